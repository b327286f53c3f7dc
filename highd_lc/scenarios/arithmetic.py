"""The paper's printed numbers against each other: each statement with its line of computation."""

import itertools
import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from highd_lc.core.edie import edie
from highd_lc.core.losses import follower_weights
from highd_lc.core.quintic import END_JY, Quintic, sample, z_shape
from highd_lc.vocab import published as p
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.names import BENCHMARK, LOCAL_OPTIMUM

Row = dict[str, Any]

_MEASURES: Final = (("flow_veh_h", 0, 0.006), ("speed_km_h", 1, 0.002), ("density_veh_km", 2, 0.001))
_ROUNDING: Final = 0.0051
"""Half a unit of the last printed digit of two decimals, and a little for binary fractions."""
_V: Final = 25.0
_D: Final = 3.5
"""Speed at t_start [m/s] and lateral shift [m] of scenario 1."""


def arithmetic_rows() -> list[Row]:
    """All statements (rows of ``arithmetic``)."""
    return [
        *_table_2(),
        *_sums(),
        *_losses(),
        *_benchmark(),
        *_free_optimum(),
        *_rectangle(),
        *_weights(),
        *_printed_twice(),
        *_equations(),
    ]


def _row(
    key: str, statement: str, computation: str, *, printed: float, computed: float, unit: str = "", within: float
) -> Row:
    consistent = abs(printed - computed) <= within
    return {
        "key": key,
        "statement": statement,
        "computation": computation,
        "printed": printed,
        "computed": computed,
        "unit": unit,
        "verdict": "consistent" if consistent else "inconsistent",
    }


def _table_2() -> Iterator[Row]:
    """Table 2 from the printed totals of Table 1 (equations 25 to 27)."""
    units = {number.quantity: number.unit for number in p.SCENARIO_2}
    size = f"({p.RECTANGLE_HEIGHT:g} x {p.RECTANGLE_DURATION:g})"
    for (scenario, policy), total in p.TABLE_1_TOTALS.items():
        ours = edie(total.distance, total.time, p.RECTANGLE_HEIGHT * p.RECTANGLE_DURATION)
        lines = (
            f"3600 x {total.distance} / {size} = {ours[0]:.3f}",
            f"3.6 x {total.distance} / {total.time} = {ours[1]:.3f}",
            f"1000 x {total.time} / {size} = {ours[2]:.3f}",
        )
        for quantity, i, within in _MEASURES:
            yield _row(
                f"table 2, {scenario} {policy}, {quantity}",
                "Table 2 is Edie's definition applied to the printed totals of Table 1",
                lines[i],
                printed=p.printed(scenario, policy, quantity),
                computed=ours[i],
                unit=units[quantity],
                within=within,
            )


def _sums() -> Iterator[Row]:
    """The totals of Table 1 from its rows."""
    for (scenario, policy), rows in p.TABLE_1.items():
        total = p.TABLE_1_TOTALS[scenario, policy]
        for what, unit, printed, values in (
            ("time", "s", total.time, [row.time for row in rows]),
            ("distance", "m", total.distance, [row.distance for row in rows]),
        ):
            yield _row(
                f"table 1, {scenario} {policy}, {what}",
                f"the total {what} of Table 1 is the sum over HV_1 .. HV_10, but for their rounding",
                f"{' + '.join(f'{v:g}' for v in values)} = {sum(values):.2f}",
                printed=printed,
                computed=sum(values),
                unit=unit,
                within=_ROUNDING * len(rows),
            )


