import numpy as np
import pytest
from made_traffic import RATE, traffic

from highd_lc.extraction.data_quality import ENTRY, EXIT, INNER, disagreement, mean_speed_change, vehicle_facts
from highd_lc.extraction.track_index import TrackIndex


def random_traffic(seed=1):
    rng = np.random.default_rng(seed)
    vehicles = [
        (300.0 * rng.random(), 25 + 5 * rng.random(), int(rng.integers(0, 3)), 4 + rng.random()) for _ in range(8)
    ]
    return traffic(vehicles, frames=40)


def test_facts_equal_plain_loops():
    made = random_traffic()
    kept = np.sort(np.random.default_rng(2).permutation(len(made.x))[: len(made.x) * 9 // 10])
    vehicle = np.repeat(np.arange(8), 40)[kept]
    index = TrackIndex.of(vehicle, made.index.frame[kept])
    x, lane, leader = made.x[kept], made.lane[kept], made.leader_id[kept]
    vx = np.where(np.arange(len(x)) % 11 == 0, 0.0, 26.0)
    facts = vehicle_facts(index, x, vx=vx, lane=lane, leader_id=leader, ids=made.ids, length=made.length)
    place = {(v, f): row for row, (v, f) in enumerate(zip(vehicle, index.frame, strict=True))}
    for v in range(8):
        rows = np.flatnonzero(vehicle == v)
        gaps, time_gaps = [], []
        for row in rows:
            ahead = place.get((leader[row] // 10 - 1, index.frame[row]))
            if leader[row] and ahead is not None:
                w = vehicle[ahead]
                gaps.append(x[ahead] - x[row] - (made.length[v] + made.length[w]) / 2)
                if vx[row] > 0:
                    time_gaps.append(gaps[-1] / vx[row])
        assert facts.holes[v] == np.sum(np.diff(index.frame[rows]) > 1)
        assert facts.lane_changes[v] == 0
        assert facts.outside[v] == np.sum(lane[rows] == 0)
        assert facts.min_gap[v] == pytest.approx(min(gaps, default=np.nan), nan_ok=True)
        assert facts.min_time_gap[v] == pytest.approx(min(time_gaps, default=np.nan), nan_ok=True)
        assert facts.travelled[v] == pytest.approx(x[rows[-1]] - x[rows[0]])


def test_lane_changes_are_counted_within_vehicles_only():
    made = traffic(((0.0, 30.0, np.r_[np.full(10, 1), np.full(10, 2)], 4.5), (50.0, 30.0, 1, 4.5)), frames=20)
    facts = vehicle_facts(
        made.index, made.x, vx=made.x * 0 + 30, lane=made.lane, leader_id=made.leader_id, ids=made.ids,
        length=made.length,
    )  # fmt: skip
    assert facts.lane_changes.tolist() == [1, 0]


def test_disagreement_is_found_where_it_is():
    made = traffic(((0.0, 30.0, 1, 4.5), (-20.0, 30.0, 1, 4.5)), frames=120)
    vx = np.where(made.x < 50, 29.5, np.where(made.x > 250, 30.2, 30.0))
    found = disagreement(
        made.index, made.x, vx, vehicles=np.array([0, 1]), rate=RATE, extent=(0.0, 300.0), trim=50.0
    )
    assert found.size[ENTRY] == pytest.approx(0.5)
    assert found.size[INNER] == pytest.approx(0.0, abs=1e-9)
    assert found.size[EXIT] == pytest.approx(0.2)
    assert found.profile[2] == pytest.approx(0.5)
    assert found.profile[10] == pytest.approx(0.0, abs=1e-9)
    assert len(found.profile) == 30


def test_disagreement_of_a_single_row_is_unknown():
    made = traffic(((0.0, 30.0, 1, 4.5),), frames=1)
    found = disagreement(
        made.index, made.x, made.x, vehicles=np.array([0]), rate=RATE, extent=(0.0, 10.0), trim=2.0
    )
    assert np.isnan(found.size).all()
    assert np.isnan(mean_speed_change(made.index, made.x, vehicles=np.array([0]), rate=RATE))


def test_speed_change_is_that_of_the_ends():
    made = random_traffic()
    vx = 20.0 + 0.3 * (made.index.frame - 1) / RATE
    assert mean_speed_change(made.index, vx, vehicles=np.arange(8), rate=RATE) == pytest.approx(0.3)
