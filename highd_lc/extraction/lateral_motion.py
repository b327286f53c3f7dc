"""A vehicle's lateral motion around a marking: smoothed, and where it comes to rest in a lane (equations.md 11).

At rest means, on the derivatives of a local quadratic through the positions: speed and acceleration below
thresholds, the speed towards the other lane staying so for a while, and the vehicle off the marking. The quadratic
is as narrow as the noise of the positions allows, for a wide one smears short manoeuvres near the ends of a track.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.core.kinematics import local_polynomial, narrowest_window, noise_gain, white_noise
from highd_lc.extraction.track_index import ABSENT, TIE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Width of the local quadratic where positions are as good as HighD's [s]; noise widens it until the speed is known
# to a sixth of the threshold, so that it crosses it by noise in one of a billion samples.
_SHORTEST_S = 0.4
_SPEED_NOISE_SHARE = 1 / 6
# Near the ends of a track the fit is one-sided and the speed less certain: one that exceeds the threshold by less
# than this many standard deviations of the excess is still taken for near zero.
_EDGE_DEVIATIONS = 1.5
# With noisy positions that is generous: a vehicle that leaves the view in the middle of its change may pass for
# one at rest. There the recorded lateral speed, averaged over the outermost samples, has a say; the slack above
# the threshold lets pass who has all but arrived. Positions as good as HighD's decide alone.
_NOISY_M = 0.01
_OUTERMOST_S = 0.2
_NEAR_EDGE_S = 0.5
_EDGE_SPEED_SHARE = 1.15


@dataclass(frozen=True)
class Rule:
    """Numbers of the rule. smoothing_s: largest width of the local quadratic [s]; speed [m/s] and acceleration
    [m/s^2]: below them it is near zero; persistence_s: how long the speed stays so [s]; clearance_m: distance from
    the marking that start and end need [m]; rest_s: time in the lane between two changes that keeps them apart
    [s]; flicker_s: lane ids that change back within this time are one crossing [s]; min_shift_m: smallest lateral
    shift [m].
    """

    smoothing_s: float
    speed: float
    acceleration: float
    persistence_s: float
    clearance_m: float
    rest_s: float
    flicker_s: float
    min_shift_m: float


@dataclass(frozen=True)
class Path:
    """One vehicle's samples: frame, lane (0 = outside), y [m, left positive], each of shape (n,). markings: y of
    the carriageway's markings from its right edge on [m], ascending; rate: frames a second [Hz]. vy: recorded
    lateral speed [m/s], shape (n,); None where there is none.
    """

    frame: IntArray
    lane: IntArray
    y: FloatArray
    markings: FloatArray
    rate: float
    vy: FloatArray | None = None

    def marking(self, origin: int, target: int) -> float:
        """Lateral position of the marking between two adjacent lanes [m], lane 1 = rightmost."""
        return float(self.markings[min(origin, target)])

    def seconds(self, first: int, last: int) -> float:
        """Time between two samples [s]."""
        return float(self.frame[last] - self.frame[first]) / self.rate


def smoothed(path: Path, rule: Rule) -> FloatArray:
    """Lateral position, and speed and acceleration as far as they are certainly not zero: shape (3, n).

    Within half a window of the ends the speed is drawn towards 0 by what it is less certain there, and the
    acceleration, which is that of the window's middle, is not looked at.
    """
    noise, n = white_noise(path.y), len(path.y)
    window_s = narrowest_window(
        round(noise, 6),
        path.rate,
        speed_noise=_SPEED_NOISE_SHARE * rule.speed,
        shortest_s=min(_SHORTEST_S, rule.smoothing_s),
        longest_s=rule.smoothing_s,
    )
    smooth = local_polynomial(path.y, path.rate, window_s=window_s)
    gain = noise_gain(n, path.rate, window_s=window_s)[1]
    slack = _EDGE_DEVIATIONS * noise * (gain - gain.min())
    smooth[1] = np.sign(smooth[1]) * np.maximum(np.abs(smooth[1]) - slack, 0.0)
    smooth[2, gain > gain.min() * (1 + TIE)] = 0.0
    return smooth


def leaves_moving(path: Path, rule: Rule, sample: int) -> bool:
    """Whether a sample is no rest after all: the track ends next to it, and its recorded lateral speed is not 0.

    Looked at only where the positions are noisy and a lateral speed is recorded.
    """
    after, n = len(path.y) - 1 - sample, len(path.y)
    if path.vy is None or min(sample, after) >= _NEAR_EDGE_S * path.rate or white_noise(path.y) <= _NOISY_M:
        return False
    used = max(2, round(_OUTERMOST_S * path.rate))
    outermost = path.vy[:used] if sample < after else path.vy[n - used :]
    return abs(float(np.mean(outermost))) >= _EDGE_SPEED_SHARE * rule.speed - TIE


@kernel()
def first_rest(
    towards: FloatArray, first: int, count: int, step: int, open_ended: bool, needed: int, limits: FloatArray
) -> int:
    """First sample, outward from the crossing, at which the vehicle keeps its lane, or ABSENT.

    towards: distance past the marking, speed and acceleration towards the target, shape (3, n); first, count,
    step: the samples outward; needed: how many samples in a row must be slow; limits: of distance, speed and
    acceleration. At the end of a track (open_ended) the slow samples still in view are enough; before another
    lane change they are not.
    """
    for place in range(count):
        sample = first + step * place
        slow = abs(towards[1, sample]) < limits[1] and abs(towards[2, sample]) < limits[2]
        if not slow or abs(towards[0, sample]) < limits[0]:
            continue
        reach = place + 1
        while reach < min(count, place + needed) and towards[1, first + step * reach] < limits[1]:
            reach += 1
        if reach == place + needed or (reach == count and open_ended):
            return sample
    return ABSENT
