"""What ``import highd_lc`` costs a fresh interpreter (to be under 50 ms of CPU), and its first name."""

import statistics
import subprocess
import sys

RUNS = 15
CODE = """
import time
begin, cpu = time.perf_counter(), time.process_time()
import highd_lc
imported = time.perf_counter() - begin, time.process_time() - cpu
highd_lc.plan
print(*imported, time.process_time() - cpu - imported[1])
"""


def main():
    """Print medians over fresh interpreters."""
    runs = [
        subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=True).stdout for _ in range(RUNS)
    ]
    wall, cpu, first = (
        statistics.median(column) for column in zip(*[map(float, r.split()) for r in runs], strict=True)
    )
    print(f"import: {1e3 * cpu:.0f} ms of CPU, {1e3 * wall:.0f} ms of wall clock; lc.plan: {first:.2f} s of CPU")


if __name__ == "__main__":
    main()
