"""The page in Chromium: what is chosen, moved and played, on a desk and on a phone, without a network."""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gpxpy
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

import pareto_ltl
from pareto_ltl.run.results import Results
from pareto_ltl.support.errors import InfeasibleError

CHROMIUM = shutil.which("chromium")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
DESK, PHONE = (1440, 900), (390, 844)
MOST, PAUSE = 60_000, 50  # [ms] that a slow machine may take, and between two looks

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


@dataclass
class Opened:
    """A page and what the browser said and asked for while it was open."""

    page: Page
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def value(self, script: str) -> Any:
        return self.page.evaluate(script)

    def wait(self, condition: str) -> None:
        """Until ``condition`` holds; the page's policy forbids what ``wait_for_function`` does."""
        for _ in range(MOST // PAUSE):
            if self.value(condition):
                return
            self.page.wait_for_timeout(PAUSE)
        pytest.fail(f"not within {MOST} ms: {condition}")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="module", params=[DESK, PHONE], ids=["desk", "phone"])
def opened(request: pytest.FixtureRequest, browser: Browser, page_result: Path) -> Iterator[Opened]:
    """The page at one width; each test leaves it as it likes."""
    width, height = request.param
    touch = request.param == PHONE
    context = browser.new_context(viewport={"width": width, "height": height}, has_touch=touch)
    shown = Opened(context.new_page())
    shown.page.set_default_timeout(MOST)
    shown.page.on("console", lambda message: shown.said.append(message.text))
    shown.page.on("pageerror", lambda error: shown.said.append(str(error)))
    shown.page.on("request", lambda request: shown.asked.append(request.url))
    shown.page.goto((page_result / "report.html").as_uri())
    shown.page.wait_for_selector("html[data-ready=map]")
    for part in ("front", "risk", "files", "machine"):
        shown.page.locator(f"#{part}").scroll_into_view_if_needed()
        shown.wait(f"drawn.has('{part}')")
    yield shown
    outside = [address for address in shown.asked if not address.startswith(("file:", "data:", "blob:"))]
    assert shown.said == []
    assert outside == []
    context.close()


def trace(name: str, key: str = "x") -> str:
    return f"byId('map').data[traceNumber('{name}')].{key}"


def test_the_first_view_is_the_chosen_plan(opened: Opened, page_result: Path) -> None:
    plan = Results(page_result).plan
    east = opened.value(trace("path"))
    assert [1e3 * x for x in east] == pytest.approx(plan.path.x[:, 0], abs=0.51)
    assert opened.value("shown.point") == opened.value("PAGE.chosen")
    names = opened.page.locator("#map text").all_text_contents()
    assert {"a", "b", "c"} <= set(names)


def test_nothing_is_wider_than_the_window(opened: Opened) -> None:
    assert opened.value("document.documentElement.scrollWidth <= innerWidth")
    small = opened.value(
        "[...document.querySelectorAll('button, select, .files a')].filter(e => e.offsetHeight < 36).length"
    )
    assert small == 0


def test_a_click_on_a_point_of_the_front_shows_its_path(opened: Opened) -> None:
    if opened.value("PAGE.points.length") < 2:
        pytest.fail("the small result needs two points")
    opened.page.locator("#front").scroll_into_view_if_needed()
    wanted = opened.value("PAGE.chosen === 0 ? PAGE.points.length - 1 : 0")
    marks = opened.page.locator("#front .scatterlayer .trace").first.locator(".points path")
    box = marks.nth(wanted).bounding_box()
    assert box is not None
    opened.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.wait(f"shown.point === {wanted}")
    assert opened.page.locator("#point").input_value() == str(wanted)
    assert opened.value(trace("path")) == pytest.approx(
        opened.value(f"PAGE.paths[{wanted}].x.map(p => p[0] / 1000)")
    )
    assert opened.value("byId('front').data[2].x") == [
        pytest.approx(opened.value(f"PAGE.points[{wanted}].length / 1000"))
    ]
    assert f"--point {wanted}" in (opened.page.locator("#export-command").text_content() or "")
    opened.page.locator("#home").click()
    assert opened.value("shown.point === PAGE.chosen")


