"""The page on the choice of the start: its numbers are those of the tables."""

import numpy as np
import pandas as pd

from highd_lc.reporting.drawing import DARK
from highd_lc.reporting.figures_population import start_figure
from highd_lc.reporting.pages_population import StartTables, start_page
from highd_lc.vocab import names
from highd_lc.vocab.policy import CHOOSING_START
from highd_lc.vocab.tables import TABLES


def tiles():
    rows = []
    for policy in CHOOSING_START:
        for spacing, closing in ((np.nan, np.nan), (0.0, np.nan), (10.0, -2.0), (20.0, 4.0)):
            rows.append(
                {
                    "policy": policy, "accounting": names.EQUAL, "spacing_low_m": spacing,
                    "closing_low_mps": closing, "n_events": 7, "share_waiting": 0.25, "share_other_gap": 0.125,
                    "mean_delay_s": 0.75, "saved_objective": 0.0321, "saved_av": -0.011, "saved_hv": 0.054,
                    "saved_total": 0.0123, "share_events": 0.3,
                }
            )  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["start_map"].column_names))


def foresight():
    rows = [
        {
            "policy": names.LOCAL_OPTIMUM_START, "knowledge": "replanned", "n_events": 25, "no_plan": 1,
            "touching": 2, "n_compared": 22, "mean_delay_s": 0.5, "share_waiting": 0.4, "objective": 100.0,
            "objective_recorded": 97.53, "value_of_information": 0.0247, "value_low": 0.01, "value_high": 0.04,
        }
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["foresight_summary"].column_names))


def test_the_page_shows_the_tables_numbers():
    page = start_page(StartTables(tiles(), foresight()))
    for shown in ("25.0", "12.5", "3.21", "1.23", "2.47", "a plan every 0.5 s"):
        assert shown in page


def test_a_run_without_starts_says_so():
    empty = StartTables(tiles().iloc[:0], foresight().iloc[:0])
    assert "No start was chosen" in start_page(empty)


def test_the_figure_counts_events_in_their_tiles():
    figure = start_figure(tiles())
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["7", "7", "7"]


def test_numbers_in_tiles_keep_their_colour_in_the_dark():
    # A page replaces black by its own ink, which is pale on a dark ground; so are the tiles.
    page = start_page(StartTables(tiles().assign(share_waiting=0.0, saved_objective=0.0), foresight()))
    assert page.count(f"fill: {DARK}") == 3 * 4
