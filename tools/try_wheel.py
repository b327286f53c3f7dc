"""The wheel as somebody finds it who has no checkout: install it, run the README's ten lines, and every stage.

    python tools/try_wheel.py FOLDER

FOLDER gets the wheel, a fresh virtual environment with the versions of constraints.txt, and an empty working
folder in which everything runs. It takes some minutes, most of them for compiling; neither ``make check`` nor
``make test`` calls it. Exits with 1 if something fails.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
IMPORT_MS = 50.0
"""CPU time that importing the package may take [ms]."""
TIMED = """
import time
started = time.process_time()
import highd_lc as lc
print(1000.0 * (time.process_time() - started))
"""


def run(*command: str | Path, inside: Path) -> str:
    """What a command prints, run without anything of the checkout. Raises CalledProcessError."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "NUMBA"))}
    return subprocess.run(command, cwd=inside, env=kept, check=True, text=True, stdout=subprocess.PIPE).stdout


def install(folder: Path) -> Path:
    """The folder of the programs of a fresh environment that holds the wheel."""
    empty, wheels, venv = folder / "empty", folder / "wheel", folder / "venv"
    empty.mkdir(parents=True, exist_ok=True)
    run(sys.executable, "-m", "pip", "wheel", ROOT, "--no-deps", "-q", "-w", wheels, inside=empty)
    run(sys.executable, "-m", "venv", "--clear", venv, inside=empty)
    wheel = max(wheels.glob("*.whl"), key=lambda path: path.stat().st_mtime)
    run(venv / "bin" / "pip", "install", "-q", "-c", ROOT / "constraints.txt", wheel, inside=empty)
    return venv / "bin"


def lines() -> str:
    """The README's example of Python."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    return next(block for block in blocks if "import highd_lc as lc" in block)


def main() -> None:
    """Install, import, print the help, run the lines; print what each took or gave."""
    folder = Path(sys.argv[1]).resolve()
    programs = install(folder)
    python, empty = programs / "python", folder / "empty"
    milliseconds = min(float(run(python, "-c", TIMED, inside=empty)) for _ in range(5))
    print(f"import highd_lc: {milliseconds:.0f} ms of CPU")
    print(run(programs / "highd-lc", "--help", inside=empty).split("\n\n")[0].strip())
    said = run(python, "-c", lines() + "print(lc.__file__, plan.T, plan.status, lc.__version__)", inside=empty)
    print(said.strip())
    left = sorted(path.name for path in empty.iterdir())
    print(f"left in the working folder: {left or 'nothing'}")
    page = whole_run(programs / "highd-lc", folder / "run")
    print(f"a whole run ends with {page}")
    if milliseconds > IMPORT_MS or str(ROOT) in said or left or not page.is_file():
        sys.exit(1)


def whole_run(program: Path, place: Path) -> Path:
    """The first page of a run of every stage, by a pipeline that has little to do."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    shutil.copy(ROOT / "tests" / "faults" / "quick.toml", place)
    run(program, "synthesize", "data", "--recordings", "2", "--seconds", "20", inside=place)
    run(program, "run", "--data", "data", "--pipeline", "quick.toml", inside=place)
    return place / "reports" / "index.html"


if __name__ == "__main__":
    main()
