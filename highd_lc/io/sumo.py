"""Recordings of SUMO's traffic in HighD's format: drivers and lane changes that nobody here modelled.

The extra ``sumo`` brings it. A carriageway is a straight motorway of three edges, of which the middle one is
filmed. Cars drive by EIDM or Krauss, trucks by EIDM, all change lane by SL2015, the sublane model, so that lane
changes take time. SUMO's floating car data have the front's centre, its speed and acceleration; lateral speeds and
accelerations are differences of y.
"""

import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import iterparse

import numpy as np
import pandas as pd

from highd_lc.io.synthetic import DIRECTIONS, Scene, draw_site, write_scene
from highd_lc.io.synthetic_highd import encode
from highd_lc.traffic.film import Film
from highd_lc.traffic.lanes import PATH, VEHICLE, Drivers, FloatArray, IntArray, Road
from highd_lc.vocab import names
from highd_lc.vocab.errors import InputError, MissingExtraError
from highd_lc.vocab.sections import RecorderSettings

_UPSTREAM_M, _DOWNSTREAM_M = 1000.0, 500.0
_WARM_UP_S: Final = 120.0
_LONGEST_STEP_S: Final = 0.05
_LANE_CHANGES: Final = "SL2015"
_LATERAL_M: Final = 0.8
_TRUTH = ("vehicle_id", "origin_lane", "target_lane", "crossing_s", "crossing_frame")


@dataclass(frozen=True)
class Kind:
    """A type of SUMO's vehicles: length, width [m], factor of the limit (mean, deviation), share of its class."""

    name: str
    model: str
    vehicle_class: str
    length: float
    width: float
    factor: tuple[float, float]
    share: float


KINDS: Final = (
    Kind("car_eidm", "EIDM", names.CAR, 4.6, 1.9, (0.85, 0.12), 0.5),
    Kind("car_krauss", "Krauss", names.CAR, 4.4, 1.85, (0.85, 0.12), 0.5),
    Kind("truck_eidm", "EIDM", names.TRUCK, 14.0, 2.5, (0.6, 0.03), 1.0),
)
LIMIT_MPS: Final = 40.0


def synthesize(
    out: Path, *, recordings: int, seconds: float, seed: int, settings: RecorderSettings, workers: int = 1
) -> list[int]:
    """Write recordings 1 .. N of SUMO's traffic into a folder, with their truth; returns their numbers.

    Args:
        out: folder to write to.
        recordings: how many.
        seconds: length of each [s].
        seed: recording k depends on it, k, the settings and SUMO's version.
        settings: lanes, section, flow, share of trucks and frame rate; the drivers are SUMO's.
        workers: simulations side by side.

    Raises:
        MissingExtraError: SUMO is not installed.
        InputError: SUMO fails; the text is its own.
    """
    binaries = _binaries()
    numbers = list(range(1, recordings + 1))
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(lambda number: _write(out, number, seconds, seed, settings, binaries), numbers))
    return numbers


def _binaries() -> Path:
    try:
        import sumo
    except ImportError as error:
        raise MissingExtraError("SUMO is not installed: install highd-lc[sumo]") from error
    return Path(sumo.SUMO_HOME) / "bin"


def _write(out: Path, number: int, seconds: float, seed: int, settings: RecorderSettings, binaries: Path) -> None:
    site = draw_site(np.random.default_rng((seed, number, 0)), settings)
    filmed = {d: _film(site.markings(d), (seed, number, d), seconds, settings, binaries) for d in DIRECTIONS}
    films = {direction: film for direction, (film, _) in filmed.items()}
    scene = Scene(site, films, encode(films, site))
    truth = pd.concat([_truth(film, scene.tracks.ids[d], settings.frame_rate) for d, film in films.items()])
    drivers = pd.concat([_drivers(kinds, scene.tracks.ids[d]) for d, (_, kinds) in filmed.items()])
    truth, drivers = truth.sort_values(["vehicle_id", "crossing_frame"]), drivers.sort_values("vehicle_id")
    write_scene(out, number, scene, tables=(truth, drivers), seed=seed, rate=settings.frame_rate)


