"""The page of a flight: what it is told, what it refuses, and what a browser shows."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest
from numpy.random import SeedSequence
from playwright.sync_api import Browser, expect

from chromium import launched, needs_chromium, opened_page
from desk import DirectClient
from pareto_ltl_apps.desk.live import LivePage, live_app
from pareto_ltl_apps.flight.telemetry import Reading
from pareto_ltl_apps.flight.watch import Watch, WatchSettings
from watched import DT, PATH, PLAN, PROBLEM, heading_of

TOKEN, PORT = "a-token-of-this-test", 8123
HERE = f"http://127.0.0.1:{PORT}"
BEARER = {"Authorization": f"Bearer {TOKEN}"}
HOSTILE = "<img src=x onerror=alert(1)>"


def watched_page(until: float = 12.5) -> LivePage:
    """A page after some steps of a flight, with a fix that lies and an alarm."""
    page, watch = (
        LivePage(),
        Watch(PROBLEM, PLAN, WatchSettings(every=DT, members=80, alarm=1.0), SeedSequence(1)),
    )
    page.opened(results())
    fixes = {5.0: (*(PATH.x[5] + 100.0), 50.0), 9.0: (*(PATH.x[9] + 9e3), 50.0)}
    readings = []
    for k in range(int(2 * until)):
        x, y, sd = fixes.get(0.5 * k, (None, None, float("nan")))
        heading, airspeed = heading_of(PATH.u[k // 2])
        readings.append(Reading(0.5 * k * DT, heading, airspeed, None if x is None else (x, y), sd))
    for event in watch.events(readings):
        page.heard(watch, event)
    return page


def results(name: str = HOSTILE) -> SimpleNamespace:
    """A plan as results have it, with a hostile name."""
    return SimpleNamespace(
        scene=PROBLEM.scene, plan=replace(PLAN, formula=f"F a {HOSTILE}"), settings=SimpleNamespace(name=name)
    )


@pytest.fixture(scope="module")
def page() -> LivePage:
    return watched_page()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    yield from launched()


def test_the_page_needs_its_token_and_changes_nothing(page: LivePage) -> None:
    client = DirectClient(live_app(page, TOKEN, PORT), HERE)
    for path in ("/", "/api/plan", "/api/state", "/api/state?since=1"):
        assert client.get(path).status_code == 401
        assert client.request("POST", path, headers=BEARER).status_code == 405
    assert client.get("/api/state", headers=BEARER | {"origin": "http://evil.example"}).status_code == 403
    assert client.get("/api/state", headers=BEARER | {"host": "evil.example"}).status_code == 421
    for bad in ("-1", "x", "9" * 30, "%F0%9F%92%A9", "١"):
        assert client.get(f"/api/state?since={bad}", headers=BEARER).status_code == 400
    assert client.get("/desk/live.js").status_code == 200
    assert client.get("/desk/../live.py").status_code in (401, 404)


def test_the_state_is_what_is_new_and_the_rest_of_the_flights(page: LivePage) -> None:
    client = DirectClient(live_app(page, TOKEN, PORT), HERE)
    plan, state = (client.get(path, headers=BEARER).json() for path in ("/api/plan", "/api/state"))
    assert len(plan["line"]) == len(PATH.u) + 1 == len(plan["spread"])
    kinds = [event["event"] for event in state["events"]]
    assert "flown" not in kinds
    assert {"status", "fix", "alarm", "end"} <= set(kinds)
    assert state["next"] == len(kinds)
    assert len(state["rest"]["at"]) == len(state["rest"]["failed"]) > 50
    for since in (0, 3, len(kinds), 10**6):
        later = client.get(f"/api/state?since={since}", headers=BEARER).json()
        assert later["events"] == state["events"][since:]
    json.dumps(state, allow_nan=False)


def test_old_events_are_forgotten_and_keep_their_numbers(
    monkeypatch: pytest.MonkeyPatch, page: LivePage
) -> None:
    monkeypatch.setattr("pareto_ltl_apps.desk.live.MOST", 10)
    small, watch = LivePage(), SimpleNamespace(problem=PROBLEM)
    for number in range(25):
        one = {"event": "alarm", "time": float(number), "text": str(number), "advice": "none"}
        small.heard(watch, one)  # type: ignore[arg-type]
    assert len(small.events) == 10
    for since in (0, 20, 24, 25, 40):
        told = [event["text"] for event in small.state(since)["events"]]
        assert told == [str(number) for number in range(max(since, 15), 25)]


@needs_chromium
def test_a_browser_shows_the_flight_and_no_text_becomes_markup(browser: Browser) -> None:
    page = watched_page()
    address = page.serve(0)
    with opened_page(browser, address, (1280, 800), "flight") as shown:
        assert shown.page.inner_text("#name") == HOSTILE
        assert HOSTILE in shown.page.inner_text("#formula")
        assert shown.page.locator("img").count() == 0
        expect(shown.page.locator("#alarms")).to_contain_text("standard deviations")
        shown.becomes("document.querySelectorAll('#map .mark.used').length", 1)
        shown.becomes("document.querySelectorAll('#map .mark.refused').length", 1)
        shown.wait("document.querySelector('#promise .rate').getTotalLength() > 50")
        shown.wait("document.querySelector('#map .believed').getTotalLength() > 50")
        shown.wait("document.querySelector('#map .ellipse.now') !== null")
        expect(shown.page.locator("#facts .main dd")).to_contain_text("%")
        page.opened(results("another plan"))
        shown.wait("document.getElementById('name').textContent === 'another plan'")


@needs_chromium
def test_the_page_fits_a_phone(browser: Browser) -> None:
    address = watched_page().serve(0)
    with opened_page(browser, address, (390, 844), "flight") as shown:
        assert shown.value("document.documentElement.scrollWidth") <= 390
