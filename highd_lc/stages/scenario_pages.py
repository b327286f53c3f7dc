"""The scenarios' figures and pages from their tables and runs.

The recordings' part of the scenarios: traffic around a real lane change, and the fitted drivers.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from highd_lc.core.edie import Cells, clip_to_grid, trajectories_of, trajectories_of_rows
from highd_lc.core.shock_waves import WaveSpeed, wave_speed
from highd_lc.io import artefacts
from highd_lc.io.atomic import whole_file
from highd_lc.reporting import figures_scenarios as figures
from highd_lc.reporting import figures_space_time as space_time
from highd_lc.reporting import html
from highd_lc.reporting import pages_scenarios as pages
from highd_lc.reporting import tables_scenarios as tables
from highd_lc.reporting import tables_scenarios as words
from highd_lc.reporting.figures_scenarios import PrintedLosses, Story
from highd_lc.reporting.figures_space_time import LaneState, SpeedMap, Window
from highd_lc.reporting.pages_scenarios import Picture
from highd_lc.scenarios.ledger import KEY as PRINTED_STATE
from highd_lc.scenarios.platoon import Platoon
from highd_lc.scenarios.run import DEFAULT
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.published import PUBLISHED, printed
from highd_lc.vocab.scenarios import MapSettings, RecordedSettings, ScenarioSettings

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

_NEEDED = ("events", "vehicles", "followers")


@dataclass(frozen=True)
class RecordedChange:
    """Traffic on the target lane around a recorded lane change.

    cells: Edie's measures on a grid of x [m] and t [s from the crossing]; ego: t and x of the vehicle that changes
    lane; wave: of the disturbance behind it.
    """

    event_id: str
    x_edges: FloatArray
    t_edges: FloatArray
    cells: Cells
    ego: tuple[FloatArray, FloatArray]
    wave: WaveSpeed


@dataclass(frozen=True)
class Recordings:
    """What the scenarios take from a work folder; nothing by default.

    fitted: LCM parameters of the fitted followers, shape (n, 6); fits: median of the paper's J over them, NaN of
    none; change: the lane change that is drawn; nearest: event id of the lane change nearest to scenario 3's
    printed state, empty = none.
    """

    fitted: FloatArray = field(default_factory=lambda: np.empty((0, len(PARAMETERS))))
    fits: float = np.nan
    change: RecordedChange | None = None
    nearest: str = ""


def has_recordings(work: Path | None) -> bool:
    """Whether a work folder holds what the recordings' part needs."""
    return work is not None and all(artefacts.path_of(work, name).is_file() for name in _NEEDED)


def fitted_drivers(work: Path) -> tuple[FloatArray, float]:
    """All followers that were fitted: LCM parameters, shape (n, 6), in the order of the table; median of J."""
    followers = artefacts.read(work, "followers", columns=["status", "paper_j", *PARAMETERS])
    fitted = followers[followers["status"] == names.FITTED]
    return fitted[list(PARAMETERS)].to_numpy(np.float64), float(fitted["paper_j"].median())


def nearest_event(work: Path, settings: ScenarioSettings) -> str:
    """Event id of the lane change whose followers start nearest to scenario 3's printed state; empty if none.

    By the sum of squared differences of spacings (10 m) and speed differences (1 m/s) to the AV.
    """
    state = settings.scenario_3
    columns = ["event_id", "role", "t", "x", "vx"]
    start = artefacts.read(work, "event_tracks", columns=columns, where=(("t", ">", -1e-9), ("t", "<", 1e-9)))
    wide = start.pivot_table(index="event_id", columns="role", values=["x", "vx"])
    printed_state = zip(state.spacings_m, state.speed_differences, strict=True)
    away = pd.Series(0.0, wide.index)
    for rank, (spacing, difference) in enumerate(printed_state, start=1):
        role = names.target_follower(rank)
        if ("x", role) not in wide:
            return ""
        behind = wide["x", names.EGO] - wide["x", role]
        faster = wide["vx", role] - wide["vx", names.EGO]
        away += ((behind - spacing) / 10.0) ** 2 + (faster - difference) ** 2
    known = away.dropna()
    return str(known.idxmin()) if len(known) else ""


def recorded_change(work: Path, settings: ScenarioSettings) -> RecordedChange | None:
    """The traffic around the lane change with most followers, the first of equals; None without events."""
    events = artefacts.read(work, "events")
    if events.empty:
        return None
    event = events.iloc[int(events["follower_ids"].map(len).to_numpy().argmax())]
    rows = _carriageway(work, event)
    rows = rows.assign(t=rows["t"] - _crossing_time(event, rows))
    span = settings.recorded
    rows = rows[(rows["t"] >= -span.before_s) & (rows["t"] <= span.after_s)]
    x_edges, t_edges = _edges(rows, span)
    lane = rows[rows["lane"] == event["target_lane"]]
    step = 1.5 / event["frame_rate"]
    tracks = trajectories_of_rows(*(lane[c].to_numpy() for c in ("vehicle_id", "t", "x")), longest_step=step)
    ego = rows[rows["vehicle_id"] == event["ego_id"]].sort_values("t")
    return RecordedChange(
        str(event["event_id"]),
        x_edges,
        t_edges,
        clip_to_grid(tracks, x_edges=x_edges, t_edges=t_edges),
        (ego["t"].to_numpy(), ego["x"].to_numpy()),
        _wave(event, rows, settings.seed),
    )