def _film(
    markings: FloatArray, key: tuple[int, ...], seconds: float, settings: RecorderSettings, binaries: Path
) -> tuple[Film, list[str]]:
    """A carriageway's film, and the kind of each of its drivers."""
    with tempfile.TemporaryDirectory(prefix="highd_lc-sumo-") as folder:
        seen = _simulate(Path(folder), markings, key, seconds, settings, binaries)
    kind_of = {kind.name: kind for kind in KINDS}
    drivers, driver = np.unique(seen["id"], return_inverse=True)
    first = seen.iloc[np.unique(driver, return_index=True)[1]]
    kinds = [str(name) for name in first["type"]]
    vehicles = np.zeros(len(drivers), dtype=VEHICLE)
    vehicles["length"] = [kind_of[name].length for name in kinds]
    vehicles["width"] = [kind_of[name].width for name in kinds]
    vehicles["truck"] = [kind_of[name].vehicle_class == names.TRUCK for name in kinds]
    motion = _motion(seen, driver, vehicles["length"], markings, settings)
    inside = (motion[:, 0] >= 0.0) & (motion[:, 0] <= settings.section_m)
    frame = seen["frame"].to_numpy()
    road = Road(markings, _UPSTREAM_M, settings.section_m, _DOWNSTREAM_M)
    none = np.empty((0, 1, 2))
    who = Drivers(vehicles, np.zeros(1, np.int64), none, none[:, None])
    frames = round(seconds * settings.frame_rate)
    rows = motion[inside]
    return Film(who, road, frames, driver[inside], frame[inside], rows, rows, np.empty(0, dtype=PATH)), kinds


def _motion(
    seen: pd.DataFrame, driver: IntArray, length: FloatArray, markings: FloatArray, settings: RecorderSettings
) -> FloatArray:
    """x, v, a, y, vy, ay of the box centres, (n, 6): x from the section's entry, y from the right edge."""
    x = seen["x"].to_numpy() - _UPSTREAM_M - length[driver] / 2.0
    y = seen["y"].to_numpy() + markings[-1]
    vy, ay = np.zeros(len(y)), np.zeros(len(y))
    order = np.argsort(driver, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(driver[order])) + 1):
        if len(rows) > 1:
            vy[rows] = np.gradient(y[rows], 1.0 / settings.frame_rate)
            ay[rows] = np.gradient(vy[rows], 1.0 / settings.frame_rate)
    return np.column_stack([x, seen["speed"], seen["acceleration"], y, vy, ay])


def _simulate(
    folder: Path,
    markings: FloatArray,
    key: tuple[int, ...],
    seconds: float,
    settings: RecorderSettings,
    binaries: Path,
) -> pd.DataFrame:
    """SUMO's floating car data of the filmed edge: frame, id, x, y, speed, acceleration, type; frame by frame."""
    _write_road(folder, markings, settings.section_m)
    _write_traffic(folder, len(markings) - 1, settings)
    (folder / "filmed.txt").write_text("edge:view\n", encoding="utf-8")
    _run(binaries / "netconvert", folder, "-n", "road.nod.xml", "-e", "road.edg.xml", "-o", "road.net.xml",
         "--no-turnarounds", "--no-internal-links")  # fmt: skip
    period = 1.0 / settings.frame_rate
    step = period / np.ceil(period / _LONGEST_STEP_S - 1e-9)
    end = _WARM_UP_S + seconds - period / 2.0
    seed = int(np.random.default_rng(key).integers(2**31))
    _run(binaries / "sumo", folder, "-n", "road.net.xml", "-r", "traffic.rou.xml", "--seed", str(seed),
         "--step-length", f"{step:.6f}", "--end", f"{end:.6f}", "--lateral-resolution", str(_LATERAL_M),
         "--fcd-output", "fcd.xml", "--fcd-output.acceleration", "--precision", "4",
         "--fcd-output.attributes", "x,y,speed,acceleration,type",
         "--fcd-output.filter-edges.input-file", "filmed.txt", "--device.fcd.begin", f"{_WARM_UP_S:.6f}",
         "--device.fcd.period", f"{period:.6f}", "--collision.action", "none", "--extrapolate-departpos",
         "--no-step-log", "--no-warnings")  # fmt: skip
    return _read(folder / "fcd.xml", settings.frame_rate)


