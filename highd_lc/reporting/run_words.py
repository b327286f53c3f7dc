"""What a run says, in plain words: every number is looked up in the tables, and every sentence follows from it.

The voice is the same whatever the numbers are: better, worse and undecided are told alike, and what is not known
is said with the reason.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import pandas as pd

from highd_lc.reporting import html, labels
from highd_lc.reporting.certainty_words import (
    amount,
    between,
    change,
    concentration,
    counted,
    incremental,
    interval,
    multiplicity,
    selection,
)
from highd_lc.reporting.figures_population import ALL
from highd_lc.reporting.pages_multiverse import range_words
from highd_lc.scoring.population import BOOTSTRAP_T, LEAST_CLUSTERS, PERCENTILE, STUDENT
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.tables.studies import TOGETHER

Said = tuple[str, tuple[str, ...]]
"""A heading of few words, and the paragraphs below it."""

FEW_EVENTS: Final = 30
"""Below this many, single events can carry a result."""

_COMPARED: Final = (
    "Two plans for the same lane change: the benchmark makes the AV's own loss as low as it can (self-optimum); "
    "the local optimum does so with the mean of the AV's and the followers' losses. A loss adds up jerk and the "
    "difference from a reference speed.",
    "A plan ends at the speed at which it starts (fixed) or at any (free); with a chosen start the AV may also "
    "wait and choose the gap. Unless said otherwise, AV and followers are charged over the same time (accounting "
    "“equal”).",
)
_LIMITS: Final = (
    "Nobody drove these plans. The followers are simulated by car-following models, fitted where possible to how "
    "each drove before the lane change; they do not look ahead and never change lane, and the vehicles ahead do "
    "not react to the AV.",
    "Whether real drivers would answer in the same way, these numbers cannot say, nor what a plan means for risk "
    "or for traffic beyond the few vehicles that are simulated.",
)


@dataclass(frozen=True)
class RunTables:
    """What is put into words: artefacts of a whole run (matrix: ``validation_matrix``, worse:
    ``worse_for_somebody``), the coverage of its intervals, and the relative difference that counts as a tie.

    clusters: what intervals vary over, "recording" or "location"; interval: how they are made; omega_av: weight of
    the AV in the local optimum; believed: whether the gain can be seen beside the model's error, in words.
    """

    recordings: pd.DataFrame
    crossings: pd.DataFrame
    events: pd.DataFrame
    losses: pd.DataFrame
    matrix: pd.DataFrame
    worse: pd.DataFrame
    leave_one_out: pd.DataFrame
    confidence: float
    tie_band: float
    clusters: str = "recording"
    interval: str = BOOTSTRAP_T
    omega_av: float = 0.5
    multiverse: pd.DataFrame = field(default_factory=pd.DataFrame)
    believed: str = ""

    @cached_property
    def cells(self) -> dict[Any, Any]:
        """The rows of the matrix over all events, by form and accounting."""
        whole = self.matrix[self.matrix["stratum"] == ALL]
        return {(row.form, row.accounting): row for row in whole.itertuples(index=False)}


def run_says(run: RunTables) -> list[Said]:
    """What the run says, heading by heading, from what went in to what it cannot say."""
    said = [(title, tuple(map(unbroken, texts))) for title, texts in _headings(run)]
    return [(title, texts) for title, texts in said if texts]


def _headings(run: RunTables) -> Iterator[tuple[str, Iterable[str]]]:
    forms = planned(run)
    yield "What went in", [_went_in(run)]
    if not forms:
        yield "What comes out", [nothing_said(run)]
        return
    yield "What is compared", _COMPARED
    yield from ((labels.FORMS[form], _of_form(run, form)) for form in forms)
    yield "Not planned", _not_planned(run)
    yield "What the accounting changes", _accountings(run)
    yield "What other choices would change", [range_words(run.multiverse)]
    yield "Other places", [_locations(run)]
    yield "Who was selected", selection(run.crossings, cell_of(run, forms[0], names.EQUAL))
    yield "What was filmed", [_observed(run), *_leader_seen(run)]
    yield "Caution", cautions_of(run, forms)
    yield "What it cannot say", _LIMITS


def unbroken(text: str) -> str:
    """With no line break between a number and its percent sign."""
    return text.replace(" %", "\u00a0%")


def planned(run: RunTables) -> list[str]:
    """The forms that have a row in the matrix, the primary one first; none without events."""
    forms = [] if run.events.empty else PAIRS
    return [form for form in forms if cell_of(run, form, names.EQUAL) is not None]


def cell_of(run: RunTables, form: str, accounting: str) -> Any:
    """The row of the matrix over all events; None if the form was not planned."""
    return run.cells.get((form, accounting))


def _solved(cell: Any) -> int:
    return int(cell.n_events - cell.infeasible - cell.contacts)


def lowered(text: str) -> str:
    """With a small first letter."""
    return text[:1].lower() + text[1:]


def _went_in(run: RunTables) -> str:
    read = counted(run.recordings["recording_id"].nunique(), "recording")
    found = counted(len(run.crossings), "lane-id change")
    if run.events.empty:
        return f"Read: {read} with {found}; none of these is a usable lane change{_commonest(run)}."
    used = counted(run.events["recording_id"].nunique(), "recording")
    left = len(run.crossings) - len(run.events)
    usable = f"{len(run.events)} of these can be used as events, from {used}; {left} cannot{_commonest(run)}"
    return f"Read: {read} with {found}. {usable}."


def _commonest(run: RunTables) -> str:
    """The reason that excludes most lane-id changes, as the end of a sentence."""
    reasons = run.crossings.loc[~run.crossings["usable"].astype(bool), "reason"].value_counts()
    if reasons.empty:
        return ""
    return f", most often because {labels.REASONS[reasons.index[0]]} ({reasons.iloc[0]})"


def nothing_said(run: RunTables) -> str:
    """Why a run without plans says nothing."""
    if not run.events.empty:
        why = "no plans were made in this run"
    elif run.crossings.empty:
        why = "no usable event, because no lane-id change was found"
    else:
        why = f"no usable event, because not one of {counted(len(run.crossings), 'lane-id change')} can be used"
    return f"Nothing can be said of the local optimum: {why}."


def _of_form(run: RunTables, form: str) -> Iterator[str]:
    cell = cell_of(run, form, names.EQUAL)
    yield f"{_sample(run, cell)}{gain_said(run, form)}"
    if _solved(cell):
        yield " ".join([*added_said(run, form), concentration(cell)])
        yield f"{_shares(run, cell)} {_infeasible(cell)}"
        yield f"{sides_said(cell)} {_followers(run, form)}"


def _sample(run: RunTables, cell: Any) -> str:
    """Which events, where they are not all: a start is chosen for a sample of them."""
    if cell.n_events == len(run.events):
        return ""
    return f"Planned for a sample of {cell.n_events} of the {counted(len(run.events), 'event')}. "


def _infeasible(cell: Any) -> str:
    if not cell.infeasible + cell.contacts:
        return "Every event has a feasible plan of both policies."
    if cell.contacts:
        left = counted(int(cell.infeasible), "event")
        met = counted(int(cell.contacts), "event")
        return f"{left} without a feasible plan of both policies and {met} with a contact are left out."
    has, is_ = ("has", "is") if cell.infeasible == 1 else ("have", "are")
    return f"{counted(int(cell.infeasible), 'event')} {has} no feasible plan of both policies and {is_} left out."


def gain_said(run: RunTables, form: str) -> str:
    """A sentence on the gain under the primary accounting with its interval, and what its sign is worth."""
    cell = cell_of(run, form, names.EQUAL)
    if html.is_missing(cell.gain):
        return f"No gain can be given: {_no_plan(cell)}."
    sure = interval_said(run, form, names.EQUAL)
    text = f"The local optimum has {change(cell.gain)} total loss than the benchmark ({sure})."
    return " ".join([text, *_verdict(run, cell)])


def added_said(run: RunTables, form: str) -> list[str]:
    """A sentence on what of the added loss is saved; none where no plans are compared."""
    cell = cell_of(run, form, names.EQUAL)
    return [incremental(cell, unit=run.clusters, confidence=run.confidence)] if _solved(cell) else []


def _no_plan(cell: Any) -> str:
    return f"none of {counted(int(cell.n_events), 'event')} has a feasible plan of both policies"


def interval_said(run: RunTables, form: str, accounting: str) -> str:
    """The interval of a form's gain under an accounting, or why there is none."""
    cell = cell_of(run, form, accounting)
    n = int(cell.n_clusters)
    return interval(cell.gain_low, cell.gain_high, n, run.clusters, confidence=run.confidence)


