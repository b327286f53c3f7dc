"""A lane change replayed in SUMO: the AV and the leaders are moved along their ways, the followers are SUMO's.

The extra ``sumo`` brings it. The road is straight and has a lane on either side of origin and target lane; lanes
are as wide as the AV's lateral shift, so that SUMO, too, has the AV on the target lane from half of its way on.
SUMO knows positions, speeds and sizes, and nothing of any model of this package. Its followers want the speeds of
``io.sumo``'s drivers, but none a lower one than it has at the start, and change no lane. Krauss' dawdling, white
noise from step to step, is off: it would be most of a loss of comfort. So is the rule not to overtake on the
right, by which they would brake for an AV that is on its origin lane still.
"""

import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.sumo import KINDS, LIMIT_MPS, Kind
from highd_lc.vocab import names
from highd_lc.vocab.errors import InputError, MissingExtraError

FloatArray = NDArray[np.float64]

_BEHIND_M, _ROAD_M = 3000.0, 9000.0
_LANES: Final = 4
_PAST_M, _LOST_M = 0.001, 0.01
_TRUCK_M: Final = 7.5
"""A longer vehicle is a truck: a scene knows sizes, no classes."""
_NO_DAWDLING: Final = {"Krauss": ' sigma="0"'}
_ONE_AT_A_TIME: Final = threading.Lock()
"""A process has one libsumo."""


@dataclass(frozen=True)
class Moved:
    """Who is moved: front, left of the origin lane's centre [m], speed [m/s], each (N + 1,); length, width [m]."""

    front: FloatArray
    y: FloatArray
    v: FloatArray
    length: float
    width: float


@dataclass(frozen=True)
class Driven:
    """Whom SUMO drives on the target lane, nearest first: front [m], speed [m/s], length, width [m], each (p,)."""

    front: FloatArray
    v: FloatArray
    length: FloatArray
    width: FloatArray


def refuse_missing() -> None:
    """Raise MissingExtraError if SUMO is not installed."""
    if find_spec("libsumo") is None or find_spec("sumo") is None:
        raise MissingExtraError(
            "validate.sumo.events: SUMO is not installed: install highd-lc[sumo], or set it to 0"
        )


