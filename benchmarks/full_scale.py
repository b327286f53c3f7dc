"""A data set of HighD's size through the whole pipeline: time, CPU, memory and bytes of each stage, as markdown.

    python benchmarks/full_scale.py [--recordings 60] [--seconds 1000] [--pipeline highd] [--workers 2] [--keep]

Each stage is a command of its own (its start-up included), so that its processes can be added up, workers and
all: CPU time as it stood when each process was last seen, memory as the largest sum of what was in use at one
moment (proportional set size: pages that processes share count once), sampled ten times a second.
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

STAGES = ("synthesize", "ingest", "extract", "calibrate", "validate", "report")
_SAMPLE_SECONDS = 0.1


@dataclass(frozen=True)
class Usage:
    """What a command took. seconds and cpu [s], memory [bytes]."""

    seconds: float
    cpu: float
    memory: int


def main() -> None:
    arguments = _arguments()
    folder = Path(arguments.folder or tempfile.mkdtemp(prefix="highd_lc_full_"))
    try:
        rows = [(stage, *_measured(stage, folder, arguments)) for stage in STAGES]
    finally:
        if not (arguments.keep or arguments.folder):
            shutil.rmtree(folder)
    print(_table(rows, arguments))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=1000.0, help="length of a recording (HighD: 1000 s)")
    parser.add_argument("--pipeline", default="highd", help="shipped name or TOML file")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", help="where to work and leave everything; default: temporary")
    parser.add_argument("--keep", action="store_true", help="leave the temporary folder")
    return parser.parse_args()


def _measured(stage: str, folder: Path, arguments: argparse.Namespace) -> tuple[Usage, int]:
    """Carry out a stage: what it took, and the bytes that it left."""
    before = _size(folder)
    usage = _watched(_command(stage, folder, arguments))
    return usage, _size(folder) - before


def _command(stage: str, folder: Path, arguments: argparse.Namespace) -> list[str]:
    program = [sys.executable, "-c", "from highd_lc.cli import main; main()", stage]
    if stage == "synthesize":
        amount = ["--recordings", arguments.recordings, "--seconds", arguments.seconds]
        amount += ["--workers", arguments.workers]
        return [*program, str(folder / "data"), *map(str, amount)]
    folders = ["--data", folder / "data", "--work", folder / "work", "--reports", folder / "reports"]
    options = ["--pipeline", arguments.pipeline, "--workers", arguments.workers]
    return [*program, *map(str, folders), *map(str, options)]


@dataclass
class _Watch:
    """Processes of a session as they are seen. cpu: of each process [s]; memory: peak of their sum [bytes]."""

    session: int
    cpu: dict[str, float] = field(default_factory=dict)
    memory: int = 0

    def look(self) -> None:
        processes = _processes(self.session)
        self.memory = max(self.memory, sum(map(_memory, processes)))
        self.cpu |= {process.name: seconds for process in processes if (seconds := _cpu(process)) is not None}


def _watched(command: list[str]) -> Usage:
    """Run a command in a session of its own and watch its processes."""
    started = time.perf_counter()
    process = subprocess.Popen(command, start_new_session=True, stdout=sys.stderr)
    watch = _Watch(process.pid)
    while process.poll() is None:
        watch.look()
        time.sleep(_SAMPLE_SECONDS)
    seconds = time.perf_counter() - started
    if process.returncode not in (0, 4):
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return Usage(seconds, sum(watch.cpu.values()), watch.memory)


def _processes(session: int) -> list[Path]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            of = int(stat.read_text().rpartition(")")[2].split()[3])
        except OSError:
            continue
        if of == session:
            found.append(stat.parent)
    return found


def _cpu(process: Path) -> float | None:
    """CPU time of a process so far [s], None if it is gone."""
    try:
        user, system = (process / "stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:
        return None
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def _memory(process: Path) -> int:
    """Proportional set size of a process [bytes], 0 if it is gone."""
    try:
        lines = (process / "smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:")), 0)


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) if folder.exists() else 0


def _table(rows: list[tuple[str, Usage, int]], arguments: argparse.Namespace) -> str:
    lines = [
        f"{arguments.recordings} recordings of {arguments.seconds:g} s, pipeline {arguments.pipeline}, "
        f"{arguments.workers} workers; {os.cpu_count()} CPUs ({_processor()}), "
        f"Python {platform.python_version()}.",
        "",
        "| stage | time [s] | CPU [s] | peak memory [MB] | written [MB] |",
        "|---|---:|---:|---:|---:|",
    ]
    for stage, usage, size in rows:
        lines.append(
            f"| {stage} | {usage.seconds:.1f} | {usage.cpu:.1f} | {usage.memory / 1e6:.0f} | {size / 1e6:.1f} |"
        )
    pipeline = rows[1:]
    seconds, cpu = (sum(getattr(usage, name) for _, usage, _ in pipeline) for name in ("seconds", "cpu"))
    memory = max(usage.memory for _, usage, _ in pipeline)
    size = sum(size for *_, size in pipeline)
    total = f"| ingest to report | {seconds:.1f} | {cpu:.1f} | {memory / 1e6:.0f} | {size / 1e6:.1f} |"
    return "\n".join([*lines, total])


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    main()