def _verdict(run: RunTables, cell: Any) -> Iterator[str]:
    """What follows from the sign: nothing where the plan is chosen for the lowest total by who scores it.

    That is said once, of the first form.
    """
    if run.omega_av == _SAME_GOAL:
        if cell.gain < -run.tie_band:
            yield _FAULT
        elif cell.form == planned(run)[0]:
            yield _CERTAIN
        return
    if html.is_missing(cell.gain_low):
        return
    if cell.gain_low <= 0.0 <= cell.gain_high:
        yield "The interval includes zero: this run does not tell which of the two has the lower loss."
        return
    lower = "local optimum" if cell.gain_low > 0.0 else "benchmark"
    yield f"The interval excludes zero: in this run the {lower} has the lower loss."


_SAME_GOAL: Final = 0.5
"""Weight of the AV with which the local optimum minimises half of the total that is reported."""
_CERTAIN: Final = (
    "That it is not more was certain before, here and in the other forms: the plan is the one of the lowest total "
    "by the same simulated followers that then score it. Only the size can be found out, and whether other "
    "followers say the same."
)
_FAULT: Final = (
    "That it is more cannot be: the plan is the one of the lowest total by the same simulated followers that then "
    "score it. Something is wrong with the planning of this run."
)


def _shares(run: RunTables, cell: Any) -> str:
    tied = round(1.0 - cell.share_better - cell.share_worse, 12)  # nothing left is nothing, not a rest of digits
    better, worse, same = (f"{amount(share, 1)} %" for share in (cell.share_better, cell.share_worse, tied))
    return (
        f"Of {counted(_solved(cell), 'event')} the local optimum is better in {better}, worse in {worse}, and "
        f"within {_band(run)} of the benchmark in {same}."
    )


