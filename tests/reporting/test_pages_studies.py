"""The page of studies: contacts of tracked drives by cause, and words where there are none."""

from dataclasses import replace

from sample_studies import studies

from highd_lc.reporting.pages_studies import studies_page


def section_of(page):
    return page.split("Contacts of tracked drives</h2>", 1)[1].split("</section>", 1)[0]


def test_contacts_of_tracked_drives_are_told_by_cause():
    found = section_of(studies_page(studies()))
    assert "8 of plans that a search chose, 2 of references" in found
    assert "HV 1 drives through AV" in found
    assert "the car beside its plan" in found


def test_without_a_contact_there_are_words_and_no_table():
    tables = studies()
    found = section_of(studies_page(replace(tables, tracking_contacts=tables.tracking_contacts.iloc[:0])))
    assert "0 of plans that a search chose, 0 of references" in found
    assert "<table" not in found
