import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.io import highd_csv
from highd_lc.io.highd_csv import Field, read_columns
from highd_lc.io.plain_numbers import EVERY
from highd_lc.vocab.errors import InputError

FIELDS = (Field("n", int, 0, 100), Field("x", float, -1000, 1000))


def written(tmp_path, text, *, encoding="utf-8"):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    "text",
    [
        "n,skipped,x\n1,a,2.50\n2,-,-3\n",
        "n,skipped,x\r\n1,a,2.50\r\n2,-,-3\r\n",
        "\ufeffn,skipped,x\n1,a,2.50\n2,-,-3\n",
        "x,n,skipped\n2.50,1,a\n-3,2,-\n",
        "n,skipped,x\n1,a,2.50\n2,-,-3",
        "n,skipped,x\n1.0,a,2.5e0\n2,-,-3.0\n",
        'n,skipped,x\n1,"a,b",2.50\n"2",-,-3\n',
        "n,skipped,x\n\n1,a,2.50\n\n2,-,-3\n\n",
    ],
    ids=["plain", "crlf", "bom", "order", "no-newline", "exponent", "quoted", "blank-lines"],
)
def test_every_way_of_writing_the_same_numbers(tmp_path, text):
    found = read_columns(written(tmp_path, text), FIELDS)
    assert list(found) == ["n", "x"]
    assert found["n"].dtype == np.int64
    assert found["x"].dtype == np.float64
    assert found["n"].tolist() == [1, 2]
    assert found["x"].tolist() == [2.5, -3.0]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "empty file"),
        ("\n", "empty file"),
        ("n,y\n1,2\n", "column 'x': is missing"),
        ("n,x,x\n1,2,3\n", "column 'x': is there more than once"),
        ("n,x\n1,2.0\n2,abc\n", "row 3, column 'x': 'abc' is not a number"),
        ("n,x\n1,2.0\n2,\n", "row 3, column 'x': '' is not a number"),
        ("n,x\n1.5,2.0\n", "row 2, column 'n': '1.5' is not a whole number"),
        ("n,x\n1,nan\n", "row 2, column 'x': 'nan' is not a finite number"),
        ("n,x\n1,2\n1,-inf\n", "row 3, column 'x': '-inf' is not a finite number"),
        ("n,x\n1,2\n101,3\n", r"row 3, column 'n': 101 is outside \[0, 100\]"),
        ("n,x\n1,1e300\n", r"row 2, column 'x': 1e300 is outside \[-1000, 1000\]"),
        ("n,x\n1,2\n3\n", "row 3: 1 cells, the header has 2"),
        ("n,x\n1,2\n3,4,5\n", "row 3: 3 cells, the header has 2"),
        ("n,x\n1,2\n\n3,x\n", "row 4, column 'x'"),
        ("n,x\n1,1_000\n", "row 2, column 'x'"),
    ],
)
def test_fault_is_named_by_file_column_and_row(tmp_path, text, fault):
    with pytest.raises(InputError, match=fault) as caught:
        read_columns(written(tmp_path, text), FIELDS)
    assert str(caught.value).startswith(str(tmp_path / "a.csv"))
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder_in_its_place(tmp_path):
    with pytest.raises(InputError, match=r"b\.csv: not found"):
        read_columns(tmp_path / "b.csv", FIELDS)
    with pytest.raises(InputError, match="cannot be read"):
        read_columns(tmp_path, FIELDS)


def test_foreign_encoding_is_an_error_and_no_traceback(tmp_path):
    with pytest.raises(InputError):
        read_columns(written(tmp_path, "n,x\n1,2\n", encoding="utf-16"), FIELDS)


def test_text_columns_refuse_empty_cells(tmp_path):
    fields = (*FIELDS, Field("word", str))
    found = read_columns(written(tmp_path, "n,x,word\n1,2,Car\n"), fields)
    assert found["word"].tolist() == ["Car"]
    with pytest.raises(InputError, match="row 2, column 'word': is empty"):
        read_columns(written(tmp_path, "n,x,word\n1,2,\n"), fields)


def test_text_is_read_without_the_space_around_it(tmp_path):
    found = read_columns(written(tmp_path, "n,x,word\n1,2, Car \n"), (*FIELDS, Field("word", str)))
    assert found["word"].tolist() == ["Car"]


def test_an_optional_column_may_be_missing_but_not_faulty(tmp_path):
    fields = (*FIELDS, Field("z", float, optional=True))
    found = read_columns(written(tmp_path, "n,x\n1,2\n3,4\n"), fields)
    assert np.isnan(found["z"]).all()
    assert found["z"].shape == (2,)
    for text, fault in (("n,x,z\n1,2,a\n", "row 2, column 'z'"), ("n,x,z,z\n1,2,3,4\n", "more than once")):
        with pytest.raises(InputError, match=fault):
            read_columns(written(tmp_path, text), fields)


def test_header_alone_gives_no_rows(tmp_path):
    assert len(read_columns(written(tmp_path, "n,x\n"), FIELDS)["n"]) == 0


@given(
    rows=st.lists(
        st.tuples(
            st.integers(0, 100), st.integers(-99999, 99999), st.integers(0, 4), st.text("ab-.0 ", max_size=12)
        ),
        min_size=1,
        max_size=60,
    ),
    chunk=st.sampled_from([64, 256, 1 << 20]),
)
@settings(deadline=None, max_examples=60)
def test_fast_and_general_way_read_the_same(tmp_path_factory, rows, chunk):
    """Every number written with 0 to 4 decimals, chunks that end anywhere."""
    lines = [f"{n},{text},{x / 100:.{places}f}" for n, x, places, text in rows]
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    path.write_text("n,skipped,x\n" + "\n".join(lines) + "\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("highd_lc.io.plain_numbers._CHUNK", chunk)
        fast = highd_csv._read_plain(path, ["n", "skipped", "x"], FIELDS)
        patch.setattr(highd_csv, "_read_plain", lambda *_: None)
        general = read_columns(path, FIELDS)
    assert fast is not None
    for name, values in general.items():
        np.testing.assert_array_equal(fast[name], values)


@pytest.mark.parametrize("way", ["plain", "general"])
@pytest.mark.parametrize("rows", [1, EVERY, EVERY + 1, 12_345, 40_000])
def test_a_sampled_column_is_read_in_some_rows(tmp_path, way, rows):
    """Wherever it stands, over chunks of the file, and NaN where there is no number, on both ways of reading."""
    junk = {3 * EVERY: "", 4 * EVERY: "a", 5 * EVERY: "1.5e"}
    values = [junk.get(row, f"{row % 1000 / 8:.3f}") for row in range(rows)]
    lines = [f"{value},{row % 100},-,{row % 7}.50,{value}" for row, value in enumerate(values)]
    text = "first,n,skipped,x,last\n" + "\n".join(lines).replace("-", '"-"' if way == "general" else "-")
    if way == "general":
        text = text.replace(",1.50,", ',"1.50",')
    fields = (Field("last", float, sampled=True), *FIELDS, Field("first", float, sampled=True))
    fields += (Field("absent", float, optional=True, sampled=True),)
    found = read_columns(written(tmp_path, text + "\n"), fields)
    wanted = [np.nan if row in junk else row % 1000 / 8 for row in range(0, rows, EVERY)]
    assert found["n"].tolist() == [row % 100 for row in range(rows)]
    assert found["x"].tolist() == [row % 7 + 0.5 for row in range(rows)]
    np.testing.assert_array_equal(found["first"], wanted)
    np.testing.assert_array_equal(found["last"], wanted)
    assert np.isnan(found["absent"]).all()
    assert len(found["absent"]) == len(wanted)
