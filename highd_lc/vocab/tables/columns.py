"""What a table is made of: columns with type, unit and meaning, and the table that holds them."""

from dataclasses import dataclass
from typing import Final, Literal

from highd_lc.vocab import names

Kind = Literal[
    "int64",
    "int32",
    "float64",
    "float32",
    "string",
    "bool",
    "list<int64>",
    "list<string>",
    "list<float64>",
    "map<string,float64>",
    "map<string,int64>",
]


@dataclass(frozen=True)
class Column:
    """A column: its type, unit, meaning, and what its values may be. NaN counts as null in float columns."""

    name: str
    kind: Kind
    meaning: str
    unit: str = ""
    nullable: bool = False
    minimum: float | None = None
    maximum: float | None = None
    allowed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """An artefact: what a row is, which columns order it, and its columns."""

    name: str
    row: str
    order: tuple[str, ...]
    columns: tuple[Column, ...]

    @property
    def column_names(self) -> tuple[str, ...]:
        """The columns' names in order."""
        return tuple(column.name for column in self.columns)


def number(name: str, meaning: str, unit: str = "", *, nullable: bool = True, **limits: float) -> Column:
    """A float column; limits: ``minimum`` and ``maximum``."""
    return Column(name, "float64", meaning, unit, nullable, limits.get("minimum"), limits.get("maximum"))


def single(name: str, meaning: str, unit: str) -> Column:
    """A number of single precision: for the one large table, whose speeds HighD rounds to 0.01."""
    return Column(name, "float32", meaning, unit)


def count(name: str, meaning: str, unit: str = "", *, nullable: bool = False) -> Column:
    """A column of whole numbers from 0 on."""
    return Column(name, "int64", meaning, unit, nullable, minimum=0)


def word(name: str, meaning: str, allowed: tuple[str, ...] = ()) -> Column:
    """A text column; allowed: the only words it may hold, empty = any."""
    return Column(name, "string", meaning, allowed=allowed)


EVENT: Final = word("event_id", "RR-VVVV-FFFFF: recording, ego, crossing frame")
RECORDING: Final = Column("recording_id", "int64", "number in the recording's file name", minimum=0)
VEHICLE: Final = Column("vehicle_id", "int64", "the vehicle's id in its recording", minimum=0)
RANK: Final = Column("follower", "int64", "rank, 1 = nearest to the ego", minimum=1)
POLICY: Final = word("policy", "who planned the motion (equations.md 6)", names.POLICIES)
ACCOUNTING: Final = word("accounting", "over which time each side is charged", names.ACCOUNTINGS)
