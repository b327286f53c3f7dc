"""Who the followers may be: sets of drivers under which one plan is judged at once (equations.md 7.4).

A crowd holds K draws of all followers. They are common to all candidates of a search, so that two candidates
differ by what they do and not by whom they meet.
"""

import hashlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.planning.scene import PackedScene
from highd_lc.vocab.driver import LOWER_BOUNDS, REPLAY_L_BOUNDS, UPPER_BOUNDS
from highd_lc.vocab.sections import RobustSettings

FloatArray = NDArray[np.float64]


class Crowd(NamedTuple):
    """K sets of drivers, and what becomes of a candidate's K losses.

    parameters (K, p, 6), reactions (K, p, 7), first_L (K,), joined (K, 3): as in ``PackedScene``. worst: the mean
    of so many of the largest losses counts; K = the mean of all. rejects_all: whether a contact under any draw
    rejects a candidate; else those of the first draw alone do, which are the drivers that the scene has.
    """

    parameters: FloatArray
    reactions: FloatArray
    first_L: FloatArray
    joined: FloatArray
    worst: int
    rejects_all: bool


def own_crowd(scene: PackedScene) -> Crowd:
    """The crowd of one: the drivers that the scene has."""
    joined = np.array([scene.joined], dtype=np.float64)
    return Crowd(scene.parameters[None], scene.reactions[None], np.array([scene.first_L]), joined, 1, False)


@njit(inline="always")
def together(losses: FloatArray, worst: int) -> float:
    """Mean of the ``worst`` largest of the draws' losses (K,), or of all of them."""
    if worst < len(losses):
        losses = np.sort(losses)[len(losses) - worst :]
    total = 0.0
    for loss in losses:
        total += loss
    return total / len(losses)


def event_generator(run_seed: int, event_id: str, *, purpose: str) -> np.random.Generator:
    """The random generator of one event for one purpose, the same in every process."""
    return np.random.default_rng(seeded_hash(f"{run_seed}/{event_id}/{purpose}"))


def seeded_hash(text: str) -> int:
    """A number that depends on a text alone."""
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")


def parameter_draws(
    parameters: FloatArray, spread: FloatArray, count: int, rng: np.random.Generator
) -> FloatArray:
    """LCM parameters drawn about those of each follower, shape (count, p, 6).

    Normal with the standard deviations ``spread``, each parameter by itself, cut to the bounds of the calibration
    (L to those of the replay). parameters, spread: shape (p, 6). A spread of 0 leaves a parameter as it is.
    """
    low, high = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
    low[-1], high[-1] = REPLAY_L_BOUNDS
    # Followers beyond the bounds (L of a long leader, the population) are drawn about what they have.
    low = np.where(parameters < low, np.maximum(parameters - 2.0 * spread, 0.1 * parameters), low)
    high = np.where(parameters > high, parameters + 2.0 * spread, high)
    drawn = parameters + spread * rng.standard_normal((count, *parameters.shape))
    return np.clip(drawn, low, high)


def drawn_crowd(packed: PackedScene, spread: FloatArray | None, count: int, rng: np.random.Generator) -> Crowd:
    """The scene's own drivers, then others of their model drawn within their spread; ``count`` sets in all.

    spread: standard deviations of the parameters, shape (p, 6); None = of none.
    """
    known = np.zeros_like(packed.parameters) if spread is None else spread
    drawn = np.concatenate([packed.parameters[None], parameter_draws(packed.parameters, known, count - 1, rng)])
    return Crowd(
        drawn,
        np.repeat(packed.reactions[None], count, axis=0),
        packed.first_L + drawn[:, 0, 5] - packed.parameters[0, 5],
        np.repeat(np.array([packed.joined], dtype=np.float64), count, axis=0),
        count,
        False,
    )


def crowd_of(
    packed: PackedScene,
    spread: FloatArray | None,
    others: Sequence[PackedScene],
    *,
    robust: RobustSettings,
    rng: np.random.Generator,
) -> Crowd:
    """Who the followers may be: the scene's own drivers, those of other models, the rest drawn (equations.md 7.4).

    others: the scene with other follower models, the best first; they take half of the places at most. spread: see
    ``drawn_crowd``.
    """
    taken = [own_crowd(other) for other in others[: robust.draws // 2]]
    crowds = [drawn_crowd(packed, spread, robust.draws - len(taken), rng), *taken]
    worst = max(1, int(np.ceil(robust.share * robust.draws - 1e-9)))
    return Crowd(
        np.concatenate([crowd.parameters for crowd in crowds]),
        np.concatenate([crowd.reactions for crowd in crowds]),
        np.concatenate([crowd.first_L for crowd in crowds]),
        np.concatenate([crowd.joined for crowd in crowds]),
        worst,
        robust.contacts == "any",
    )
