"""Fenced blocks of Markdown pages, and how each kind is run."""

import contextlib
import doctest
import io
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from highd_lc import cli
from highd_lc.io import settings as settings_file

ROOT = Path(__file__).resolve().parents[2]
QUICK = ROOT / "tests" / "faults" / "quick.toml"
RUN = ("sh", "console", "python", "toml")
"""Kinds of blocks that are run; others are read."""
_BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>[^>]*?) -->\n)?^```(?P<kind>[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
_FILE = re.compile(r"# (\w+\.(?:py|toml))\n")
_STAGES = ("ingest", "extract", "calibrate", "validate", "report", "run", "multiverse", "truth")


_MADE: dict[tuple[Any, ...], str] = {}
"""What the commands of make said, by folder and words."""


@dataclass(frozen=True)
class Block:
    """A fenced block. line: where it begins; why: why it is not run, or ""."""

    line: int
    kind: str
    text: str
    why: str


def pages() -> list[Path]:
    """The pages whose blocks are run."""
    found = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "NOMENCLATURE.md", "data/README.md")]
    return [*found, *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(text.count("\n", 0, m.start("kind")) + 1, m["kind"], m["text"], m["why"] or "")
        for m in _BLOCK.finditer(text)
    ]


class Session:
    """What the blocks of a page share: a folder and the names of its Python."""

    def __init__(self, place: Path) -> None:
        self.place = place
        self.names: dict[str, Any] = {}

    def run(self, block: Block) -> None:
        """Run a block. Raises AssertionError if a command fails or shows something else."""
        if file := _FILE.match(block.text):
            (self.place / file[1]).write_text(block.text, encoding="utf-8")
        getattr(self, f"_{block.kind}")(block.text)

    def _python(self, text: str) -> None:
        if ">>>" in text:
            self._examples(text)
        else:
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile(text, "<block>", "exec"), self.names)

    def _examples(self, text: str) -> None:
        flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        test = doctest.DocTestParser().get_doctest(text, self.names, "block", None, None)
        said = io.StringIO()
        doctest.DocTestRunner(optionflags=flags).run(test, out=said.write, clear_globs=False)
        assert not said.getvalue(), said.getvalue()
        self.names |= test.globs

    def _toml(self, text: str) -> None:
        settings_file.load(self.place / _FILE.match(text)[1])

    def _sh(self, text: str) -> None:
        for line in filter(None, (part.strip() for part in text.replace("\\\n", " ").splitlines())):
            self.command(line)

    def _console(self, text: str) -> None:
        for shown in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
            line, _, wanted = shown.partition("\n")
            said = self.command(line)
            flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
            assert doctest.OutputChecker().check_output(wanted, said, flags), f"{line}\nshows:\n{said}"

    def command(self, line: str) -> str:
        """Run a line of a shell; what it says on the standard output."""
        words = shlex.split(line, comments=True)
        if words[:1] == ["make"]:
            return self._make(words)
        if words[:1] == ["highd-lc"] and not {"|", ">"} & set(words):
            return self._highd_lc(words[1:])
        return self._shell(line)

    def _highd_lc(self, words: list[str]) -> str:
        """The command line in this process; stages by the pipeline with little to do that the run is made by."""
        if words[0] in _STAGES:
            words = [*words, *(("--pipeline", str(QUICK)) if "--pipeline" not in words else ())]
            words = [*words, *(("--workers", "1") if "--workers" not in words else ())]
        said, problems = io.StringIO(), io.StringIO()
        argv, code = sys.argv, 0
        sys.argv = ["highd-lc", *words]
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(problems):
                cli.main()
        except SystemExit as end:
            code = end.code
        finally:
            sys.argv = argv
        assert not code, f"{words}: {problems.getvalue()}"
        return said.getvalue()

    def _make(self, words: list[str]) -> str:
        """make in the checkout on the folder's data, with an environment that others keep in order."""
        bin_folder = self.place / "venv" / "bin"
        bin_folder.mkdir(parents=True, exist_ok=True)
        program = f'#!/bin/sh\nexec "{sys.executable}" -m highd_lc.cli "$@"\n'
        (bin_folder / "highd-lc").write_text(program)
        (bin_folder / "highd-lc").chmod(0o755)
        for stamp in (".set-up", ".set-up-dev"):
            (self.place / "venv" / stamp).touch()
        values = {"VENV": "venv", "WORK": "work", "REPORTS": "reports", "DATA": "data/highd"}
        given = {name: str(self.place / value) for name, value in values.items()} | {"PIPELINE": str(QUICK)}
        words = [word for word in words if not word.startswith("DATA=")]
        if (self.place, *words) not in _MADE:  # several pages begin with the same one
            _MADE[self.place, *words] = self._run(words, cwd=ROOT, **given)
        return _MADE[self.place, *words]

    def _shell(self, line: str) -> str:
        """Any other line, by bash, with highd-lc and python of this environment."""
        program = (
            f'highd-lc() {{ "{sys.executable}" -m highd_lc.cli "$@"; }}; python() {{ "{sys.executable}" "$@"; }}'
        )
        return self._run(["bash", "-euc", f"set -o pipefail; {program}; {line}"], cwd=self.place)

    def _run(self, words: list[str], *, cwd: Path, **variables: str) -> str:
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
        paths = os.pathsep.join([str(ROOT), kept.get("PYTHONPATH", "")])
        done = subprocess.run(
            words, cwd=cwd, env=kept | {"PYTHONPATH": paths} | variables, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout
