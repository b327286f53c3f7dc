"""The page on the choice of the start: its numbers are those of the tables."""

from sample_studies import foresight, tiles

from highd_lc.reporting.drawing import DARK
from highd_lc.reporting.figures_population import start_figure
from highd_lc.reporting.pages_population import StartTables, start_page


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
