"""Random lane changes for the planner's tests and benchmark: scenes as the planner reads them, from a seed."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning.candidates import loss_terms
from highd_lc.planning.limits import limits_of
from highd_lc.planning.pool import Goal, Task
from highd_lc.planning.scene import Followers, Human, Motion, Scene, pack
from highd_lc.vocab import names
from highd_lc.vocab.driver import LOWER_BOUNDS, TABLE3_MEANS, UPPER_BOUNDS
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]

DT = 0.1
CAR, WIDTH = 4.6, 1.9
GOALS = [Goal(accounting, omega) for accounting in names.ACCOUNTINGS for omega in (1.0, 0.5)]


def motion(rng: np.random.Generator, x: float, y: float, *, v: float, samples: int) -> Motion:
    """A vehicle that starts at (x, y) with about speed v and whose speed swings slowly."""
    t = np.arange(samples) * DT
    amplitude, frequency = rng.uniform(0, 1.5), rng.uniform(0.2, 0.6)
    speed = np.maximum(v + amplitude * np.sin(frequency * t), 0.0)
    way = x + np.concatenate([[0.0], np.cumsum(speed[1:])]) * DT
    return Motion(way, y + 0.05 * np.sin(0.3 * t), speed, np.gradient(speed, DT), CAR, WIDTH, samples // 2)


def random_scene(
    rng: np.random.Generator, p: int = 3, *, horizon: float = 15.0, v0: float | None = None, crowding: float = 1.0
) -> Scene:
    """A lane change to either side among p followers and leaders that may be missing; some egos are trucks.

    crowding: divides the distances between vehicles, so that slots get tight.
    """
    samples = round(horizon / DT) + 1
    v0 = rng.uniform(12, 36) if v0 is None else v0
    D = rng.choice([-1.0, 1.0]) * rng.uniform(2.8, 4.0)
    length = float(rng.choice([4.5, 4.8, 14.0], p=[0.5, 0.4, 0.1]))

    def car(share: float, x: float, y: float, v: float) -> Motion | None:
        made = motion(rng, np.sign(x) * 6 + x / crowding, y + 0.2 * rng.normal(), v=v, samples=samples)
        return made if rng.random() < share else None

    return Scene(
        event_id="01-0001-00001",
        v0=v0,
        a0=0.1,
        lateral_shift=D,
        length=length,
        width=WIDTH,
        wheelbase=0.6 * length,
        dt=DT,
        horizon=horizon,
        target_leader=car(0.85, rng.uniform(6, 74), D, v0 + 2.5 * rng.normal()),
        origin_leader=car(0.8, rng.uniform(4, 54), 0.0, v0 - rng.uniform(0, 4)),
        origin_follower=car(0.7, -rng.uniform(4, 54), 0.0, v0 + 1.5 * rng.normal()),
        followers=_followers(rng, p, v0, D=D, samples=samples, crowding=crowding),
        human=_human(v0),
    )


def _followers(
    rng: np.random.Generator, p: int, v0: float, *, D: float, samples: int, crowding: float
) -> Followers:
    x, v = -np.cumsum(6 + rng.uniform(3, 44, p) / crowding), v0 + 2 * rng.normal(size=p) + rng.uniform(-1, 4)
    scattered = TABLE3_MEANS.as_array() * (1 + 0.15 * rng.normal(size=(p, 6)))
    parameters = np.clip(scattered, LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array())
    recorded = tuple(motion(rng, x[i], D, v=v[i], samples=samples) for i in range(p))
    y = D + 0.2 * rng.normal(size=p)
    return Followers(
        x, y, v, np.full(p, CAR), np.full(p, WIDTH), parameters, float(parameters[0, 5]) + 1.0, recorded
    )


REACTIONS = {
    "memory": (2.0, 9.0),
    "relaxation": (5.0, 20.0),
    "need": (0.5, 2.0),
    "a_0": (-0.6, 0.6),
    "drift": (-0.3, 0.3),
}
"""Ranges of how followers may react: seconds, and accelerations in m/s^2."""


def reacting(
    scene: Scene,
    rng: np.random.Generator,
    *,
    family: str = names.LCM,
    moment: float | None = None,
    parts: tuple[str, ...] = tuple(REACTIONS),
) -> Scene:
    """The same scene with followers that react each in its own way. parts: which of ``REACTIONS`` they have."""
    p = len(scene.followers.x)
    drawn = {part: rng.uniform(*REACTIONS[part], p) for part in parts}
    share = None if moment is None else np.full(p, moment)
    return replace(scene, followers=replace(scene.followers, family=family, moment=share, **drawn))


def pushed(scene: Scene, gap: float, *, blind: bool = False) -> Scene:
    """The scene with its second follower ``gap`` [m] behind the first, where it would rather be nearer.

    blind: it is 4 m/s faster and drives through the first, whatever the ego does.
    """
    followers = scene.followers
    x, v, parameters = followers.x.copy(), followers.v.copy(), followers.parameters.copy()
    x[1], v[1] = x[0] - followers.length[0] - gap, v[0] + (4.0 if blind else 0.0)
    x[2:] -= 40.0
    near = followers.length[0] + gap / 3.0
    parameters[1] = [50.0, 2.0, 10.0, 2.0, 0.1, 2.0] if blind else [60.0, 3.0, 4.0, 4.0, 0.02, near]
    return replace(scene, followers=replace(followers, x=x, v=v, parameters=parameters))


def _human(v0: float) -> Human:
    zero = np.zeros(56)
    return Human(zero, zero, zero + v0, zero, zero, zero, zero, zero, 27, 0.0)


def mirrored(scene: Scene) -> Scene:
    """The same scene seen in a mirror: left and right swapped."""

    def flip(m: Motion | None) -> Motion | None:
        return None if m is None else replace(m, y=-m.y)

    followers = replace(
        scene.followers, y=-scene.followers.y, recorded=tuple(replace(m, y=-m.y) for m in scene.followers.recorded)
    )
    human = replace(scene.human, y=-scene.human.y, vy=-scene.human.vy, ay=-scene.human.ay, jy=-scene.human.jy)
    return replace(
        scene,
        lateral_shift=-scene.lateral_shift,
        target_leader=flip(scene.target_leader),
        origin_leader=flip(scene.origin_leader),
        origin_follower=flip(scene.origin_follower),
        followers=followers,
        human=human,
    )


def task_of(scene: Scene, settings: ValidateSettings | None = None) -> Task:
    """The search that a scene poses."""
    settings = settings or ValidateSettings()
    packed = pack(scene, settings)
    terms = loss_terms(scene, packed.weights, settings.loss)
    return Task(packed, terms, limits_of(scene.v0, settings, scene.wheelbase), settings.search)
