"""The animated GIF of an event: real time, equal scale, everybody where the motion says."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from sample_event import infeasible_event, sample_event, unplanned_event

from highd_lc.reporting import labels
from highd_lc.reporting.animation import FRAMES_PER_S, event_gif, plays_shown, road_panel
from highd_lc.reporting.event import Path
from highd_lc.vocab import names


def cut(report, samples):
    """The event's first samples alone."""

    def short(path):
        return Path(*(getattr(path, name)[:samples] for name in ("x", "y", "v", "a")))

    plays = tuple(
        replace(p, ego=short(p.ego), followers=tuple(map(short, p.followers)), jerk=p.jerk[:samples])
        for p in report.plays
    )
    return replace(report, plays=plays, others={role: short(path) for role, path in report.others.items()})


def test_it_plays_in_real_time_and_is_the_same_every_time():
    report = cut(sample_event(), 21)
    data = event_gif(report)
    assert event_gif(report) == data
    image = Image.open(io.BytesIO(data))
    assert image.n_frames == round(20 * report.dt * FRAMES_PER_S) + 1
    assert image.info["duration"] == 1000 // FRAMES_PER_S


@pytest.mark.parametrize("k", [0, 37])
def test_everybody_is_drawn_where_the_plan_says_at_equal_scale(k):
    report = sample_event()
    plays = plays_shown(report)
    assert [play.policy for play in plays] == [names.LOCAL_OPTIMUM, names.BENCHMARK]
    panel = road_panel(report, plays, k)
    ego = plays[0].ego
    box = report.boxes[names.EGO]
    filled = [b for b in panel.blocks if b.fill == labels.POLICIES[names.LOCAL_OPTIMUM].light]
    assert [(b.x + b.width / 2, b.y + b.height / 2) for b in filled] == [pytest.approx((ego.x[k], ego.y[k]))]
    assert (filled[0].width, filled[0].height) == (box.length, box.width)
    assert panel.limits[0] < ego.x[k] < panel.limits[1]
    along, across = panel.limits[1] - panel.limits[0], panel.limits[3] - panel.limits[2]
    assert across / along == pytest.approx((0.3 * 2.9) / (0.92 * 8.0))


@pytest.mark.parametrize(
    ("event", "policy"), [(infeasible_event, names.HUMAN), (unplanned_event, labels.RECORDED)]
)
def test_without_a_plan_the_motion_that_there_is_is_shown(event, policy):
    (play,) = plays_shown(event())
    assert play.policy == policy
    known = np.flatnonzero(np.isfinite(play.ego.x))
    panel = road_panel(event(), [play], int(known[-1]))
    assert "outlines" not in panel.title
    assert all(math.isfinite(block.x) for block in panel.blocks)
