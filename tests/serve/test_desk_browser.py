"""The desk in Chromium: a mission from nothing to an exported plan; wide and narrow, light and dark."""

from __future__ import annotations

import html
import json
import random
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Route, expect

from chromium import PAUSE, Opened, launched, needs_chromium, opened_page
from desk import HOP, RunningDesk, running_desk
from geotiffs import WGS84, geotiff
from levels import AT_NIGHT
from quick_wind import wind_words
from wind_files import level_file, stronger

CLICK_ONE = """([dice, left_out]) => {
  const found = [...document.querySelectorAll("button, .point, input[type=checkbox], summary")].filter(
    one => one.getClientRects().length && !one.disabled && !left_out.includes(one.id) && !one.dataset.kind);
  const one = found[Math.floor(dice * found.length)], box = one.getBoundingClientRect();
  const place = { bubbles: true, clientX: box.x + box.width / 2, clientY: box.y + box.height / 2 };
  if (one.click) one.click(); else one.dispatchEvent(new MouseEvent("click", place));
}"""  # of all that can be clicked now
ASK_ELSEWHERE = """([address, mode, headers]) => fetch(address, {
  method: "POST", mode, headers, body: JSON.stringify({ overrides: ["+experiment=hop"] }),
}).then(one => one.type === "opaque" ? "refused" : `answered ${one.status}`).catch(() => "refused")"""
POST_FORM = """address => {
  const form = Object.assign(document.createElement("form"), { method: "POST", action: address });
  document.body.append(form);
  form.submit();
}"""
FRAME = """address => new Promise(loaded => {
  const frame = Object.assign(document.createElement("iframe"), { src: address, onload: loaded });
  document.body.append(frame);
}).then(() => null)"""  # a refused page ends with ``load`` too
FIX_FIELD = "document.querySelector('#editor [data-key=fix]')"
SHOWN = (
    "['features', 'formula'].map(id => document.getElementById(id)).map(one => one.value ?? one.innerText)"
)
WIDE, NARROW = (1280, 800), (400, 850)
CLICKS = 40  # of a random session
FEW_FLIGHTS = (
    "planner.trees=2", "planner.n_max=1500", "refine.flights=60", "refine.sweep_flights=30",
    "refine.points=4", "selection.draws=600", "selection.runs=400", "deployment.runs=100", "report=none",
    *wind_words(),
)  # fmt: skip
NOT_CLICKED = {  # open a dialog of the browser, or take long; links with data-kind download
    "open", "save", "save-kml", "backdrop", "plan", "compare-starts", "show-wind", "find-beacon",
}  # fmt: skip

pytestmark = needs_chromium


class Desk(Opened):
    """A page of the desk."""

    def at(self, u: float, v: float) -> tuple[float, float]:
        """Pixels of a place of the map, as shares of its width and height."""
        self.page.locator("#map").scroll_into_view_if_needed()
        box = self.page.locator("#map").bounding_box()
        assert box is not None
        return box["x"] + u * box["width"], box["y"] + v * box["height"]

    def draw(self, tool: str, *places: tuple[float, float]) -> None:
        self.page.locator(f"[data-tool={tool}]").click()
        for place in places:
            self.page.mouse.click(*self.at(*place))

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        self.page.mouse.move(*begin)
        self.page.mouse.down()
        self.page.mouse.move((begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2)
        self.page.mouse.move(*end)
        self.page.mouse.up()

    def kept(self) -> None:
        """Until the server has the mission as it is shown."""
        self.wait("document.documentElement.dataset.mission === 'kept'")


browser = pytest.fixture(scope="module")(launched)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDesk]:
    with running_desk(tmp_path_factory.mktemp("desk")) as running:
        yield running


def opened_desk(
    browser: Browser, address: str, size: tuple[int, int], scheme: str
) -> AbstractContextManager[Desk]:
    """A new page of the desk, without an error and without requests to others."""
    return opened_page(browser, address, size, "desk", Desk, color_scheme=scheme, accept_downloads=True)


