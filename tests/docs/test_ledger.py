"""docs/ledger.md is what the shipped scenarios give: the same words, numbers to the last printed digit."""

import re
from pathlib import Path

from highd_lc.io import settings as settings_file
from highd_lc.scenarios.ledger import Book, rows_of_printed_state
from highd_lc.scenarios.run import rows_of_variants
from highd_lc.stages.scenario_pages import ledger_text
from highd_lc.stages.scenarios import ledger_frames
from highd_lc.vocab.scenarios import ScenarioSettings

PAGE = Path(__file__).parents[2] / "docs" / "ledger.md"
NUMBER = re.compile(r"-?\d+\.\d+")


def test_the_ledger_is_fresh():
    settings = settings_file.load_pipeline("scenarios", ScenarioSettings)
    cells = rows_of_variants(settings, threads=2) + rows_of_printed_state(settings)
    made, kept = ledger_text(ledger_frames(Book.of(cells, settings))), PAGE.read_text(encoding="utf-8")
    assert NUMBER.sub("#", made) == NUMBER.sub("#", kept), "make ledger writes docs/ledger.md anew"
    for ours, theirs in zip(NUMBER.findall(made), NUMBER.findall(kept), strict=True):
        assert abs(float(ours) - float(theirs)) < 0.011, (ours, theirs)
