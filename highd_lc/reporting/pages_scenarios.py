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
from highd_lc.vocab.published import CHANGE, COMPARISONS, DIFFERENCE, LEAST, MOST, TABLE_3
from highd_lc.vocab.tables.scenarios import NEAR, NEAR_WITHIN, NOT_VALID, REPRODUCED

PAGES: Final = (("index.html", "Scenarios"), ("ledger.html", "Ledger of published numbers"))
_VERDICT_WORDS: Final = {
    "holds": "holds",
    "fails": "fails",
    "unchanged": "no change",
    "no_plan": "no plan",
    "not_valid": "not valid",
}


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
    Column("not_valid", "Default cell not valid"),
    Column("note", "Note"),
)
_TITLES: Final = {
    "1": "Scenario 1: ten followers, AV at 25 m/s",
    "2_15": "Scenario 2: a hundred followers, AV at 15 m/s",
    "2_20": "Scenario 2: a hundred followers, AV at 20 m/s",
    "3": "Scenario 3: the printed state of one recorded event",
    TABLE_3: "Table 3: drivers fitted to recordings",
}
QUANTITY_WORDS: Final = {
    **labels.QUANTITIES,
    "ttt_difference_s": "added total travel time",
    "hv1_v_min": "lowest speed of HV 1",
    "min_time_headway_s": "shortest time headway",
    "av_v_max": "peak speed of the AV",
    "av_vy_max": "peak lateral speed",
    "hv_v_min": "lowest speed of the followers",
    "paper_j": "objective of the calibration",
    "flow_veh_h": "flow",
    "speed_km_h": "speed",
    "density_veh_km": "density",
    "rectangle_time_s": "time in the rectangle",
    "rectangle_distance_m": "distance in the rectangle",
}
_COMPARED: Final = {
    CHANGE: "relative change of",
    DIFFERENCE: "difference in",
    LEAST: "smallest rise of the",
    MOST: "largest rise of the",
}


def quantity_words(quantity: str) -> str:
    """A quantity as a reader says it; "column rank" becomes "... of HV rank", "change column" "change of ..."."""
    column, _, rank = quantity.partition(" ")
    if column in _COMPARED:
        return f"{_COMPARED[column]} {QUANTITY_WORDS.get(rank, rank)}"
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
    """What does reproduce, then one section a scenario; Table 1 behind a click."""
    readable = readable_ledger(ledger)
    sections = [_reproduced_section(readable)]
    for scenario, title in _TITLES.items():
        rows = readable[readable["scenario"] == scenario]
        cells = rows["quantity"].str.startswith("rectangle_")
        main = table_view(rows[~cells], _LEDGER_COLUMNS)
        folded = [table_view(rows[~cells], _PLACE_COLUMNS, "Where the nearest values stand; notes")]
        if cells.any():
            folded.append(table_view(rows[cells], _LEDGER_COLUMNS, "Table 1, vehicle by vehicle"))
        sections.append(Section(title, tables=(main,), folded=tuple(folded), anchor=f"scenario-{scenario}"))
    return sections


def reproduced(ledger: pd.DataFrame) -> pd.DataFrame:
    """The numbers that come out under the default options: comparisons first, each group in the paper's order.

    Numbers of plans that are not valid, because they lie on a bound, are included; their verdict says why.
    """
    rows = ledger[_comes_out(ledger)]
    doubt = rows["verdict"] == NOT_VALID
    told = rows["verdict"].where(~doubt, rows["verdict"] + ": " + rows["not_valid"])
    return rows.assign(verdict=told).iloc[(~_compared(rows)).argsort(kind="stable")]


def _comes_out(ledger: pd.DataFrame) -> pd.Series:
    return ledger["verdict"].isin([REPRODUCED, NEAR]) | (
        (ledger["verdict"] == NOT_VALID) & ((ledger["ratio"] - 1.0).abs() <= NEAR_WITHIN)
    )


def _compared(ledger: pd.DataFrame) -> pd.Series:
    return ledger["quantity"].str.split(" ").str[0].isin(COMPARISONS)


def reproduced_words(ledger: pd.DataFrame) -> str:
    """What the paper says of the gain beside ours, and how many numbers come out under the default options."""
    first = ledger[ledger["quantity"].isin([f"{CHANGE} loss_hv", f"{CHANGE} loss_total"])].head(2)
    found: Iterable[Any] = first.dropna(subset="ours").itertuples()
    pairs = [
        f"{quantity_words(row.quantity.partition(' ')[2])} {row.ours:+.1f} % (printed {row.published:+.1f} %)"
        for row in found
    ]
    doubts = sorted(set(first.loc[first["verdict"] == NOT_VALID, "not_valid"]))
    doubt = f"; not valid, for {' and '.join(doubts)} in one of the plans" if doubts else ""
    begin = f"From benchmark to local optimum, scenario 1: {', '.join(pairs)}{doubt}. " if pairs else ""
    counted = [
        f"of {len(rows)} {text} {int(_comes_out(rows).sum())} come out within 10 %, "
        f"{int(rows['verdict'].isin([REPRODUCED, NEAR]).sum())} of them by valid plans"
        for text, rows in (
            ("comparisons of local optimum and benchmark", ledger[_compared(ledger)]),
            ("levels", ledger[~_compared(ledger)]),
        )
    ]
    return f"{begin}Under the default options, with a platoon in equilibrium, {'; '.join(counted)}."


