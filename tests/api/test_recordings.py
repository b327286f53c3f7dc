"""Recordings, events and fits through the door are those of the commands."""

import gc
import tempfile

import numpy as np
import pandas as pd
import pytest

import highd_lc as lc
from highd_lc.drivers.population import PRIOR
from highd_lc.io import artefacts
from highd_lc.vocab import names


@pytest.fixture(scope="module")
def read(pipeline_run):
    return lc.read_recording(pipeline_run.data, 1)


@pytest.mark.parametrize(
    ("name", "table"), [("events", "events"), ("crossings", "crossings"), ("quality", "recordings")]
)
def test_tables_are_those_of_a_run(read, pipeline_run, name, table):
    theirs = artefacts.read(pipeline_run.work, table, recording=1).reset_index(drop=True)
    pd.testing.assert_frame_equal(getattr(read, name).reset_index(drop=True), theirs)


def test_events_have_their_roles_and_tracks(read):
    events = lc.lane_changes(read)
    assert [event.event_id for event in events] == read.events["event_id"].tolist()
    for event in events:
        tracks = event.tracks
        assert set(event.roles.items()) >= {("ego", int(event.about["ego_id"]))}
        for role, vehicle in event.roles.items():
            assert set(tracks.loc[tracks["role"] == role, "vehicle_id"]) == {vehicle}
        assert [one.rank for one in event.followers] == list(range(1, len(event.followers) + 1))
    assert lc.funnel(read)["usable"].sum() == len(events)


def test_fits_are_those_of_a_run(read, pipeline_run):
    theirs = artefacts.read(pipeline_run.work, "followers", recording=1).set_index(["event_id", "follower"])
    fitted = 0
    for event in lc.lane_changes(read):
        for follower, fit in zip(event.followers, lc.fit_drivers(event), strict=True):
            row = theirs.loc[(event.event_id, follower.rank)]
            assert (
                (fit.status == "fitted")
                == (row["status"] == "fitted")
                == (follower.track is not None and not fit.reason)
            )
            if fit.status == "fitted":
                fitted += 1
                assert fit.driver.tau == row["tau"]
                assert fit.errors.rmse_spacing == row["rmse_spacing_m"]
                assert list(fit.bounds_hit) == list(row["at_bound"])
            else:
                assert fit.driver == lc.TABLE3_MEANS
                assert fit.reason == row["reason"]
    assert fitted


def driver_of(row):
    """A run's driver of a follower, be it a pool's, as a fit."""
    driver = lc.LcmParameters(*(row[name] for name in ("v_desire", "A", "b", "B", "tau", "L")))
    return lc.DriverFit(driver, row["leader_length_m"], None, (), row["spread"], 0.0, 0, row["status"], "")


def test_plans_losses_and_tracking_are_those_of_a_run(read, pipeline_run):
    event = max(lc.lane_changes(read), key=lambda one: len(one.followers))
    theirs = artefacts.read(pipeline_run.work, "followers", recording=1).to_dict("records")
    drivers = [driver_of(row) for row in theirs if row["event_id"] == event.event_id]
    scene = event.scene(drivers=drivers)
    tables = {
        name: rows[(rows["event_id"] == event.event_id) & (rows["followers"] == names.OWN_FIT)]
        for name in ("plans", "losses", "tracking")
        for rows in [artefacts.read(pipeline_run.work, name, recording=1)]
    }
    assert len(tables["plans"])
    for row in tables["plans"].to_dict("records"):
        plan = lc.plan(scene, row["policy"], accounting=row["accounting"])
        mine, theirs = (
            (plan.T, plan.x_final, plan.v_end, plan.found.objective),
            ("T", "x_final", "v_end", "objective"),
        )
        assert plan.status == row["status"]
        np.testing.assert_array_equal(mine, [row[name] for name in theirs])
        assert plan.margins == row["margins"]
        lost = tables["losses"].query("policy == @plan.policy and accounting == @plan.accounting").iloc[0]
        mine = (plan.loss.av, plan.loss.followers, plan.loss.increment, plan.safety["min_gap_m"])
        np.testing.assert_array_equal(
            mine, lost[["loss_av", "loss_hv", "loss_hv_increment", "min_gap_m"]].astype(float)
        )
    driven = tables["tracking"].set_index(["policy", "plant"]).loc[("local_optimum", "kinematic")]
    assert lc.track(lc.plan(scene)).rmse_lateral_m == driven["rmse_lateral_m"]


