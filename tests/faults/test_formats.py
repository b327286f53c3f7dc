"""Bad files of every format: an error in one line that names the file, or a sound recording; nothing else."""

import random

import numpy as np
import pytest
from mutations import _NUMBERS
from ngsim_recording import carriageway
from ngsim_recording import table as ngsim_table
from tgsim_recording import table as tgsim_table

from highd_lc.io.formats import FORMATS
from highd_lc.vocab import names
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.settings import IngestSettings

_TABLES = {"ngsim": ngsim_table, "tgsim": tgsim_table}
_CELLS = 120
_CUTS = 20


@pytest.fixture(scope="module")
def texts(tmp_path_factory):
    """A small file of each format as text."""
    made = carriageway(tmp_path_factory.mktemp("made") / "highd", seconds=20.0)
    found = {}
    for name, table in _TABLES.items():
        rows = table(made)
        some = rows[rows.iloc[:, 0].isin(rows.iloc[:, 0].unique()[:10])]
        found[name] = some.to_csv(index=False)
    return found


def _cells(text, rng):
    lines = text.split("\n")
    columns = lines[0].split(",")
    for _ in range(_CELLS):
        row, place, value = rng.randrange(1, len(lines) - 1), rng.randrange(len(columns)), rng.choice(_NUMBERS)
        cells = lines[row].split(",")
        cells[place] = value
        yield "\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :]])


def _cuts(text, rng):
    for _ in range(_CUTS):
        yield text[: rng.randrange(1, len(text))]


def _columns(text, rng):
    lines = [line.split(",") for line in text.split("\n")[:-1]]
    for place in range(len(lines[0])):
        yield "\n".join(",".join([*cells[:place], *cells[place + 1 :]]) for cells in lines) + "\n"
        yield "\n".join(",".join([*cells, cells[place]]) for cells in lines) + "\n"


def _rows(text, rng):
    head, *lines = text.split("\n")[:-1]
    shuffled = rng.sample(lines, len(lines))
    for body in (
        shuffled,
        lines[::-1],
        lines + lines[:5],
        lines[::2],
        lines[:1],
        [],
        [*lines, ",".join("1" * 99)],
    ):
        yield "\n".join([head, *body]) + "\n"


def _whole(text, rng):
    yield from ("", "\n", text.replace(",", ";"), text.upper(), "\ufeff" + text, text.replace("\n", "\r\n"))
    yield from (text.replace(".", ","), text[::-1], "x" * 5000, "\0" * 100, text.split("\n", 1)[1])


def _is_sound(recording):
    tracks, metas = recording.road.tracks, recording.vehicles
    for name in ("x", "y", "vx", "vy", "ax", "ay"):
        assert np.isfinite(getattr(tracks, name)).all(), name
    assert (np.diff(metas.id) > 0).all()
    assert metas.id[0] >= 1
    assert (tracks.index.counts > 0).all()
    assert set(metas.vehicle_class) <= set(names.CLASSES)
    assert (tracks.lane >= 0).all()
    assert tracks.lane.max() < len(recording.meta.lower)
    assert np.isin(tracks.leader_id[tracks.leader_id > 0], metas.id).all()
    assert (np.diff(recording.meta.lower) > 0).all()
    assert (metas.length > 0).all()


@pytest.mark.parametrize("family", [_cells, _cuts, _columns, _rows, _whole])
@pytest.mark.parametrize("name", list(_TABLES))
def test_a_bad_file_ends_in_one_line_or_in_a_sound_recording(tmp_path, texts, name, family):
    read = refused = 0
    for text in family(texts[name], random.Random(7)):
        path = tmp_path / "us-101.csv"
        path.write_text(text, newline="")
        source = FORMATS[name]
        if not source.found_in(tmp_path):
            refused += 1
            continue
        try:
            numbers = source.discover(tmp_path)
            recording = source.read(tmp_path, numbers[0], IngestSettings())
        except InputError as error:
            told = str(error)
            assert str(tmp_path) in told
            assert "\n" not in told
            assert len(told) < 700
            refused += 1
        else:
            _is_sound(recording)
            read += 1
    assert refused > 0
    assert read > 0 or family is _cuts
