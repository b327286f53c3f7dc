"""The finished artefacts of a whole run to the pages that show it as a whole.

Report and scenarios in one folder: which of them is there, and the links between finished pages.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.car_following import TIME_STEP, simulate
from highd_lc.core.drive import hardest_braking
from highd_lc.io import artefacts
from highd_lc.io.atomic import whole_file
from highd_lc.reporting import html, pages_scenarios
from highd_lc.reporting.event import FitTrace
from highd_lc.reporting.follower_words import LOSS_COLUMNS
from highd_lc.reporting.follower_words import PAGE as PREDICTION_PAGE
from highd_lc.reporting.html import TO_REPORT, TO_SCENARIOS, Crosslink
from highd_lc.reporting.pages_closed_loop import PAGE as CLOSED_LOOP_PAGE
from highd_lc.reporting.pages_closed_loop import closed_loop_page
from highd_lc.reporting.pages_data import Section, believed_section, data_page, empty_page, excluded_page
from highd_lc.reporting.pages_followers import CalibrationTables, calibration_page
from highd_lc.reporting.pages_index import IndexTables, SummaryTables, index_page, summary_page
from highd_lc.reporting.pages_multiverse import PAGE as MULTIVERSE_PAGE
from highd_lc.reporting.pages_multiverse import multiverse_page
from highd_lc.reporting.pages_population import PriceTables, StartTables, dictionary_page, matrix_page, start_page
from highd_lc.reporting.pages_prediction import PREDICTION_READ, PredictionTables, prediction_page
from highd_lc.reporting.pages_studies import StudyTables, studies_page
from highd_lc.reporting.run_words import RunTables, nothing_said, run_says
from highd_lc.reporting.short_words import in_short, run_in_short
from highd_lc.stages.prediction_tables import followers_believed, is_judged
from highd_lc.stages.scenes import track_of
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.prediction import JUDGED
from highd_lc.vocab.tracking import TRACKED

FloatArray = NDArray[np.float64]

_KEY: Final = ["event_id", "policy", "accounting"]
_SAFE_STEP_M: Final = 0.1


@dataclass(frozen=True)
class Overview:
    """What the overview pages of a run are made from.

    raw: recorded motion at full resolution; statistics: how the intervals and ties in the artefacts were made;
    b_max: bound of the simulated followers' braking, as in the settings; model: the default follower model;
    omega_av: weight of the AV in the local optimum.
    """

    work: Path
    raw: bool
    statistics: StatisticsSettings
    b_max: float
    model: str
    omega_av: float = 0.5

    def read(self, *tables: str, columns: list[str] | None = None) -> dict[str, pd.DataFrame]:
        """Finished artefacts by their names; of those that follower models made, the rows of the default one."""
        return {name: self._read(name, columns) for name in tables}

    def _read(self, name: str, columns: list[str] | None) -> pd.DataFrame:
        if "followers" not in TABLES[name].column_names:
            return artefacts.read(self.work, name, columns=columns)
        wanted = columns and [*columns, "followers"]
        return artefacts.read(self.work, name, columns=wanted, where=[("followers", "==", self.model)])

    def losses(self) -> pd.DataFrame:
        """The losses without their terms."""
        return self._read("losses", [*_KEY, "loss_av", "loss_hv", "loss_total", *LOSS_COLUMNS])

    @cached_property
    def believed(self) -> tuple[str, ...]:
        """How far the simulated followers can be believed."""
        return followers_believed(self.work, self.model)

    @cached_property
    def first(self) -> Section:
        """What stands in front of every gain: how far the followers can be believed."""
        return believed_section(self.believed, linked=PREDICTION_PAGE not in missing_pages(self.work))


def page_of(name: str, overview: Overview) -> bytes:
    """An overview page by its file's name, one of ``OVERVIEW_PAGES`` that is not missing."""
    empty = name in _SHOWN and artefacts.read(overview.work, _SHOWN[name][1], columns=["event_id"]).empty
    page = _without_events(name, overview) if empty else _MAKERS[name](overview)
    return html.without(page, missing_pages(overview.work)).encode("utf-8")


def _without_events(name: str, overview: Overview) -> str:
    run = _run_tables(overview)
    return empty_page(name, _SHOWN[name][0], nothing_said(run), run.crossings)


def missing_pages(work: Path) -> tuple[str, ...]:
    """The overview pages that cannot be made, because the work folder is of a run without their tables."""
    return () if is_judged(work) else (PREDICTION_PAGE,)


