"""What several test modules share: one run of the whole pipeline on the fixtures, and how hypothesis searches."""

import io
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings as hypothesis_settings
from rich.console import Console

from highd_lc import engine
from highd_lc.io import settings as settings_file
from highd_lc.vocab.job import Options, Outcome
from highd_lc.vocab.settings import Settings

FIXTURES = Path(__file__).parent / "fixtures"

# The first example of a property may compile kernels; the same examples every time keep a red test red.
hypothesis_settings.register_profile("repeatable", deadline=None, derandomize=True)
hypothesis_settings.load_profile("repeatable")


@dataclass(frozen=True)
class PipelineRun:
    """A finished run: read only, several tests look at it."""

    data: Path
    work: Path
    reports: Path
    settings: Settings
    outcome: Outcome


def small_studies(settings: Settings) -> Settings:
    """The settings with one event to study, for the studies have tests of their own, and every start chosen."""
    values = settings.model_dump(by_alias=True)
    few = {"sample": 1, "start_sample": 25, "foresight_sample": 0, "solver_sample": 1, "solver_starts": 1}
    few |= {"draws": 2, "replans": 1, "population": 8, "generations": 2, "horizons_s": (5.0,)}
    few |= {"multibody_sample": 1, "safety_sample": 4}
    values["validate"]["studies"] |= few
    values["validate"]["multiverse"]["sample"] = 2
    values["validate"]["closed_loop"]["events"] = 2
    return Settings.model_validate(values)


@pytest.fixture(scope="session")
def pipeline_run(tmp_path_factory: pytest.TempPathFactory) -> PipelineRun:
    """The default study on the fixtures, every stage, in this process; its studies on a single event."""
    root = tmp_path_factory.mktemp("pipeline")
    settings = small_studies(settings_file.load(settings_file.find_pipeline("highd")))
    options = Options(FIXTURES, root / "work", root / "reports", workers=1)
    outcome = engine.run(settings, options, last="report", console=Console(file=io.StringIO()))
    return PipelineRun(FIXTURES, options.work, options.reports, settings, outcome)
