"""The scenarios' figures and pages from their tables and runs."""

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from highd_lc.algorithms.platoon import Platoon
from highd_lc.algorithms.scenario_cells import DEFAULT
from highd_lc.algorithms.scenario_printed import KEY as PRINTED_STATE
from highd_lc.core.edie import clip_to_grid, trajectories_of
from highd_lc.io.whole_file import whole_file
from highd_lc.reporting import figures_scenarios as figures
from highd_lc.reporting import figures_space_time as space_time
from highd_lc.reporting import html
from highd_lc.reporting import pages_scenarios as pages
from highd_lc.reporting import tables_scenarios as tables
from highd_lc.reporting import words_scenarios as words
from highd_lc.reporting.figures_scenarios import PrintedLosses, Story
from highd_lc.reporting.figures_space_time import LaneState, SpeedMap, Window
from highd_lc.reporting.pages_scenarios import Picture
from highd_lc.stages.scenario_recordings import RecordedChange
from highd_lc.vocab.published import PUBLISHED
from highd_lc.vocab.scenarios import MapSettings, ScenarioSettings

Frames = Mapping[str, pd.DataFrame]

_DPI: Final = 150
_FOLLOWER_SECONDS: Final = 60.0
_KEPT_EVERY: Final = 5


def write_pages(
    out: Path,
    frames: Frames,
    *,
    stories: Mapping[str, Story],
    settings: ScenarioSettings,
    change: RecordedChange | None = None,
) -> None:
    """Write figures (PNG), both pages and the ledger as text below ``out``. change: of a recording, if any."""
    sections = []
    for picture in _pictures(frames, stories, settings=settings, change=change):
        _save(out, picture)
        sections.append(tables.section_of(picture, frames))
    back = (out.parent / "index.html").is_file()
    lead = words.lead(frames, settings)
    index = pages.scenario_page("index.html", "The paper's scenarios", sections, lead=lead, back=back)
    entries = [pages.claims_section(frames["claims"]), *pages.ledger_sections(frames["ledger"])]
    if "sweep_claims" in frames:
        swept = pages.claims_section(frames["sweep_claims"], title="Claims over the sweep", what="combinations")
        entries.insert(1, swept)
    entries.append(pages.arithmetic_section(frames["arithmetic"]))
    title = "Every published number, ours, and the ratio"
    ledger = pages.scenario_page("ledger.html", title, entries, lead=words.ledger_lead(frames), back=back)
    text = pages.ledger_markdown(
        frames["ledger"],
        frames["claims"],
        arithmetic=frames["arithmetic"],
        lead=words.ledger_lead(frames),
        swept=frames.get("sweep_claims"),
    )
    for name, content in (("index.html", index), ("ledger.html", ledger), ("ledger.md", text)):
        with whole_file(out / name) as sink:
            sink.write(content.encode("utf-8"))


def _save(out: Path, picture: Picture) -> None:
    with whole_file(out / "figures" / f"{picture.name}.png") as sink:
        sink.write(picture.png)


def _picture(name: str, figure: Figure) -> Picture:
    sink = io.BytesIO()
    figure.savefig(sink, format="png", dpi=_DPI)
    said = words.WORDS[name]
    return Picture(name, html.inline_svg(figure, said.alternative), sink.getvalue(), said)


def _pictures(
    frames: Frames, stories: Mapping[str, Story], *, settings: ScenarioSettings, change: RecordedChange | None
) -> Iterator[Picture]:
    cells = frames["scenario_cells"]
    first = cells[(cells["scenario"] == "1") & (cells["variant"] == DEFAULT)]
    second = {key: story for key, story in stories.items() if key != "1"}
    third = cells[cells["scenario"] == PRINTED_STATE]
    followers = settings.options.planned_followers
    yield _picture("plans", figures.plan_figure(stories))
    yield _picture("followers", figures.follower_figure(stories["1"], seconds=_FOLLOWER_SECONDS))
    yield _picture("losses", figures.loss_figure(first, printed=_printed_losses("1")))
    yield _picture("weights", figures.weight_figure(first, printed=_printed_weights("1")))
    yield _picture("speed_maps", space_time.speed_maps_figure(_speed_maps(second, settings.map)))
    windows = {key: _window(story, settings) for key, story in second.items()}
    yield _picture("rectangle", space_time.rectangle_figure(second, windows, followers=followers))
    yield _picture("scenario_3", figures.printed_state_figure(third, printed=_printed_losses(PRINTED_STATE)))
    yield _picture("growth", space_time.growth_figure(frames["string_stability"], frames["growth"]))
    if change is not None:
        yield _picture("recorded", space_time.lane_state_figure(_lane_state(change)))


def _lane_state(change: RecordedChange) -> LaneState:
    cells = change.cells
    return LaneState(
        change.x_edges,
        change.t_edges,
        3600.0 * cells.flow,
        3.6 * cells.speed,
        1000.0 * cells.density,
        change.ego,
    )


def _printed_losses(scenario: str) -> dict[str, PrintedLosses]:
    found = {(n.policy, n.quantity): n.value for n in PUBLISHED if n.scenario == scenario and not n.omega_given}
    return {p: PrintedLosses(found[p, "loss_av"], found[p, "loss_hv"]) for p in figures.PAIR}


def _printed_weights(scenario: str) -> dict[float, PrintedLosses]:
    found = {(n.omega_av, n.quantity): n.value for n in PUBLISHED if n.scenario == scenario}
    weights = [omega for omega, quantity in found if quantity == "loss_av"]
    return {omega: PrintedLosses(found[omega, "loss_av"], found[omega, "loss_hv"]) for omega in weights}


def _window(story: Story, settings: ScenarioSettings) -> Window:
    top = float(story.unchanged.front[0, 0]) + settings.rectangle.top_m
    return Window((top - settings.rectangle.height_m, top), (0.0, settings.rectangle.duration_s))


def _speed_maps(stories: Mapping[str, Story], settings: MapSettings) -> dict[str, dict[str, SpeedMap]]:
    return {
        f"AV {story.v_av:g} m/s": {
            policy: _speed_map(story.approach, platoon, settings) for policy, platoon in story.platoons.items()
        }
        for story in stories.values()
    }


def _speed_map(approach: Platoon, after: Platoon, settings: MapSettings) -> SpeedMap:
    x_edges = np.arange(-settings.upstream_m, settings.downstream_m + 1e-9, settings.cell_m)
    t_edges = np.arange(-settings.before_s, settings.after_s + 1e-9, settings.cell_s)
    before = approach.t >= t_edges[0] - settings.cell_s
    # The approach ends with the instant with which the run begins.
    t = np.concatenate([approach.t[before][:-1], after.t])
    front = np.concatenate([approach.front[:, before][:, :-1], after.front], axis=1)
    shown = t <= t_edges[-1] + settings.cell_s
    tracks = trajectories_of(t[shown][::_KEPT_EVERY], front[:, shown][:, ::_KEPT_EVERY])
    return SpeedMap(x_edges, t_edges, clip_to_grid(tracks, x_edges=x_edges, t_edges=t_edges).speed)
