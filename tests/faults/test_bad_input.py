"""Bad recordings end in a named error or a counted exclusion: no traceback, no hang, no silent wrong number."""

import os
import warnings
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from faulty_runs import Place, contents, copy_of_fixtures, run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutations import (
    KINDS,
    REFUSED,
    SAME,
    TOLD,
    TRACKS,
    Files,
    expected,
    mutated,
    small_recording,
    with_cell,
    write,
)

from highd_lc.io import artefacts
from highd_lc.io.highd import Recording, read_recording, split_tracks
from highd_lc.stages import ingest
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Job, Provenance
from highd_lc.vocab.settings import Settings

_MUTATED = list(mutated())
_EXAMPLES = 2000 if os.environ.get("HIGHD_LC_FAULTS") else 150
_GOOD = small_recording()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_recording(write(tmp_path_factory.mktemp("good"), _GOOD), 1)


def _read(folder: Path, files: Files) -> Recording | InputError:
    """The recording, or the error that names its fault. Anything else is a failure."""
    data = write(folder, files)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return read_recording(data, 1)
        except InputError as error:
            text = str(error)
            assert str(data) in text
            assert "\n" not in text
            assert len(text) < 600
            return error


def _is_sound(recording: Recording) -> None:
    """What the stages that follow rely on."""
    tracks, vehicles = recording.road.tracks, recording.vehicles
    for name in ("x", "y", "vx", "vy", "ax", "ay"):
        values = getattr(tracks, name)
        assert np.isfinite(values).all()
        assert np.abs(values).max() < 1e6
    assert (vehicles.length > 0).all()
    assert (vehicles.width > 0).all()
    assert (tracks.index.counts > 0).all()
    for first, last in zip(tracks.index.starts[:-1], tracks.index.starts[1:], strict=True):
        assert (np.diff(tracks.index.frame[first:last]) > 0).all()
    parts = split_tracks(recording)
    index = parts.recording.road.tracks.index
    for first, last in zip(index.starts[:-1], index.starts[1:], strict=True):
        assert (np.diff(index.frame[first:last]) == 1).all()
    assert len(index.frame) == len(tracks.index.frame)
    assert len(np.unique(parts.recording.vehicles.id)) == len(index.counts) == len(vehicles.id) + len(parts.breaks)
    assert recording.meta.frame_rate > 0
    assert (np.diff(recording.meta.upper) > 0).all()


def test_the_corpus_is_large() -> None:
    assert len(_MUTATED) >= 200
    assert len({name for name, _ in _MUTATED}) == len(_MUTATED)


@pytest.mark.parametrize(("name", "files"), _MUTATED, ids=[name for name, _ in _MUTATED])
def test_a_fault_comes_to_what_it_has_to(name: str, files: Files, good: Recording, tmp_path: Path) -> None:
    assert _outcome(tmp_path, files, good) == expected(name, files)
    written = {kind for kind, content in files.items() if content is not None}
    assert {path.name for path in (tmp_path / "data").iterdir()} == written


def _outcome(folder: Path, files: Files, good: Recording) -> str:
    """What comes of a recording in ingest: words other than ``mutations`` has are wrong numbers in silence."""
    found = _read(folder / "data", files)
    if isinstance(found, InputError):
        return REFUSED
    _is_sound(found)
    try:
        report = ingest.run(Job(1, folder / "data", folder / "work", Settings(), Provenance("", {}, 1, "")))
    except InputError as error:
        return REFUSED if str(folder / "data") in str(error) else f"no file is named: {error}"
    quality = artefacts.read_part(folder / "work", "ingest", "recordings", 1)
    if report.problems or (quality[["n_holes", "n_duplicates", "share_outside"]] > 0).any(axis=None):
        return TOLD
    return SAME if _are_same(found, good) else "silent"


def _are_same(found: Recording, good: Recording) -> bool:
    read = {
        "road.tracks": ("x", "y", "vx", "vy", "ax", "ay", "lane", "leader_id", "follower_id"),
        "vehicles": ("id", "length", "width", "direction", "vehicle_class"),
        "meta": ("frame_rate", "upper"),  # everybody is on the upper carriageway
    }
    names = [f"{part}.{name}" for part, columns in read.items() for name in columns]
    return all(np.array_equal(attrgetter(name)(found), attrgetter(name)(good)) for name in names)


_HARMLESS = (
    "CRLF",
    "BOM",
    "quoted",
    "no last line feed",
    "shuffled",
    "time goes back",
    "every row twice",
    "blank lines",
)


@pytest.mark.parametrize("ending", _HARMLESS)
def test_what_only_looks_strange_is_read_as_it_is(ending: str, good: Recording, tmp_path: Path) -> None:
    chosen = [files for name, files in _MUTATED if name.endswith(ending)]
    assert chosen
    for k, files in enumerate(chosen):
        found = _read(tmp_path / str(k), files)
        assert isinstance(found, Recording), found
        for name in ("x", "y", "vx", "ax", "lane", "leader_id"):
            np.testing.assert_array_equal(getattr(found.road.tracks, name), getattr(good.road.tracks, name))


