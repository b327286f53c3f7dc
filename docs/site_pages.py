"""What the documentation site has beside the pages of this folder: called by mkdocs, see mkdocs.yml.

Pages that lie elsewhere in the repository become pages of the site; links to other files of the repository lead to
copies. The data dictionary, the list of commands and the notebooks are written from what they describe.
"""

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jupytext
from mkdocs.structure.files import File, Files
from typer.main import get_command

from highd_lc import cli
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.columns import Column, Table

ROOT = Path(__file__).resolve().parents[1]
ELSEWHERE = {
    "README.md": "index.md",
    "NOMENCLATURE.md": "nomenclature.md",
    "data/README.md": "highd.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
"""Pages of the repository, and what they are called on the site."""
_LINK = re.compile(r"(?<=\]\()([^)\s#:]+)(?=[#)])")
_FENCED = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)
_LIST = re.compile(r"^((?![-*|#>\s]|\d+\.).*[^\n])\n(?=- |\d+\. )", re.MULTILINE)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are written or lie elsewhere, and the files that pages link to."""
    written = {"dictionary.md": dictionary(), "commands.md": commands(), **notebooks()}
    for name, text in written.items():
        files.append(File.generated(config, name, content=text))
    for source, name in ELSEWHERE.items():
        files.append(File.generated(config, name, abs_src_path=str(ROOT / source)))
    for target in sorted(linked(files)):
        files.append(File.generated(config, f"repository/{target}", abs_src_path=str(ROOT / target)))
    return files


def linked(files: Files) -> set[str]:
    """Files of the repository outside the site that its pages link to."""
    found = set()
    for file in files.documentation_pages():
        for link in _LINK.findall(_FENCED.sub("", file.content_string)):
            target = posixpath.normpath(posixpath.join(posixpath.dirname(_home(file.src_uri)), link))
            if not target.startswith("docs/") and target not in ELSEWHERE and (ROOT / target).is_file():
                found.add(target)
    return found


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead links to where things lie on the site, and part lists from the sentence before them."""
    here = page.file.src_uri

    def lead(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(_home(here)), match[1]))
        return posixpath.relpath(_place(target), posixpath.dirname(here) or ".")

    parts = _FENCED.split(markdown)
    return "".join(
        part if number % 2 else _LIST.sub(r"\1\n\n", _LINK.sub(lead, part)) for number, part in enumerate(parts)
    )


def _home(name: str) -> str:
    """Where a page of the site lies in the repository."""
    return next((source for source, page in ELSEWHERE.items() if page == name), f"docs/{name}")


def _place(target: str) -> str:
    """Where a file of the repository lies on the site."""
    if target in ELSEWHERE:
        return ELSEWHERE[target]
    if target == "docs/example":
        return "example/event.html"
    if target.startswith("docs/"):
        name = target.removeprefix("docs/")
        return re.sub(r"^(notebooks/\w+)\.py$", r"\1.md", name)
    return f"repository/{target}"


def notebooks() -> dict[str, str]:
    """The notebooks as pages."""
    return {
        f"notebooks/{path.stem}.md": jupytext.writes(jupytext.read(path), fmt="md:markdown").split("---\n", 2)[-1]
        for path in sorted((ROOT / "docs" / "notebooks").glob("*.py"))
    }


def dictionary() -> str:
    """Every table with its columns, from the schemas that artefacts are checked against."""
    lead = (
        "# Tables and columns\n\nEvery artefact below the work folder is a parquet file with these columns, "
        "checked when it is written and when it is read. *null*: the value may be missing. Sections are those of "
        "[equations.md](equations.md).\n"
    )
    return "\n".join([lead, *(line for name in sorted(TABLES) for line in _table(TABLES[name]))])


def _table(table: Table) -> Iterator[str]:
    yield f"## {table.name}\n\nOne row a {table.row}, ordered by {', '.join(table.order)}.\n"
    yield "| column | type | unit | | meaning |\n|---|---|---|---|---|"
    for column in table.columns:
        cells = (f"`{column.name}`", column.kind, column.unit, "null" * column.nullable, _meaning(column))
        yield f"| {' | '.join(_plain(cell) for cell in cells)} |"
    yield ""


def _meaning(column: Column) -> str:
    words = f": {', '.join(f'`{word or chr(0x2205)}`' for word in column.allowed)}" if column.allowed else ""
    return f"{column.meaning}{words}"


def _plain(cell: str) -> str:
    return cell.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def commands() -> str:
    """Every command with its options, from the command line itself."""
    group: Any = get_command(cli.app)
    lines = ["# Commands\n\n`highd-lc COMMAND --help` says the same. `--debug`, `--version`: before a command.\n"]
    for name, command in group.commands.items():
        lines.append(f"## highd-lc {name}\n\n{command.help}\n\n| | |\n|---|---|")
        for parameter in command.params:
            if parameter.name != "help":
                names = ", ".join(f"`{word}`" for word in getattr(parameter, "opts", [])) or f"`{parameter.name}`"
                lines.append(f"| {names} | {_plain(getattr(parameter, 'help', '') or '')} |")
        lines.append("")
    return "\n".join(lines)
