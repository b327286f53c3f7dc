"""A fitted population as a TOML file: exported by a run, to be cited and used on other data."""

import tomllib
from pathlib import Path

import numpy as np

from highd_lc.drivers.population import CONSTANTS, NAMES, Population
from highd_lc.io import atomic
from highd_lc.vocab.errors import SettingsError


def save_population(path: Path, population: Population) -> None:
    """Write a population: its constants with unit and meaning, moment, number of responses, and source."""
    lines = [
        "# A population of followers: constants of the LCM with memory and relaxation (equations.md 3).",
        f'source = "{population.source}"  # what its responses come from',
        f"n_responses = {population.n_responses}",
        f"moment = {population.moment!r}  # share of the lateral way from which the lane changer is the leader",
        "[constants]",
    ]
    for constant, value in zip(CONSTANTS, population.constants.tolist(), strict=True):
        unit = f" [{constant.unit}]" if constant.unit else ""
        lines.append(f"{constant.name} = {value!r}  # {constant.meaning}{unit}")
    atomic.write_text(path, "\n".join(lines) + "\n")


def load_population(path: Path) -> Population:
    """Read a population. Raises SettingsError naming the file and the key that is missing or out of range."""
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"followers.population = {path}: {error}") from error
    constants = found.get("constants", {})
    for constant in CONSTANTS:
        value = constants.get(constant.name)
        if not isinstance(value, int | float) or not constant.low <= value <= constant.high:
            allowed = f"a number from {constant.low:g} to {constant.high:g}"
            raise SettingsError(f"{path}: key constants.{constant.name} = {value!r}: {allowed} is needed")
    moment = found.get("moment", 0.5)
    values = np.array([float(constants[name]) for name in NAMES])
    return Population(values, float(moment), int(found.get("n_responses", 0)), str(found.get("source", path.name)))
