"""Every fenced block of README and docs runs, and shows what the page says it shows."""

import re
import shutil
import sys
from pathlib import Path

import pytest
from code_blocks import QUICK, ROOT, RUN, Session, blocks, pages
from shared_runs import copied

FIXTURES = ROOT / "tests" / "fixtures"
PAGES = pages()
_READ = {"text", "yaml", "json", "mermaid", "jinja", "html", "bibtex"}
"""Kinds of blocks that are no commands and no code."""


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def place(quick_run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two small recordings where HighD's go, and what a short run made of them."""
    root = tmp_path_factory.mktemp("documented")
    data = root / "data" / "highd"
    data.mkdir(parents=True)
    for path in FIXTURES.glob("*.csv"):
        shutil.copy(path, data)
    shutil.copytree(ROOT / "examples", root / "examples")
    copied(quick_run, root)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        Session(root).command(f"highd-lc run --data data/highd --pipeline '{QUICK}'")
    return root


@pytest.mark.parametrize(
    "page", [p for p in PAGES if any(b.kind in RUN and not b.why for b in blocks(p))], ids=name_of
)
def test_the_blocks_of_a_page_run(page, place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(str(place))
    known = set(sys.modules)
    session = Session(place)
    try:
        for block in blocks(page):
            if block.kind in RUN and not block.why:
                try:
                    session.run(block)
                except Exception as error:
                    raise AssertionError(f"{name_of(page)}:{block.line}: {error}") from error
    finally:
        for module in set(sys.modules) - known:
            if "." not in module and (place / f"{module}.py").exists():
                del sys.modules[module]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_says_what_it_is(page):
    for block in blocks(page):
        assert block.kind in {*RUN, *_READ}, f"{name_of(page)}:{block.line}: {block.kind!r}"
    indented = re.findall(r"^ {4}(?:highd-lc|make|python|pip|import) .*", page.read_text("utf-8"), re.MULTILINE)
    inside = "\n".join(block.text for block in blocks(page))
    assert [line for line in indented if line not in inside] == []


def test_a_block_that_fails_or_shows_something_else_is_told(tmp_path):
    session = Session(tmp_path)
    session._python("a = 1")
    session._python(">>> a + 1\n2\n")
    with pytest.raises(AssertionError, match="Got"):
        session._python(">>> a + 1\n3\n")
    with pytest.raises(AssertionError, match="no such pipeline"):
        session._sh("highd-lc run --pipeline nowhere")
    with pytest.raises(AssertionError, match="shows"):
        session._console("$ echo one\ntwo\n")
    session._console("$ echo one two\none ...\n")
