"""Rows of responses: who is in view how long, and the traffic around."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from random_scenes import random_scene

from highd_lc.core.edie import clip_to_grid, trajectories_of
from highd_lc.drivers.prediction import Scales, motion_loss
from highd_lc.planning.candidates import loss_terms
from highd_lc.planning.scene import Motion
from highd_lc.stages.responses import Traffic, lane_kilometres, loss_in_view, samples_in_view
from highd_lc.vocab.settings import ValidateSettings

SETTINGS = ValidateSettings()


def vehicles() -> pd.DataFrame:
    return pd.DataFrame({
        "vehicle_id": [1, 2, 3, 4, 9], "driving_direction": [1, 1, 1, 1, 2], "first_frame": [1, 5, 10, 31, 1],
        "last_frame": [20, 20, 30, 60, 60], "mean_acceleration": [5.0, 0.1, 0.3, 0.2, -7.0],
    })  # fmt: skip


def test_density_is_edies_over_the_road_in_view_and_five_seconds_on_either_side():
    recordings = pd.DataFrame({
        "driving_direction": [1, 2], "markings": [[0.0, 3.7, 7.4], [0.0, 3.7, 7.4, 11.1]], "entry_m": [10.0, 0.0],
        "exit_m": [410.0, 400.0],
    })  # fmt: skip
    road = lane_kilometres(recordings)
    assert road == pytest.approx({1: 0.8, 2: 1.2})
    traffic = Traffic(vehicles(), road)
    # At two frames a second: frames 20 to 40, of which vehicles 1 and 2 are in 1, 3 in 11, 4 in 10.
    assert traffic.density(1, 30, rate=2.0) == pytest.approx((1 + 1 + 11 + 10) / 21 / 0.8)
    # The film begins with frame 1: vehicle 1 is in frames 1 to 11, 2 in 5 to 11, 3 in 10 and 11.
    assert traffic.density(1, 1, rate=2.0) == pytest.approx((11 + 7 + 2) / 11 / 0.8)
    assert traffic.density(9, 20, rate=2.0) == pytest.approx(1 / 1.2)
    assert np.isnan(Traffic(vehicles(), {}).density(1, 20, rate=2.0))


def test_density_is_that_of_trajectories_clipped_to_the_region():
    """Twin: the same vehicles at constant speed through the section, by exact clipping."""
    frames, rate, metres = 200, 5.0, 400.0
    t, v, entries = np.arange(1, frames + 1) / rate, 25.0, np.arange(0.0, 38.0, 1.7)
    x = np.where(t >= entries[:, None], v * (t - entries[:, None]), np.nan)
    x = np.where(x <= metres, x, np.nan)
    seen = [np.flatnonzero(np.isfinite(row)) + 1 for row in x]
    made = pd.DataFrame({
        "vehicle_id": np.arange(len(x)), "driving_direction": 1, "first_frame": [s[0] for s in seen],
        "last_frame": [s[-1] for s in seen], "mean_acceleration": 0.0,
    })  # fmt: skip
    cells = clip_to_grid(trajectories_of(t, x), x_edges=np.array([0.0, metres]), t_edges=np.array([15.0, 25.0]))
    found = Traffic(made, {1: metres / 1000.0}).density(0, 100, rate=rate)
    assert found == pytest.approx(1000.0 * cells.density[0, 0], rel=0.03)


def test_the_drift_is_the_median_of_the_others_of_the_carriageway():
    traffic = Traffic(vehicles(), {})
    assert traffic.drift_without(1, [1]) == pytest.approx(0.2)
    assert traffic.drift_without(1, [1, 4]) == pytest.approx(0.2)
    assert traffic.drift_without(9, [9]) == 0.0


def scene_with(observed: list[int], leaves: int | None = None):
    """Three followers, filmed for that many samples; the second leaves its lane at a sample."""
    scene = random_scene(np.random.default_rng(4), 3)
    samples, motions = scene.samples, []
    for rank, seen in enumerate(observed):
        y = np.full(samples, 3.5)
        if rank == 1 and leaves is not None:
            y[leaves:] += 2.0
        v = 28.0 - 0.1 * rank - 0.01 * np.arange(samples)
        x = -30.0 * (rank + 1) + np.cumsum(v) * 0.1
        motions.append(Motion(x, y, v, np.full(samples, -0.1), 4.6, 1.8, seen))
    path = {name: np.zeros(91) for name in ("y", "vy", "ax", "ay", "jx", "jy")}
    human = replace(scene.human, x=28.0 * 0.1 * np.arange(91), vx=np.full(91, 28.0), **path)
    return replace(scene, human=human, followers=replace(scene.followers, recorded=tuple(motions)))


@pytest.mark.parametrize(
    ("observed", "leaves", "seen"),
    [([120, 60, 70], None, [81, 60, 60]), ([70, 81, 40], None, [70, 70, 40]), ([81, 81, 81], 33, [81, 33, 33])],
)
def test_behind_somebody_out_of_view_or_of_the_lane_nobody_is_judged(observed, leaves, seen):
    assert samples_in_view(scene_with(observed, leaves)) == seen


def test_the_loss_in_view_is_the_weighted_one_of_those_in_view_long_enough():
    scene = scene_with([60, 50, 12])  # the third is in view for too short a time
    terms = loss_terms(scene, np.array([0.5, 0.3, 0.2]), SETTINGS.loss)
    v = [motion.v for motion in scene.followers.recorded]
    scales = Scales(SETTINGS.loss.v_ref_hv, SETTINGS.loss.comfort_scale, SETTINGS.loss.efficiency_scale)
    each = [motion_loss(v[i][:seen, None], scales)[0] for i, seen in ((0, 60), (1, 50))]
    found = loss_in_view(v, scene, terms, SETTINGS.loss)
    assert found == pytest.approx(0.5 * each[0] + 0.3 * each[1])
    # What comes after the view costs nothing.
    later = [values + np.where(np.arange(len(values)) >= 60, 9.0, 0.0) for values in v]
    assert loss_in_view(later, scene, terms, SETTINGS.loss) == found
    assert np.isnan(loss_in_view(v, scene_with([12, 12, 12]), terms, SETTINGS.loss))
