"""The page in Chromium: what is chosen, moved and played, on a desk and on a phone, without a network."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import gpxpy
import numpy as np
import pytest
from fastkml.validator import validate
from playwright.sync_api import Browser, expect

import pareto_ltl
from chromium import PAUSE, Opened, launched, needs_chromium, opened_page
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import InfeasibleError
from quick_plan import QUICK_SEARCH

DESK, PHONE = (1440, 900), (390, 844)

pytestmark = needs_chromium


browser = pytest.fixture(scope="module")(launched)


@pytest.fixture(scope="module", params=[DESK, PHONE], ids=["desk", "phone"])
def opened(request: pytest.FixtureRequest, browser: Browser, page_result: Path) -> Iterator[Opened]:
    """The page at one width; each test leaves it as it likes."""
    address = (page_result / "report.html").as_uri()
    with opened_page(browser, address, request.param, "page", has_touch=request.param == PHONE) as shown:
        yield shown


def drawn(opened: Opened, kind: str) -> list[str]:
    """The outlines of all shapes of a class on the map, once it is drawn."""
    opened.wait("!map.waiting")
    script = "e => e.getAttribute('d') ?? [e.getAttribute('cx'), e.getAttribute('cy')].join()"
    return list(opened.value(f"[...document.querySelectorAll('#map {kind}')].map({script})"))


def test_the_first_view_is_the_chosen_plan(opened: Opened, page_result: Path) -> None:
    plan = Run.open(page_result).plan
    scene = Run.open(page_result).scene
    assert scene.crs is not None
    x = scene.frame.to_plane(*np.array(opened.value("path().line")).T)
    assert np.abs(x - plan.path.x).max() < 1.0
    assert drawn(opened, ".track") == [opened.value("map.line(path().line)")]
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
    wanted = opened.value("PAGE.chosen === 0 ? PAGE.points.length - 1 : 0")
    opened.page.locator(f"#front [data-point='{wanted}'] circle").click(force=True)
    opened.wait(f"shown.point === {wanted}")
    expect(opened.page.locator("#point")).to_have_value(str(wanted))
    assert drawn(opened, ".track") == [opened.value(f"map.line(PAGE.paths[{wanted}].line)")]
    assert opened.page.locator("#front .point.shown").get_attribute("data-point") == str(wanted)
    assert f"--point {wanted}" in (opened.page.locator("#export-command").text_content() or "")
    opened.page.locator("#home").click()
    opened.wait("shown.point === PAGE.chosen")


def test_points_are_chosen_with_the_keyboard(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    last = opened.value("PAGE.points.length - 1")
    opened.page.locator("#point").focus()
    opened.page.keyboard.press("End")
    opened.wait(f"shown.point === {last}")
    expect(opened.page.locator("#next")).to_be_disabled()
    opened.page.locator("#previous").press("Enter")
    opened.wait(f"shown.point === {last - 1}")
    opened.page.locator("#home").press("Space") if opened.value("shown.point !== PAGE.chosen") else None
    opened.wait("shown.point === PAGE.chosen")


def test_the_slider_moves_robot_wind_flights_risk_and_automaton(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen); player.go(0)")
    kinds = (".vehicle", ".speed", ".flight")
    before = {kind: drawn(opened, kind) for kind in kinds}
    now = opened.page.locator("#risk .now").get_attribute("d") or ""
    clock = opened.page.locator("#clock").text_content() or ""
    opened.page.locator("#time").focus()
    for _ in range(3):
        opened.page.keyboard.press("ArrowRight")
    opened.becomes("shown.step", 3)
    assert all(drawn(opened, kind) != shapes for kind, shapes in before.items())
    expect(opened.page.locator("#clock")).not_to_have_text(clock)
    opened.page.keyboard.press("End")
    opened.wait("shown.step === path().line.length - 1")
    expect(opened.page.locator("#risk .now")).not_to_have_attribute("d", now)
    end = opened.value("path().q.at(-1)")
    expect(opened.page.locator("#machine .state.now")).to_have_attribute("data-state", str(end))
    expect(opened.page.locator("#progress .now")).to_contain_text("mission complete")


def test_speeds_of_a_glider_have_two_decimals(opened: Opened) -> None:
    assert opened.value("speedTexts(0.35, 0.124, 0.01).join()") == "0.35,0.12,0.01"
    assert opened.value("speedTexts(20, 5.26, 0.5).join()") == "20.0,5.3,0.5"


def test_the_flight_plays_pauses_and_ends(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen); player.go(0)")
    play = opened.page.locator("#play")
    play.click()
    expect(play).to_have_attribute("aria-label", "pause")
    opened.wait("shown.step >= 2")
    play.press("Space")
    expect(play).to_have_attribute("aria-label", "play")
    stopped = opened.value("shown.step")
    opened.page.wait_for_timeout(400)
    assert opened.value("shown.step") == stopped
    opened.value("player.go(path().line.length - 2)")
    play.click()
    opened.wait("player.timer === null && shown.step === path().line.length - 1")


def test_failed_flights_have_another_colour_and_another_line(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen); player.go(path().line.length - 1)")
    drawn(opened, ".flight")
    looks = [
        opened.value(
            f"(({{ stroke, strokeDasharray }}) => [stroke, strokeDasharray])(getComputedStyle({one}))"
        )
        for one in ("document.querySelector('.trail')", "document.querySelector('.trail.lost')")
    ]
    assert looks[0][0] != looks[1][0]
    assert looks[0][1] == "none"
    assert looks[1][1] != "none"
    assert len(drawn(opened, ".flight.lost")) == opened.value(
        "PAGE.flights.failed.filter(k => k >= 0).length"
    )


def test_layers_are_switched_off_and_on(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    for name, kind in (
        ("wind", ".speed"), ("doubt", ".doubt path"), ("ellipses", ".ellipse"), ("flights", ".trail"),
        ("others", ".others"),
    ):  # fmt: skip
        box = opened.page.locator(f"#layer-{name}")
        begun = box.is_checked()
        box.uncheck()
        assert drawn(opened, kind) == []
        box.check()
        assert drawn(opened, kind) != []
        box.set_checked(begun)


def test_tight_places_belong_to_the_chosen_plan_and_can_be_hidden(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    places = opened.value("PAGE.places")
    assert places
    wanted = opened.value("PAGE.places.map(({ step }) => map.line(path().line.slice(step, step + 2)))")
    assert drawn(opened, ".place") == wanted
    reasons = opened.page.locator("#map .place title").all_text_contents()
    assert reasons == ["\n".join(place["lines"]) for place in places]
    numbers = [int(text) for text in opened.page.locator("#map .number").all_text_contents()]
    assert numbers == opened.value("PAGE.pricedObstacles")
    opened.value("showPoint(PAGE.chosen === 0 ? 1 : 0)")
    assert drawn(opened, ".place") == drawn(opened, ".number") == []
    opened.value("showPoint(PAGE.chosen)")
    assert drawn(opened, ".place") == wanted
    opened.page.locator("#layer-places").uncheck()
    assert drawn(opened, ".place") == []
    opened.page.locator("#layer-places").check()
    assert drawn(opened, ".place") == wanted


HOSTILE = "<img src=x onerror=alert(1)>"
SPOT = """(() => {
  const box = byId('map').getBoundingClientRect(), [x, y] = map.at(path().line[PAGE.places[0].step]);
  return [box.x + x, box.y + y];
})()"""


def test_a_click_on_a_tight_place_goes_to_its_step_and_its_text_is_no_markup(opened: Opened) -> None:
    opened.value("showPoint(PAGE.chosen)")
    step = opened.value("PAGE.places[0].step")
    opened.value(f'PAGE.places[0].lines.push("{HOSTILE}"); map.refresh()')
    drawn(opened, ".place")
    assert HOSTILE in (opened.page.locator("#map .place title").first.text_content() or "")
    assert opened.page.locator("img").count() == 0
    opened.page.locator("#map").scroll_into_view_if_needed()
    opened.page.mouse.click(*opened.value(SPOT))
    opened.wait(f"shown.step === {step}")
    opened.value("PAGE.places[0].lines.pop(); map.refresh()")


def test_the_map_moves_and_zooms_and_the_wheel_scrolls_the_page(opened: Opened) -> None:
    opened.page.locator("#fit").click()
    opened.wait("!map.waiting")
    whole = opened.value("map.scale")
    opened.page.locator("#zoom-in").click()
    opened.becomes("map.scale", pytest.approx(1.5 * whole))
    opened.page.locator("#map").focus()
    middle = opened.value("map.middle")
    opened.page.keyboard.press("ArrowRight")
    opened.wait(f"map.middle.join() !== {middle}.join()")
    scale = opened.value("map.scale")
    opened.page.locator("#map").hover()
    opened.page.mouse.wheel(0, 200)
    opened.page.wait_for_timeout(2 * PAUSE)
    assert opened.value("map.scale") == scale
    opened.page.locator("#fit").click()
    opened.becomes("map.scale", pytest.approx(whole))


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
    drawn, place = downloaded(opened, "plan.kml"), tmp_path / "page.kml"
    place.write_text(drawn, encoding="utf-8")
    assert validate(file_to_validate=place)  # against the OGC schema
    used = set(re.findall("<styleUrl>#(.*?)</styleUrl>", drawn))
    assert {"route", "region", "obstacle", "bounds"} <= used <= set(re.findall('<Style id="(.*?)">', drawn))
    sentences = [
        re.sub(r"[\d.,]*\d", "N", sentence)  # the exported rate is that of other flights
        for text in (drawn, (tmp_path / "plan.kml").read_text())
        for sentence in re.findall(r"Of [\d,]+ flights flown by heading .*? fail\.", text)
    ]
    assert sentences == 2 * [
        "Of N flights flown by heading and airspeed in coherent winds, N % (N %: N to N %) fail."
    ]
    assert "<opencpn:planned_departure>" in downloaded(opened, "plan.gpx")


# --- other results ----------------------------------------------------------------------------

PLANAR = {
    "bounds": [[0, 0], [1e6, 1e6]],
    "start": [1e5, 1e5],
    "regions": {"a": [[4e5, 4e5], [7e5, 4e5], [5e5, 7e5]]},
    "obstacles": [[[2e5, 3e5], [3e5, 3e5], [3e5, 9e5], [2e5, 9e5]]],
}
WALL = {"obstacles": [[[0, 3e5], [1e6, 3e5], [1e6, 3.5e5], [0, 3.5e5]]]}
FEW: dict[str, Any] = {
    "planner": {"trees": 1, "n_max": 400}, "deployment": {"runs": 5}, "wind": "calm", **QUICK_SEARCH,
}  # fmt: skip


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
    address = (tmp_path / "run" / "report.html").as_uri()
    with opened_page(browser, address, PHONE, "page") as shown:
        shown.page.locator("#time").press("End") if shown.page.locator("#time").is_enabled() else None
        shown.drawn()
        assert shown.page.locator("#files a").count() == 0
        assert shown.page.locator("#layer-places").count() == bool(
            shown.value("PAGE.places.length + PAGE.pricedObstacles.length")
        )
        assert shown.page.locator("h1").text_content() == "Reach a"
        assert (shown.page.locator("[role=alert]").count() == 1) == (scene is not PLANAR)
        assert shown.value("document.documentElement.scrollWidth <= innerWidth")


WIDEST = 718  # [px] between the usual margins of a sheet of A4
UNFITTED = """[...document.querySelectorAll('#map, #front, #risk')].filter(chart => {
  const [, , width, height] = chart.getAttribute('viewBox').split(' ').map(Number);
  const off = Math.max(Math.abs(width - chart.clientWidth), Math.abs(height - chart.clientHeight));
  return off > 1 || !chart.children.length;
}).map(chart => chart.id)"""


def test_charts_on_paper_have_the_size_of_their_places(browser: Browser, page_result: Path) -> None:
    page = browser.new_page(viewport={"width": DESK[0], "height": DESK[1]})
    page.goto((page_result / "report.html").as_uri())
    page.wait_for_selector("html[data-ready=page]")
    sheet = page.pdf(format="A4", margin=dict.fromkeys(("top", "bottom", "left", "right"), "1cm"))
    assert len(re.findall(rb"/Type\s*/Page\b", sheet)) == 1
    width = page.evaluate("byId('map').clientWidth")
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(UNFITTED) == []
    assert page.evaluate("document.body.scrollWidth") <= WIDEST
    assert (
        page.evaluate("getComputedStyle(document.querySelector('.key.region')).printColorAdjust") == "exact"
    )
    page.emulate_media(media="screen")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(UNFITTED) == []
    assert page.evaluate("byId('map').clientWidth") == width
    page.close()
