"""The scenarios' claims on the terminal."""

import pandas as pd
from rich import box
from rich.table import Table

from highd_lc.reporting.pages_scenarios import CLAIM_WORDS
from highd_lc.vocab import names

_SHORT = {names.PAPER: "paper", names.FOLLOWER_HORIZON: "follower", names.EQUAL: "equal"}
_MARKS = {"holds": "yes", "fails": "NO", "unchanged": "=", "no_plan": "no plan"}


def claims_table(claims: pd.DataFrame) -> Table:
    """The claims of the paper by form and accounting. claims: rows of ``claims``."""
    table = Table(
        title="Claims of the paper under the default options",
        caption="yes = holds, NO = the opposite, = : nothing changes; n/m: in n of the m variants with both\n"
        "plans; sc. = scenario (2/15: scenario 2, AV at 15 m/s)",
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
    for claim, words in CLAIM_WORDS.items():
        for scenario in dict.fromkeys(claims.loc[claims["claim"] == claim, "scenario"]):
            rows = [found.loc[(claim, scenario, *cell)] for cell in cells]
            table.add_row(words, scenario.replace("_", "/"), *map(_cell, rows))
    return table


def _cell(row: pd.Series) -> str:
    mark = _MARKS[row["default_verdict"]]
    return f"{mark} {row['holds']}/{row['cells']}" if row["cells"] > 1 else mark
