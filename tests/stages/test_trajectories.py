"""The artefact ``trajectories``: losses follow from it alone, and it says what was recorded."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.io import artefacts
from highd_lc.vocab.tables import TABLES

DT, V_REF, N_COMFORT, N_EFFICIENCY = 0.1, 33.54, 8.0, 33.54
MODEL = "own_fit"
PLANNED = ("benchmark", "local_optimum", "local_optimum_free", "constant")
KEY = list(TABLES["trajectories"].order)


@pytest.fixture(scope="module")
def rows(pipeline_run):
    return pd.read_parquet(pipeline_run.work / "trajectories").astype(
        {c: float for c in ("t", "x", "y", "vx", "ax")}
    )


@pytest.fixture(scope="module")
def losses(pipeline_run):
    found = artefacts.read(pipeline_run.work, "losses")
    found = found[(found["accounting"] == "equal") & (found["followers"] == MODEL) & (found["contact"] == "")]
    return found.dropna(subset="loss_total").set_index(["event_id", "policy"])


def motions(rows, kind, policy):
    """Each role's rows by event."""
    chosen = rows[(rows["kind"] == kind) & (rows["policy"] == policy) & rows["followers"].isin([MODEL, ""])]
    return {event: dict(list(of.groupby("role"))) for event, of in chosen.groupby("event_id")}


def test_rows_are_ordered_and_each_is_there_once(pipeline_run, rows):
    assert not rows.duplicated(KEY).any()
    for recording in (1, 2):
        part = artefacts.read_partition(pipeline_run.work, "trajectories", recording)
        pd.testing.assert_frame_equal(part, part.sort_values(KEY, ignore_index=True))
    assert set(rows["event_id"]) == set(artefacts.read(pipeline_run.work, "events")["event_id"])


def test_polars_reads_the_same_plain_columns(pipeline_run, rows):
    polars = pytest.importorskip("polars")
    found = polars.read_parquet(pipeline_run.work / "trajectories" / "**" / "*.parquet")
    kinds = {"string": "String", "float32": "Float32"}
    expected = {column.name: kinds[column.kind] for column in TABLES["trajectories"].columns}
    assert {name: str(kind) for name, kind in found.schema.items() if name != "recording"} == expected
    assert len(found) == len(rows)
    assert found["x"].sum() == pytest.approx(rows["x"].sum(), rel=1e-3)


def hv_each(roles):
    """Loss of each follower over 0..H, nearest first, unweighted."""
    each = []
    for rank in range(1, len(roles)):
        one = roles[f"target_follower_{rank}"]
        comfort = np.abs(np.diff(one["ax"])).sum() / DT / N_COMFORT
        each.append(0.5 * comfort + 0.5 * np.abs(one["vx"] - V_REF).sum() / N_EFFICIENCY)
    return np.array(each)


@pytest.mark.parametrize("policy", [*PLANNED, "no_lane_change"])
def test_the_followers_loss_follows_from_them_alone(pipeline_run, rows, losses, policy):
    lengths = artefacts.read(pipeline_run.work, "vehicles").set_index(["recording_id", "vehicle_id"])["length"]
    events = artefacts.read(pipeline_run.work, "events").set_index("event_id")
    compared = 0
    for event, roles in motions(rows, "simulated", policy).items():
        if (event, policy) not in losses.index:
            continue
        about, expected = events.loc[event], losses.loc[event, policy]
        each = hv_each(roles)
        assert each == pytest.approx(np.array(expected["loss_hv_each"]), rel=1e-5)
        ego, of = roles["ego"].iloc[0], [roles[f"target_follower_{k + 1}"].iloc[0] for k in range(len(each))]
        boxes = [lengths[about["recording_id"], v] for v in (about["ego_id"], *about["follower_ids"])]
        front = [one["x"] + box / 2.0 for one, box in zip((ego, *of), boxes, strict=True)]
        speed = events_speed(rows, event)
        sigma = np.array([abs(one["vx"] - speed) for one in of]) / np.sqrt(front[0] - np.array(front[1:]))
        assert sigma / sigma.sum() @ each == pytest.approx(expected["loss_hv"], rel=1e-4)
        compared += 1
    assert compared


