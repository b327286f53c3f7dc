"""Pages of the scenarios: what happens (figures), and the ledger of every published number and claim."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import pandas as pd
from markupsafe import Markup

from highd_lc.reporting import html, labels
from highd_lc.reporting.html import TO_REPORT
from highd_lc.reporting.pages_data import Column, Section, TableView, table_view
from highd_lc.vocab import names

PAGES: Final = (("index.html", "Scenarios"), ("ledger.html", "Ledger of published numbers"))
_VERDICT_WORDS: Final = {"holds": "holds", "fails": "fails", "unchanged": "no change", "no_plan": "no plan"}


@dataclass(frozen=True)
class Words:
    """What is said of a figure: title, caption, and what it shows for those who cannot see it."""

    title: str
    caption: str
    alternative: str


@dataclass(frozen=True)
class Picture:
    """A figure of a page: its name, its SVG, its PNG (in ``figures/`` beside the page), its words."""

    name: str
    svg: Markup
    png: bytes
    words: Words


def scenario_page(
    here: str, title: str, sections: Sequence[Section], *, lead: Sequence[str | Markup], back: bool
) -> str:
    """A page in the reports' look with the scenarios' own navigation.

    back: whether a report lies in the folder above.
    """
    context = {"root": "", "here": here, "title": title, "lead": lead, "sections": sections, "pages": PAGES}
    crosslink = TO_REPORT.link if back else TO_REPORT.room
    return html.render("overview.html", context | {"crosslink": crosslink})


def picture_section(
    picture: Picture, tables: Sequence[TableView] = (), folded: Sequence[TableView] = ()
) -> Section:
    """A section about one figure, with a link to its PNG."""
    link = Markup('<a href="figures/{}.png">PNG</a>').format(picture.name)
    return Section(
        picture.words.title,
        (),
        picture.svg,
        Markup("{} {}").format(picture.words.caption, link),
        tuple(tables),
        tuple(folded),
        anchor=picture.name,
    )


_LEDGER_COLUMNS: Final = (
    Column("what_unit", "Quantity"),
    Column("policy_label", "Policy"),
    Column("published", "Published", digits=2),
    Column("ours", "Ours", digits=2),
    Column("ratio", "Ratio", digits=3),
    Column("verdict", "Verdict"),
    Column("paper_literal", "Paper literal", digits=2),
    *(Column(a, f"Accounting {labels.ACCOUNTING_NAMES[a].lower()}", digits=2) for a in names.ACCOUNTINGS),
    Column("nearest", "Nearest", digits=2),
    Column("nearest_ratio", "Ratio", digits=3),
)
_PLACE_COLUMNS: Final = (
    Column("what_unit", "Quantity"),
    Column("policy_label", "Policy"),
    Column("published", "Published", digits=2),
    Column("nearest", "Nearest", digits=2),
    Column("nearest_cell", "in the cell (variant, form, accounting)"),
    Column("nearest_verdict", "Verdict"),
    Column("note", "Note"),
)
_TITLES: Final = {
    "1": "Scenario 1: ten followers, AV at 25 m/s",
    "2_15": "Scenario 2: a hundred followers, AV at 15 m/s",
    "2_20": "Scenario 2: a hundred followers, AV at 20 m/s",
    "3": "Scenario 3: the printed state of one recorded event",
}
QUANTITY_WORDS: Final = {
    **labels.QUANTITIES,
    "ttt_difference_s": "added total travel time",
    "hv1_v_min": "lowest speed of HV 1",
    "min_time_headway_s": "shortest time headway",
    "av_v_max": "peak speed of the AV",
    "flow_veh_h": "flow",
    "speed_km_h": "speed",
    "density_veh_km": "density",
    "rectangle_time_s": "time in the rectangle",
    "rectangle_distance_m": "distance in the rectangle",
}


def quantity_words(quantity: str) -> str:
    """A quantity as a reader says it; "column rank" becomes "... of HV rank"."""
    column, _, rank = quantity.partition(" ")
    words = QUANTITY_WORDS.get(column, column)
    return f"{words}, HV {rank}" if rank else words


def readable_ledger(ledger: pd.DataFrame) -> pd.DataFrame:
    """The ledger with words in place of names."""
    policy = ledger["policy"].map(labels.short_policy)
    weighted = ledger["key"].str.extract(r"@([0-9.]+):", expand=False)
    policy = policy.where(weighted.isna(), "omega_AV " + weighted.fillna(""))
    what = ledger["quantity"].map(quantity_words)
    unit = ledger["unit"].map(lambda text: f" [{text}]" if text else "")
    return ledger.assign(what_unit=what + unit, policy_label=policy)


def ledger_sections(ledger: pd.DataFrame) -> list[Section]:
    """One section a scenario; Table 1 behind a click."""
    readable = readable_ledger(ledger)
    sections = []
    for scenario, title in _TITLES.items():
        rows = readable[readable["scenario"] == scenario]
        cells = rows["quantity"].str.startswith("rectangle_")
        main = table_view(rows[~cells], _LEDGER_COLUMNS)
        folded = [table_view(rows[~cells], _PLACE_COLUMNS, "Where the nearest values stand; notes")]
        if cells.any():
            folded.append(table_view(rows[cells], _LEDGER_COLUMNS, "Table 1, vehicle by vehicle"))
        sections.append(Section(title, tables=(main,), folded=tuple(folded), anchor=f"scenario-{scenario}"))
    return sections


_CLAIM_COLUMNS: Final = (
    Column("words", "Claim"),
    Column("scenario_label", "Scenario"),
    Column("printed", "Printed"),
    *(
        Column(f"{form} {accounting}", f"{form.capitalize()}: {labels.ACCOUNTING_NAMES[accounting].lower()}")
        for form in names.FORMS
        for accounting in names.ACCOUNTINGS
    ),
)
_DETAIL_COLUMNS: Final = (
    Column("statement", "Claim"),
    Column("scenario_label", "Scenario"),
    Column("cell_label", "Form and accounting"),
    Column("default_label", "Default options"),
    Column("holds_text", "Holds under"),
    Column("fails_text", "Fails or nothing changes under"),
    Column("missing_text", "No plan under"),
)


def claims_section(claims: pd.DataFrame, *, title: str = "Claims", what: str = "variants") -> Section:
    """The claims by form and accounting: verdict under the default options, and in how many variants it holds.

    what: of what the cells are counted; a sweep's are too many to be listed.
    """
    labelled = claims.assign(
        words=claims["claim"].map(labels.CLAIMS),
        scenario_label=claims["scenario"].map(scenario_words),
        printed=claims["printed"].str.replace(" -> ", " → "),
        cell=[f"{r.form} {r.accounting}" for r in claims.itertuples()],
        cell_label=claims["form"].map(labels.FORMS)
        + ", "
        + claims["accounting"].map(labels.ACCOUNTING_NAMES).str.lower(),
        default_label=claims["default_verdict"].map(_VERDICT_WORDS),
        **{
            f"{name}_text": [", ".join(v) or "–" for v in claims[f"{column}_under"]]
            for name, column in (("holds", "holds"), ("fails", "fails"), ("missing", "no_plan"))
        },
    )
    labelled["verdict"] = [_verdict_text(row) for row in labelled.itertuples()]
    order = labelled["claim"].map({name: i for i, name in enumerate(labels.CLAIMS)})
    labelled = labelled.iloc[order.argsort(kind="stable")]
    index = ["claim", "scenario", "words", "scenario_label", "printed"]
    wide = labelled.pivot_table(index=index, columns="cell", values="verdict", aggfunc="first", sort=False)
    text = (
        f"Each cell (end speed: accounting): the verdict under the default options, then in how many of the "
        f"{what} the claim holds, of those that have both plans. “No change” means that both plans are the same, "
        "or differ by less than 0.1 %."
    )
    details = table_view(
        labelled,
        _DETAIL_COLUMNS,
        "The variants of the options (pipelines/scenarios.toml) under which each claim holds and fails",
    )
    return Section(
        title,
        (text,),
        tables=(table_view(wide.reset_index(), _CLAIM_COLUMNS),),
        folded=(details,) if what == "variants" else (),
        anchor=title.lower().replace(" ", "-"),
    )


def _verdict_text(row: Any) -> str:
    verdict, holds, cells = row.default_verdict, row.holds, row.cells
    counted = f" {holds}/{cells}" if cells > 1 else ""
    return f"{_VERDICT_WORDS[verdict]}{counted}"


def scenario_words(key: str) -> str:
    """A scenario's key as a reader says it: "2_15" is "2, AV 15 m/s"."""
    number, _, speed = key.partition("_")
    return f"{number}, AV {speed} m/s" if speed else number


