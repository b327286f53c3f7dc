"""The recorder's speed: rows a second by threads, and its CSV writer beside pyarrow's, polars' and pandas'.

python benchmarks/synthetic_recorder.py [seconds a recording]
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import polars as pl
import pyarrow as pa
from pyarrow import csv

from highd_lc.io.synthetic import simulate_recording, synthesize, write_table
from highd_lc.io.synthetic_highd import HAS_DECIMALS, TRACK_COLUMNS
from highd_lc.vocab.sections import RecorderSettings

RECORDINGS = 4
HIGHD_ROWS = 39_725_708


def best_of(repetitions: int, work: Callable[[], object]) -> float:
    """Shortest CPU time [s]."""
    times = []
    for _ in range(repetitions):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def compare_writers(folder: Path, seconds: float) -> None:
    table = simulate_recording(1, seconds, 1, settings=RecorderSettings()).tracks.table
    path, header = folder / "tracks.csv", ",".join(TRACK_COLUMNS)
    columns = {name: table[:, k] / 100 if HAS_DECIMALS[k] else table[:, k] for k, name in enumerate(TRACK_COLUMNS)}
    arrow, frame, pandas = pa.table(columns), pl.DataFrame(columns), pd.DataFrame(columns)
    own = best_of(3, lambda: write_table(path, header, table, decimals=HAS_DECIMALS))
    others = {
        "pyarrow (all digits)": best_of(3, lambda: csv.write_csv(arrow, path)),
        "polars (2 decimals)": best_of(3, lambda: frame.write_csv(path, float_precision=2)),
        "pandas (2 decimals)": best_of(1, lambda: pandas.to_csv(path, index=False, float_format="%.2f")),
    }
    print(f"own writer: {own / len(table) * 1e9:.0f} ns a row; the others take, of its CPU time:")
    for name, seconds_taken in others.items():
        print(f"  {name:22s} {seconds_taken / own:6.1f} x")


def measure_recorder(folder: Path, seconds: float) -> None:
    for workers in (1, 2):
        start, cpu = time.perf_counter(), time.process_time()
        synthesize(folder, recordings=RECORDINGS, seconds=seconds, seed=1, workers=workers)
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
        rows = sum(path.read_bytes().count(b"\n") - 1 for path in folder.glob("*_tracks.csv"))
        print(
            f"{workers} thread(s): {rows / wall / 1e6:.2f} M rows/s wall, {rows / cpu / 1e6:.2f} M rows/CPU-s; "
            f"all of HighD's size: {HIGHD_ROWS / rows * wall:.0f} s"
        )


def main(seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        synthesize(Path(folder), recordings=1, seconds=1.0, seed=1)  # compile
        compare_writers(Path(folder), seconds)
        for path in Path(folder).iterdir():
            path.unlink()
        measure_recorder(Path(folder), seconds)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 300.0)
