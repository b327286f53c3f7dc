"""The scenarios' claims on the terminal."""

import pandas as pd
from rich import box
from rich.table import Table

from highd_lc.reporting.pages_scenarios import CLAIM_WORDS, scenario_words
from highd_lc.vocab import names

_SHORT = {names.PAPER: "paper", names.FOLLOWER_HORIZON: "follower", names.EQUAL: "equal"}
_MARKS = {"holds": "yes", "fails": "NO", "unchanged": "=", "no_plan": "no plan"}


def claims_table(claims: pd.DataFrame) -> Table:
    """The claims of the paper by form and accounting. claims: rows of ``claims``."""
    table = Table(
        title="Claims of the paper under the default options (variants of them in which each holds)",
        caption="yes = holds, NO = the opposite, = : both plans alike; the count: of the variants with both plans",
        box=box.SIMPLE_HEAD,
        title_justify="left",
        caption_justify="left",
    )
    table.add_column("claim", no_wrap=True)
    table.add_column("scenario", no_wrap=True)
    cells = [(form, accounting) for form in names.FORMS for accounting in names.ACCOUNTINGS]
    for form, accounting in cells:
        table.add_column(f"{form}\n{_SHORT[accounting]}", no_wrap=True)
    found = claims.set_index(["claim", "scenario", "form", "accounting"])
    for claim, words in CLAIM_WORDS.items():
        for scenario in dict.fromkeys(claims.loc[claims["claim"] == claim, "scenario"]):
            rows = [found.loc[(claim, scenario, *cell)] for cell in cells]
            table.add_row(words, scenario_words(scenario), *map(_cell, rows))
    return table


def _cell(row: pd.Series) -> str:
    mark = _MARKS[row["default_verdict"]]
    return f"{mark} {row['holds']}/{row['cells']}" if row["cells"] > 1 else mark