def drive(
    moved: Sequence[Moved], driven: Driven, *, lateral_shift: float, dt: float, model: str, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Front [m], speed [m/s] and acceleration [m/s^2] of SUMO's followers, each of shape (p, N + 1).

    Args:
        moved: the AV and the leaders.
        driven: the followers at the first sample.
        lateral_shift: from the origin lane's centre to the target lane's, left positive [m].
        dt: step [s].
        model: of the cars: ``EIDM`` or ``Krauss``; trucks drive by EIDM.
        seed: of everything that SUMO and the wanted speeds draw.

    Returns:
        Accelerations are those that lead from a sample to the next, as a command does (equations.md 3).

    Raises:
        MissingExtraError: SUMO is not installed.
        InputError: SUMO refuses the scene; the text is its own.
    """
    refuse_missing()
    kinds = [_kind(length, model) for length in driven.length]
    wanted = _factors(kinds, driven.v, np.random.default_rng(seed))
    samples = len(moved[0].front)
    x, v = (np.empty((len(kinds), samples + 1)) for _ in range(2))
    with _simulation(abs(lateral_shift), dt, seed) as sumo:
        _add(sumo, moved, driven, lateral_shift, list(zip(kinds, wanted, strict=True)))
        for k in range(samples + 1):
            if k > 0:  # never after the last step: what is moved without a step haunts the next run
                _move(sumo, moved, k, lateral_shift, dt)
            sumo.simulationStep()
            for i in range(len(kinds)):
                x[i, k], v[i, k] = sumo.vehicle.getLanePosition(f"f{i}"), sumo.vehicle.getSpeed(f"f{i}")
            _show(sumo, moved, k, dt)
    _refuse_lost(x[:, 0] - _BEHIND_M, driven.front)
    return x[:, :-1] - _BEHIND_M, v[:, :-1], np.diff(v, axis=1) / dt


def _refuse_lost(found: FloatArray, wanted: FloatArray) -> None:
    """Raise InputError if a follower is not where it has to begin."""
    if lost := np.flatnonzero(~(np.abs(found - wanted) < _LOST_M)).tolist():
        raise InputError(f"SUMO: follower {lost[0] + 1} is not where it has to begin, at {wanted[lost[0]]:.1f} m")


def _kind(length: float, model: str) -> Kind:
    """The kind of ``io.sumo`` that a follower is."""
    vehicle_class = names.TRUCK if length > _TRUCK_M else names.CAR
    of_class = [kind for kind in KINDS if kind.vehicle_class == vehicle_class]
    return next((kind for kind in of_class if kind.model == model), of_class[0])


def _factors(kinds: Sequence[Kind], v: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Each follower's wanted speed as a share of the limit: drawn, at least what it has at the start."""
    drawn = np.array([rng.normal(*kind.factor) for kind in kinds])
    return np.asarray(np.maximum(drawn, v / LIMIT_MPS))


@contextmanager
def _simulation(lane_width: float, dt: float, seed: int) -> Iterator[Any]:
    with _ONE_AT_A_TIME, redirect_stdout(StringIO()):  # it warns of another pyarrow than the one it never uses
        import libsumo
    with _ONE_AT_A_TIME, tempfile.TemporaryDirectory(prefix="highd_lc-sumo-") as folder:
        net, kinds = Path(folder) / "road.net.xml", Path(folder) / "kinds.rou.xml"
        net.write_text(_road(lane_width), encoding="utf-8")
        kinds.write_text(_types(), encoding="utf-8")
        options: dict[str, object] = {
            "--net-file": net, "--route-files": kinds, "--step-length": dt, "--seed": seed % 2**31,
            "--insertion-checks": "none", "--collision.action": "none", "--time-to-teleport": -1,
            "--no-step-log": "true", "--no-warnings": "true",
        }  # fmt: skip
        try:
            libsumo.start(["sumo", *(str(word) for pair in options.items() for word in pair)])
            yield libsumo
        except libsumo.TraCIException as error:
            with suppress(libsumo.TraCIException):
                libsumo.simulationStep()  # what is moved without a step haunts the next run
            raise InputError(f"SUMO: {' '.join(str(error).split())[:300]}") from error
        finally:
            libsumo.close()


def _road(width: float) -> str:
    """A straight road as SUMO's network file; lane 0 is the rightmost, y = 0 the left edge."""
    lanes = "".join(
        f'<lane id="e_{k}" index="{k}" speed="{LIMIT_MPS}" length="{_ROAD_M}" width="{width:.4f}" '
        f'shape="0,{_level(k, width):.4f} {_ROAD_M},{_level(k, width):.4f}"/>'
        for k in range(_LANES)
    )
    ends = "".join(
        f'<junction id="{name}" type="dead_end" x="{x}" y="0" incLanes="{lanes_in}" intLanes="" '
        f'shape="{x},0 {x},{-_LANES * width:.4f}"/>'
        for name, x, lanes_in in (("a", 0.0, ""), ("b", _ROAD_M, " ".join(f"e_{k}" for k in range(_LANES))))
    )
    return (
        f'<net version="1.20"><location netOffset="0,0" convBoundary="0,{-_LANES * width:.4f},{_ROAD_M},0" '
        f'origBoundary="0,0,0,0" projParameter="!"/><edge id="e" from="a" to="b" priority="-1">{lanes}</edge>'
        f"{ends}</net>"
    )


def _level(lane: int, width: float) -> float:
    """The centre of a lane in SUMO's y [m]."""
    return (lane + 0.5 - _LANES) * width


def _types() -> str:
    kinds = "".join(
        f'<vType id="{kind.name}" vClass="{"truck" if kind.vehicle_class == names.TRUCK else "passenger"}" '
        f'carFollowModel="{kind.model}" lcOvertakeRight="1" maxSpeed="55"{_NO_DAWDLING.get(kind.model, "")}/>'
        for kind in KINDS
    )
    return f'<routes>{kinds}<vType id="moved" maxSpeed="100"/><route id="r" edges="e"/></routes>'


def _lane_of(y: float, lateral_shift: float) -> int:
    """The lane at y [m] from the origin lane's centre: origin and target lane are the two in the middle."""
    origin = 1 if lateral_shift > 0.0 else 2
    return int(np.clip(np.rint(y / abs(lateral_shift)) + origin, 0, _LANES - 1))


def _add(
    sumo: Any, moved: Sequence[Moved], driven: Driven, lateral_shift: float, wanted: Sequence[tuple[Kind, float]]
) -> None:
    for i, one in enumerate(moved):
        lane = _lane_of(float(one.y[0]), lateral_shift)
        _add_one(sumo, f"m{i}", "moved", (lane, one.front[0], one.v[0]), (one.length, one.width))
    for i, (kind, factor) in enumerate(wanted):
        state = _lane_of(lateral_shift, lateral_shift), driven.front[i], driven.v[i]
        _add_one(sumo, f"f{i}", kind.name, state, (driven.length[i], driven.width[i]))
        sumo.vehicle.setSpeedFactor(f"f{i}", float(factor))
        sumo.vehicle.setLaneChangeMode(f"f{i}", 0)


def _add_one(sumo: Any, name: str, kind: str, state: tuple[int, float, float], size: tuple[float, float]) -> None:
    lane, front, v = state
    place = {"departLane": str(lane), "departPos": f"{front + _BEHIND_M:.6f}", "departSpeed": f"{v:.6f}"}
    sumo.vehicle.add(name, "r", kind, **place)
    sumo.vehicle.setLength(name, float(size[0]))
    sumo.vehicle.setWidth(name, float(size[1]))


def _show(sumo: Any, moved: Sequence[Moved], k: int, dt: float) -> None:
    """Show everybody the speed of those that are moved at sample k, where SUMO has that of its last step."""
    for i, one in enumerate(moved):
        at, before = min(k, len(one.v) - 1), max(min(k, len(one.v) - 1) - 1, 0)
        sumo.vehicle.setPreviousSpeed(f"m{i}", float(one.v[at]), float(one.v[at] - one.v[before]) / dt)


def _move(sumo: Any, moved: Sequence[Moved], k: int, lateral_shift: float, dt: float) -> None:
    """Have those that are moved be where they are at sample k after the next step."""
    width = abs(lateral_shift)
    origin = _level(_lane_of(0.0, lateral_shift), width)
    for i, one in enumerate(moved):
        at = min(k, len(one.front) - 1)
        front = float(one.front[at]) + (k - at) * dt * float(one.v[at]) + _BEHIND_M
        # Half of the way is on the target lane, on the left as on the right.
        y = origin + float(one.y[at]) + float(np.copysign(_PAST_M, lateral_shift))
        sumo.vehicle.moveToXY(f"m{i}", "e", -1, front, y, angle=90.0, keepRoute=1)
