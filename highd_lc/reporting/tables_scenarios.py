"""Tables beside the figures of the scenarios' page.

What the scenarios' pages say: words beside each figure, and what the pages begin with.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup

from highd_lc.core.edie import edie
from highd_lc.reporting import html, labels
from highd_lc.reporting.labels import RECORDED
from highd_lc.reporting.pages_data import Column, Section, TableView, table_view
from highd_lc.reporting.pages_scenarios import Picture, Words, claim_counts, picture_section
from highd_lc.scenarios.run import DEFAULT
from highd_lc.vocab import names
from highd_lc.vocab.published import WEIGHTS
from highd_lc.vocab.scenarios import ScenarioSettings

Frames = Mapping[str, pd.DataFrame]

WORDS: Final = {
    "plans": Words(
        "Plans of the AV (figure 9 of the paper)",
        "Benchmark minimises the AV's own loss, local optimum the mean of its own and the followers'. A dot marks "
        "the end of the manoeuvre; the AV drives on at its end speed.",
        "Forward offset, lateral position, speed, forward acceleration, lateral speed and lateral acceleration of "
        "both plans over time, one column an AV speed.",
    ),
    "followers": Words(
        "Scenario 1: the followers (figure 8)",
        "Ten followers behind the AV at 25 m/s. Under the default options the platoon is in equilibrium until "
        "t_start: what happens after it is the lane change's doing. With v_desire = 25 m/s as printed (variant "
        "v_desire_25) no spacing is in equilibrium and all of them begin to stretch at t_start.",
        "Trajectories in a frame that moves at 25 m/s, speeds, accelerations and time headways of ten followers.",
    ),
    "losses": Words(
        "Scenario 1: losses (figure 10)",
        "Each bar is half of comfort and half of efficiency, AV below, followers above. Left the printed totals. "
        "*: a plan on a bound of T or of the speed, not valid.",
        "Losses of benchmark and local optimum by part, fixed and free end speed, three accountings, and as "
        "printed.",
    ),
    "weights": Words(
        "Scenario 1: the weight of the AV (figure 11)",
        "The total is lowest at omega_AV = 0.5 by construction: half of it is the objective there.",
        "Losses of AV and followers and their sum over omega_AV under three accountings, with the printed points.",
    ),
    "speed_maps": Words(
        "Scenario 2: speed over space and time (figures 12 and 13)",
        "Cells by exact clipping; where nobody was, the map is empty. With the end speed fixed the AV stays "
        "as slow "
        "as it came, and the platoon behind it with it. With the AV at 15 m/s and 10 m between centres HV 1 "
        "drives into it: that row shows what the equations give, and counts for nothing.",
        "Speed maps of both policies and their difference for the AV at 15 and 20 m/s.",
    ),
    "rectangle": Words(
        "Scenario 2: trajectories in the rectangle (figure 14), Tables 1 and 2",
        "The rectangle is 225 m by 15 s as printed, placed so that HV 1 drives the printed 147 m in it. The "
        "printed "
        "distances of up to 248 m do not fit into 225 m (see the ledger).",
        "Trajectories of ten followers around the rectangle, benchmark dashed, local optimum solid.",
    ),
    "scenario_3": Words(
        "Scenario 3: the printed state of one recorded event",
        "The AV's speed is not printed, so it is the axis; dotted lines are the printed totals. Equations 16 "
        "and 17 "
        "give the printed weights (ledger, arithmetic).",
        "Total loss of both policies over the speed of the AV under three accountings.",
    ),
    "recorded": Words(
        "A real lane change: Edie's measures on the target lane",
        "The recorded lane change with most followers in the work folder. The line is the vehicle that changes "
        "lane, the dotted one its crossing; cells that nobody entered are empty.",
        "Flow, speed and density of the target lane over space and time around a recorded lane change.",
    ),
    "growth": Words(
        "String stability, and how far up the platoon the local optimum helps",
        "Top left: amplification of a speed oscillation from vehicle to vehicle, linearised at equilibrium. The "
        "others: largest drop of each follower below the speed that lasts.",
        "Amplification over speed for six sets of drivers; undershoot over the follower's rank under both "
        "policies.",
    ),
}


_PRE_PHASE: Final = {"hold": "held until t_start", "lcm": "driving by LCM from the begin of the scenario"}


def lead(frames: Frames, settings: ScenarioSettings) -> list[str | Markup]:
    """What the page begins with: options, claims, the way to the ledger."""
    counted = claim_counts(_default_claims(frames["claims"], settings))
    options = settings.options
    return [
        f"Default options: accounting “{labels.ACCOUNTING_NAMES[settings.accounting].lower()}”, "
        f"{labels.FORMS[settings.form].lower()}, platoon at {settings.scenario_1.platoon_speed:g} m/s with "
        f"{options.spacing_m:g} m spacing ({_PRE_PHASE[options.pre_phase]}), followers' losses: "
        f"{options.aggregation}, H = {options.horizon_s:g} s.",
        f"Claims of the paper under them, scenario by scenario: {counted}.",
        Markup('Every published number beside ours: <a href="ledger.html">the ledger</a>.'),
    ]


def _default_claims(claims: pd.DataFrame, settings: ScenarioSettings) -> pd.DataFrame:
    return claims[(claims["form"] == settings.form) & (claims["accounting"] == settings.accounting)]


def ledger_lead(frames: Frames) -> list[str]:
    """What the ledger begins with: how many numbers come out."""
    verdicts = frames["ledger"]["verdict"].value_counts()
    nearest = frames["ledger"]["nearest_verdict"].value_counts()
    total = len(frames["ledger"])

    def told(counts: pd.Series) -> str:
        return ", ".join(f"{n} {word}" for word, n in counts.items())

    closest: Iterable[Any] = frames["closest"].itertuples()
    alone = "; ".join(
        f"scenario {labels.scenario(row.scenario)}: {row.near} of {row.numbers} within 10 % (in {row.cell})"
        for row in closest
    )
    return [
        f"{total} published numbers. Under the default options: {told(verdicts)}. In the cell nearest to each: "
        f"{told(nearest)}. Reproduced: within 1 %; near: within 10 %.",
        "A cell is a variant of the options (named as in pipelines/scenarios.toml), a form and an accounting. "
        "Nothing was tuned towards the paper. The nearest cell is chosen for each number alone, after the fact; "
        f"taken together, the single cells that come nearest give (without Table 1) {alone}.",
        *_unbound(frames["scenario_cells"]),
    ]


_UNBOUND: Final = "v_max_50"


def _unbound(cells: pd.DataFrame) -> Iterable[str]:
    """What becomes of scenario 1's changes where plans may drive faster than 30 m/s, in the default form."""
    chosen = cells[(cells["scenario"] == "1") & (cells["variant"] == _UNBOUND) & (cells["form"] == names.FIXED)]
    chosen = chosen[chosen["accounting"] == names.FOLLOWER_HORIZON].set_index("omega_av")
    if not set(WEIGHTS.values()) <= set(chosen.index):
        return
    benchmark, local = (chosen.loc[omega] for omega in WEIGHTS.values())
    hv, total = (100.0 * (local[f"loss_{side}"] / benchmark[f"loss_{side}"] - 1.0) for side in ("hv", "total"))
    yield (
        f"Where plans may drive up to 50 m/s (variant {_UNBOUND}: fixed end speed, accounting of the follower "
        f"horizon) scenario 1's local optimum reaches {local['av_v_max']:.1f} m/s, and from benchmark to it the "
        f"followers' loss changes by {hv:+.1f} %, the total by {total:+.1f} %: how near ours come to the printed "
        "changes hangs on the bound of 30 m/s."
    )


