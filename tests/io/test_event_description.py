import pandas as pd
import pytest

from highd_lc.io import artefacts
from highd_lc.io.event_description import describe_event, event_facts, list_events, list_text, records
from highd_lc.vocab.errors import ArtefactError, UsageError
from highd_lc.vocab.job import Provenance

PROVENANCE = Provenance("settings", {}, 1, "code")
USABLE, CUT = "01-0012-00100", "01-0013-00200"


def finish(work, name, **columns):
    frame = pd.DataFrame(columns)
    missing = {c: None for c in artefacts.TABLES[name].column_names if c not in frame}
    artefacts.write(artefacts.path_of(work, name), artefacts.to_arrow(name, frame.assign(**missing), PROVENANCE))


@pytest.fixture
def work(tmp_path):
    finish(
        tmp_path, "crossings", event_id=[USABLE, CUT], recording_id=1, ego_id=[12, 13], ego_class=["Car", "Truck"],
        direction=["left", ""], crossing_frame=[100, 200], origin_lane=[1, None], target_lane=[2, 1],
        start_frame=[60, None], end_frame=[150, None], usable=[True, False], reason=["", "outside_markings"],
    )  # fmt: skip
    finish(
        tmp_path, "events", event_id=[USABLE], recording_id=1, ego_id=12, ego_class="Car", direction="left",
        origin_lane=1, target_lane=2, start_frame=60, crossing_frame=100, end_frame=150, frame_rate=25.0,
        duration_s=3.6, lateral_shift_m=3.5, peak_lateral_speed_mps=1.2, follower_ids=[[14]], roles_confirmed=True,
        leader_changes_s=[[]], later_leader_ids=[[]],
    )  # fmt: skip
    finish(
        tmp_path, "event_tracks", event_id=USABLE, recording_id=1,
        role=["ego"] * 2 + ["target_follower_1"] * 3 + ["target_leader_2"] * 2, vehicle_id=[12] * 2 + [14] * 5,
        t=[0.0, 0.04, -0.04, 0.0, 0.04, 2.0, 2.04], x=[0.0, 1.0, -31.0, -30.0, -29.0, 90.0, 91.0], y=0.0,
        vx=[25.0] * 2 + [27.0] * 5, vy=0.0,
        ax=0.0, ay=0.0, calibration=[False, False, True, False, False, False, False],
    )  # fmt: skip
    finish(
        tmp_path, "vehicles", recording_id=1, vehicle_id=[12, 14], driving_direction=2, length=4.5, width=1.9,
        first_frame=1, last_frame=400, recorded_id=[12, 14], **{"class": ["Car", "Truck"]},
    )  # fmt: skip
    return tmp_path


def test_usable_event_names_frames_and_roles(work):
    head, verdict, frames, facts, _, columns, ego, follower, later = describe_event(work, USABLE).splitlines()
    assert head == "01-0012-00100: recording 1, vehicle 12 (Car) to the left, lane 1 -> 2 (1 = rightmost)"
    assert verdict == "usable"
    assert frames == "frames: start 60, crossing 100, end 150"
    assert facts == "duration 3.60 s, lateral shift +3.50 m, peak lateral speed 1.20 m/s"
    assert columns.split("  ")[1] == "role"
    assert ego.split() == ["ego", "12", "Car", "0.00", "25.00", "0.00", "0.04", "0.00"]
    assert follower.split() == ["target_follower_1", "14", "Truck", "-30.00", "27.00", "-0.04", "0.04", "0.04"]
    assert later.split() == ["target_leader_2", "14", "Truck", "90.00", "27.00", "2.00", "2.04", "0.00"]


def test_unusable_change_names_its_reason(work):
    assert describe_event(work, CUT).splitlines() == [
        "01-0013-00200: recording 1, vehicle 13 (Truck), lane outside -> 1 (1 = rightmost)",
        "not usable: outside_markings",
        "frames: start not found, crossing 200, end not found",
    ]


def test_unknown_event_is_answered_with_the_nearest(work):
    with pytest.raises(UsageError, match=r"no lane-id change '01-0013-00999'; known are 01-0013-00200, "):
        describe_event(work, "01-0013-00999")


def test_missing_artefacts_are_named(tmp_path):
    with pytest.raises(ArtefactError, match="crossings"):
        describe_event(tmp_path, USABLE)


def test_usable_events_are_listed_with_what_is_known_of_them(work):
    (row,) = records(list_events(work))
    assert row["event_id"] == USABLE
    assert (row["duration_s"], row["lateral_shift_m"], row["n_followers"]) == (3.6, 3.5, 1)


@pytest.mark.parametrize(
    ("filters", "expected"),
    [
        ({"direction": "left"}, [USABLE]),
        ({"direction": "right"}, []),
        ({"vehicle_class": "Truck"}, []),
        ({"recordings": (1,)}, [USABLE]),
        ({"reason": "outside_markings"}, [CUT]),
        ({"reason": "flicker"}, []),
        ({"reason": "any"}, [CUT]),
        ({"reason": "any", "vehicle_class": "Car"}, []),
    ],
)
def test_filters_keep_what_they_name(work, filters, expected):
    assert list_events(work, **filters)["event_id"].tolist() == expected


def test_what_is_not_known_of_an_unusable_change_is_null(work):
    (row,) = records(list_events(work, reason="any"))
    assert (row["origin_lane"], row["duration_s"], row["n_followers"]) == (None, None, None)


@pytest.mark.parametrize(
    ("filters", "said"),
    [
        ({"direction": "up"}, "--direction 'up': one of left, right is needed"),
        ({"vehicle_class": "car"}, "--class 'car': one of Car, Truck is needed"),
        ({"reason": "bored"}, "--reason 'bored': one of outside_markings, "),
        ({"recordings": (1, 7)}, "recording 7 has no change of lane"),
    ],
)
def test_filters_that_name_nothing_are_refused(work, filters, said):
    with pytest.raises(UsageError, match=said):
        list_events(work, **filters)


def test_facts_of_an_event_are_those_of_the_words(work):
    facts = event_facts(work, USABLE)
    assert (facts["start_frame"], facts["end_frame"]) == (60, 150)
    assert [role["role"] for role in facts["roles"]] == ["ego", "target_follower_1", "target_leader_2"]
    assert facts["roles"][1] == {
        "role": "target_follower_1", "vehicle_id": 14, "class": "Truck", "length_m": 4.5, "width_m": 1.9,
        "x_m": -30.0, "vx_mps": 27.0, "from_s": pytest.approx(-0.04), "to_s": pytest.approx(0.04),
        "calibration_samples": 1,
    }  # fmt: skip
    assert event_facts(work, CUT)["reason"] == "outside_markings"


def test_what_is_missing_is_a_dash_in_a_list(work):
    lines = list_text(list_events(work, reason="any")).splitlines()
    assert len(lines) > 1
    assert all(line.endswith("-") for line in lines[1:])
    assert not any(word in line for line in lines for word in ("<NA>", "NaN"))


def test_a_list_of_nothing_says_none(work):
    assert list_text(list_events(work).iloc[:0]) == "none"
