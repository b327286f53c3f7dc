"""The scenarios' stage: tables, figures and pages are written whole, and say the same as each other."""

import re

import pandas as pd
import pytest

from highd_lc.io import artefacts
from highd_lc.io import settings as settings_file
from highd_lc.reporting.html import TO_SCENARIOS
from highd_lc.stages import scenarios
from highd_lc.vocab.scenarios import ScenarioSettings
from highd_lc.vocab.tables.scenarios import SCENARIO_TABLES

FIGURES = ("plans", "followers", "losses", "weights", "speed_maps", "rectangle", "scenario_3", "growth")


def small() -> ScenarioSettings:
    shipped = settings_file.load_pipeline("scenarios", ScenarioSettings)
    values = shipped.model_dump()
    values["options"] |= {"planned_followers": 10, "horizon_s": 5.0}
    values["scenario_2"] |= {"followers": 14, "duration_s": 320.0}
    values["scenario_3"]["av_speeds"] = (25.0,)
    values["planner"] |= {"x_nodes": 8, "v_nodes": 4, "T_nodes_free": 8, "zoom_starts": 1}
    values["variants"] = {"bumpers": {"gap_reading": "bumpers"}}
    values["sweep"] = {"v_ref_av": (30.0, 33.54)}
    values["omegas"] = (0.1, 0.5, 1.0)
    return ScenarioSettings.model_validate(values)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return scenarios.run(small(), tmp_path_factory.mktemp("scenarios"), sweep=True)


def test_every_table_is_written_and_read_back(made):
    names = {table.name for table in SCENARIO_TABLES} - {"recorded_state"}
    assert set(made.frames) == names
    for name in names:
        back = artefacts.read_file(made.page.parent / f"{name}.parquet", name)
        assert len(back) == len(made.frames[name]) > 0


def test_a_sweep_with_the_default_combination_has_its_verdicts(made):
    """The default options are one of the sweep's combinations: same verdicts as the default variant."""
    index = ["claim", "scenario", "form", "accounting"]
    swept = made.frames["sweep_claims"].set_index(index)["default_verdict"]
    named = made.frames["claims"].set_index(index)["default_verdict"]
    assert len(swept) > 80
    assert (swept == named.loc[swept.index]).all()


def test_the_closest_cell_is_one_cell(made):
    closest = made.frames["closest"].set_index("scenario")
    assert list(closest.index) == ["1", "2_15", "2_20", "3"]
    assert (closest["reproduced"] <= closest["near"]).all()
    assert (closest["near"] <= closest["numbers"]).all()
    assert closest.loc["1", "numbers"] == 15


def test_figures_and_pages_are_there(made):
    for name in FIGURES:
        data = (made.page.parent / "figures" / f"{name}.png").read_bytes()
        assert data.startswith(b"\x89PNG")
        assert len(data) > 10_000
    assert not list(made.page.parent.rglob("*.tmp"))


@pytest.mark.parametrize("page", ["index.html", "ledger.html"])
def test_pages_ask_for_nothing_outside(made, page):
    text = (made.page.parent / page).read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="(?:https?:)?//', text)
    assert "nan" not in re.sub(r"<svg.*?</svg>|<style.*?</style>", "", text, flags=re.S).lower().split()


def test_ledger_page_shows_every_number(made):
    text = (made.page.parent / "ledger.html").read_text(encoding="utf-8").replace("−", "-")
    for value in made.frames["ledger"]["published"]:
        assert f"{value:.2f}" in text


def test_table_2_from_the_printed_table_1(made):
    state = made.frames["traffic_state"]
    flows = state[state["measure"] == "flow"]
    assert (flows["from_table_1"] - flows["published"]).abs().max() <= 0.006


def test_our_table_2_is_edie_of_our_table_1(made):
    totals = made.frames["rectangle"].groupby(["scenario", "policy"])[["time_s", "distance_m"]]
    totals = totals.sum(min_count=1)
    state = made.frames["traffic_state"].set_index(["scenario", "policy", "measure"])["ours"]
    for (scenario, policy), row in totals.iterrows():
        # At 15 m/s HV_1 drives into the AV where the 10 m are between centres: no number is kept.
        assert row.isna().all() == (scenario == "2_15")
        assert state[scenario, policy, "flow"] == pytest.approx(3600 * row["distance_m"] / 3375.0, nan_ok=True)
        assert state[scenario, policy, "speed"] == pytest.approx(
            3.6 * row["distance_m"] / row["time_s"], nan_ok=True
        )


def test_ledger_agrees_with_the_cells(made):
    cells, ledger = made.frames["scenario_cells"], made.frames["ledger"].set_index("key")
    default = cells[
        (cells["variant"] == "default") & (cells["form"] == "fixed") & (cells["accounting"] == "follower_horizon")
    ]
    row = default[(default["scenario"] == "1") & (default["omega_av"] == 0.5)].iloc[0]
    assert ledger.loc["1:local_optimum:loss_total", "ours"] == row["loss_total"]
    assert ledger.loc["1:local_optimum:ttt_difference_s", "ours"] == row["ttt_difference_s"]


def test_the_same_run_gives_the_same_tables_and_links_a_report_above(made, undrawn, tmp_path):
    (tmp_path / "index.html").write_text(f"<nav>{TO_SCENARIOS.room}</nav>")
    again = scenarios.run(small(), tmp_path / "scenarios", sweep=True, threads=1)
    for name, frame in made.frames.items():
        pd.testing.assert_frame_equal(frame, again.frames[name])
    assert (tmp_path / "index.html").read_text() == f"<nav>{TO_SCENARIOS.link}</nav>"
    for page in ("index.html", "ledger.html"):
        assert 'href="../index.html"' in (tmp_path / "scenarios" / page).read_text(encoding="utf-8")
        assert 'href="../index.html"' not in (made.page.parent / page).read_text(encoding="utf-8")


def test_markdown_ledger_holds_the_claims(made):
    text = (made.page.parent / "ledger.md").read_text(encoding="utf-8")
    assert "## Claims" in text
    assert "50.06" in text
    assert "| total loss falls |" in text
