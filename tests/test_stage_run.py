"""What a stage depends on: its own settings, those it shares, and nothing that only later stages read."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from highd_lc.io.settings import digest
from highd_lc.io.workspace import InputHashes, Inputs
from highd_lc.stage_run import STAGES, StageRun, _Pages
from highd_lc.vocab.job import Options
from highd_lc.vocab.settings import Settings

CHOICES = Path(__file__).parents[1] / "pipelines" / "choices" / "multiverse.toml"
OPTIONS = Options(Path("data"), Path("work"), Path("reports"))


class _Undirected(_Pages):
    """The stage of the pages without what is looked up in a work folder."""

    def request(self, settings: Settings, options: Options) -> None:
        return None


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


@pytest.mark.parametrize(("raw", "told"), [(True, True), (False, False)])
def test_a_picture_of_the_road_touches_raw_pages_alone(tmp_path: Path, raw: bool, told: bool) -> None:
    files = [tmp_path / "01_tracks.csv"]
    settings = Settings.model_validate({"report": {"raw": raw}})
    read = [stage.files_beside(settings, files) for stage in STAGES]
    assert read == [[]] * len(STAGES)
    (tmp_path / "01_highway.png").touch()
    found = [path for stage in STAGES for path in stage.files_beside(settings, files)]
    assert found == [tmp_path / "01_highway.png"] * told


def test_what_is_read_beside_a_recording_is_in_its_key(tmp_path: Path) -> None:
    tracks, picture = tmp_path / "01_tracks.csv", tmp_path / "01_highway.png"
    settings = Settings.model_validate({"report": {"raw": True}})

    def key() -> str:
        inputs = Inputs(tmp_path, {1: (tracks,)}, {1: "key"}, (), InputHashes(tmp_path / "inputs.json", {}, True))
        return StageRun(_Undirected("report", ("report",)), settings, OPTIONS, inputs, {1: "key"})._key(1)

    without = key()
    picture.write_bytes(b"one")
    one = key()
    picture.write_bytes(b"two")
    assert len({without, one, key()}) == 3


def test_stages_travel_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(STAGES)) == STAGES


def test_no_stage_is_imported_before_there_is_work_for_it() -> None:
    code = "import sys, highd_lc.engine; print([m for m in sys.modules if m.startswith('highd_lc.stages.')])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
