"""Scenarios: the paper's simulations planned, driven, drawn, and entered beside the published numbers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.io import artefacts, workspace
from highd_lc.io.settings import digest
from highd_lc.reporting.labels import RECORDED
from highd_lc.scenarios.run import rows_of_sweep
from highd_lc.stages.crosslinks import link_to_scenarios
from highd_lc.stages.scenario_frames import Given, default_plans, frame, scenario_frames, story_of, wave_columns
from highd_lc.stages.scenario_pages import (
    RecordedChange,
    fitted_drivers,
    has_recordings,
    recorded_change,
    state_rows,
    write_pages,
)
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.scenarios import ScenarioSettings

FloatArray = NDArray[np.float64]


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
    fitted, change, skipped = load_recordings(work, settings)
    swept = [row for part in rows_of_sweep(settings, threads=threads) for row in part] if sweep else []
    given = Given(fitted, swept)
    frames = scenario_frames(planned, stories, settings=settings, given=given, threads=threads)
    if change is not None:
        frames["recorded_state"] = frame("recorded_state", state_rows(change))
        row = {"scenario": change.event_id, "policy": RECORDED, **wave_columns(change.wave)}
        frames["waves"] = pd.concat([frames["waves"], frame("waves", [row])], ignore_index=True)
    provenance = Provenance(digest(settings), {}, settings.seed, workspace.code_version())
    for name, table in frames.items():
        artefacts.write(out / f"{name}.parquet", artefacts.to_arrow(name, table, provenance))
    write_pages(out, frames, stories=stories, settings=settings, change=change)
    link_to_scenarios(out)
    return ScenarioReport(frames, out / "index.html", skipped)


def load_recordings(
    work: Path | None, settings: ScenarioSettings
) -> tuple[FloatArray, RecordedChange | None, str]:
    """Fitted drivers and a real lane change of a work folder; none, and why, where its artefacts are of no use."""
    none = np.empty((0, len(PARAMETERS)))
    if work is None or not has_recordings(work):
        return none, None, ""
    try:
        return fitted_drivers(work), recorded_change(work, settings), ""
    except ArtefactError as error:
        # The scenarios need no recordings: a folder of an older version must not stop them.
        return none, None, str(error)
