"""The fast CSV writer against Python's own formatting."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.io.synthetic import write_frame, write_table

INT32 = st.integers(-(2**31), 2**31 - 1)


def printed(value: int, hundredths: bool) -> str:
    if not hundredths:
        return str(value)
    sign = "-" if value < 0 else ""
    return f"{sign}{abs(value) // 100}.{abs(value) % 100:02d}"


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("csv") / "table.csv"


@settings(deadline=None)
@given(rows=st.lists(st.tuples(INT32, INT32, INT32), max_size=20))
def test_every_int32_prints_as_an_integer_or_with_two_decimals(path, rows):
    decimals = np.array([False, True, True])
    write_table(path, "a,b,c", np.array(rows, np.int32).reshape(-1, 3), decimals=decimals)
    wanted = ["a,b,c"] + [",".join(printed(v, d) for v, d in zip(row, decimals, strict=True)) for row in rows]
    assert path.read_text() == "\n".join(wanted) + "\n"


def test_tables_longer_than_a_chunk_are_written_in_order(tmp_path):
    table = np.arange(100_000, dtype=np.int32).reshape(-1, 2)
    write_table(tmp_path / "long.csv", "a,b", table, decimals=np.array([False, True]))
    read = pd.read_csv(tmp_path / "long.csv")
    np.testing.assert_array_equal(read["a"], table[:, 0])
    np.testing.assert_allclose(read["b"], table[:, 1] / 100, atol=1e-9)


def test_small_negative_hundredths_keep_their_sign(tmp_path):
    write_table(tmp_path / "x.csv", "a,b", np.array([[-5, 0]], np.int32), decimals=np.array([True, True]))
    assert (tmp_path / "x.csv").read_text() == "a,b\n-0.05,0.00\n"


def test_a_frame_is_printed_with_its_format(tmp_path):
    write_frame(tmp_path / "y.csv", pd.DataFrame({"n": [1], "x": [2.5]}), float_format="%.2f")
    assert (tmp_path / "y.csv").read_text() == "n,x\n1,2.50\n"
