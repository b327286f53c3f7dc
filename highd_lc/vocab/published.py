"""Every number that the paper prints on its scenarios, once (equations.md 13)."""

import math
from dataclasses import dataclass
from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS, POLICIES


@dataclass(frozen=True)
class Published:
    """A printed number of a scenario: of which policy and weight of the AV, what, in which unit.

    quantity: the column of ``scenario_cells`` that holds ours, for a list followed by the follower's rank; for a
    comparison of the pair preceded by what is compared (``COMPARISONS``).
    """

    scenario: str
    policy: str
    quantity: str
    value: float
    unit: str = ""
    note: str = ""
    omega_given: float | None = None

    @property
    def omega_av(self) -> float:
        """Weight of the AV behind it: 1 of the benchmark, 0.5 of the local optimum unless another is given.

        NaN where no policy stands behind it.
        """
        if self.omega_given is not None:
            return self.omega_given
        return WEIGHTS.get(self.policy, math.nan)

    @property
    def key(self) -> str:
        """Scenario, policy and quantity in one word."""
        return _key(self.scenario, self.policy, self.quantity, self.omega_given)


def _key(scenario: str, policy: str, quantity: str, omega: float | None) -> str:
    weight = "" if omega is None else f"@{omega:g}"
    return f"{scenario}:{policy}{weight}:{quantity}"


@dataclass(frozen=True)
class Totals:
    """A printed pair of Tables 1: time [s] and distance [m] in the rectangle."""

    time: float
    distance: float


CHANGE: Final = "change"
DIFFERENCE: Final = "difference"
LEAST: Final = "least"
MOST: Final = "most"
COMPARISONS: Final = (CHANGE, DIFFERENCE, LEAST, MOST)
"""Local optimum against benchmark: relative change [%], difference, its least and its most over the followers."""
RECORDED_FITS: Final = "recorded"
"""In the place of a policy: the drivers fitted to recordings."""

LOWEST_OMEGA: Final = 0.1
"""The lowest weight of the AV that the paper prints losses of."""
_JOINT: Final = 0.5
WEIGHTS: Final = {policy: POLICIES[policy].omega_av(_JOINT) for policy in PAIRS[names.FIXED]}
"""Weight of the AV of the paper's benchmark and local optimum."""
_BENCHMARK, _LOCAL = names.BENCHMARK, names.LOCAL_OPTIMUM

SCENARIO_1: Final = (
    Published("1", _BENCHMARK, "loss_av", 21.42),
    Published("1", _BENCHMARK, "av_comfort", 28.87, note="cannot be a free optimum as printed (arithmetic)"),
    Published("1", _BENCHMARK, "av_efficiency", 13.97, note="T = 4.0 s at constant speed gives 13.9706"),
    Published("1", _LOCAL, "loss_av", 26.94),
    Published("1", _BENCHMARK, "loss_hv", 28.64),
    Published("1", _BENCHMARK, "hv_comfort", 27.50),
    Published("1", _BENCHMARK, "hv_efficiency", 29.79),
    Published("1", _LOCAL, "loss_hv", 17.70),
    Published("1", _BENCHMARK, "loss_total", 50.06),
    Published("1", _LOCAL, "loss_total", 44.64),
    Published("1", _BENCHMARK, "ttt_difference_s", 14.18, "s"),
    Published("1", _LOCAL, "ttt_difference_s", 11.84, "s"),
    Published("1", _BENCHMARK, "hv1_v_min", 15.47, "m/s"),
    Published("1", _BENCHMARK, "min_time_headway_s", 0.42, "s", "10 m at 25 m/s are 0.40 s already"),
    Published("1", _LOCAL, "av_v_max", 28.11, "m/s"),
    Published("1", _LOCAL, "loss_av", 36.79, note="omega_AV = 0.1 (figure 11)", omega_given=LOWEST_OMEGA),
    Published("1", _LOCAL, "loss_hv", 14.14, note="omega_AV = 0.1 (figure 11)", omega_given=LOWEST_OMEGA),
)
"""Scenario 1: losses, travel time, speeds."""

