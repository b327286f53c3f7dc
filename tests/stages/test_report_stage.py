import json
import re
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from shared_runs import FIXTURES, copied

from highd_lc.io import artefacts
from highd_lc.reporting.html import PAGES
from highd_lc.stages import report
from highd_lc.stages.overview_pages import missing_pages
from highd_lc.stages.prediction_tables import followers_believed
from highd_lc.vocab import names
from highd_lc.vocab.errors import UsageError
from highd_lc.vocab.job import Combination, Job, Provenance, one_by_one
from highd_lc.vocab.settings import ReportSettings, Settings, ValidateSettings
from highd_lc.vocab.tables import TABLES

RECORDINGS = (1, 2)
PROVENANCE = Provenance("0123abcd", {"01": "feed"}, 1, "code-1")


def job(work: Path, recording: int, settings: Settings) -> Job:
    return Job(recording, FIXTURES, work, settings, made_from(work, recording))


def made_from(work: Path, recording: int) -> Provenance:
    """The provenance of a recording's pages, which they show, as the run had it."""
    about = artefacts.provenance_of(artefacts.part_folder(work, report.STAGE, recording) / "event_pages.parquet")
    return Provenance(*(about[field.name] for field in fields(Provenance)))


@pytest.fixture(scope="module")
def work(pipeline_run, tmp_path_factory) -> Path:
    """A copy of a finished run's work folder: the stage writes a table of its own into it."""
    return copied(pipeline_run, tmp_path_factory.mktemp("run"), reports=False).work


@pytest.fixture(scope="module")
def made(pipeline_run, tmp_path_factory) -> Path:
    """The whole report, without the lock of the run that made it."""
    folder = tmp_path_factory.mktemp("made") / "reports"
    return shutil.copytree(pipeline_run.reports, folder, ignore=shutil.ignore_patterns(".lock"))


@pytest.fixture
def make(pipeline_run):
    """Makes the pages of a work folder, all of them unless some are named, changed: settings of the report."""

    def make(work: Path, folder: Path, *, carry_out=one_by_one, changed: dict | None = None, **wanted) -> None:
        of_report = pipeline_run.settings.report.model_copy(update=changed or {})
        settings = pipeline_run.settings.model_copy(update={"report": of_report})
        request = report.choose(work, settings.report, reports=folder, **wanted)
        for recording in RECORDINGS:
            report.run(job(work, recording, settings), request=request)
        report.combine(Combination(RECORDINGS, work, settings, PROVENANCE), request=request, carry_out=carry_out)

    return make


def last_first(calls):
    """Calls carried out from the last to the first."""
    return [call() for call in reversed(calls)][::-1]


def events(work: Path) -> list[str]:
    return artefacts.read(work, "events")["event_id"].tolist()


def payload(page: Path) -> dict:
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text).group(1))


DEFAULT = ValidateSettings().follower_models[0]


def default(work: Path, name: str) -> pd.DataFrame:
    """The rows of the follower model that pages show."""
    frame = artefacts.read(work, name)
    assert frame["followers"].nunique() == 2
    return frame[frame["followers"] == DEFAULT]


def test_every_event_has_its_page_and_picture_and_nothing_else_is_there(work, made):
    assert len(events(work)) >= 3
    expected = {f"{e}.{kind}" for e in events(work) for kind in ("html", "png")}
    assert {path.name for path in (made / "events").iterdir()} == expected
    assert {path.name for path in made.iterdir()} == {"events", *pages_of(work)}


def pages_of(work: Path) -> list[str]:
    return [name for name, _ in PAGES if name not in missing_pages(work)]


def with_predictions(work: Path, folder: Path, *, present: bool) -> Path:
    """A copy of the work folder that holds the tables of predicted followers, without rows, or does not."""
    shutil.copytree(work, folder)
    for name in ("prediction", "prediction_summary", "dose_response", "externality", "externality_balance"):
        path = artefacts.path_of(folder, name)
        path.unlink(missing_ok=True)
        if present:
            empty = pd.DataFrame(columns=list(TABLES[name].column_names), dtype=object)
            artefacts.write(path, artefacts.to_arrow(name, empty, PROVENANCE))
    return folder


@pytest.mark.parametrize("present", [True, False])
def test_the_page_on_followers_is_there_if_its_tables_are(work, make, undrawn, tmp_path, present):
    copy = with_predictions(work, tmp_path / "work", present=present)
    (tmp_path / "reports").mkdir()
    (tmp_path / "reports" / "prediction.html").write_text("of an earlier run")
    make(copy, tmp_path / "reports", changed={"png": "none"})
    page = tmp_path / "reports" / "prediction.html"
    assert page.is_file() == present
    assert not present or "earlier run" not in page.read_text(encoding="utf-8")
    for other in (tmp_path / "reports").rglob("*.html"):
        text = other.read_text(encoding="utf-8")
        assert ('prediction.html"' in text) == present, other
        if other.name in ("summary.html", "index.html", "matrix.html", "studies.html"):
            words = text.index("How well the followers are predicted is not known")
            assert words < text.index("</table>")
            assert ("this work folder holds no prediction" in text) != present


