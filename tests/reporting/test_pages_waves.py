"""Waves behind real lane changes in words: how far, how sure, and nothing where nothing passes on."""

import pandas as pd
from sample_prediction import DEFAULT, field, waves

from highd_lc.reporting.pages_waves import wave_sections, wave_words


def told(table: pd.DataFrame) -> str:
    return " ".join(wave_words(table, DEFAULT))


def test_words_hold_speeds_delays_and_how_sure_they_are():
    text = told(waves())
    assert "Observed: in 60 % of 40 pairs" in text
    assert "1.5 s later on average; it moves at −4.0 m/s (−4.5 to −3.5) along the road, upstream" in text
    assert "Over the 12 pairs with both they react 0.5 s later than the drivers did (0.3 to 0.7)" in text
    assert "a difference beyond chance" in text
    assert "unrelated vehicles something seems to pass on in 20 %, against 60 % observed" in text
    assert "about 50 % are waves" in text
    assert "Intervals are over 6 recordings." in text


def test_a_speed_whose_interval_holds_0_has_no_direction():
    table = waves()
    table.loc[table["source"] == "observed", "speed_high"] = 1.0
    assert "(−4.5 to 1.0) along the road, upstream or downstream cannot be told" in told(table)


def test_few_recordings_give_no_interval_and_the_words_say_so():
    text = told(waves(intervals=False))
    assert "nan" not in text
    assert "With 6 recordings there is no interval." in text
    assert "beyond chance" not in text


def test_what_chance_does_as_often_is_no_wave():
    table = waves()
    table.loc[table["source"] == "unrelated", "share_passed"] = 0.7
    assert "cannot be told from chance" in told(table)


def test_a_lag_difference_whose_interval_holds_0_is_none():
    table = waves()
    table.loc[table["source"] == DEFAULT, "lag_difference_low"] = -0.1
    assert "no difference that could be told" in told(table)


def test_nothing_that_passes_on_is_said():
    table = waves()
    table["passed"] = 0
    assert "of waves nothing can be said" in told(table)


def test_the_section_holds_table_and_figure_and_is_none_without_pairs():
    (section,) = wave_sections(waves(), field(), DEFAULT)
    assert section.figure is not None
    assert section.tables[0].rows[0][0] == "Observed"
    assert len(section.tables[0].rows) == 3
    assert not list(wave_sections(waves().iloc[:0], field(), DEFAULT))
    (bare,) = wave_sections(waves(), field().iloc[:0], DEFAULT)
    assert bare.figure is None
