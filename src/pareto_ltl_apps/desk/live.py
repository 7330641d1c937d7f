"""The page of a flight that is being watched (``pareto-ltl follow --page``), on the loopback address.

It has the map and the guard of the desk. The browser asks for what is new; nothing can be changed from it.
"""

from __future__ import annotations

import math
import threading
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from pareto_ltl import Scene
from pareto_ltl_apps.desk.app import page_routes
from pareto_ltl_apps.desk.server import Guard, loopback_server
from pareto_ltl_apps.flight.lines import event_line
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.watch import Watch
from pareto_ltl_apps.view.page.ground import map_places, north_turn, shown_map
from pareto_ltl_apps.view.page.points import plan_spread

if TYPE_CHECKING:
    from pareto_ltl import Run

PAGE = "pareto_ltl_apps.desk.live_page"
MOST = 5000  # the newest events, which are sent to the page
SHOWN = (
    "event", "time", "failure", "low", "high", "flights", "promised", "corridor", "goal", "goal_time", "end",
    "wind", "wind_from", "wind_sd", "law", "energy", "energy_needed", "battery", "kind", "text", "use",
)  # fmt: skip


class LivePage:
    """What the page shows; :meth:`heard` is a listener of a watch."""

    def __init__(self) -> None:
        self.plan: dict[str, Any] = {}
        self.events: list[dict[str, Any]] = []
        self.reported = 0  # all events so far; the first of ``events`` has the number reported - len(events)
        self.rest: dict[str, Any] = {"at": [], "failed": []}
        self.lock = threading.Lock()

    def opened(self, results: Run) -> None:
        """Show a plan from now on."""
        scene, plan = results.scene, results.plan
        shown = {
            "name": results.settings.name, "formula": plan.formula, "map": shown_map(scene),
            "t": plan.path.t.tolist(), "line": map_places(scene, plan.path.x),
            "spread": plan_spread(scene, plan.path), "notCovered": plan.not_covered,
        }  # fmt: skip
        with self.lock:
            self.plan, self.rest = shown | {"number": self.reported}, {"at": [], "failed": []}

    def heard(self, watch: Watch, event: Event) -> tuple[Event, ...]:
        """Keep what the page shows of ``event``; returns no events."""
        if event["event"] == "flown":
            return ()
        scene = watch.problem.scene
        shown = {key: event[key] for key in SHOWN if key in event} | {"line": event_line(event)}
        if event["event"] in ("status", "end"):
            shown |= _believed(scene, event)
            lines, failed = watch.rest
            self.rest = {"at": map_places(scene, lines), "failed": failed.tolist()}
        elif event["event"] == "fix":
            shown["place"] = map_places(scene, np.array(event["place"]))
        with self.lock:
            self.events, self.reported = [*self.events[1 - MOST :], shown], self.reported + 1
        return ()

    def state(self, since: int) -> dict[str, Any]:
        """The events from the number ``since`` on, and the flights of the rest."""
        with self.lock:
            first = max(since, self.reported - len(self.events))
            new = self.events[len(self.events) - (self.reported - first) :] if first < self.reported else []
            return {
                "plan": self.plan.get("number", 0),
                "next": self.reported,
                "events": new,
                "rest": self.rest,
            }

    def serve(self, port: int) -> str:
        """Serve the page in a thread until the process ends; returns its address with the token.

        Raises
        ------
        ConfigError
            If the port is taken.
        """
        page = loopback_server(partial(live_app, self), port, "name another with --page", lifespan="off")
        threading.Thread(target=page.serve, daemon=True).start()
        return page.address


def _believed(scene: Scene, event: Event) -> dict[str, Any]:
    """The estimated position of the robot on the map: place, and half axes [m] with their azimuth [deg]."""
    x = np.array([[event["x"], event["y"]]])
    azimuth = 90.0 - math.degrees(event["angle"]) + math.degrees(float(north_turn(scene, x)[0]))
    return {"at": map_places(scene, x[0]), "ellipse": [event["major"], event["minor"], azimuth]}


def live_app(page: LivePage, token: str, port: int) -> Guard:
    """The routes of the page, behind the guard of the desk."""

    async def plan(_request: Request) -> Response:
        return JSONResponse(page.plan)

    async def state(request: Request) -> Response:
        since = request.query_params.get("since", "0")
        if not (since.isascii() and since.isdigit()) or len(since) > 9:
            return JSONResponse({"error": "since must be the number of an event"}, 400)
        return JSONResponse(page.state(int(since)))

    routes = [*page_routes(PAGE, "live.html"), Route("/api/plan", plan), Route("/api/state", state)]
    return Guard(Starlette(routes=routes), token, port)
