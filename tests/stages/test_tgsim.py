"""TGSIM's format: what the synthetic carriageway comes to when it is written in it and read again."""

import numpy as np
import pandas as pd
import pytest
import running
from ngsim_recording import carriageway
from tgsim_recording import table

from highd_lc.io.formats import FORMATS, format_of
from highd_lc.io.tgsim_files import FIELDS, PLACE_OF, TYPE
from highd_lc.vocab.cross_checks import CROSS_CHECKS
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.settings import IngestSettings

SETTINGS = IngestSettings()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return carriageway(tmp_path_factory.mktemp("made") / "highd", seconds=150.0)


@pytest.fixture(scope="module")
def rows(made):
    return table(made)


def write(folder, rows, name="I395_Trajectories.csv"):
    folder.mkdir(exist_ok=True, parents=True)
    rows.to_csv(folder / name, index=False)
    return folder


def read(data, recording=1):
    return format_of(data, "auto").read(data, recording, SETTINGS)


@pytest.mark.parametrize("turned", [0.0, 25.0, -100.0, 180.0])
def test_positions_and_speeds_are_those_that_were_written_however_the_road_lies(tmp_path, made, turned):
    found = read(write(tmp_path, table(made, turned=turned)))
    tracks = found.road.tracks
    # The way of the road is that of the vehicles' displacements: 1e-4 over 400 m.
    assert np.ptp(tracks.x - made.own("x")) < 0.001
    assert np.ptp(tracks.y - made.own("y")) < 0.05
    np.testing.assert_allclose(tracks.vx, made.own("vx"), atol=1e-4)
    for name in ("lane", "leader_id", "follower_id"):
        assert getattr(tracks, name).tolist() == made.own(name).tolist(), name
    inner = (made.markings[-1] - made.markings)[::-1][1:-1]
    assert np.abs(np.diff(found.meta.lower[1:-1]) - np.diff(inner)).max() < 0.1
    assert found.notes == ()


def test_events_are_the_same(tmp_path, made, rows):
    carriageway(tmp_path / "highd", seconds=150.0)
    highd = running.extracted(tmp_path / "highd", tmp_path / "w1")
    directions = highd["vehicles"].set_index("vehicle_id")["driving_direction"]
    expected = highd["crossings"][highd["crossings"]["ego_id"].map(directions) == 2]
    data = write(tmp_path / "tgsim", rows)
    tables = running.extracted(data, tmp_path / "w2")
    found = tables["crossings"]
    assert set(tables["recordings"]["format"]) == {"tgsim"}
    assert len(expected) > 10
    pairs = expected.merge(found, on=["ego_id", "origin_lane", "target_lane"], suffixes=("", "_tgsim"))
    assert len(pairs) == len(expected) == len(found)
    assert (pairs["crossing_frame"] - pairs["crossing_frame_tgsim"]).abs().max() <= 1
    assert pairs["reason"].tolist() == pairs["reason_tgsim"].tolist()
    usable = pairs[pairs["usable"]]
    assert len(usable) > 5
    for name in ("start_frame", "end_frame"):
        assert (usable[name] - usable[f"{name}_tgsim"]).abs().max() <= 1


def test_hyphens_and_capitals_of_the_site_s_own_files_are_the_same(tmp_path, rows):
    named = rows.rename(columns=lambda name: name.replace("_", "-"))
    named = named.rename(columns={"id": "ID", "av": "ACC"})
    expected, found = read(write(tmp_path / "a", rows)), read(write(tmp_path / "b", named))
    assert found.road.tracks.x.tolist() == expected.road.tracks.x.tolist()


def test_runs_of_a_file_are_recordings_of_their_own(tmp_path, made, rows):
    both = pd.concat([table(made, run=2, turned=-60.0), rows])
    data = write(tmp_path, both)
    source = format_of(data, "auto")
    assert source.name == "tgsim"
    assert source.discover(data) == [1, 2]
    first, second = (source.read(data, number, SETTINGS) for number in (1, 2))
    assert np.ptp(first.road.tracks.x - second.road.tracks.x) < 0.001
    with pytest.raises(InputError, match="no recording 3: there are 2"):
        source.read(data, 3, SETTINGS)


def test_a_road_that_bends_is_refused_by_its_angle(tmp_path, made):
    straight = table(made, turned=0.0)
    x, y = straight["xloc_kf"] - 100.0, straight["yloc_kf"] - 80.0
    radius = 1200.0  # 420 m of it are 20 degrees
    bent = straight.assign(
        xloc_kf=(radius - y) * np.sin(x / radius), yloc_kf=radius - (radius - y) * np.cos(x / radius)
    )
    with pytest.raises(InputError, match=r"the road turns by (19|20) degrees .* centre lines, which are not read"):
        read(write(tmp_path, bent))


def test_a_short_lane_is_a_ramp_and_nobody_changes_to_it(tmp_path, rows, made):
    along, right = made.own("x"), rows["lane_kf"] == rows["lane_kf"].max()
    stays = rows.groupby("id")["lane_kf"].transform("nunique") == 1
    ramp = rows[right & stays & (along < 0.4 * along.max())]
    way = np.radians(25.0)
    beside = {"xloc_kf": ramp["xloc_kf"] - 3.7 * np.sin(way), "yloc_kf": ramp["yloc_kf"] + 3.7 * np.cos(way)}
    ramp = ramp.assign(id=ramp["id"] + 5000, lane_kf=9, **beside)
    found = read(write(tmp_path, pd.concat([rows, ramp])))
    share = found.notes[0].partition("lane_kf 9 reaches along ")[2]
    assert 30 <= int(share.partition(" ")[0]) <= 50
    assert "taken for a ramp or an auxiliary lane" in share
    vehicle = np.repeat(found.vehicles.id, found.road.tracks.index.counts)
    assert (found.road.tracks.lane[vehicle >= 5000] == 0).all()
    assert len(found.meta.lower) == len(made.markings)