def _reproduced_section(readable: pd.DataFrame) -> Section:
    rows = reproduced(readable)
    columns = (Column("scenario_label", "Scenario"), *_LEDGER_COLUMNS[:6])
    labelled = rows.assign(scenario_label=rows["scenario"].map(labels.scenario))
    return Section(
        "What does reproduce",
        (reproduced_words(readable),),
        tables=(table_view(labelled, columns),),
        anchor="reproduced",
    )


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
    Column("no_plan_text", "No plan under"),
    Column("not_valid_text", "Not valid under"),
)


def claims_section(claims: pd.DataFrame, *, title: str = "Claims", what: str = "variants") -> Section:
    """The claims by form and accounting: verdict under the default options, and in how many variants it holds.

    what: the unit that each cell counts. Only variants are listed one by one: a sweep's cells are too many.
    """
    labelled = claims.assign(
        words=claims["claim"].map(labels.CLAIMS),
        scenario_label=claims["scenario"].map(labels.scenario),
        printed=claims["printed"].str.replace(" -> ", " → "),
        cell=[f"{r.form} {r.accounting}" for r in claims.itertuples()],
        cell_label=claims["form"].map(labels.FORMS)
        + ", "
        + claims["accounting"].map(labels.ACCOUNTING_NAMES).str.lower(),
        default_label=claims["default_verdict"].map(_VERDICT_WORDS),
        **{
            f"{verdict}_text": [", ".join(v) or "–" for v in claims[f"{verdict}_under"]]
            for verdict in ("holds", "fails", "no_plan", "not_valid")
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
        "or differ by less than 0.1 %. “Not valid”: a plan drives into somebody, or sits on a bound of T or of "
        "the speed; it counts for no claim."
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
    counted = f" {row.holds}/{row.cells}" if row.cells > 1 else ""
    return f"{_VERDICT_WORDS[row.default_verdict]}{counted}"


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
    parts = [f"{text}\n" for text in (_MARKDOWN_HEAD, *lead)]
    parts += ["## What does reproduce\n", f"{reproduced_words(readable)}\n", _ledger_table(reproduced(short))]
    parts += ["\n## Every number\n", _ledger_table(short)]
    for head, judged in ((_MARKDOWN_CLAIMS, claims), (_MARKDOWN_SWEEP, swept)):
        if judged is not None:
            parts += [head, _claims_table(judged)]
    parts.append("\n## Printed numbers that contradict each other\n")
    odd = arithmetic[arithmetic["verdict"] == "inconsistent"]
    told = odd.assign(computation=odd["computation"].str.replace("|", "\\|", regex=False))
    columns = (
        Column("statement", "statement"),
        Column("computation", "computation"),
        Column("printed", "printed", digits=2),
    )
    return "\n".join([*parts, _markdown(columns, told), ""])


_MARKDOWN_HEAD: Final = """# Published numbers of the scenarios, and ours

Written by `highd-lc scenarios`, as `ledger.md` beside its pages. The ledger in full, with Table 1 vehicle by
vehicle, paper_literal and every accounting, is `ledger.html` and `ledger.parquet`; every cell with all of its
options is in `scenario_cells.parquet`. *Ours* is the default of `pipelines/scenarios.toml`, *nearest* the best of
all cells looked at.
"""
_MARKDOWN_CLAIMS: Final = """
## Claims

Verdict under the default options, and in how many variants of the options the claim holds, of those with both
plans. *Not valid*: a plan drives into somebody, or sits on a bound of T or of the speed.
"""
_MARKDOWN_SWEEP: Final = """
## Claims over the sweep

The same over every combination of the options that `--sweep` varies.
"""
_MARKDOWN_COLUMNS: Final = (
    Column("scenario_label", "scenario"),
    Column("what_unit", "quantity"),
    Column("policy_label", "policy"),
    *(Column(name, name, digits=2) for name in ("published", "ours", "ratio")),
    Column("verdict", "verdict"),
    Column("nearest", "nearest", digits=2),
    Column("nearest_cell", "in the cell"),
)


def _ledger_table(readable: pd.DataFrame) -> str:
    return _markdown(_MARKDOWN_COLUMNS, readable.assign(scenario_label=readable["scenario"].map(labels.scenario)))


def _claims_table(claims: pd.DataFrame) -> str:
    table = claims_section(claims).tables[0]
    return _markdown(table.columns, pd.DataFrame(table.rows, columns=[column.name for column in table.columns]))


def _markdown(columns: Sequence[Column], frame: pd.DataFrame) -> str:
    cells = [
        [html.number(v, c.digits) if c.digits is not None else str(v) for v in frame[c.name]] for c in columns
    ]
    lines = ["| " + " | ".join(row) + " |" for row in ([c.title for c in columns], *zip(*cells, strict=True))]
    return "\n".join([lines[0], "|" + "---|" * len(columns), *lines[1:]])


def claim_counts(claims: pd.DataFrame) -> str:
    """How many claims hold, fail or change nothing under the default options, as a phrase."""
    counts = claims["default_verdict"].value_counts()
    phrases = {
        "holds": "hold",
        "fails": "fail",
        "unchanged": "show no change",
        "no_plan": "have no plan",
        "not_valid": "are not valid",
    }
    return ", ".join(f"{counts[word]} {text}" for word, text in phrases.items() if word in counts)
