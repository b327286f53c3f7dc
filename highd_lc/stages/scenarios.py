"""Scenarios: the paper's simulations planned, driven, drawn, and entered beside the published numbers."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from highd_lc.algorithms.scenario_cells import rows_of_sweep
from highd_lc.io import artefacts, workspace
from highd_lc.io.settings import digest
from highd_lc.stages.scenario_frames import default_plans, frame, scenario_frames, story_of
from highd_lc.stages.scenario_pages import write_pages
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.scenarios import ScenarioSettings

SWEEP = "scenario_sweep"


@dataclass(frozen=True)
class ScenarioReport:
    """What a run of the scenarios left behind: its tables by name, and the page to open."""

    frames: dict[str, pd.DataFrame]
    page: Path


def run(
    settings: ScenarioSettings, out: Path, *, sweep: bool = False, work: Path | None = None, threads: int = 2
) -> ScenarioReport:
    """Plan and drive the scenarios; write tables (parquet), figures (PNG) and pages below ``out``.

    sweep: also every combination of the options in the settings' section ``sweep``. threads: over the variants;
    results do not depend on their number.
    """
    planned = default_plans(settings)
    stories = {one.situation.key: story_of(one, settings) for one in planned}
    frames = scenario_frames(planned, stories, settings, threads=threads)
    if sweep:
        rows = (row for part in rows_of_sweep(settings, threads=threads) for row in part)
        frames[SWEEP] = frame(SWEEP, rows)
    provenance = Provenance(digest(settings), {}, settings.seed, workspace.code_version())
    for name, table in frames.items():
        artefacts.write(out / f"{name}.parquet", artefacts.to_arrow(name, table, provenance))
    write_pages(out, frames, stories, settings, [])
    return ScenarioReport(frames, out / "index.html")