def test_points_are_chosen_with_the_keyboard(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    last = opened.value("PAGE.points.length - 1")
    opened.page.locator("#point").focus()
    opened.page.keyboard.press("End")
    opened.wait(f"shown.point === {last}")
    assert opened.page.locator("#next").is_disabled()
    opened.page.locator("#previous").press("Enter")
    opened.wait(f"shown.point === {last - 1}")
    opened.page.locator("#home").press("Space") if opened.value("shown.point !== PAGE.chosen") else None
    assert opened.value("shown.point === PAGE.chosen")


def test_the_slider_moves_robot_wind_flights_risk_and_automaton(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    before = {name: opened.value(trace(name)) for name in ("robot", "wind", "heads")}
    clock = opened.page.locator("#clock").text_content()
    opened.page.locator("#time").focus()
    for _ in range(3):
        opened.page.keyboard.press("ArrowRight")
    assert opened.value("shown.step") == 3
    for name, east in before.items():
        assert opened.value(trace(name)) != east
    assert opened.page.locator("#clock").text_content() != clock
    opened.page.keyboard.press("End")
    assert opened.value("shown.step === path().x.length - 1")
    assert opened.value("byId('risk').layout.shapes[0].x0") == pytest.approx(
        opened.value("path().t.at(-1) / 3600")
    )
    end = opened.value("path().q.at(-1)")
    assert (
        opened.page.locator(f"#machine [data-state='{end}'] circle").first.get_attribute("stroke-width")
        == "3"
    )
    assert "mission complete" in (opened.page.locator("#progress .now").text_content() or "")


def test_the_flight_plays_pauses_and_ends(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    play = opened.page.locator("#play")
    play.click()
    assert play.get_attribute("aria-label") == "pause"
    opened.wait("shown.step >= 2")
    play.press("Space")
    stopped = opened.value("shown.step")
    assert play.get_attribute("aria-label") == "play"
    opened.page.wait_for_timeout(400)
    assert opened.value("shown.step") == stopped
    opened.value("showStep(path().x.length - 2)")
    play.click()
    opened.wait("shown.timer === null && shown.step === path().x.length - 1")


def test_failed_flights_have_another_colour_and_another_line(opened: Opened) -> None:
    good, bad = (opened.value(trace(name, "line")) for name in ("tails", "lost"))
    assert good["color"] != bad["color"]
    assert bad["dash"] == "dash"
    assert "dash" not in good
    opened.value("showPoint(PAGE.chosen); showStep(path().x.length - 1)")
    lost = opened.value(trace("lostHeads")).count(None) + bool(opened.value(trace("lostHeads")))
    assert lost == opened.value("PAGE.flights.failedAt.filter(step => step >= 0).length")


def test_layers_are_switched_off_and_on(opened: Opened) -> None:
    for box, name in (("show-wind", "wind"), ("show-doubt", "doubt"), ("show-ellipses", "ellipses")):
        opened.page.locator(f"#{box}").uncheck()
        assert opened.value(trace(name, "visible")) is False
        opened.page.locator(f"#{box}").check()
        assert opened.value(trace(name, "visible")) is True
    opened.page.locator("#show-flights").uncheck()
    assert opened.value(trace("tails")) == []
    opened.page.locator("#show-flights").check()


def test_tight_places_belong_to_the_chosen_plan_and_can_be_hidden(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    places = opened.value("PAGE.places")
    east = opened.value("path().x.map(p => p[0] / 1000)")
    assert places
    drawn = [x for place in places for x in (*east[place["step"] : place["step"] + 2], None)][:-1]
    assert opened.value(trace("places")) == pytest.approx(drawn)
    reasons = opened.value(trace("reasons", "text"))
    assert reasons[::4] == ["<br>".join(place["lines"]) for place in places]
    numbers = [int(text) for text in opened.value(trace("numbers", "text")) if text]
    assert numbers == opened.value("PAGE.pricedObstacles")
    opened.value("showPoint(PAGE.chosen === 0 ? 1 : 0)")
    for name in ("places", "reasons", "numbers"):
        assert opened.value(trace(name)) == []
    opened.value("showPoint(PAGE.chosen)")
    assert opened.value(trace("places")) == pytest.approx(drawn)
    opened.page.locator("#show-places").uncheck()
    assert opened.value(trace("places")) == opened.value(trace("reasons")) == []
    opened.page.locator("#show-places").check()
    assert opened.value(trace("places")) == pytest.approx(drawn)


HOSTILE = "<img src=x onerror=alert(1)>"
SECOND_SPOT = """(() => {
  const map = byId('map'), { x, y } = map.data[traceNumber('reasons')], box = map.getBoundingClientRect();
  const { _size: size, xaxis, yaxis } = map._fullLayout;
  return [box.x + size.l + xaxis.l2p(x[1]), box.y + size.t + yaxis.l2p(y[1])];
})()"""


def test_a_click_on_a_tight_place_goes_to_its_step_and_its_text_is_no_markup(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    step = opened.value("PAGE.places[0].step")
    opened.value(f'PAGE.places[0].lines.push("{HOSTILE}"); restyleMap(placeTraces())')
    opened.page.locator("#map").scroll_into_view_if_needed()
    x, y = opened.value(SECOND_SPOT)
    opened.page.mouse.move(x, y)
    opened.wait("document.querySelectorAll('#map .hoverlayer text').length > 0")
    assert HOSTILE in "".join(opened.page.locator("#map .hoverlayer text").all_text_contents())
    assert opened.page.locator("img").count() == 0
    opened.page.mouse.click(x, y)
    opened.wait(f"shown.step === {step}")
    opened.value("PAGE.places[0].lines.pop(); restyleMap(placeTraces())")


def test_everything_has_a_name_for_those_who_do_not_see_it(opened: Opened) -> None:
    unnamed = opened.value(
        """[...document.querySelectorAll('button, input, select, [role=img]')].filter(e =>
           !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)).map(e => e.id)"""
    )
    assert unnamed == []
    assert opened.page.locator("h1").count() == 1


def downloaded(opened: Opened, name: str) -> str:
    with opened.page.expect_download() as waiting:
        opened.page.locator("#files a", has_text=name).click()
    assert waiting.value.suggested_filename.endswith(f"_{name}")
    return Path(waiting.value.path()).read_text(encoding="utf-8")


def test_downloads_say_what_the_exported_files_say(opened: Opened, page_result: Path, tmp_path: Path) -> None:
    last = opened.value("PAGE.points.length - 1")
    opened.value(f"showPoint({last})")
    formats = ["dead_reckoning", "geojson", "kml", "gpx", "qgc"]
    pareto_ltl.export(page_result, tmp_path, formats, point=last)
    table = list(csv.DictReader(io.StringIO(downloaded(opened, "dead_reckoning.csv"))))
    with (tmp_path / "dead_reckoning.csv").open() as file:
        wanted = list(csv.DictReader(file))
    assert list(table[0]) == list(wanted[0])
    for row, other in zip(table, wanted, strict=True):
        for key, cell in other.items():
            try:
                assert float(row[key]) == pytest.approx(float(cell), rel=1e-3, abs=0.06), key
            except ValueError:
                assert row[key] == cell
    route = gpxpy.parse(downloaded(opened, "plan.gpx")).routes[0].points
    exported = gpxpy.parse((tmp_path / "plan.gpx").read_text()).routes[0].points
    for point, other in zip(route, exported, strict=True):
        assert (point.latitude, point.longitude) == pytest.approx((other.latitude, other.longitude), abs=1e-6)
        assert point.time == other.time
    items = json.loads(downloaded(opened, "mission.plan"))["mission"]["items"]
    wanted_items = json.loads((tmp_path / "mission.plan").read_text())["mission"]["items"]
    assert [item["command"] for item in items] == [item["command"] for item in wanted_items]
    features = json.loads(downloaded(opened, "plan.geojson"))["features"]
    told = json.loads((tmp_path / "plan.geojson").read_text())["features"]
    roles = [feature["properties"]["role"] for feature in features]
    assert sorted(roles) == sorted(feature["properties"]["role"] for feature in told)
    assert "<coordinates>" in downloaded(opened, "plan.kml")


# --- other results ----------------------------------------------------------------------------

PLANAR = {
    "bounds": [[0, 0], [1e6, 1e6]],
    "start": [1e5, 1e5],
    "regions": {"a": [[4e5, 4e5], [7e5, 4e5], [5e5, 7e5]]},
    "obstacles": [[[2e5, 3e5], [3e5, 3e5], [3e5, 9e5], [2e5, 9e5]]],
}
WALL = {"obstacles": [[[0, 3e5], [1e6, 3e5], [1e6, 3.5e5], [0, 3.5e5]]]}
FEW = {"planner": {"trees": 1, "n_max": 400}, "deployment": {"runs": 5}, "wind": "calm"}


@pytest.mark.parametrize(
    ("scene", "fidelity"), [(PLANAR, "full"), (PLANAR, "paper"), (PLANAR | WALL, "full")],
    ids=["without a place on Earth", "judged by a bound", "without a plan"],
)  # fmt: skip
def test_results_with_less_have_pages_without_faults(
    scene: dict[str, Any], fidelity: str, browser: Browser, tmp_path: Path
) -> None:
    with suppress(InfeasibleError):
        pareto_ltl.plan(
            scene, "F a", out=tmp_path / "run", fidelity=fidelity, report={"figures": False}, **FEW
        )
    context = browser.new_context(viewport={"width": PHONE[0], "height": PHONE[1]})
    shown = Opened(context.new_page())
    shown.page.on("console", lambda message: shown.said.append(message.text))
    shown.page.on("pageerror", lambda error: shown.said.append(str(error)))
    shown.page.goto((tmp_path / "run" / "report.html").as_uri())
    shown.page.wait_for_selector("html[data-ready=map]")
    for part in shown.value("Object.keys(LATER).filter(id => byId(id))"):
        shown.page.locator(f"#{part}").scroll_into_view_if_needed()
        shown.wait(f"drawn.has('{part}')")
    shown.page.locator("#time").press("End") if shown.page.locator("#time").is_enabled() else None
    assert shown.page.locator("#files a").count() == 0
    assert shown.page.locator("#show-places").count() == bool(
        shown.value("PAGE.places.length + PAGE.pricedObstacles.length")
    )
    assert shown.page.locator("h1").text_content() == "Reach a"
    assert (shown.page.locator("[role=alert]").count() == 1) == (scene is not PLANAR)
    assert shown.value("document.documentElement.scrollWidth <= innerWidth")
    assert shown.said == []
    context.close()


def test_a_printed_page_has_all_charts(browser: Browser, page_result: Path) -> None:
    page = browser.new_page(viewport={"width": DESK[0], "height": DESK[1]})
    page.goto((page_result / "report.html").as_uri())
    page.wait_for_selector("html[data-ready=map]")
    assert page.pdf().startswith(b"%PDF")
    assert page.evaluate("Object.keys(LATER).every(id => drawn.has(id))")
    page.close()


WIDEST = 718  # [px] between the usual margins of a sheet of A4
UNFITTED = """[...document.querySelectorAll('.js-plotly-plot')].filter(chart => {
  const drawn = chart.querySelector('.main-svg').getBoundingClientRect();
  const place = chart.getBoundingClientRect();
  return Math.abs(drawn.width - place.width) > 1 || Math.abs(drawn.height - place.height) > 1;
}).map(chart => chart.id)"""
SIGNS = "[...document.querySelectorAll('.legend .layers')]"
UNSEEN = f"{SIGNS}.filter(sign => sign.getBoundingClientRect().width < 5).length"


def test_charts_on_paper_have_the_size_of_their_places_and_signs_in_their_legends(
    browser: Browser, page_result: Path
) -> None:
    page = browser.new_page(viewport={"width": DESK[0], "height": DESK[1]})
    page.goto((page_result / "report.html").as_uri())
    page.wait_for_selector("html[data-ready=map]")
    width = page.evaluate("byId('map').clientWidth")
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("document.querySelectorAll('.js-plotly-plot').length") == 3
    assert page.evaluate(f"{SIGNS}.length") >= 3
    assert page.evaluate(UNFITTED) == []
    assert page.evaluate(UNSEEN) == 0
    assert page.evaluate("document.body.scrollWidth") <= WIDEST
    assert (
        page.evaluate("getComputedStyle(document.querySelector('.key.region')).printColorAdjust") == "exact"
    )
    page.emulate_media(media="screen")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(UNFITTED) == []
    assert page.evaluate("byId('map').clientWidth") == width
    page.close()