def _losses() -> Iterator[Row]:
    """Losses as means of comfort and efficiency, totals as sums."""
    for side in ("av", "hv"):
        quantities = (f"{side}_comfort", f"{side}_efficiency", f"loss_{side}")
        comfort, efficiency, printed = (p.printed("1", BENCHMARK, quantity) for quantity in quantities)
        value = 0.5 * comfort + 0.5 * efficiency
        line = f"0.5 x {comfort} + 0.5 x {efficiency} = {value:.3f}"
        yield _row(
            f"{side.upper()} loss, benchmark",
            "a loss is half comfort, half efficiency",
            line,
            printed=printed,
            computed=value,
            within=_ROUNDING,
        )
    for scenario, policy in itertools.product(("1", "3"), (BENCHMARK, LOCAL_OPTIMUM)):
        quantities = ("loss_av", "loss_hv", "loss_total")
        av, hv, printed = (p.printed(scenario, policy, quantity) for quantity in quantities)
        line = f"{av} + {hv} = {av + hv:.2f}"
        yield _row(
            f"total, scenario {scenario}, {policy.removesuffix('_optimum')}",
            "the reported total is the unweighted sum",
            line,
            printed=printed,
            computed=av + hv,
            within=_ROUNDING,
        )


def _benchmark() -> Iterator[Row]:
    """The benchmark of scenario 1 as printed cannot be a free optimum."""
    t = np.arange(41, dtype=np.float64) * 0.1
    s = sample(Quintic(v0=_V, D=_D, T=4.0, x_final=4.0 * _V, v_end=_V), t)
    v_ref = TABLE3_MEANS.v_desire
    efficiency = float(np.abs(np.hypot(s.vx, s.vy) - v_ref).sum() / _V)
    comfort = float((np.abs(s.jx) + np.abs(s.jy)).sum() / 8.0)
    yield _row(
        "AV efficiency of 4 s at 25 m/s",
        "the printed efficiency of the benchmark is that of T = 4.0 s at constant speed",
        f"sum |hypot(25, ydot) - {v_ref}| / 25 over 0..4 s = {efficiency:.4f}",
        printed=p.printed("1", BENCHMARK, "av_efficiency"),
        computed=efficiency,
        within=_ROUNDING,
    )
    yield _row(
        "AV comfort of 4 s at 25 m/s",
        "the printed comfort is that of the same motion",
        f"sum |j_y| / 8 over 0..4 s = {comfort:.4f}",
        printed=p.printed("1", BENCHMARK, "av_comfort"),
        computed=comfort,
        within=_ROUNDING,
    )


def _free_optimum() -> Iterator[Row]:
    """The printed comfort and efficiency against what a free optimum at constant speed asks."""
    # At constant speed efficiency grows with T, comfort falls with T^2: at the optimum E = 2 C.
    comfort, efficiency = (p.printed("1", BENCHMARK, f"av_{term}") for term in ("comfort", "efficiency"))
    for key, C, E in (("as printed", comfort, efficiency), ("labels swapped", efficiency, comfort)):
        yield _row(
            f"free optimum, {key}",
            "at the optimum over T of a constant-speed plan efficiency is twice comfort (E ~ T, C ~ 1/T^2)",
            f"E / (2 C) = {E} / (2 x {C}) = {E / (2 * C):.3f}",
            printed=1.0,
            computed=E / (2 * C),
            within=0.05,
        )
    T = math.sqrt(23.094 * _D / (0.1 * 8.0 * comfort))
    end_jerk = END_JY * _D / T**3
    yield _row(
        f"duration behind comfort {comfort}",
        "a constant-speed plan with the printed comfort keeps the jerk limit of 8 m/s^3",
        f"23.094 D / T^2 = {comfort} x 8 x 0.1 gives T = {T:.2f} s, end jerk 60 D / T^3 = {end_jerk:.1f}",
        printed=8.0,
        computed=end_jerk,
        unit="m/s³",
        within=0.05,
    )


