"""Recordings with one fault each, made from the small fixtures: what a reader may meet and must not believe."""

import gzip
import random
from collections.abc import Callable, Iterator
from pathlib import Path

from shared_runs import FIXTURES

Files = dict[str, bytes | None]
"""Content by name, None = no such file; a recording is 01_recordingMeta.csv, 01_tracksMeta.csv, 01_tracks.csv."""

META, VEHICLES, TRACKS = "01_recordingMeta.csv", "01_tracksMeta.csv", "01_tracks.csv"
KINDS = (META, VEHICLES, TRACKS)
_NUMBERS = ("nan", "NaN", "inf", "-Infinity", "1e309", "-1e300", "9" * 40, "", " ", "x", "0x10", "1,5", "1_000",
            "--1", "\u0663", "1\x000", "<b>1</b>", "1.7976931348623157e308", "-0.0000001", "1e-320")  # fmt: skip
_READ = {
    META: ("frameRate", "upperLaneMarkings", "lowerLaneMarkings"),
    VEHICLES: ("id", "width", "height", "drivingDirection", "numFrames"),
    TRACKS: ("frame", "id", "x", "y", "xVelocity", "yAcceleration", "precedingId", "laneId"),
}


def small_recording(vehicles: int = 12) -> Files:
    """The first vehicles of the first fixture, their neighbours among them only."""
    rows = {name: (FIXTURES / name).read_bytes().splitlines() for name in KINDS}
    names = rows[TRACKS][0].decode().split(",")
    kept = [row.split(b",") for row in rows[TRACKS][1:] if int(row.split(b",")[names.index("id")]) <= vehicles]
    neighbours = [place for place, name in enumerate(names) if name.endswith(("ingId", "sideId"))]
    for cells in kept:
        for place in neighbours:
            cells[place] = cells[place] if int(cells[place]) <= vehicles else b"0"
    metas = [row for row in rows[VEHICLES][1:] if int(row.split(b",")[0]) <= vehicles]
    tables = {
        META: rows[META],
        VEHICLES: [rows[VEHICLES][0], *metas],
        TRACKS: [rows[TRACKS][0], *map(b",".join, kept)],
    }
    return {name: b"\n".join(lines) + b"\n" for name, lines in tables.items()}


REFUSED, TOLD, SAME = "refused", "told", "same"
"""What has to come of a fault: an error that names a file; a problem that is told or rows that are counted; or
what the good recording says.
"""

# Faults that are no reason to refuse a recording; all others are one.
_WAYS = ("CRLF", "BOM", "quoted", "spaces", "no last line feed")
_SAME = (
    *(f"encodings: {name} {way}" for name in KINDS for way in _WAYS),
    *(f"encodings: {name} CR" for name in (META, VEHICLES)),
    *(f"rows: {way}" for way in ("shuffled", "time goes back", "blank lines")),
    *(f"cells: {META} lowerLaneMarkings = {text!r}" for text in ("nan", "NaN", "", " ")),
    *(f"formats: {way}" for way in ("packed", "tracks packed", "upper-case suffixes")),
    *(f"formats: no lower carriageway: {way}" for way in ("empty", "a semicolon", "nan")),
)  # fmt: skip
# A place that a vehicle cannot be in for a frame breaks its track; a lane that is none is counted.
_TOLD = (
    "rows: a row twice", f"cells: {TRACKS} x = '1e-320'",
    f"cells: {TRACKS} x = '-0.0000001'", "conventions: laneId 12", "conventions: laneId -1",
)  # fmt: skip


def expected(name: str, files: Files) -> str:
    """What has to come of a fault of that name."""
    if name in _TOLD or name.startswith("broken:"):
        return TOLD
    # Cut is only the last line feed, or a 0 behind a decimal point too.
    whole = name.startswith("truncated:") and all(
        (files[kind] or b"").rstrip(cut) == content.rstrip(cut)
        for (kind, content), cut in zip(small_recording().items(), (b"\n0", b"\n", b"\n"), strict=True)
    )
    return SAME if whole or name in _SAME or name.startswith("texts: weekDay") else REFUSED