def _index(overview: Overview) -> str:
    (plans,) = overview.read("plans", columns=[*_KEY, "status"]).values()
    run, pages = _run_tables(overview), artefacts.read(overview.work, "event_pages")
    index = IndexTables(run.events, run.crossings, plans, run.losses, run.matrix, pages)
    return index_page(index, raw=overview.raw, says=run_in_short(run), believed=overview.first)


def _summary(overview: Overview) -> str:
    run, pages = _run_tables(overview), artefacts.read(overview.work, "event_pages")
    tables = SummaryTables(
        events=run.events,
        crossings=run.crossings,
        losses=run.losses,
        matrix=artefacts.read(overview.work, "validation_matrix"),
        recordings=run.recordings,
        pages=pages,
        further=_further(overview),
        **overview.read("summary_losses", "summary_lcm", "gain_map", "pareto", "pareto_summary"),
    )
    return summary_page(tables, run_says(run), [overview.first], short=in_short(run))


def _run_tables(overview: Overview) -> RunTables:
    matrix, worse = overview.read("validation_matrix", "worse_for_somebody").values()
    return RunTables(
        losses=overview.losses(),
        matrix=matrix,
        worse=worse,
        confidence=overview.statistics.confidence,
        tie_band=overview.statistics.tie_band,
        clusters=overview.statistics.clusters,
        interval=overview.statistics.interval,
        omega_av=overview.omega_av,
        multiverse=artefacts.read(overview.work, "multiverse"),
        believed=next((text for text in overview.believed if "gain can" in text), ""),
        **overview.read("recordings", "crossings", "events", "leave_one_out"),
    )


def _matrix(overview: Overview) -> str:
    price = PriceTables(**overview.read(*PriceTables.__dataclass_fields__))
    matrix = artefacts.read(overview.work, "validation_matrix")
    return matrix_page(matrix, [overview.first], price=price, confidence=overview.statistics.confidence)


def _studies(overview: Overview) -> str:
    # Contacts are told of every follower model: they count for no gain that would have to be of one.
    whole = {"tracking_contacts": artefacts.read(overview.work, "tracking_contacts")}
    tables = overview.read(*StudyTables.__dataclass_fields__) | whole
    return studies_page(StudyTables(**tables), [overview.first])


def _multiverse(overview: Overview) -> str:
    return multiverse_page(artefacts.read(overview.work, "multiverse"), [overview.first])


def _closed_loop(overview: Overview) -> str:
    return closed_loop_page(artefacts.read(overview.work, "closed_loop"), [overview.first])


def write_multiverse(work: Path, reports: Path, settings: ValidateSettings) -> None:
    """Write the page of the multiverse alone. work: of a finished validation; settings: of the run."""
    model, b_max = settings.follower_models[0], settings.followers.b_max
    page = page_of(
        MULTIVERSE_PAGE, Overview(work, False, settings.statistics, b_max, model, settings.loss.omega_av)
    )
    reports.mkdir(parents=True, exist_ok=True)
    with whole_file(reports / MULTIVERSE_PAGE) as sink:
        sink.write(TO_SCENARIOS.opened(page) if has_scenarios(reports) else page)


def _prediction(overview: Overview) -> str:
    errors = overview.read("prediction", columns=[*PREDICTION_READ])
    others = overview.read(*(name for name in JUDGED if name not in errors))
    return prediction_page(PredictionTables(**errors, **others, losses=overview.losses()))


def _start(overview: Overview) -> str:
    return start_page(StartTables(*overview.read("start_map", "foresight_summary").values()))


def _data(overview: Overview) -> str:
    recordings, crossings, events = overview.read("recordings", "crossings", "events").values()
    return data_page(recordings, crossings, events, _further(overview))


def _excluded(overview: Overview) -> str:
    return excluded_page(artefacts.read(overview.work, "crossings"), _further(overview))


def _further(overview: Overview) -> dict[str, frozenset[str]]:
    """The events that were calibrated, planned, tracked and reported."""
    followers = artefacts.read(overview.work, "followers", columns=["event_id", "follower", "status"])
    (plans,) = overview.read("plans", columns=[*_KEY, "status"]).values()
    (driven,) = overview.read("tracking", columns=["event_id", "policy", "status"]).values()
    primary = plans["accounting"] == names.PRIMARY_ACCOUNTING
    planned, tracked = (frame[frame["policy"] == names.LOCAL_OPTIMUM] for frame in (plans[primary], driven))
    found = {
        "calibrated": followers[(followers["follower"] == 1) & (followers["status"] == names.FITTED)],
        "planned": planned[planned["status"] == names.SOLVED],
        "tracked": tracked[tracked["status"] == TRACKED],
        "reported": artefacts.read(overview.work, "event_pages", columns=["event_id"]),
    }
    return {word: frozenset(rows["event_id"]) for word, rows in found.items()}


