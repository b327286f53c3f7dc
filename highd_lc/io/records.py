"""The manifest of a work folder: which parts are finished, under which key, and the files that they consist of.

``parts/<stage>/NN.json`` stands for a stage's work on recording NN, ``parts/<stage>.json`` for its artefacts.
A record is removed before its work begins anew and written after all of its files: what it says is true at any
moment at which the process may be killed.
"""

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from highd_lc.io import atomic, workspace
from highd_lc.io.atomic import Written
from highd_lc.vocab.job import JobReport, Problem


@dataclass(frozen=True)
class Records:
    """The records of a work folder. verify: hash the files of finished work instead of looking at their sizes."""

    work: Path
    verify: bool = False

    def finished(self, stage: str, key: str, recording: int | None = None) -> JobReport | None:
        """The report of work finished under that key with all its files in place; None if it has to be done."""
        record = workspace.read_json(self._file(stage, recording))
        if record.get("key") != key or not self._in_place(record.get("files", {})):
            return None
        problems = tuple(Problem(**problem) for problem in record.get("problems", []))
        return JobReport(record.get("counts", {}), problems)

    def forget(self, stage: str, recording: int | None = None) -> None:
        """Remove a record: the first step of doing its work anew."""
        self._file(stage, recording).unlink(missing_ok=True)

    def remember(
        self, stage: str, key: str, *, report: JobReport, files: Iterable[Written], recording: int | None = None
    ) -> None:
        """Write down that work is finished: the last step of it."""
        base = self.work.resolve()
        listed = {os.path.relpath(f.path.resolve(), base): [f.size, f.sha256] for f in files}
        record = {"key": key, **asdict(report), "files": listed}
        atomic.write_text(self._file(stage, recording), json.dumps(record, indent=1, sort_keys=True))

    def _file(self, stage: str, recording: int | None) -> Path:
        name = f"{stage}.json" if recording is None else f"{stage}/{recording:02d}.json"
        return self.work / "parts" / name

    def _in_place(self, files: dict[str, tuple[int, str]]) -> bool:
        base = self.work.resolve()
        return all(self._is_whole(base / name, size, sha256) for name, (size, sha256) in files.items())

    def _is_whole(self, path: Path, size: int, sha256: str) -> bool:
        try:
            return path.stat().st_size == size and (not self.verify or atomic.content_hash(path) == sha256)
        except OSError:
            return False