def mutated() -> Iterator[tuple[str, Files]]:
    """Every fault by its name, applied to the small recording."""
    good = small_recording()
    families = (_missing, _truncated, _cells, _columns, _rows, _broken, _encodings, _texts, _conventions, _formats)
    for family in families:
        for name, change in family(good):
            yield f"{family.__name__[1:]}: {name}", good | change


def _missing(good: Files) -> Iterator[tuple[str, Files]]:
    for name in KINDS:
        yield f"{name} empty", {name: b""}
        yield f"{name} one line feed", {name: b"\n"}
        yield f"{name} header only", {name: good[name].splitlines()[0] + b"\n"}
        yield f"{name} no header", {name: b"\n".join(good[name].splitlines()[1:])}
        yield f"{name} binary", {name: random.Random(1).randbytes(3000)}
        yield f"{name} zeros", {name: bytes(3000)}
        yield f"{name} one endless cell", {name: b"1" * 300_000}
        yield f"{name} endless line of commas", {name: b"," * 200_000 + b"\n" + b"," * 200_000}


def _truncated(good: Files) -> Iterator[tuple[str, Files]]:
    """In the header, at a comma, in a number, before and after a line feed, at random."""
    for name in KINDS:
        content, chance = good[name], random.Random(name)
        first, second = content.index(b"\n"), content.index(b"\n", content.index(b"\n") + 1)
        places = {3, first - 1, first, first + 1, first + 4, content.index(b",", first), second, len(content) - 1}
        places |= {len(content) - 2, *(chance.randrange(len(content)) for _ in range(6))}
        for place in sorted(places):
            yield f"{name} at byte {place}", {name: content[:place]}


def _cells(good: Files) -> Iterator[tuple[str, Files]]:
    for name, columns in _READ.items():
        for column in columns:
            for number in _NUMBERS if (name, column) in ((TRACKS, "x"), (TRACKS, "id")) else _NUMBERS[:9]:
                yield f"{name} {column} = {number[:12]!r}", {name: with_cell(good[name], column, number)}


def with_cell(content: bytes, column: str, text: str, *, row: int = -1) -> bytes:
    """Another text in a cell; row: of the data, -1 = the one in the middle, None = all."""
    lines = content.split(b"\n")
    place = lines[0].split(b",").index(column.encode())
    at = 1 + (len(lines) - 2) // 2 if row < 0 else 1 + row
    cells = lines[at].split(b",")
    cells[place] = text.encode("utf-8")
    return b"\n".join([*lines[:at], b",".join(cells), *lines[at + 1 :]])


def _columns(good: Files) -> Iterator[tuple[str, Files]]:
    for name, columns in _READ.items():
        for column in columns:
            yield f"{name} without {column}", {name: _renamed(good[name], column, "other")}
            yield f"{name} {column} twice", {name: good[name].replace(b"\n", b",%s\n" % column.encode(), 1)}
    for one, other in (("x", "y"), ("x", "xVelocity"), ("frame", "id"), ("laneId", "precedingId")):
        swapped = _renamed(_renamed(_renamed(good[TRACKS], one, "?"), other, one), "?", other)
        yield f"{one} and {other} swapped", {TRACKS: swapped}
    for delimiter in (b";", b"\t", b" "):
        yield f"delimiter {delimiter!r}", {TRACKS: good[TRACKS].replace(b",", delimiter)}
    yield "a cell more", {TRACKS: good[TRACKS].replace(b"\n", b",7\n").replace(b",7\n", b"\n", 1)}
    yield "tables exchanged", {TRACKS: good[VEHICLES], VEHICLES: good[TRACKS]}


def _renamed(content: bytes, column: str, name: str) -> bytes:
    header, rest = content.split(b"\n", 1)
    words = [name.encode() if word == column.encode() else word for word in header.split(b",")]
    return b",".join(words) + b"\n" + rest


