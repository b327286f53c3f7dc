"""Distance between the safety ellipses of two vehicles (paper, equations 8 and 9, corrected).

For disjoint convex sets the distance is the largest separation over all directions n,

    d = max over |n| = 1 of  n . c - h1(n) - h2(n),    h(n) = hypot(a n_along, b n_across),

c the vector between the centres. Every direction gives a lower bound, so an approximate maximum is never
optimistic. For overlapping ellipses the maximum is minus the penetration depth, so the value is signed.
"""

import math
from typing import NamedTuple

from numba import njit

from highd_lc.core.kernels import kernel

_DIRECTIONS = 24
_STEP = 2.0 * math.pi / _DIRECTIONS
_GOLDEN = 0.3819660112501051
_NEWTON_STEPS = 8
# The separation is flat at its maximum: a turn of 1e-8 from there loses 1e-16 of the vehicles' size.
_SETTLED = 1e-8


class _Pair(NamedTuple):
    """Two ellipses: way of the second one's centre, heading of the first, semi-axes (see ``swept_clearance``)."""

    x0: float
    y0: float
    x1: float
    y1: float
    cos: float
    sin: float
    a1: float
    b1: float
    a2: float
    b2: float


@njit(inline="always")
def _separation(angle: float, pair: _Pair) -> float:
    n_x, n_y = math.cos(angle), math.sin(angle)
    along, across = n_x * pair.cos + n_y * pair.sin, n_y * pair.cos - n_x * pair.sin
    nearest = min(pair.x0 * n_x + pair.y0 * n_y, pair.x1 * n_x + pair.y1 * n_y)
    return nearest - math.hypot(pair.a1 * along, pair.b1 * across) - math.hypot(pair.a2 * n_x, pair.b2 * n_y)


@kernel()
def _best_about(angle: float, pair: _Pair) -> float:
    """Largest separation within a step about a direction, by golden section."""
    left, right = angle - _STEP, angle + _STEP
    one, two = left + _GOLDEN * (right - left), right - _GOLDEN * (right - left)
    at_one, at_two = _separation(one, pair), _separation(two, pair)
    for _ in range(40):
        if at_one > at_two:
            right, two, at_two = two, one, at_one
            one = left + _GOLDEN * (right - left)
            at_one = _separation(one, pair)
        else:
            left, one, at_one = one, two, at_two
            two = right - _GOLDEN * (right - left)
            at_two = _separation(two, pair)
    return max(at_one, at_two)


@kernel()
def swept_clearance(
    x0: float, y0: float, x1: float, y1: float, heading: float, a1: float, b1: float, a2: float, b2: float
) -> float:
    """Smallest distance [m] between two ellipses while one moves straight: negative = overlap.

    The centre of ellipse 2 moves from (x0, y0) to (x1, y1) from that of 1 [m]; heading of ellipse 1 [rad], ellipse
    2 is not turned; a1, b1, a2, b2: semi-axes [m]. Directions around the circle first, then golden section: about
    the best one if it separates, else about every one that is better than its neighbours.
    """
    pair = _Pair(x0, y0, x1, y1, math.cos(heading), math.sin(heading), a1, b1, a2, b2)
    # The direction between the centres is the best for circles: always among those tried.
    towards = math.atan2(y1, x1)
    best, best_angle = _separation(towards, pair), towards
    for i in range(_DIRECTIONS):
        value = _separation(i * _STEP, pair)
        if value > best:
            best, best_angle = value, i * _STEP
    best = max(best, _best_about(best_angle, pair))
    if best > 0.0:
        return best
    before = _separation(-_STEP, pair)
    here = _separation(0.0, pair)
    for i in range(_DIRECTIONS):
        after = _separation((i + 1) * _STEP, pair)
        if here >= before and here >= after:
            best = max(best, _best_about(i * _STEP, pair))
        before, here = here, after
    return best


