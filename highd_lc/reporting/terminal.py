"""Tables for the terminal: what a run ends with.

The scenarios' claims on the terminal.
"""

from collections.abc import Iterable, Iterator
from typing import Any, Final, cast

import numpy as np
import pandas as pd
from rich import box
from rich.table import Table

from highd_lc.reporting import labels
from highd_lc.reporting.certainty_words import no_interval
from highd_lc.reporting.follower_words import LONG, SHORT, aim_rows, recordings_say, row_of, within_band
from highd_lc.vocab import names


def matrix_table(matrix: pd.DataFrame) -> Table:
    """The validation matrix over all events: gain of the local optimum over the benchmark, with its interval."""
    table = _table(
        "Validation matrix: gain of the local optimum over the benchmark, all events, in %",
        "no event was planned: there is nothing to compare"
        if matrix.empty
        else "gain = 1 - ratio of the summed total losses; added: of the losses above no lane change; "
        f"inf. = no feasible plan; better, worse: share of events{_why_no_interval(matrix)}",
    )
    several = len(set(matrix["followers"])) > 1
    for heading in ("followers", "form", "charged") if several else ("form", "accounting"):
        table.add_column(heading, no_wrap=True)
    for heading in (
        "n" if several else "events",
        "inf.",
        "gain",
        "interval",
        "added",
        "HV",
        "AV",
        "better",
        "worse",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    rows: Iterable[Any] = matrix[matrix["stratum"] == "all"].itertuples()
    for row in rows:
        shares = (row.gain_hv, row.gain_av, row.share_better, row.share_worse)
        interval = _interval(row.gain_low, row.gain_high)
        counts = (str(row.n_events), str(row.infeasible))
        about = (row.followers, row.form, _SHORT[row.accounting]) if several else (row.form, row.accounting)
        gains = (_percent(row.gain), interval, _percent(row.gain_incremental))
        table.add_row(*about, *counts, *gains, *(_percent(s, 1) for s in shares))
    return table


def _why_no_interval(matrix: pd.DataFrame) -> str:
    """The end of a caption: why rows have no interval, each reason once."""
    whole = matrix[(matrix["stratum"] == "all") & matrix["gain_low"].isna() & matrix["gain"].notna()]
    return "".join(f"; {reason}" for reason in dict.fromkeys(no_interval(n) for n in whole["n_clusters"]))


def multiverse_table(table: pd.DataFrame) -> Table:
    """The specification curve as a table. table: ``multiverse`` by gain."""
    found = _table(
        "Multiverse: gain of the local optimum over the benchmark under every choice, fixed end speed, in %",
        "added: of the losses above those without a lane change (accounting equal)",
    )
    found.add_column("choice", no_wrap=True)
    for heading in ("events", "inf.", "cont.", "gain", "interval", "added"):
        found.add_column(heading, justify="right", no_wrap=True)
    rows: Iterable[Any] = table.itertuples()
    for row in rows:
        counts = (str(row.n_events), str(row.infeasible), str(row.contacts))
        gains = (_percent(row.gain), _interval(row.gain_low, row.gain_high), _percent(row.gain_incremental))
        found.add_row(str(row.variant), *counts, *gains)
    return found


_BOARD: Final = (
    ("n_planned", "plans", 0),
    ("n_contacts", "contacts", 0),
    ("n_violating", "break", 0),
    ("n_faulty", "faults", 0),
    ("loss_av", "AV", 2),
    ("loss_hv", "HV", 2),
    ("loss_total", "both", 2),
    ("min_gap_m", "gap", 1),
    ("max_drac", "DRAC", 2),
    ("rmse_lateral_m", "rmse y", 3),
)


def leaderboard_table(board: pd.DataFrame) -> Table:
    """Our policies and other people's planners on the same events, accounting equal, the lowest loss first."""
    events, common = int(board["n_events"].max()), int(board["n_common"].max())
    table = _table(
        f"Planners side by side, {events} events, accounting equal",
        f"losses, gap, DRAC, tracking error: means over the {common} events that all plan without contact",
    )
    table.add_column("planner", no_wrap=True)
    for _, heading, _ in _BOARD:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in board.to_dict("records"):
        cells = (_decimal(row[name], digits) for name, _, digits in _BOARD)
        table.add_row(str(row["policy"]), *cells)
    return table


def _decimal(value: float, digits: int) -> str:
    return "-" if pd.isna(value) else f"{value:.{digits}f}"


def price_words(price: pd.DataFrame) -> str:
    """What the safety profile costs, in a line: gains under both profiles on the events feasible under both."""
    rows = price[price["accounting"] == names.PRIMARY_ACCOUNTING]
    if rows.empty:
        return "The price of safety was not asked for (studies.safety_sample = 0), or no event was planned."
    said = []
    for form, of_form in rows.groupby("form", sort=False):
        cells = [
            f"{row.safety} {_percent(row.gain)} %{_of_added(row.gain_incremental)} ({row.infeasible} of "
            f"{row.n_events} infeasible)"
            for row in cast(Iterable[Any], of_form.itertuples())
        ]
        said.append(
            f"{form} end speed, {of_form['n_both'].iloc[0]} events feasible under both: {', '.join(cells)}"
        )
    return f"The price of safety, gain under each profile: {'; '.join(said)}."


def _of_added(gain: float) -> str:
    """The gain of what the lane change adds to the loss; nothing where it adds none."""
    return f", {_percent(gain)} % of what the change adds" if np.isfinite(gain) else ""


def lcm_table(summary: pd.DataFrame) -> Table:
    """Our fitted LCM parameters beside the paper's Table 3: quantiles and mean of all fitted followers."""
    table = _table(
        "LCM parameters, ours / paper's Table 3", "bound: share of fits with the parameter on a bound, %"
    )
    table.add_column("quantity", no_wrap=True)
    for heading in ("fits", "25 %", "50 %", "75 %", "mean", "bound"):
        table.add_column(heading, justify="right", no_wrap=True)
    rows: Iterable[Any] = summary[summary["group"] == "all"].itertuples()
    for row in rows:
        pairs = (
            (row.q25, row.paper_q25),
            (row.q50, row.paper_q50),
            (row.q75, row.paper_q75),
            (row.mean, row.paper_mean),
        )
        cells = [_beside(ours, paper) for ours, paper in pairs]
        table.add_row(row.quantity, str(row.n), *cells, _percent(row.share_at_bound, 1))
    return table


def prediction_table(summary: pd.DataFrame) -> Table | str:
    """How each follower model predicts HV 1 behind the recorded lane changer; a sentence where nobody is in view.

    summary: ``prediction_summary``.
    """
    rows = [(row_of(summary, m, SHORT), row_of(summary, m, LONG)) for m in labels.in_order(summary["model"])]
    if all(short is None for short, _ in rows):
        return f"Followers: none is in view for {SHORT:g} s behind the recorded lane changer; none is predicted."
    table = _table(
        "Followers: each model behind the recorded lane changer",
        "skill = 1 - ratio of mean absolute errors of speed, against constant speed and the best naive model; "
        f"over {SHORT:g} s: interval, bias in m/s, peak braking simulated / recorded in m/s², mean absolute "
        "error of loss, hits = contacts simulated / recorded; * = plans",
    )
    table.add_column("model", overflow="fold")
    headings = (
        "n",
        f"skill\n{SHORT:g} s",
        "interval",
        f"naive\n{SHORT:g} s",
        f"skill\n{LONG:g} s",
        f"naive\n{LONG:g} s",
        "bias",
    )
    for heading in (*headings, "braking", "loss", "hits"):
        table.add_column(heading, justify="right", no_wrap=True)
    for short, long in rows:
        if short is not None:
            table.add_row(f"{short.model}{' *' * bool(short.default)}", *_predicted(short, long))
    return table


def prediction_lines(summary: pd.DataFrame, doses: pd.DataFrame) -> list[str]:
    """In how many classes each model answers as drivers do, and the skill of the one that plans by recording.

    summary: ``prediction_summary``; doses: ``dose_response``.
    """
    within, said = within_band(doses, SHORT), recordings_say(summary, SHORT)
    lines = (
        [f"Classes of dose-response within the band of the recorded drivers after {SHORT:g} s:"] if within else []
    )
    lines += [f"  {model}: {within[model]}" for model in labels.in_order(summary["model"]) if model in within]
    lines += [f"Skill after {SHORT:g} s against constant speed, model that plans:"] if said else []
    return lines + [f"  recording {name}: {text}" for name, text in said]


def aims_table(aims: pd.DataFrame) -> Table:
    """What the model that plans has to reach, and whether it does. aims: ``prediction_aims``."""
    table = _table("Aims for followers that can be believed, model that plans", "")
    table.add_column("aim", no_wrap=True)
    for heading in ("after", "reached"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("wanted", "verdict"):
        table.add_column(heading, overflow="fold")
    for row in aim_rows(aims[aims["default"].astype(bool)]).to_dict("records"):
        table.add_row(row["title"], f"{row['horizon_s']:g} s", row["said"], row["wanted"], row["verdict"])
    return table


def _predicted(short: Any, long: Any) -> Iterator[str]:
    yield str(short.n_events)
    yield _fixed(short.skill_constant)
    low, high = short.skill_constant_low, short.skill_constant_high
    yield "-" if np.isnan(low) else f"{_fixed(low)}..{_fixed(high)}"
    yield _fixed(short.skill_naive)
    yield from map(_fixed, _skills(long))
    yield _fixed(short.bias)
    yield f"{_fixed(short.peak_decel_simulated)}/{_fixed(short.peak_decel_recorded)}"
    yield _fixed(short.loss_error)
    yield f"{short.contacts}/{short.contacts_recorded}"


def _skills(row: Any) -> tuple[float, float]:
    return (np.nan, np.nan) if row is None else (row.skill_constant, row.skill_naive)


def _fixed(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"


def _table(title: str, caption: str) -> Table:
    return Table(title=title, caption=caption, box=box.SIMPLE, padding=(0, 1, 0, 0), title_justify="left")


def _interval(low: float, high: float) -> str:
    return "-" if np.isnan(low) else f"{_percent(low)}..{_percent(high)}"


def _beside(ours: float, paper: float) -> str:
    return f"{_number(ours)} / {_number(paper)}" if not np.isnan(paper) else _number(ours)


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3g}"


def _percent(share: float, digits: int = 2) -> str:
    return "-" if np.isnan(share) else f"{100.0 * share:.{digits}f}"


_SHORT = {names.PAPER: "paper", names.FOLLOWER_HORIZON: "follower", names.EQUAL: "equal"}
_MARKS = {"holds": "yes", "fails": "NO", "unchanged": "=", "no_plan": "no plan", "not_valid": "n/v"}


def claims_table(claims: pd.DataFrame) -> Table:
    """The claims of the paper by form and accounting. claims: rows of ``claims``."""
    table = Table(
        title="Claims of the paper under the default options",
        caption="yes = holds, NO = the opposite, = : nothing changes; n/v: a plan collides, or is on a bound of\n"
        "T or speed; n/m: in n of the m variants with both plans; sc. = scenario (2/15: AV at 15 m/s)",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        title_justify="left",
        caption_justify="left",
    )
    table.add_column("claim", no_wrap=True)
    table.add_column("sc.", no_wrap=True)
    cells = [(form, accounting) for form in names.FORMS for accounting in names.ACCOUNTINGS]
    for form, accounting in cells:
        table.add_column(f"{form}\n{_SHORT[accounting]}", no_wrap=True)
    found = claims.set_index(["claim", "scenario", "form", "accounting"])
    for claim, words in labels.CLAIMS.items():
        for scenario in dict.fromkeys(claims.loc[claims["claim"] == claim, "scenario"]):
            rows: list[Any] = [found.xs((claim, scenario, *cell)) for cell in cells]
            table.add_row(words, scenario.replace("_", "/"), *map(_cell, rows))
    return table


def _cell(row: pd.Series) -> str:
    mark = _MARKS[row["default_verdict"]]
    return f"{mark} {row['holds']}/{row['cells']}" if row["cells"] > 1 else mark
