"""Pages in a real browser: they play, scrub, sort and filter from disk, quietly, asking for nothing."""

import csv
import importlib.util
from dataclasses import replace
from pathlib import Path

import pytest
from browser import Watched, chromium
from sample_drives import DRIVES
from sample_event import infeasible_event, replanned_event, sample_event, unplanned_event
from sample_prediction import many_models, nobody, sample_prediction, trace
from sample_run import calibration, matrix, recordings, sample_run, sample_summary
from sample_studies import foresight, studies, tiles, variants

from highd_lc.reporting.pages_closed_loop import closed_loop_page
from highd_lc.reporting.pages_data import data_page, excluded_page
from highd_lc.reporting.pages_event import Links, event_page
from highd_lc.reporting.pages_followers import calibration_page
from highd_lc.reporting.pages_index import index_page, summary_page
from highd_lc.reporting.pages_multiverse import multiverse_page
from highd_lc.reporting.pages_population import StartTables, dictionary_page, matrix_page, start_page
from highd_lc.reporting.pages_prediction import prediction_page
from highd_lc.reporting.pages_studies import studies_page

EVENTS = 8400


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("reports")
    (root / "events").mkdir()
    pages = {
        "index.html": index_page(sample_run(EVENTS)),
        "summary.html": summary_page(sample_summary()),
        "matrix.html": matrix_page(matrix()),
        "calibration.html": calibration_page(calibration()),
        "studies.html": studies_page(studies()),
        "multiverse.html": multiverse_page(variants()),
        "closed_loop.html": closed_loop_page(DRIVES),
        "data.html": data_page(recordings(), sample_run().crossings, sample_run().events),
        "start.html": start_page(StartTables(tiles(), foresight())),
        "prediction.html": prediction_page(sample_prediction()),
        "nobody.html": prediction_page(nobody()),
        "excluded.html": excluded_page(sample_run().crossings),
        "dictionary.html": dictionary_page(),
        "events/event.html": event_page(sample_event(), Links()),
        "events/predicted.html": event_page(replace(sample_event(), prediction=trace()), Links()),
        "events/many_models.html": event_page(replace(sample_event(), prediction=many_models()), Links()),
        "events/infeasible.html": event_page(infeasible_event(), Links()),
        "events/replanned.html": event_page(replanned_event(), Links()),
        "events/unplanned.html": event_page(unplanned_event(), Links()),
    }
    for name, text in pages.items():
        (root / name).write_text(text, encoding="utf-8")
    return root


@pytest.fixture
def opened(browser, folder):
    watched = []

    def open_page(name, **options):
        watched.append(Watched(browser, folder / name, **options))
        return watched[-1].page

    yield open_page
    for one in watched:
        one.close()


def until(page, condition) -> None:
    # Playwright's own waiting needs eval, which the pages' content security policy forbids.
    for _ in range(300):
        if condition():
            return
        page.wait_for_timeout(20)
    raise AssertionError("waited in vain")


def clock(page) -> float:
    return float(page.inner_text("#clock").split()[0])


def fill_of(page, selector: str) -> str:
    return page.eval_on_selector(selector, "e => getComputedStyle(e).fill")


def test_the_player_plays_and_pauses(opened):
    page = opened("events/event.html")
    page.select_option("#rate", "4")
    page.click("#play")
    until(page, lambda: clock(page) > 1.0)
    page.click("#play")
    stopped = clock(page)
    page.wait_for_timeout(150)
    assert clock(page) == stopped > 1.0


def test_the_player_stops_at_the_end_and_starts_over(opened):
    page = opened("events/event.html")
    page.focus("#time")
    page.keyboard.press("End")
    assert clock(page) == 15.0
    page.click("#play")
    until(page, lambda: 0.0 < clock(page) < 10.0)
    page.click("#play")


def test_scrubbing_moves_vehicles_cursor_and_numbers_together(opened):
    page = opened("events/event.html")
    labels = lambda: page.eval_on_selector_all(".road text", "es => es.map(e => e.textContent)")  # noqa: E731
    before = page.inner_text(".chart .legend"), page.get_attribute(".chart .cursor", "x1"), labels()
    page.fill("#time", "4.2")
    after = page.inner_text(".chart .legend"), page.get_attribute(".chart .cursor", "x1"), labels()
    assert clock(page) == 4.2
    assert all(a != b for a, b in zip(before, after, strict=True))


def test_a_chart_can_be_dragged(opened):
    page = opened("events/event.html")
    page.locator("#charts .chart > svg").nth(1).click()
    # The time axis reaches from 54 to 526 of 560 units.
    assert clock(page) == pytest.approx(15 * (280 - 54) / (526 - 54), abs=0.1)