def event_link(event_id: str, has_page: bool) -> Markup:
    """Where the paper's figures 15 and 16 have their counterpart: an event page.

    event_id: empty without recordings.
    """
    begin = "Figures 15 and 16 of the paper show such an event: its plans, and the followers behind each of them. "
    if not event_id:
        return Markup("{}The page of every recorded event shows the same; there are no recordings here.").format(
            begin
        )
    where = Markup('<a href="../events/{0}.html">{0}</a>').format(event_id) if has_page else event_id
    told = "" if has_page else " (the report beside this folder has no page of it)"
    return Markup("{}Of the recorded lane changes the nearest to the printed state is {}{}.").format(
        begin, where, told
    )


def section_of(picture: Picture, frames: Frames) -> Section:
    """The section of a figure with the tables that belong to it."""
    makers = {
        "followers": _tracking,
        "rectangle": _traffic,
        "losses": _increments,
        "speed_maps": _waves,
        "growth": _reach,
        "recorded": _recorded,
    }
    shown, folded = makers[picture.name](frames) if picture.name in makers else ([], [])
    return picture_section(picture, shown, folded)


Tables = tuple[list[TableView], list[TableView]]


def _worded(frame: pd.DataFrame) -> pd.DataFrame:
    changed = frame.assign(scenario=frame["scenario"].map(labels.scenario)) if "scenario" in frame else frame
    return changed.assign(policy=changed["policy"].map(labels.short_policy)) if "policy" in changed else changed


