"""A follower model from ``follower_models`` plans, scores and is told of as the fits themselves."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from running import FIXTURES, validated

from highd_lc.core.lcm import moved_behind
from highd_lc.io import artefacts
from highd_lc.stages import validate
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Combination, Job, Provenance
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables import TABLES

MODEL = "own_fit@start"
ABOUT = Provenance("settings", {}, 1, "code")
KEY = ["event_id", "policy", "accounting"]


def settings(**followers):
    samples = ("sample", "start_sample", "foresight_sample", "solver_sample", "multibody_sample")
    few = {
        "studies": dict.fromkeys(samples, 0),
        "statistics": {"bootstrap": 100},
        "multiverse": {"sample": 0},
        "closed_loop": {"events": 0},
        "robust": {"sample": 0},
        "trajectories": "none",
    }
    return Settings.model_validate(
        {
            "calibrate": {"optimiser": "screen", "study_sample": 0, "models": ["own_fit"]},
            "validate": few | {"followers": followers},
        }
    )


def told_otherwise(work):
    """The fits of ``followers`` as rows of ``follower_models``."""
    fits, events = artefacts.read(work, "followers"), artefacts.read(work, "events").set_index("event_id")
    lengths = artefacts.read(work, "vehicles").set_index(["recording_id", "vehicle_id"])["length"]
    rows = []
    for fit in fits.to_dict("records"):
        leader = events.loc[fit["event_id"], "target_leader_id"]
        before = fit["L"]
        if fit["follower"] == 1 and pd.notna(leader):
            before = moved_behind(fit["L"], fit["leader_length_m"], lengths[fit["recording_id"], leader])
        rows.append(
            {name: fit[name] for name in ("event_id", "recording_id", "follower", "vehicle_id", *PARAMETERS[:-1])}
            | {"model": MODEL, "family": names.LCM, "fold": "", "L": fit["L_replay"], "L_before": before}
            | {
                "memory_s": 0.0,
                "relaxation_s": 0.0,
                "moment": 0.0,
                "need": np.inf,
                "a_0": 0.0,
                "drift": 0.0,
                "parameters": {},
                "spread": {},
            }
        )
    frame = pd.DataFrame(rows)[list(TABLES["follower_models"].column_names)]
    return artefacts.to_arrow("follower_models", frame, ABOUT)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    return validated(tmp_path_factory.mktemp("models"), (1,), settings(model=names.OWN_FIT))


def test_a_model_of_another_table_plans_as_the_fits_that_it_holds(work):
    wanted = settings(model=MODEL, also=[names.OWN_FIT])
    job = Job(1, FIXTURES, work, wanted, ABOUT)
    with pytest.raises(ArtefactError, match="follower_models: model 'own_fit@start': 0 of the"):
        validate.run(job)
    artefacts.write(artefacts.path_of(work, "follower_models"), told_otherwise(work))
    assert not validate.run(job).problems
    validate.combine(Combination((1,), work, wanted, ABOUT))
    for name in ("plans", "losses", "validation_matrix", "gain_map"):
        frame = artefacts.read(work, name)
        one, other = (
            frame[frame["followers"] == m].drop(columns="followers").reset_index(drop=True)
            for m in (MODEL, names.OWN_FIT)
        )
        assert len(one)
        pd.testing.assert_frame_equal(one, other, rtol=1e-9)
        if name == "validation_matrix":
            assert frame["followers"].iloc[0] == MODEL
    cross = artefacts.read(work, "cross_scores").set_index(["planned_with", "scored_with"])
    drop = ["form", "optimised", "scored"]
    own, others = (cross.loc[(MODEL, scored)].drop(columns=drop) for scored in (MODEL, names.OWN_FIT))
    np.testing.assert_allclose(own.to_numpy(float), others.to_numpy(float), rtol=1e-9)


def test_no_motions_are_written_where_none_are_wanted(work):
    assert artefacts.read_partition(work, "trajectories", 1).empty
    wanted = settings(model=names.OWN_FIT)
    every = wanted.model_copy(
        update={"validation": wanted.validation.model_copy(update={"trajectories": "sample"})}
    )
    validate.run(replace(Job(1, FIXTURES, work, wanted, ABOUT), settings=every))
    events = artefacts.read(work, "events", recording=1)["event_id"]
    assert set(artefacts.read_partition(work, "trajectories", 1)["event_id"]) == set(events)