@pytest.mark.parametrize(
    "name",
    [
        "cells: 01_tracks.csv x = 'nan'", "cells: 01_tracks.csv x = 'inf'", "cells: 01_tracks.csv x = '1e309'",
        "cells: 01_tracks.csv x = ''", "cells: 01_tracks.csv x = 'x'", "cells: 01_tracks.csv id = '-Infinity'",
        "rows: a row twice with another x", "rows: rows of a stranger", "rows: a vehicle twice",
        "conventions: width 0", "conventions: frame rate 0", "conventions: frame 1.5", "columns: delimiter b';'",
    ],
)  # fmt: skip
def test_what_cannot_be_true_is_refused(name: str, tmp_path: Path) -> None:
    assert isinstance(_read(tmp_path, dict(_MUTATED)[name]), InputError)


@pytest.mark.parametrize("name", [name for name, _ in _MUTATED if name.startswith("broken")])
def test_a_broken_track_is_split_where_it_breaks(name: str, good: Recording, tmp_path: Path) -> None:
    found = _read(tmp_path, dict(_MUTATED)[name])
    assert isinstance(found, Recording)
    parts = split_tracks(found)
    assert {one.vehicle_id for one in parts.breaks} == ({9, 12} if "swapped" in name else {9})
    assert len(parts.breaks) == (2 if "swapped" in name else 1)
    assert all(f"vehicle {one.vehicle_id} " in parts.in_words() for one in parts.breaks)
    assert all(str(one.frame) in parts.in_words() for one in parts.breaks)
    assert not split_tracks(good).breaks


@settings(max_examples=_EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_anywhere(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes overwritten, removed or put in at any place of any file."""
    name = data.draw(st.sampled_from(KINDS))
    content = _GOOD[name]
    start = data.draw(st.integers(0, len(content)))
    stop = data.draw(st.integers(start, min(len(content), start + 40)))
    put = data.draw(
        st.one_of(st.binary(max_size=12), st.sampled_from([b"\n", b",", b'"', b"-", b".", b"1e9", b"\r"]))
    )
    found = _read(tmp_path, _GOOD | {name: content[:start] + put + content[stop:]})
    if isinstance(found, Recording):
        _is_sound(found)


@settings(max_examples=_EXAMPLES // 3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    column=st.sampled_from(["frame", "id", "x", "y", "xVelocity", "laneId", "precedingId"]),
    text=st.one_of(st.floats().map(repr), st.integers().map(str), st.text(max_size=8)),
)
def test_any_text_in_a_cell_is_its_number_or_refused(column: str, text: str, tmp_path: Path) -> None:
    text = text.encode("utf-8", "ignore").decode()
    found = _read(tmp_path, _GOOD | {TRACKS: with_cell(_GOOD[TRACKS], column, text)})
    if isinstance(found, Recording):
        _is_sound(found)
        float(text.strip().strip('"'))


def test_no_stage_stumbles_over_what_the_reader_lets_through(tmp_path: Path) -> None:
    """Strange but readable recordings go through ingest and extract; the bad ones beside them are listed."""
    data = copy_of_fixtures(tmp_path / "data")
    strange = [files for name, files in _MUTATED if name.startswith(("rows:", "conventions:", "texts: class"))]
    for number, files in enumerate(strange, start=3):
        write(data, {name.replace("01_", f"{number:02d}_"): content for name, content in files.items()})
    place = Place(tmp_path / "run", data=data)
    code, said = run(place, "--workers", "1", stage="extract")
    assert code == 4, said
    assert "Traceback" not in said
    assert "Error:" not in said
    assert {p.name for p in tmp_path.iterdir()} == {"data", "run"}
    assert not [name for name in contents(place) if name.endswith(".tmp")]


def test_hostile_names_and_links_stay_where_they_are(tmp_path: Path) -> None:
    data = copy_of_fixtures(tmp_path / "data <b>&'\" \u202e\n")
    outside = tmp_path / "outside"
    outside.mkdir()
    (data / "02_tracks.csv").rename(outside / "real.csv")
    (data / "02_tracks.csv").symlink_to(outside / "real.csv")
    (data / "03_tracks.csv").symlink_to(data / "03_tracks.csv")
    (data / "04_tracks.csv").symlink_to(outside / "nowhere")
    os.mkfifo(data / "05_tracks.csv")
    (data / "\u0661_tracks.csv").touch()
    (data / f"{'9' * 60}_tracks.csv").touch()
    (data / "..%2f06_tracks.csv").touch()
    before = {path: path.stat().st_mtime_ns for path in outside.iterdir()}
    place = Place(tmp_path / "run", data=data)
    code, said = run(place, "--workers", "1", stage="extract")
    assert code == 4, said
    assert "Traceback" not in said
    assert {path: path.stat().st_mtime_ns for path in outside.iterdir()} == before
    assert {"work/parts/extract/01.json", "work/parts/extract/02.json"} <= contents(place).keys()
