"""Settings of the scenarios: the shipped file says every number, bad options are named where they stand."""

import tomllib

import pytest

from highd_lc.io import settings as settings_file
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.scenarios import ScenarioOptions, ScenarioSettings

SHIPPED = settings_file.find_pipeline("scenarios", ScenarioSettings)


def load(tmp_path, change=""):
    path = tmp_path / "other.toml"
    path.write_text(SHIPPED.read_text(encoding="utf-8") + change, encoding="utf-8")
    return settings_file.load_model(path, ScenarioSettings)


def test_shipped_file_states_every_option():
    values = tomllib.loads(SHIPPED.read_text(encoding="utf-8"))
    assert set(values["options"]) == set(ScenarioOptions.model_fields)


def test_defaults_of_the_model_are_those_of_the_file(tmp_path):
    assert load(tmp_path).options == ScenarioOptions()


def test_options_reach_the_planner(tmp_path):
    settings = load(tmp_path)
    planning = settings.planning(settings.with_options({"aggregation": "weighted", "horizon_s": 5.0}))
    assert planning.loss.aggregation == "weighted"
    assert planning.loss.horizon_s == 5.0
    assert planning.loss.v_ref_hv == 25.0
    assert planning.loss.efficiency_scale == 25.0
    assert planning.planner.after == "constant"
    assert planning.constraints.v_max == 30.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("\n[variants.odd]\nspacing_m = 1.0\n", ("variants.odd.spacing_m", "greater than 5")),
        ("\n[variants.odd]\nspaces = 1.0\n", ("variants.odd.spaces", "not permitted")),
        ("\n[whatever]\nx = 1\n", ("whatever", "unknown setting")),
    ],
)
def test_a_bad_option_is_named_where_it_stands(tmp_path, change, words):
    with pytest.raises(SettingsError) as caught:
        load(tmp_path, change)
    message = str(caught.value)
    assert "other.toml" in message
    assert "\n" not in message
    assert all(word in message for word in words)


def test_another_pipeline_is_refused_in_one_short_line():
    with pytest.raises(SettingsError, match=r"demo\.toml: omegas: missing$"):
        settings_file.load_model(settings_file.find_pipeline("demo"), ScenarioSettings)
