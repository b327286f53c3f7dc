import io

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from highd_lc.reporting.figures_extraction import distributions_figure, funnel_figure, quality_figure
from highd_lc.vocab import names


def made_crossings(n=40):
    rng = np.random.default_rng(1)
    reason = rng.choice(["", names.CUT_BEFORE_START, names.NO_TARGET_FOLLOWER], n)
    return pd.DataFrame({
        "ego_class": rng.choice(names.CLASSES, n), "direction": rng.choice(["left", "right"], n), "reason": reason,
        "usable": reason == "",
    })  # fmt: skip


def made_events(n=25):
    rng = np.random.default_rng(2)
    return pd.DataFrame({
        "ego_class": rng.choice(names.CLASSES, n), "duration_s": rng.uniform(4, 8, n),
        "lateral_shift_m": rng.choice([-3.7, 3.6], n), "peak_lateral_speed_mps": rng.uniform(0.6, 1.4, n),
        "gap_ahead_m": np.where(np.arange(n) % 5 == 0, np.nan, rng.uniform(5, 80, n)),
        "gap_behind_m": rng.uniform(5, 80, n), "follower_ids": [list(range(k % 4)) for k in range(n)],
    })  # fmt: skip


def made_recordings():
    return pd.DataFrame({
        "recording_id": [1, 1, 2], "driving_direction": [1, 2, 2], "mean_acceleration": [-0.2, 0.25, 0.01],
        "mean_speed_change": [0.0, 0.01, np.nan], "entry_m": 0.0,
        "disagreement_profile": [np.array([0.4, 0.0, np.nan]), np.array([0.3, 0.1]), np.array([])],
    })  # fmt: skip


def widths(figure):
    """Right ends of the bars of the funnel by row."""
    (axes,) = figure.axes
    ends = {}
    for bar in axes.patches:
        row = round(bar.get_y() + bar.get_height() / 2)
        ends.setdefault(row, []).append((bar.get_x(), bar.get_x() + bar.get_width()))
    return {row: (min(a for a, _ in spans), max(b for _, b in spans)) for row, spans in ends.items()}


def test_funnel_bars_add_up_to_all_crossings():
    crossings = made_crossings()
    counts = crossings["reason"].value_counts()
    left = len(crossings)
    spans = widths(funnel_figure(crossings))
    assert spans[0] == (0, left)
    for row, reason in enumerate((names.CUT_BEFORE_START, names.NO_TARGET_FOLLOWER), start=1):
        assert spans[row] == (left - counts[reason], left)
        left -= counts[reason]
    assert spans[3] == (0, left)


def test_share_of_complete_and_censored_changes_is_stated():
    crossings = made_crossings()
    text = distributions_figure(crossings, made_events()).get_suptitle()
    cut = (crossings["reason"] == names.CUT_BEFORE_START).mean()
    whole = f"{100 * (1 - cut):.0f} % complete (published: 60 %), {100 * cut:.0f} % censored"
    assert f"{len(crossings)} lane-id changes: {whole}" in text


def test_published_durations_stand_beside_ours():
    axes = distributions_figure(made_crossings(), made_events()).axes[0]
    drawn = {line.get_xdata()[0] for line in axes.lines if len(line.get_xdata())}
    assert drawn == {5.70, 5.55, 6.22, 6.08}


def test_every_recording_and_carriageway_is_drawn():
    figure = quality_figure(made_recordings())
    bias, profiles = figure.axes
    drawn = sorted(float(y) for line in bias.lines[1:] for y in np.atleast_1d(line.get_ydata()) if np.isfinite(y))
    assert drawn == pytest.approx(sorted([-0.2, 0.25, 0.01, 0.0, 0.01]))
    assert len(profiles.lines) == 1 + 3


@pytest.mark.parametrize(
    "figure",
    [
        lambda: funnel_figure(made_crossings()),
        lambda: funnel_figure(made_crossings().iloc[:0]),
        lambda: quality_figure(made_recordings()),
        lambda: quality_figure(made_recordings().iloc[:0]),
        lambda: distributions_figure(made_crossings(), made_events()),
        lambda: distributions_figure(made_crossings().iloc[:0], made_events().iloc[:0]),
        lambda: distributions_figure(made_crossings(), made_events(1)),
    ],
)
def test_figures_render_without_pyplot(figure, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)
    sink = io.BytesIO()
    figure().savefig(sink, format="png", dpi=40)
    image = np.asarray(Image.open(sink).convert("L"))
    assert image.min() < 128
    assert image.max() == 255
