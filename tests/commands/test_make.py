"""make as people call it: values with anything in them, and virtual environments in any state."""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FAKE = Path(__file__).with_name("fake_python.sh")
WORKERS = "<--workers><2>"

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="GNU make is not installed")


@dataclass(frozen=True)
class Checkout:
    """What of a checkout setting up needs, in a folder with a space; every Python in it is a fake one."""

    folder: Path

    def python(self, version: str, *without: str) -> Path:
        """A Python of the version. without: "pip", "ensurepip"."""
        place = self.folder.parent / "-".join(["python", version, *without])
        place.mkdir()
        shutil.copy(FAKE, place)
        (place / "version").write_text(version)
        for name in without:
            (place / f"no-{name}").touch()
        return place / FAKE.name

    def make(self, target: str, **variables: object) -> subprocess.CompletedProcess[str]:
        words = [f"{name}={value}" for name, value in variables.items()]
        outer = {"MAKEFLAGS", "MFLAGS", "MAKEOVERRIDES", "MAKELEVEL", "PYTHON", "VENV", "DATA", "WORK", "REPORTS"}
        surroundings = {k: v for k, v in os.environ.items() if k not in outer | {"PIPELINE", "OUT", "WORKERS"}}
        return subprocess.run(
            ["make", target, *words],
            cwd=self.folder,
            env=surroundings,
            capture_output=True,
            text=True,
            check=False,
        )

    def version(self, venv: str = ".venv") -> str:
        return (self.folder / venv / "bin/version").read_text()


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    folder = tmp_path / "a checkout"
    (folder / "tools").mkdir(parents=True)
    for name in ("Makefile", "pyproject.toml", "constraints.txt", "tools/set_up.sh"):
        shutil.copy(ROOT / name, folder / name)
    return Checkout(folder)


@pytest.fixture
def ready(checkout: Checkout) -> Checkout:
    """A checkout that is set up: its highd-lc prints its arguments."""
    assert checkout.make("setup", PYTHON=checkout.python("3.12.1")).returncode == 0
    return checkout


@pytest.mark.parametrize(
    "value",
    [
        "my data",
        "highD (v1.0)",
        "[a] {b}",
        "it's",
        'the "best"',
        "a$b",
        "$$",
        "$HOME",
        "$(HOME)",
        "a;touch executed",
        "a&touch executed&",
        "$(touch executed)",
        "$(shell touch executed)",
        "`touch executed`",
        "a|touch executed",
        "'; touch executed; '",
        "a#b",
        "a,b",
        "100%",
        "back\\slash",
        "*",
        "two  spaces",
        "-n",
    ],
)
def test_a_value_arrives_as_it_is_and_is_never_executed(ready, value):
    values = {"DATA": value, "WORK": value, "REPORTS": value, "PIPELINE": value}
    options = f"<--data><{value}><--work><{value}><--reports><{value}><--pipeline><{value}>"
    assert ready.make("validate", **values).stdout == f"<run>{options}{WORKERS}"
    assert ready.make("calibrate", **values).stdout == f"<calibrate>{options}{WORKERS}"
    assert ready.make("synthesize", OUT=value).stdout == f"<synthesize><--><{value}>"
    found = ready.make("scenarios", REPORTS=value, WORKERS=value).stdout
    assert found == f"<scenarios><--out><{value}/scenarios><--workers><{value}>"
    assert not (ready.folder / "executed").exists()


@pytest.mark.parametrize(
    ("value", "expected"),
    [("~", "{}"), ("~/high d", "{}/high d"), ("~/$a", "{}/$a"), ("a~/b", "a~/b"), ("~b", "~b"), ("a/~", "a/~")],
)
def test_tilde_at_the_beginning_is_the_home_folder(ready, value, expected):
    home = os.environ.get("HOME", "")
    assert ready.make("ingest", DATA=value).stdout == f"<ingest><--data><{expected.format(home)}>{WORKERS}"


def test_nothing_is_passed_that_is_not_given(ready):
    assert ready.make("validate").stdout == f"<run>{WORKERS}"
    assert ready.make("demo", WORK="w w").stdout == f"<run><--pipeline><demo><--work><w w>{WORKERS}"
    assert ready.make("synthesize").stdout == "<synthesize><--><data/synthetic>"


@pytest.mark.parametrize("code", [0, 2, 3, 4])
def test_exit_code_4_alone_is_success(ready, code):
    (ready.folder / ".venv/bin/highd-lc").write_text(f"#!/bin/sh\nexit {code}\n")
    found = ready.make("validate")
    assert (found.returncode == 0) == (code in (0, 4))
    assert ("what was skipped is listed" in found.stdout) == (code == 4)


@pytest.mark.parametrize("venv", ["my venv", "v(1)", "it's", "$(touch executed)"])
def test_the_environment_may_have_any_name(checkout, venv):
    python = checkout.python("3.11.2")
    assert checkout.make("setup", PYTHON=python, VENV=venv).returncode == 0
    assert checkout.make("ingest", VENV=venv).stdout == f"<ingest>{WORKERS}"
    assert not (checkout.folder / ".venv").exists()
    assert not (checkout.folder / "executed").exists()


@pytest.mark.parametrize("version", ["3.10.13", "2.7.18", "3.9.0", "3.8"])
def test_a_python_too_old_is_named_and_nothing_is_made(checkout, version):
    found = checkout.make("setup", PYTHON=checkout.python(version))
    assert found.returncode != 0
    line = found.stderr.splitlines()[0]
    assert f"is Python {version}; needed: >= 3.11" in line
    assert not (checkout.folder / ".venv").exists()


