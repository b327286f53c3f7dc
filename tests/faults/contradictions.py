"""Recordings whose columns contradict each other, each with what has to come of it.

Every fault is a change of the three tables of the first fixture. It states what is right: an error that names the
column (``REFUSED``), a warning or a listed problem that does (``TOLD``), or the lane changes of the clean
recording within a tolerance (``KEPT``).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
from shared_runs import FIXTURES

KINDS = ("tracks", "tracksMeta", "recordingMeta")
REFUSED, TOLD, KEPT = "refused", "told", "kept"
FEET = 3.28084
LEADER, FOLLOWER, EGO, AT = 13, 17, 16, 24
"""Of the event 01-0016-00035: its target leader, its first target follower, the ego, and a frame at its start."""


@dataclass(frozen=True)
class Fault:
    """A change of the tables ``t`` (tracks), ``v`` (tracksMeta), ``m`` (recordingMeta), what has to come of it,
    the words that have to be said, and how far the gaps may be from those of the clean recording [m].
    """

    name: str
    change: Callable[[SimpleNamespace], None]
    expected: str = REFUSED
    says: str = ""
    tolerance: float = 0.0


def tables() -> SimpleNamespace:
    """The clean recording."""
    t, v, m = (pd.read_csv(FIXTURES / f"01_{kind}.csv") for kind in KINDS)
    return SimpleNamespace(t=t, v=v, m=m)


def write(folder: Path, fault: Fault) -> Path:
    """Write the changed recording into a folder that is made for it."""
    changed = tables()
    fault.change(changed)
    folder.mkdir(parents=True)
    for kind, frame in zip(KINDS, (changed.t, changed.v, changed.m), strict=True):
        frame.to_csv(folder / f"01_{kind}.csv", index=False)
    return folder


def faults() -> Iterator[Fault]:
    """Every fault."""
    for family in (
        _ids,
        _sizes,
        _signs,
        _units,
        _directions,
        _places,
        _rates,
        _metas,
        _noises,
        _holes,
        _crossings,
    ):
        yield from (Fault(f"{family.__name__[1:]}: {f.name}", f.change, f.expected, f.says, f.tolerance)
                    for f in family())  # fmt: skip


def scaled(kind: str, columns: str, factor: float, *, direction: int = 0) -> Callable[[SimpleNamespace], None]:
    """Columns multiplied by a factor; direction: in the vehicles of one only, 0 = all."""

    def change(r: SimpleNamespace) -> None:
        frame = getattr(r, kind)
        own = r.v["id"][r.v["drivingDirection"] == direction] if direction else r.v["id"]
        rows = frame["id"].isin(own)
        for column in columns.split():
            frame[column] = frame[column].where(~rows, (frame[column] * factor).round(4))

    return change


def put(kind: str, **columns: object) -> Callable[[SimpleNamespace], None]:
    """Columns replaced by a value, or by what a function makes of the table."""

    def change(r: SimpleNamespace) -> None:
        frame = getattr(r, kind)
        made = {name: value(frame) if callable(value) else value for name, value in columns.items()}
        setattr(r, kind, frame.assign(**made))

    return change


def without_columns(kind: str, *columns: str) -> Callable[[SimpleNamespace], None]:
    """Columns left out."""
    return lambda r: setattr(r, kind, getattr(r, kind).drop(columns=list(columns)))


def swapped(kind: str, one: str, other: str) -> Callable[[SimpleNamespace], None]:
    """Two columns in each other's place."""
    return put(kind, **{one: lambda f: f[other], other: lambda f: f[one]})


def both(*changes: Callable[[SimpleNamespace], None]) -> Callable[[SimpleNamespace], None]:
    """Several changes."""

    def change(r: SimpleNamespace) -> None:
        for one in changes:
            one(r)

    return change


def only(chosen: Callable[[pd.DataFrame], pd.Series]) -> Callable[[SimpleNamespace], None]:
    """Some vehicles only, by their metas."""

    def change(r: SimpleNamespace) -> None:
        r.v = r.v[chosen(r.v)]
        r.t = r.t[r.t["id"].isin(r.v["id"])]

    return change


def _ids() -> Iterator[Fault]:
    empty = "column 'precedingId'.* it is 0 there"
    strangers = "column 'precedingId'.* ids that the file does not hold"
    named = lambda f: f["precedingId"] > 0  # noqa: E731
    yield Fault("both empty", put("t", precedingId=0, followingId=0), says=empty)
    yield Fault("preceding empty", put("t", precedingId=0), says=empty)
    yield Fault("following empty", put("t", followingId=0), says="column 'followingId'.* it is 0 there")
    yield Fault("empty in one direction", scaled("t", "precedingId", 0, direction=1), says=empty)
    yield Fault("unknown", put("t", precedingId=lambda f: f["precedingId"] + 100_000 * named(f)), says=strangers)
    yield Fault("swapped", swapped("t", "precedingId", "followingId"), says="precedingId and followingId swapped")
    yield Fault("off by one", put("t", precedingId=lambda f: f["precedingId"] + named(f)), says="precedingId")
    yield Fault("of the left lane", put("t", precedingId=lambda f: f["leftPrecedingId"]), says="precedingId")
    yield Fault("every fifth vehicle only", only(lambda v: v["id"] % 5 == 0), says=strangers)
    yield Fault(
        "some empty", put("t", precedingId=lambda f: f["precedingId"].where(f["id"] % 5 > 0, 0)), TOLD,
        r"column 'precedingId': \d+ of \d+ vehicles",
    )  # fmt: skip
    yield Fault("every other vehicle missing", only(lambda v: v["id"] % 2 == 0), TOLD, strangers)


