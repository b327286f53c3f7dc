import numpy as np
import pytest
from image_recording import (
    META_COLUMNS,
    RECORDING_COLUMNS,
    TRACK_COLUMNS,
    meta_row,
    pair,
    recording_row,
    track_row,
)

from highd_lc.io.highd import read_recording
from highd_lc.vocab.errors import InputError


def lines(folder, kind="tracks"):
    return (folder / f"01_{kind}.csv").read_text().splitlines()


def rewrite(folder, found, kind="tracks"):
    (folder / f"01_{kind}.csv").write_text("\n".join(found) + "\n")


def fault(folder):
    with pytest.raises(InputError) as caught:
        read_recording(folder, 1)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{folder}/")


def test_rows_in_any_order_are_the_same_recording(tmp_path):
    sorted_one = read_recording(pair(tmp_path / "a"), 1)
    header, *rows = lines(pair(tmp_path / "b"))
    rewrite(tmp_path / "b", [header, *np.random.default_rng(1).permutation(rows)])
    meta_header, *metas = lines(tmp_path / "b", "tracksMeta")
    rewrite(tmp_path / "b", [meta_header, *reversed(metas)], "tracksMeta")
    shuffled = read_recording(tmp_path / "b", 1)
    for name in ("x", "y", "vx", "vy", "ax", "ay", "lane", "leader_id"):
        np.testing.assert_array_equal(getattr(shuffled.road.tracks, name), getattr(sorted_one.road.tracks, name))
    np.testing.assert_array_equal(shuffled.vehicles.id, sorted_one.vehicles.id)
    np.testing.assert_array_equal(shuffled.road.tracks.index.starts, sorted_one.road.tracks.index.starts)


def test_numbers_written_otherwise_are_the_same_recording(tmp_path):
    plain = read_recording(pair(tmp_path / "a"), 1)
    text = (pair(tmp_path / "b") / "01_tracks.csv").read_text()
    (tmp_path / "b" / "01_tracks.csv").write_text(text.replace(",30.00,", ",3.0e1,"))
    other = read_recording(tmp_path / "b", 1)
    for name in ("x", "y", "vx", "vy", "ax", "ay", "lane", "leader_id"):
        np.testing.assert_array_equal(getattr(other.road.tracks, name), getattr(plain.road.tracks, name))


def test_identical_rows_are_dropped_and_counted(tmp_path):
    header, *rows = lines(pair(tmp_path))
    rewrite(tmp_path, [header, rows[0], *rows, rows[4]])
    recording = read_recording(tmp_path, 1)
    assert len(recording.road.tracks.x) == 6
    assert recording.duplicates.tolist() == [1, 1]


def test_contradicting_rows_are_refused(tmp_path):
    header, *rows = lines(pair(tmp_path))
    rewrite(tmp_path, [header, *rows, track_row(2, 3, 99.0, 37.0)])
    assert fault(tmp_path) == "01_tracks.csv: row 8, column 'x': contradicts another row of vehicle 3 in frame 2"


def test_vehicle_without_metas_is_refused(tmp_path):
    header, *rows = lines(pair(tmp_path))
    rewrite(tmp_path, [header, *rows, track_row(1, 99, 10.0, 37.0)])
    assert fault(tmp_path) == "01_tracks.csv: row 8, column 'id': vehicle 99 has no row in the tracksMeta file"


def test_vehicle_without_rows_is_refused(tmp_path):
    pair(tmp_path, metas=[meta_row(3), meta_row(7, direction=1), meta_row(8), meta_row(9)])
    assert fault(tmp_path).startswith("01_tracks.csv: column 'id': no row of vehicle 8, one of 2")


@pytest.mark.parametrize(
    ("kind", "content", "text"),
    [
        ("tracks", TRACK_COLUMNS + "\n", "01_tracks.csv: no rows"),
        ("tracks", "", "01_tracks.csv: empty file"),
        ("tracksMeta", META_COLUMNS + "\n", "01_tracksMeta.csv: no vehicles"),
        ("recordingMeta", RECORDING_COLUMNS + "\n", "01_recordingMeta.csv: 0 rows, expected 1"),
        (
            "recordingMeta",
            f"{RECORDING_COLUMNS}\n{recording_row(upper='1.0;x')}\n",
            "01_recordingMeta.csv: row 2, column 'upperLaneMarkings': '1.0;x' is no list of numbers separated "
            "by ';'",
        ),
        (
            "recordingMeta",
            f"{RECORDING_COLUMNS}\n{recording_row(lower='40;36')}\n",
            "01_recordingMeta.csv: row 2, column 'lowerLaneMarkings': '40;36' is not two or more ascending "
            "numbers",
        ),
        (
            "recordingMeta",
            f"{RECORDING_COLUMNS}\n{recording_row(rate=0)}\n",
            "01_recordingMeta.csv: row 2, column 'frameRate': 0 is outside [5, 1000]: lateral speeds take 3 "
            "frames or more in 0.4 s",
        ),
        (
            "tracksMeta",
            f"{META_COLUMNS}\n{meta_row(3)}\n{meta_row(3)}\n",
            "01_tracksMeta.csv: row 3, column 'id': 3 is there twice",
        ),
        (
            "tracksMeta",
            f"{META_COLUMNS}\n{meta_row(3, kind='<script>')}\n",
            "01_tracksMeta.csv: row 2, column 'class': '<script>' is not Car or Truck",
        ),
        (
            "tracksMeta",
            f"{META_COLUMNS}\n{meta_row(3, direction=3)}\n",
            "01_tracksMeta.csv: row 2, column 'drivingDirection': 3 is outside [1, 2]",
        ),
        (
            "tracksMeta",
            f"{META_COLUMNS}\n{meta_row(3, box=(0, 0))}\n",
            "01_tracksMeta.csv: row 2, column 'width': 0.00 is outside [0.1, 100]",
        ),
    ],
)
def test_bad_files_are_named(tmp_path, kind, content, text):
    pair(tmp_path)
    (tmp_path / f"01_{kind}.csv").write_text(content)
    assert fault(tmp_path) == text


def test_file_torn_in_a_row_is_refused(tmp_path):
    whole = (pair(tmp_path) / "01_tracks.csv").read_text()
    for cut in range(len(whole) - len(whole.splitlines()[-1]), len(whole) - 2):
        (tmp_path / "01_tracks.csv").write_text(whole[:cut])
        assert fault(tmp_path).startswith("01_tracks.csv: row 7: ")


def test_missing_file_of_the_triple_is_named(tmp_path):
    pair(tmp_path)
    (tmp_path / "01_tracksMeta.csv").unlink()
    assert fault(tmp_path) == "01_tracksMeta.csv: not found"
