"""All fitted drivers together: samples of them, fits drawn to their class, and who drives for the unfitted."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.calibration import FollowerFit, fit_follower, pose
from highd_lc.algorithms.prior import common_driver, pool_of
from highd_lc.core.car_following import FollowingTrack
from highd_lc.core.drive import UNBOUNDED
from highd_lc.vocab.settings import CalibrateSettings

FloatArray = NDArray[np.float64]

EVERYBODY: Final = ""
"""Key of the pool of all classes."""
# Most fits of a pool that stand for election as its driver, and most tracks that elect.
_ELECTORS = 300
# Fewest fits of a class towards whose median its members are drawn; smaller ones are drawn to everybody's.
_LEAST_CLASS = 3


@dataclass(frozen=True)
class FittedDrivers:
    """Fits of n followers, all in one order: tracks, parameters (n, 6), vehicle classes, seeds of the fits."""

    tracks: tuple[FollowingTrack, ...]
    parameters: FloatArray
    classes: tuple[str, ...]
    seeds: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.tracks)

    def take(self, places: NDArray[np.int64]) -> "FittedDrivers":
        """Those at the places, in their order."""
        return FittedDrivers(
            tuple(self.tracks[i] for i in places),
            self.parameters[places],
            tuple(self.classes[i] for i in places),
            tuple(self.seeds[i] for i in places),
        )

    def sample(self, most: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Places of at most so many of them, ascending."""
        return np.sort(rng.permutation(len(self))[:most])


def pool_drivers(
    drivers: FittedDrivers,
    settings: CalibrateSettings,
    *,
    rng: np.random.Generator,
    hardest: float = UNBOUNDED,
) -> dict[str, int]:
    """Place of the common driver of each class that has fits, and of ``EVERYBODY`` if anybody was fitted."""
    pools = {name: np.flatnonzero(np.array(drivers.classes) == name) for name in sorted(set(drivers.classes))}
    pools[EVERYBODY] = np.arange(len(drivers))
    return {name: _elect(drivers, places, settings, rng, hardest) for name, places in pools.items() if len(places)}


def _elect(
    drivers: FittedDrivers,
    places: NDArray[np.int64],
    settings: CalibrateSettings,
    rng: np.random.Generator,
    hardest: float,
) -> int:
    members = drivers.take(places)
    electors = members.sample(_ELECTORS, rng)
    problems = [pose(members.tracks[i], settings, hardest=hardest) for i in electors]
    return int(places[electors[common_driver(problems, members.parameters[electors])]])


def refit(
    drivers: FittedDrivers, settings: CalibrateSettings, *, strength: float, hardest: float = UNBOUNDED
) -> list[FollowerFit]:
    """Everybody's fit again, drawn with a strength towards the median of his class."""
    classes = np.array(drivers.classes)
    priors = {EVERYBODY: pool_of(drivers.parameters, strength)}
    for name in set(drivers.classes):
        members = drivers.parameters[classes == name]
        if len(members) >= _LEAST_CLASS:
            priors[name] = pool_of(members, strength)
    return [
        fit_follower(track, settings, seed=seed, prior=priors.get(name, priors[EVERYBODY]), hardest=hardest)
        for track, name, seed in zip(drivers.tracks, drivers.classes, drivers.seeds, strict=True)
    ]


def with_parameters(drivers: FittedDrivers, fits: list[FollowerFit]) -> FittedDrivers:
    """The drivers with the parameters of other fits."""
    return replace(drivers, parameters=np.array([fit.parameters for fit in fits]).reshape(-1, 6))