@contextmanager
def served_page() -> Iterator[str]:
    """The address of an empty page of another server of this machine."""

    class Empty(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<body>empty</body>")

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Empty) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def begin_anew(opened: Opened) -> None:
    opened.page.locator("#clear").click()
    for _ in range(2):
        opened.page.locator("#zoom-in").click()
    opened.wait("document.querySelectorAll('#features li').length === 0")


def draw_mission(opened: Opened) -> None:
    """A start, a region with a name in another script, a round one with markup in its name, an obstacle."""
    page = opened.page
    opened.draw("start", (0.2, 0.75))
    opened.draw("region", (0.65, 0.2), (0.8, 0.2), (0.8, 0.35), (0.65, 0.35), (0.65, 0.2))
    page.locator("#editor [data-key=title]").fill("Лес")
    page.locator("#editor [data-key=title]").press("Enter")
    opened.draw("region-circle", (0.7, 0.75), (0.78, 0.75))
    page.locator("#editor [data-key=title]").fill("<b>Hafen</b>")
    page.locator("#editor [data-key=title]").press("Enter")
    opened.draw("obstacle", (0.4, 0.4), (0.5, 0.4), (0.5, 0.6), (0.38, 0.6))
    page.locator("#map").press("Enter")
    opened.drawn()


def small_request(route: Route) -> None:
    """What the page asks for, with a small search and few flights."""
    body = route.request.post_data_json
    if route.request.method != "POST" or body["command"] == "wind":
        return route.continue_()
    return route.continue_(post_data=json.dumps(body | {"overrides": [*FEW_FLIGHTS, *body["overrides"]]}))


def plan_mission(opened: Opened) -> None:
    page = opened.page
    page.route("**/api/plans", small_request)
    page.locator("#robot").select_option("light_aircraft")
    page.locator("#planner").select_option("quick")
    opened.wait("!document.getElementById('plan').disabled")
    page.locator("#plan").click()
    opened.wait("document.querySelector('.vehicle') !== null || !document.getElementById('problem').hidden")
    assert not page.locator("#problem").is_visible(), page.locator("#problem").inner_text()
    opened.wait("document.getElementById('cancel').hidden")


@pytest.mark.parametrize(("size", "scheme"), [(WIDE, "light"), (NARROW, "dark")], ids=["wide", "narrow"])
def test_a_mission_is_drawn_planned_chosen_exported_and_replanned(
    browser: Browser, desk: RunningDesk, size: tuple[int, int], scheme: str, tmp_path: Path
) -> None:
    with opened_desk(browser, desk.address, size, scheme) as opened:
        page = opened.page
        begin_anew(opened)
        draw_mission(opened)
        for name in ("Лес", "<b>Hafen</b>"):
            expect(page.locator("#map .label").get_by_text(name, exact=True)).to_have_count(1)
        opened.wait("document.getElementById('meaning').textContent.startsWith('Reach Лес')")
        plan_mission(opened)
        assert opened.value("document.documentElement.scrollWidth <= innerWidth")

        points = page.locator("#front .point")  # choose
        opened.wait("document.querySelectorAll('#front .point').length > 1")
        path = page.locator("#map .track").get_attribute("d") or ""
        rate = page.locator("#facts").inner_text()
        wanted = 0 if "chosen" not in (points.first.get_attribute("class") or "") else points.count() - 1
        points.nth(wanted).focus()
        points.nth(wanted).press("Enter")
        opened.wait(f"document.getElementById('point-name').textContent.startsWith('Point {wanted} ')")
        expect(page.locator("#map .track")).not_to_have_attribute("d", path)
        opened.wait(f"document.getElementById('facts').innerText !== {json.dumps(rate)}")
        page.locator("#choose").click()
        opened.wait("document.getElementById('directory').textContent.includes('_point_')")
        opened.wait("document.getElementById('cancel').hidden && document.querySelector('.vehicle') !== null")
        expect(page.locator("#point-name")).to_contain_text(f"Point {wanted} of")
        expect(page.locator("#point-name")).to_contain_text("the plan")

        with page.expect_download() as download:  # export
            page.locator("[data-kind=kml]").click()
        assert download.value.suggested_filename == "plan.kml"
        download.value.save_as(tmp_path / "plan.kml")
        assert b"<kml" in (tmp_path / "plan.kml").read_bytes()

        page.locator("#time").focus()  # replan
        for _ in range(3):
            page.keyboard.press("ArrowRight")
        page.locator("#show-fix").click()
        opened.wait("document.querySelector('#map .fix') !== null")
        page.locator("#map").scroll_into_view_if_needed()
        box = page.locator("#map .fix").bounding_box()
        assert box is not None
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        far = size == NARROW  # where no robot that flies this plan can be
        opened.drag(middle, (middle[0] + 3, middle[1] + (25 if far else 2)))
        page.locator("#replan").click()
        opened.wait("document.getElementById('directory').textContent.includes('_replan_')")
        opened.wait(
            "document.getElementById('cancel').hidden && (document.querySelector('.vehicle') !== null "
            "|| !document.getElementById('problem').hidden)"
        )
        said = page.locator("#problem").inner_text() if page.locator("#problem").is_visible() else ""
        assert said.startswith("No failure rate is promised: ") == far, said
        opened.wait(f"{str(not said).lower()} || document.querySelector('#map .track, #map .early') !== null")