def test_keys_step_jump_and_choose(opened):
    page = opened("events/event.html")
    page.keyboard.press("ArrowRight")
    assert clock(page) == pytest.approx(0.1)
    page.keyboard.press("Shift+ArrowRight")
    assert clock(page) == pytest.approx(1.1)
    page.keyboard.press("Home")
    assert clock(page) == 0.0
    policies = page.eval_on_selector_all("#policy option", "es => es.map(e => e.value)")
    page.keyboard.press("2")
    assert page.input_value("#policy") == policies[1]
    page.keyboard.press(" ")
    assert page.inner_text("#play") == "Pause"
    page.keyboard.press(" ")


def test_choosing_policies_redraws_scene_and_charts(opened):
    page = opened("events/event.html")
    page.select_option("#policy", "no_lane_change")
    page.select_option("#compare", "human")
    legend = page.inner_text("#charts .chart .legend")
    assert "No lane change" in legend
    assert "Human" in legend
    assert page.locator(".road .ghost").count() == 4


def test_the_numbers_at_the_cursor_are_those_of_the_motion(opened):
    report = sample_event()
    page = opened("events/event.html")
    page.fill("#time", "3")
    shown = page.locator("#charts .chart").nth(1).locator(".legend").inner_text()
    value = float(shown.split("Local optimum")[1].split()[0])
    assert value == pytest.approx(report.play("local_optimum").ego.v[30], abs=0.02)


def test_the_accounting_chosen_is_the_only_one_shown(opened):
    page = opened("events/event.html")
    for accounting in ("paper", "equal", "follower_horizon"):
        page.select_option("#accounting", accounting)
        shown = page.eval_on_selector_all(
            "[data-accounting]", "es => es.filter(e => !e.hidden).map(e => e.dataset.accounting)"
        )
        assert set(shown) == {accounting}


def test_a_replanned_drive_shows_the_plan_of_each_moment(opened):
    page = opened("events/replanned.html")
    page.select_option("#accounting", "equal")
    assert page.locator("#road .plan").count() == 0
    page.select_option("#policy", "local_optimum_replanned")
    drawn = [page.locator("#road .plan").get_attribute("d")]
    assert drawn[0].count("L") == 12
    page.click("#time")
    page.keyboard.press("Home")
    for _ in range(3):
        page.keyboard.press("Shift+ArrowRight")
    drawn.append(page.locator("#road .plan").get_attribute("d"))
    assert drawn[1].count("L") == 4


def test_the_loss_surface_is_drawn_with_its_points(opened):
    page = opened("events/event.html")
    assert page.locator("#surface circle").count() == 4
    first = page.get_attribute("#surface image", "href")
    page.select_option("#quantity", "hv")
    assert page.get_attribute("#surface image", "href") != first


def test_fits_and_tracking_are_drawn(opened):
    page = opened("events/event.html")
    assert page.locator("[data-fit] path.line").count() == 2 * 2 * 2
    assert page.locator("[data-track] path.line").count() == 4 * 2


def test_the_predicted_follower_is_drawn_as_long_as_it_is_in_view(opened):
    page = opened("events/predicted.html")
    assert page.inner_text("#prediction .legend").split("\n") == ["recorded", "constant speed", "population"]
    ends = page.eval_on_selector_all(
        "#prediction path.line", "es => es.map(e => e.getBBox()).map(b => b.x + b.width)"
    )
    # The time axis reaches from 54 to 526 of 560 units over 8 s; the model that plans ends at 6 s.
    assert ends == pytest.approx([526, 526, 46 + 480 * 6 / 8], abs=20)
    assert ends[2] < ends[1] - 60


def test_of_many_models_a_few_are_drawn_and_the_legend_shows_and_hides_them(opened):
    page = opened("events/many_models.html")
    pressed = lambda: page.eval_on_selector_all(  # noqa: E731
        "#prediction .legend button[aria-pressed=true]", "es => es.map(e => e.textContent)"
    )
    assert pressed() == ["recorded", "constant speed", "own fit", "population"]
    assert page.locator("#prediction path.line").count() == 4
    page.click("#prediction .legend button >> text=Table 3 means")
    page.click("#prediction .legend button >> text=recorded")
    assert pressed() == ["constant speed", "own fit", "Table 3 means", "population"]
    assert page.locator("#prediction path.line").count() == 4
    assert page.evaluate("document.activeElement.textContent") == "recorded"


def test_a_car_on_a_small_screen_is_no_speck(opened):
    page = opened("events/event.html", width=420)
    assert page.locator(".road rect.ego").bounding_box()["width"] > 8.0


def test_every_figure_has_words(opened):
    page = opened("events/event.html")
    texts = page.eval_on_selector_all("svg[role=img]", "es => es.map(e => e.getAttribute('aria-label') || '')")
    assert len(texts) >= 10
    assert min(map(len, texts)) > 20


