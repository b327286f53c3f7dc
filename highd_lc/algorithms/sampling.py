"""Seeds and samples that depend on the events alone: not on their order, nor on batches or workers."""

import hashlib
from collections.abc import Hashable, Mapping

import numpy as np
from numpy.typing import NDArray

from highd_lc.vocab.lcm_parameters import LOWER_BOUNDS, REPLAY_L_BOUNDS, UPPER_BOUNDS

FloatArray = NDArray[np.float64]


def event_generator(run_seed: int, event_id: str, *, purpose: str) -> np.random.Generator:
    """The random generator of one event for one purpose, the same in every process."""
    return np.random.default_rng(_hash(f"{run_seed}/{event_id}/{purpose}"))


def _hash(text: str) -> int:
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")


def stratified_sample(strata: Mapping[str, Hashable], size: int, *, seed: int) -> frozenset[str]:
    """``size`` events (all, if there are fewer), every stratum with its share of them.

    strata: the stratum of each event id. Within a stratum the events with the smallest seeded hash are taken;
    the seats left by rounding go to the largest remainders, the same way.
    """
    if size >= len(strata):
        return frozenset(strata)
    members: dict[Hashable, list[str]] = {}
    for event in sorted(strata, key=lambda event: (_hash(f"{seed}/{event}/sample"), event)):
        members.setdefault(strata[event], []).append(event)
    quotas = {stratum: size * len(events) / len(strata) for stratum, events in members.items()}
    seats = {stratum: int(quota) for stratum, quota in quotas.items()}
    by_remainder = sorted(quotas, key=lambda stratum: (seats[stratum] - quotas[stratum], repr(stratum)))
    for stratum in by_remainder[: size - sum(seats.values())]:
        seats[stratum] += 1
    return frozenset(event for stratum, events in members.items() for event in events[: seats[stratum]])


def parameter_draws(
    parameters: FloatArray, spread: FloatArray, count: int, rng: np.random.Generator
) -> FloatArray:
    """LCM parameters drawn about those of each follower, shape (count, p, 6).

    Normal with the standard deviations ``spread``, each parameter by itself, cut to the bounds of the calibration
    (L to those of the replay). parameters, spread: shape (p, 6). A spread of 0 leaves a parameter as it is.
    """
    low, high = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
    low[-1], high[-1] = REPLAY_L_BOUNDS
    # Followers beyond the bounds (L of a long leader, a user's own set) keep what they have.
    low, high = np.minimum(low, parameters), np.maximum(high, parameters)
    drawn = parameters + spread * rng.standard_normal((count, *parameters.shape))
    return np.clip(drawn, low, high)