def _rectangle() -> Iterator[Row]:
    """The rectangle of Table 1 and the follower in it that was not clipped."""
    height, duration = p.RECTANGLE_HEIGHT, p.RECTANGLE_DURATION
    longest = max(row.distance for rows in p.TABLE_1.values() for row in rows)
    yield _row(
        "height of the rectangle",
        "no follower drives farther in the rectangle than it is long",
        f"largest distance in Table 1 = {longest} m in {height:g} m; area used {longest * duration:.0f} m s, "
        f"not {height * duration:.0f}",
        printed=height,
        computed=longest,
        unit="m",
        within=0.0,
    )
    bench, local = (p.TABLE_1_TOTALS["2_20", policy] for policy in (BENCHMARK, LOCAL_OPTIMUM))
    printed_gain = 100.0 * (local.distance / bench.distance - 1.0)
    # Where the others are clipped: the largest distance of another follower at 20 m/s.
    third, end = sorted(
        (row.distance for q in (BENCHMARK, LOCAL_OPTIMUM) for row in p.TABLE_1["2_20", q]), reverse=True
    )[:2]
    beyond = third - end
    gain = 100.0 * ((local.distance - beyond) / bench.distance - 1.0)
    moved = f"({local.distance} - ({third} - {end})) / {bench.distance} - 1"
    yield _row(
        "HV_3 at 20 m/s",
        "the gain in flow at 20 m/s does not rest on HV_3, the only one not clipped at 200 m",
        f"{moved} = {gain:.2f} %, printed {printed_gain:.2f} %",
        printed=printed_gain,
        computed=gain,
        unit="%",
        within=0.1,
    )


def _weights() -> Iterator[Row]:
    """Time headway at t_start, weights of scenario 3, the total at omega_AV = 0.1."""
    yield _row(
        "shortest time headway",
        "no time headway is shorter than the printed one (10 m between centres at t_start)",
        f"10 / {_V:g} = {10.0 / _V:.2f} s at t_start already",
        printed=p.printed("1", BENCHMARK, "min_time_headway_s"),
        computed=10.0 / _V,
        unit="s",
        within=_ROUNDING,
    )
    v, spacing = np.array(p.SCENARIO_3_SPEED_DIFFERENCES), np.array(p.SCENARIO_3_SPACINGS)
    weights = follower_weights(v, spacing, 0.0)
    for i, (ours, printed) in enumerate(zip(weights, p.SCENARIO_3_WEIGHTS, strict=True)):
        yield _row(
            f"weight of HV_{i + 1}, scenario 3",
            "equations 16 and 17 give the printed weights",
            f"{v[i]} / sqrt({spacing[i]}) over the sum of all = {ours:.5f}",
            printed=printed,
            computed=float(ours),
            within=_ROUNDING,
        )
    av, hv = (p.printed("1", LOCAL_OPTIMUM, f"loss_{side}", omega=p.LOWEST_OMEGA) for side in ("av", "hv"))
    yield _row(
        "weight 0.1",
        "the printed total at omega_AV = 0.1 lies above the benchmark's",
        f"{av} + {hv} = {av + hv:.2f} against {p.printed('1', BENCHMARK, 'loss_total')}",
        printed=50.93,
        computed=av + hv,
        within=_ROUNDING,
    )


def _printed_twice() -> Iterator[Row]:
    """A number that the paper prints in two places."""
    first, again = p.printed("3", BENCHMARK, "loss_av"), p.SCENARIO_3_LOSS_AV_AGAIN
    yield _row(
        "AV loss, scenario 3, benchmark",
        "the AV loss of scenario 3's benchmark is the same in both places where it is printed",
        f"{first} against {again}",
        printed=first,
        computed=again,
        within=1e-9,
    )


def _equations() -> Iterator[Row]:
    """Equations and constants as printed."""
    yield _row(
        "equation 4",
        "the lateral polynomial y = 6 D z ends at D",
        f"6 D z(1) = 6 x {_D} x {z_shape(1.0):g} = {6 * _D * z_shape(1.0):g} m",
        printed=_D,
        computed=6 * _D * z_shape(1.0),
        unit="m",
        within=1e-9,
    )
    corner = (2.5 / 2.5) ** 2 + (1.0 / 1.0) ** 2
    yield _row(
        "C_a, C_b",
        "the ellipse with semi-axes 2.5 m and 1.0 m holds the corners of the 5 m x 2 m box (at most 1)",
        f"(2.5 / 2.5)^2 + (1.0 / 1.0)^2 = {corner:g}",
        printed=1.0,
        computed=corner,
        within=1e-9,
    )
