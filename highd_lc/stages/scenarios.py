"""Scenarios: the paper's simulations planned, driven, drawn, and entered beside the published numbers."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.edie import edie
from highd_lc.core.shock_waves import WaveSpeed, wave_speed
from highd_lc.io import artefacts, workspace
from highd_lc.io.settings import digest
from highd_lc.reporting.figures_scenarios import Story
from highd_lc.reporting.labels import RECORDED
from highd_lc.scenarios import waves
from highd_lc.scenarios.arithmetic import arithmetic_rows
from highd_lc.scenarios.claims import claim_rows
from highd_lc.scenarios.ledger import Book, closest_rows, ledger_rows, rows_of_printed_state, value_of
from highd_lc.scenarios.platoon import Platoon, gaps, situations
from highd_lc.scenarios.run import (
    DEFAULT,
    Cell,
    Planned,
    av_lead,
    drive_behind,
    no_lane_change,
    plan_situation,
    rows_of_sweep,
    rows_of_variants,
)
from highd_lc.scenarios.tracking import contact_rows, tracking_rows
from highd_lc.stages.overview_pages import link_to_scenarios
from highd_lc.stages.scenario_pages import (
    Recordings,
    fitted_drivers,
    has_recordings,
    nearest_event,
    recorded_change,
    state_rows,
    write_pages,
)
from highd_lc.vocab import published as paper
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.scenarios import ScenarioSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.scenarios import COLLISION

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

_WAVE_SECONDS = 120.0
_WAVE_VEHICLES = 20
_MEASURES = {
    "flow": ("flow_veh_h", "veh/h"),
    "speed": ("speed_km_h", "km/h"),
    "density": ("density_veh_km", "veh/km"),
}


@dataclass(frozen=True)
class Given:
    """What comes from outside: recordings, and the cells of a sweep over the options, empty without one."""

    recordings: Recordings
    swept: list[Row]


def frame(name: str, rows: Iterable[Row]) -> pd.DataFrame:
    """Rows as a frame with all columns of a table, in its order."""
    columns = list(TABLES[name].column_names)
    return pd.DataFrame(list(rows), columns=columns).sort_values(list(TABLES[name].order), kind="stable")


def default_plans(settings: ScenarioSettings) -> list[Planned]:
    """Every situation with a platoon under the default options, planned for benchmark and local optimum."""
    weights = tuple(settings.weights.values())
    return [plan_situation(posed, settings, omegas=weights) for posed in situations(settings, settings.options)]


def story_of(planned: Planned, settings: ScenarioSettings) -> Story:
    """The situation as it goes on under benchmark and local optimum, with the whole platoon."""
    posed = planned.situation
    found = {
        p: planned.plan(Cell(settings.form, settings.accounting, omega)) for p, omega in settings.weights.items()
    }
    plans = {policy: plan for policy, plan in found.items() if plan is not None}
    platoons = {policy: drive_behind(posed, av_lead(posed, plan)) for policy, plan in plans.items()}
    return Story(posed.key, posed.v_av, plans, platoons, no_lane_change(posed), posed.approach)


def scenario_frames(
    planned: list[Planned],
    stories: dict[str, Story],
    *,
    settings: ScenarioSettings,
    given: Given,
    threads: int,
) -> dict[str, pd.DataFrame]:
    """All tables but those of a recorded lane change, by name. threads: over the variants."""
    cells = rows_of_variants(settings, threads=threads) + rows_of_printed_state(settings)
    book = Book.of(cells, settings, fits=given.recordings.fits)
    drivers, fitted = waves.published_drivers(), given.recordings.fitted
    if len(fitted):
        drivers[f"fitted ({len(fitted)} followers)"] = fitted
    rows: dict[str, Iterable[Row]] = {
        "contacts": contact_rows(settings),
        "rectangle": rectangle_rows(book),
        "traffic_state": traffic_state_rows(book),
        "waves": wave_rows(stories, settings),
        "growth": waves.growth_rows(settings, drivers),
        "string_stability": waves.stability_rows(drivers),
        "scenario_tracking": tracking_rows(planned[0], settings),
    }
    if given.swept:
        rows["scenario_sweep"] = given.swept
        rows["sweep_claims"] = claim_rows(Book.of(given.swept, settings))
    return ledger_frames(book, given.swept) | {name: frame(name, found) for name, found in rows.items()}


def ledger_frames(book: Book, swept: Iterable[Row] = ()) -> dict[str, pd.DataFrame]:
    """What the ledger is made of: the cells, the published numbers beside them, claims, the paper's arithmetic."""
    cells = list(book.cells.values())
    rows: dict[str, Iterable[Row]] = {
        "scenario_cells": cells,
        "ledger": ledger_rows(book, swept=swept),
        "closest": closest_rows([*cells, *swept]),
        "claims": claim_rows(book),
        "arithmetic": arithmetic_rows(),
    }
    return {name: frame(name, found) for name, found in rows.items()}


def _default_cell(book: Book, scenario: str, policy: str) -> Row:
    settings = book.settings
    return book.cells[scenario, DEFAULT, settings.form, settings.accounting, settings.weights[policy]]