def test_the_words_on_followers_are_those_of_the_tables(work, tmp_path):
    without = with_predictions(work, tmp_path / "without", present=False)
    empty = with_predictions(work, tmp_path / "empty", present=True)
    assert "no prediction" in followers_believed(without, DEFAULT)[0]
    assert "none is in view" in followers_believed(empty, DEFAULT)[0]


def test_every_link_leads_to_a_file(made):
    for page in made.rglob("*.html"):
        for link in re.findall(r' href="(?!data:)([^"#]+)', page.read_text(encoding="utf-8")):
            assert (page.parent / link).is_file(), (page, link)


def test_every_crossing_is_an_event_or_listed_as_excluded(work, made):
    excluded = (made / "excluded.html").read_text(encoding="utf-8")
    for row in artefacts.read(work, "crossings").itertuples():
        assert row.usable == (made / "events" / f"{row.event_id}.html").exists()
        assert row.usable != (f'<th scope="row">{row.event_id}</th>' in excluded)


def test_the_index_gains_are_those_of_the_losses(work, made):
    data = payload(made / "index.html")
    losses = default(work, "losses").set_index(["event_id", "policy", "accounting"])["loss_total"]
    for row, gain in zip(data["rows"], data["values"]["fixed/equal"]["gain"], strict=True):
        local, benchmark = (losses[row[0], policy, "equal"] for policy in (names.LOCAL_OPTIMUM, names.BENCHMARK))
        assert gain == pytest.approx(100 * (1 - local / benchmark), abs=6e-4)


def follower_loss(play: dict, weights: list[float], last: int) -> float:
    """The followers' loss recomputed from what a page draws (equations.md 4)."""
    import base64

    values, offset, data = [], 0, np.frombuffer(base64.b64decode(play["data"]), np.int8)
    for step, base, first, count in play["channels"]:
        assert first == 0
        values.append(step * (base + np.cumsum(data[offset : offset + count].astype(int))))
        offset += count
    speeds, accelerations = values[7::4], values[8::4]
    comfort = [np.abs(np.diff(a[: last + 1])).sum() / 0.1 / 8.0 for a in accelerations]
    efficiency = [np.abs(v[: last + 1] - 33.54).sum() / 33.54 for v in speeds]
    return 0.5 * float(np.dot(weights, comfort) + np.dot(weights, efficiency))


def test_what_a_page_draws_is_what_the_tables_were_made_from(work, made):
    losses = default(work, "losses")
    chosen = losses[(losses["accounting"] == "equal") & losses["policy"].isin(names.FIXED_POLICIES)].dropna(
        subset="loss_total"
    )
    assert len(chosen)
    for row in chosen.itertuples():
        plays = payload(made / "events" / f"{row.event_id}.html")["plays"]
        play = next(p for p in plays if p["policy"] == row.policy and "equal" in p["accountings"])
        # Rounding to 0.01 m/s^2 adds noise to the comfort sums.
        assert follower_loss(play, row.follower_weights, 150) == pytest.approx(row.loss_hv, rel=0.05)


def test_what_the_summary_says_is_what_the_tables_hold(work, made):
    page = re.sub(r"<[^>]+>", " ", (made / "summary.html").read_text(encoding="utf-8").replace("\u00a0", " "))
    matrix = default(work, "validation_matrix").query("stratum == 'all'")
    losses = default(work, "losses").query("accounting == 'equal'")
    pairs = {"fixed": ("local_optimum", "benchmark"), "free": ("local_optimum_free", "benchmark_free")}
    wide = losses.pivot_table(index="event_id", columns="policy", values="loss_total")
    for form, (local, benchmark) in pairs.items():
        both = wide[[local, benchmark]].dropna()
        gain = 1 - both[local].sum() / both[benchmark].sum()
        row = matrix.query(f"form == '{form}' and accounting == 'equal'").iloc[0]
        assert gain == pytest.approx(row["gain"])
        words = "less" if gain > 0 else "more"
        amount = f"{100 * abs(gain):.2f}" if abs(gain) >= 5e-5 else "under 0.01"
        assert f"{amount} % {words} total loss than the benchmark" in page, gain
        better = (both[local] < both[benchmark] * 0.999).mean()
        assert f"Of {len(both)} events the local optimum is better in {100 * better:.1f} %" in page
    crossings = pd.read_parquet(work / "crossings.parquet")
    assert f"{len(RECORDINGS)} recordings with {len(crossings)} lane-id changes" in page


def test_surface_and_plan_agree(work, made):
    for event_id in events(work):
        data = payload(made / "events" / f"{event_id}.html")
        for policy, _, T, offset in data["surface"]["points"]:
            assert data["surface"]["x"][0] <= offset <= data["surface"]["x"][-1], policy
            assert T > 0


