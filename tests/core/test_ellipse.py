"""Distance of ellipses against pairs whose distance is known, against polygons, and along a way."""

import numpy as np
import pytest

from highd_lc.core.ellipse import (
    _separate_clearance,
    ellipse_clearance,
    ellipses_overlap,
    ellipses_touch,
    semi_axes,
    swept_clearance,
)

TOLERANCE_M = 1e-3


def outline(points: int, a: float, b: float, heading: float, centre: np.ndarray) -> np.ndarray:
    """Points on an ellipse, shape (points, 2)."""
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    x, y = a * np.cos(angle), b * np.sin(angle)
    turned = np.stack(
        [x * np.cos(heading) - y * np.sin(heading), x * np.sin(heading) + y * np.cos(heading)], axis=1
    )
    return turned + centre


def polygon_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Smallest distance from a corner of either polygon to a side of the other; both are convex and apart."""

    def corners_to_sides(corners, polygon):
        start, side = polygon, np.roll(polygon, -1, axis=0) - polygon
        along = np.einsum("pqi,qi->pq", corners[:, None, :] - start, side) / np.einsum("qi,qi->q", side, side)
        foot = start + np.clip(along, 0, 1)[:, :, None] * side
        return np.hypot(*(corners[:, None, :] - foot).transpose(2, 0, 1)).min()

    return min(corners_to_sides(one, other), corners_to_sides(other, one))


def random_sizes(rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Semi-axes of two vehicles, from a small car to a long truck."""
    return tuple(
        rng.uniform(low, high) / np.sqrt(2) for low, high in ((3.5, 25), (1.5, 2.6), (3.5, 25), (1.5, 2.6))
    )


def support(a: float, b: float, heading: float, angle: float) -> np.ndarray:
    """The point of an ellipse about the origin that reaches farthest in a direction."""
    n = np.array([np.cos(angle - heading), np.sin(angle - heading)])
    point = np.array([a * a, b * b]) * n / np.hypot(a * n[0], b * n[1])
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    return turn @ point


