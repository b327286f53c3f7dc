"""Nothing to work on, at any stage: empty tables, pages that say why, and no error that nobody foresaw."""

import io
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from faulty_runs import Place, run
from rich.console import Console
from shared_runs import FIXTURES, QUICK

from highd_lc import engine
from highd_lc.io import artefacts
from highd_lc.io import settings as settings_file
from highd_lc.reporting.terminal import lcm_table, matrix_table
from highd_lc.stages import calibrate, validate
from highd_lc.stages.overview_pages import OVERVIEW_PAGES, Overview, page_of
from highd_lc.vocab import names
from highd_lc.vocab.job import Combination, Options, Outcome, Provenance
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables import TABLES

_LONG = bool(os.environ.get("HIGHD_LC_FAULTS"))
_ABOUT = Provenance("settings", {}, 1, "code")
_RESULTS = ("matrix.html", "studies.html", "start.html", "calibration.html")
"""Pages of results alone."""


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A work folder in which every artefact is there and has no rows."""
    work = tmp_path_factory.mktemp("empty")
    for name in TABLES:
        artefacts.write_groups(work, name, [], _ABOUT)
    return work


@pytest.mark.parametrize("stage", [calibrate, validate])
def test_the_population_of_nobody_is_empty_tables(empty: Path, stage: object) -> None:
    stage.combine(Combination((), empty, Settings(), _ABOUT))
    for name in TABLES:
        assert artefacts.read(empty, name).empty or name == "summary_lcm"
    assert lcm_table(artefacts.read(empty, "summary_lcm")).columns
    assert "no event was planned" in matrix_table(artefacts.read(empty, "validation_matrix")).caption


@pytest.mark.parametrize("name", OVERVIEW_PAGES)
def test_every_page_can_be_made_of_nothing(empty: Path, name: str) -> None:
    page = page_of(name, Overview(empty, False, Settings().validation.statistics, 9.0, "own_fit")).decode()
    if name in (*_RESULTS, "summary.html", "index.html"):
        assert "no usable event" in page
    assert ">NaN<" not in page
    assert ">nan<" not in page


def _changed(**sections: dict[str, object]) -> Settings:
    values = settings_file.load(QUICK).model_dump(by_alias=True)
    for section, changes in sections.items():
        values[section] = {
            key: value | changes.get(key, {}) if isinstance(value, dict) else changes.get(key, value)
            for key, value in values[section].items()
        }
    return Settings.model_validate(values)


@pytest.fixture
def report(undisturbed: Place, tmp_path: Path) -> Callable[[Settings], Outcome]:
    """A run with other settings; it goes on in a copy of the artefacts of a run that nothing happened to."""
    shutil.copytree(undisturbed.work, tmp_path / "work")
    options = Options(FIXTURES, tmp_path / "work", tmp_path / "reports", workers=1)

    def run(settings: Settings) -> Outcome:
        return engine.run(settings, options, last="report", console=Console(file=io.StringIO()))

    return run


def _pages(root: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in (root / "reports").rglob("*.html")}


_ALL_STUDIES = {"sample": 5, "foresight_sample": 5, "multibody_sample": 5, "solver_sample": 5, "solver_starts": 1}


@pytest.mark.parametrize("png", ["all", "top", "none"] if _LONG else ["top"])
def test_lane_changes_none_of_which_can_be_used_are_told_as_a_funnel(
    tmp_path: Path, report: Callable[[Settings], Outcome], png: str
) -> None:
    settings = _changed(extract={"min_shift_m": 5.0}, report={"png": png}, validate={"studies": _ALL_STUDIES})
    outcome = report(settings)
    crossings = artefacts.read(tmp_path / "work", "crossings")
    assert not outcome.problems
    assert len(crossings) > 0
    assert not crossings["usable"].any()
    for name in TABLES.keys() & {path.stem for path in (tmp_path / "work").glob("*.parquet")}:
        assert artefacts.read(tmp_path / "work", name).empty or name in _FILLED
    pages = _pages(tmp_path)
    assert pages.keys() == set(OVERVIEW_PAGES)
    for name in (*_RESULTS, "summary.html", "index.html"):
        assert f"not one of {len(crossings)} lane-id changes can be used" in pages[name]


_FILLED = {"vehicles", "recordings", "crossings", "summary_lcm"}


def test_no_plan_that_can_be_driven_is_a_result(tmp_path: Path, report: Callable[[Settings], Outcome]) -> None:
    settings = _changed(
        validate={
            "constraints": {"jerk": 0.01},
            "studies": {"foresight_sample": 1, "solver_sample": 1, "solver_starts": 1},
        }
    )
    outcome = report(settings)
    assert not outcome.problems
    plans = artefacts.read(tmp_path / "work", "plans")
    optimal = plans[plans["policy"].isin((*names.FIXED_POLICIES, *names.FREE_POLICIES, *PAIRS[names.START]))]
    assert set(optimal["status"]) == {names.INFEASIBLE}
    matrix = artefacts.read(tmp_path / "work", "validation_matrix")
    assert (matrix["infeasible"] == matrix["n_events"]).all()
    assert matrix["gain"].isna().all()
    assert "has a feasible plan of both policies" in _pages(tmp_path)["index.html"]


def test_nobody_who_can_be_fitted_drives_by_the_published_means(
    tmp_path: Path, report: Callable[[Settings], Outcome]
) -> None:
    outcome = report(_changed(calibrate={"min_window_s": 60.0, "pooling": "penalised"}))
    assert not outcome.problems
    followers = artefacts.read(tmp_path / "work", "followers")
    assert set(followers["status"]) == {names.TABLE3}
    assert artefacts.read(tmp_path / "work", "losses")["loss_total"].notna().any()


@pytest.fixture
def breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every event fails as nothing should."""

    def fail(*_: object) -> None:
        raise ZeroDivisionError("planned to fail")

    monkeypatch.setattr(validate.planner, "pose", fail)


@pytest.mark.parametrize("png", ["all", "top"] if _LONG else ["top"])
def test_events_that_all_fail_are_listed_and_shown_as_failed(
    tmp_path: Path, report: Callable[[Settings], Outcome], breaks: None, png: str
) -> None:
    outcome = report(_changed(report={"png": png}, validate={"studies": _ALL_STUDIES}))
    events = artefacts.read(tmp_path / "work", "events")["event_id"].tolist()
    assert artefacts.read(tmp_path / "work", "plans").empty
    for stage in ("validate", "report"):
        told = [problem for problem in outcome.problems if problem.stage == stage]
        assert [p.message for p in told] == [f"{e}: ZeroDivisionError: planned to fail" for e in events]
        assert not any(problem.warning or problem.lost for problem in told)
    pages = _pages(tmp_path)
    assert pages.keys() == {*OVERVIEW_PAGES, *(f"{event}.html" for event in events)}
    assert all("ZeroDivisionError: planned to fail" in pages[f"{event}.html"] for event in events)
    assert "no plans were made in this run" in pages["summary.html"]


def test_the_command_ends_well_and_has_no_event_to_show(tmp_path: Path) -> None:
    pipeline = tmp_path / "nothing.toml"
    pipeline.write_text(QUICK.read_text().replace("[extract]\n", "") + "\n[extract]\nmin_shift_m = 5.0\n")
    place = Place(tmp_path, options=("--pipeline", str(pipeline), "--workers", "1"))
    code, said = run(place)
    assert code == 0, said
    assert "Traceback" not in said
    shutil.rmtree(place.reports)
    code, said = run(place, "--event", "01-0001-00001", stage="report")
    assert code == 2
    assert "not among the 0 usable events" in said