def _tracking(frames: Frames) -> Tables:
    frame = frames["scenario_tracking"]
    columns = (
        Column("policy", "Policy"),
        Column("plant", "Car"),
        Column("status", "Status"),
        Column("max_lateral_m", "Largest lateral error", "m", 3),
        Column("max_longitudinal_m", "longitudinal", "m", 3),
        Column("loss_av", "AV loss", digits=2),
        Column("loss_hv", "Followers' loss", digits=2),
        Column("loss_total", "Total", digits=2),
        Column("hv1_v_min", "Lowest speed of HV 1", "m/s", 2),
    )
    caption = "The AV as the MPC drives it, and the followers behind that motion; jerk by finite differences."
    return [table_view(_worded(frame.assign(plant=frame["plant"].map(labels.PLANTS))), columns, caption)], []


def _increments(frames: Frames) -> Tables:
    """The followers' loss with and without the lane change, default variant of scenarios 1 and 2."""
    cells = frames["scenario_cells"]
    rows = cells[(cells["variant"] == DEFAULT) & cells["omega_av"].isin(list(WEIGHTS.values()))]
    told = rows.assign(
        scenario=rows["scenario"].map(labels.scenario),
        policy=rows["omega_av"].map({omega: labels.POLICIES[policy].label for policy, omega in WEIGHTS.items()}),
        form=rows["form"].map(labels.FORMS),
        accounting=rows["accounting"].map(labels.ACCOUNTING_NAMES),
        increment=rows["loss_hv"] - rows["loss_hv_unchanged"],
    )
    columns = (
        Column("scenario", "Scenario"),
        Column("form", "Form"),
        Column("accounting", "Accounting"),
        Column("policy", "Policy"),
        Column("T", "T", "s", 1),
        Column("loss_av", "AV loss", digits=2),
        Column("loss_hv", "Followers' loss", digits=2),
        Column("loss_hv_unchanged", "without lane change", digits=2),
        Column("increment", "due to it", digits=2),
        Column("loss_total", "Total", digits=2),
        Column("not_valid", "Not valid"),
    )
    caption = "Followers' loss over the same time with and without the lane change; “–”: no plan, or a collision."
    return [], [table_view(told, columns, caption)]


def _traffic(frames: Frames) -> Tables:
    state = (
        Column("scenario", "Scenario"),
        Column("policy", "Policy"),
        Column("measure", "Measure"),
        Column("unit", "Unit"),
        Column("published", "Published", digits=3),
        Column("from_table_1", "From the printed Table 1", digits=3),
        Column("ours", "Ours", digits=3),
    )
    vehicles = (
        Column("scenario", "Scenario"),
        Column("policy", "Policy"),
        Column("follower", "HV", digits=0),
        Column("published_time_s", "Time, published", "s", 2),
        Column("time_s", "ours", "s", 2),
        Column("published_distance_m", "Distance, published", "m", 2),
        Column("distance_m", "ours", "m", 2),
    )
    return (
        [table_view(_worded(frames["traffic_state"]), state, "Table 2"), _contacts(frames)],
        [table_view(_worded(frames["rectangle"]), vehicles, "Table 1, vehicle by vehicle")],
    )


def _contacts(frames: Frames) -> TableView:
    columns = (
        Column("scenario", "Scenario"),
        Column("gap_reading", "10 m between"),
        Column("motion", "Motion of the AV"),
        Column("status", "Status"),
        Column("gap_start_m", "Gap at t_start", "m", 2),
        Column("min_gap_m", "Smallest gap", "m", 2),
        Column("min_gap_at_s", "at", "s", 1),
        Column("min_clearance_m", "Ellipse clearance", "m", 2),
        Column("hv1_peak_decel", "HV 1 brakes by", "m/s²", 2),
        Column("verdict", "Outcome"),
    )
    told = frames["contacts"].assign(
        motion=frames["contacts"]["motion"].map(labels.short_policy),
        scenario=frames["contacts"]["scenario"].map(labels.scenario),
        verdict=frames["contacts"]["collision"].map({True: "collision", False: "no contact"}).fillna("no plan"),
    )
    about = (
        "Is 10 m in front of HV 1 possible? AV and HV 1 lengthwise, HV 1 braking by LCM from t_start on. A "
        "collision is "
        "a negative gap: the AV is then still beside HV 1, on its own lane, or has been hit."
    )
    return table_view(told, columns, about)


