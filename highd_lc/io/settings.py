"""Settings from a pipeline's TOML file; every fault is one line with the file, the key and what is allowed."""

import hashlib
import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.settings import Settings

Model = TypeVar("Model", bound=BaseModel)


def pipelines_folder() -> Path:
    """Where the shipped pipelines lie: inside the wheel, or beside the package in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "pipelines"
    return inside if inside.is_dir() else package.parent / "pipelines"


SCENARIOS = "scenarios"
"""The shipped pipeline of the scenarios; all others are of recordings."""


def shipped_pipelines(model: type[BaseModel] = Settings) -> list[Path]:
    """The shipped pipelines by name. model: ``Settings`` = of recordings; else of the scenarios."""
    of_scenarios = model is not Settings
    return [path for path in sorted(pipelines_folder().glob("*.toml")) if (path.stem == SCENARIOS) == of_scenarios]


def find_pipeline(name: str, model: type[BaseModel] = Settings) -> Path:
    """A pipeline by its path, or by its name among the shipped ones that hold settings of the model.

    Raises SettingsError if there is none.
    """
    given = Path(name)
    if given.is_file():
        return given
    shipped = {path.stem: path for path in shipped_pipelines(model)}
    if given.parent == Path() and (found := shipped.get(name.removesuffix(".toml"))):
        return found
    raise SettingsError(f"{name}: no such pipeline here; give a TOML file or one of: {', '.join(shipped)}")


def load_pipeline(name: str, model: type[Model]) -> Model:
    """Read and check a pipeline given by its path or shipped name. Raises SettingsError."""
    return load_model(find_pipeline(name, model), model)


def load(path: Path) -> Settings:
    """Read and check a pipeline. Raises SettingsError naming file, key and allowed range."""
    return load_model(path, Settings)


def load_model(path: Path, model: type[Model]) -> Model:
    """Read settings of any model from TOML. Raises SettingsError naming file, key and allowed range."""
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: not valid TOML: {error}") from error
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise SettingsError(f"{path}: {one_line(error, model)}") from error


def one_line(error: ValidationError, model: type[BaseModel] = Settings) -> str:
    """The first fault of settings: key, value and what is allowed."""
    first = error.errors()[0]
    if not first["loc"]:
        return str(first["msg"])
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return f"{key}: unknown setting; allowed here: {', '.join(_siblings(first['loc'], model))}"
    if first["type"] == "value_error":
        return f"{key}.{str(first['msg']).removeprefix('Value error, ')}"
    if first["type"] == "missing":
        return f"{key}: missing"
    return f"{key} = {first['input']!r}: {first['msg']}"


def _siblings(location: tuple[int | str, ...], model: Any) -> list[str]:
    for part in location[:-1]:
        found = {(field.alias or name): field for name, field in model.model_fields.items()}.get(str(part))
        if found is None or not isinstance(found.annotation, type) or not issubclass(found.annotation, BaseModel):
            return []
        model = found.annotation
    return sorted(field.alias or name for name, field in model.model_fields.items())


def digest(*models: BaseModel | int | str) -> str:
    """A hash of settings, the same for equal values in any run."""
    values = [m.model_dump(mode="json", by_alias=True) if isinstance(m, BaseModel) else m for m in models]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def resolved(settings: Settings) -> str:
    """The settings with every default filled in, as JSON to be kept beside the results."""
    return json.dumps(settings.model_dump(mode="json", by_alias=True), indent=2, sort_keys=True) + "\n"


def with_report(settings: Settings, changes: dict[str, Any]) -> Settings:
    """The settings with some of the report's replaced. Raises SettingsError if one is not allowed."""
    return _with(settings, "report", changes)


def with_ingest(settings: Settings, changes: dict[str, Any]) -> Settings:
    """The settings with some of ingest's replaced. Raises SettingsError if one is not allowed."""
    return _with(settings, "ingest", changes)


def with_multiverse(settings: Settings, changes: dict[str, Any]) -> Settings:
    """The settings with some of the multiverse's replaced. Raises SettingsError if one is not allowed."""
    old = settings.validation.multiverse.model_dump()
    return _with(settings, "validation", {"multiverse": old | changes})


def with_planners(settings: Settings, planners: Sequence[str]) -> Settings:
    """The settings with planners of others added to those that the pipeline names."""
    return _with(settings, "validation", {"planners": [*settings.validation.planners, *planners]})


def _with(settings: Settings, section: str, changes: dict[str, Any]) -> Settings:
    old = getattr(settings, section)
    try:
        new = type(old).model_validate(old.model_dump(by_alias=True) | changes)
    except ValidationError as error:
        raise SettingsError(f"command line: {section}.{one_line(error)}") from error
    return settings.model_copy(update={section: new})