def _rows(good: Files) -> Iterator[tuple[str, Files]]:
    header, *rows = good[TRACKS].splitlines()
    chance = random.Random(3)

    def tracks(changed: list[bytes]) -> Files:
        return {TRACKS: b"\n".join([header, *changed]) + b"\n"}

    yield "every row twice", tracks([row for row in rows for _ in (0, 1)])
    yield "a row twice", tracks([*rows, rows[5]])
    yield (
        "a row twice with another x",
        {TRACKS: good[TRACKS] + with_cell(b"\n".join([header, rows[5]]), "x", "1.5").split(b"\n")[1] + b"\n"},
    )
    yield "shuffled", tracks(chance.sample(rows, len(rows)))
    yield "time goes back", tracks(rows[::-1])
    yield "every third row missing", tracks([row for k, row in enumerate(rows) if k % 3])
    yield "one row a vehicle", tracks(list({row.split(b",")[1]: row for row in rows}.values()))
    yield "blank lines", tracks([row for k in rows for row in (k, b"")])
    yield "rows of a stranger", {TRACKS: with_cell(good[TRACKS], "id", "777")}
    yield "all of one id", tracks([with_cell(header + b"\n" + row, "id", "1").split(b"\n")[1] for row in rows])
    metas = good[VEHICLES].splitlines()
    yield "a vehicle twice", {VEHICLES: good[VEHICLES] + metas[1] + b"\n"}
    yield "a vehicle without rows", {VEHICLES: with_cell(good[VEHICLES], "id", "778")}
    yield "recordingMeta of two rows", {META: good[META] + good[META].splitlines()[1] + b"\n"}


def _broken(good: Files) -> Iterator[tuple[str, Files]]:
    """Vehicles 9 and 12 lost or mixed up by a tracker, from the middle of the first one's track on."""
    header, *rows = good[TRACKS].splitlines()
    of = {vehicle: [k for k, row in enumerate(rows) if row.split(b",")[1] == vehicle] for vehicle in (b"9", b"12")}
    half = len(of[b"9"]) // 2
    middle = of[b"9"][half]
    frame = int(rows[middle].split(b",")[0])

    def tracks(cells: dict[int, tuple[str, str]], dropped: frozenset[int] = frozenset()) -> Files:
        changed = [
            with_cell(header + b"\n" + row, *cells[k]).split(b"\n")[1] if k in cells else row
            for k, row in enumerate(rows)
            if k not in dropped
        ]
        return {TRACKS: b"\n".join([header, *changed]) + b"\n"}

    def moved(column: str, metres: float) -> Files:
        place = header.split(b",").index(column.encode())
        later = [k for k in of[b"9"] if k >= middle]
        return tracks({k: (column, f"{float(rows[k].split(b',')[place]) + metres:.2f}") for k in later})

    for count in (1, 5, 20):
        yield f"{count} frames missing", tracks({}, frozenset(of[b"9"][half - count : half]))
    for column, metres in (("x", 4.0), ("x", -60.0), ("y", 3.6)):
        yield f"{metres:+.1f} m in {column}", moved(column, metres)
    swapped = {k: ("id", "12") for k in of[b"9"] if int(rows[k].split(b",")[0]) >= frame}
    swapped |= {k: ("id", "9") for k in of[b"12"] if int(rows[k].split(b",")[0]) >= frame}
    yield "two ids swapped", tracks(swapped)


def _encodings(good: Files) -> Iterator[tuple[str, Files]]:
    ways: dict[str, Callable[[bytes], bytes]] = {
        "CRLF": lambda c: c.replace(b"\n", b"\r\n"),
        "CR": lambda c: c.replace(b"\n", b"\r"),
        "BOM": lambda c: b"\xef\xbb\xbf" + c,
        "UTF-16": lambda c: c.decode().encode("utf-16"),
        "UTF-32": lambda c: c.decode().encode("utf-32"),
        "Latin-1 in the header": lambda c: c.replace(b"\n", b",gr\xf6\xdfe\n", 1),
        "Latin-1 in the last cells": lambda c: c.replace(b"\n", b"\xf6\n"),
        "quoted": lambda c: b"".join(b'"%s"\n' % line.replace(b",", b'","') for line in c.splitlines()),
        "an open quote": lambda c: c.replace(b"\n", b'\n"', 1),
        "spaces": lambda c: c.replace(b",", b", "),
        "no last line feed": lambda c: c.rstrip(b"\n"),
        "EBCDIC": lambda c: c.decode().encode("cp500"),
        "gzip": lambda c: gzip.compress(c, mtime=0),
    }  # fmt: skip
    for name in KINDS:
        for way, change in ways.items():
            yield f"{name} {way}", {name: change(good[name])}


