import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest
from image_recording import pair

from highd_lc.io.highd import read_recording
from highd_lc.io.highd_files import discover, folders, input_files
from highd_lc.vocab.errors import InputError

KINDS = ("recordingMeta", "tracksMeta", "tracks")


def same(data: Path, plain: Path) -> bool:
    """Whether recording 1 of both folders reads the same."""
    found, expected = read_recording(data, 1), read_recording(plain, 1)
    arrays = [(getattr(found.road.tracks, k), getattr(expected.road.tracks, k)) for k in ("x", "y", "lane")]
    return all(map(np.array_equal, *zip(*arrays, strict=True)))


def sorted_into(folder: Path, plain: Path, places: dict[str, str]) -> Path:
    """The files of a recording in folders and under names by kind."""
    for kind, name in places.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(plain / f"01_{kind}.csv", folder / name)
    return folder


@pytest.mark.parametrize(
    "places",
    [
        dict.fromkeys(KINDS, "data/{}"),
        dict.fromkeys(KINDS, "highD-dataset-v1.0/data/{}"),
        dict.fromkeys(KINDS, "a/b/my data/{}"),
        {"recordingMeta": "Metas/{}", "tracksMeta": "Metas/{}", "tracks": "Tracks/{}"},
        {"recordingMeta": "highD/Metas/{}", "tracksMeta": "highD/Metas/{}", "tracks": "highD/Tracks/{}"},
        {"recordingMeta": "recordingMeta/{}", "tracksMeta": "tracksMeta/{}", "tracks": "tracks/{}"},
        {"recordingMeta": "{}", "tracksMeta": "{}", "tracks": "tracks/{}"},
    ],
)
def test_files_are_found_below_the_folder_given(tmp_path, places):
    plain = pair(tmp_path / "plain")
    data = sorted_into(
        tmp_path / "given", plain, {kind: place.format(f"01_{kind}.csv") for kind, place in places.items()}
    )
    assert discover(data) == [1]
    assert [path.name for path in input_files(data, 1)] == [f"01_{kind}.csv" for kind in KINDS]
    assert folders(data) == sorted({(data / place).parent for place in places.values()})
    assert same(data, plain)


@pytest.mark.parametrize("name", ["01_{}.CSV", "01_{}.Csv", "1_{}.CSV"])
def test_case_of_names_does_not_matter(tmp_path, name):
    plain = pair(tmp_path / "plain")
    assert same(sorted_into(tmp_path / "given", plain, {kind: name.format(kind.upper()) for kind in KINDS}), plain)


@pytest.mark.parametrize("packed", [KINDS, ("tracks",), ("tracksMeta", "recordingMeta")])
@pytest.mark.parametrize("ending", [".csv.gz", ".CSV.GZ"])
def test_packed_files_are_read(tmp_path, packed, ending):
    plain, data = pair(tmp_path / "plain"), pair(tmp_path / "given")
    for kind in packed:
        path = data / f"01_{kind}.csv"
        path.with_name(f"01_{kind}{ending}").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    assert same(data, plain)


def test_packed_files_that_were_joined_are_read_whole(tmp_path):
    """As ``cat a.gz b.gz`` joins them: the last part's size is not the file's."""
    plain, data = pair(tmp_path / "plain"), pair(tmp_path / "given")
    content = (data / "01_tracks.csv").read_bytes()
    (data / "01_tracks.csv.gz").write_bytes(gzip.compress(content[:-40]) + gzip.compress(content[-40:]))
    (data / "01_tracks.csv").unlink()
    assert same(data, plain)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "damage",
    [lambda b: b[:-9], lambda b: b[:25], lambda _: b"frame,id\n1,2\n", lambda _: b""],
)
def test_a_packed_file_that_is_torn_is_named(tmp_path, kind, damage):
    data = pair(tmp_path)
    path = data / f"01_{kind}.csv"
    path.with_name(path.name + ".gz").write_bytes(damage(gzip.compress(path.read_bytes())))
    path.unlink()
    with pytest.raises(InputError, match=rf"01_{kind}\.csv\.gz: (cannot be read|empty file)"):
        read_recording(data, 1)


def test_a_plain_file_is_preferred_to_a_packed_one(tmp_path):
    data = pair(tmp_path)
    (data / "01_tracks.csv.gz").write_bytes(b"torn")
    assert input_files(data, 1)[2] == data / "01_tracks.csv"


def test_two_folders_with_recordings_are_both_named(tmp_path):
    for name in ("highd", "synthetic"):
        pair(tmp_path / name)
    with pytest.raises(InputError) as caught:
        discover(tmp_path)
    first, second = tmp_path / "highd", tmp_path / "synthetic"
    assert str(caught.value).startswith(f"{tmp_path}: recordings lie in {first} and in {second}: give one")
    assert discover(pair(tmp_path)) == [1]


def test_hidden_folders_and_links_to_the_same_folder_are_no_choice(tmp_path):
    for name in (".cache", "__MACOSX", "v1"):
        pair(tmp_path / name)
    (tmp_path / "latest").symlink_to("v1")
    (tmp_path / "v1/up").symlink_to(tmp_path)
    assert discover(tmp_path) == [1]
    assert len(folders(tmp_path)) == 1


def test_a_missing_file_is_named_where_it_would_be(tmp_path):
    pair(tmp_path / "data")
    (tmp_path / "data/01_tracks.csv").unlink()
    with pytest.raises(InputError) as caught:
        input_files(tmp_path, 1)
    assert str(caught.value) == f"{tmp_path / 'data/01_tracks.csv'}: not found"


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("highD-dataset-v1.0.zip", "", "there is highD-dataset-v1.0.zip: unpack it"),
        ("trajectories-0750am-0805am.txt", "Vehicle_ID,Frame_ID,Local_X,Local_Y\n", "looks like one of NGSIM"),
        ("points.csv", "1,2,3\n", "looks like rows without a header line"),
        ("notes.csv", "a,b\n", "there is notes.csv"),
    ],
)
def test_what_lies_there_instead_is_told(tmp_path, name, content, said):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=r"no file named like 01_tracks\.csv") as caught:
        discover(tmp_path)
    assert str(caught.value).endswith(said)