BEST_OMEGA: Final = (0.5, 0.6)
"""Where the paper's total is lowest."""

SCENARIO_2: Final = (
    Published("2_15", _BENCHMARK, "flow_veh_h", 1875.963, "veh/h"),
    Published("2_15", _LOCAL, "flow_veh_h", 1905.666, "veh/h"),
    Published("2_20", _BENCHMARK, "flow_veh_h", 1509.140, "veh/h"),
    Published("2_20", _LOCAL, "flow_veh_h", 1579.746, "veh/h"),
    Published("2_15", _BENCHMARK, "speed_km_h", 65.746, "km/h"),
    Published("2_15", _LOCAL, "speed_km_h", 69.381, "km/h"),
    Published("2_20", _BENCHMARK, "speed_km_h", 67.641, "km/h"),
    Published("2_20", _LOCAL, "speed_km_h", 72.837, "km/h"),
    Published("2_15", _BENCHMARK, "density_veh_km", 28.533, "veh/km"),
    Published("2_15", _LOCAL, "density_veh_km", 27.467, "veh/km"),
    Published("2_20", _BENCHMARK, "density_veh_km", 22.311, "veh/km"),
    Published("2_20", _LOCAL, "density_veh_km", 21.689, "veh/km"),
    Published("2_15", _BENCHMARK, "loss_total", 224.96),
    Published("2_15", _LOCAL, "loss_total", 207.58),
    Published("2_20", _BENCHMARK, "loss_total", 198.16),
    Published("2_20", _LOCAL, "loss_total", 184.65),
)
"""Table 2 and the total losses of scenario 2."""

SCENARIO_3: Final = (
    Published("3", _BENCHMARK, "loss_av", 21.84),
    Published("3", _LOCAL, "loss_av", 25.40),
    Published("3", _BENCHMARK, "loss_hv", 48.44),
    Published("3", _LOCAL, "loss_hv", 42.12),
    Published("3", _BENCHMARK, "loss_total", 70.28),
    Published("3", _LOCAL, "loss_total", 67.52),
)
"""Losses of scenario 3."""
SCENARIO_3_SPACINGS: Final = (24.23, 59.73, 107.26)
"""Front to front from each follower to the AV at t_start [m]."""
SCENARIO_3_SPEED_DIFFERENCES: Final = (5.27, 5.43, 4.56)
"""Speed of each follower minus the AV's at t_start [m/s]."""
SCENARIO_3_WEIGHTS: Final = (0.48, 0.32, 0.20)
"""Weights of the followers."""

TABLE_1: Final = {
    ("2_15", _BENCHMARK): (
        Totals(10.80, 147.22), Totals(12.10, 191.36), Totals(13.40, 234.41), Totals(13.60, 248.25),
        Totals(12.10, 229.08), Totals(10.30, 202.78), Totals(9.00, 184.97), Totals(6.80, 143.16),
        Totals(5.00, 107.71), Totals(3.20, 69.78),
    ),
    ("2_15", _LOCAL): (
        Totals(9.80, 147.48), Totals(11.20, 191.43), Totals(12.60, 234.42), Totals(12.90, 248.43),
        Totals(12.10, 239.08), Totals(10.40, 213.10), Totals(8.60, 181.65), Totals(6.80, 147.24),
        Totals(5.00, 110.26), Totals(3.30, 73.48),
    ),
    ("2_20", _BENCHMARK): (
        Totals(9.80, 148.35), Totals(11.00, 191.45), Totals(10.80, 197.33), Totals(10.50, 199.29),
        Totals(10.00, 196.47), Totals(8.40, 170.39), Totals(6.30, 130.99), Totals(4.60, 97.77),
        Totals(2.80, 60.08), Totals(1.10, 22.72),
    ),
    ("2_20", _LOCAL): (
        Totals(8.70, 148.44), Totals(10.10, 191.75), Totals(11.60, 235.56), Totals(9.80, 198.48),
        Totals(9.60, 199.57), Totals(8.20, 174.59), Totals(6.40, 139.05), Totals(4.70, 103.69),
        Totals(2.90, 64.24), Totals(1.20, 25.63),
    ),
}  # fmt: skip
"""Table 1: HV_1 .. HV_10 in the rectangle."""

