import numpy as np
import pyarrow.parquet as pq
import pytest
from image_recording import pair

from highd_lc.io import artefacts, highd
from highd_lc.io.highd import read_recording
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.tables import TRACKS

PROVENANCE = Provenance("settings", {"01": "hash"}, 1, "code")


@pytest.fixture
def written(tmp_path):
    recording = read_recording(pair(tmp_path / "data"), 1)
    assert highd.write(tmp_path, recording, PROVENANCE) == 6
    return tmp_path, recording.road.tracks


def test_what_is_read_is_what_was_written(written):
    work, tracks = written
    found = highd.read(work, 1)
    assert found.vehicle_id.tolist() == [3, 3, 3, 7, 7, 7]
    assert found.frame.tolist() == [1, 2, 3, 1, 2, 3]
    np.testing.assert_array_equal(found.x, tracks.x)
    np.testing.assert_array_equal(found.y, tracks.y)
    for name in ("vx", "vy", "ax", "ay"):
        np.testing.assert_allclose(getattr(found, name), getattr(tracks, name), rtol=1e-6)
    assert found.lane.tolist() == tracks.lane.tolist()
    assert found.leader_id.tolist() == [0] * 6
    assert {a.dtype for a in (found.vehicle_id, found.frame, found.lane)} == {np.dtype(np.int64)}
    assert found.vx.dtype == np.float32


def test_table_has_the_columns_of_the_contract_and_nulls_for_nobody(written):
    work, _ = written
    table = pq.read_table(highd.path_of(work, 1), partitioning=None)
    assert table.column_names == list(TRACKS.column_names)
    assert table["leader_id"].null_count == table["follower_id"].null_count == 6
    assert table["t"].to_pylist() == pytest.approx([0.0, 0.04, 0.08] * 2)
    assert table["length"].to_pylist() == [5.0] * 3 + [12.0] * 3
    assert artefacts.provenance_of(highd.path_of(work, 1))["inputs"] == {"01": "hash"}


def test_frame_reader_reads_them_too(written):
    work, _ = written
    frame = artefacts.read_tracks(work, 1)
    assert frame["leader_id"].isna().all()
    assert frame["lane"].tolist() == [1, 1, 1, 2, 2, 2]


def test_missing_and_damaged_tracks_are_named(written, tmp_path):
    work, _ = written
    with pytest.raises(ArtefactError, match="not found"):
        highd.read(work, 2)
    path = highd.path_of(work, 1)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ArtefactError, match="cannot be read"):
        highd.read(work, 1)