def arithmetic_section(rows: pd.DataFrame) -> Section:
    """The paper's numbers against each other."""
    columns = (
        Column("key", "About"),
        Column("statement", "Statement"),
        Column("computation", "Computation"),
        Column("printed", "Printed", digits=3),
        Column("computed", "Computed", digits=3),
        Column("unit", "Unit"),
        Column("verdict", "Verdict"),
    )
    odd = rows["verdict"] == "inconsistent"
    return Section(
        "Arithmetic of the printed numbers",
        (f"{int(odd.sum())} statements do not hold, {int((~odd).sum())} do.",),
        tables=(table_view(rows[odd], columns, "Inconsistent"),),
        folded=(table_view(rows[~odd], columns, f"Consistent: {int((~odd).sum())} statements"),),
        anchor="arithmetic",
    )


def ledger_markdown(
    ledger: pd.DataFrame,
    claims: pd.DataFrame,
    *,
    arithmetic: pd.DataFrame,
    lead: Sequence[str] = (),
    swept: pd.DataFrame | None = None,
) -> str:
    """The ledger as a text with tables, for the documentation; Table 1 is left to the page.

    lead: paragraphs at the begin; swept: rows of ``sweep_claims``, None without a sweep.
    """
    readable = readable_ledger(ledger)
    short = readable[~readable["quantity"].str.startswith("rectangle_")]
    begin = "\n".join(f"{text}\n" for text in (_MARKDOWN_HEAD, *lead))
    parts = [begin, _ledger_table(short), _MARKDOWN_CLAIMS, _claims_table(claims)]
    if swept is not None:
        parts += [_MARKDOWN_SWEEP, _claims_table(swept)]
    parts.append(_MARKDOWN_ARITHMETIC)
    odd = arithmetic[arithmetic["verdict"] == "inconsistent"]
    told = odd["computation"].str.replace("|", "\\|", regex=False)
    lines = [
        f"| {statement} | {computation} | {html.number(printed)} |"
        for statement, computation, printed in zip(odd["statement"], told, odd["printed"], strict=True)
    ]
    return "\n".join([*parts, "| statement | computation | printed |", "|---|---|---|", *lines, ""])