def pairs_of_known_distance(count: int):
    """Two ellipses that face each other with their farthest points in some direction, a distance apart."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        a1, b1, a2, b2 = random_sizes(rng)
        heading, angle = rng.uniform(-np.pi, np.pi, 2)
        distance = rng.choice([rng.uniform(0, 0.01), rng.uniform(0, 1), rng.uniform(0, 60)])
        n = np.array([np.cos(angle), np.sin(angle)])
        centre = support(a1, b1, heading, angle) + support(a2, b2, 0.0, angle) + distance * n
        yield centre, heading, (a1, b1, a2, b2), distance


def test_the_distance_of_10000_random_pairs():
    for centre, heading, axes, distance in pairs_of_known_distance(10_000):
        found = ellipse_clearance(*centre, heading, *axes)
        assert found <= distance + 1e-9, "optimistic"
        assert found == pytest.approx(distance, abs=1e-6)


def test_ellipses_apart_rarely_need_a_search_over_directions():
    found = []
    for (dx, dy), heading, axes, _ in pairs_of_known_distance(2_000):
        course = heading / 10.0
        quick = _separate_clearance(dx, dy, np.cos(course), np.sin(course), *axes)
        slow = swept_clearance(dx, dy, dx, dy, course, *axes)
        if slow > 1e-6:
            found.append((quick, slow))
    quick, slow = np.array(found).T
    settled = np.isfinite(quick)
    np.testing.assert_allclose(quick[settled], slow[settled], atol=1e-10)
    assert settled.mean() > 0.9  # 0.95, sizes up to long trucks
    rng = np.random.default_rng(2)
    overlapping = [(*rng.uniform(-0.5, 0.5, 2), 1.0, 0.0, *random_sizes(rng)) for _ in range(200)]
    assert all(np.isnan(_separate_clearance(*pair)) for pair in overlapping)


def test_polygons_say_the_same():
    for centre, heading, axes, distance in pairs_of_known_distance(150):
        one, other = outline(400, *axes[:2], heading, np.zeros(2)), outline(400, *axes[2:], 0.0, centre)
        found = ellipse_clearance(*centre, heading, *axes)
        # Sides lie inside their ellipse by up to a (pi / 400)^2 / 2.
        assert polygon_distance(one, other) == pytest.approx(found, abs=TOLERANCE_M)
        assert distance == pytest.approx(found, abs=1e-6)


def test_overlap_is_negative_and_says_how_deep():
    assert ellipse_clearance(1.0, 0.0, 0.3, 2.0, 2.0, 3.0, 3.0) == pytest.approx(-4.0)
    assert ellipse_clearance(0.0, 2.0, 0.0, 4.0, 1.0, 4.0, 1.5) == pytest.approx(-0.5)
    assert ellipse_clearance(0.0, 0.0, 0.0, 4.0, 1.0, 4.0, 1.5) == pytest.approx(-2.5)


def test_random_overlaps_are_those_of_the_outlines():
    rng, angles = np.random.default_rng(2), np.linspace(0, 2 * np.pi, 3000)
    seen = set()
    for _ in range(2000):
        a1, b1, a2, b2 = random_sizes(rng)
        heading, dx, dy = rng.uniform(-np.pi, np.pi), rng.uniform(-25, 25), rng.uniform(-8, 8)
        # Brute force over directions: the largest separation of the two support functions.
        own = np.hypot(a1 * np.cos(angles - heading), b1 * np.sin(angles - heading))
        gap = dx * np.cos(angles) + dy * np.sin(angles) - own - np.hypot(a2 * np.cos(angles), b2 * np.sin(angles))
        found = ellipse_clearance(dx, dy, heading, a1, b1, a2, b2)
        assert found == pytest.approx(gap.max(), abs=TOLERANCE_M)
        overlap = ellipses_overlap(dx, dy, np.cos(heading), np.sin(heading), a1, b1, a2, b2)
        assert overlap == (found < 0)
        seen.add(bool(overlap))
    assert seen == {True, False}


def test_a_way_comes_as_near_as_its_nearest_place():
    rng = np.random.default_rng(3)
    touched = set()
    for _ in range(500):
        a1, b1, a2, b2 = random_sizes(rng)
        heading = rng.uniform(-0.4, 0.4)
        start = np.array([rng.uniform(-20, 20), rng.uniform(-6, 6)])
        end = start + rng.uniform(-3, 3, 2)
        places = start + np.linspace(0, 1, 200)[:, None] * (end - start)
        nearest = min(ellipse_clearance(*place, heading, a1, b1, a2, b2) for place in places)
        found = swept_clearance(*start, *end, heading, a1, b1, a2, b2)
        if nearest > 0:
            assert found <= nearest + 1e-9, "optimistic"
            assert found == pytest.approx(nearest, abs=1e-2)
        else:
            assert found < 0
        touch = ellipses_touch(*start, *end, np.cos(heading), np.sin(heading), a1, b1, a2, b2)
        assert touch == (found < 0)
        touched.add(bool(touch))
    assert touched == {True, False}


def test_a_way_through_a_corner_touches_though_both_its_ends_are_clear():
    start, end = (-0.3, 2.95), (0.3, 2.95)
    for x, y in (start, end):
        assert ellipse_clearance(x, y, 0.0, 1.0, 1.0, 2.0, 1.955) > 0
    assert swept_clearance(*start, *end, 0.0, 1.0, 1.0, 2.0, 1.955) == pytest.approx(-0.005)
    assert ellipses_touch(*start, *end, 1.0, 0.0, 1.0, 1.0, 2.0, 1.955)


def test_the_corners_of_the_box_lie_on_the_ellipse():
    a, b = semi_axes(4.6, 1.9)
    assert (4.6 / 2 / a) ** 2 + (1.9 / 2 / b) ** 2 == pytest.approx(1.0)
    assert a / b == pytest.approx(4.6 / 1.9)
