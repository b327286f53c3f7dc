"""What several test modules share: one run of the whole pipeline on the fixtures, and how hypothesis searches."""

import os
from collections.abc import Callable
from functools import partial

import pytest
from hypothesis import settings as hypothesis_settings
from markupsafe import Markup
from shared_runs import QUICK, PipelineRun, T, made_once, run

from highd_lc.io import settings as settings_file
from highd_lc.reporting import html
from highd_lc.vocab.settings import Settings

# The first example of a property may compile kernels; the same examples every time keep a red test red.
hypothesis_settings.register_profile("repeatable", deadline=None, derandomize=True)
hypothesis_settings.load_profile("repeatable")


_COMPILING = "faults/test_workers"
"""Begun first of all: it makes the run that most others go on from, and compiles nearly all kernels for it."""
_WITHOUT_KERNELS = (
    "reporting/test_browser", "reporting/test_pages_prediction", "commands/test_make",
    "reporting/test_pages_population", "reporting/test_figures_event",
)  # fmt: skip
"""Long ones for the other processes meanwhile: with an empty cache others would wait for its kernels."""
_LONGEST = (
    "regression/test_recompute", "docs/test_ledger", "stages/test_validate_studies", "faults/test_no_events",
    "faults/test_cluster", "faults/test_storage", "faults/test_resume", "stages/test_crosslinks",
    "faults/test_streams", "stages/test_report_stage", "faults/test_stages_asked_for", "stages/test_own_model",
    "stages/test_report_command", "drivers/test_genetic", "stages/test_extract", "planning/test_search",
    "planning/test_start_planner", "stages/test_sumo", "api/test_door", "commands/test_multiverse_command",
    "stages/test_multiverse",
)  # fmt: skip
"""Files of tests that take longest: begun early, none of them is waited for at the end."""


def pytest_configure(config: pytest.Config) -> None:
    """Have several processes take the files in the order of the collection, not by their numbers of tests."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that others wait for and the longest first, the others as they were."""
    first = (_COMPILING, *_WITHOUT_KERNELS, *_LONGEST)
    place = {f"tests/{name}.py": number for number, name in enumerate(first)}
    items.sort(key=lambda item: place.get(item.nodeid.partition("::")[0], len(place)))


def small_studies(settings: Settings) -> Settings:
    """The settings with one event to study, for the studies have tests of their own, and few starts chosen."""
    values = settings.model_dump(by_alias=True)
    few = {"sample": 1, "start_sample": 8, "foresight_sample": 0, "solver_sample": 1, "solver_starts": 1}
    few |= {"draws": 2, "replans": 1, "population": 8, "generations": 2, "horizons_s": (5.0,)}
    few |= {"multibody_sample": 1, "safety_sample": 4}
    values["validate"]["studies"] |= few
    values["validate"]["multiverse"]["sample"] = 1
    values["validate"]["robust"]["sample"] = 2
    values["validate"]["closed_loop"]["events"] = 2
    return Settings.model_validate(values)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., T]:
    """``shared_runs.made_once`` below a folder that all processes of the tests share."""
    own = tmp_path_factory.getbasetemp()
    return partial(made_once, own.parent if "PYTEST_XDIST_WORKER" in os.environ else own)


@pytest.fixture(scope="session")
def pipeline_run(once: Callable[..., PipelineRun]) -> PipelineRun:
    """The default study on the fixtures, every stage; its studies on a single event."""
    settings = small_studies(settings_file.load(settings_file.find_pipeline("highd")))
    return once("pipeline", partial(run, settings=settings))


@pytest.fixture(scope="session")
def quick_run(once: Callable[..., PipelineRun]) -> PipelineRun:
    """The pipeline of the fault tests on the fixtures: every stage, with less to do."""
    return once("quick", partial(run, settings=settings_file.load(QUICK)))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures on pages stay empty, for tests of what else is there: most of a report's time is their drawing."""
    empty = Markup('<svg role="img" aria-label="{}"></svg>')
    monkeypatch.setattr(html, "inline_svg", lambda figure, alternative: empty.format(alternative))


@pytest.fixture(scope="module")
def kept_pages() -> dict[str, bytes]:
    """The overview pages by their file's names, as they were made first."""
    return {}


@pytest.fixture
def made_once_pages(monkeypatch: pytest.MonkeyPatch, undrawn: None, kept_pages: dict[str, bytes]) -> None:
    """Overview pages are rendered once a module, for tests of what becomes of them, all on copies of one run."""
    from highd_lc.stages import report

    make = report.page_of

    def page_of(name: str, overview: object) -> bytes:
        if name not in kept_pages:
            kept_pages[name] = make(name, overview)
        return kept_pages[name]

    monkeypatch.setattr(report, "page_of", page_of)