_MARKDOWN_HEAD: Final = """# Published numbers of the scenarios, and ours

Written by `highd-lc scenarios`, as `ledger.md` beside its pages. The ledger in full, with Table 1 vehicle by
vehicle, paper_literal and every accounting, is `ledger.html` and `ledger.parquet`; every cell with all of its
options is in `scenario_cells.parquet`. *Ours* is the default of `pipelines/scenarios.toml`, *nearest* the best of
all cells looked at.
"""
_MARKDOWN_CLAIMS: Final = """
## Claims

Verdict under the default options, and in how many variants of the options the claim holds, of those with both
plans.
"""
_MARKDOWN_SWEEP: Final = """
## Claims over the sweep

The same over every combination of the options that `--sweep` varies.
"""
_MARKDOWN_ARITHMETIC: Final = """
## Printed numbers that contradict each other
"""


def _ledger_table(readable: pd.DataFrame) -> str:
    rows: Iterable[Any] = readable.itertuples()
    head = "| scenario | quantity | policy | published | ours | ratio | verdict | nearest | in the cell |"
    lines = [
        f"| {scenario_words(r.scenario)} | {r.what_unit} | {r.policy_label} "
        f"| {html.number(r.published)} | {html.number(r.ours)} | {html.number(r.ratio)} | {r.verdict} "
        f"| {html.number(r.nearest)} | {r.nearest_cell} |"
        for r in rows
    ]
    return "\n".join([head, "|---|---|---|---|---|---|---|---|---|", *lines])


def _claims_table(claims: pd.DataFrame) -> str:
    section = claims_section(claims)
    table = section.tables[0]
    head = "| " + " | ".join(column.title for column in table.columns) + " |"
    rule = "|" + "---|" * len(table.columns)
    return "\n".join([head, rule, *("| " + " | ".join(map(str, row)) + " |" for row in table.rows)])


def claim_counts(claims: pd.DataFrame) -> str:
    """How many claims hold, fail or change nothing under the default options, as a phrase."""
    counts = claims["default_verdict"].value_counts()
    phrases = {"holds": "hold", "fails": "fail", "unchanged": "show no change", "no_plan": "have no plan"}
    return ", ".join(f"{counts[word]} {text}" for word, text in phrases.items() if word in counts)