def test_an_empty_lane_is_no_lane(tmp_path, rows):
    found = read(write(tmp_path, rows.assign(lane_kf=rows["lane_kf"].astype(float).mask(rows.index < 5))))
    assert found.road.tracks.lane[:5].tolist() == [0] * 5


def test_who_drives_against_the_others_is_left_out_and_told(tmp_path, rows):
    first = rows["id"].iloc[0]
    one = rows["id"] == first
    end = rows.loc[one, ["xloc_kf", "yloc_kf"]].sum().to_numpy() * 2.0 / one.sum()
    back = rows.copy()
    back.loc[one, ["xloc_kf", "yloc_kf"]] = end - rows.loc[one, ["xloc_kf", "yloc_kf"]].to_numpy()
    found = read(write(tmp_path, back))
    assert first not in found.vehicles.id
    assert "1 vehicles drive against the others and are left out" in found.notes[0]


def test_lane_numbers_from_right_to_left_raise_a_doubt(tmp_path, rows):
    found = read(write(tmp_path, rows.assign(lane_kf=rows["lane_kf"].max() + 1 - rows["lane_kf"])))
    assert "left and right are exchanged" in found.notes[0]


def test_types_in_words_and_in_numbers(tmp_path, rows):
    trucks = rows["type_most_common"] == "large-vehicle"
    numbers = np.where(trucks, "2.0", "4.0")
    expected, found = (
        read(write(tmp_path / "a", rows)),
        read(write(tmp_path / "b", rows.assign(**{TYPE: numbers}))),
    )
    assert trucks.any()
    assert found.vehicles.vehicle_class.tolist() == expected.vehicles.vehicle_class.tolist()
    with pytest.raises(
        InputError, match=r"column 'type_most_common': 'boat' is none of 1, 2, 3, 4, small-vehicle"
    ):
        read(write(tmp_path / "c", rows.assign(**{TYPE: "boat"})))


def test_streets_are_left_out_and_told(tmp_path, rows):
    streets = rows.rename(columns={"speed_kf": "speed_kf_x"}).assign(speed_kf_y=0.0)
    write(tmp_path, streets, "Foggy_Bottom.csv")
    with pytest.raises(InputError, match="no rows of TGSIM trajectories on motorways"):
        format_of(tmp_path, "tgsim").discover(tmp_path)
    write(tmp_path, rows)
    source = format_of(tmp_path, "auto")
    assert source.discover(tmp_path) == [1]
    assert source.remarks(tmp_path) == ["Foggy_Bottom.csv is left out: streets with signals (speeds by axis)"]


def test_times_that_are_no_tenths_are_refused(tmp_path, rows):
    with pytest.raises(InputError, match=r"column 'time': .* is no multiple of 0.1 s: rows are 10 a second"):
        read(write(tmp_path, rows.assign(time=rows["time"] * 1.25)))


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("speed_kf", "fast", "row 6, column 'speed_kf': 'fast' is not a number"),
        ("xloc_kf", "", "row 6, column 'xloc_kf': '' is not a number"),
        ("yloc_kf", "1e9", "row 6, column 'yloc_kf': 1e9 is outside"),
        ("id", "1.5", "row 6, column 'id': '1.5' is not a whole number"),
        ("length_smoothed", "nan", "row 6, column 'length_smoothed': 'nan' is not a finite number"),
        ("width_smoothed", "45", "row 6, column 'width_smoothed': 45 is outside"),
    ],
)
def test_a_fault_is_named_by_column_and_row(tmp_path, rows, column, value, said):
    text = rows.iloc[:300].astype(object)
    text.loc[4, column] = value
    with pytest.raises(InputError) as caught:
        read(write(tmp_path, text))
    assert said in str(caught.value)


def test_a_missing_column_is_told_with_those_expected(tmp_path, rows):
    with pytest.raises(InputError, match=r"column 'speed_kf': is missing; TGSIM's are id, time, xloc_kf"):
        read(write(tmp_path, rows.drop(columns="speed_kf")))


def test_what_takes_the_place_of_a_column_is_there():
    assert set(PLACE_OF.values()) <= {TYPE, *(field.name for field in FIELDS)}
    counted = {"numLaneChanges", "minDHW", "minTHW", "traveledDistance"}  # that TGSIM does not hold
    checked = {name for check in CROSS_CHECKS.values() for name in check.column.split(", ")}
    assert checked - counted <= set(PLACE_OF)


# --- exiD ---

EXID = "recordingId,trackId,frame,xCenter,yCenter,heading,lonVelocity,laneletId,leadId\n0,0,0,1,2,3,4,5,-1\n"


def test_exid_is_recognised_and_refused_with_what_is_missing(tmp_path):
    (tmp_path / "00_tracks.csv").write_text(EXID)
    source = format_of(tmp_path, "exid")
    assert format_of(tmp_path, "auto") is source
    with pytest.raises(
        InputError, match=r"looks like exiD, which cannot be read: .* expected is highd, ngsim or tgsim"
    ):
        source.discover(tmp_path)
    with pytest.raises(InputError) as caught:
        source.read(tmp_path, 1, SETTINGS)
    assert "\n" not in str(caught.value)


def test_a_folder_without_exid_is_told_so(tmp_path, rows):
    with pytest.raises(InputError, match="no file of the format exid, here or in a folder below"):
        format_of(write(tmp_path, rows), "exid")
    assert {"highd", "ngsim", "tgsim", "exid"} <= set(FORMATS)
