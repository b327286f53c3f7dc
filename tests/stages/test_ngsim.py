"""NGSIM's formats: what the synthetic carriageway comes to when it is written in each and read again."""

import re

import numpy as np
import pandas as pd
import pytest
import running
from ngsim_recording import FOOT, STARTS, carriageway, table, write_csv, write_portal, write_text

from highd_lc.extraction.data_quality import vehicle_facts
from highd_lc.io import unmarked
from highd_lc.io.formats import format_of
from highd_lc.io.ngsim_files import FIELDS, PLACE_OF
from highd_lc.stages import cross_checks
from highd_lc.vocab.cross_checks import CROSS_CHECKS, META, TRACKS, VEHICLES
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.settings import IngestSettings

ROUNDING = 0.0005 * FOOT + 0.0025 * FOOT  # of the position, and half of that of the length
SETTINGS = IngestSettings()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return carriageway(tmp_path_factory.mktemp("made") / "highd", seconds=150.0)


@pytest.fixture(scope="module")
def rows(made):
    return table(made)


def read(data, recording=1, smoothing="auto"):
    settings = IngestSettings(ngsim_smoothing=smoothing)
    return format_of(data, "auto").read(data, recording, settings)


def written(way, folder, rows):
    if way == "portal":
        return write_portal(folder / "NGSIM.csv", [("us-101", rows)])
    return (write_csv if way == "csv" else write_text)(folder / f"us-101-0750.{way}", rows)


@pytest.mark.parametrize("way", ["csv", "txt", "portal"])
def test_positions_and_speeds_are_those_that_were_written(tmp_path, made, rows, way):
    written(way, tmp_path, rows)
    found = read(tmp_path)
    tracks = found.road.tracks
    np.testing.assert_allclose(tracks.x, made.own("x"), atol=ROUNDING)
    offset = tracks.y - made.own("y")  # the outer markings are estimates
    assert np.ptp(offset) < 0.0011 * FOOT
    np.testing.assert_allclose(tracks.vx, made.own("vx"), atol=0.0051 * FOOT)
    assert tracks.lane.tolist() == made.own("lane").tolist()
    assert tracks.leader_id.tolist() == made.own("leader_id").tolist()
    inner = (made.markings[-1] - made.markings)[::-1][1:-1]
    assert np.abs(np.diff(found.meta.lower[1:-1]) - np.diff(inner)).max() < 0.1
    assert found.notes == ()


@pytest.fixture(scope="module")
def events(made, rows, tmp_path_factory):
    """The events of direction 2 from HighD's files and from NGSIM's."""
    root = tmp_path_factory.mktemp("events")
    write_csv(root / "ngsim" / "us101.csv", rows)
    highd = running.extracted(_highd_of(made, root), root / "w1")
    directions = highd["vehicles"].set_index("vehicle_id")["driving_direction"]
    known = highd["crossings"][highd["crossings"]["ego_id"].map(directions) == 2]
    return known, running.extracted(root / "ngsim", root / "w2")["crossings"], highd


def _highd_of(made, root):
    carriageway(root / "highd", seconds=150.0)
    return root / "highd"


def test_events_are_the_same(events):
    expected, found, _ = events
    found = found.assign(crossing_frame=found["crossing_frame"] - 9)  # frames begin at 10 in what was written
    assert len(expected) > 10
    pairs = expected.merge(found, on=["ego_id", "origin_lane", "target_lane"], suffixes=("", "_ngsim"))
    assert len(pairs) == len(expected) == len(found)
    assert (pairs["crossing_frame"] - pairs["crossing_frame_ngsim"]).abs().max() <= 1
    assert pairs["reason"].tolist() == pairs["reason_ngsim"].tolist()
    usable = pairs[pairs["usable"]]
    assert len(usable) > 5
    assert (usable["start_frame"] - usable["start_frame_ngsim"] + 9).abs().max() <= 1
    assert (usable["end_frame"] - usable["end_frame_ngsim"] + 9).abs().max() <= 1