def _recorded(frames: Frames) -> Tables:
    """The traffic state before and after the crossing, totals over the lane; the wave's speed."""
    cells = frames["recorded_state"]
    rows = []
    for text, part in (("before the crossing", cells["t_from_s"] < 0.0), ("after it", cells["t_from_s"] >= 0.0)):
        chosen = cells[part]
        sizes = (chosen["x_to_m"] - chosen["x_from_m"]) * (chosen["t_to_s"] - chosen["t_from_s"])
        flow, speed, density = edie(*(float(v.sum()) for v in (chosen["distance_m"], chosen["time_s"], sizes)))
        rows.append({"when": text, "flow": flow, "speed": speed, "density": density})
    columns = (
        Column("when", "Target lane"),
        Column("flow", "Flow", "veh/h", 0),
        Column("speed", "Speed", "km/h", 1),
        Column("density", "Density", "veh/km", 1),
    )
    state = table_view(pd.DataFrame(rows), columns, f"Event {cells['event_id'].iloc[0]}, all cells together")
    wave = frames["waves"][frames["waves"]["policy"] == RECORDED]
    return [
        state,
        _wave_table(wave.assign(policy="recorded"), "Shock wave from the ego through its followers"),
    ], []


def _waves(frames: Frames) -> Tables:
    caption = (
        "Speed of the shock wave along the road by cross-correlation from follower to follower, 95 % bootstrap "
        "interval over the pairs; positive = it is carried downstream."
    )
    return [_wave_table(_worded(frames["waves"][frames["waves"]["policy"] != RECORDED]), caption)], []


def _wave_table(rows: pd.DataFrame, caption: str) -> TableView:
    columns = (
        Column("scenario", "Scenario"),
        Column("policy", "Policy"),
        Column("speed_mps", "Wave speed", "m/s", 2),
        Column("low_mps", "from", "m/s", 2),
        Column("high_mps", "to", "m/s", 2),
        Column("pairs", "Pairs", digits=0),
        Column("correlation", "Correlation", digits=3),
        Column("status", "Status"),
    )
    return table_view(rows, columns, caption)


REACH_MPS: Final = 0.05
"""Difference in undershoot that counts as help [m/s]."""


def reach(growth: pd.DataFrame) -> pd.DataFrame:
    """How far up the platoon the local optimum helps: last follower whose undershoot it lowers by 0.05 m/s.

    growth: rows of ``growth``, NaN where somebody drives into another. Columns drivers, scenario, first_benchmark,
    first_local [m/s], last_helped, last_harmed (ranks, 0 = none), delay_saved_s (summed over the platoon).
    """
    key = ["drivers", "scenario", "follower"]
    benchmark, local = (
        growth[growth["policy"] == policy].set_index(key)[["undershoot_mps", "delay_s"]] for policy in WEIGHTS
    )
    rows = []
    pairs = benchmark.add_suffix("_0").join(local.add_suffix("_1"))
    for (drivers, scenario), part in pairs.groupby(level=["drivers", "scenario"], sort=False):
        gained = part["undershoot_mps_0"] - part["undershoot_mps_1"]
        ranks = part.index.get_level_values("follower")
        rows.append(
            {
                "drivers": drivers,
                "scenario": scenario,
                "first_benchmark": part["undershoot_mps_0"].iloc[0],
                "first_local": part["undershoot_mps_1"].iloc[0],
                "last_helped": _last(gained, gained > REACH_MPS, ranks),
                "last_harmed": _last(gained, gained < -REACH_MPS, ranks),
                "delay_saved_s": float((part["delay_s_0"] - part["delay_s_1"]).sum(min_count=1)),
            }
        )
    return pd.DataFrame(rows)


def _last(gained: pd.Series, chosen: pd.Series, ranks: pd.Index) -> float:
    """The last rank that is chosen, 0 = none; NaN where nothing is known, because somebody drives into another."""
    if gained.isna().all():
        return np.nan
    return float(ranks[chosen].max()) if chosen.any() else 0.0


def _reach(frames: Frames) -> Tables:
    columns = (
        Column("drivers", "Drivers"),
        Column("scenario", "AV as in scenario"),
        Column("first_benchmark", "Undershoot of HV 1, benchmark", "m/s", 2),
        Column("first_local", "local optimum", "m/s", 2),
        Column("last_helped", "Helped up to HV", digits=0),
        Column("last_harmed", "Harmed up to HV", digits=0),
        Column("delay_saved_s", "Delay saved, all followers", "s", 2),
    )
    caption = (
        f"Helped, harmed: the local optimum changes the undershoot by more than {html.number(REACH_MPS)} m/s; "
        f"0 = nobody. The delay is taken at the end of the run. “–”: somebody drives into the vehicle ahead."
    )
    return [table_view(_worded(reach(frames["growth"])), columns, caption)], []
