import io
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from sample_event import infeasible_event, sample_event

from highd_lc.reporting import figures_event
from highd_lc.reporting.figures_event import EventPainter, event_figure, event_panels, event_vector
from highd_lc.vocab import names


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)


def other_event():
    report = sample_event(1)
    faster = {**report.event, "event_id": "07-0200-00500", "direction": "right"}
    plays = tuple(replace(p, ego=replace(p.ego, v=p.ego.v + 12.0)) for p in report.plays)
    return replace(report, event=faster, plays=plays)


def test_a_picture_does_not_depend_on_what_was_painted_before():
    alone = EventPainter().png(sample_event())
    painter = EventPainter()
    painter.png(other_event())
    painter.png(infeasible_event())
    assert painter.png(sample_event()) == alone


def test_painted_picture_equals_the_fresh_figure():
    report = sample_event()
    sink = io.BytesIO()
    event_figure(report).savefig(sink, format="png")
    painted, fresh = pixels(EventPainter().png(report)), pixels(sink.getvalue())
    assert painted.shape == fresh.shape
    # Ticks and grids are painted before the content in one and after in the other: a few edges differ.
    assert (np.abs(painted - fresh).max(axis=2) > 40).mean() < 0.005


def test_pictures_of_different_events_differ():
    painter = EventPainter()
    assert painter.png(sample_event()) != painter.png(other_event())


def test_kept_backgrounds_are_bounded(monkeypatch):
    monkeypatch.setattr(figures_event, "_KEPT_GROUNDS", 10)
    painter = EventPainter()
    painter.png(sample_event())
    painter.png(other_event())
    assert len(painter._grounds) <= 10
    assert painter.png(sample_event()) == EventPainter().png(sample_event())


def test_an_infeasible_event_is_drawn_with_what_there_is():
    panels = event_panels(infeasible_event())
    assert "infeasible" in {note.text for note in panels["loss"].notes}
    assert panels["hv_speed"].curves
    assert pixels(EventPainter().png(infeasible_event())).std() > 0


@pytest.mark.parametrize("kind", figures_event.VECTOR_FORMATS)
def test_vector_formats(kind):
    data = event_vector(sample_event(2), kind)
    assert data.startswith(b"%PDF" if kind == "pdf" else b"<?xml")
    assert event_vector(sample_event(2), kind) == data


def test_bars_are_the_losses_of_the_primary_accounting():
    report = sample_event()
    panel = event_panels(report)["loss"]
    local = report.loss(names.LOCAL_OPTIMUM)
    row = panel.names.index("Local optimum")
    blocks = [b for b in panel.blocks if round(b.y + 0.34) == row]
    assert sum(b.width for b in blocks) == pytest.approx(local["loss_total"])
    assert f" {local['loss_total']:.2f}" in {note.text for note in panel.notes}


def test_limits_hold_all_curves():
    for name, panel in event_panels(sample_event(10)).items():
        low, high = panel.limits[2:]
        for curve in panel.curves:
            known = curve.y[np.isfinite(curve.y)]
            assert low <= known.min(), name
            assert known.max() <= high, name


def test_axes_carry_units():
    for name, panel in event_panels(sample_event()).items():
        assert "[" in panel.x_label or "no unit" in panel.x_label, name
        assert "[" in panel.y_label or panel.names, name


def test_pyplot_is_never_loaded():
    code = (
        "import sys; sys.path.insert(0, 'tests/reporting')\n"
        "from sample_event import sample_event\n"
        "from highd_lc.reporting.figures_event import EventPainter\n"
        "import highd_lc.reporting.pages_index\n"
        "EventPainter().png(sample_event(1))\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("leader_at", [20.0, 150.0])
def test_a_metre_across_is_as_long_as_a_metre_along(leader_at):
    report = sample_event()
    role, path = next(iter(report.others.items()))
    moved = replace(path, x=path.x - path.x[0] + leader_at)
    figure = event_figure(replace(report, others={**report.others, role: moved}))
    figure.canvas.draw()
    scene = figure.axes[0]
    (x0, y0), (x1, y1) = scene.transData.transform([(0.0, 0.0), (10.0, 10.0)])
    assert x1 - x0 == pytest.approx(y1 - y0, rel=1e-6)
    assert scene.get_xlim()[1] - scene.get_xlim()[0] >= 199.9
