"""The numbers in README and docs/results.md that depend on a run or a machine, written from work folders.

    python docs/write_results.py                        render what docs/results.json holds into the pages
    python docs/write_results.py --check                exit with 1 if the pages say something else
    python docs/write_results.py --run demo=WORK ...    read the numbers of finished runs first
    python docs/write_results.py --example WORK REPORTS    copy the pages in docs/example from a finished run

Runs: demo, us101 (gains, price of safety), mixture, idm, lcm (prediction), planners (other people's planners);
docs/results.json has the command that makes each one's work folder. Each table stands between
``<!-- table NAME: written by docs/write_results.py -->`` and ``<!-- end -->``.
"""

import argparse
import json
import math
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from highd_lc.io import artefacts
from highd_lc.io.workspace import code_version
from highd_lc.reporting.drawing import panels
from highd_lc.reporting.follower_words import LOSS_COLUMNS, effects_of
from highd_lc.vocab import names

DOCS = Path(__file__).resolve().parent
STORE = DOCS / "results.json"
PAGES = (DOCS.parent / "README.md", DOCS / "results.md", DOCS / "planners.md")
PICTURE = DOCS / "example" / "finding.png"
_TABLE = re.compile(r"(<!-- table (\w+): [^>]*-->\n).*?(<!-- end -->)", re.DOTALL)
_MODELS = {names.POPULATION: "`population`", names.OWN_FIT: "`own_fit`", names.IDM: "`idm`, fitted"}
_FORMS = {
    "fixed": "fixed end speed",
    "free": "free end speed",
    "start": "fixed end speed, start chosen",
    "free_start": "free end speed, start chosen",
    "robust": "fixed end speed, robust",
    "robust_free": "free end speed, robust",
}
_GAINS = (
    ("demo", names.POPULATION),
    ("demo", names.OWN_FIT),
    ("us101", names.POPULATION),
    ("us101", names.OWN_FIT),
)
Store = dict[str, dict[str, Any]]


def read_run(work: Path) -> dict[str, Any]:
    """What the pages say of a finished run; of one up to calibrate, how followers are predicted."""
    found: dict[str, Any] = {"code": code_version(), "seconds": _seconds(work)}
    readers = {
        "skill": (_skill, "prediction_summary"),
        "gain": (_gain, "validation_matrix"),
        "ratio": (_ratio, "losses"),
        "price": (_price, "safety_price"),
        "planners": (_planners, "leaderboard"),
    }
    for name, (reader, table_) in readers.items():
        if artefacts.path_of(work, table_).is_file():
            found[name] = reader(work)
    return found


def _seconds(work: Path) -> dict[str, float]:
    """Of each stage the longest time in the log: later runs skip what is up to date."""
    found: dict[str, float] = {}
    for line in (work / "run.log").read_text("utf-8").splitlines():
        entry = json.loads(line)
        if "seconds" in entry:
            found[entry["stage"]] = max(entry["seconds"], found.get(entry["stage"], 0.0))
    return found


def _skill(work: Path) -> dict[str, Any]:
    table = artefacts.read(work, "prediction_summary")
    rows = table[(table["stratum"] == "all") & table["model"].isin(_MODELS)].to_dict("records")
    columns = ("n_events", "bias", "peak_decel_simulated", "peak_decel_recorded", "skill_naive", "skill_constant")
    limits = ("skill_constant_low", "skill_constant_high")
    return {
        f"{row['model']} {row['horizon_s']:g}": {c: _kept(row[c]) for c in (*columns, *limits)} for row in rows
    }


def _gain(work: Path) -> dict[str, Any]:
    table = artefacts.read(work, "validation_matrix")
    rows = table[table["stratum"] == "all"].to_dict("records")
    columns = ("n_events", "infeasible", "gain", "gain_low", "gain_high")
    return {f"{r['followers']} {r['form']} {r['accounting']}": {c: _kept(r[c]) for c in columns} for r in rows}


def _ratio(work: Path) -> dict[str, Any]:
    keys = ["event_id", "followers", "policy", "accounting"]
    losses = artefacts.read(work, "losses", columns=[*keys, *LOSS_COLUMNS])
    effects = effects_of(losses[losses["followers"] == names.POPULATION])
    return {e.form: {"ratio": _kept(e.ratio), "events": e.n} for e in effects}


def _price(work: Path) -> list[dict[str, Any]]:
    table = artefacts.read(work, "safety_price")
    rows = table[table["accounting"] == names.PRIMARY_ACCOUNTING]
    columns = ["form", "safety", "n_both", "n_events", "gain", "gain_incremental"]
    return [{k: _kept(v) for k, v in row.items()} for row in rows[columns].to_dict("records")]


def _planners(work: Path) -> list[dict[str, Any]]:
    board = artefacts.read(work, "leaderboard")
    columns = ["policy", "n_planned", "n_contacts", "n_violating", "loss_av", "loss_hv", "loss_total"]
    return [{k: _kept(v) for k, v in row.items()} for row in board[columns].to_dict("records")]


