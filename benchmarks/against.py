"""The benchmarks beside those of an earlier commit: each figure's ratio, on one machine, turn by turn.

    python benchmarks/against.py [bench_planner.py ..] [--commit b4f799e] [--turns 3] [--worktree FOLDER]

The earlier commit is laid out as a worktree of this repository (FOLDER, else temporary) with a kernel cache of its
own, and runs under the same interpreter and packages. Benchmarks that both have run in turn. Every figure with a
unit of time counts that both print behind the same words; its ratio is the median over the turns.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

HERE = Path(__file__).parents[1]
ASKED = ("bench_planner.py", "bench_calibration.py", "bench_tracking.py", "bench_ingest.py", "bench_platoon.py")
_FIGURE = re.compile(r"(\d+\.?\d*) (ns|us|ms|CPU-s|s)\b")
Figures = dict[tuple[str, str], float]


def main() -> None:
    """A table of each benchmark that both commits have."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", default=ASKED)
    parser.add_argument("--commit", default="b4f799e")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--worktree", type=Path, help="where the commit is, or is to be laid out and left")
    asked = parser.parse_args()
    with _laid_out(asked.commit, asked.worktree) as there:
        if there is None:
            print(f"{asked.commit} cannot be had here (no repository with it): no ratios")
            return
        for name in asked.files:
            if (there / "benchmarks" / name).is_file():
                _compare(name, there, asked.turns)


@contextmanager
def _laid_out(commit: str, folder: Path | None) -> Iterator[Path | None]:
    """The commit's worktree; None where git does not have it. A temporary one is removed again."""
    if folder is not None and (folder / "benchmarks").is_dir():
        yield folder
        return
    with tempfile.TemporaryDirectory() as temporary:
        there = folder or Path(temporary) / "worktree"
        git = ["git", "-C", str(HERE), "worktree"]
        made = subprocess.run([*git, "add", "--detach", str(there), commit], capture_output=True, check=False)
        yield there if made.returncode == 0 else None
        if folder is None and made.returncode == 0:
            subprocess.run([*git, "remove", "--force", str(there)], check=False)


def _compare(name: str, there: Path, turns: int) -> None:
    _figures(there, name), _figures(HERE, name)  # which compiles what is not compiled yet
    found = [(_figures(HERE, name), _figures(there, name)) for _ in range(turns)]
    print(f"== {name}: now, {there.name}, ratio (median of {turns})")
    for key in (key for key in found[0][0] if all(key in one for turn in found for one in turn)):
        now, then = (np.median([turn[side][key] for turn in found]) for side in (0, 1))
        ratio = np.median([ours[key] / theirs[key] for ours, theirs in found if theirs[key] > 0.0] or [np.nan])
        print(f"{key[0]:<60}{now:10.3f}{then:10.3f} {key[1]:<6}x {ratio:.2f}", flush=True)


def _figures(folder: Path, name: str) -> Figures:
    """The times that a benchmark of a folder prints, by the words in front of them and their unit."""
    of_folder = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / ".kernels")}
    call = [sys.executable, str(folder / "benchmarks" / name)]
    done = subprocess.run(
        call, env=os.environ | of_folder, cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        print(f"{name} of {folder.name} failed: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
    found: Figures = {}
    for line in done.stdout.splitlines():
        for figure in _FIGURE.finditer(line):
            words = " ".join(re.sub(r"\d+\.\d+", "", line[: figure.start()]).split())
            if "asked" not in words:
                found[words.strip(" :,;"), figure[2]] = float(figure[1])
    return found


if __name__ == "__main__":
    main()
