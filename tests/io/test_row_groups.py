"""A recording's rows: by its row groups where it has them to itself, by a condition where it shares them."""

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from highd_lc.io import artefacts

ROWS = pd.DataFrame({"recording_id": [1, 1, 2, 2, 2, 4], "value": range(6)})


def written(folder, sizes, **options):
    """ROWS as a file with row groups of these sizes."""
    table, start = pa.Table.from_pandas(ROWS), 0
    with pq.ParquetWriter(folder / "rows.parquet", table.schema, **options) as writer:
        for size in sizes:
            writer.write_table(table.slice(start, size))
            start += size
    return folder / "rows.parquet"


@pytest.mark.parametrize(("recording", "values"), [(1, [0, 1]), (2, [2, 3, 4]), (3, []), (4, [5])])
@pytest.mark.parametrize("sizes", [(2, 3, 1), (2, 1, 2, 1)])
def test_whole_groups_are_a_recordings_rows(tmp_path, recording, values, sizes):
    table = artefacts.of_recording(written(tmp_path, sizes), recording, None)
    assert table["value"].to_pylist() == values


def test_columns_may_be_chosen(tmp_path):
    table = artefacts.of_recording(written(tmp_path, (2, 3, 1)), 2, ["value"])
    assert table.column_names == ["value"]


@pytest.mark.parametrize("recording", [1, 2, 3])
def test_a_group_that_is_shared_is_left_to_a_condition(tmp_path, recording):
    assert artefacts.of_recording(written(tmp_path, (6,)), recording, None) is None


def test_so_is_a_file_that_does_not_say_what_its_groups_hold(tmp_path):
    assert artefacts.of_recording(written(tmp_path, (2, 3, 1), write_statistics=False), 2, None) is None
    pq.write_table(pa.table({"value": [1]}), tmp_path / "other.parquet")
    assert artefacts.of_recording(tmp_path / "other.parquet", 1, None) is None
