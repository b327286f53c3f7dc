import pytest
from faulty_runs import Place, run


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """A run that nothing happened to, with one worker."""
    place = Place(tmp_path_factory.mktemp("undisturbed"))
    code, said = run(place, "--workers", "1")
    assert code == 0, said
    return place