def _kept(value: Any) -> Any:
    """A value as it is kept: numbers with more digits than any page shows, None where there is none."""
    if isinstance(value, str):
        return value
    return None if pd.isna(value) or math.isinf(value) else round(float(value), 6)


def finding(store: Store) -> Iterator[str]:
    """The results in short: error over effect beside the gain."""
    yield (
        "| | events | error over effect, fixed / free end speed | gain `equal`, fixed | free | "
        "gain `paper`, fixed |"
    )
    yield "|---|---|---|---|---|---|"
    for name in ("demo", "us101"):
        run = store[name]
        cells = [run["gain"].get(f"population {cell}") for cell in ("fixed equal", "free equal", "fixed paper")]
        ratios = " / ".join(_times(run["ratio"].get(form)) for form in names.FORMS)
        events = f"{cells[0]['n_events']:.0f}, {cells[0]['infeasible']:.0f} without a plan"
        yield f"| {run['title']} | {events} | {ratios} | {' | '.join(_interval(cell) for cell in cells)} |"


def skill(store: Store) -> Iterator[str]:
    """How well the first follower is predicted."""
    yield (
        "| recordings | events 5 s (8 s) | model | skill 5 s | skill 8 s | against the best naive, 5 s / 8 s | "
        "bias 5 s / 8 s [m/s] | braking [m/s²] |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for name in ("mixture", "idm", "lcm", "us101"):
        for place, (model, title) in enumerate(_MODELS.items()):
            short, long = (store[name]["skill"].get(f"{model} {h}", {}) for h in (5, 8))
            about = f"{store[name]['title']} | {_whole(short)} ({_whole(long)})" if place == 0 else " | "
            both = [f"{_two(short.get(c))} / {_two(long.get(c))}" for c in ("skill_naive", "bias")]
            braking = f"{_two(short.get('peak_decel_simulated'))} / {_two(short.get('peak_decel_recorded'))}"
            yield f"| {about} | {title} | {_skilled(short)} | {_skilled(long)} | {' | '.join(both)} | {braking} |"


def gain(store: Store) -> Iterator[str]:
    """Gain of the local optimum over the benchmark by form, accounting, run and follower model."""
    heads = [f"{store[run]['title']}, `{model}`" for run, model in _GAINS]
    yield f"| form | accounting | {' | '.join(heads)} |"
    yield f"|---|---|{'---|' * len(heads)}"
    for form, title in _FORMS.items():
        for accounting in (names.PAPER, names.EQUAL) if form in names.FORMS else (names.EQUAL,):
            word = f"**{accounting}**" if accounting == names.EQUAL else accounting
            cells = [_interval(store[run]["gain"].get(f"{model} {form} {accounting}")) for run, model in _GAINS]
            yield f"| {title} | {word} | {' | '.join(cells)} |"


def price(store: Store) -> Iterator[str]:
    """Gains under both safety profiles."""
    yield "| form | events | `practice` | of what is added | `paper` | of what is added |"
    yield "|---|---|---|---|---|---|"
    for name in ("demo", "us101"):
        for form in names.FORMS:
            rows = {row["safety"]: row for row in store[name]["price"] if row["form"] == form}
            cells = [_percent(rows[p][c]) for p in ("practice", "paper") for c in ("gain", "gain_incremental")]
            events = f"{rows['paper']['n_both']:.0f} of {rows['paper']['n_events']:.0f}"
            yield f"| {_FORMS[form]}, {store[name]['title']} | {events} | {' | '.join(cells)} |"


def planners(store: Store) -> Iterator[str]:
    """Other people's planners beside our policies."""
    yield "| planner | plans | contacts, broken limits | AV loss | followers' loss | both |"
    yield "|---|---|---|---|---|---|"
    for row in store["planners"]["planners"]:
        counts = f"{row['n_planned']:.0f} | {row['n_contacts']:.0f}, {row['n_violating']:.0f}"
        losses = " | ".join(_two(row[c]) for c in ("loss_av", "loss_hv", "loss_total"))
        yield f"| `{row['policy']}` | {counts} | {losses} |"


def seconds(store: Store) -> Iterator[str]:
    """How long the demo takes."""
    if not (run := store["demo"]["seconds"]):
        yield (
            "The demo took 70 s on two cores with compiled kernels, before the multiverse; not measured again yet."
        )
        return
    yield f"| {' | '.join(['demo', *run, 'all'])} |"
    yield f"|---|{'---:|' * (len(run) + 1)}"
    yield f"| seconds | {' | '.join(f'{value:.0f}' for value in [*run.values(), sum(run.values())])} |"


TABLES: dict[str, tuple[Callable[[Store], Iterable[str]], tuple[str, ...]]] = {
    "finding": (finding, ("demo", "us101")),
    "skill": (skill, ("mixture", "idm", "lcm", "us101")),
    "gain": (gain, ("demo", "us101")),
    "price": (price, ("demo", "us101")),
    "planners": (planners, ("planners",)),
    "seconds": (seconds, ("demo",)),
}
"""How each table is made, and of which runs."""


def table(name: str, store: Store) -> str:
    """A table with the code that made its runs."""
    make, runs = TABLES[name]
    codes = list(dict.fromkeys(store[run]["code"] for run in runs))
    return "\n".join([*make(store), "", f"*Made by {'; '.join(codes)}.*"])


def _times(found: dict[str, float] | None) -> str:
    return "-" if not found or found["ratio"] is None else f"**{found['ratio']:.0f}**"


def _interval(cell: dict[str, float] | None) -> str:
    if not cell or cell["gain"] is None:
        return "-"
    if cell.get("gain_low") is None:
        return f"{_percent(cell['gain'])} %"
    return f"{_percent(cell['gain'])} % ({_percent(cell['gain_low'])} .. {_percent(cell['gain_high'])})"


def _skilled(row: dict[str, float]) -> str:
    if row.get("skill_constant_low") is None:
        return _two(row.get("skill_constant"))
    limits = f"{_two(row['skill_constant_low'])} .. {_two(row['skill_constant_high'])}"
    return f"{_two(row['skill_constant'])} ({limits})"


def _whole(row: dict[str, float]) -> str:
    return "-" if row.get("n_events") is None else f"{row['n_events']:.0f}"


def _two(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100.0 * value:.2f}"


def rendered(text: str, store: Store) -> str:
    """A page with its tables from the store."""
    return _TABLE.sub(lambda m: f"{m[1]}{table(m[2], store)}\n{m[3]}", text)


def draw(store: Store, path: Path) -> None:
    """The picture of the finding: how many times the policy's effect the error of the followers' model is."""
    bars = [
        (f"{store[name]['title']},\n{_FORMS[form]}", store[name]["ratio"][form]["ratio"])
        for name in ("us101", "demo")
        for form in reversed(names.FORMS)
        if form in store[name]["ratio"]
    ]
    figure, places = panels(7.2, 2.6)
    axes = places[0, 0]
    axes.barh([title for title, _ in bars], [ratio for _, ratio in bars], color="#0067a3", height=0.6)
    for place, (_, ratio) in enumerate(bars):
        axes.text(ratio * 1.08, place, f"{ratio:.0f}", va="center")
    axes.axvline(1.0, color="#a84300")
    axes.text(1.08, len(bars) - 0.45, "left of this line the gain could be seen", color="#a84300", va="bottom")
    axes.set(
        xscale="log",
        xlim=(0.5, 2000.0),
        xlabel="error of the followers' model / effect of the policy",
        ylim=(-0.5, 4.0),
    )
    figure.savefig(path, dpi=144, metadata={"Software": None})


def copy_example(work: Path, reports: Path) -> None:
    """Copy the page and picture of the event with the largest gain, and the page of the matrix."""
    losses = artefacts.read(
        work, "losses", columns=["event_id", "followers", "policy", "accounting", "loss_total"]
    )
    rows = losses[(losses["followers"] == names.POPULATION) & (losses["accounting"] == names.PRIMARY_ACCOUNTING)]
    wide = rows.pivot_table(index="event_id", columns="policy", values="loss_total")
    event = (1.0 - wide[names.LOCAL_OPTIMUM] / wide[names.BENCHMARK]).idxmax()
    pages = {f"events/{event}.html": "event.html", f"events/{event}.png": "event.png"}
    for source, target in {**pages, "matrix.html": "validation_matrix.html"}.items():
        shutil.copyfile(reports / source, PICTURE.with_name(target))


def main() -> int:
    """Read, render, or check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--run", action="append", default=[], metavar="NAME=WORK", help="a finished run (repeatable)"
    )
    parser.add_argument(
        "--check", action="store_true", help="change nothing, exit with 1 if a page is not as written"
    )
    parser.add_argument("--example", nargs=2, type=Path, metavar=("WORK", "REPORTS"), help="for docs/example")
    options = parser.parse_args()
    if options.example:
        copy_example(*options.example)
    store: Store = json.loads(STORE.read_text("utf-8"))
    for name, _, work in (run.partition("=") for run in options.run):
        store[name] |= read_run(Path(work))
    pages = {path: rendered(path.read_text("utf-8"), store) for path in PAGES}
    if options.check:
        stale = [path.name for path, text in pages.items() if path.read_text("utf-8") != text]
        print(*(f"{name}: not as docs/write_results.py writes it" for name in stale), sep="\n", end="")
        return int(bool(stale))
    STORE.write_text(json.dumps(store, indent=1) + "\n", "utf-8")
    for path, text in pages.items():
        path.write_text(text, "utf-8")
    draw(store, PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
