"""What a stage depends on: its own settings, those it shares, and nothing that only later stages read."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from highd_lc.io.settings import digest
from highd_lc.stage_run import STAGES
from highd_lc.vocab.job import Options
from highd_lc.vocab.settings import Settings

CHOICES = Path(__file__).parents[1] / "pipelines" / "choices" / "multiverse.toml"
OPTIONS = Options(Path("data"), Path("work"), Path("reports"))


def keys(options: Options = OPTIONS, **sections: object) -> dict[str, str]:
    settings = Settings.model_validate(sections)
    return {stage.name: digest(*stage.depends_on(settings, options, None)) for stage in STAGES}


@pytest.mark.parametrize(
    ("sections", "touched"),
    [
        ({"synthetic": {"seed": 9}}, set()),
        ({"extract": {"max_followers": 2}}, {"extract"}),
        ({"calibrate": {"study_sample": 7}}, {"calibrate"}),
        ({"validate": {"studies": {"sample": 3}}}, {"validate", "multiverse"}),
        ({"validate": {"multiverse": {"sample": 3}}}, {"multiverse"}),
        ({"validate": {"multiverse": {"choices": str(CHOICES)}}}, {"multiverse"}),
        ({"validate": {"followers": {"b_max": 5.0}}}, {"calibrate", "validate", "multiverse"}),
        ({"validate": {"statistics": {"bootstrap": 200}}}, {"calibrate", "validate", "multiverse"}),
        ({"seed": 7}, {"calibrate", "validate", "multiverse"}),
        ({"report": {"top": 3}}, {"report"}),
    ],
)
def test_a_setting_touches_the_stages_that_read_it(sections: dict[str, object], touched: set[str]) -> None:
    changed = keys(**sections)
    assert {name for name, key in keys().items() if changed[name] != key} == touched


def test_what_is_read_from_the_tables_of_ingest_touches_extract_too() -> None:
    section = Settings().ingest.model_dump()
    name, value = next((k, v) for k, v in section.items() if isinstance(v, float))
    changed = keys(ingest={name: value * 0.9})
    assert {stage for stage, key in keys().items() if changed[stage] != key} == {"ingest", "extract"}


@pytest.mark.parametrize(
    "options",
    [
        Options(Path("data"), Path("work"), Path("elsewhere")),
        Options(Path("data"), Path("work"), Path("reports"), vector=("pdf",)),
        Options(Path("data"), Path("work"), Path("reports"), events=("01-0001-00001",)),
    ],
)
def test_options_of_the_report_touch_the_report_alone(options: Options) -> None:
    before, after = keys(), keys(options)
    assert {name for name in before if before[name] != after[name]} == {"report"}


def test_stages_travel_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(STAGES)) == STAGES


def test_no_stage_is_imported_before_there_is_work_for_it() -> None:
    code = "import sys, highd_lc.engine; print([m for m in sys.modules if m.startswith('highd_lc.stages.')])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