HOSTILE = ("<script>alert(1)</script>", "Car<img src=x onerror=alert(1)>", "'; DROP TABLE", "../../etc/passwd",
           "{{7*7}}", "%s%n", "Car\u202e", "\U0001f697", "=cmd()", "a" * 5000)  # fmt: skip


def _texts(good: Files) -> Iterator[tuple[str, Files]]:
    for text in HOSTILE:
        yield f"class {text[:20]!r}", {VEHICLES: with_cell(good[VEHICLES], "class", text)}
        yield f"markings {text[:20]!r}", {META: with_cell(good[META], "upperLaneMarkings", text)}
        yield f"weekDay {text[:20]!r}", {META: with_cell(good[META], "weekDay", text)}


def _conventions(good: Files) -> Iterator[tuple[str, Files]]:
    for column in ("width", "height"):
        for size in ("0", "-4", "0.0000001", "1000"):
            yield f"{column} {size}", {VEHICLES: with_cell(good[VEHICLES], column, size)}
    for rate in ("0", "-25", "0.01", "1e6"):
        yield f"frame rate {rate}", {META: with_cell(good[META], "frameRate", rate)}
    for direction in ("0", "3", "1.5"):
        yield f"direction {direction}", {VEHICLES: with_cell(good[VEHICLES], "drivingDirection", direction)}
    for markings in ("1;2;1", "5", "3;3", ";", "1;nan", "1;inf", "10;5", "-1e300;1e300", "100;200;300"):
        yield f"markings {markings}", {META: with_cell(good[META], "upperLaneMarkings", markings)}
    for frame in ("-1", "0", "99999999", "1.5"):
        yield f"frame {frame}", {TRACKS: with_cell(good[TRACKS], "frame", frame)}
    for name in ("0.005", "12", "-1"):
        yield f"laneId {name}", {TRACKS: with_cell(good[TRACKS], "laneId", name)}
    yield "direction of everybody turned", {VEHICLES: _turned(good[VEHICLES])}


def _formats(good: Files) -> Iterator[tuple[str, Files]]:
    """What people have on their disks."""
    packed = {f"{name}.gz": gzip.compress(content, mtime=0) for name, content in good.items()}
    yield "packed", packed | dict.fromkeys(good)
    yield "tracks packed", {TRACKS: None, f"{TRACKS}.gz": packed[f"{TRACKS}.gz"]}
    yield "upper-case suffixes", {n.replace(".csv", ".CSV"): c for n, c in good.items()} | dict.fromkeys(good)
    yield "torn pack", {TRACKS: None, f"{TRACKS}.gz": packed[f"{TRACKS}.gz"][:4000]}
    for name in (VEHICLES, TRACKS):
        excel = good[name].replace(b",", b";")
        yield f"{name} semicolons", {name: excel}
        yield f"{name} semicolons and decimal commas", {name: excel.replace(b".", b",")}
        yield f"{name} tabs and decimal commas", {name: excel.replace(b".", b",").replace(b";", b"\t")}
    for way, text in (("empty", ""), ("a semicolon", ";"), ("nan", "nan")):
        table = [line.split(b",") for line in good[META].splitlines()]
        table[1][table[0].index(b"lowerLaneMarkings")] = text.encode()
        yield f"no lower carriageway: {way}", {META: b"\n".join(map(b",".join, table)) + b"\n"}


def _turned(content: bytes) -> bytes:
    table = [line.split(b",") for line in content.splitlines()]
    place = table[0].index(b"drivingDirection")
    for row in table[1:]:
        row[place] = b"1" if row[place] == b"2" else b"2"
    return b"\n".join(b",".join(row) for row in table) + b"\n"


def write(folder: Path, files: Files) -> Path:
    """Write a recording into a folder that is made for it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        if content is not None:
            (folder / name).write_bytes(content)
    return folder
