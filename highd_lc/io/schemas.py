"""Value checks of artefacts, by pandera, built from the column list of vocab.tables."""

from functools import cache

import pandas as pd
import pandera.pandas as pandera
import pyarrow as pa
import pyarrow.compute as pc
from pandera.errors import SchemaError

from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.tables import TABLES, Column, Table


@cache
def schema(name: str, chosen: tuple[str, ...]) -> pandera.DataFrameSchema:
    """The pandera schema of some columns of a table: their ranges and allowed words."""
    columns = {
        c.name: pandera.Column(checks=_checks(c), nullable=c.nullable)
        for c in _limited(TABLES[name])
        if c.name in chosen
    }
    return pandera.DataFrameSchema(columns, name=name)


def _limited(table: Table) -> list[Column]:
    return [c for c in table.columns if c.allowed or c.minimum is not None or c.maximum is not None]


def _checks(column: Column) -> list[pandera.Check]:
    checks = []
    if column.minimum is not None:
        checks.append(pandera.Check.ge(column.minimum))
    if column.maximum is not None:
        checks.append(pandera.Check.le(column.maximum))
    if column.allowed:
        checks.append(pandera.Check.isin(list(column.allowed)))
    return checks


def check_values(table: Table, data: pa.Table) -> None:
    """Check ranges and allowed words of the columns present.

    Arrow finds out in microseconds whether a column holds anything that is not allowed, pandera says what.
    Raises ArtefactError naming table, column and the first value that is not allowed.
    """
    if data.num_rows == 0:
        return
    doubtful = [c.name for c in _limited(table) if c.name in data.column_names and not _is_within(c, data[c.name])]
    if not doubtful:
        return
    frame: pd.DataFrame = data.select(doubtful).to_pandas()
    try:
        schema(table.name, tuple(doubtful)).validate(frame)
    except SchemaError as error:
        raise ArtefactError(f"{table.name}: {_in_one_line(error)}") from error


def _is_within(column: Column, values: pa.ChunkedArray) -> bool:
    """Whether all values are certainly allowed. NaN, which no comparison holds for, is left to pandera."""
    if values.null_count == len(values):
        return column.nullable
    if column.allowed and not pc.all(pc.is_in(values, value_set=pa.array(column.allowed))).as_py():
        return False
    if column.minimum is None and column.maximum is None:
        return True
    ends = pc.min_max(values)
    low = column.minimum is None or ends["min"].as_py() >= column.minimum
    high = column.maximum is None or ends["max"].as_py() <= column.maximum
    return low and high and not (pa.types.is_floating(values.type) and pc.any(pc.is_nan(values)).as_py())


def _in_one_line(error: SchemaError) -> str:
    return " ".join(str(error).split())[:300]
