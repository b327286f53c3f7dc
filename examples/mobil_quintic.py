"""A quintic whose start MOBIL chooses: the first moment at which the change pays and is safe for the new follower.

MOBIL (Kesting, Treiber and Helbing 2007) compares IDM accelerations with and without the lane change. Everybody is
predicted at constant speed; the ego waits at constant speed. Parameters: IDM as there for motorways, politeness
0.3, threshold 0.1 m/s^2, safe braking 4 m/s^2.

    highd-lc validate --planner examples.mobil_quintic:mobil_quintic
"""

import numpy as np

from highd_lc import PlannedMotion
from highd_lc.core.quintic import Quintic, sample
from highd_lc.planning.scene import Motion, Scene

V0, T0, S0, A, B = 33.3, 1.5, 2.0, 1.4, 2.0
POLITENESS, THRESHOLD, SAFE = 0.3, 0.1, 4.0
LONGEST_WAIT, T = 5.0, 5.0
FREE = (np.inf, 0.0, 0.0)
"""Place, speed and length of nobody."""

Car = tuple[float, float, float]
"""Centre x [m], speed [m/s], length [m]."""


def idm(car: Car, leader: Car) -> float:
    """Acceleration of a car behind another by the IDM [m/s^2]."""
    gap = leader[0] - car[0] - (leader[2] + car[2]) / 2.0
    if gap <= 0.0:
        return -np.inf
    wanted = S0 + car[1] * T0 + car[1] * (car[1] - leader[1]) / (2.0 * np.sqrt(A * B))
    closing = 0.0 if np.isinf(gap) else max(wanted, 0.0) / gap
    return A * (1.0 - (car[1] / V0) ** 4 - closing**2)


def mobil_quintic(scene: Scene) -> PlannedMotion | str:
    """Wait until MOBIL agrees, then change lane in 5 s at constant speed."""
    for k in range(round(LONGEST_WAIT / scene.dt) + 1):
        if agrees(scene, k * scene.dt):
            return delayed(scene, k)
    return f"MOBIL does not agree to change lane within {LONGEST_WAIT:g} s"


def agrees(scene: Scene, t: float) -> bool:
    """Whether MOBIL changes lane at that moment."""
    ego = (scene.v0 * t, scene.v0, scene.length)
    ahead, new_ahead = at(scene.origin_leader, t), at(scene.target_leader, t)
    behind = at(scene.origin_follower, t) if scene.origin_follower else None
    f = scene.followers
    follower = (float(f.x[0] + f.v[0] * t), float(f.v[0]), float(f.length[0]))
    after = idm(follower, ego)
    if after < -SAFE or idm(ego, new_ahead) < -SAFE:
        return False
    others = after - idm(follower, new_ahead)
    if behind is not None:
        others += idm(behind, ahead) - idm(behind, ego)
    return idm(ego, new_ahead) - idm(ego, ahead) + POLITENESS * others > THRESHOLD


def at(motion: Motion | None, t: float) -> Car:
    """Where a vehicle is predicted to be: at the speed that it has at t = 0."""
    if motion is None:
        return FREE
    return float(motion.x[0] + motion.v[0] * t), float(motion.v[0]), motion.length


def delayed(scene: Scene, k: int) -> PlannedMotion:
    """Constant speed for k samples, then the quintic."""
    quintic = Quintic(v0=scene.v0, D=scene.lateral_shift, T=T, x_final=scene.v0 * T, v_end=scene.v0)
    s = sample(quintic, np.arange(round(T / scene.dt) + 1) * scene.dt)
    wait = np.arange(k) * scene.dt * scene.v0
    x = np.concatenate([wait, k * scene.dt * scene.v0 + s.x])
    rest = {name: np.concatenate([np.zeros(k), getattr(s, name)]) for name in ("y", "vy", "ax", "ay", "jx", "jy")}
    return PlannedMotion(x=x, vx=np.concatenate([np.full(k, scene.v0), s.vx]), **rest)
