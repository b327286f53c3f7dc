"""The finished artefacts of a whole run to the pages that show it as a whole."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.car_following import TIME_STEP, simulate
from highd_lc.io import artefacts
from highd_lc.io.follower_tracks import track_of
from highd_lc.reporting.event import FitTrace
from highd_lc.reporting.pages_calibration import CalibrationTables, calibration_page
from highd_lc.reporting.pages_data import data_page, excluded_page
from highd_lc.reporting.pages_index import IndexTables, index_page
from highd_lc.reporting.pages_population import dictionary_page, matrix_page
from highd_lc.reporting.pages_start import StartTables, start_page
from highd_lc.reporting.pages_studies import StudyTables, studies_page
from highd_lc.reporting.pages_summary import SummaryTables, summary_page
from highd_lc.reporting.run_words import RunTables, run_in_short, run_says
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import PARAMETERS
from highd_lc.vocab.settings import StatisticsSettings

FloatArray = NDArray[np.float64]

_KEY: Final = ["event_id", "policy", "accounting"]
_SAFE_STEP_M: Final = 0.1


def overview_pages(work: Path, *, raw: bool, statistics: StatisticsSettings) -> Iterator[tuple[str, str]]:
    """File name and text of each overview page.

    raw: recorded motion at full resolution; statistics: how the intervals and ties in the artefacts were made.
    """
    events, crossings, recordings = (artefacts.read(work, n) for n in ("events", "crossings", "recordings"))
    losses = artefacts.read(work, "losses", columns=[*_KEY, "loss_av", "loss_hv", "loss_total"])
    pages, matrix = artefacts.read(work, "event_pages"), artefacts.read(work, "validation_matrix")
    studies = StudyTables(**{name: artefacts.read(work, name) for name in StudyTables.__dataclass_fields__})
    calibration = _calibration(work, raw=raw)
    plans = artefacts.read(work, "plans", columns=[*_KEY, "status"])
    run = RunTables(
        recordings=recordings,
        crossings=crossings,
        events=events,
        losses=losses,
        matrix=matrix,
        worse=studies.worse_for_somebody,
        leave_one_out=studies.leave_one_out,
        confidence=statistics.confidence,
        tie_band=statistics.tie_band,
    )
    index = IndexTables(events, crossings, plans, losses, matrix, pages)
    yield "index.html", index_page(index, raw=raw, says=run_in_short(run))
    yield (
        "summary.html",
        summary_page(
            SummaryTables(
                events=events,
                crossings=crossings,
                losses=losses,
                matrix=matrix,
                summary_losses=artefacts.read(work, "summary_losses"),
                summary_lcm=calibration.summary,
                recordings=recordings,
                gain_map=artefacts.read(work, "gain_map"),
                pareto=studies.pareto,
                pareto_summary=studies.pareto_summary,
                pages=pages,
            ),
            run_says(run),
        ),
    )
    yield "matrix.html", matrix_page(matrix)
    yield "studies.html", studies_page(studies)
    yield (
        "start.html",
        start_page(StartTables(*(artefacts.read(work, n) for n in ("start_map", "foresight_summary")))),
    )
    yield "calibration.html", calibration_page(calibration)
    yield "data.html", data_page(recordings, crossings, events)
    yield "excluded.html", excluded_page(crossings)
    yield "dictionary.html", dictionary_page()


def _calibration(work: Path, *, raw: bool) -> CalibrationTables:
    followers = artefacts.read(work, "followers")
    return CalibrationTables(
        summary=artefacts.read(work, "summary_lcm"),
        followers=followers,
        identifiability=artefacts.read(work, "identifiability"),
        pooling=artefacts.read(work, "pooling"),
        examples=tuple(_examples(work, followers, raw=raw)),
    )


def _examples(work: Path, followers: pd.DataFrame, *, raw: bool) -> Iterator[tuple[str, FitTrace]]:
    """The fits with the smallest, the median and the largest objective."""
    fitted = followers[followers["status"] == names.FITTED].sort_values(["objective", "event_id", "follower"])
    for title, place in (("best", 0), ("median", len(fitted) // 2), ("worst", len(fitted) - 1)):
        if len(fitted):
            fit = fitted.iloc[place]
            yield f"{title}: {fit['event_id']}, HV {fit['follower']}", _trace(work, fit, raw=raw)


def _trace(work: Path, fit: pd.Series, *, raw: bool) -> FitTrace:
    tracks = artefacts.read(work, "follower_tracks", recording=int(fit["recording_id"]))
    chosen = tracks[(tracks["event_id"] == fit["event_id"]) & (tracks["follower"] == fit["follower"])]
    recorded = track_of(chosen.iloc[0])
    simulated = simulate(recorded, fit[list(PARAMETERS)].to_numpy(float))
    return FitTrace(
        t=TIME_STEP * np.arange(recorded.x.size),
        spacing_recorded=_safe(recorded.spacing, raw),
        spacing_simulated=_safe(recorded.leader_x - simulated.x, raw),
        speed_recorded=_safe(recorded.v, raw),
        speed_simulated=_safe(simulated.v, raw),
    )


def _safe(values: FloatArray, raw: bool) -> FloatArray:
    # A figure on a page is vectors: what it draws can be read back.
    return values if raw else _SAFE_STEP_M * np.rint(values / _SAFE_STEP_M)