def test_points_are_compared_with_flights_beacons_winds_and_starts(
    browser: Browser, desk: RunningDesk
) -> None:
    with opened_desk(browser, desk.address, WIDE, "dark") as opened:
        page = opened.page
        begin_anew(opened)
        draw_mission(opened)
        page.locator("#show-wind").click()  # the wind before a plan, with the departure on a slider
        opened.wait("!document.getElementById('leave-part').hidden")
        barbs = page.locator("#map .wind").inner_html()
        page.locator("#leave").focus()
        for _ in range(20):
            page.keyboard.press("ArrowRight")
        opened.wait("document.getElementById('departure').value === '2018-10-09 10:00'")
        opened.wait(f"document.querySelector('#map .wind').innerHTML !== {json.dumps(barbs)}")
        page.locator(".layers summary").click()
        page.locator("#layer-doubt").check()
        opened.wait("document.querySelectorAll('#map .doubt path').length > 20")
        page.locator("#layer-doubt").uncheck()

        plan_mission(opened)
        page.locator("#layer-flights").check()
        opened.wait("document.querySelectorAll('#map .flight').length === 60")
        page.locator("#pin").click()
        name = page.locator("#point-name").inner_text()
        page.locator("#next" if page.locator("#previous").is_disabled() else "#previous").click()
        opened.wait(f"document.getElementById('point-name').textContent !== {name!r}")
        opened.wait("document.querySelectorAll('#comparison tbody tr').length === 4")
        page.locator("#find-limits").click()
        opened.wait("document.querySelector('#limits h3') !== null")
        page.locator("#pin").click()  # two are kept, with their paths
        opened.wait("document.querySelectorAll('#map .track.pinned').length === 2")
        page.locator("#pin").click()
        opened.wait("document.querySelectorAll('#map .track.pinned').length === 1")
        page.locator("#find-beacon").click()
        opened.wait("document.querySelectorAll('#map .beacon').length > 50")
        expect(page.locator("#beacon-said")).to_contain_text("without a further beacon")

        page.locator("#starts-part summary").click()
        page.locator("#latest").fill("2018-10-09 13:00")
        page.locator("#every").fill("3")
        page.locator("#compare-starts").click()
        opened.wait("document.querySelectorAll('.start-column').length === 2")
        page.locator(".start-column").nth(1).click()
        expect(page.locator("#departure")).to_have_value("2018-10-09 13:00")


