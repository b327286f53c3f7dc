"""Pages from templates: one environment, styles and scripts inlined, every text from data escaped.

A page is one file that asks for nothing: no address outside it is ever loaded, which its content security policy
also forbids.

The links between a report and the scenarios beside it, either of which may be made first, or alone.

Every page is written with room for the link, which a reader does not see. Whoever is made second turns the room
into the link, on its own pages and on those that it finds: the result does not depend on the order.
"""

import io
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

from markupsafe import Markup

from highd_lc.reporting import labels

if TYPE_CHECKING:
    from jinja2 import Environment, Template
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Crosslink:
    """A link in the navigation to pages that another command makes. href: relative to the page."""

    href: str
    title: str

    @property
    def room(self) -> Markup:
        """What stands on a page as long as there is nothing to lead to."""
        return Markup("<!-- room for {} -->").format(self.href)

    @property
    def link(self) -> Markup:
        """What stands there afterwards."""
        return Markup('<a href="{}">{}</a>').format(self.href, self.title)

    def opened(self, page: bytes) -> bytes:
        """A page with the link in its room; as it is where it has none."""
        return page.replace(self.room.encode(), self.link.encode())


TO_SCENARIOS: Final = Crosslink("scenarios/index.html", "Scenarios")
"""From the overview pages of a report."""
TO_REPORT: Final = Crosslink("../index.html", "Report of the recordings")
"""From the pages of the scenarios."""


_NO_METADATA: Final = dict.fromkeys(("Date", "Creator", "Format", "Type"))
_MISSING: Final = "–"
# Formats made beforehand: there are 800 numbers on an event's page.
_FIXED: Final = tuple(f"%.{digits}f" for digits in range(12))
_NEXT_CELL: Final = '</td><td class="n">'
_BETWEEN: Final = "\n"
_SCRIPT_ESCAPES: Final = {
    ord("<"): "\\u003c",
    ord(">"): "\\u003e",
    ord("&"): "\\u0026",
    0x2028: "\\u2028",
    0x2029: "\\u2029",
}

PAGES: Final = (
    ("index.html", "Events"),
    ("summary.html", "Summary"),
    ("prediction.html", "Followers"),
    ("matrix.html", "Validation matrix"),
    ("studies.html", "Robustness"),
    ("multiverse.html", "Multiverse"),
    ("closed_loop.html", "Closed loop"),
    ("start.html", "Start"),
    ("calibration.html", "Calibration"),
    ("data.html", "Data"),
    ("excluded.html", "Excluded"),
    ("dictionary.html", "Data dictionary"),
)
"""The pages of a report beside those of the events: file name and title."""


def render(template: str, context: Mapping[str, Any]) -> str:
    """A page from a template of this package and its context."""
    return _template(template).render(context)


def without(page: str, missing: Iterable[str]) -> str:
    """A page that does not lead to these files of ``PAGES``, which are not made: in its text the words stay."""
    for file in missing:
        link = rf'<a href="(\.\./)?{re.escape(file)}"'
        page = re.sub(rf"^{link}.*\n", "", page, flags=re.MULTILINE)
        page = re.sub(rf"{link}[^>]*>(.*?)</a>", r"\2", page, flags=re.DOTALL)
    return page