def events_speed(rows, event):
    """The ego's recorded speed at t_start."""
    ego = rows[(rows["event_id"] == event) & (rows["kind"] == "recorded") & (rows["role"] == "ego")]
    return ego["vx"].iloc[0]


@pytest.mark.parametrize("policy", PLANNED)
def test_the_avs_loss_follows_from_them_alone(rows, losses, policy):
    """T is when the AV's box stops moving sideways; its way there is the quintic of equation 3."""
    z = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    compared = 0
    for event, roles in motions(rows, "simulated", policy).items():
        if (event, policy) not in losses.index:
            continue
        t, y, vx, ax = (roles["ego"][name].to_numpy() for name in ("t", "y", "vx", "ax"))
        D, n = y[-1], int(np.flatnonzero(y != y[-1])[-1]) + 1
        cubic = np.polynomial.Polynomial.fit(t[:n], ax[:n], 3)
        jerk = np.abs(cubic.deriv()(t[: n + 1])) + np.abs(D * z.deriv(3)(t[: n + 1] / t[n]) / t[n] ** 3)
        vy = np.where(t < t[n], D * z.deriv()(t / t[n]) / t[n], 0.0)
        # The step from the plan's own 0 onto the drive after T is charged, as the steps of that drive are.
        comfort = (jerk.sum() + (np.abs(ax[n]) + np.abs(np.diff(ax[n:])).sum()) / DT) / N_COMFORT
        efficiency = np.abs(np.hypot(vx, vy) - V_REF).sum() / N_EFFICIENCY
        assert 0.5 * comfort + 0.5 * efficiency == pytest.approx(losses.loc[event, policy]["loss_av"], rel=1e-5)
        compared += 1
    assert compared


def test_recorded_rows_are_the_event_tracks_where_both_have_a_sample(pipeline_run, rows):
    recorded = rows[rows["kind"] == "recorded"]
    assert set(recorded["followers"]) == {""}
    assert set(recorded["policy"]) == {"recorded"}
    raw = artefacts.read(pipeline_run.work, "event_tracks").assign(k=lambda f: np.rint(f["t"] * 10.0))
    raw = raw[(raw["t"] - raw["k"] / 10.0).abs() < 1e-6]
    both = recorded.assign(k=np.rint(recorded["t"] * 10.0)).merge(
        raw, on=["event_id", "role", "k"], suffixes=("", "_raw")
    )
    assert len(both) > 0.4 * len(recorded)
    for name in ("x", "y", "vx", "ax"):
        assert both[name].to_numpy() == pytest.approx(both[f"{name}_raw"].to_numpy(), rel=1e-6, abs=1e-4)
    assert set(raw.loc[(raw["t"] > -1e-9) & (raw["t"] < 15.0), "role"]) == set(recorded["role"])


def test_behind_the_recorded_ego_followers_end_where_a_recording_does(rows):
    recorded, behind = motions(rows, "recorded", "recorded"), motions(rows, "simulated", "recorded")
    human = motions(rows, "simulated", "human")
    assert set(behind) == set(recorded)
    for event, roles in behind.items():
        for role, one in roles.items():
            seen = [recorded[event][other]["t"].max() for other in ("ego", role)]
            assert one["t"].max() == pytest.approx(min(seen), abs=1e-6)
            same = human[event][role].iloc[: len(one)]
            assert (one[["x", "vx", "ax"]].to_numpy() == same[["x", "vx", "ax"]].to_numpy()).all()


def test_tracked_egos_start_as_planned_and_stay_near(pipeline_run, rows):
    tracking = artefacts.read(pipeline_run.work, "tracking")
    tracking = tracking[(tracking["plant"] == "kinematic") & (tracking["followers"] == MODEL)]
    tracking = tracking.set_index(["event_id", "policy"])
    for event, roles in motions(rows, "tracked", "local_optimum").items():
        planned, tracked = motions(rows, "simulated", "local_optimum")[event]["ego"], roles["ego"]
        away = np.abs(tracked["y"].to_numpy() - planned["y"].to_numpy()[: len(tracked)])
        assert away[0] == 0.0
        # Between the rear axle, whose error stands in the table, and the centre lies half a wheelbase of heading.
        most = tracking.loc[(event, "local_optimum"), "max_lateral_m"]
        assert away.max() < most + 0.05