def test_periods_and_locations_of_one_file_are_recordings_of_their_own(tmp_path, made, rows):
    second = table(made, start=STARTS[1])
    second = second[second["Vehicle_ID"] > 40]
    street = rows[rows["Vehicle_ID"] < 40]
    write_portal(tmp_path / "all.csv", [("us-101", second), ("lankershim", street), ("us-101", rows)])
    source = format_of(tmp_path, "auto")
    assert source.discover(tmp_path) == [1, 2]
    assert source.remarks(tmp_path) == [
        "all.csv: a period of lankershim is left out: a street with signals",
    ]
    first, other = (source.read(tmp_path, number, SETTINGS) for number in (1, 2))
    assert len(first.road.tracks.x) == len(rows)
    assert len(other.road.tracks.x) == len(second)
    assert first.meta.location == 101


def test_a_folder_of_streets_alone_is_refused(tmp_path, rows):
    write_portal(tmp_path / "all.csv", [("peachtree", rows)])
    with pytest.raises(InputError, match="only peachtree: streets with signals"):
        format_of(tmp_path, "auto").discover(tmp_path)


def test_an_id_that_stands_for_two_vehicles_is_split(tmp_path, rows):
    counts = rows.groupby("Vehicle_ID").size()
    one, two = counts.index[0], next(i for i in counts.index[1:] if counts[i] != counts.iloc[0])
    merged = rows.assign(
        **{name: rows[name].replace(two, one) for name in ("Vehicle_ID", "Preceding", "Following")}
    )
    write_csv(tmp_path / "us101.csv", merged)
    found = read(tmp_path)
    assert len(found.vehicles.id) == len(counts)
    assert found.notes == (
        "us101.csv: recording 01: 1 ids stand for several vehicles and are split by Total_Frames",
    )
    expected = dict(zip(rows["Vehicle_ID"], rows["Total_Frames"], strict=True))
    assert sorted(found.vehicles.n_frames) == sorted(expected.values())


def test_ramps_are_on_no_lane_and_vehicles_of_ramps_alone_are_left_out(tmp_path, rows):
    first, second = rows["Vehicle_ID"].unique()[:2]
    frames = rows.loc[rows["Vehicle_ID"] == second, "Frame_ID"]
    on_ramp = (rows["Vehicle_ID"] == second) & (rows["Frame_ID"] < frames.min() + 5)
    lanes = rows["Lane_ID"].mask(rows["Vehicle_ID"] == first, 8).mask(on_ramp, 7)
    write_csv(tmp_path / "us101.csv", rows.assign(Lane_ID=lanes))
    found = read(tmp_path)
    assert first not in found.vehicles.id
    assert not np.isin(found.road.tracks.leader_id, first).any()
    place = int(np.flatnonzero(found.vehicles.id == second)[0])
    of_second = found.road.tracks.lane[found.road.tracks.index.span(place)]
    assert of_second[:5].tolist() == [0] * 5
    assert (of_second[5:] > 0).all()
    assert "1 vehicles are on auxiliary lanes and ramps alone and are left out" in found.notes[0]


@pytest.mark.parametrize(("place", "lanes"), [("i-80", 6), ("us-101", 5)])
def test_the_sixth_lane_is_a_main_lane_on_i80_alone(tmp_path, rows, place, lanes):
    shifted = rows.assign(Lane_ID=rows["Lane_ID"] + 3, Local_X=rows["Local_X"] + 36.0)
    write_portal(tmp_path / "all.csv", [(place, shifted)])
    assert len(read(tmp_path).meta.lower) == lanes + 1


def test_identical_rows_are_counted_and_contradicting_ones_cost_their_vehicle(tmp_path, rows):
    twice = pd.concat([rows, rows.iloc[[5, 6]], rows.iloc[[-1]].assign(Local_Y=3.0)])
    write_csv(tmp_path / "us101.csv", twice)
    found = read(tmp_path)
    lost = rows["Vehicle_ID"].iloc[-1]
    assert found.duplicates.sum() == 2
    assert lost not in found.vehicles.id
    assert "1 vehicles have rows that contradict each other and are left out" in found.notes[0]


