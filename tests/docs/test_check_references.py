"""The proof that references resolve: what it finds in small trees with one fault each, and what it lets pass."""

import subprocess
import sys
from pathlib import Path
from runpy import run_path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "docs" / "check_references.py"
CHECK = run_path(str(SCRIPT))
OLD = CHECK["GONE"][0]
EQUATIONS = """# Equations

## 4. Losses
### 4.1 Sums over samples
### 4.6 Accounting: `paper`, *equal* and [more](more.md)
```
## 9. No heading, but code
```
## 12. Population
"""


def tree(root: Path, files: dict[str, str]) -> list[str]:
    """The faults of a project that has these files beside sound equations."""
    for name, text in ({"docs/equations.md": EQUATIONS, "docs/more.md": "# More\n"} | files).items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return list(CHECK["faults"](root))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("highd_lc/a.py", '"""Sums (equations.md 4.1)."""\n'),
        ("highd_lc/a.py", '"""Losses: equations.md 4, 4.6 and 12; 99 is a number."""\n'),
        ("highd_lc/a.py", "# A sum over samples, as in equations.md\n# 4.1, of each follower.\n"),
        ("pipelines/a.toml", "horizon_s = 15.0  # H (equations.md 4.6: 15)\n"),
        (
            "README.md",
            "[Losses](docs/equations.md#4-losses), `equations.md 4.1`, [site](https://example.org/none)\n",
        ),
        ("README.md", "[Accounting](docs/equations.md#46-accounting-paper-equal-and-more), [docs](docs)\n"),
        ("docs/more.md", "# More\n## Twice\n## Twice\n[second](#twice-1), [up](../README.md)\n"),
        ("highd_lc/a.py", f"{OLD} = 1  # a name may be spelled like a document\n"),
        ("highd_lc/a.py", f"{OLD} = 1\nTEXT = f'{{{OLD}}} of them'\n"),
        ("tests/a.py", f'"""{OLD}_FAULTS is the name of a variable."""\n'),
        ("CHANGELOG.md", "Took `highd_lc/gone.py` out.\n"),
        ("work/a.md", "[what a run writes](nowhere.md) is not looked at\n"),
    ],
)
def test_what_resolves_is_let_pass(tmp_path, name, text):
    assert tree(tmp_path, {"README.md": "# Project\n"} | {name: text}) == []


@pytest.mark.parametrize(
    ("name", "text", "line", "words"),
    [
        ("highd_lc/a.py", '"""Sums.\n\nSee equations.md 4.2.\n"""\n', 3, "no section 4.2"),
        ("tests/a.py", "# equations.md 4.1, 4.6 and 5\n", 1, "no section 5"),
        ("pipelines/a.toml", "x = 1\n# equations.md\n# 7\n", 2, "no section 7"),
        ("docs/more.md", "equations.md 9\n", 1, "no section 9"),
        ("highd_lc/a.py", "# equations.md, section 4.1\n", 1, "cite it as"),
        ("highd_lc/a.py", f'"""First.\n\nAs in {OLD}, section 4."""\n', 3, OLD),
        ("benchmarks/a.py", f"# {OLD}.md says so\n", 1, OLD),
        ("pipelines/a.toml", f"y = 2 # ({OLD} 4)\n", 1, OLD),
        ("README.md", f"As {OLD} has it.\n", 1, OLD),
        ("README.md", "one\n[two](docs/none.md)\n", 2, "there is no docs/none.md"),
        ("README.md", "[Losses](docs/equations.md#losses)\n", 1, "no heading #losses"),
        ("docs/more.md", "# More\n[self](#less)\n", 2, "no heading #less"),
        ("docs/more.md", "![picture](img/none.png)\n", 1, "there is no img/none.png"),
        ("highd_lc/a.py", '"""Figures: docs/none.md."""\n', 1, "there is no docs/none.md"),
        ("highd_lc/a.py", '"""docs/more.md#less."""\n', 1, "no heading #less"),
        ("docs/more.md", "`highd_lc/gone.py` has it\n", 1, "there is no highd_lc/gone.py"),
        ("docs/more.md", "all of `highd_lc/gone*.py`\n", 1, "no file is called"),
    ],
)
def test_a_fault_is_named_with_file_and_line(tmp_path, name, text, line, words):
    (found,) = tree(tmp_path, {name: text})
    assert found.startswith(f"{name}:{line}: ")
    assert words in found


def test_a_section_that_is_there_twice_is_a_fault(tmp_path):
    (found,) = tree(tmp_path, {"docs/equations.md": EQUATIONS + "## 12. Population again\n"})
    assert "section 12 is there twice" in found


def test_the_command_exits_with_1_and_prints_each_fault(tmp_path):
    tree(tmp_path, {"README.md": "[a](none.md) [b](docs/more.md#none)\n"})
    done = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True)
    assert done.returncode == 1
    assert len(done.stdout.splitlines()) == 2
    tree(tmp_path, {"README.md": "[b](docs/more.md#more)\n"})
    assert subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True).returncode == 0
