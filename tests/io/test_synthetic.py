"""The recorder as a whole: what a recording depends on, and that the committed fixtures are its work."""

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from highd_lc.io.synthetic import synthesize, write_recording
from highd_lc.vocab.sections import RecorderSettings

FIXTURES = Path(__file__).parents[1] / "fixtures"
FILES = ("recordingMeta", "tracksMeta", "tracks", "truth", "truth_drivers")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_it_writes_five_files_a_recording(tmp_path):
    assert synthesize(tmp_path, recordings=2, seconds=5.0, seed=1) == [1, 2]
    assert set(contents(tmp_path)) == {f"{n:02d}_{name}.csv" for n in (1, 2) for name in FILES}


def test_a_recording_depends_neither_on_the_others_nor_on_the_workers(tmp_path):
    synthesize(tmp_path / "all", recordings=3, seconds=6.0, seed=5)
    synthesize(tmp_path / "threads", recordings=3, seconds=6.0, seed=5, workers=2)
    write_recording(tmp_path / "alone", 2, 6.0, 5, settings=RecorderSettings())
    everything = contents(tmp_path / "all")
    assert contents(tmp_path / "threads") == everything
    alone = contents(tmp_path / "alone")
    assert alone == {name: everything[name] for name in alone}
    assert len(alone) == 5


def test_recordings_and_seeds_differ(tmp_path):
    synthesize(tmp_path / "a", recordings=2, seconds=5.0, seed=1)
    synthesize(tmp_path / "b", recordings=1, seconds=5.0, seed=2)
    tracks = [tmp_path / name for name in ("a/01_tracks.csv", "a/02_tracks.csv", "b/01_tracks.csv")]
    assert len({path.read_bytes() for path in tracks}) == 3


def test_a_road_without_vehicles_gives_headers(tmp_path):
    empty = RecorderSettings(flow_veh_per_h=50)
    for seed in range(100):
        write_recording(tmp_path, 1, 0.2, seed, settings=empty)
        if len(pd.read_csv(tmp_path / "01_tracksMeta.csv")) == 0:
            break
    else:
        pytest.fail("no recording without vehicles among 100 seeds")
    assert len(pd.read_csv(tmp_path / "01_tracks.csv")) == 0
    assert len(pd.read_csv(tmp_path / "01_truth.csv")) == 0
    meta = pd.read_csv(tmp_path / "01_recordingMeta.csv").iloc[0]
    assert (meta["numVehicles"], meta["totalDrivenDistance"]) == (0, 0)


def test_the_fixtures_are_the_recorders_work(tmp_path):
    """Equal to the last digit printed, which another mathematical library may round the other way."""
    spec = importlib.util.spec_from_file_location("make_fixtures", FIXTURES / "make_fixtures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.make(tmp_path)
    for name in ("tracks", "tracksMeta"):
        for number in module.FIXTURES:
            made, kept = (pd.read_csv(folder / f"{number:02d}_{name}.csv") for folder in (tmp_path, FIXTURES))
            assert list(made) == list(kept)
            numbers = made.select_dtypes("number").columns.difference(["ttc", "minTTC"])
            np.testing.assert_allclose(made[numbers], kept[numbers], atol=0.0101)
            pd.testing.assert_frame_equal(
                made.select_dtypes(exclude="number"), kept.select_dtypes(exclude="number")
            )
    assert sum(path.stat().st_size for path in FIXTURES.glob("*.csv")) < 1.5e6
