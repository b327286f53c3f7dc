"""A data set of HighD's size through the whole pipeline: time, CPU, memory and bytes of each stage, as markdown.

    python benchmarks/full_scale.py [--recordings 6 15 30 60] [--cases default fixed-ga fixed-screen]
                                    [--seconds 800] [--workers 2] [--folder FOLDER] [--keep]

The recordings are synthesized once; a smaller number takes the first of them. 60 of 800 s have a little more than
HighD's rows and about its vehicles and usable lane changes. Cases: ``default`` is the pipeline
highd as it is shipped, to the report; the others stop after validate and plan the fixed form alone, without the
studies on samples, with the GA or the screen as the optimiser of the calibration.

Each stage is a command of its own (its start-up included), so that its processes can be added up, workers and
all: CPU time as it stood when each process was last seen, ten times a second; memory as the largest sum of what
was in use at one moment (proportional set size: pages that processes share count once), once a second, since the
kernel walks through all pages of a process for it.
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

import pyarrow.parquet as pq

from highd_lc.io.settings import pipelines_folder

STAGES = ("ingest", "extract", "calibrate", "validate", "report")
CASES = ("default", "fixed-ga", "fixed-screen")
_FIXED_FORM = {
    "free_form": "false",
    "start": '"none"',
    "sample": "0",
    "start_sample": "0",
    "foresight_sample": "0",
    "solver_sample": "0",
    "multibody_sample": "0",
    "safety_sample": "0",
    "also_sample": "0",
    "validate.closed_loop.events": "0",
}
"""Keys, with their section where others of another section have the same."""
_SAMPLE_SECONDS = 0.1
_LOOKS_AT_MEMORY = 10
"""One in so many samples looks at the memory: at every one the watching took a quarter of a core."""


@dataclass(frozen=True)
class Usage:
    """What a command took. seconds and cpu [s], memory [bytes]."""

    seconds: float
    cpu: float
    memory: int


def main() -> None:
    """Synthesize, then run every case at every number of recordings; print a table of each."""
    arguments = _arguments()
    folder = Path(arguments.folder or tempfile.mkdtemp(prefix="highd_lc_full_"))
    try:
        _synthesize(folder / "data", arguments)
        for case in arguments.cases:
            for count in arguments.recordings:
                print(_run(case, count, folder, arguments), flush=True)
    finally:
        if not (arguments.keep or arguments.folder):
            shutil.rmtree(folder)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, nargs="+", default=[60], help="how many; several: growth")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=["default"])
    parser.add_argument("--seconds", type=float, default=800.0, help="length of a recording (HighD: about 1000 s)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", help="where to work and leave everything; default: temporary")
    parser.add_argument("--keep", action="store_true", help="leave the temporary folder")
    return parser.parse_args()


def _synthesize(data: Path, arguments: argparse.Namespace) -> None:
    if data.exists():
        return
    amount = ["--recordings", str(max(arguments.recordings)), "--seconds", str(arguments.seconds)]
    usage = _watched([*_PROGRAM, "synthesize", str(data), *amount, "--workers", str(arguments.workers)])
    print(f"synthesized in {usage.seconds:.0f} s, {_size(data) / 1e9:.2f} GB; {_machine(arguments)}\n", flush=True)


_PROGRAM = [sys.executable, "-c", "from highd_lc.cli import main; main()"]


def _run(case: str, count: int, folder: Path, arguments: argparse.Namespace) -> str:
    """All stages of a case on the first recordings: the table."""
    place = folder / f"{case}-{count}"
    shutil.rmtree(place, ignore_errors=True)
    _linked(folder / "data", place / "data", count)
    options = ["--data", place / "data", "--work", place / "work", "--reports", place / "reports"]
    options += ["--pipeline", _pipeline(case, place), "--workers", arguments.workers]
    rows = []
    for stage in STAGES if case == "default" else STAGES[:-1]:
        before = _size(place)
        usage = _watched([*_PROGRAM, stage, *map(str, options)])
        rows.append((stage, usage, _size(place) - before))
    return _table(f"{case}, {count} recordings ({_contents(place / 'work')})", rows)


def _contents(work: Path) -> str:
    """What the run went through: rows of its artefacts."""
    rows = sum(pq.read_metadata(path).num_rows for path in (work / "tracks").rglob("*.parquet"))
    counts = {
        name: pq.read_metadata(work / f"{name}.parquet").num_rows for name in ("vehicles", "events", "followers")
    }
    return f"{rows / 1e6:.1f} M rows, " + ", ".join(f"{count:,} {name}" for name, count in counts.items())


def _linked(data: Path, place: Path, count: int) -> None:
    """The first recordings in a folder of their own."""
    place.mkdir(parents=True)
    for path in data.glob("*_*.csv"):
        if int(path.name.split("_")[0]) <= count:
            (place / path.name).symlink_to(path.resolve())


def _pipeline(case: str, place: Path) -> Path:
    """The shipped pipeline highd, with the case's settings."""
    optimiser = '"screen"' if case == "fixed-screen" else '"ga"'
    changes = {} if case == "default" else {**_FIXED_FORM, "optimiser": optimiser}
    lines = (pipelines_folder() / "highd.toml").read_text(encoding="utf-8").splitlines()
    section, changed = "", []
    for line in lines:
        section, key = line.strip("[]") if line.startswith("[") else section, line.split(" = ")[0]
        value = changes.get(f"{section}.{key}", changes.get(key))
        changed.append(line if value is None else f"{key} = {value}")
    path = place / "pipeline.toml"
    path.write_text("\n".join(changed), encoding="utf-8")
    return path


@dataclass
class _Watch:
    """Processes of a session as they are seen. cpu: of each process [s]; memory: peak of their sum [bytes]."""

    session: int
    cpu: dict[str, float] = field(default_factory=dict)
    memory: int = 0
    looks: int = 0

    def look(self) -> None:
        processes = _processes(self.session)
        if self.looks % _LOOKS_AT_MEMORY == 0:
            self.memory = max(self.memory, sum(map(_memory, processes)))
        self.looks += 1
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
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            of = int(Path("/proc", name, "stat").read_text().rpartition(")")[2].split()[3])
        except OSError:
            continue
        if of == session:
            found.append(Path("/proc", name))
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


def _table(caption: str, rows: list[tuple[str, Usage, int]]) -> str:
    lines = [
        f"{caption}:",
        "",
        "| stage | time [s] | CPU [s] | peak memory [MB] | written [MB] |",
        "|---|---:|---:|---:|---:|",
    ]
    for stage, usage, size in rows:
        lines.append(
            f"| {stage} | {usage.seconds:.1f} | {usage.cpu:.1f} | {usage.memory / 1e6:.0f} | {size / 1e6:.1f} |"
        )
    seconds, cpu = (sum(getattr(usage, name) for _, usage, _ in rows) for name in ("seconds", "cpu"))
    memory, size = max(usage.memory for _, usage, _ in rows), sum(size for *_, size in rows)
    lines.append(f"| all | {seconds:.1f} | {cpu:.1f} | {memory / 1e6:.0f} | {size / 1e6:.1f} |\n")
    return "\n".join(lines)


def _machine(arguments: argparse.Namespace) -> str:
    return (
        f"{arguments.workers} workers, {os.cpu_count()} CPUs ({_processor()}), Python {platform.python_version()}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    main()