def _sizes() -> Iterator[Fault]:
    longer = put("v", width=lambda f: f["width"] + 2.5)
    unsaid = put("v", minDHW=-1.0, minTHW=-1.0)
    yield Fault("lengths of the metas", longer, says=r"column 'width'.* 2\.50 m more")
    yield Fault("lengths of the metas, no gaps there", both(longer, unsaid), says="column 'width'")
    yield Fault("lengths of the tracks", put("t", width=lambda f: f["width"] + 1), says="column 'width'")
    yield Fault("widths of the metas", scaled("v", "height", 1.3), says="column 'height'")
    both_longer = both(longer, unsaid, put("t", width=lambda f: f["width"] + 2.5))
    yield Fault("lengths of both", both_longer, says="column 'dhw'")
    turned = both(swapped("v", "width", "height"), swapped("t", "width", "height"))
    yield Fault("length and width swapped", turned, says="width and height swapped")
    classes = {"Car": "Truck", "Truck": "Car"}
    yield Fault("classes swapped", put("v", **{"class": lambda f: f["class"].map(classes)}), says="swapped")
    yield Fault("gaps", scaled("t", "dhw", 1.5), says="column 'dhw'")
    some = put("v", width=lambda f: f["width"] + (f["id"] % 7 == 0))
    yield Fault("lengths of some", some, TOLD, r"column 'width': \d+ of \d+ vehicles")
    yield Fault("no sizes in the tracks", without_columns("t", "width", "height"), KEPT)
    yield Fault("junk where nothing is needed", put("t", width="?", height="", dhw="-", thw="inf"), KEPT)


def _signs() -> Iterator[Fault]:
    for column, words in (("xVelocity", "speeds"), ("xAcceleration", "accelerations")):
        for direction in (0, 1, 2):
            yield Fault(f"{column} {direction}", scaled("t", column, -1, direction=direction),
                        says=f"column '{column}'.* {words} .*wrong sign")  # fmt: skip
    yield Fault("yVelocity", scaled("t", "yVelocity yAcceleration", -1), says="column 'yVelocity'.*wrong sign")
    yield Fault("yAcceleration", scaled("t", "yAcceleration", -1), says="column 'yAcceleration'.*wrong sign")
    absolute = put("t", xVelocity=lambda f: f["xVelocity"].abs())
    yield Fault("speeds without sign", absolute, says="column 'xVelocity'.* direction 1 .*wrong sign")
    yield Fault("no accelerations", put("t", xAcceleration=0.0), says="column 'xAcceleration'.* empty")
    yield Fault("no lateral speeds", put("t", yVelocity=0.0), says="column 'yVelocity'.* empty")


_MARKINGS = ("upperLaneMarkings", "lowerLaneMarkings")


def _in_feet(markings: str) -> str:
    return ";".join(f"{FEET * float(y):.2f}" for y in markings.split(";"))


def _units() -> Iterator[Fault]:
    lengths = "x y width height xVelocity yVelocity xAcceleration yAcceleration dhw"
    marked = {side: lambda f, side=side: f[side].map(_in_feet) for side in _MARKINGS}
    feet = both(scaled("t", lengths, FEET), scaled("v", "width height traveledDistance minDHW", FEET),
                put("m", **marked))  # fmt: skip
    yield Fault("all in feet", feet, says="LaneMarkings'.*a recording in feet")
    yield Fault("sizes in feet", both(scaled("t", "width height", FEET), scaled("v", "width height", FEET)),
                says="columns 'width, height'.* in feet")  # fmt: skip
    yield Fault("positions in feet", scaled("t", "x y", FEET))
    yield Fault("positions in centimetres", scaled("t", "x y", 100))
    yield Fault("speeds in km/h", scaled("t", "xVelocity yVelocity", 3.6), says="column 'xVelocity'.* in km/h")
    yield Fault("speeds in feet a second", scaled("t", "xVelocity yVelocity", FEET), says="feet a second")
    yield Fault("accelerations in g", scaled("t", "xAcceleration", 1 / 9.81), says="column 'xAcceleration'")
    yield Fault("accelerations in feet", scaled("t", "xAcceleration", FEET), says="column 'xAcceleration'")


