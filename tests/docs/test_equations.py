"""What docs/equations.md states is what the code holds: published tables, defaults of the settings, reasons."""

import re
from pathlib import Path

import pytest

from highd_lc.vocab import names, published
from highd_lc.vocab.driver import (
    LOWER_BOUNDS,
    PARAMETERS,
    SIMULATION,
    TABLE3_MEANS,
    TABLE3_QUANTILES,
    UPPER_BOUNDS,
)
from highd_lc.vocab.settings import Settings

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "equations.md").read_text("utf-8")
COLUMNS = [
    (scenario, policy) for scenario in ("2_15", "2_20") for policy in (names.BENCHMARK, names.LOCAL_OPTIMUM)
]
DEFAULTS = Settings()


def section(number: str) -> str:
    """The text below a numbered heading, up to the next heading."""
    return re.search(rf"^#+ {re.escape(number)}\.? .*?\n(.*?)(?=^#)", TEXT, re.MULTILINE | re.DOTALL)[1]


def row(number: str, label: str) -> list[float]:
    """The numbers in a row of a section's table."""
    (cells,) = re.findall(rf"^\| {label} \|(.*)\|$", section(number), re.MULTILINE)
    return [float(value) for value in re.findall(r"-?\d+\.?\d*", cells)]


def numbers(number: str) -> set[float]:
    return {float(value) for value in re.findall(r"\d+(?:\.\d+)?(?:e\d)?", section(number).replace(",", ""))}


@pytest.mark.parametrize("name", PARAMETERS)
def test_table_3(name):
    printed = [getattr(TABLE3_QUANTILES[q], name) for q in (0.25, 0.5, 0.75)] + [getattr(TABLE3_MEANS, name)]
    assert row("9.10", name)[:4] == printed


@pytest.mark.parametrize(
    ("written", "meant"),
    [("v_desire", ["v_desire"]), ("A, b, B", ["A", "b", "B"]), ("tau", ["tau"]), ("L", ["L"])],
)
def test_the_bounds_of_a_fit(written, meant):
    (interval,) = re.findall(rf"\b{written} \[([\d.]+), ([\d.]+)\]", section("9.3"))
    for name in meant:
        assert [float(end) for end in interval] == [getattr(LOWER_BOUNDS, name), getattr(UPPER_BOUNDS, name)]


@pytest.mark.parametrize("rank", range(1, 11))
def test_table_1(rank):
    cells = [published.TABLE_1[column][rank - 1] for column in COLUMNS]
    assert row("13.4", f"HV_{rank}") == [value for cell in cells for value in (cell.time, cell.distance)]


def test_the_totals_of_table_1():
    cells = [published.TABLE_1_TOTALS[column] for column in COLUMNS]
    assert row("13.4", "total") == [value for cell in cells for value in (cell.time, cell.distance)]


@pytest.mark.parametrize(
    ("label", "quantity"),
    [("flow", "flow_veh_h"), ("speed", "speed_km_h"), ("density", "density_veh_km"), ("total loss", "loss_total")],
)
def test_table_2(label, quantity):
    found = {(n.scenario, n.policy): n.value for n in published.SCENARIO_2 if n.quantity == quantity}
    assert row("13.5", label) == [found[column] for column in COLUMNS]


@pytest.mark.parametrize(("number", "printed"), [("13.2", published.SCENARIO_1), ("13.6", published.SCENARIO_3)])
def test_every_printed_number_of_scenarios_1_and_3_is_stated(number, printed):
    assert {one.value for one in printed} <= numbers(number)
    assert number != "13.6" or set(published.SCENARIO_3_WEIGHTS) <= numbers(number)


@pytest.mark.parametrize(
    ("number", "stated"),
    [
        ("3.7", SIMULATION.as_array().tolist()),
        ("4.2", [DEFAULTS.validation.loss.comfort_scale, DEFAULTS.validation.loss.efficiency_scale]),
        ("4.6", [DEFAULTS.validation.loss.horizon_s, *DEFAULTS.validation.studies.horizons_s]),
        ("5.1", [getattr(DEFAULTS.validation.constraints, k) for k in ("v_max", "v_min", "acceleration", "jerk")]),
        ("2.1", [DEFAULTS.validation.planner.T_min, DEFAULTS.validation.planner.T_max]),
        ("6.2", [DEFAULTS.validation.planner.human_smoothing_s]),
        ("7.3", [DEFAULTS.validation.studies.population, DEFAULTS.validation.studies.generations]),
        ("9.1", [DEFAULTS.ingest.trim_ends_m, DEFAULTS.calibrate.min_window_s]),
        ("9.5", [getattr(DEFAULTS.calibrate, f"{k}_probability") for k in ("crossover", "mutation")]),
        ("9.5", [DEFAULTS.calibrate.population, DEFAULTS.calibrate.generations]),
        ("9.6", [DEFAULTS.calibrate.screened]),
        ("11.2", [getattr(DEFAULTS.extract, k) for k in ("lateral_speed_mps", "lateral_acceleration_mps2")]),
        ("11.2", [getattr(DEFAULTS.extract, k) for k in ("persistence_s", "clearance_m", "min_shift_m")]),
        ("11.3", [DEFAULTS.extract.max_link_m, DEFAULTS.extract.max_followers]),
        ("12.2", [DEFAULTS.validation.statistics.bootstrap, 100 * DEFAULTS.validation.statistics.confidence]),
    ],
)
def test_the_stated_defaults_are_those_of_the_settings(number, stated):
    assert set(stated) <= numbers(number)


@pytest.mark.parametrize(
    ("label", "keys"),
    [
        ("R: along, across, v_r times heading", ("weight_longitudinal", "weight_lateral", "weight_heading")),
        ("Q: increment of speed, of steering", ("weight_speed_increment", "weight_steering_increment")),
        ("speed", ("speed_min", "speed_max")),
        ("change of speed", ("acceleration_max",)),
        ("steering, rate", ("steering_max", "steering_rate_max")),
    ],
)
def test_the_controllers_weights_and_bounds(label, keys):
    tracking = DEFAULTS.validation.tracking
    assert row("8.4", label)[: len(keys)] == [getattr(tracking, key) for key in keys]


def test_the_reasons_of_the_funnel_in_their_order():
    assert tuple(re.findall(r"`(\w+)`", section("11.4"))) == names.REASONS


def test_the_statuses_of_a_fit():
    assert tuple(re.findall(r"`(\w+)`", section("9.8")))[:4] == names.FIT_STATUSES
