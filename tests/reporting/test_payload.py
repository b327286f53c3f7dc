import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sample_event import sample_event

from highd_lc.planning.pareto import BLOCKERS
from highd_lc.reporting import payload
from highd_lc.reporting.event import Ground
from highd_lc.vocab import names


def unpack(channels, data):
    """Plain twin of the page's script."""
    values, offset = [], 0
    for step, base, first, count in channels:
        deltas = np.frombuffer(data, np.int8, count, offset).astype(int)
        values.append((first, step * (base + np.cumsum(deltas))))
        offset += count
    assert offset == len(data)
    return values


@settings(max_examples=200)
@given(
    arrays(np.float64, st.tuples(st.integers(1, 4), st.integers(1, 60)), elements=st.floats(-500, 500)),
    st.sampled_from([0.01, 0.1]),
)
def test_packed_channels_come_back_within_half_a_step(values, step):
    packed = payload.pack(list(values), step)
    for row, (head, (first, back)) in zip(
        values, zip(packed.channels, unpack(packed.channels, packed.data), strict=True), strict=True
    ):
        assert first == 0
        assert head[0] >= step
        np.testing.assert_allclose(back, row, atol=0.5 * head[0] * (1 + 1e-9))


def test_slow_channels_keep_the_step_asked_for():
    packed = payload.pack([np.linspace(0.0, 30.0, 151)], 0.01)
    assert packed.channels[0][0] == 0.01


def test_unknown_ends_are_left_out():
    values = np.array([np.nan, np.nan, 1.0, 1.5, 2.0, np.nan])
    packed = payload.pack([values, np.full(6, np.nan), np.arange(6.0)], 0.1)
    (first, seen), (_, nothing), (_, all_of_it) = unpack(packed.channels, packed.data)
    assert first == 2
    np.testing.assert_allclose(seen, [1.0, 1.5, 2.0])
    assert nothing.size == 0
    np.testing.assert_allclose(all_of_it, np.arange(6.0))


def test_recorded_motion_is_no_finer_than_a_tenth_unless_raw():
    report = sample_event()
    safe = {p["policy"]: p for p in payload.event_payload(report)["plays"]}
    raw = {p["policy"]: p for p in payload.event_payload(report, raw=True)["plays"]}
    assert min(head[0] for head in safe["recorded"]["channels"]) >= 0.1
    assert min(head[0] for head in raw["recorded"]["channels"]) == 0.01
    for other in payload.event_payload(report)["others"]:
        assert min(head[0] for head in other["channels"]) >= 0.1


def test_safe_payload_has_no_more_than_ten_samples_a_second():
    data = payload.event_payload(sample_event())
    assert data["dt"] >= 0.1
    assert all(fit["dt"] >= 0.1 for fit in data["fits"].values())


def test_safe_payload_names_no_vehicle_and_no_frame():
    report = sample_event()
    report.event["start_frame"], report.event["crossing_frame"], report.event["end_frame"] = 77_771, 77_772, 77_773
    report.event["follower_ids"] = [88_881, 88_882, 88_883]
    text = json.dumps(payload.event_payload(report))
    assert not any(str(number) in text for number in (77_771, 77_772, 77_773, 88_881, 88_882, 88_883))


def test_positions_come_back_in_the_moving_frame():
    report = sample_event()
    data = payload.event_payload(report)
    play = next(p for p in data["plays"] if p["policy"] == names.LOCAL_OPTIMUM)
    moved = unpack(play["channels"], base64.b64decode(play["data"]))[0][1]
    x = moved + data["v0"] * data["dt"] * np.arange(moved.size)
    truth = report.play(names.LOCAL_OPTIMUM).ego.x
    np.testing.assert_allclose(x, truth, atol=0.51 * play["channels"][0][0])


def test_surface_levels_and_mask_come_back():
    report = sample_event()
    packed = payload.event_payload(report)["surface"]
    shape = len(packed["T"]), len(packed["x"])
    for accounting, entry in packed["losses"].items():
        array = packed["arrays"][entry["hv"]]
        levels = np.frombuffer(base64.b64decode(array["data"]), "<u2").reshape(shape)
        values = array["low"] + array["scale"] * levels
        np.testing.assert_allclose(values, report.surface.loss_hv[accounting], atol=array["scale"] + 1e-4)
        bits = np.frombuffer(base64.b64decode(entry["feasible"]), np.uint8)
        mask = np.unpackbits(bits, bitorder="little")[: levels.size].reshape(shape).astype(bool)
        np.testing.assert_array_equal(mask, report.surface.feasible[accounting])


def test_unknown_surface_cells_are_marked():
    values = np.array([[1.0, np.nan], [3.0, 2.0]])
    packed = payload._levels(values)
    levels = np.frombuffer(base64.b64decode(packed["data"]), "<u2")
    assert levels[1] == 65535
    assert packed["low"] + packed["scale"] * levels[2] == pytest.approx(3.0, abs=1e-4)


def test_payload_is_plain_json():
    json.dumps(payload.event_payload(sample_event(1)), allow_nan=False)


def test_a_picture_of_the_road_is_on_pages_alone_that_are_not_shared():
    report = replace(sample_event(), ground=Ground(b"jpeg", (-100.0, 300.0), (-6.0, 10.0)))
    assert payload.event_payload(report)["ground"] is None
    ground = payload.event_payload(report, raw=True)["ground"]
    assert ground["href"] == f"data:image/jpeg;base64,{base64.b64encode(b'jpeg').decode()}"
    assert (ground["x"], ground["y"]) == ([-100.0, 300.0], [-6.0, 10.0])


def test_the_page_has_a_colour_for_everything_that_may_stand_in_a_plans_way():
    script = (Path(payload.__file__).parent / "assets" / "surface.js").read_text()
    colours = json.loads(re.search(r"const BLOCKED = (\[.*?\]);", script, re.DOTALL).group(1))
    assert len(colours) == len(BLOCKERS)
    assert len({tuple(colour) for colour in colours[1:]}) == len(BLOCKERS) - 1