def _band(run: RunTables) -> str:
    return f"{100.0 * run.tie_band:g} %"


_PARTIES: Final = {
    (False, True): ": the AV pays, the followers gain",
    (True, False): ": the AV gains, the followers pay",
    (True, True): ": both gain",
    (False, False): ": both pay",
}


def sides_said(cell: Any) -> str:
    """Who pays and who gains."""
    av, hv = cell.gain_av, cell.gain_hv
    if html.is_missing(av) or html.is_missing(hv):
        return "Who pays cannot be said: one side has no loss under the benchmark to compare with."
    parties = _PARTIES[av > 0.0, hv > 0.0] if av and hv else ""
    lower = "The AV's loss is {}, the followers' together {}{}."
    return lower.format(*(change(side, "lower", "higher") for side in (av, hv)), parties)


def _followers(run: RunTables, form: str) -> str:
    """In how many events a single follower loses, though all of them together may gain."""
    rows = run.worse[(run.worse["form"] == form) & (run.worse["accounting"] == names.EQUAL)]
    rows = rows[rows["who"] != TOGETHER]
    if rows.empty:
        return f"No single follower loses more than {_band(run)} in any event."
    lost, most = counted(rows["event_id"].nunique(), "event"), html.percent(rows["increase"].max())
    return f"In {lost} a single follower loses more than {_band(run)}, the worst off {most}."


def _not_planned(run: RunTables) -> Iterator[str]:
    missing = [labels.FORMS[form] for form in PAIRS if form not in planned(run)]
    if missing:
        yield f"{'; '.join(missing)}: this run made no such plans, so that nothing is said of them."


def _accountings(run: RunTables) -> Iterator[str]:
    yield (
        "Under “paper” both sides are charged only until the manoeuvre ends, so that a shorter one is charged for "
        "less time; plans are made anew under each accounting. The local optimum then has:"
    )
    yield from (f"{labels.FORMS[form]}: {against_paper(run, form)}." for form in planned(run))


