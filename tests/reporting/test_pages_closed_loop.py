"""The closed loop's page: contacts per cause beside the human's, and words where there is nothing."""

from sample_drives import DRIVES

from highd_lc.reporting.pages_closed_loop import NOTHING, closed_loop_page, said


def test_contacts_are_told_beside_the_humans():
    words = said(DRIVES)
    assert "of 2 driven" in words
    assert "Benchmark, replanned 0" in words
    assert "Local optimum, replanned 1" in words
    assert "recorded humans 1" in words


def test_every_cause_has_its_row():
    page = closed_loop_page(DRIVES)
    assert "HV 1 drives through AV" in page
    assert "touches that of target leader" in page
    assert "leaders do otherwise than predicted" in page
    assert "as recorded" in page
    assert "turned back" in page
    assert "0.250" in page


def test_without_drives_the_page_says_why():
    page = closed_loop_page(DRIVES.iloc[:0])
    assert said(DRIVES.iloc[:0]) == NOTHING
    assert NOTHING in page
    assert "Contacts by cause" not in page


def test_without_a_contact_there_is_no_table_of_causes():
    page = closed_loop_page(DRIVES[DRIVES["contacts"] == 0])
    told = page.split('id="contacts"', 1)[1].split("</section>", 1)[0]
    assert "No AV touches anybody" in told
    assert "<table" not in told