def test_a_recordings_folder_goes_with_it():
    made = lc.synthesize(seconds=20, seed=6)[0]
    folder = made.work
    again = lc.read_recording(made.data, 1)
    assert folder.is_dir()
    del made
    gc.collect()
    assert not folder.exists()
    assert len(again.tracks)
    assert again.meta.frame_rate == 25.0
    assert isinstance(lc.lane_changes(again), list)


def test_without_a_place_for_the_folder_one_line_says_so(tmp_path, monkeypatch, pipeline_run):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(lc.HighdLcError, match="TMPDIR") as caught:
        lc.read_recording(pipeline_run.data, 1)
    assert "\n" not in str(caught.value)


def test_a_pipeline_names_the_recorder_and_the_settings():
    made = lc.synthesize(seconds=10, pipeline="recorder_idm")[0]
    assert made.settings.synthetic.recorder.drivers == "idm"
    default = lc.synthesize(seconds=10)[0]
    assert not made.tracks.equals(default.tracks)


def test_recordings_differ_and_the_same_seed_repeats():
    one, two = lc.synthesize(recordings=2, seconds=20, seed=6)
    again = lc.synthesize(seconds=20, seed=6)[0]
    assert (one.number, two.number) == (1, 2)
    assert len(one.tracks) != len(two.tracks)
    pd.testing.assert_frame_equal(one.tracks, again.tracks)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda data: lc.read_recording(data / "nowhere", 1), lc.InputError, "not a folder"),
        (lambda data: lc.read_recording(data, 7), lc.InputError, "07_recordingMeta.csv"),
        (lambda data: lc.read_recording(data, 1, pipeline="unheard"), lc.SettingsError, "unheard"),
        (lambda data: lc.synthesize(recordings=0), lc.UsageError, "recordings = 0"),
        (lambda data: lc.synthesize(seconds=-1.0), lc.UsageError, "seconds = -1"),
        (lambda data: lc.synthesize(seconds=float("nan")), lc.UsageError, "seconds = nan"),
        (lambda data: lc.synthesize(seconds=float("inf")), lc.UsageError, "seconds = inf"),
        (lambda data: lc.synthesize(seed=-1), lc.UsageError, "seed = -1"),
    ],
)
def test_errors_are_named_and_have_one_line(pipeline_run, call, error, words):
    with pytest.raises(error, match=words) as caught:
        call(pipeline_run.data)
    assert "\n" not in str(caught.value)


def test_drivers_are_one_a_follower(recording):
    event = lc.lane_changes(recording)[0]
    with pytest.raises(lc.UsageError, match=f"{len(event.followers) + 1} drivers for"):
        event.scene(drivers=[lc.SIMULATION] * (len(event.followers) + 1))
    given = event.scene(drivers=[lc.SIMULATION] * len(event.followers)).drivers
    np.testing.assert_array_equal(given, [lc.SIMULATION.as_array()] * len(event.followers))
    np.testing.assert_allclose(event.scene().drivers["tau"], PRIOR["tau"])


def test_unknown_drivers_of_an_event_differ_as_the_population_does(recording):
    event = lc.lane_changes(recording)[0]
    crowd = event.scene().unknown.crowd
    assert len(np.unique(crowd.parameters[:, 0, 4])) == len(crowd.parameters) > 1
    one = event.scene(drivers=[lc.SIMULATION] * len(event.followers)).unknown.crowd
    np.testing.assert_array_equal(one.parameters, one.parameters[:1].repeat(len(one.parameters), axis=0))
