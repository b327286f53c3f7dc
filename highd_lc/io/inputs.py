"""The recordings that a run starts from: their files, a hash of each, and whether they are what they were."""

from dataclasses import dataclass
from pathlib import Path

from highd_lc.io import highd_files, workspace
from highd_lc.io.settings import digest
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Problem


@dataclass(frozen=True)
class Inputs:
    """The recordings of a data folder. files: of each readable recording, largest recording first; keys: hash of
    each one's files; problems: recordings that cannot be read.
    """

    data: Path
    files: dict[int, tuple[Path, ...]]
    keys: dict[int, str]
    problems: tuple[Problem, ...]
    hashes: workspace.InputHashes

    def refuse_changed(self, recording: int) -> None:
        """Raises InputError if a file of the recording is no longer the one that its key was made of."""
        for path in self.files[recording]:
            self.hashes.refuse_changed(path)


def find_inputs(data: Path, work: Path, *, verify: bool) -> Inputs:
    """Find the recordings of a folder and hash their files; verify: even those that look unchanged.

    Raises InputError if the folder is missing or holds no recording, StorageError if the hashes cannot be kept.
    """
    hashes = workspace.InputHashes.open(work, verify=verify)
    files: dict[int, tuple[Path, ...]] = {}
    keys: dict[int, str] = {}
    problems = []
    for recording in highd_files.discover(data):
        try:
            files[recording] = highd_files.input_files(data, recording)
            keys[recording] = digest(*map(hashes.of, files[recording]))
        except InputError as error:
            problems.append(Problem(recording, "ingest", str(error), lost=True))
    hashes.save()
    largest_first = sorted(keys, key=lambda r: (-sum(hashes.size_of(path) for path in files[r]), r))
    return Inputs(data, {r: files[r] for r in largest_first}, keys, tuple(problems), hashes)