def test_the_wind_at_the_pointer_is_drawn_against_height_and_time(
    browser: Browser, desk: RunningDesk, tmp_path: Path
) -> None:
    said, dots = "document.getElementById('profile-said').textContent", "#profile-heights .dot"
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        page = opened.page
        begin_anew(opened)
        expect(page.locator("#profile-part")).to_be_hidden()
        draw_mission(opened)
        page.locator("#wind-file").set_input_files(level_file(tmp_path / "levels.nc"))
        expect(page.locator("#wind-note")).to_contain_text("levels.nc")
        page.locator("details:has(#settings) summary").click()
        page.locator("#settings").fill(" ".join(["robot.level=925hPa", *wind_words()]))
        page.locator("#settings").press("Tab")
        page.locator("#show-wind").click()
        expect(page.locator("#profile-part")).to_be_visible()
        page.locator("#profile-part summary").press("Enter")  # with the keyboard
        expect(page.locator(dots)).to_have_count(3)
        expect(page.locator("#profile-times .curve")).to_have_count(1)
        expect(page.locator("#profile-heights text.flown").first).to_have_text("925 hPa")
        told = opened.value(said)
        knots = float(re.search(r"925hPa: ([0-9.]+) kt from", told)[1])
        page.mouse.move(*opened.at(0.3, 0.4))
        opened.wait(f"{said} !== {json.dumps(told)}")
        there = opened.value(said)
        page.locator("#map").focus()
        for _ in range(3):
            page.keyboard.press("ArrowDown")  # the place is the middle of the map
        opened.wait(f"{said} !== {json.dumps(there)}")
        for _ in range(3):
            page.keyboard.press("ArrowUp")
        opened.becomes(said, told)
        page.locator("#profile-unit").select_option("m/s")
        opened.wait(f"{said}.includes('m/s from')")
        metres = float(re.search(r"925hPa: ([0-9.]+) m/s from", opened.value(said))[1])
        assert metres == pytest.approx(knots * 1852 / 3600, abs=0.11)
        heights = page.locator("#profile-heights").get_attribute("aria-label")
        read = float(re.search(r"925hPa, of the plan: ([0-9.]+) m/s", heights)[1])
        assert read == pytest.approx(metres, abs=0.5)  # the fit is near to what the file has there
        lowest = float(re.search(r"1000hPa: ([0-9.]+) m/s", heights)[1])
        assert read == pytest.approx(stronger(925.0) * lowest, rel=0.02)


def test_a_wind_of_one_level_says_so(browser: Browser, desk: RunningDesk) -> None:
    with opened_desk(browser, desk.address, NARROW, "dark") as opened:
        begin_anew(opened)
        draw_mission(opened)
        opened.page.locator("#show-wind").click()
        opened.page.locator("#profile-part summary").click()
        expect(opened.page.locator("#profile-levels")).to_contain_text("known at one level")
        expect(opened.page.locator("#profile-heights")).to_be_hidden()
        expect(opened.page.locator("#profile-times .curve")).to_have_count(1)


def test_a_finished_plan_is_opened_without_its_past(browser: Browser, desk: RunningDesk) -> None:
    """Nothing says that it is still made, and a fix can be placed when its path is there."""
    name = desk.planned(overrides=HOP)["id"]
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        held: list[Route] = []

        def hold(route: Route) -> None:
            held.append(route)

        opened.page.route(f"**/api/plans/{name}/front", hold)
        opened.page.locator("#earlier-part").evaluate("part => { part.open = true; }")
        opened.page.locator("#earlier button").first.click()
        opened.wait("!document.getElementById('progress').hidden")
        while not held:
            opened.page.wait_for_timeout(PAUSE)
        expect(opened.page.locator("#state")).to_have_text("Opening the result…")
        expect(opened.page.locator("#cancel")).to_be_hidden()
        opened.value("document.getElementById('show-fix').click()")  # hidden and disabled: it does nothing
        assert opened.value("document.getElementById('show-fix').disabled")
        held[0].continue_()
        opened.wait("document.querySelector('#map .track') !== null")
        opened.wait("!document.getElementById('show-fix').disabled")
        opened.page.locator("#show-fix").click()
        opened.wait("document.querySelector('#map .fix') !== null")


