"""Who leads the target lane when its leader has left it."""

from dataclasses import replace

import numpy as np
import pytest
from made_traffic import traffic

from highd_lc.extraction.roles import NOBODY, Successor, left_at, successors

EGO, FIRST = (100.0, 30.0, 1, 4.5), 140.0


def leaves(frame, frames=100):
    """Lanes of a vehicle that is on lane 2 before a frame and on lane 3 from it on."""
    return np.where(np.arange(1, frames + 1) < frame, 2, 3)


def found(made, leader=1, frame=20):
    return list(successors(made, leader, ego=0, lane=2, frame=frame, flicker_s=1.0))


@pytest.mark.parametrize("frame", [21, 50, 99])
def test_the_next_vehicle_ahead_leads_from_the_moment_of_leaving(frame):
    made = traffic((EGO, (FIRST, 30.0, leaves(frame), 4.5), (200.0, 29.0, 2, 12.0), (260.0, 31.0, 2, 4.5)))
    assert found(made) == [Successor(frame, 2)]


@pytest.mark.parametrize(
    "others",
    [
        [],
        [(60.0, 30.0, 2, 4.5)],  # behind
        [(200.0, 30.0, 3, 4.5)],  # on another lane
        [(200.0, 30.0, leaves(49), 4.5)],  # gone before
    ],
)
def test_without_anybody_ahead_on_the_lane_nobody_leads(others):
    made = traffic((EGO, (FIRST, 30.0, leaves(50), 4.5), *others))
    assert found(made) == [Successor(50, NOBODY)]


def test_a_leader_that_stays_has_no_successor():
    assert found(traffic((EGO, (FIRST, 30.0, 2, 4.5), (200.0, 30.0, 2, 4.5)))) == []
    assert found(traffic((EGO,)), leader=NOBODY) == []


def test_leaders_that_leave_one_after_the_other():
    made = traffic(
        (EGO, (FIRST, 30.0, leaves(30), 4.5), (180.0, 30.0, leaves(60), 4.5), (220.0, 30.0, leaves(60), 4.5))
    )
    assert found(made) == [Successor(30, 2), Successor(60, NOBODY)]


def test_who_moves_in_between_does_not_lead():
    between = np.where(np.arange(1, 101) < 40, 1, 2)
    made = traffic((EGO, (FIRST, 30.0, leaves(50), 4.5), (120.0, 30.0, between, 4.5), (200.0, 30.0, 2, 4.5)))
    assert found(made) == [Successor(50, 3)]


def test_the_ego_and_the_other_carriageway_never_lead():
    made = traffic(((180.0, 30.0, 2, 4.5), (FIRST, 30.0, leaves(50), 4.5), (200.0, 30.0, 2, 4.5)))
    made = replace(made, direction=np.array([2, 2, 1]))
    assert found(made) == [Successor(50, NOBODY)]


@pytest.mark.parametrize(("off", "expected"), [(8, -1), (10, -1), (11, 40), (30, 40)])
def test_a_flicker_of_lane_ids_is_no_leaving(off, expected):
    lane = np.full(100, 2)
    lane[39 : 39 + off] = 3
    made = traffic((EGO, (FIRST, 30.0, lane, 4.5)))
    assert left_at(made, 1, lane=2, frame=20, flicker_s=1.0) == expected