def test_dark_and_light(opened):
    dark = opened("events/event.html", dark=True)
    ground = "getComputedStyle(document.body).backgroundColor"
    assert dark.evaluate(ground) == "rgb(20, 23, 26)"
    dark.click("#theme")
    assert dark.evaluate(ground) == "rgb(255, 255, 255)"


def test_the_ego_takes_the_colour_of_its_policy(opened):
    page = opened("events/event.html")
    first = fill_of(page, ".road .ego")
    page.select_option("#policy", "benchmark")
    assert fill_of(page, ".road .ego") != first


def test_an_infeasible_event_offers_what_there_is(opened):
    page = opened("events/infeasible.html")
    offered = page.eval_on_selector_all("#policy option", "es => es.map(e => e.value)")
    assert "benchmark" not in offered
    assert page.input_value("#policy") == "human"
    assert "meets all constraints" in page.inner_text(".notice >> nth=0")
    assert "No candidate of this grid meets all constraints" in page.inner_text("#surface .legend")
    assert page.locator(".road rect.ego").count() == 1


def test_printing_shows_content_without_controls(opened):
    page = opened("events/event.html")
    page.emulate_media(media="print")
    assert not page.is_visible("#play")
    assert page.is_visible("#road")
    assert len(page.pdf(format="A4")) > 20_000


def test_only_rows_in_view_are_in_the_document(opened):
    page = opened("index.html")
    assert page.locator("#events tbody tr:not(.gap)").count() < 80
    page.evaluate("document.getElementById('events').scrollTop = 1e9")
    until(page, lambda: page.eval_on_selector("#events tbody tr:last-child", "e => e.offsetHeight") < 5)
    assert page.locator("#events tbody tr:not(.gap)").count() < 80


def gains(page) -> list[float]:
    texts = page.eval_on_selector_all(
        "#events tbody tr:not(.gap) td:nth-child(10)", "es => es.map(e => e.textContent)"
    )
    return [float(text.replace("−", "-")) for text in texts]


def test_best_and_worst_first(opened):
    page = opened("index.html")
    best = gains(page)
    assert best == sorted(best, reverse=True)
    page.click("#worst")
    worst = gains(page)
    assert worst == sorted(worst)
    assert worst[0] < best[-1]


def test_headers_sort_and_say_so(opened):
    page = opened("index.html")
    page.click("#events thead button >> text=Event")
    ids = page.eval_on_selector_all("#events tbody a", "es => es.map(e => e.textContent)")
    assert ids == sorted(ids)
    assert page.get_attribute("#events thead th >> nth=0", "aria-sort") == "ascending"
    page.click("#events thead button >> text=Event")
    assert page.get_attribute("#events thead th >> nth=0", "aria-sort") == "descending"


def test_filters_and_search_narrow_the_list(opened):
    page = opened("index.html")
    run = sample_run(EVENTS)
    page.select_option("#direction", "right")
    page.select_option("#ego_class", "Truck")
    expected = ((run.events["direction"] == "right") & (run.events["ego_class"] == "Truck")).sum()
    assert page.inner_text("#count") == f"{expected} of {EVENTS} events"
    page.click("#clear")
    page.fill("#search", "01-0006 car")
    assert page.inner_text("#count") == f"1 of {EVENTS} events"
    assert page.get_attribute("#events tbody a", "href") == "events/01-0006-00142.html"


def test_filter_by_gain(opened):
    page = opened("index.html")
    page.fill("#gain_from", "2")
    page.fill("#gain_to", "3")
    shown = gains(page)
    assert min(shown) >= 2.0
    assert max(shown) <= 3.0


def test_another_form_and_accounting_changes_the_gains(opened):
    page = opened("index.html")
    before = gains(page)
    page.select_option("#cell", "free/paper")
    assert gains(page) != before


@pytest.mark.parametrize(
    "name",
    [
        "summary",
        "prediction",
        "matrix",
        "studies",
        "multiverse",
        "start",
        "calibration",
        "data",
        "excluded",
        "dictionary",
    ],
)
def test_overview_pages_are_quiet(opened, name):
    page = opened(f"{name}.html")
    assert page.inner_text("h1")
    assert page.get_attribute("nav a[aria-current=page]", "href") == f"{name}.html"
    # Nothing but tables inside their own scroller is wider than the window.
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


ALL_PAGES = (
    "index", "summary", "prediction", "nobody", "matrix", "studies", "multiverse", "closed_loop", "start",
    "calibration", "data", "excluded", "dictionary",
)  # fmt: skip


