"""What the door offers: every name, documented with examples that run, and nothing paid before it is used."""

import ast
import doctest
import inspect
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

import highd_lc as lc

ROOT = Path(__file__).parents[2]
MODULES = sorted(path.stem for path in (ROOT / "highd_lc" / "api").glob("[a-z]*.py"))
OFFERED = re.findall(r"as (\w+)$", (ROOT / "highd_lc" / "__init__.pyi").read_text(), flags=re.MULTILINE)
FUNCTIONS = [name for name in OFFERED if inspect.isfunction(getattr(lc, name))]


def test_every_name_of_the_stub_is_there_and_listed():
    assert {*OFFERED, "__version__"} <= set(dir(lc))
    assert lc.__version__ == version("highd-lc")
    for accounting in lc.ACCOUNTINGS:
        assert isinstance(accounting, str)


@pytest.mark.parametrize("name", ["plans_", "Ego", "local_optimum"])
def test_other_names_are_refused_as_python_does(name):
    with pytest.raises(AttributeError, match=name):
        getattr(lc, name)


def test_importing_loads_nothing_heavy():
    heavy = "[m for m in ('numpy', 'pandas', 'numba', 'matplotlib', 'pydantic') if m in sys.modules]"
    code = f"import highd_lc, sys; print({heavy}); highd_lc.LOCAL_OPTIMUM; print({heavy})"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["[]", "[]"]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_documented(name):
    function = getattr(lc, name)
    text = inspect.getdoc(function)
    assert text.splitlines()[0].endswith(".")
    for argument in inspect.signature(function).parameters:
        assert f"\n    {argument}: " in text
    assert "\nReturns:\n" in text


def test_examples_are_many():
    found = [
        test
        for module in MODULES
        for test in doctest.DocTestFinder().find(import_module(f"highd_lc.api.{module}"))
    ]
    named = {test.name.rsplit(".", 1)[1] for test in found if test.examples}
    assert {*FUNCTIONS, "plot", "scene", "of"} <= named


@pytest.mark.parametrize("module", MODULES)
def test_examples_run(module):
    found = doctest.testmod(import_module(f"highd_lc.api.{module}"))
    assert found.failed == 0


@pytest.mark.parametrize("page", ["README.md", "docs/api.md"])
def test_the_lines_of_the_pages_run(page, tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    told = {"lc": lc}
    for block in blocks:
        exec(compile(ast.parse(block), page, "exec"), told)
    assert told["plan"].status == "solved"
    assert told["fit"].status == "fitted"
    assert not list(tmp_path.iterdir())
