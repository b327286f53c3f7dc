"""What a run says in a few sentences: what was found, how sure that is, what would change it."""

from highd_lc.reporting import html, labels
from highd_lc.reporting.certainty_words import change, concentration
from highd_lc.reporting.pages_multiverse import range_words
from highd_lc.reporting.run_words import (
    RunTables,
    Said,
    added_said,
    against_paper,
    cautions_of,
    cell_of,
    gain_said,
    interval_said,
    lowered,
    nothing_said,
    planned,
    sides_said,
    unbroken,
)
from highd_lc.vocab import names


def run_in_short(run: RunTables) -> str:
    """The run in a few sentences: the first form that was planned, under two accountings, and the cautions."""
    if not planned(run):
        return nothing_said(run)
    form = planned(run)[0]
    text = f"{labels.FORMS[form]}, accounting “equal”: {lowered(gain_said(run, form))}"
    paper = f"Under “paper”: {against_paper(run, form)}."
    across = [] if run.multiverse.empty else [range_words(run.multiverse)]
    return unbroken(" ".join([text, *added_said(run, form), paper, *across, *cautions_of(run, [form])]))


def in_short(run: RunTables) -> list[Said]:
    """Three headings for who reads no further: what was found, how sure that is, what would change it."""
    if not planned(run):
        return []
    form = planned(run)[0]
    cell = cell_of(run, form, names.EQUAL)
    if html.is_missing(cell.gain):
        return []
    found = (
        f"{labels.FORMS[form]}, both sides charged over the same time: the local optimum has {change(cell.gain)} "
        f"total loss than the benchmark, as simulated. {sides_said(cell)}"
    )
    beside = f"Beside how well the followers are predicted: {lowered(run.believed)}" if run.believed else ""
    sure = [f"{html.begun(interval_said(run, form, names.EQUAL))}.", concentration(cell), beside]
    other = [range_words(run.multiverse), f"Under the accounting “paper”: {against_paper(run, form)}."]
    said = (
        ("What was found", [found]),
        ("How sure that is", [" ".join(filter(None, sure)), *cautions_of(run, [form])]),
        ("What would change it", [" ".join(other)]),
    )
    return [(title, tuple(map(unbroken, texts))) for title, texts in said]
