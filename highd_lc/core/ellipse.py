"""Distance between the safety ellipses of two vehicles (paper, equations 8 and 9, corrected).

For disjoint convex sets the distance is the largest separation over all directions n,

    d = max over |n| = 1 of  n . c - h1(n) - h2(n),    h(n) = hypot(a n_along, b n_across),

c the vector between the centres. Every direction gives a lower bound, so an approximate maximum is never
optimistic. For overlapping ellipses the maximum is minus the penetration depth, so the value is signed.
"""

import math

from numba import njit

_DIRECTIONS = 24
_GOLDEN = 0.3819660112501051


@njit(inline="always")
def separation(
    angle: float, dx: float, dy: float, heading: float, a1: float, b1: float, a2: float, b2: float
) -> float:
    """Separation [m] along the direction ``angle`` [rad] of ellipse 1 (semi-axes a1, b1 [m], turned by
    ``heading`` [rad]) and ellipse 2 (a2, b2, not turned) whose centre lies at (dx, dy) [m] from that of 1.
    """
    n_x, n_y = math.cos(angle), math.sin(angle)
    along, across = math.cos(angle - heading), math.sin(angle - heading)
    return dx * n_x + dy * n_y - math.hypot(a1 * along, b1 * across) - math.hypot(a2 * n_x, b2 * n_y)


@njit(cache=True, nogil=True)
def ellipse_clearance(dx: float, dy: float, heading: float, a1: float, b1: float, a2: float, b2: float) -> float:
    """Signed distance [m] between two ellipses: negative = overlap (see the module).

    (dx, dy): centre of ellipse 2 from that of 1 [m]; heading of ellipse 1 [rad], ellipse 2 is not turned;
    a1, b1, a2, b2: semi-axes [m]. Directions around the circle first, then golden section about the best.
    """
    step = 2.0 * math.pi / _DIRECTIONS
    best, best_angle = -math.inf, 0.0
    for i in range(_DIRECTIONS + 1):
        # The direction between the centres is the maximum for circles: always among the candidates.
        angle = i * step if i < _DIRECTIONS else math.atan2(dy, dx)
        value = separation(angle, dx, dy, heading, a1, b1, a2, b2)
        if value > best:
            best, best_angle = value, angle
    left, right = best_angle - step, best_angle + step
    one, two = left + _GOLDEN * (right - left), right - _GOLDEN * (right - left)
    at_one = separation(one, dx, dy, heading, a1, b1, a2, b2)
    at_two = separation(two, dx, dy, heading, a1, b1, a2, b2)
    for _ in range(40):
        if at_one > at_two:
            right, two, at_two = two, one, at_one
            one = left + _GOLDEN * (right - left)
            at_one = separation(one, dx, dy, heading, a1, b1, a2, b2)
        else:
            left, one, at_one = one, two, at_two
            two = right - _GOLDEN * (right - left)
            at_two = separation(two, dx, dy, heading, a1, b1, a2, b2)
    return max(best, at_one, at_two)


def semi_axes(length: float, width: float) -> tuple[float, float]:
    """Semi-axes [m] of the ellipse of the box's proportions with the corners of the box on it."""
    return length / math.sqrt(2.0), width / math.sqrt(2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def ellipses_overlap(
    dx: float, dy: float, cos: float, sin: float, a1: float, b1: float, a2: float, b2: float
) -> bool:
    """Whether two ellipses overlap: ``ellipse_clearance`` < 0, decided cheaply where possible.

    Arguments as there, the heading by its cosine and sine. A point inside both proves that they do; separation
    along one direction proves that they do not: the direction tried is the normal of the ellipse with the summed
    semi-axes.
    """
    p_x, p_y = dx * a1 / (a1 + a2), dy * b1 / (b1 + b2)
    inside_1 = ((p_x * cos + p_y * sin) / a1) ** 2 + ((p_y * cos - p_x * sin) / b1) ** 2 < 1.0
    if inside_1 and ((dx - p_x) / a2) ** 2 + ((dy - p_y) / b2) ** 2 < 1.0:
        return True
    n_x, n_y = dx / ((a1 + a2) * (a1 + a2)), dy / ((b1 + b2) * (b1 + b2))
    norm = math.hypot(n_x, n_y)
    n_x, n_y = n_x / norm, n_y / norm
    along, across = n_x * cos + n_y * sin, n_y * cos - n_x * sin
    if dx * n_x + dy * n_y >= math.hypot(a1 * along, b1 * across) + math.hypot(a2 * n_x, b2 * n_y):
        return False
    return ellipse_clearance(dx, dy, math.atan2(sin, cos), a1, b1, a2, b2) < 0.0
