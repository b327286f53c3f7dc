"""The multiverse's choices: a table in TOML, and the settings that each of them means (equations.md 12.7)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from highd_lc.io.settings import load_model, one_line, pipelines_folder
from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.sections import StudySettings
from highd_lc.vocab.settings import ValidateSettings

Value = bool | int | float | str

RUN: Final = "run"
"""Kind and name of the variant in which everything is as in the run."""
CHOICE: Final = "choice"
COMBINATION: Final = "combination"
ACCOUNTING: Final = "accounting"
"""The key that is no setting: over which time each side is charged."""
_SECTIONS: Final = ("loss", "constraints", "safety", "planner")
_KEYS: Final = ("followers.model", "followers.b_max")


class Choice(BaseModel):
    """One choice: its keys take each value in turn."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1)]
    keys: Annotated[tuple[str, ...], Field(min_length=1)]
    values: Annotated[tuple[Value, ...], Field(min_length=1)]


class Combination(BaseModel):
    """Several choices made at once."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1)]
    sets: Annotated[dict[str, Value], Field(min_length=1)]


class ChoiceTable(BaseModel):
    """All choices: each value alone, and the named combinations."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    choices: tuple[Choice, ...] = ()
    combinations: tuple[Combination, ...] = ()


@dataclass(frozen=True)
class Variant:
    """One way to ask the question.

    kind: ``run``, ``choice`` or ``combination``; settings: those under which it plans; changes: what differs from
    the run, as "key = value".
    """

    name: str
    kind: str
    accounting: str
    settings: ValidateSettings
    changes: tuple[str, ...] = ()


def variants_of(settings: ValidateSettings) -> tuple[Variant, ...]:
    """Every variant of a run: as it is, each choice that differs from that, each combination.

    Raises SettingsError with file, choice, key and what is allowed.
    """
    path = find_choices(settings.multiverse.choices)
    table = load_model(path, ChoiceTable)
    own = Variant(RUN, RUN, names.PRIMARY_ACCOUNTING, settings)
    found = {RUN: own}
    for name, kind, sets in _asked(table):
        if name in found:
            raise SettingsError(f"{path}: {name}: this name is used twice; each choice needs its own")
        variant = _variant(f"{path}: {name}", name, kind, sets=sets, settings=settings)
        same = variant.accounting == own.accounting and _planned_by(variant.settings) == _planned_by(settings)
        if kind == COMBINATION or not same:
            found[name] = variant
    return tuple(found.values())


def choices_text(settings: ValidateSettings) -> str:
    """The text of the file of choices, on which results depend; empty if no event is planned under them."""
    if not (settings.multiverse.sample or settings.studies.chosen):
        return ""
    try:
        return find_choices(settings.multiverse.choices).read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise SettingsError(f"{settings.multiverse.choices}: cannot be read: {error.strerror}") from error


def find_choices(name: str) -> Path:
    """A table of choices by its path, or by its name among the shipped ones. Raises SettingsError without it."""
    shipped = pipelines_folder() / "choices"
    for path in (Path(name), shipped / f"{name.removesuffix('.toml')}.toml"):
        if path.is_file():
            return path
    known = ", ".join(sorted(path.stem for path in shipped.glob("*.toml")))
    raise SettingsError(f"multiverse.choices = {name}: no such table; give a TOML file or one of: {known}")


def _asked(table: ChoiceTable) -> Iterator[tuple[str, str, Mapping[str, Value]]]:
    """Name, kind and changes of each entry."""
    for choice in table.choices:
        for value in choice.values:
            yield f"{choice.name}: {_text(value)}", CHOICE, dict.fromkeys(choice.keys, value)
    for combination in table.combinations:
        yield combination.name, COMBINATION, combination.sets


def _variant(
    where: str, name: str, kind: str, *, sets: Mapping[str, Value], settings: ValidateSettings
) -> Variant:
    """where: file and name, for an error."""
    accounting = sets.get(ACCOUNTING, names.PRIMARY_ACCOUNTING)
    if accounting not in names.ACCOUNTINGS:
        raise SettingsError(f"{where}: {ACCOUNTING} = {accounting!r}: one of {', '.join(names.ACCOUNTINGS)}")
    values = settings.model_dump()
    # Horizons of a study beyond the variant's own H would be refused, and plan nothing here.
    values["studies"] = StudySettings().model_dump()
    if "followers.model" in sets:
        values["planner"]["parameters"] = "fitted"
    for key, value in sets.items():
        if key != ACCOUNTING:
            section, _, field = _checked(where, key).partition(".")
            values[section][field] = value
    try:
        changed = ValidateSettings.model_validate(values)
    except ValidationError as error:
        raise SettingsError(f"{where}: {one_line(error, ValidateSettings)}") from error
    changes = tuple(f"{key} = {_text(value)}" for key, value in sets.items())
    if _planned_by(changed) == _planned_by(settings):
        changed = settings  # so that who planned under these need not plan again
    return Variant(name, kind, str(accounting), changed, changes)


def _checked(where: str, key: str) -> str:
    """The key, if it decides how a plan is made."""
    if key in _KEYS or (key.partition(".")[0] in _SECTIONS and "." in key):
        return key
    allowed = ", ".join((ACCOUNTING, *_KEYS, *(f"{section}.*" for section in _SECTIONS)))
    raise SettingsError(f"{where}: {key}: no choice of the multiverse; allowed: {allowed}")


def _planned_by(settings: ValidateSettings) -> tuple[Any, ...]:
    """What of the settings decides how a plan is made."""
    planner = settings.planner.model_copy(update={"parameters": "fitted"})  # which follower_models knows
    followers = settings.follower_models[0], settings.followers.b_max
    return followers, planner, settings.loss, settings.constraints, settings.safety


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