def test_noisy_positions_are_smoothed_and_clean_ones_are_not(tmp_path, made, rows):
    noise = np.random.default_rng(1).normal(0.0, 0.15 / FOOT, len(rows))
    write_csv(tmp_path / "us101.csv", rows.assign(Local_Y=rows["Local_Y"] + noise))
    found, rough = read(tmp_path), read(tmp_path, smoothing="never")
    (note,) = found.notes
    assert "of noise: smoothed over (0.5, 1.0, 4.0) s" in note
    assert rough.notes == ()
    error = found.road.tracks.x - made.own("x")
    assert np.std(error) < 0.6 * 0.15
    assert np.std(found.road.tracks.ax) < 0.7


def test_smoothing_leaves_a_straight_line_alone_and_averages_symmetrically():
    parts = np.array([0, 50, 60])
    line = np.concatenate([3.0 * np.arange(50), 7.0 - np.arange(10.0)])
    np.testing.assert_allclose(unmarked.smooth(parts, line, 5.0), line, atol=1e-9)
    spike = np.zeros(60)
    spike[20] = 1.0
    found = unmarked.smooth(parts, spike, 5.0)
    weights = np.exp(-np.abs(np.arange(-15, 16)) / 5.0)
    np.testing.assert_allclose(found[20], 1.0 / weights.sum())
    np.testing.assert_allclose(found[18], np.exp(-0.4) / weights.sum())
    assert (found[50:] == 0.0).all()


def test_a_wandering_road_is_straightened(tmp_path, made, rows):
    bend = 4.0 * np.sin(rows["Local_Y"] / 400.0)
    write_csv(tmp_path / "us101.csv", rows.assign(Local_X=rows["Local_X"] + bend))
    found = read(tmp_path)
    assert "sideways along the section: straightened" in found.notes[0]
    offset = found.road.tracks.y - made.own("y")
    assert np.std(offset) < 0.15
    assert found.road.lane_mismatches.sum() < 0.02 * len(rows)


def test_gaps_are_held_against_the_space_headway(tmp_path, rows):
    write_csv(tmp_path / "us101.csv", rows)
    quality = running.extracted(tmp_path, tmp_path / "w")["recordings"].iloc[0]
    assert quality["share_gaps"] > 0.95
    assert quality["share_leader_ids"] > 0.95
    assert quality["share_speed"] > 0.95
    wrong = rows.assign(Space_Headway=rows["Space_Headway"] + 20.0)
    write_csv(tmp_path / "other" / "us101.csv", wrong)
    with pytest.raises(InputError, match="Space_Headway"):
        running.extracted(tmp_path / "other", tmp_path / "w2")


def test_asking_for_a_format_that_is_not_there_is_told(tmp_path, rows):
    with pytest.raises(InputError, match="no file of the format ngsim, here or in a folder below"):
        format_of(tmp_path, "ngsim")
    write_csv(tmp_path / "us101.csv", rows)
    with pytest.raises(InputError, match=r"us101\.csv, which looks like one of NGSIM"):
        format_of(tmp_path, "highd").discover(tmp_path)
    with pytest.raises(InputError, match="no recording 2: there are 1"):
        read(tmp_path, 2)


_FAULTS = {
    "a letter": lambda t: _cell(t, "v_Vel", "x2.1"),
    "a position of 1e9": lambda t: _cell(t, "Local_Y", "1e9"),
    "an empty position": lambda t: _cell(t, "Local_X", ""),
    "a position that is no number": lambda t: _cell(t, "Local_X", "nan"),
    "half a frame": lambda t: _cell(t, "Frame_ID", "17.5"),
    "a class 9": lambda t: _cell(t, "v_Class", "9"),
    "a negative id": lambda t: _cell(t, "Vehicle_ID", "-3"),
    "a length in metres times a thousand": lambda t: _cell(t, "v_Length", "4500"),
    "a time that is none": lambda t: _cell(t, "Global_Time", "soon"),
    "a lane that is none": lambda t: _cell(t, "Lane_ID", "two"),
    "a torn last line": lambda t: t.rstrip("\n")[:-40],
    "no column of lanes": lambda t: t.replace("Lane_ID", "Lane", 1),
    "two columns of lanes": lambda t: t.replace("Preceding", "Lane_ID", 1),
    "header only": lambda t: t.splitlines()[0] + "\n",
    "a line of commas": lambda t: t + "," * 300 + "\n",
}


