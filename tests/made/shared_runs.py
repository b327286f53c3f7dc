"""Runs that many tests look at: made once, by whichever process of the tests comes first."""

import fcntl
import io
import pickle
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from rich.console import Console

from highd_lc import engine
from highd_lc.vocab.job import Options, Outcome
from highd_lc.vocab.settings import Settings

TESTS = Path(__file__).parents[1]
FIXTURES, QUICK = TESTS / "fixtures", TESTS / "faults" / "quick.toml"
T = TypeVar("T")


@dataclass(frozen=True)
class PipelineRun:
    """A finished run: read only, several tests look at it, in several processes at once."""

    data: Path
    work: Path
    reports: Path
    settings: Settings
    outcome: Outcome


def made_once(root: Path, name: str, make: Callable[[Path], T]) -> T:
    """What ``make`` returns when it is given a folder of that name below ``root``.

    One process calls it. The others wait for its end and get a copy of what it returned, so that the folder and
    what is in it have to be left as they are.
    """
    folder, result = root / name, root / f"{name}.pickle"
    with (root / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not result.is_file():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            result.write_bytes(pickle.dumps(make(folder)))
        return pickle.loads(result.read_bytes())


def run(root: Path, settings: Settings, *, last: str = "report") -> PipelineRun:
    """A run on the fixtures below ``root``, in this process, up to the stage ``last``."""
    options = Options(FIXTURES, root / "work", root / "reports", workers=1)
    outcome = engine.run(settings, options, last=last, console=Console(file=io.StringIO()))
    return PipelineRun(FIXTURES, options.work, options.reports, settings, outcome)


def copied(made: PipelineRun, root: Path, *, reports: bool = True) -> Options:
    """Options of a run that goes on in a copy of a finished one. reports: whether its pages are copied too."""
    shutil.copytree(made.work, root / "work")
    if reports:
        shutil.copytree(made.reports, root / "reports")
    return Options(made.data, root / "work", root / "reports", workers=1)
