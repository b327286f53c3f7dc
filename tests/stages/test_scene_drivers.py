"""Who drives the followers of a scene under each follower model, and what is said where a model is missing."""

import numpy as np
import pandas as pd
import pytest
from made_tables import EVENT, LENGTH, PLACE, rows, tables

from highd_lc.drivers.population import SPREAD
from highd_lc.io import artefacts
from highd_lc.planning.scene import Followers
from highd_lc.stages.scene_drivers import read_drivers
from highd_lc.stages.scenes import driven_by, scene_makers
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.settings import Settings, ValidateSettings
from highd_lc.vocab.tables import TABLES

BEHAVIOUR = ("memory", "relaxation", "need", "a_0", "drift", "moment")
ABOUT = Provenance("settings", {}, 1, "code")


def model_row(rank=1, **changes):
    """A row of ``follower_models``; every number differs from every other."""
    numbers = dict(zip(PARAMETERS, (26.0, 0.8, 2.0, 1.4, 3.4, 8.6), strict=True))
    numbers |= {"L_before": 7.1, "memory_s": 6.5, "relaxation_s": 0.0, "moment": 0.4, "need": 1.5}
    numbers |= {"a_0": 0.25, "drift": -0.125}
    made = {"event_id": EVENT, "recording_id": 1, "follower": rank, "vehicle_id": 4, "model": names.POPULATION}
    made |= {"parameters": {}, "spread": dict(zip(PARAMETERS, SPREAD, strict=True))}
    return made | {"family": names.LCM, "fold": "not 1"} | numbers | changes


def made_scenes(**changes):
    """The scene tables of one event with two follower models, and its scene of the default one."""
    made = tables({role: rows(role) for role in PLACE if role[-1] not in "23"})
    own = {name: np.array([value]) for name, value in model_row(**changes).items()}
    made.drivers[names.POPULATION] = {(EVENT,): own}
    ((_, make),) = scene_makers(made, ValidateSettings())
    return made, make()


def test_a_fitted_driver_is_the_bare_lcm_with_l_behind_the_av():
    _, scene = made_scenes()
    expected = TABLE3_MEANS.as_array()
    expected[5] += LENGTH[1] - 5.0
    np.testing.assert_allclose(scene.followers.parameters, [expected])
    assert scene.followers.L_no_change == pytest.approx(TABLE3_MEANS.L + LENGTH[3] - 5.0)
    assert scene.followers.family == names.LCM
    assert all(getattr(scene.followers, name) is None for name in BEHAVIOUR)


@pytest.mark.parametrize("family", names.FAMILIES)
def test_a_model_drives_by_its_own_rows(family):
    made, scene = made_scenes(family=family)
    followers = driven_by(scene, names.POPULATION, made).followers
    np.testing.assert_array_equal(followers.parameters, [[26.0, 0.8, 2.0, 1.4, 3.4, 8.6]])
    assert (followers.L_no_change, followers.family) == (7.1, family)
    found = [getattr(followers, name).tolist() for name in BEHAVIOUR]
    assert found == [[6.5], [0.0], [1.5], [0.25], [-0.125], [0.4]]
    np.testing.assert_array_equal(followers.spread, [SPREAD])
    for name in ("x", "y", "v", "length", "width"):
        np.testing.assert_array_equal(getattr(followers, name), getattr(scene.followers, name))


def test_back_to_the_fits_nothing_of_another_model_stays():
    made, scene = made_scenes()
    back = driven_by(driven_by(scene, names.POPULATION, made), names.OWN_FIT, made).followers
    for name in Followers.__dataclass_fields__:
        np.testing.assert_equal(getattr(back, name), getattr(scene.followers, name))


def test_a_model_that_is_not_there_is_named(tmp_path):
    fits = pd.DataFrame({"event_id": [EVENT, EVENT], "follower": [1, 2]})
    with pytest.raises(ArtefactError, match=r"follower_models.parquet: not found; `highd-lc run` makes it"):
        read_drivers(tmp_path, 1, fits, names.POPULATION)
    written = pd.DataFrame([model_row()])[list(TABLES["follower_models"].column_names)]
    table = artefacts.to_arrow("follower_models", written, ABOUT)
    artefacts.write(artefacts.path_of(tmp_path, "follower_models"), table)
    for model, count in ((names.POPULATION, 1), ("own_fit+memory", 0)):
        with pytest.raises(ArtefactError) as caught:
            read_drivers(tmp_path, 1, fits, model)
        assert f"model '{model}': {count} of the 2 followers of recording 01" in str(caught.value)
    assert read_drivers(tmp_path, 1, fits.iloc[:1], names.POPULATION)[EVENT,]["memory_s"].tolist() == [6.5]


@pytest.mark.parametrize(
    ("model", "parameters", "also", "also_sample", "expected"),
    [
        ("own_fit", "fitted", ["own_fit"], 500, ("own_fit",)),
        ("own_fit", "mean", ["own_fit"], 500, ("mean", "own_fit")),
        ("table3", "table3", [], 500, ("table3",)),
        ("population", "fitted", ["own_fit", "idm", "own_fit"], 20, ("population", "own_fit", "idm")),
        ("population", "fitted", ["own_fit"], 0, ("population",)),
    ],
)
def test_models_that_plan_come_once_each_the_default_first(model, parameters, also, also_sample, expected):
    followers = {"model": model, "also": also, "also_sample": also_sample}
    made = ValidateSettings.model_validate({"followers": followers, "planner": {"parameters": parameters}})
    assert made.follower_models == expected


@pytest.mark.parametrize(("model", "parameters"), [("population", "mean"), ("mean", "table3"), ("idm", "table3")])
def test_parameters_for_everybody_and_another_model_contradict_each_other(model, parameters):
    values = {"followers": {"model": model}, "planner": {"parameters": parameters}}
    with pytest.raises(ValueError, match=f"planner.parameters = {parameters}: only with followers.model ="):
        Settings.model_validate({"validate": values})