TABLE_1_TOTALS: Final = {
    ("2_15", _BENCHMARK): Totals(96.30, 1758.72),
    ("2_15", _LOCAL): Totals(92.70, 1786.56),
    ("2_20", _BENCHMARK): Totals(75.30, 1414.82),
    ("2_20", _LOCAL): Totals(73.20, 1481.01),
}
"""Its printed totals."""

RECTANGLE_HEIGHT: Final = 225.0
RECTANGLE_DURATION: Final = 15.0
"""Length of road [m] and time [s] of the rectangle behind Tables 1 and 2; |A| is their product."""

TABLE_1_NUMBERS: Final = tuple(
    Published(scenario, policy, f"{quantity} {rank}", value, unit, "Table 1")
    for (scenario, policy), rows in TABLE_1.items()
    for rank, row in enumerate(rows, start=1)
    for quantity, value, unit in (("rectangle_time_s", row.time, "s"), ("rectangle_distance_m", row.distance, "m"))
)
"""Table 1, number by number."""

MOST_HELPED: Final = (5, 10)
"""The followers whose speeds rise most under the local optimum, from rank to rank."""
TABLE_3: Final = "table_3"
FITS: Final = (Published(TABLE_3, RECORDED_FITS, "paper_j", 0.09, note="printed as about 0.09; of 60 recordings"),)
"""Objective of the calibration to recordings."""
SCENARIO_3_LOSS_AV_AGAIN: Final = 21.82
"""The benchmark's AV loss of scenario 3 where it is printed a second time."""

_SIGN: Final = "printed without a sign; lower, since the lateral acceleration is said to be smaller"
_SPEEDS: Final = "printed as 1 to 5 m/s without a scenario; ours: change of the lowest speed"
_PRINTED_CHANGES: Final = (
    Published("1", _LOCAL, f"{CHANGE} loss_hv", -38.0, "%"),
    Published("1", _LOCAL, f"{CHANGE} loss_total", -10.8, "%"),
    Published("1", _LOCAL, f"{DIFFERENCE} av_vy_max", -0.2, "m/s", _SIGN),
    Published("1", _LOCAL, f"{LEAST} hv_v_min", 1.0, "m/s", _SPEEDS),
    Published("1", _LOCAL, f"{MOST} hv_v_min", 5.0, "m/s", _SPEEDS),
)
"""Comparisons that the paper prints itself."""
_PRINTED: Final = SCENARIO_1 + SCENARIO_2 + SCENARIO_3 + TABLE_1_NUMBERS + FITS
_BY_KEY: Final = {number.key: number for number in _PRINTED}


def printed(scenario: str, policy: str, quantity: str, *, omega: float | None = None) -> float:
    """A printed number. omega: weight of the AV where one other than the policy's is given. Raises KeyError."""
    return _BY_KEY[_key(scenario, policy, quantity, omega)].value


def _changes() -> tuple[Published, ...]:
    """Relative changes of all printed pairs that the paper does not state as such."""
    known = {number.key for number in _PRINTED_CHANGES}
    found = []
    for number in SCENARIO_1 + SCENARIO_2 + SCENARIO_3:
        pair = [_BY_KEY.get(_key(number.scenario, policy, number.quantity, None)) for policy in WEIGHTS]
        benchmark, local = pair
        if number is not local or benchmark is None:
            continue
        value = 100.0 * (local.value / benchmark.value - 1.0)
        change = Published(
            number.scenario, _LOCAL, f"{CHANGE} {number.quantity}", value, "%", "from the printed pair"
        )
        found += [] if change.key in known else [change]
    return tuple(found)


CHANGES: Final = _PRINTED_CHANGES + _changes()
"""Every comparison of local optimum and benchmark, those that the paper prints as such first."""
PUBLISHED: Final = _PRINTED + CHANGES
"""Every printed result of the scenarios."""