def without_figures(page: Path) -> bytes:
    """What is in a file; of a page no drawn figure but its words."""
    drawn = rb'<svg role="img"[^>]*? (aria-label="[^"]*")[^>]*>.*?</svg>\n?'
    return re.sub(drawn, rb"<svg \1></svg>", page.read_bytes(), flags=re.DOTALL)


def test_the_same_run_gives_the_same_bytes_in_any_order_and_leaves_no_event_of_another(
    work, made, make, undrawn, tmp_path
):
    """The figures of overview pages apart: ``test_workers`` compares these as well."""
    folder = tmp_path / "events"
    folder.mkdir()
    for name in ("77-0001-00001.html", "77-0001-00001.png", f"{events(work)[0]}.pdf", "notes.html"):
        (folder / name).write_text("from an earlier run")
    make(work, tmp_path, carry_out=last_first)
    for path in made.rglob("*.*"):
        assert without_figures(tmp_path / path.relative_to(made)) == without_figures(path), path.name
    extra = {path.name for path in folder.iterdir()} - {path.name for path in (made / "events").iterdir()}
    assert extra == {"notes.html"}


def test_one_event_leaves_everything_else_alone(work, make, tmp_path):
    chosen = events(work)[1]
    (tmp_path / "index.html").write_text("old")
    make(work, tmp_path, events=(chosen,), vector=("pdf", "svg"))
    assert {path.name for path in (tmp_path / "events").iterdir()} == {
        f"{chosen}.{k}" for k in ("html", "png", "pdf", "svg")
    }
    assert (tmp_path / "index.html").read_text() == "old"


def test_one_event_is_animated_whether_pictures_are_drawn_or_not(make, work, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "event_gif", lambda event: event.event_id.encode())
    chosen = events(work)[1]
    request = report.choose(work, ReportSettings(png="none"), reports=tmp_path, events=(chosen,), vector=("gif",))
    assert report._links([chosen], 0, request).vector == ("gif",)
    make(work, tmp_path, events=(chosen,), vector=("gif",))
    assert (tmp_path / "events" / f"{chosen}.gif").read_bytes() == chosen.encode()
    assert f'href="{chosen}.gif"' in (tmp_path / "events" / f"{chosen}.html").read_text()
    make(work, tmp_path, events=(chosen,))
    assert not (tmp_path / "events" / f"{chosen}.gif").exists()


def test_unknown_events_and_formats_are_refused(work, tmp_path):
    with pytest.raises(UsageError, match="event '99-0000-00000': not among the"):
        report.choose(work, ReportSettings(), reports=tmp_path, events=("99-0000-00000",))
    with pytest.raises(UsageError, match="vector 'gif': choose from pdf, svg"):
        report.choose(work, ReportSettings(), reports=tmp_path, vector=("gif",))


@pytest.mark.parametrize(("png", "top", "expected"), [("none", 2, 0), ("top", 2, 2), ("all", 2, None)])
def test_png_modes(work, tmp_path, png, top, expected):
    request = report.choose(work, ReportSettings(png=png, top=top), reports=tmp_path)
    assert (None if request.pictures is None else len(request.pictures)) == expected


def test_top_events_are_those_that_differ_most(work):
    losses = default(work, "losses")
    wide = losses[losses["accounting"] == "equal"].pivot_table(
        index="event_id", columns="policy", values="loss_total"
    )
    difference = (1 - wide[names.LOCAL_OPTIMUM] / wide[names.BENCHMARK]).abs()
    assert report.top_events(work, 1, DEFAULT) == {difference.idxmax()}


def test_pictures_no_longer_wanted_go(work, make, tmp_path):
    event_id = events(work)[0]
    (tmp_path / "events").mkdir()
    (tmp_path / "events" / f"{event_id}.png").write_text("from an earlier run")
    make(work, tmp_path, changed={"png": "none"}, events=(event_id,))
    assert [path.name for path in (tmp_path / "events").iterdir()] == [f"{event_id}.html"]


def test_raw_pages_hold_finer_recorded_motion(work, made, make, tmp_path):
    event_id = events(work)[0]
    make(work, tmp_path, changed={"raw": True, "png": "none"}, events=(event_id,))

    def finest(folder: Path) -> float:
        plays = payload(folder / "events" / f"{event_id}.html")["plays"]
        recorded = next(p for p in plays if p["policy"] == "recorded")
        return min(channel[0] for channel in recorded["channels"])

    assert finest(tmp_path) == 0.01
    assert finest(made) == 0.1


def test_the_part_for_the_index_holds_the_start(work, made):
    pages = artefacts.read(work, "event_pages").set_index("event_id")
    tracks = artefacts.read(work, "event_tracks")
    start = tracks[tracks["t"].abs() < 1e-9].set_index(["event_id", "role"])["vx"]
    expected = pd.Series({e: start[e, names.target_follower(1)] - start[e, names.EGO] for e in pages.index})
    pd.testing.assert_series_equal(pages["hv1_speed_difference_mps"], expected, check_names=False, atol=1e-6)
