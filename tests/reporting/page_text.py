"""What a page says, read from its HTML."""

import html as escapes
import re


def rows_of(page: str, *, after: str = "<body") -> list[list[str]]:
    """All table rows behind a place of the page, as texts of their cells."""
    rows = re.findall(r"<tr>(.*?)</tr>", page[page.index(after) :], flags=re.DOTALL)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, flags=re.DOTALL) for row in rows]
    return [[escapes.unescape(re.sub(r"<[^>]+>", "", cell)) for cell in row] for row in cells]
