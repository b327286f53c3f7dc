"""A differentiable stand-in for the clearance between ellipses: what a gradient-based solver may lean on.

The separation of two ellipses at one instant is hypot(dx / (a + a2), dy / (b + b2)) - 1, with a and b the half
extents of the AV's turned ellipse along and across the road. It is free of unit, negative deep inside, and close
to the clearance where it vanishes; the exact test stays with ``contacts``.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.packing import PackedScene
from highd_lc.algorithms.replay import drive_on, follow, origin_follower_motion
from highd_lc.core.quintic import q_rate, q_shape, z_rate, z_shape

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def separations(
    n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, *, to_T: bool
) -> FloatArray:
    """Smallest separation of each plan to each obstacle over 0..T (to_T) or 0..H; shape (m, obstacles).

    n, delta, change: plans as in ``candidates.evaluate``, each of shape (m,). Obstacles in the order of
    ``packing.obstacle_roles``.
    """
    obstacles = len(scene.leader_a) + len(scene.follower_x) + (1 if len(scene.origin_follower) else 0)
    out = np.full((len(n), obstacles), np.inf)
    _separations(n, delta, change, scene, to_T, out)
    return out


@njit(inline="always")
def _separation(dx: float, dy: float, a: float, b: float) -> float:
    return float(np.hypot(dx / a, dy / b) - 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _separations(
    n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, to_T: bool, out: FloatArray
) -> None:
    samples, p, leaders = len(scene.target_v), len(scene.follower_x), len(scene.leader_a)
    x, y, vx, vy = np.empty(samples), np.empty(samples), np.empty(samples), np.zeros(samples)
    ax, jerk = np.empty(samples), np.empty(samples)
    fx, fv, fa = np.empty((p, samples)), np.empty((p, samples)), np.empty((p, samples))
    for w in range(len(n)):
        T = n[w] * scene.dt
        for k in range(n[w] + 1):
            u = k / n[w]
            x[k] = scene.v0 * k * scene.dt + delta[w] * z_shape(u) + T * change[w] * q_shape(u)
            vx[k] = scene.v0 + delta[w] / T * z_rate(u) + change[w] * q_rate(u)
            y[k], vy[k] = scene.D * z_shape(u), scene.D / T * z_rate(u)
        vy[n[w] :] = 0.0
        drive_on(x, y, vx, ax, jerk, n[w], scene)
        crossing = n[w] // 2
        follow(x + scene.length / 2.0, vx, crossing if scene.from_crossing else 0, scene, fx, fv, fa)
        behind = x
        if len(scene.origin_follower):
            behind = origin_follower_motion(x + scene.length / 2.0, vx, crossing, scene)
        for k in range(n[w] + 1 if to_T else samples):
            speed = np.hypot(vx[k], vy[k])
            cos, sin = (vx[k] / speed, vy[k] / speed) if vy[k] != 0.0 else (1.0, 0.0)
            a, b = np.hypot(scene.a * cos, scene.b * sin), np.hypot(scene.a * sin, scene.b * cos)
            cx, cy = x[k] + scene.rear_to_centre * (cos - 1.0), y[k] + scene.rear_to_centre * sin
            for i in range(leaders):
                apart = _separation(
                    scene.leader_x[i, k] - cx,
                    scene.leader_y[i, k] - cy,
                    a + scene.leader_a[i],
                    b + scene.leader_b[i],
                )
                out[w, i] = min(out[w, i], apart)
            for i in range(p):
                apart = _separation(
                    fx[i, k] - cx, scene.follower_y[i] - cy, a + scene.follower_a[i], b + scene.follower_b[i]
                )
                out[w, leaders + i] = min(out[w, leaders + i], apart)
            if len(scene.origin_follower) and k <= crossing:
                a2, b2 = scene.origin_follower[4], scene.origin_follower[5]
                apart = _separation(behind[k] - cx, scene.origin_follower[1] - cy, a + a2, b + b2)
                out[w, leaders + p] = min(out[w, leaders + p], apart)
