"""Whether the columns of an artefact hold what they may: found out by arrow, told by pandera."""

import pyarrow as pa
import pyarrow.compute as pc

from highd_lc.vocab.columns import Column, Table


def check_values(table: Table, data: pa.Table) -> None:
    """Check ranges and allowed words of the columns present.

    Arrow finds out in microseconds whether a column holds anything that is not allowed, pandera says what.
    Raises ArtefactError naming table, column and the first value that is not allowed.
    """
    doubtful = [c.name for c in limited(table) if c.name in data.column_names and not _is_within(c, data[c.name])]
    if doubtful and data.num_rows:
        from highd_lc.io.schemas import validate  # pandera takes a second to import and is hardly ever needed

        validate(table, data.select(doubtful))


def limited(table: Table) -> list[Column]:
    """The columns of a table that may not hold every value of their type."""
    return [c for c in table.columns if c.allowed or c.minimum is not None or c.maximum is not None]


def _is_within(column: Column, values: pa.ChunkedArray) -> bool:
    """Whether all values are certainly allowed; nulls are checked elsewhere, NaN may stand where a null may."""
    if values.null_count == len(values):
        return column.nullable
    if column.allowed and not pc.all(pc.is_in(values, value_set=pa.array(column.allowed))).as_py():
        return False
    if column.minimum is None and column.maximum is None:
        return True
    if pa.types.is_floating(values.type) and pc.any(pc.is_nan(values)).as_py():
        if not column.nullable:
            return False
        values = values.filter(pc.invert(pc.is_nan(values)))
    ends = pc.min_max(values)
    low = column.minimum is None or ends["min"].as_py() is None or ends["min"].as_py() >= column.minimum
    high = column.maximum is None or ends["max"].as_py() is None or ends["max"].as_py() <= column.maximum
    return bool(low and high)
