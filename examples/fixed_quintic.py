"""A planner in ten lines: always the same quintic, 5 s long, at the speed of the start.

highd-lc validate --planner examples.fixed_quintic:fixed_quintic
"""

import numpy as np

from highd_lc import PlannedMotion
from highd_lc.core.quintic import Quintic, sample
from highd_lc.planning.scene import Scene

T = 5.0


def fixed_quintic(scene: Scene) -> PlannedMotion:
    """The quintic of 5 s that keeps the speed v0 at its end, whoever is in the way."""
    quintic = Quintic(v0=scene.v0, D=scene.lateral_shift, T=T, x_final=scene.v0 * T, v_end=scene.v0)
    s = sample(quintic, np.arange(round(T / scene.dt) + 1) * scene.dt)
    return PlannedMotion(s.x, s.y, s.vx, s.vy, s.ax, s.ay, s.jx, s.jy)