def _run(binary: Path, folder: Path, *options: str) -> None:
    done = subprocess.run([str(binary), *options], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        said = " ".join((done.stderr or done.stdout).split())[:300]
        raise InputError(f"SUMO: {binary.name} failed: {said}")


def _write_road(folder: Path, markings: FloatArray, section: float) -> None:
    """Three edges one behind the other, with the markings' lanes; SUMO's lane 0 is the rightmost."""
    ends = np.cumsum([0.0, _UPSTREAM_M, section, _DOWNSTREAM_M])
    nodes = "".join(f'<node id="n{k}" x="{x:.2f}" y="0"/>' for k, x in enumerate(ends))
    lanes = "".join(f'<lane index="{k}" width="{width:.2f}"/>' for k, width in enumerate(np.diff(markings)))
    about = f'numLanes="{len(markings) - 1}" speed="{LIMIT_MPS}"'
    edges = "".join(
        f'<edge id="{name}" from="n{k}" to="n{k + 1}" {about}>{lanes}</edge>'
        for k, name in enumerate(("before", "view", "after"))
    )
    (folder / "road.nod.xml").write_text(f"<nodes>{nodes}</nodes>", encoding="utf-8")
    (folder / "road.edg.xml").write_text(f"<edges>{edges}</edges>", encoding="utf-8")


def _write_traffic(folder: Path, lanes: int, settings: RecorderSettings) -> None:
    shares = {names.CAR: 1.0 - settings.truck_share, names.TRUCK: settings.truck_share}
    kinds = "".join(
        f'<vType id="{k.name}" vClass="{"truck" if k.vehicle_class == names.TRUCK else "passenger"}" '
        f'carFollowModel="{k.model}" laneChangeModel="{_LANE_CHANGES}" length="{k.length}" width="{k.width}" '
        f'maxSpeed="55" speedFactor="normc({k.factor[0]},{k.factor[1]},0.4,1.3)" '
        f'probability="{k.share * shares[k.vehicle_class]:.4f}"/>'
        for k in KINDS
    )
    rate = settings.flow_veh_per_h * lanes / 3600.0
    (folder / "traffic.rou.xml").write_text(
        f'<routes><vTypeDistribution id="all">{kinds}</vTypeDistribution><route id="r" edges="before view after"/>'
        f'<flow id="f" type="all" route="r" begin="0" end="100000" period="exp({rate:.6f})" departLane="random" '
        f'departSpeed="desired" departPos="base"/></routes>',
        encoding="utf-8",
    )


def _read(path: Path, rate: float) -> pd.DataFrame:
    rows: list[tuple[int, int, float, float, float, float, str]] = []
    frame = 0
    for when, element in iterparse(path, events=("start", "end")):
        if when == "start" and element.tag == "timestep":
            frame = round((float(element.get("time", "nan")) - _WARM_UP_S) * rate)
        elif when == "end" and element.tag == "vehicle":
            x, y, v, a = (float(element.get(name, "nan")) for name in ("x", "y", "speed", "acceleration"))
            number = int(element.get("id", "").rpartition(".")[2])
            rows.append((frame, number, x, y, v, a, element.get("type", "").partition("@")[0]))
            element.clear()
    columns = ["frame", "id", "x", "y", "speed", "acceleration", "type"]
    return pd.DataFrame(rows, columns=columns).sort_values(["frame", "id"], kind="stable").reset_index(drop=True)


# --- truth ---


def _truth(film: Film, ids: IntArray, rate: float) -> pd.DataFrame:
    """Every change of lane in view: lanes from the right, the first frame with the centre in the target lane."""
    lanes = np.searchsorted(film.road.markings, film.true[:, 3], side="right")
    order = np.argsort(film.driver, kind="stable")
    changed = order[1:][(np.diff(lanes[order]) != 0) & (np.diff(film.driver[order]) == 0)]
    before = order[:-1][(np.diff(lanes[order]) != 0) & (np.diff(film.driver[order]) == 0)]
    frame = film.frame[changed]
    values = (ids[film.driver[changed]], lanes[before], lanes[changed], frame / rate, frame + 1)
    return pd.DataFrame(dict(zip(_TRUTH, values, strict=True)))


def _drivers(kinds: list[str], ids: IntArray) -> pd.DataFrame:
    """The model of each vehicle in view."""
    model = {kind.name: kind.model for kind in KINDS}
    seen = np.flatnonzero(ids)
    of_seen = [kinds[k] for k in seen]
    return pd.DataFrame(
        {
            "vehicle_id": ids[seen],
            "type": of_seen,
            "model": [model[k] for k in of_seen],
            "lane_changes": _LANE_CHANGES,
        }
    )