@pytest.mark.parametrize("version", ["3.11.0", "3.13.1", "3.14.0rc1", "4.0.0"])
def test_a_python_new_enough_is_taken(checkout, version):
    assert checkout.make("setup", PYTHON=checkout.python(version)).returncode == 0
    assert checkout.version() == version


def test_a_python_that_is_none(checkout):
    for python in ("no-such-python", "false", ROOT):
        found = checkout.make("setup", PYTHON=python)
        assert found.returncode != 0
        assert re.match(r"setup: .*: (not found|does not run as a Python); needed: Python >= 3\.11", found.stderr)


def test_a_python_without_ensurepip_names_the_package(checkout):
    found = checkout.make("setup", PYTHON=checkout.python("3.12.3", "ensurepip"))
    assert found.returncode != 0
    assert "apt install python3.12-venv" in found.stderr
    assert not (checkout.folder / ".venv").exists()


def too_old(venv):
    (venv / "bin/version").write_text("3.10.1")
    (venv / "pyvenv.cfg").write_text("version = 3.10.1\n")


def upgraded(venv):
    (venv / "bin/version").write_text("3.13.0")


def dangling(venv):
    (venv / "bin/python").unlink()
    (venv / "bin/python").symlink_to("/nowhere/python")


def missing(venv):
    (venv / "bin/python").unlink()


def crashing(venv):
    (venv / "bin/fake_python.sh").write_text("#!/bin/sh\nexit 1\n")


def without_pip(venv):
    for name in ("no-pip", "no-ensurepip"):
        (venv / "bin" / name).touch()
    (venv / ".set-up").unlink()


def moved(venv):
    venv.rename(venv.with_name("elsewhere"))
    shutil.copytree(venv.with_name("elsewhere"), venv, symlinks=True)
    (venv / ".set-up").write_text("/nowhere/.venv\n")


FAULTS = {
    too_old: r"it is of Python 3\.10\.1 \(needed: >= 3\.11\)",
    upgraded: r"it was made for Python 3\.12\.1, its python is 3\.13\.0 now",
    dangling: "its python does not run",
    missing: "its python does not run",
    crashing: "its python does not run",
    without_pip: "it has no pip",
    moved: "it was made elsewhere",
}


@pytest.mark.parametrize("damage", FAULTS, ids=lambda damage: damage.__name__)
def test_an_environment_that_cannot_serve_is_made_anew(ready, damage):
    damage(ready.folder / ".venv")
    found = ready.make("setup", PYTHON=ready.python("3.12.9"))
    assert found.returncode == 0, found.stderr
    assert re.search(FAULTS[damage] + "; making it anew", found.stdout)
    assert "setup: installing the package" in found.stderr
    assert ready.version() == "3.12.9"
    again = ready.make("setup")
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")


def test_missing_pip_is_put_in_where_that_is_enough(ready):
    venv = ready.folder / ".venv"
    (venv / ".set-up").unlink()
    (venv / "bin/no-pip").touch()
    (venv / "kept").touch()
    assert ready.make("setup").returncode == 0
    assert (venv / "kept").exists()


def test_another_python_asked_for_is_taken_and_the_default_does_not_replace_what_serves(ready):
    assert ready.make("setup", PYTHON=ready.python("3.11.4")).returncode == 0
    assert ready.version() == "3.11.4"
    assert ready.make("setup").stdout == ""
    assert ready.version() == "3.11.4"


def test_an_old_python_asked_for_is_refused_beside_an_environment_that_serves(ready):
    assert "needed: >= 3.11" in ready.make("setup", PYTHON=ready.python("3.10.2")).stderr
    assert ready.version() == "3.12.1"


@pytest.mark.parametrize("damage", [too_old, dangling, upgraded], ids=lambda damage: damage.__name__)
def test_an_environment_that_make_did_not_make_is_left_alone(ready, damage):
    (ready.folder / ".venv").rename(ready.folder / "mine")
    (ready.folder / "mine/.made-by-make").unlink()
    damage(ready.folder / "mine")
    found = ready.make("setup", VENV="mine", PYTHON=ready.python("3.12.9"))
    assert found.returncode != 0
    assert "make did not make it" in found.stderr.splitlines()[0]
    assert (ready.folder / "mine/bin/fake_python.sh").exists()


def test_a_folder_or_file_that_is_no_environment_is_left_alone(checkout):
    python = checkout.python("3.12.1")
    (checkout.folder / "thesis").mkdir()
    (checkout.folder / "thesis/chapter.tex").write_text("precious")
    (checkout.folder / "notes").write_text("precious")
    (checkout.folder / "link").symlink_to("nowhere")
    for venv in ("thesis", "notes", "link"):
        found = checkout.make("setup", VENV=venv, PYTHON=python)
        assert found.returncode != 0
        assert found.stderr.startswith(f"setup: VENV=./{venv}: ")
    assert (checkout.folder / "thesis/chapter.tex").read_text() == "precious"
    assert (checkout.folder / "notes").read_text() == "precious"


def test_an_empty_folder_becomes_the_environment(checkout):
    (checkout.folder / "empty").mkdir()
    assert checkout.make("setup", VENV="empty", PYTHON=checkout.python("3.12.1")).returncode == 0
    assert checkout.version("empty") == "3.12.1"


def test_help_tells_every_target(ready):
    text = ready.make("help").stdout
    targets = set(re.findall(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.M)[0].split())
    targets |= set(re.findall(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.M)[1].split())
    assert {line.split()[0] for line in text.splitlines()[:-1]} == targets - {"setup-dev"}
