"""Pipelines: every shipped one loads, faults are one line that says what is allowed."""

import tomllib

import pytest

from highd_lc.io import settings as settings_file
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.sections import Section
from highd_lc.vocab.settings import Settings

SHIPPED = sorted(path.stem for path in settings_file.pipelines_folder().glob("*.toml") if path.stem != "scenarios")


def missing(model: type[Section], values: dict, where: str = "") -> list[str]:
    found = []
    for name, field in model.model_fields.items():
        key = field.alias or name
        if key not in values:
            found.append(f"{where}{key}")
        elif isinstance(values[key], dict):
            found += missing(field.annotation, values[key], f"{where}{key}.")
    return found


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_pipelines_load(name):
    assert settings_file.load(settings_file.find_pipeline(name)).name == name


def test_the_full_study_names_every_number_at_its_default():
    path = settings_file.find_pipeline("highd")
    assert missing(Settings, tomllib.loads(path.read_text())) == []
    assert settings_file.load(path) == Settings(name="highd")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = -1", ("seed", "-1", "greater than or equal to 0")),
        ("[validate.loss]\nomega_av = 1.5", ("validate.loss.omega_av", "1.5", "less than 1")),
        ("[calibrate]\noptimiser = 'anneal'", ("calibrate.optimiser", "'ga'", "'screen'")),
        ("[calibrate]\npopulatoin = 10", ("calibrate.populatoin", "unknown", "population")),
        ("[nonsense]\na = 1", ("nonsense", "unknown", "calibrate")),
        ("seed = ", ("not valid TOML",)),
        ("[calibrate]\nmodels = ['owl_fit']", ("calibrate.models", "'owl_fit'", "own_fit", "@moment")),
        ("[validate.followers]\nmodel = 'own_fit+luck'", ("validate.followers.model", "'own_fit+luck'")),
        ("[validate.followers]\nalso = ['made_models:hasty']", ("validate.followers.also", "made_models:hasty")),
        ("[calibrate]\nmodels = ['made_models:crowded']", ("calibrate.models", "7 parameters, at most 6")),
        (
            "[validate.followers]\nmodel = 'population-memory'\npopulation = 'p.toml'",
            ("validate.followers.population = p.toml", "population-memory"),
        ),
        (
            "[validate.studies]\nhorizons_s = [5.0, 20.0]",
            ("studies.horizons_s", "20", "loss.horizon_s = 15"),
        ),
        (
            "[validate]\nloss.horizon_s = 6\nstudies.horizons_s = [8.0]",
            ("validate.studies.horizons_s = 8", "= 6"),
        ),
        (
            "[validate]\nloss.horizon_s = 2\nplanner.T_min = 3",
            ("validate.planner.T_min = 3", "horizon_s = 2"),
        ),
        ("[validate]\nloss.horizon_s = 1.5", ("validate.loss.horizon_s", "1.5", "greater than or equal to 2")),
    ],
)
def test_a_bad_setting_names_file_key_and_what_is_allowed(tmp_path, text, words):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        settings_file.load(path)
    assert str(path) in str(caught.value)
    assert all(word in str(caught.value) for word in words)
    assert "\n" not in str(caught.value)


def test_an_unknown_pipeline_lists_the_known_ones():
    with pytest.raises(SettingsError, match="demo, highd, paper_literal"):
        settings_file.find_pipeline("nowhere")


def test_digest_depends_on_values_alone():
    assert settings_file.digest(Settings()) == settings_file.digest(Settings())
    assert settings_file.digest(Settings()) != settings_file.digest(Settings(seed=2))


def test_report_changes_are_checked():
    assert settings_file.with_report(Settings(), {"png": "none"}).report.png == "none"
    with pytest.raises(SettingsError, match=r"report\.png = 'some'"):
        settings_file.with_report(Settings(), {"png": "some"})


@pytest.mark.parametrize("H", [2.0, 5.0, 8.0, 60.0])
def test_a_shorter_horizon_needs_no_other_setting(tmp_path, H):
    path = tmp_path / "short.toml"
    path.write_text(f"[validate.loss]\nhorizon_s = {H}")
    assert settings_file.load(path).validation.loss.horizon_s == H
