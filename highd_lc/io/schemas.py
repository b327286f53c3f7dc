"""Value checks of artefacts in words, by pandera, built from the column list of vocab.tables."""

from functools import cache

import pandas as pd
import pandera.pandas as pandera
import pyarrow as pa
from pandera.errors import SchemaError

from highd_lc.io.value_checks import limited
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.tables import TABLES, Column, Table


@cache
def schema(name: str, chosen: tuple[str, ...]) -> pandera.DataFrameSchema:
    """The pandera schema of some columns of a table: their ranges and allowed words."""
    columns = {
        c.name: pandera.Column(checks=_checks(c), nullable=c.nullable)
        for c in limited(TABLES[name])
        if c.name in chosen
    }
    return pandera.DataFrameSchema(columns, name=name)


def _checks(column: Column) -> list[pandera.Check]:
    checks = []
    if column.minimum is not None:
        checks.append(pandera.Check.ge(column.minimum))
    if column.maximum is not None:
        checks.append(pandera.Check.le(column.maximum))
    if column.allowed:
        checks.append(pandera.Check.isin(list(column.allowed)))
    return checks


def validate(table: Table, data: pa.Table) -> None:
    """Check every value. Raises ArtefactError naming table, column and the first value that is not allowed."""
    frame: pd.DataFrame = data.to_pandas()
    try:
        schema(table.name, tuple(frame.columns)).validate(frame)
    except SchemaError as error:
        raise ArtefactError(f"{table.name}: {_in_one_line(error)}") from error


def _in_one_line(error: SchemaError) -> str:
    return " ".join(str(error).split())[:300]