@pytest.mark.parametrize(
    "name", [*ALL_PAGES, *(f"events/{kind}" for kind in ("event", "many_models", "infeasible", "unplanned"))]
)
def test_on_a_telephone_nothing_is_wider_than_the_screen(opened, name):
    page = opened(f"{name}.html", width=420)
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    wide = "[...document.querySelectorAll('caption')].filter(c => c.offsetWidth > innerWidth).length"
    assert page.evaluate(wide) == 0


def test_letters_of_drawings_stay_legible_on_a_telephone(opened):
    page = opened("events/event.html", width=420)
    for selector in (".chart .tick", ".road text"):
        height = page.eval_on_selector(selector, "e => e.getBoundingClientRect().height")
        assert height > 9.0


def test_the_printed_index_keeps_the_names_of_its_columns(opened):
    page = opened("index.html")
    page.emulate_media(media="print")
    assert page.is_visible("#events thead button >> text=Gain")
    assert not page.is_visible("#best")


_SERIOUS = """async () => (await axe.run(document, {resultTypes: ["violations"]})).violations
    .filter(v => ["serious", "critical"].includes(v.impact))
    .map(v => `${v.id}: ${v.nodes[0].html.slice(0, 200)}`)"""


@pytest.mark.parametrize(
    "name", [*ALL_PAGES, *(f"events/{kind}" for kind in ("event", "many_models", "infeasible", "unplanned"))]
)
def test_a_page_has_no_serious_fault_of_accessibility(opened, name):
    axe = importlib.util.find_spec("axe_playwright_python")
    if axe is None:
        pytest.skip("axe-playwright-python is not installed (extra dev)")
    page = opened(f"{name}.html", width=420, dark=name.startswith("events"))
    page.add_script_tag(content=Path(axe.origin).with_name("axe.min.js").read_text("utf-8"))
    assert page.evaluate(_SERIOUS) == []


def chart(page, title: str):
    return page.locator("figure.chart", has=page.locator("h3", has_text=title)).first


def test_a_chart_zooms_about_the_cursor_and_back(opened):
    page = opened("events/event.html")
    page.fill("#time", "4.0")
    speed = chart(page, "Speed of the AV")
    ticks = lambda: speed.locator("text.tick").all_text_contents()  # noqa: E731
    whole = speed.locator("path.line").first.get_attribute("d")
    for _ in range(2):
        speed.get_by_role("button", name="Zoom in").click()
    assert speed.locator("path.line").first.get_attribute("d") != whole
    assert "15" not in ticks()
    for _ in range(2):
        speed.get_by_role("button", name="Zoom out").click()
    assert speed.locator("path.line").first.get_attribute("d") == whole


def test_a_chart_s_data_are_saved_as_csv(opened, tmp_path):
    page = opened("events/event.html")
    with page.expect_download() as waiting:
        chart(page, "Lateral position of the AV").get_by_role("button", name="CSV").click()
    waiting.value.save_as(tmp_path / "lateral.csv")
    rows = list(csv.reader((tmp_path / "lateral.csv").read_text("utf-8").splitlines()))
    assert rows[0] == ["series", "time since start [s]", "Lateral position of the AV [m]"]
    assert {row[0] for row in rows[1:]} >= {"Local optimum", "Benchmark", "Human", "Local optimum, as driven"}
    last = [float(row[2]) for row in rows if row[0] == "Local optimum"][-1]
    assert last == pytest.approx(sample_event().play("local_optimum").ego.y[-1], abs=0.02)


def test_the_plan_as_driven_stands_beside_the_plan(opened):
    page = opened("events/event.html")
    assert "Local optimum, as driven" in chart(page, "Speed of the AV").inner_text()
    assert "as driven" not in chart(page, "Jerk charged").inner_text()
    page.select_option("#accounting", "paper")
    assert "as driven" not in chart(page, "Speed of the AV").inner_text()


@pytest.mark.parametrize("width", [420, 1280])
def test_labels_of_the_loss_surface_cover_neither_each_other_nor_a_point(opened, width):
    page = opened("events/event.html", width=width)
    boxes = "es => es.map(e => { const b = e.getBBox(); return [b.x, b.y, b.x + b.width, b.y + b.height]; })"
    texts = page.eval_on_selector_all("#surface .halo", boxes)
    points = page.eval_on_selector_all("#surface .point", boxes)
    assert len(texts) == len(points) > 2
    for k, (x0, y0, x1, y1) in enumerate(texts):
        for u0, v0, u1, v1 in [*texts[:k], *points]:
            assert x1 <= u0 + 1 or u1 <= x0 + 1 or y1 <= v0 + 3 or v1 <= y0 + 3


def test_tables_of_an_event_fit_a_window_of_1280(opened):
    page = opened("events/event.html")
    wide = "[...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth + 1).length"
    assert page.evaluate(wide) == 0
