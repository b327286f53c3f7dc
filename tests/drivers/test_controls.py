"""Matched controls: who can be one, and who is chosen."""

import numpy as np

from highd_lc.drivers.prediction import Rows, match, speeds, starts

RATE = 25.0


def rows_of(*vehicles: dict[str, float]) -> Rows:
    """Vehicles of 300 frames each, at constant speed behind a leader; ``cut_at``: frame of another leader."""
    parts = []
    for number, about in enumerate(vehicles):
        frame = np.arange(1, 301)
        v = np.full(300, about.get("v", 30.0))
        leader = np.where(frame < about.get("cut_at", 999), 100 + number, 900)
        parts.append(
            (np.full(300, number), frame, np.full(300, about.get("group", 0)), leader, v, np.zeros(300),
             np.full(300, about.get("spacing", 40.0)), v - about.get("closing", 0.0))
        )  # fmt: skip
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Rows(*(c.astype(np.int64) for c in columns[:4]), *(c.astype(float) for c in columns[4:]))


def test_a_control_keeps_its_leader_to_the_horizon() -> None:
    found = starts(rows_of({}, {"cut_at": 150}), RATE, 5.0)
    frames = found.row % 300 + 1
    kept = frames[found.vehicle == 1]
    assert ((kept + 125 < 150) | (kept - 12 >= 150)).all()
    assert (frames + 125 <= 300).all()
    assert (frames - 12 >= 1).all()


def test_the_nearest_alike_are_chosen_one_a_vehicle() -> None:
    rows = rows_of({"v": 30.0}, {"v": 30.5}, {"v": 32.0}, {"v": 30.1, "group": 1})
    found = starts(rows, RATE, 5.0)
    chosen = match(0, np.array([30.4, 0.0, 40.0, 0.0]), np.array([7]), found)
    assert found.vehicle[chosen].tolist() == [1, 0]
    assert found.vehicle[match(0, np.array([30.4, 0.0, 40.0, 0.0]), np.array([1]), found)].tolist() == [0]


def test_speeds_are_read_on_the_grid() -> None:
    rows = rows_of({})
    ramp = rows._replace(v=30.0 + 0.04 * (rows.frame - 1))
    series = speeds(ramp, np.array([25]), RATE, 5.0)
    np.testing.assert_allclose(series[:, 0], 30.0 + 0.04 * 25 + 0.1 * np.arange(51))
