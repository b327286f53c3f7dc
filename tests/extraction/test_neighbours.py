import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.extraction.roles import NOBODY, Ego, Lane, neighbours

EGO = Ego(front=100.0, rear=95.0, later_front=200.0)
LIMITS = {"max_link_m": 150.0, "max_followers": 3}


def lane(*vehicles):
    """Vehicles as (index, front, length, front at the crossing or None)."""
    index, front, length, later = zip(*vehicles, strict=True)
    later = [np.nan if value is None else value for value in later]
    front = np.array(front, dtype=float)
    return Lane(np.array(index), front, front - np.array(length), np.array(later, dtype=float))


EMPTY = Lane(np.array([], dtype=np.int64), np.array([]), np.array([]), np.array([]))


def test_empty_lane_has_nobody():
    found = neighbours(EGO, EMPTY, **LIMITS)
    assert (found.leader, found.followers, found.follower_ahead) == (NOBODY, (), False)


def test_chain_is_walked_upstream_from_the_ego():
    found = neighbours(EGO, lane((7, 60, 5, 160), (3, 130, 5, 230), (4, 20, 5, 120), (9, 180, 5, 280)), **LIMITS)
    assert found.leader == 3
    assert found.followers == (7, 4)


def test_chain_ends_at_a_long_link_and_at_the_largest_number():
    found = neighbours(EGO, lane((1, 90, 5, 190), (2, -60, 5, 40), (3, -210.1, 5, -110)), **LIMITS)
    assert found.followers == (1, 2)
    four = lane(*((k, 90 - 20 * k, 5, None) for k in range(4)))
    assert neighbours(EGO, four, **LIMITS).followers == (0, 1, 2)
    assert neighbours(EGO, lane((1, -50.1, 5, None)), **LIMITS).followers == ()


@pytest.mark.parametrize(("later", "leads"), [(201.0, True), (199.0, False)])
def test_vehicle_alongside_is_resolved_by_its_front_at_the_crossing(later, leads):
    found = neighbours(EGO, lane((5, 98, 5, later)), **LIMITS)
    assert (found.leader == 5) is leads
    assert (found.followers == (5,)) is not leads
    assert not found.follower_ahead


@pytest.mark.parametrize(("front", "leads"), [(99.0, False), (102.0, True)])
def test_vehicle_alongside_that_has_left_the_view_is_resolved_by_its_front_now(front, leads):
    assert (neighbours(EGO, lane((5, front, 5, None)), **LIMITS).leader == 5) is leads


@pytest.mark.parametrize("front", [100.0, 101.0])
def test_follower_whose_front_is_not_behind_is_reported(front):
    assert neighbours(EGO, lane((5, front, 5, 190.0)), **LIMITS).follower_ahead


@given(
    fronts=st.lists(st.integers(-3000, 4000), min_size=1, max_size=12, unique=True),
    length=st.integers(4, 16),
)
def test_clear_lane_equals_a_plain_search(fronts, length):
    """Without anybody alongside: the nearest ahead leads, the chain is the sorted rest."""
    fronts = [f / 10 for f in fronts if not 94.9 < f / 10 < 100.1 + length]
    if not fronts:
        return
    found = neighbours(EGO, lane(*((k, f, length, None) for k, f in enumerate(fronts))), **LIMITS)
    ahead = [f for f in fronts if f > EGO.front]
    chain, last = [], EGO.front
    for front in sorted((f for f in fronts if f < EGO.front), reverse=True):
        if last - front > 150.0 or len(chain) == 3:
            break
        chain.append(fronts.index(front))
        last = front
    assert found.leader == (fronts.index(min(ahead)) if ahead else NOBODY)
    assert list(found.followers) == chain