@kernel(error_model="numpy")
def _separate_clearance(
    dx: float, dy: float, cos: float, sin: float, a1: float, b1: float, a2: float, b2: float
) -> float:
    """``ellipse_clearance`` by Newton's method from the normal of the ellipse with the summed semi-axes.

    NaN unless it converges on a separation above 0. That one is the largest: as a function of n the separation is
    concave, so on the circle it has a single maximum where it is positive.
    """
    n_x, n_y = dx / (a1 + a2) ** 2, dy / (b1 + b2) ** 2
    spread_1, spread_2 = b1 * b1 - a1 * a1, b2 * b2 - a2 * a2
    for _ in range(_NEWTON_STEPS):
        norm = math.sqrt(n_x * n_x + n_y * n_y)
        if not norm > 0.0:
            break
        n_x, n_y = n_x / norm, n_y / norm
        along, across = n_x * cos + n_y * sin, n_y * cos - n_x * sin
        h1 = math.sqrt((a1 * along) ** 2 + (b1 * across) ** 2)
        h2 = math.sqrt((a2 * n_x) ** 2 + (b2 * n_y) ** 2)
        # By the angle of the direction: h' = (b^2 - a^2) sin cos / h, h'' = ((b^2 - a^2) cos 2 - h'^2) / h.
        rate_1, rate_2 = spread_1 * along * across / h1, spread_2 * n_x * n_y / h2
        bend_1 = (spread_1 * (along * along - across * across) - rate_1 * rate_1) / h1
        bend_2 = (spread_2 * (n_x * n_x - n_y * n_y) - rate_2 * rate_2) / h2
        slope, bend = dy * n_x - dx * n_y - rate_1 - rate_2, -(dx * n_x + dy * n_y) - bend_1 - bend_2
        if not bend < 0.0:
            break
        turn = -slope / bend
        separation = dx * n_x + dy * n_y - h1 - h2
        if abs(turn) < _SETTLED and separation > 0.0:
            return separation
        n_x, n_y = n_x - turn * n_y, n_y + turn * n_x
    return math.nan


@kernel()
def ellipse_clearance(dx: float, dy: float, heading: float, a1: float, b1: float, a2: float, b2: float) -> float:
    """Signed distance [m] between two ellipses at rest: ``swept_clearance`` with (dx, dy) at both ends.

    Where they overlap it is minus the depth: how far one has to be moved until they touch.
    """
    apart = _separate_clearance(dx, dy, math.cos(heading), math.sin(heading), a1, b1, a2, b2)
    return swept_clearance(dx, dy, dx, dy, heading, a1, b1, a2, b2) if math.isnan(apart) else apart


def semi_axes(length: float, width: float) -> tuple[float, float]:
    """Semi-axes [m] of the ellipse of the box's proportions with the corners of the box on it."""
    return length / math.sqrt(2.0), width / math.sqrt(2.0)


@kernel(error_model="numpy")
def ellipses_overlap(
    dx: float, dy: float, cos: float, sin: float, a1: float, b1: float, a2: float, b2: float, margin: float = 0.0
) -> bool:
    """Whether two ellipses at rest overlap: ``ellipses_touch`` with (dx, dy) at both ends."""
    return ellipses_touch(dx, dy, dx, dy, cos, sin, a1, b1, a2, b2, margin)


@kernel(error_model="numpy")
def ellipses_touch(
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    cos: float,
    sin: float,
    a1: float,
    b1: float,
    a2: float,
    b2: float,
    margin: float = 0.0,
) -> bool:
    """Whether ``swept_clearance`` < margin [m], at least 0, decided cheaply where possible: arguments as there,
    cos and sin of heading.

    A point inside both ellipses at the end proves that they touch; separation along one direction proves that
    they do not: the direction tried is the normal of the ellipse with the summed semi-axes at the path's nearest
    point.
    """
    p_x, p_y = x1 * a1 / (a1 + a2), y1 * b1 / (b1 + b2)
    inside_1 = ((p_x * cos + p_y * sin) / a1) ** 2 + ((p_y * cos - p_x * sin) / b1) ** 2 < 1.0
    if inside_1 and ((x1 - p_x) / a2) ** 2 + ((y1 - p_y) / b2) ** 2 < 1.0:
        return True
    a, b = 1.0 / (a1 + a2) ** 2, 1.0 / (b1 + b2) ** 2
    way_x, way_y = x1 - x0, y1 - y0
    way = a * way_x * way_x + b * way_y * way_y
    done = min(1.0, max(0.0, -(a * x0 * way_x + b * y0 * way_y) / way)) if way > 0.0 else 0.0
    n_x, n_y = a * (x0 + done * way_x), b * (y0 + done * way_y)
    norm = math.hypot(n_x, n_y)
    if norm > 0.0:
        n_x, n_y = n_x / norm, n_y / norm
        along, across = n_x * cos + n_y * sin, n_y * cos - n_x * sin
        nearest = min(x0 * n_x + y0 * n_y, x1 * n_x + y1 * n_y)
        if nearest >= math.hypot(a1 * along, b1 * across) + math.hypot(a2 * n_x, b2 * n_y) + margin:
            return False
    return swept_clearance(x0, y0, x1, y1, math.atan2(sin, cos), a1, b1, a2, b2) < margin