def _carriageway(work: Path, event: pd.Series) -> pd.DataFrame:
    """Tracks of the ego's recording on its carriageway."""
    recording = int(event["recording_id"])
    vehicles = artefacts.read(work, "vehicles", recording=recording)
    direction = vehicles.set_index("vehicle_id")["driving_direction"]
    columns = ["vehicle_id", "frame", "t", "x", "vx", "lane"]
    tracks = artefacts.read_tracks(work, recording, columns=columns)
    same = direction.index[direction == direction.loc[event["ego_id"]]]
    return tracks[tracks["vehicle_id"].isin(same)]


def _crossing_time(event: pd.Series, rows: pd.DataFrame) -> float:
    crossed = (rows["vehicle_id"] == event["ego_id"]) & (rows["frame"] == event["crossing_frame"])
    return float(rows.loc[crossed, "t"].iloc[0])


def _edges(rows: pd.DataFrame, span: RecordedSettings) -> tuple[FloatArray, FloatArray]:
    low, high = np.floor(rows["x"].min() / span.cell_m), np.ceil(rows["x"].max() / span.cell_m)
    x_edges = np.arange(low, high + 1) * span.cell_m
    t_edges = np.arange(-span.before_s, span.after_s + 1e-9, span.cell_s)
    # A cell that begins before the recording or ends after it would be too empty.
    seen = (t_edges >= rows["t"].min() - 1e-9) & (t_edges <= rows["t"].max() + 1e-9)
    return x_edges, t_edges[seen] if seen.sum() >= 2 else t_edges


def _wave(event: pd.Series, rows: pd.DataFrame, seed: int) -> WaveSpeed:
    """The wave from the ego through its followers, from the begin of the window to its end."""
    chain = [int(event["ego_id"]), *(int(i) for i in event["follower_ids"])]
    wide = rows[rows["vehicle_id"].isin(chain)].pivot_table(
        index="frame", columns="vehicle_id", values=["x", "vx"]
    )
    wide = wide.reindex(range(int(wide.index.min()), int(wide.index.max()) + 1))
    x, v = (
        wide.reindex(columns=[(name, vehicle) for vehicle in chain]).to_numpy(np.float64).T for name in ("x", "vx")
    )
    rng = np.random.default_rng([seed, int(event["recording_id"]), int(event["ego_id"])])
    return wave_speed(x, v - np.nanmean(v, axis=1, keepdims=True), dt=1.0 / float(event["frame_rate"]), rng=rng)


def state_rows(change: RecordedChange) -> Iterator[Row]:
    """The cells around a lane change (rows of ``recorded_state``)."""
    cells = change.cells
    measures = {
        "flow_veh_h": 3600.0 * cells.flow,
        "speed_km_h": 3.6 * cells.speed,
        "density_veh_km": 1000.0 * cells.density,
    }
    for i, j in np.ndindex(cells.time.shape):
        yield {
            "event_id": change.event_id,
            "x_from_m": change.x_edges[i],
            "x_to_m": change.x_edges[i + 1],
            "t_from_s": change.t_edges[j],
            "t_to_s": change.t_edges[j + 1],
            "distance_m": cells.distance[i, j],
            "time_s": cells.time[i, j],
            **{name: values[i, j] for name, values in measures.items()},
        }


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
    recordings: Recordings,
) -> None:
    """Write figures (PNG), both pages and the ledger as text below ``out``."""
    sections = []
    for picture in _pictures(frames, stories, settings=settings, change=recordings.change):
        _save(out, picture)
        section = tables.section_of(picture, frames)
        if picture.name == "scenario_3":
            section = replace(section, text=(words.event_link(recordings.nearest, _has_page(out, recordings)),))
        sections.append(section)
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
    text = ledger_text(frames)
    for name, content in (("index.html", index), ("ledger.html", ledger), ("ledger.md", text)):
        with whole_file(out / name) as sink:
            sink.write(content.encode("utf-8"))


def ledger_text(frames: Frames) -> str:
    """The ledger as Markdown, which ``docs/ledger.md`` holds for the shipped settings."""
    return pages.ledger_markdown(
        frames["ledger"],
        frames["claims"],
        arithmetic=frames["arithmetic"],
        lead=words.ledger_lead(frames),
        swept=frames.get("sweep_claims"),
    )


def _has_page(out: Path, recordings: Recordings) -> bool:
    """Whether the report in the folder above has a page of the nearest event."""
    return bool(recordings.nearest) and (out.parent / "events" / f"{recordings.nearest}.html").is_file()


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
    return {
        p: PrintedLosses(*(printed(scenario, p, f"loss_{side}") for side in ("av", "hv"))) for p in figures.PAIR
    }


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