@cache
def _template(name: str) -> "Template":
    return _environment().get_template(name)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("highd_lc.reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=number, percent=percent, json=json_script, role=labels.role)
    environment.globals.update(style=style, script=script, labels=labels)
    environment.globals.update(pages=PAGES, crosslink=TO_SCENARIOS.room)
    return environment


def number(value: Any, digits: int = 2) -> str:
    """A number with a fixed number of decimals and a true minus sign; a dash where there is none."""
    try:
        text: str = _FIXED[digits] % value
    except TypeError:  # None, NA
        return _MISSING
    if text[-1] in "nf":  # nan, inf
        return _MISSING
    if text[0] != "-":
        return text
    return f"−{text[1:]}" if text.strip("-0.") else text[1:]


def percent(value: Any, digits: int = 2) -> str:
    """A share as percent, without its sign; a dash where there is none."""
    return _MISSING if is_missing(value) else f"{number(100 * float(value), digits)} %"


def cells(values: Iterable[Any], digits: int | None = None) -> str:
    """Table cells of numbers, or of (number, digits) pairs: HTML for a text that is put together from many."""
    if digits is None:
        pairs = list(values)
        found, places = tuple([value for value, _ in pairs]), tuple([places for _, places in pairs])
    else:
        found = tuple(values)
        places = (digits,) * len(found)
    return f'<td class="n">{_NEXT_CELL.join(_numbers(found, places))}</td>' if found else ""


def _numbers(values: tuple[Any, ...], places: tuple[int, ...]) -> list[str]:
    """``number`` of each value: all in one go, then again those with a sign, or without a number."""
    try:
        texts = (_together(places) % values).split(_BETWEEN)
    except TypeError:  # None, NA
        return [number(value, digits) for value, digits in zip(values, places, strict=True)]
    for k, text in enumerate(texts):
        if text[0] == "-" or text[-1] in "nf":
            texts[k] = number(values[k], places[k])
    return texts


@cache
def _together(places: tuple[int, ...]) -> str:
    return _BETWEEN.join(_FIXED[digits] for digits in places)


@cache
def policy_head(policy: str) -> Markup:
    """The head of a policy's row in a table: its colour and its label, escaped once for all pages."""
    text = '<th scope="row"><span class="key" style="background: {}"></span>{}</th>'
    return Markup(text).format(labels.css_colour(policy), labels.look(policy).label)


def bars(shares: Iterable[tuple[str, float]]) -> str:
    """Stacked bars of (kind, share in percent), as ``cells``."""
    return "".join([f'<span style="width: {share}%; background: var(--{kind})"></span>' for kind, share in shares])


def begun(text: str) -> str:
    """A text with a capital at its begin; what comes after it stays."""
    return text[:1].upper() + text[1:]


def is_missing(value: Any) -> bool:
    """Whether a cell holds nothing: None, NA or not a finite number."""
    try:
        return not math.isfinite(value)
    except TypeError:
        return True


def json_script(value: Any) -> Markup:
    """A value as JSON that cannot leave the script element it stands in. NaN is refused."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    return Markup(text.translate(_SCRIPT_ESCAPES))


@cache
def style(*names: str) -> Markup:
    """The colours of the policies and the style sheets of these names, as one text."""
    colours = "".join(f"--policy-{p}: light-dark({k.light}, {k.dark});" for p, k in labels.POLICIES.items())
    colours += "".join(
        f"--other-{k}: light-dark({light}, {dark});" for k, (light, dark) in enumerate(labels.OTHERS)
    )
    sheets = "\n".join(_asset(f"{name}.css") for name in names)
    return Markup(f":root {{ {colours} }}\n{sheets}")


@cache
def script(*names: str) -> Markup:
    """The scripts of these names, as one text."""
    return Markup("\n".join(_asset(f"{name}.js") for name in names))


def _asset(name: str) -> str:
    return (files("highd_lc.reporting") / "assets" / name).read_text(encoding="utf-8")


def inline_svg(figure: "Figure", alternative: str) -> Markup:
    """A matplotlib figure as SVG inside a page, in the page's font and colours; its ground is clear.

    alternative: what the figure shows, in words.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    sink, canvas = io.StringIO(), FigureCanvasSVG(figure)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "highd_lc"}):
        _lay_out(figure)
        for ground in (figure.patch, *(axes.patch for axes in figure.axes)):
            ground.set(facecolor="none", edgecolor="none")
        canvas.print_svg(sink, metadata=_NO_METADATA)
    text = sink.getvalue()
    text = text[text.index("<svg") :]
    for colour, variable in _theme_colours().items():
        text = text.replace(colour, variable)
    width = round(96 * figure.get_figwidth())  # which a small screen takes less of than its own width
    head = Markup('<svg role="img" style="--width: {}px" aria-label="{}" ').format(width, alternative)
    return Markup(text.replace("<svg ", str(head), 1))


def _lay_out(figure: "Figure") -> None:
    """Place a figure's axes once and for all: ``savefig`` would draw everything for it, only to draw it again."""
    engine, dpi = figure.get_layout_engine(), figure.dpi
    if engine is not None:
        figure.dpi = 72  # which the format is made for, whatever is asked for
        engine.execute(figure)
        figure.set_layout_engine("none")
        figure.dpi = dpi  # that of images inside


@cache
def _theme_colours() -> dict[str, str]:
    """Colours of figures as matplotlib writes them, and what takes their place on a page with two themes."""
    from highd_lc.reporting import drawing

    policies = {look.light.lower(): f"var(--policy-{policy})" for policy, look in labels.POLICIES.items()}
    parts = {colour.lower(): f"var(--{name.replace('_', '-')})" for name, _, colour in labels.LOSS_PARTS}
    return (
        policies
        | parts
        | {drawing.INK: "currentColor", drawing.QUIET: "var(--quiet)", drawing.LINE: "var(--line)"}
        | {drawing.GROUND: "var(--ground)"}
    )