def against_paper(run: RunTables, form: str) -> str:
    """The gain under “paper”, and how far that is from the one under “equal”."""
    paper, equal = (cell_of(run, form, accounting) for accounting in (names.PAPER, names.EQUAL))
    if paper is None:
        return "no gain that is known, because the tables hold no such row"
    if html.is_missing(paper.gain):
        return f"no gain that can be given, because {_no_plan(paper)}"
    text = f"{change(paper.gain)} total loss ({interval_said(run, form, names.PAPER)})"
    return text if html.is_missing(equal.gain) else f"{text}, {_points(paper.gain, equal.gain)}"


def _points(paper: float, equal: float) -> str:
    points = 100.0 * (paper - equal)
    turned = ", with the other sign" if paper * equal < 0.0 else ""
    more = "more" if points >= 0.0 else "less"
    return f"{html.number(abs(points), 2)} percentage points {more} gain than under “equal”{turned}"


def _locations(run: RunTables) -> str:
    """Whether a single site carries the result of the first form."""
    table, form = run.leave_one_out, planned(run)[0]
    rows = table[(table["form"] == form) & (table["accounting"] == names.EQUAL)]
    gains = rows["gain"].dropna()
    if len(rows) == 1:
        return "All events are of one location: whether another would say the same is not known."
    if gains.empty:
        return "Whether one location carries the result is not known: no gain is left without it."
    text = f"{labels.FORMS[form]}, leaving out one of {len(rows)} locations after the other:"
    return f"{text} {between(gains.min(), gains.max())} total loss."


def _observed(run: RunTables) -> str:
    cell = cell_of(run, planned(run)[0], names.EQUAL)
    share = getattr(cell, "share_observed", None)
    if share is None or html.is_missing(share):
        return "The filmed share of the charged follower-seconds is not available: the tables do not hold it."
    return (
        f"{html.percent(share, 1)} of the follower-seconds charged (counted for the human's lane change). "
        "In the others the follower or the ego had left the view: there is no recording to compare the simulation "
        "with."
    )


def _leader_seen(run: RunTables) -> Iterator[str]:
    """How long the target leader is filmed."""
    seen = cell_of(run, planned(run)[0], names.EQUAL).leader_seen_s
    if not html.is_missing(seen):
        yield (
            f"The leader on the target lane is filmed for {html.number(seen, 1)} s after the start on average; "
            "how it drives on from there is assumed."
        )


def cautions_of(run: RunTables, forms: Sequence[str]) -> Iterator[str]:
    """What the reader should not lean on: no or few clusters, one place, many cells, few events."""
    used = [int(cell_of(run, form, names.EQUAL).n_clusters) for form in forms]
    yield from _few_clusters(run, min(used), max(used))
    if len(set(run.recordings["location_id"])) == 1 and max(used) >= LEAST_CLUSTERS:
        yield "All recordings are of one location: the intervals vary over them, and say nothing of other places."
    if len(forms) > 1 and run.matrix["gain_low"].notna().any():
        yield multiplicity(run.matrix, confidence=run.confidence)
    yield from (text for form in forms for text in _few_events(run, form))


def _few_clusters(run: RunTables, least: int, most: int) -> Iterator[str]:
    few = _ENOUGH[run.interval]
    if most < LEAST_CLUSTERS and run.interval != PERCENTILE:
        yield "Without an interval nothing is known of how far chance carries these numbers."
    elif least < few:
        here = " to ".join(str(n) for n in sorted({least, most}))
        yield (
            f"With fewer than {few} {run.clusters}s (here {here}) the intervals were not found to cover what they "
            "say: they may be too narrow."
        )


_ENOUGH: Final = {BOOTSTRAP_T: LEAST_CLUSTERS, PERCENTILE: 60, STUDENT: 60}
"""Clusters from which on each kind of interval was found to cover what it says (equations.md 12.2)."""


def _few_events(run: RunTables, form: str) -> Iterator[str]:
    solved = _solved(cell_of(run, form, names.EQUAL))
    if 0 < solved < FEW_EVENTS:
        rests = f"{labels.FORMS[form]}: the result rests on {counted(solved, 'event')}"
        yield f"{rests}, and a single one can carry it."
