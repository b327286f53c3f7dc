"""Prove that the project's references resolve: citations of docs/equations.md, links and paths between files.

    python docs/check_references.py [ROOT]

A citation is ``equations.md`` and section numbers: ``equations.md 4.6``, ``equations.md 4.1, 6.2 and 12``. Prints
one line a fault (file, line, what is wrong) and exits with 1 if there is any.
"""

import io
import re
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

FOLDERS = ("highd_lc", "pipelines", "tests", "benchmarks", "docs")
"""Folders that are looked through. In ``data`` and ``reports`` only the README is the project's own."""
KINDS = (".py", ".toml", ".md", ".yml", ".html", ".js", ".css", ".j2", ".cff")
GONE = ("SPEC", "HIGHD", "SPEED", "FOLLOWERS", "DESIGN")
"""Documents that are not in the repository: nothing may refer to them."""

WRITTEN = ("dictionary.md", "commands.md")
"""Pages of the documentation site that docs/site_pages.py writes."""

_GONE = re.compile(rf"\b({'|'.join(GONE)})\b")
_HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)
_NUMBER = re.compile(r"^(\d+(?:\.\d+)*)\.? ")
# A reference may run over the end of a line, into the next one of a comment.
_AND = r"(?:,|,? (?:and|to))[\s#]+"
_CITATION = re.compile(rf"\bequations\.md\s[\s#]*(\d+(?:\.\d+)*(?:{_AND}\d+(?:\.\d+)*)*)")
_WRONG_FORM = re.compile(r"\bequations\.md,?\s[\s#]*(?:sections?|§|\(\d)")
_LINK = re.compile(r"!?\[[^\]\n]*\]\(<?([^)\s>]+)>?[^)\n]*\)")
_PAGE = re.compile(r"(?<![\w/.])docs/[\w/-]+\.md(?:#[\w-]+)?")
_CODE = re.compile(r"`((?:highd_lc|tests|benchmarks|docs|pipelines)/[\w/.*-]+\.\w+)`")
_FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)

Fault = tuple[int, str]
"""Where in the text (a place counted in characters), and what is wrong."""


def slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
    return re.sub(r"[^\w\- ]", "", text).replace(" ", "-")


@cache
def anchors(page: Path) -> frozenset[str]:
    """All anchors of a Markdown page; of equal headings the second has -1 at its end, and so on."""
    found: list[str] = []
    for heading in _HEADING.findall(_without_code(page.read_text("utf-8"))):
        name = slug(heading)
        found.append(name)
        if (before := found.count(name) - 1) > 0:
            found.append(f"{name}-{before}")
    return frozenset(found)


def sections(text: str) -> list[str]:
    """The numbers of a page's numbered headings, in order."""
    headings = _HEADING.findall(_without_code(text))
    return [match[1] for heading in headings if (match := _NUMBER.match(heading))]


def faults(root: Path) -> Iterator[str]:
    """Every fault below root, one line each."""
    equations = root / "docs" / "equations.md"
    if not equations.is_file():
        yield "docs/equations.md: not found"
        return
    numbers = sections(equations.read_text("utf-8"))
    for number in sorted({n for n in numbers if numbers.count(n) > 1}):
        yield f"docs/equations.md: section {number} is there twice"
    for path in files(root):
        text = path.read_text("utf-8")
        found = [*_citations(text, frozenset(numbers)), *_gone(path, text), *_pointers(path, text, root)]
        for place, what in sorted(found):
            yield f"{path.relative_to(root)}:{text.count(chr(10), 0, place) + 1}: {what}"


def files(root: Path) -> Iterator[Path]:
    """The text files of the project, this one and its test left out: they have to name what is looked for."""
    inside = [path for folder in FOLDERS for path in (root / folder).rglob("*")]
    for path in sorted([*root.iterdir(), *inside, root / "data" / "README.md", root / "reports" / "README.md"]):
        known = path.suffix in KINDS or path.name == "Makefile"
        if known and path.is_file() and path.stem.removeprefix("test_") != Path(__file__).stem:
            yield path


def _citations(text: str, numbers: frozenset[str]) -> Iterator[Fault]:
    for match in _CITATION.finditer(text):
        for number in re.findall(r"\d+(?:\.\d+)*", match[1]):
            if number not in numbers:
                yield match.start(), f"docs/equations.md has no section {number}"
    for match in _WRONG_FORM.finditer(text):
        yield match.start(), f"{match[0]!r}: cite it as `equations.md 4.6`"


def _gone(path: Path, text: str) -> Iterator[Fault]:
    """References to documents that are not here; in Python only in words, for a name may be spelled alike."""
    if not _GONE.search(text):
        return
    for place, words in _words(text) if path.suffix == ".py" else [(0, text)]:
        for match in _GONE.finditer(words):
            yield place + match.start(), f"{match[0]} is no document of this repository"


def _words(source: str) -> Iterator[tuple[int, str]]:
    """Comments and strings of Python source, each with its place; values put into a string are blanked."""
    begins = [0]
    for line in source.splitlines(keepends=True):
        begins.append(begins[-1] + len(line))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        name = tokenize.tok_name[token.type]
        if name in ("COMMENT", "STRING") or name.startswith("FSTRING"):
            words = re.sub(r"\{[^{}]*\}", lambda value: " " * len(value[0]), token.string)
            yield begins[token.start[0] - 1] + token.start[1], words


def _pointers(path: Path, text: str, root: Path) -> Iterator[Fault]:
    """Links and names of files in Markdown, of pages elsewhere. The changelog may name what is no more."""
    if path.suffix != ".md":
        pointers = [(match.start(), root, match[0]) for match in _PAGE.finditer(text)]
    else:
        plain = _without_code(text)
        pointers = [(match.start(), path.parent, match[1]) for match in _LINK.finditer(plain)]
        if path.name != "CHANGELOG.md":
            pointers += [(match.start(), root, match[1]) for match in _CODE.finditer(plain)]
    for place, folder, target in pointers:
        if what := _unresolved(path, folder, target):
            yield place, what


def _unresolved(path: Path, folder: Path, target: str) -> str:
    """Why a link cannot be followed; empty if it can, or leads out of the project."""
    if re.match(r"[a-z]+:", target):
        return ""
    name, _, anchor = target.partition("#")
    if "*" in name:
        return "" if any(folder.glob(name)) else f"no file is called {name}"
    goal = folder / name if name else path
    if goal.parent.name == "docs" and goal.name in WRITTEN:
        return ""
    if not goal.exists():
        return f"{target}: there is no {name}"
    if anchor and goal.suffix == ".md" and anchor not in anchors(goal):
        return f"{target}: {goal.name} has no heading #{anchor}"
    return ""


def _without_code(text: str) -> str:
    """Markdown with its fenced blocks blanked, every character in its place."""
    return _FENCE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def main(root: Path) -> int:
    """Print the faults; 1 if there are any."""
    found = list(faults(root))
    for fault in found:
        print(fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent))
