"""The AV of a tile of candidate plans: the plan, then the drive after T, with what both cost it."""

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import advance, gentle, lcm_command
from highd_lc.core.kernels import UNALIASED, fused, kernel
from highd_lc.core.losses import LossTerms, charged
from highd_lc.core.quintic import (
    lateral,
    lateral_jerk,
    q_rate,
    q_shape,
    q_third,
    r_rate,
    r_shape,
    r_third,
    z_rate,
    z_shape,
    z_third,
)
from highd_lc.planning.contacts import CHANGE, COMMAND, DELTA, FRONT, SPEED, TO_H, TO_T, WIDTH
from highd_lc.planning.scene import PackedScene

FloatArray = NDArray[np.float64]


@kernel(error_model="numpy", **UNALIASED)
def drive_av(
    n: int,
    state: FloatArray,
    scene: PackedScene,
    terms: LossTerms,
    front: FloatArray,
    speed: FloatArray,
) -> None:
    """Plan to n, then the drive after T; fills fronts and speeds, and the losses in the scratch."""
    dt, v0, half, hardest = scene.dt, scene.v0, scene.length / 2.0, scene.hardest
    most, step = scene.safety.acceleration, scene.safety.jerk * scene.dt
    T, ax = n * dt, scene.start.ax
    v_desire, A, b, B, tau, L = scene.av_parameters
    comfort, efficiency, ref = terms.comfort, terms.efficiency, terms.av_ref
    both_sides = 0.0 if terms.one_sided else 1.0
    for w in range(WIDTH):
        state[TO_T * WIDTH + w] = 0.0
    for k in range(n + 1):
        u = k / n
        base, z, q = half + v0 * k * dt, z_shape(u), T * q_shape(u)
        v_base, dz, dq = v0, z_rate(u) / T, q_rate(u)
        j_base, j_z, j_q = 0.0, z_third(u) / (T * T * T), q_third(u) / (T * T)
        if ax != 0.0:
            base, v_base, j_base = base + T * T * ax * r_shape(u), v0 + T * ax * r_rate(u), ax / T * r_third(u)
        _, vy = lateral(u, T, scene.D, scene.start)
        jy = abs(lateral_jerk(u, T, scene.D, scene.start))
        for w in range(WIDTH):
            delta, change = state[DELTA * WIDTH + w], state[CHANGE * WIDTH + w]
            v = fused(change, dq, fused(delta, dz, v_base))
            front[k * WIDTH + w] = fused(change, q, fused(delta, z, base))
            speed[k * WIDTH + w] = v
            jerk = abs(fused(change, j_q, fused(delta, j_z, j_base))) + jy
            along = np.sqrt(fused(v, v, vy * vy))
            state[TO_T * WIDTH + w] = charged(
                state[TO_T * WIDTH + w], jerk, along, ref, comfort, efficiency, both_sides
            )
    after = 1.0 if scene.after_lcm else 0.0
    # A plan that ends at H has no drive after T, hence no step onto it.
    handover = comfort / dt if scene.counts_handover and n + 1 < len(scene.target_v) else 0.0
    for w in range(WIDTH):
        x, v = front[n * WIDTH + w], speed[n * WIDTH + w]
        a = after * lcm_command(
            v, scene.target_front[n] - x, scene.target_v[n], v_desire, A, b, B, tau, L, hardest
        )
        a = gentle(a, 0.0, most, step)
        state[FRONT * WIDTH + w], state[SPEED * WIDTH + w], state[COMMAND * WIDTH + w] = x, v, a
        state[TO_H * WIDTH + w] = state[TO_T * WIDTH + w] + handover * abs(a)
    for k in range(n + 1, len(scene.target_v)):
        target, target_v = scene.target_front[k], scene.target_v[k]
        for w in range(WIDTH):
            before = state[COMMAND * WIDTH + w]
            x, v = advance(state[FRONT * WIDTH + w], state[SPEED * WIDTH + w], before, dt)
            a = after * lcm_command(v, target - x, target_v, v_desire, A, b, B, tau, L, hardest)
            a = gentle(a, before, most, step)
            state[TO_H * WIDTH + w] = charged(
                state[TO_H * WIDTH + w], abs(a - before), v, ref, comfort / dt, efficiency, both_sides
            )
            state[FRONT * WIDTH + w], state[SPEED * WIDTH + w], state[COMMAND * WIDTH + w] = x, v, a
            front[k * WIDTH + w], speed[k * WIDTH + w] = x, v
