"""The front of what AV and followers can have at once, beside the omega sweep: knee, hypervolume, comparison.

The sweep's optima minimise omega Loss_AV + (1 - omega) Loss_HV, so they lie on the convex hull of the true front.
Where a front that was found otherwise disagrees, one of the methods has failed, and ``compare`` says by how much.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The hypervolume's reference point over the worst losses of either method.
_BEYOND = 1.1


@dataclass(frozen=True)
class Points:
    """Plans and their losses, each of shape (m,): n samples of T, delta [m], change [m/s] as in ``Pool``; gap:
    number of the gap, delay: samples before the start, both 0 where the start is not chosen.
    """

    gap: IntArray
    delay: IntArray
    n: IntArray
    delta: FloatArray
    change: FloatArray
    loss_av: FloatArray
    loss_hv: FloatArray

    def __len__(self) -> int:
        return len(self.n)

    def chosen(self, index: IntArray) -> "Points":
        """Some of the points."""
        return Points(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Comparison:
    """Front against sweep. behind, ahead: most by which the front's best joint objective exceeds the sweep's, or
    falls below it, relative. hypervolumes: shares of the box between the ideal of all points and ``reference``.
    """

    behind: float
    ahead: float
    hypervolume: float
    hypervolume_sweep: float
    reference: tuple[float, float]


def non_dominated(points: Points) -> Points:
    """The points that no other beats in both losses, by rising loss of the AV, equals once."""
    order = np.lexsort((points.loss_hv, points.loss_av))
    hv = points.loss_hv[order]
    before = np.concatenate([[np.inf], np.minimum.accumulate(hv)[:-1]]) if len(hv) else hv
    return points.chosen(order[hv < before])


def knee(front: Points) -> int | None:
    """The point farthest below the line between the front's ends, both losses scaled to 0..1; None without a bend.

    front: by rising loss of the AV.
    """
    if len(front) < 3:
        return None
    av, hv = ((loss - loss.min()) / (loss.max() - loss.min()) for loss in (front.loss_av, front.loss_hv))
    below = 1.0 - av - hv
    best = int(np.argmax(below))
    return best if below[best] > 1e-9 else None


def knee_weights(front: Points, k: int) -> tuple[float, float]:
    """The weights of the AV from and up to which point k minimises the joint objective over the front.

    NaN, NaN if it does so for no weight (it lies behind the hull). omega av_k + (1 - omega) hv_k is linear in
    omega, so every other point gives one bound.
    """
    low, high = 0.0, 1.0
    for av, hv in zip(front.loss_av - front.loss_av[k], front.loss_hv - front.loss_hv[k], strict=True):
        # omega av + (1 - omega) hv >= 0
        slope = av - hv
        if slope > 0.0:
            low = max(low, -hv / slope)
        elif slope < 0.0:
            high = min(high, -hv / slope)
    return (float(low), float(high)) if low <= high else (np.nan, np.nan)


def hypervolume(points: Points, ideal: tuple[float, float], reference: tuple[float, float]) -> float:
    """Share of the box from ideal to reference (av, hv) that the points dominate; NaN for an empty box."""
    width, height = reference[0] - ideal[0], reference[1] - ideal[1]
    if width <= 0.0 or height <= 0.0:
        return np.nan
    inside = (points.loss_av < reference[0]) & (points.loss_hv < reference[1])
    front = non_dominated(points.chosen(np.flatnonzero(inside)))
    right = np.append(front.loss_av[1:], reference[0])
    return float(np.sum((right - front.loss_av) * (reference[1] - front.loss_hv)) / (width * height))


def compare(front: Points, optima: Points, omegas: tuple[float, ...]) -> Comparison:
    """Front against sweep. optima: one point an omega; NaN where either is empty."""
    if not len(front) or not len(optima):
        return Comparison(np.nan, np.nan, np.nan, np.nan, (np.nan, np.nan))
    omega = np.array(omegas)[:, None]
    best = (omega * front.loss_av + (1.0 - omega) * front.loss_hv).min(axis=1)
    swept = (omega * optima.loss_av + (1.0 - omega) * optima.loss_hv).min(axis=1)
    av = np.concatenate([front.loss_av, optima.loss_av])
    hv = np.concatenate([front.loss_hv, optima.loss_hv])
    # Beyond the nadir, so that the ends of a front count, and so that a single point has a volume.
    ideal, reference = (av.min(), hv.min()), (_BEYOND * float(av.max()), _BEYOND * float(hv.max()))
    excess = best / swept - 1.0
    return Comparison(
        float(excess.max()),
        float(max(-excess.min(), 0.0)),
        hypervolume(front, ideal, reference),
        hypervolume(optima, ideal, reference),
        reference,
    )