def _directions() -> Iterator[Fault]:
    question = "left-hand traffic, or directions swapped"
    yield Fault("swapped", put("v", drivingDirection=lambda f: 3 - f["drivingDirection"]), says=question)
    yield Fault("all 2", put("v", drivingDirection=2), says=question)
    yield Fault("all 1", put("v", drivingDirection=1), says=question)

    def mirror(r: SimpleNamespace) -> None:
        r.t["x"] = (r.t["x"] + r.t["width"]).max() - r.t["x"] - r.t["width"]
        r.t[["xVelocity", "xAcceleration"]] *= -1

    yield Fault("left-hand traffic", mirror, says="drive towards.*left-hand traffic")


def _places() -> Iterator[Fault]:
    yield Fault("x and y swapped", swapped("t", "x", "y"))
    yield Fault("speeds and accelerations swapped", swapped("t", "xVelocity", "xAcceleration"), says="xVelocity")
    centre = put("t", y=lambda f: f["y"] + f["height"] / 2)
    yield Fault("y of the centre", centre, says="column 'y'.* is y that of the box's centre")
    yield Fault("y of the lower edge", put("t", y=lambda f: f["y"] + f["height"]), says="laneId")
    yield Fault("lanes from 0", put("t", laneId=lambda f: f["laneId"] - 1), says="laneId")
    yield Fault("markings of another place", put("m", lowerLaneMarkings="60.00;63.75;67.50;71.25"))


def _rates() -> Iterator[Fault]:
    for rate in (6, 12.5, 25):
        yield Fault(
            f"{rate} Hz", put("m", frameRate=rate), says=f"frameRate 10 instead of {rate:g}|frameRate 9.99"
        )


def _metas() -> Iterator[Fault]:
    for column in ("numFrames", "numLaneChanges", "initialFrame", "finalFrame"):
        yield Fault(column, put("v", **{column: lambda f, c=column: f[c] + 1}), says=column)
        some = put("v", **{column: lambda f, c=column: f[c] + (f["id"] % 7 == 0)})
        yield Fault(f"{column} of some", some, TOLD, column)
    yield Fault("minDHW", put("v", minDHW=lambda f: f["minDHW"] + 0.2), TOLD, "minDHW")
    yield Fault("minTHW", put("v", minTHW=lambda f: f["minTHW"] + 0.2), TOLD, "minTHW")
    yield Fault("traveledDistance", scaled("v", "traveledDistance", 2), TOLD, "traveledDistance")


def _noises() -> Iterator[Fault]:
    """What trackers leave, and no error."""
    draw = np.random.default_rng(1)
    white = put("t", x=lambda f: f["x"] + draw.normal(0, 0.05, len(f)),
                y=lambda f: f["y"] + draw.normal(0, 0.02, len(f)))  # fmt: skip
    yield Fault("white noise", white, KEPT, tolerance=1.5)
    yield Fault("bias", put("t", xAcceleration=lambda f: f["xAcceleration"] + 0.3), KEPT)

    def drift(r: SimpleNamespace) -> None:
        sign = np.where(r.t["id"].isin(r.v["id"][r.v["drivingDirection"] == 1]), -1.0, 1.0)
        seen = (r.t["frame"] - r.t.groupby("id")["frame"].transform("min")) / r.m["frameRate"][0]
        r.t["xVelocity"] += sign * 0.3 * seen
        r.t["xAcceleration"] += sign * 0.3

    yield Fault("drift", drift, KEPT)
    yield Fault("one carriageway", only(lambda v: v["drivingDirection"] == 2), KEPT)


def _holes() -> Iterator[Fault]:
    def without(vehicle: int, first: int, last: int, *, back: float = 0.0) -> Callable[[SimpleNamespace], None]:
        def change(r: SimpleNamespace) -> None:
            own = r.t["id"] == vehicle
            way = np.sign(r.t.loc[own, "xVelocity"].iloc[0])
            r.t["x"] -= way * back * (own & (r.t["frame"] > last))
            r.t = r.t[~(own & r.t["frame"].between(first, last))]
            r.v["numFrames"] = r.v["id"].map(r.t.groupby("id").size())

        return change

    for role, vehicle in (("leader", LEADER), ("follower", FOLLOWER), ("ego", EGO)):
        says = rf"vehicle {vehicle} (misses|jumps)"
        yield Fault(f"{role} misses 20 frames", without(vehicle, AT - 10, AT + 9), TOLD, says)
        yield Fault(f"{role} misses 2 frames", without(vehicle, AT, AT + 1), TOLD, says)
        yield Fault(f"{role} returns upstream", without(vehicle, AT + 1, AT + 20, back=150.0), TOLD, says)
        yield Fault(f"{role} jumps", without(vehicle, AT, AT - 1, back=40.0), TOLD, says)


def _crossings() -> Iterator[Fault]:
    def lost(lane: int) -> Callable[[SimpleNamespace], None]:
        def change(r: SimpleNamespace) -> None:
            r.t.loc[(r.t["id"] == EGO) & (r.t["frame"] == 35), "laneId"] = lane

        return change

    for lane in (0, -1, 99):
        yield Fault(f"laneId {lane} at one crossing", lost(lane), KEPT)