def test_the_mission_is_saved_and_opened_and_survives_a_reload(
    browser: Browser, desk: RunningDesk, tmp_path: Path
) -> None:
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        page = opened.page
        begin_anew(opened)
        draw_mission(opened)
        opened.wait("document.getElementById('formula').value !== ''")
        formula, names = page.locator("#formula").input_value(), page.locator("#features").inner_text()
        for button, name in (("#save", "mission.geojson"), ("#save-kml", "mission.kml")):
            with page.expect_download() as download:
                page.locator(button).click()
            download.value.save_as(tmp_path / name)
        coast = {"type": "LineString", "coordinates": [[-179, -80], [179, 80]]}
        (tmp_path / "coast.json").write_text(json.dumps(coast), encoding="utf-8")
        page.locator("#backdrop-file").set_input_files(tmp_path / "coast.json")
        opened.wait("document.querySelector('#map .backdrop') !== null")
        opened.kept()
        page.reload()
        page.wait_for_selector("html[data-ready=desk]")
        opened.becomes("document.getElementById('features').innerText", names)
        opened.wait("document.querySelector('#map .backdrop') !== null")
        content = geotiff(np.zeros((90, 90), np.uint8), WGS84, (-100.0, 45.0), 0.2)
        (tmp_path / "chart.tif").write_bytes(content)
        page.locator("#backdrop-file").set_input_files(tmp_path / "chart.tif")
        opened.wait("document.querySelector('#map image') !== null")
        for name in ("mission.geojson", "mission.kml"):
            begin_anew(opened)
            page.locator("#file").set_input_files(tmp_path / name)
            opened.wait("document.querySelectorAll('#features li').length === 4")
            opened.wait(f"document.getElementById('formula').value === {json.dumps(formula)}")
            expect(page.locator("#map .label").get_by_text("Лес", exact=True)).to_have_count(1)


def test_faults_are_said_in_the_page(browser: Browser, desk: RunningDesk) -> None:
    with opened_desk(browser, desk.address, WIDE, "dark") as opened:
        page = opened.page
        begin_anew(opened)
        expect(page.locator("#plan")).to_be_disabled()
        opened.draw("region", (0.6, 0.2), (0.8, 0.4), (0.8, 0.2), (0.6, 0.4), (0.6, 0.2))  # crosses itself
        expect(page.locator("#hint")).to_contain_text("crosses itself")
        page.keyboard.press("Escape")
        draw_mission(opened)
        page.locator("#formula").fill("F(a & )")
        opened.wait("document.querySelector('#meaning mark') !== null")
        expect(page.locator("#plan")).to_be_disabled()
        page.locator("#formula").fill("F nowhere")
        opened.wait("document.getElementById('meaning').textContent.includes('nowhere')")
        page.locator("#formula").fill("F a")
        page.locator("#departure").fill("2031-01-01 00:00")  # no wind then
        opened.wait("!document.getElementById('plan').disabled")
        page.locator("#plan").click()
        opened.wait("!document.getElementById('problem').hidden")
        expect(page.locator("#problem")).to_contain_text("2031")
        page.locator("#departure").fill("")
        opened.draw(
            "obstacle", (0.7, 0.15), (0.9, 0.15), (0.9, 0.3), (0.7, 0.3), (0.7, 0.15)
        )  # over a region
        page.locator("#plan").click()
        opened.wait("document.querySelector('#map .spot') !== null")  # where it is
        expect(page.locator("#problem")).to_have_text(re.compile("^Obstacle 2 overlaps region"))
        expect(page.locator("#features li")).to_have_count(5)


