"""The operations of the desk: each function below is a route, and a row of the OpenAPI document."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from inspect import getdoc, iscoroutinefunction
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from careful_io.error_lines import one_line
from careful_io.reading import Advice, parse_json, read_json, shown_json
from pareto_ltl import __version__
from pareto_ltl.support.errors import ConfigError, NotFoundError, ParetoLtlError
from pareto_ltl_apps.desk import backdrop, missions, views
from pareto_ltl_apps.desk.earth import LONGEST_NAME, ground_view
from pareto_ltl_apps.desk.explaining import Explainer
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.plans import Job, Plans
from pareto_ltl_apps.desk.server import Guard, LoopbackServer, loopback_server
from pareto_ltl_apps.view.components import FOLDER
from pareto_ltl_apps.view.geography import places_named

MAX_TIME = 1e8  # [s] after departure
JSON_TYPE = "application/json"
BODIES = Advice(damaged="correct it")
GRACE = 2  # [s] for open streams when the server ends
PAGE = "pareto_ltl_apps.desk.page"
PLAN = "/api/plans/{id}"
KINDS = {
    "html": "text/html; charset=utf-8", "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8", "svg": "image/svg+xml",
}  # fmt: skip
Answer = Any  # what becomes JSON, or a Response


@dataclass(frozen=True, slots=True)
class DeskRequest:
    """A request, with what the answer is made from."""

    plans: Plans
    explainer: Explainer
    request: Request
    content: bytes

    @property
    def folder(self) -> DeskFolder:
        """The folder of the desk."""
        return self.plans.folder

    @property
    def name(self) -> str:
        """The plan, map or example that the path names."""
        found = self.request.path_params
        return str(found["id"] if "id" in found else found["name"])

    @property
    def number(self) -> int:
        """The point that the path names; ConfigError for any other text."""
        return _number(self.request.path_params["number"])

    @property
    def done(self) -> Path:
        """The directory of the finished plan that the path names."""
        return self.plans.require_done(self.name)

    @property
    def front(self) -> Path:
        """The directory of the plan that the path names, with a front."""
        return self.plans.require_front(self.name)

    def query(self, name: str, default: str = "") -> str:
        """A parameter after the ``?``."""
        return self.request.query_params.get(name, default)

    def fields(self, *known: str) -> Mapping[str, Any]:
        """The JSON object in the request; ConfigError if it is none, or has other names than ``known``.

        Its header must declare JSON, which a form of another page cannot.
        """
        if self.request.headers.get("content-type", "").partition(";")[0].strip().lower() != JSON_TYPE:
            raise ConfigError(f"send JSON, with Content-Type: {JSON_TYPE}")
        body = parse_json(self.content, "the body of the request", BODIES)
        if not isinstance(body, dict) or not set(body) <= set(known):
            raise ConfigError(f"expected an object with some of {', '.join(known)}, got {shown_json(body)}")
        return body

    async def while_connected(self, work: Coroutine[Any, Any, Any]) -> Any:
        """The result of ``work``, which is cancelled when the client goes."""
        working, gone = asyncio.ensure_future(work), asyncio.ensure_future(self._gone())
        try:
            await asyncio.wait({working, gone}, return_when=asyncio.FIRST_COMPLETED)
            if not working.done():
                raise ClientDisconnect
            return working.result()
        finally:
            working.cancel()
            gone.cancel()

    async def _gone(self) -> None:
        """Wait until the client has closed its connection."""
        while (await self.request.receive())["type"] != "http.disconnect":
            pass

    def started(self, job: Job) -> Response:
        """The answer to a request that starts ``job``."""
        return JSONResponse(self.plans.state(job.name), 202)


Endpoint = Callable[[DeskRequest], Any]


@dataclass(frozen=True, slots=True)
class Operation:
    """A row of the API: method, path, function, and the meaning of its body in the OpenAPI document."""

    method: str
    path: str
    make: Endpoint
    body: str = ""


ROUTES: list[Operation] = []


def operation(method: str, path: str, body: str = "") -> Callable[[Endpoint], Endpoint]:
    """Make a function a row of ``ROUTES``, with its documentation as the meaning.

    A function with ``async`` is called in the thread of the jobs, any other in a separate thread.
    """

    def added(make: Endpoint) -> Endpoint:
        ROUTES.append(Operation(method, path, make, body))
        return make

    return added


# --- plans ------------------------------------------------------------------------------------------------


@operation("POST", "/api/plans", body="settings: values by key; overrides: KEY=VALUE; map (GeoJSON) and "
           "formula; command: plan, departure (compares starts) or wind (without a plan)")  # fmt: skip
async def make_plan(requested: DeskRequest) -> Answer:
    """Start a plan; answers its id at once."""
    given = requested.fields("command", "overrides", "settings", "map", "formula")
    command, *words = await run_in_threadpool(missions.command_words, requested.folder, given)
    return requested.started(requested.plans.plan(command, words))


@operation("GET", "/api/plans")
async def list_plans(requested: DeskRequest) -> Answer:
    """All plans in the folder, the newest first."""
    return {"plans": requested.plans.all_states()}


@operation("GET", PLAN)
async def plan_state(requested: DeskRequest) -> Answer:
    """Status, directory, error and command line."""
    return requested.plans.state(requested.name)


@operation("DELETE", PLAN)
async def cancel_plan(requested: DeskRequest) -> Answer:
    """Cancel a running plan."""
    requested.plans.cancel(requested.name)
    return requested.plans.state(requested.name)


@operation("POST", PLAN + "/remove")
async def remove_plan(requested: DeskRequest) -> Answer:
    """Take an ended plan from the list; its directory is moved to ``removed/``."""
    requested.fields()
    return {"moved": str(requested.plans.remove(requested.name))}


@operation("GET", PLAN + "/events")
async def plan_events(requested: DeskRequest) -> Answer:
    """Server-sent events: stage, progress, paths, status."""
    requested.plans.state(requested.name)

    async def lines() -> AsyncIterator[bytes]:
        async for event in requested.plans.follow(requested.name):
            yield f"event: {event['event']}\ndata: {json.dumps(event)}\n\n".encode()

    return StreamingResponse(lines(), media_type="text/event-stream")


@operation("GET", PLAN + "/front")
def plan_front(requested: DeskRequest) -> Answer:
    """Points, with the columns of front.csv."""
    return views.front_view(requested.front)


@operation("GET", PLAN + "/points/{number}")
def plan_point(requested: DeskRequest) -> Answer:
    """Path, ellipses, log, flights, risk and limits of a point."""
    return views.point_view(requested.front, requested.number)


@operation("GET", PLAN + "/points/{number}/limits")
def point_limits(requested: DeskRequest) -> Answer:
    """Prices, and the tightest segments."""
    return views.limits_view(requested.done, requested.number)


@operation("GET", PLAN + "/wind")
def plan_wind(requested: DeskRequest) -> Answer:
    """The expected wind at some times, and its deviation."""
    return views.wind_view(requested.front)


@operation("GET", PLAN + "/levels")
def plan_levels(requested: DeskRequest) -> Answer:
    """The wind of the file at its levels, at the places and times of the wind; or why there is one level."""
    return views.levels_view(requested.folder, requested.front)


@operation("POST", PLAN + "/beacons")
async def find_beacon(requested: DeskRequest) -> Answer:
    """Try a beacon at many places; answers an id."""
    return requested.started(requested.plans.beacons(requested.name))


@operation("GET", PLAN + "/beacons")
def plan_beacons(requested: DeskRequest) -> Answer:
    """Failure with a beacon at each place, and a summary."""
    return views.beacons_view(requested.done)


@operation("GET", PLAN + "/check")
def plan_check(requested: DeskRequest) -> Answer:
    """The last check in a newer forecast: GO or NO-GO, and its lines."""
    return views.check_view(requested.done)


@operation("GET", PLAN + "/departures")
def plan_departures(requested: DeskRequest) -> Answer:
    """Starts, common lengths [m] and failure of each start at them."""
    return read_json(requested.done / "departures.json")


@operation("GET", PLAN + "/exports/{kind}")
def plan_export(requested: DeskRequest) -> Answer:
    """A file for other programs; ?point=N takes that point instead of the plan."""
    number = _number(requested.query("point")) if requested.query("point") else None
    name, content = views.export_view(requested.done, requested.request.path_params["kind"], number)
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type="application/octet-stream", headers=headers)


@operation("POST", PLAN + "/choose", body="point: its number")
async def choose_point(requested: DeskRequest) -> Answer:
    """Make a point the plan; answers an id."""
    number = _number(requested.fields("point").get("point"))
    rows = await run_in_threadpool(plan_front, requested)
    if number >= len(rows["points"]):
        raise NotFoundError(f"there is no point {number}; the front has {len(rows['points'])}")
    job = requested.plans.derive(requested.name, "choose", ("--point", str(number)), f"point_{number}")
    return requested.started(job)


@operation("POST", PLAN + "/replan", body="time [s after departure], fix [latitude, longitude, sd in m]")
async def replan(requested: DeskRequest) -> Answer:
    """Plan the rest of a flight again after a position fix; answers an id."""
    given = requested.fields("time", "fix")
    time, fix = given.get("time"), given.get("fix")
    numbers = [time, *fix] if isinstance(fix, list) else []
    if len(numbers) != 4 or not all(isinstance(x, int | float) and abs(x) < MAX_TIME for x in numbers):
        raise ConfigError(
            f'expected {{"time": SECONDS, "fix": [LATITUDE, LONGITUDE, SD_M]}}, got {shown_json(given)}'
        )
    time, *fix = map(float, numbers)
    words = ("--time", f"{time!r}", f"--fix={','.join(map(repr, fix))}")
    return requested.started(requested.plans.derive(requested.name, "replan", words, f"replan_{time:.0f}"))


# --- missions ---------------------------------------------------------------------------------------------


@operation("POST", "/api/formula", body="formula; or pattern with goals, avoid, order")
async def explain(requested: DeskRequest) -> Answer:
    """A formula or pattern in words, or its error and column."""
    given = requested.fields("formula", "pattern", "goals", "avoid", "order")
    return await requested.while_connected(requested.explainer.explained(given))


@operation("POST", "/api/maps", body="the file")
def read_map(requested: DeskRequest) -> Answer:
    """A GeoJSON or KML file (?name=FILE) as features with roles; ?role=ROLE for those that state none."""
    name, role = requested.query("name", "map.geojson"), requested.query("role")
    return missions.read_map(requested.folder, name, requested.content, role)


@operation("POST", "/api/backdrops", body="the file")
def keep_backdrop(requested: DeskRequest) -> Answer:
    """Copy a map to lie below the drawing (?name=FILE)."""
    return backdrop.keep_backdrop(requested.folder, requested.query("name"), requested.content)


@operation("GET", "/api/backdrops/{name}")
def show_backdrop(requested: DeskRequest) -> Answer:
    """Areas, lines and points of a file that was copied earlier, or an image."""
    return backdrop.backdrop(requested.folder, requested.name)


@operation("POST", "/api/winds", body="the file")
def keep_wind(requested: DeskRequest) -> Answer:
    """Copy a file of winds (?name=FILE)."""
    return {"path": requested.folder.keep_wind(requested.query("name"), requested.content)}


@operation("GET", "/api/ground")
def show_ground(requested: DeskRequest) -> Answer:
    """Land, lakes, borders, cities (?box=WEST,SOUTH,EAST,NORTH&pixels=N)."""
    return ground_view(requested.query("box"), requested.query("pixels", "1000"))


@operation("GET", "/api/places")
def find_places(requested: DeskRequest) -> Answer:
    """Cities by a part of their name (?find=NAME), the largest ones first."""
    return {"places": places_named(requested.query("find")[:LONGEST_NAME])}


@operation("GET", "/api/choices")
def show_choices(_requested: DeskRequest) -> Answer:
    """Names of vehicles, winds, patterns, examples."""
    return missions.choices_of_desk()


@operation("GET", "/api/examples/{name}")
def example(requested: DeskRequest) -> Answer:
    """The map of an example."""
    return missions.example_map(requested.name)


@operation("GET", "/api/mission")
async def read_draft(requested: DeskRequest) -> Answer:
    """The mission as it was last drawn, with its revision."""
    return requested.folder.read_draft()


@operation("PUT", "/api/mission", body="revision, mission")
async def write_draft(requested: DeskRequest) -> Answer:
    """Keep the mission that is drawn; 409 if revision is not the last one."""
    given = requested.fields("revision", "mission")
    return requested.folder.write_draft(given.get("revision"), given.get("mission"))


@operation("GET", "/api/openapi.json")
async def document(_asked: DeskRequest) -> Answer:
    """The OpenAPI document."""
    return openapi()


def openapi() -> dict[str, Any]:
    """The OpenAPI 3.1 document of ``ROUTES``."""
    paths: dict[str, Any] = {}
    for row in ROUTES:
        names = [part[1:-1] for part in row.path.split("/") if part.startswith("{")]
        entry: dict[str, Any] = {
            "summary": getdoc(row.make),
            "operationId": row.make.__name__,
            "parameters": [
                {"name": name, "in": "path", "required": True, "schema": {"type": "string"}} for name in names
            ],
            "responses": {
                "200": {"description": "the answer"},
                "4XX": {"description": 'what was wrong, as {"error": TEXT}'},
            },
        }
        if row.body:
            entry["requestBody"] = {"description": row.body, "content": {"application/json": {}}}
        paths.setdefault(row.path, {})[row.method.lower()] = entry
    return {
        "openapi": "3.1.0",
        "info": {"title": "pareto_ltl, the planning desk", "version": __version__},
        "components": {"securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}},
        "security": [{"token": []}],
        "paths": paths,
    }


# --- the application -----------------------------------------------------------------------------------


def desk_app(folder: DeskFolder, token: str, port: int) -> Guard:
    """The application that answers on ``port`` to requests with ``token``."""
    plans, explainer = Plans(folder), Explainer()

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        jobs = asyncio.create_task(plans.run_jobs())
        await explainer.start()
        try:
            yield
        finally:
            await explainer.close()
            jobs.cancel()
            with suppress(asyncio.CancelledError):
                await jobs

    routes = [Route(row.path, _endpoint(plans, explainer, row.make), methods=[row.method]) for row in ROUTES]
    return Guard(
        Starlette(routes=[*routes, *page_routes(PAGE, "index.html")], lifespan=lifespan), token, port
    )


def desk_server(path: Path, port: int) -> LoopbackServer:
    """A server of the folder ``path``; ConfigError if the port is taken."""
    return loopback_server(
        partial(desk_app, DeskFolder.opened(path)), port, "use --port 0",
        lifespan="on", timeout_graceful_shutdown=GRACE,
    )  # fmt: skip


def _endpoint(plans: Plans, explainer: Explainer, make: Endpoint) -> Callable[[Request], Any]:
    async def answer(request: Request) -> Response:
        try:
            requested = DeskRequest(plans, explainer, request, await request.body())
            found = await (
                make(requested) if iscoroutinefunction(make) else run_in_threadpool(make, requested)
            )
        except ClientDisconnect:
            return JSONResponse({"error": "the client has gone"}, 400)
        except (ParetoLtlError, OSError) as error:
            status = getattr(error, "status", 404 if isinstance(error, NotFoundError) else 400)
            return JSONResponse({"error": one_line(error)}, status)
        return found if isinstance(found, Response) else JSONResponse(found)

    return answer


def page_routes(package: str, first: str) -> list[Route]:
    """The routes of a page: its file ``first``, and the files that it names.

    They are in its ``package``, or in the components that all pages share.
    """

    async def file(request: Request) -> Response:
        name = request.path_params.get("name", first)
        parts = (file for folder in (package, FOLDER) for file in files(folder).iterdir())
        known = {file.name: file for file in parts if file.name.rpartition(".")[2] in KINDS}
        if name not in known:
            return JSONResponse({"error": "there is no such file"}, 404)
        return Response(known[name].read_bytes(), media_type=KINDS[name.rpartition(".")[2]])

    return [Route("/", file), Route("/desk/{name}", file)]


def _number(value: Any) -> int:
    text = str(value)
    if not (text.isascii() and text.isdigit()) or len(text) > 6:
        raise ConfigError(f"expected the number of a point, got {shown_json(value)}")
    return int(text)