def _dictionary(overview: Overview) -> str:
    return dictionary_page()


def _calibration_page(overview: Overview) -> str:
    return calibration_page(_calibration(overview))


_MAKERS: Final[Mapping[str, Callable[[Overview], str]]] = {
    "summary.html": _summary,
    "index.html": _index,
    "matrix.html": _matrix,
    "studies.html": _studies,
    MULTIVERSE_PAGE: _multiverse,
    CLOSED_LOOP_PAGE: _closed_loop,
    "calibration.html": _calibration_page,
    PREDICTION_PAGE: _prediction,
    "data.html": _data,
    "start.html": _start,
    "excluded.html": _excluded,
    "dictionary.html": _dictionary,
}
_SHOWN: Final = {
    "matrix.html": ("Validation matrix", "losses"),
    "studies.html": ("Robustness", "losses"),
    MULTIVERSE_PAGE: ("Multiverse", "losses"),
    CLOSED_LOOP_PAGE: ("Closed loop", "losses"),
    "start.html": ("Choice of the start", "losses"),
    "calibration.html": ("Calibration", "followers"),
}
"""Pages of results alone: title, and the table without whose rows there is nothing to show."""
OVERVIEW_PAGES: Final = tuple(_MAKERS)
"""File names of the overview pages, the slowest first, so that in parallel none is still running at the end.

Of a work folder without their tables, ``missing_pages`` are left out.
"""


def _calibration(overview: Overview) -> CalibrationTables:
    work = overview.work
    followers = artefacts.read(work, "followers")
    return CalibrationTables(
        summary=artefacts.read(work, "summary_lcm"),
        followers=followers,
        identifiability=artefacts.read(work, "identifiability"),
        pooling=artefacts.read(work, "pooling"),
        examples=tuple(_examples(overview, followers)),
    )


def _examples(overview: Overview, followers: pd.DataFrame) -> Iterator[tuple[str, FitTrace]]:
    """The fits with the smallest, the median and the largest objective."""
    fitted = followers[followers["status"] == names.FITTED].sort_values(["objective", "event_id", "follower"])
    for title, place in (("best", 0), ("median", len(fitted) // 2), ("worst", len(fitted) - 1)):
        if len(fitted):
            fit = fitted.iloc[place]
            yield f"{title}: {fit['event_id']}, HV {fit['follower']}", _trace(overview, fit)


def _trace(overview: Overview, fit: pd.Series) -> FitTrace:
    raw, hardest = overview.raw, hardest_braking(overview.b_max)
    tracks = artefacts.read(overview.work, "follower_tracks", recording=int(fit["recording_id"]))
    chosen = tracks[(tracks["event_id"] == fit["event_id"]) & (tracks["follower"] == fit["follower"])]
    recorded = track_of(chosen.iloc[0])
    simulated = simulate(recorded, fit[list(PARAMETERS)].to_numpy(float), hardest=hardest)
    return FitTrace(
        t=TIME_STEP * np.arange(recorded.x.size, dtype=np.float64),
        spacing_recorded=_safe(recorded.spacing, raw),
        spacing_simulated=_safe(recorded.leader_x - simulated.x, raw),
        speed_recorded=_safe(recorded.v, raw),
        speed_simulated=_safe(simulated.v, raw),
    )


def _safe(values: FloatArray, raw: bool) -> FloatArray:
    # A figure on a page is vectors: what it draws can be read back.
    return values if raw else _SAFE_STEP_M * np.rint(values / _SAFE_STEP_M)


_SCENARIOS: Final = "scenarios"


def has_scenarios(reports: Path) -> bool:
    """Whether the scenarios' pages lie where the report's link leads."""
    return (reports / TO_SCENARIOS.href).is_file()


def link_to_scenarios(scenarios: Path) -> None:
    """Make a report in the parent folder link to the scenarios, if they have the name to which its link leads."""
    if scenarios.resolve().name == _SCENARIOS:
        _open(scenarios.resolve().parent, html.PAGES, TO_SCENARIOS)


def link_to_report(reports: Path) -> None:
    """Let the scenarios' pages below a report's folder lead to it, if there are any."""
    _open(reports / _SCENARIOS, pages_scenarios.PAGES, TO_REPORT)


def _open(folder: Path, pages: tuple[tuple[str, str], ...], crosslink: Crosslink) -> None:
    # Not by io.atomic: its ledger would make the pages of the one command results of the other.
    for path in (folder / name for name, _ in pages):
        before = path.read_bytes() if path.is_file() else b""
        after = crosslink.opened(before)
        if after != before:
            with whole_file(path) as sink:
                sink.write(after)