def test_a_landmark_has_the_error_of_its_fixes(browser: Browser, desk: RunningDesk, tmp_path: Path) -> None:
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        page = opened.page
        begin_anew(opened)
        ring = [[-96, 38], [-95, 38], [-95, 38.3], [-96, 38.3], [-96, 38]]
        coast = {
            "type": "Feature",
            "properties": {"role": "landmark", "fix": {"across": 50, "along": 20000}},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        (tmp_path / "coast.geojson").write_text(
            json.dumps({"type": "FeatureCollection", "features": [coast]}), encoding="utf-8"
        )
        page.locator("#file").set_input_files(tmp_path / "coast.geojson")
        opened.wait("document.querySelectorAll('#features li').length === 1")
        page.locator("#features button").first.click()
        error = page.locator("#editor [data-key=fix]")
        expect(error).to_have_value("20000 m along, 50 m across")
        for written, expected in (
            ("50 m", {"sd": 50}),
            ("0.2 km along, 30 m across, -40°", {"along": 200, "across": 30, "bearing": -40}),
            ("30 m across, 1 nmi", {"across": 30, "sd": 1852}),
        ):
            error.fill(written)
            error.press("Enter")
            for button, name in (("#save", "saved.geojson"), ("#save-kml", "saved.kml")):
                with page.expect_download() as download:
                    page.locator(button).click()
                download.value.save_as(tmp_path / name)
            (feature,) = json.loads((tmp_path / "saved.geojson").read_text(encoding="utf-8"))["features"]
            assert feature["properties"]["fix"] == expected
            (value,) = re.findall(
                'name="fix"><value>(.*?)</value>', (tmp_path / "saved.kml").read_text("utf-8")
            )
            assert json.loads(html.unescape(value)) == expected
        for wrong in ("fast", "50 m along", "1 m, 2 m", "50 m, 1 m along, 2 m across", "5 m, 400°", "-3 m"):
            error.fill(wrong)
            error.press("Enter")
            opened.wait(f"{FIX_FIELD}.value === {json.dumps(wrong)}")
            opened.wait(f"{FIX_FIELD}.validationMessage.includes('expected e.g. 50 m')")


def test_a_server_that_has_gone_is_said_and_the_mission_is_kept(browser: Browser, tmp_path: Path) -> None:
    with running_desk(tmp_path) as gone, opened_desk(browser, gone.address, NARROW, "light") as opened:
        begin_anew(opened)
        draw_mission(opened)
        opened.kept()
        gone.process.kill()
        gone.process.wait()
        opened.page.locator("#pattern").select_option("coverage")
        opened.wait("!document.getElementById('problem').hidden")
        expect(opened.page.locator("#problem")).to_contain_text("start pareto-ltl serve again")
        expect(opened.page.locator("#features li")).to_have_count(4)
        assert all("net::ERR_" in text for text in opened.said)  # refused, or cut off
        opened.said.clear()
    with running_desk(tmp_path) as again, opened_desk(browser, again.address, NARROW, "light") as opened:
        expect(opened.page.locator("#features li")).to_have_count(4)


def test_features_of_a_text_join_what_is_drawn(browser: Browser, desk: RunningDesk) -> None:
    area = [[[-92.5, 37.0], [-92.3, 37.0], [-92.3, 37.2], [-92.5, 37.0]]]
    texts = {
        "start": json.dumps({"type": "Point", "coordinates": [-92.4, 36.8]}),
        "region": json.dumps({"type": "Polygon", "coordinates": area}),
        "obstacle": "<kml><Document><Placemark><name>Røst</name><ExtendedData><Data name='buffer'><value>900"
        "</value></Data></ExtendedData><Point><coordinates>-92.1,37.1</coordinates></Point></Placemark>"
        "</Document></kml>",
    }
    with opened_desk(browser, desk.address, NARROW, "light") as opened:
        page = opened.page
        begin_anew(opened)
        for number, (role, text) in enumerate(texts.items(), 1):
            page.locator("#import-part summary").click()
            page.locator("#import-role").select_option(role)
            page.locator("#paste").fill(text)
            page.locator("#import-text").click()
            opened.wait(f"document.querySelectorAll('#features li').length === {number}")
        assert page.locator("#features").inner_text().split("\n")[::2][1:] == ["area 1 (area_1)", "Røst"]
        opened.kept()
        kept = desk.client.get("/api/mission").json()["mission"]
        assert [(one["role"], one["buffer"]) for one in kept["features"]] == [
            ("start", ""), ("region", ""), ("obstacle", "900 m"),
        ]  # fmt: skip
        assert kept["goals"] == ["area_1"]
        page.locator("#import-part summary").click()
        page.locator("#paste").fill("not a map")
        page.locator("#import-text").click()
        opened.wait("!document.getElementById('problem').hidden")
        assert len(desk.client.get("/api/mission").json()["mission"]["features"]) == 3
        assert all("400 (Bad Request)" in text for text in opened.said)
        opened.said.clear()


def test_other_settings_reach_the_command_line(browser: Browser, desk: RunningDesk) -> None:
    with opened_desk(browser, desk.address, NARROW, "light") as opened:
        page = opened.page
        begin_anew(opened)
        draw_mission(opened)
        page.locator("details:has(#settings) summary").click()
        page.locator("#settings").fill("planner.epsilon=7 report=none")
        page.locator("#settings").press("Tab")
        opened.wait("!document.getElementById('plan').disabled")
        page.locator("#plan").click()
        opened.wait("!document.getElementById('problem').hidden")
        expect(page.locator("#problem")).to_contain_text("planner.epsilon")
        assert all("400 (Bad Request)" in text for text in opened.said)  # refused before a plan is begun
        opened.said.clear()


def test_a_page_of_another_server_cannot_use_the_desk(browser: Browser, desk: RunningDesk) -> None:
    base, _, token = desk.address.partition("/?token=")
    before = desk.client.get("/api/plans").json()
    with served_page() as other, browser.new_context() as context:
        page = context.new_page()
        page.goto(other)
        for headers in ({}, {"Authorization": f"Bearer {token}"}):
            for mode in ("cors", "no-cors"):
                assert page.evaluate(ASK_ELSEWHERE, [f"{base}/api/plans", mode, headers]) == "refused"
        with page.expect_navigation():
            page.evaluate(POST_FORM, desk.address)
        expect(page.locator("body")).to_contain_text("refused")
        page.goto(other)
        page.evaluate(FRAME, desk.address)  # frame-ancestors 'none'
        assert len(page.frames) == 2
        assert all("Planning desk" not in frame.content() for frame in page.frames[1:])
    assert desk.client.get("/api/plans").json() == before


def test_a_second_tab_says_that_the_first_has_changed_the_mission(
    browser: Browser, desk: RunningDesk
) -> None:
    with opened_desk(browser, desk.address, WIDE, "light") as first:
        begin_anew(first)
        first.kept()
        context = first.page.context
        second = context.new_page()
        second.goto(desk.address)
        second.wait_for_selector("html[data-ready=desk]")
        second.locator("#pattern").select_option("coverage")
        Desk(second, desk.address).kept()
        first.page.locator("#pattern").select_option("patrol")
        first.wait("!document.getElementById('problem').hidden")
        expect(first.page.locator("#problem")).to_contain_text("another tab")
        assert any("409" in text for text in first.said)
        first.said.clear()  # the browser logs the refused request


def test_a_plan_goes_on_while_the_browser_is_closed(browser: Browser, desk: RunningDesk) -> None:
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        begin_anew(opened)
        draw_mission(opened)
        opened.page.route("**/api/plans", small_request)
        opened.page.locator("#robot").select_option("light_aircraft")
        opened.wait("!document.getElementById('plan').disabled")
        opened.page.locator("#plan").click()
        opened.wait("document.querySelectorAll('#front .point').length > 0")
        opened.kept()
    with opened_desk(browser, desk.address, NARROW, "dark") as again:
        again.wait("document.querySelector('.vehicle') !== null")
        expect(again.page.locator("#problem")).to_be_hidden()


def random_click(opened: Desk, dice: random.Random) -> None:
    """A click on the map, a button, a layer or a box to tick; a key; a choice; some letters of a formula."""
    page, kind = opened.page, dice.random()
    if kind < 0.45:
        page.mouse.click(*opened.at(dice.uniform(0.02, 0.8), dice.uniform(0.02, 0.85)))
    elif kind < 0.75:
        page.evaluate(CLICK_ONE, [dice.random(), sorted(NOT_CLICKED)])
    elif kind < 0.85:
        page.keyboard.press(dice.choice(["Escape", "Enter", "Delete", "Control+z", "Control+y", "+", "-"]))
    elif kind < 0.93:
        chosen = page.locator(dice.choice(["#pattern", "#robot", "#planner"]))
        chosen.select_option(index=dice.randrange(chosen.locator("option").count()))
    else:
        page.locator("#formula").fill(dice.choice(["F a", "F(a & )", "G !b", "", "<b>", "F(a & F b)"]))


@pytest.fixture(scope="module")
def planned(desk: RunningDesk) -> dict[str, Any]:
    """The first plan in the folder of the desk."""
    return desk.planned(overrides=HOP)


def test_an_earlier_plan_is_removed_once_it_is_confirmed(browser: Browser, desk: RunningDesk) -> None:
    kept, other = desk.planned(overrides=HOP), desk.planned(overrides=HOP)
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        page, answers = opened.page, [False, True]
        page.on("dialog", lambda dialog: dialog.accept() if answers.pop(0) else dialog.dismiss())
        page.locator("#earlier-part").evaluate("part => { part.open = true; }")
        rows = page.locator("#earlier li")
        expect(rows.nth(1)).to_be_visible()
        before = rows.count()
        rows.nth(1).get_by_role("button").first.click()  # the newest is the first
        opened.wait("document.querySelector('.vehicle') !== null")
        rows.nth(1).locator(".remove").click()
        expect(page.locator("#removed")).to_contain_text("open another one first")
        rows.first.locator(".remove").click()
        expect(rows).to_have_count(before)
        rows.first.locator(".remove").click()
        expect(rows).to_have_count(before - 1)
        expect(page.locator("#removed")).to_contain_text(other["id"])
    assert Path(kept["directory"]).exists()
    assert not Path(other["directory"]).exists()


@pytest.mark.parametrize("seed", range(100 if AT_NIGHT else 4))
@pytest.mark.usefixtures("planned")
def test_random_clicks_leave_no_error(browser: Browser, desk: RunningDesk, seed: int) -> None:
    dice = random.Random(seed)
    with opened_desk(browser, desk.address, (WIDE, NARROW)[seed % 2], ("light", "dark")[seed % 2]) as opened:
        page = opened.page
        begin_anew(opened)
        if seed % 4 > 1:  # with a plan
            page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
            page.locator("#earlier li", has_text="done").last.locator("button").first.click()
            opened.wait("document.querySelector('.vehicle') !== null")
        for _ in range(CLICKS):
            random_click(opened, dice)
        opened.wait("document.getElementById('cancel').hidden")  # what was chosen or planned again
        page.keyboard.press("Escape")
        opened.kept()
        kept = desk.client.get("/api/mission").json()["mission"]
        shown = opened.value(SHOWN)
        page.reload()
        page.wait_for_selector("html[data-ready=desk]")
        opened.becomes(SHOWN, shown)
        opened.kept()
        assert desk.client.get("/api/mission").json()["mission"] == kept


@pytest.mark.usefixtures("planned")
def test_a_point_is_kept_for_comparison_once_its_path_is_there(browser: Browser, desk: RunningDesk) -> None:
    with opened_desk(browser, desk.address, WIDE, "light") as opened:
        page, held, waits = opened.page, list[Any](), [True]
        page.route(re.compile("/points/"), lambda route: held.append(route) if waits else route.continue_())
        page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        page.locator("#earlier li", has_text="done").last.locator("button").first.click()
        opened.wait("document.querySelectorAll('#front .point').length > 0")
        opened.wait("document.getElementById('pin').getClientRects().length > 0")
        page.evaluate("document.getElementById('pin').click()")
        waits.clear()
        for route in held:
            route.continue_()
        opened.wait("document.querySelector('.vehicle') !== null")
        page.locator("#pin").click()
        expect(page.locator("#comparison")).to_contain_text("Kept for comparison")
