"""What the scenarios' pages say: words beside each figure, and what the pages begin with."""

from collections.abc import Mapping
from typing import Final

import pandas as pd
from markupsafe import Markup

from highd_lc.reporting import labels
from highd_lc.reporting.pages_scenarios import Words, claim_counts, scenario_words
from highd_lc.vocab.scenarios import ScenarioSettings

Frames = Mapping[str, pd.DataFrame]

WORDS: Final = {
    "plans": Words(
        "Plans of the AV (figure 9 of the paper)",
        "Benchmark minimises the AV's own loss, local optimum the mean of its own and the followers'. A dot marks "
        "the end of the manoeuvre; the AV drives on at its end speed.",
        "Forward offset, lateral position, speed and acceleration of both plans over time, one column an AV "
        "speed.",
    ),
    "followers": Words(
        "Scenario 1: the followers (figure 8)",
        "Ten followers behind the AV at 25 m/s. All of them relax at once: at v_desire = 25 m/s no spacing is in "
        "equilibrium, the platoon held at 44 m until t_start begins to stretch. The benchmark hardly differs.",
        "Trajectories in a frame that moves at 25 m/s, speeds, accelerations and time headways of ten followers.",
    ),
    "losses": Words(
        "Scenario 1: losses (figure 10)",
        "Each bar is half of comfort and half of efficiency, AV below, followers above. Left the printed totals.",
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
        "as it came, and the platoon behind it with it.",
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

    alone = "; ".join(
        f"scenario {scenario_words(row.scenario)}: {row.near} of {row.numbers} within 10 % (in {row.cell})"
        for row in frames["closest"].itertuples()
    )
    return [
        f"{total} published numbers. Under the default options: {told(verdicts)}. In the cell nearest to each: "
        f"{told(nearest)}. Reproduced: within 1 %; near: within 10 %.",
        "A cell is a variant of the options (named as in pipelines/scenarios.toml), a form and an accounting. "
        "Nothing was tuned towards the paper. The nearest cell is chosen for each number alone, after the fact; "
        f"taken together, the single cells that come nearest give (without Table 1) {alone}.",
    ]
