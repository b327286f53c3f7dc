import pytest
from faulty_runs import Place
from shared_runs import PipelineRun


@pytest.fixture(scope="session")
def undisturbed(quick_run: PipelineRun) -> Place:
    """A run that nothing happened to, with one worker: read only, in several processes at once."""
    return Place(quick_run.work.parent)
