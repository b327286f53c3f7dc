"""Ingest and extraction against reading the same file, as ratios of CPU time within one run.

    python benchmarks/bench_ingest.py [DATA RECORDING]

Without arguments a recording of about 400,000 rows is synthesized. CPU time counts every thread; each figure is
the least of several runs. Peak memory is that of a fresh process that ingests and extracts the recording.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import polars as pl
import pyarrow as pa
from pyarrow import csv as arrow_csv

from highd_lc.io.highd_csv import read_columns
from highd_lc.io.highd_files import input_files
from highd_lc.io.highd_tables import FIELDS
from highd_lc.io.synthetic import write_recording
from highd_lc.stages import extract, ingest
from highd_lc.vocab.job import Job, Provenance
from highd_lc.vocab.sections import RecorderSettings
from highd_lc.vocab.settings import Settings

NAMES = [field.name for field in FIELDS if not field.sampled]
WHOLE = {field.name for field in FIELDS if field.kind is int}
RUNS = 5


def least(work: Callable[[], object]) -> float:
    """Least CPU time of several runs [s], after one that warms up."""
    work()
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def read_arrow(path: Path) -> object:
    """The needed columns, typed, by pyarrow on one thread."""
    types = {name: pa.int64() if name in WHOLE else pa.float64() for name in NAMES}
    return arrow_csv.read_csv(
        path,
        read_options=arrow_csv.ReadOptions(use_threads=False),
        convert_options=arrow_csv.ConvertOptions(column_types=types, include_columns=NAMES),
    )


def read_polars(path: Path) -> object:
    """The needed columns, typed, by polars."""
    types = {name: pl.Int64 if name in WHOLE else pl.Float64 for name in NAMES}
    return pl.read_csv(path, columns=NAMES, schema_overrides=types)


def job(data: Path, recording: int, work: Path) -> Job:
    """Both stages' job on a recording."""
    return Job(recording, data, work, Settings(), Provenance("", {}, 1, ""))


def peak_memory(data: Path, recording: int) -> float:
    """Peak memory of a process that ingests and extracts [MB]."""
    command = [sys.executable, __file__, "--memory", str(data), str(recording)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def own_peak() -> float:
    """Peak memory of this process [MB]. What getrusage says includes that of the process that started this one."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def report(data: Path, recording: int, work: Path) -> None:
    """Measure and print."""
    path = input_files(data, recording)[2]
    one = job(data, recording, work)
    reference = least(lambda: pd.read_csv(path))
    rows = len(pd.read_csv(path, usecols=["id"]))
    measured = {
        "pandas.read_csv, all columns": reference,
        "pandas.read_csv, columns needed": least(lambda: pd.read_csv(path, usecols=NAMES)),
        "polars, columns needed": least(lambda: read_polars(path)),
        "pyarrow, columns needed": least(lambda: read_arrow(path)),
        "our reader, columns needed": least(lambda: read_columns(path, FIELDS)),
        "ingest: CSV to tracks": least(lambda: ingest.run(one)),
        "extract: tracks to events": least(lambda: extract.run(one)),
    }
    measured["CSV to tracks and events"] = (
        measured["ingest: CSV to tracks"] + measured["extract: tracks to events"]
    )
    print(f"{rows} rows, {path.stat().st_size / 1e6:.0f} MB")
    for name, seconds in measured.items():
        print(f"{name:<34}{seconds:8.3f} CPU-s{seconds / reference:8.2f} x pandas.read_csv")
    print(f"{'peak memory of both stages':<34}{peak_memory(data, recording):8.0f} MB")


def main() -> None:
    """Measure a given recording or a synthetic one."""
    if sys.argv[1:2] == ["--memory"]:
        with tempfile.TemporaryDirectory() as work:
            one = job(Path(sys.argv[2]), int(sys.argv[3]), Path(work))
            ingest.run(one)
            extract.run(one)
        print(own_peak())
        return
    with tempfile.TemporaryDirectory() as folder:
        if len(sys.argv) == 3:
            report(Path(sys.argv[1]), int(sys.argv[2]), Path(folder))
        else:
            write_recording(Path(folder), 1, 480.0, 1, settings=RecorderSettings())
            report(Path(folder), 1, Path(folder) / "work")


if __name__ == "__main__":
    main()