def _cell(text, column, value, row=40):
    lines = text.split("\n")
    cells = lines[row].split(",")
    cells[lines[0].split(",").index(column)] = value
    lines[row] = ",".join(cells)
    return "\n".join(lines)


@pytest.mark.parametrize("name", sorted(_FAULTS))
def test_a_fault_is_an_error_that_names_the_file(tmp_path, rows, name):
    path = write_csv(tmp_path / "us101.csv", rows.iloc[:400])
    text = path.read_text()
    changed = _FAULTS[name](text)
    assert changed != text
    path.write_text(changed)
    with pytest.raises(InputError) as caught:
        read(tmp_path)
    assert str(path) in str(caught.value) or str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("way", ["csv", "txt"])
def test_a_fault_is_named_by_column_and_row(tmp_path, rows, way):
    path = written(way, tmp_path, rows.iloc[:400])
    lines = path.read_text().split("\n")
    separator = "," if way == "csv" else "   "
    cells = lines[40].split(separator)
    cells[4] = "abc"
    lines[40] = separator.join(cells)
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"row 41, column 'Local_X': 'abc' is not a number"):
        read(tmp_path)


@pytest.mark.parametrize("change", [lambda t: "\ufeff" + t, lambda t: t.replace("\n", "\r\n"), str.lower])
def test_ways_of_saving_that_change_nothing(tmp_path, rows, change):
    path = write_csv(tmp_path / "us101.csv", rows)
    expected = read(tmp_path).road.tracks
    header, _, rest = path.read_text().partition("\n")
    path.write_text(change(f"{header}\n{rest}"), newline="")
    assert read(tmp_path).road.tracks.x.tolist() == expected.x.tolist()


def test_checks_name_the_columns_of_the_file(tmp_path, rows):
    wrong = rows.assign(
        Preceding=np.where(rows["Preceding"] > 0, rows["Following"], 0), v_Acc=-2.0 * rows["v_Acc"]
    )
    write_csv(tmp_path / "us-101.csv", wrong)
    quality = cross_checks.findings(found := read(tmp_path), facts_of(found))
    said = format_of(tmp_path, "auto")
    files = dict.fromkeys((META, VEHICLES, TRACKS), tmp_path / "us-101.csv")
    own = np.arange(len(found.vehicles.id))
    failed = cross_checks.verdicts(quality, own, direction=2, files=files, said=said)
    texts = {verdict.check.name: verdict.text for verdict in failed}
    assert "column 'Preceding'" in texts["leader_ids"]
    assert "'v_Acc'" in texts["acceleration"]
    assert "the change of v_Vel" in texts["acceleration"]
    named = [text.partition(": ")[2] for text in texts.values()]
    assert not [text for text in named if re.search(rf"\b({'|'.join(PLACE_OF)})\b", text)]


def test_what_takes_the_place_of_a_column_is_there():
    assert set(PLACE_OF.values()) <= {field.name for field in FIELDS}
    counted = {"numLaneChanges", "minDHW", "minTHW", "traveledDistance"}  # that NGSIM does not hold
    checked = {name for check in CROSS_CHECKS.values() for name in check.column.split(", ")}
    assert checked - counted <= set(PLACE_OF)


def facts_of(found):
    tracks, metas = found.road.tracks, found.vehicles
    return vehicle_facts(
        tracks.index,
        tracks.x,
        vx=tracks.vx,
        lane=tracks.lane,
        leader_id=tracks.leader_id,
        ids=metas.id,
        length=metas.length,
    )
