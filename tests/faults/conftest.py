from collections.abc import Callable
from pathlib import Path

import pytest
from faulty_runs import Place, run


def _made(root: Path) -> Place:
    place = Place(root)
    code, said = run(place, "--workers", "1")
    assert code == 0, said
    return place


@pytest.fixture(scope="session")
def undisturbed(once: Callable[..., Place]) -> Place:
    """A run that nothing happened to, with one worker: read only, in several processes at once."""
    return once("undisturbed", _made)
