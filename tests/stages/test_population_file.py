"""A population as a file: written and read back, and what is wrong with a file is named."""

import re

import numpy as np
import pytest

from highd_lc.drivers.population import PRIOR, Population
from highd_lc.stages.responses import load_population, save_population
from highd_lc.vocab.errors import SettingsError


def test_a_population_comes_back_as_it_was(tmp_path):
    one = Population(PRIOR.constants * 1.01, 0.3, 57, "recordings 01, 02", family="idm")
    save_population(tmp_path / "p.toml", one)
    back = load_population(tmp_path / "p.toml")
    np.testing.assert_array_equal(back.constants, one.constants)
    assert (back.moment, back.n_responses, back.source) == (0.3, 57, "recordings 01, 02")
    assert back.family == "idm"


def test_a_file_without_a_family_is_of_the_lcm(tmp_path):
    path = tmp_path / "p.toml"
    save_population(path, PRIOR)
    lines = [line for line in path.read_text().splitlines() if not line.startswith("family")]
    path.write_text("\n".join(lines))
    assert load_population(path).family == "lcm"


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("tau = ", "tau = -", "constants.tau"),
        ("memory = ", "remembers = ", "constants.memory"),
        ("A = ", "A = x", "p.toml"),
        ('family = "lcm"', 'family = "own"', "key family = 'own'"),
    ],
)
def test_a_wrong_file_is_named_with_its_key(tmp_path, old, new, named):
    path = tmp_path / "p.toml"
    save_population(path, PRIOR)
    path.write_text(path.read_text().replace(f"\n{old}", f"\n{new}"))
    with pytest.raises(SettingsError, match=re.escape(named)):
        load_population(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(SettingsError, match=r"nowhere\.toml"):
        load_population(tmp_path / "nowhere.toml")
