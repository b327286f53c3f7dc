import numpy as np
import pytest
from image_recording import LOWER, meta_row, pair, recording_row, track_row, write

from highd_lc.io.highd import read_recording
from highd_lc.io.highd_files import discover, input_files
from highd_lc.vocab.errors import InputError


def test_direction_2_keeps_x_and_turns_y_up(tmp_path):
    """Lower carriageway: centre = corner + half the box, right edge = last marking (40 m)."""
    recording = read_recording(pair(tmp_path), 1)
    tracks = recording.road.tracks
    own = tracks.index.span(0)
    np.testing.assert_allclose(tracks.x[own], [11.2 + 2.5, 12.4 + 2.5, 13.6 + 2.5])
    np.testing.assert_allclose(tracks.y[own], [40 - 38.9, 40 - 38.8, 40 - 38.7])
    assert tracks.vx[own].tolist() == [30.0] * 3
    assert tracks.vy[own].tolist() == [2.5] * 3
    assert tracks.ax[own].tolist() == [0.3] * 3
    assert tracks.ay[own].tolist() == [-0.2] * 3
    assert tracks.lane[own].tolist() == [1] * 3


def test_direction_1_is_turned_around(tmp_path):
    """Upper carriageway: the entry is where the boxes end furthest right, the right edge the first marking."""
    recording = read_recording(pair(tmp_path), 1)
    tracks = recording.road.tracks
    own = tracks.index.span(1)
    end = 298.8 + 12.0
    np.testing.assert_allclose(tracks.x[own], [end - (298.8 + 6), end - (297.6 + 6), end - (296.4 + 6)])
    np.testing.assert_allclose(tracks.y[own], [13.0 + 1.25 - 8.0] * 3)
    assert tracks.vx[own].tolist() == [30.0] * 3
    assert tracks.vy[own].tolist() == [1.5] * 3
    assert tracks.ax[own].tolist() == [0.3] * 3
    assert tracks.ay[own].tolist() == [-0.2] * 3
    assert tracks.lane[own].tolist() == [2] * 3
    assert recording.vehicles.vehicle_class.tolist() == ["Car", "Truck"]
    assert recording.vehicles.length.tolist() == [5.0, 12.0]


def test_lane_ids_of_four_upper_and_three_lower_lanes(tmp_path):
    """Lane ids 2..5 above, 7..9 below (equations.md 15.4); 1 and 6 and 10 lie outside; the rightmost is 1."""
    upper = [track_row(f, 1, 300 - f, 2.0 + 4 * f, vx=-30, lane=f) for f in range(1, 7)]
    lower = [track_row(f - 5, 2, f, 22.0 + 4 * (f - 5), lane=f) for f in range(6, 11)]
    folder = write(
        tmp_path,
        tracks=[*upper, *lower],
        metas=[meta_row(1, direction=1, frames=(1, 6)), meta_row(2, frames=(1, 5))],
    )
    road = read_recording(folder, 1).road
    assert road.tracks.lane.tolist() == [0, 1, 2, 3, 4, 0, 0, 3, 2, 1, 0]
    # Corners at 6 + 4 k put the centres on 7 + 4 k: between the markings that the lane ids name, but for one in
    # the median, which ends at 28, not at 27.
    assert road.lane_mismatches.tolist() == [0, 0]


def test_rows_whose_lane_id_contradicts_y_are_counted(tmp_path):
    tracks = [track_row(f, 3, 10 + f, 37.0, lane=9 if f < 3 else 8) for f in (1, 2, 3)]
    assert read_recording(
        write(tmp_path, tracks=tracks, metas=[meta_row(3)]), 1
    ).road.lane_mismatches.tolist() == [1]


def test_zero_means_nobody(tmp_path):
    tracks = [track_row(f, 3, 10 + f, 37.0, leader=(0, 4, 4)[f - 1]) for f in (1, 2, 3)]
    tracks += [track_row(f, 4, 30 + f, 37.0, follower=3) for f in (1, 2, 3)]
    found = read_recording(write(tmp_path, tracks=tracks, metas=[meta_row(3), meta_row(4)]), 1).road.tracks
    assert found.leader_id.tolist() == [0, 4, 4, 0, 0, 0]
    assert found.follower_id.tolist() == [0, 0, 0, 3, 3, 3]