def rectangle_rows(book: Book) -> list[Row]:
    """Table 1, ours beside the published one, under the default options."""
    rows = []
    for (scenario, policy), printed in paper.TABLE_1.items():
        cell = _default_cell(book, scenario, policy)
        for rank, totals in enumerate(printed, start=1):
            rows.append(
                {
                    "scenario": scenario,
                    "policy": policy,
                    "follower": rank,
                    "time_s": value_of(cell, f"rectangle_time_s {rank}"),
                    "distance_m": value_of(cell, f"rectangle_distance_m {rank}"),
                    "published_time_s": totals.time,
                    "published_distance_m": totals.distance,
                }
            )
    return rows


def traffic_state_rows(book: Book) -> list[Row]:
    """Table 2: published, from the printed totals of Table 1, and ours."""
    area, rows = paper.RECTANGLE_HEIGHT * paper.RECTANGLE_DURATION, []
    for (scenario, policy), total in paper.TABLE_1_TOTALS.items():
        from_table = dict(zip(_MEASURES, edie(total.distance, total.time, area), strict=True))
        for measure, (column, unit) in _MEASURES.items():
            rows.append(
                {
                    "scenario": scenario,
                    "policy": policy,
                    "measure": measure,
                    "unit": unit,
                    "published": paper.printed(scenario, policy, column),
                    "from_table_1": from_table[measure],
                    "ours": value_of(_default_cell(book, scenario, policy), column),
                }
            )
    return rows


def wave_rows(stories: dict[str, Story], settings: ScenarioSettings) -> list[Row]:
    """Speed of the shock wave behind the AV in each situation and policy, seeded apart."""
    rows = []
    for number, story in enumerate(stories.values()):
        for policy, platoon in story.platoons.items():
            rng = np.random.default_rng([settings.seed, number])
            found = wave_speed(*_disturbance(platoon, story.unchanged), dt=settings.vehicle.dt_s, rng=rng)
            if gaps(platoon).min() < 0.0:
                found = WaveSpeed(np.nan, np.nan, np.nan, 0, np.nan, COLLISION)
            rows.append({"scenario": story.key, "policy": policy, **wave_columns(found)})
    return rows


def wave_columns(wave: WaveSpeed) -> Row:
    """An estimated wave as columns of ``waves``."""
    return {
        "speed_mps": wave.speed,
        "low_mps": wave.low,
        "high_mps": wave.high,
        "pairs": wave.pairs,
        "correlation": wave.correlation,
        "status": wave.status,
    }


def _disturbance(platoon: Platoon, unchanged: Platoon) -> tuple[FloatArray, FloatArray]:
    """Positions and changes of speed of the first followers over the first two minutes."""
    seen = platoon.t <= _WAVE_SECONDS
    few = slice(0, _WAVE_VEHICLES)
    return platoon.front[few, seen], (platoon.v - unchanged.v)[few, seen]


@dataclass(frozen=True)
class ScenarioReport:
    """What a run of the scenarios left behind: its tables by name, and the page to open.

    skipped: why the recordings' part was left out although there is a work folder; empty if it was not.
    """

    frames: dict[str, pd.DataFrame]
    page: Path
    skipped: str = ""


def run(
    settings: ScenarioSettings, out: Path, *, sweep: bool = False, work: Path | None = None, threads: int = 2
) -> ScenarioReport:
    """Plan and drive the scenarios; write tables (parquet), figures (PNG) and pages below ``out``.

    A report in the folder above, if ``out`` is its folder for the scenarios, is given the link to them.
    sweep: also every combination of the options in the settings' section ``sweep``. work: artefacts of
    recordings, for the fitted drivers and a real lane change; left out where it holds none. threads: over the
    variants; results do not depend on their number. Raises UsageError if another run is in the folder ``out``,
    StorageError if it cannot be written.
    """
    with workspace.owned(out, role="scenarios", name=".lock"):
        return _run(settings, out, sweep=sweep, work=work, threads=threads)


def _run(settings: ScenarioSettings, out: Path, *, sweep: bool, work: Path | None, threads: int) -> ScenarioReport:
    planned = default_plans(settings)
    stories = {one.situation.key: story_of(one, settings) for one in planned}
    recordings, skipped = load_recordings(work, settings)
    change = recordings.change
    swept = [row for part in rows_of_sweep(settings, threads=threads) for row in part] if sweep else []
    given = Given(recordings, swept)
    frames = scenario_frames(planned, stories, settings=settings, given=given, threads=threads)
    if change is not None:
        frames["recorded_state"] = frame("recorded_state", state_rows(change))
        row = {"scenario": change.event_id, "policy": RECORDED, **wave_columns(change.wave)}
        frames["waves"] = pd.concat([frames["waves"], frame("waves", [row])], ignore_index=True)
    provenance = Provenance(digest(settings), {}, settings.seed, workspace.code_version())
    for name, table in frames.items():
        artefacts.write(out / f"{name}.parquet", artefacts.to_arrow(name, table, provenance))
    write_pages(out, frames, stories=stories, settings=settings, recordings=recordings)
    link_to_scenarios(out)
    return ScenarioReport(frames, out / "index.html", skipped)


def load_recordings(work: Path | None, settings: ScenarioSettings) -> tuple[Recordings, str]:
    """Fitted drivers and real lane changes of a work folder; none, and why, where its artefacts are of no use."""
    if work is None or not has_recordings(work):
        return Recordings(), ""
    try:
        found = recorded_change(work, settings), nearest_event(work, settings)
        return Recordings(*fitted_drivers(work), *found), ""
    except ArtefactError as error:
        # The scenarios need no recordings: a folder of an older version must not stop them.
        return Recordings(), str(error)