def test_section_is_what_the_boxes_reach(tmp_path):
    road = read_recording(pair(tmp_path), 1).road
    np.testing.assert_allclose(road.extent, [[0.0, 310.8 - 11.2], [11.2, 310.8]])


def test_recordings_are_announced_by_any_file(tmp_path):
    for name in ("02_tracks.csv", "07_tracksMeta.csv", "11_recordingMeta.csv", "7_notes.csv", "02_truth.csv"):
        (tmp_path / name).touch()
    assert discover(tmp_path) == [2, 7, 11]
    with pytest.raises(InputError, match=r"07_recordingMeta\.csv: not found"):
        input_files(tmp_path, 7)


def test_numbers_may_be_written_without_zeros(tmp_path):
    pair(tmp_path)
    for path in list(tmp_path.iterdir()):
        path.rename(path.with_name(path.name.replace("01_", "1_")))
    assert discover(tmp_path) == [1]
    assert len(read_recording(tmp_path, 1).vehicles.id) == 2


@pytest.mark.parametrize("make", [lambda p: p / "nowhere", lambda p: p])
def test_folder_without_recordings_is_refused(tmp_path, make):
    with pytest.raises(InputError):
        discover(make(tmp_path))


def test_frame_rate_is_that_of_the_meta(tmp_path):
    assert read_recording(pair(tmp_path, recording=recording_row(rate=12.5)), 1).meta.frame_rate == 12.5


def test_carriageways_in_the_wrong_order_are_refused(tmp_path):
    with pytest.raises(InputError, match="row 2, column 'lowerLaneMarkings'"):
        read_recording(pair(tmp_path, recording=recording_row(upper=LOWER, lower=LOWER.replace("28", "29"))), 1)


def one_carriageway(folder, direction, *, empty, first_lane):
    """A vehicle drives through all lanes of its carriageway, from the smallest id on, a frame in each."""
    lanes = range(4) if direction == 1 else range(3)
    top, vx = (8.0, -30.0) if direction == 1 else (28.0, 30.0)
    tracks = [track_row(k + 1, 3, 100.0, top + 1 + 4 * k, vx=vx, lane=first_lane + k) for k in lanes]
    metas = [meta_row(3, direction=direction, frames=(1, len(lanes)))]
    markings = {"lower": empty} if direction == 1 else {"upper": empty}
    return write(folder, tracks=tracks, metas=metas, recording=recording_row(**markings))


@pytest.mark.parametrize("empty", ["", "nan", "NaN", ";", " "])
@pytest.mark.parametrize(("direction", "lanes"), [(1, [1, 2, 3, 4]), (2, [3, 2, 1])])
@pytest.mark.parametrize("first_lane", [1, 2, 7])
def test_a_carriageway_may_be_left_out_and_its_lanes_counted_or_not(tmp_path, empty, direction, lanes, first_lane):
    """Lane 1 is the rightmost, wherever the ids begin."""
    road = read_recording(one_carriageway(tmp_path, direction, empty=empty, first_lane=first_lane), 1).road
    assert road.tracks.lane.tolist() == lanes
    assert road.lane_mismatches.tolist() == [0]
    right = 8.0 if direction == 1 else 40.0
    corners = (8.0 if direction == 1 else 28.0) + 1 + 4 * np.arange(len(lanes))
    np.testing.assert_allclose(road.tracks.y, abs(corners + 1 - right))


def test_a_vehicle_on_a_carriageway_without_markings_is_refused(tmp_path):
    for markings, vehicle in (({"upper": ""}, 7), ({"lower": ""}, 3)):
        with pytest.raises(
            InputError, match=rf"01_tracksMeta\.csv: column 'drivingDirection': vehicle {vehicle} "
        ):
            read_recording(pair(tmp_path, recording=recording_row(**markings)), 1)
    with pytest.raises(InputError, match=r"01_recordingMeta\.csv: row 2, column 'upperLaneMarkings': no markings"):
        read_recording(pair(tmp_path, recording=recording_row(upper="", lower="")), 1)
