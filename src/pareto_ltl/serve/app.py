"""The routes of the desk, each in one row of ``ROUTES``, from which the OpenAPI document is made."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from pareto_ltl import __version__
from pareto_ltl.report.components import FOLDER
from pareto_ltl.run.provenance import one_line
from pareto_ltl.serve import backdrop, missions, views
from pareto_ltl.serve.draft import Draft
from pareto_ltl.serve.folder import DeskFolder
from pareto_ltl.serve.guard import Guard
from pareto_ltl.serve.plans import Job, Plans
from pareto_ltl.support.errors import ConfigError, DataError, ParetoLtlError
from pareto_ltl.support.reading import shown_json

MOST_TIME = 1e8  # [s] after departure
PAGE = "pareto_ltl.serve.page"
KINDS = {
    "html": "text/html; charset=utf-8", "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8", "svg": "image/svg+xml",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Desk:
    """What the answers are made from."""

    plans: Plans
    folder: DeskFolder
    draft: Draft


Answer = Any  # what becomes JSON, or a Response
Endpoint = Callable[[Desk, Request], Any]


@dataclass(frozen=True, slots=True)
class Operation:
    """A row of the API: method, path, function, and its line in the OpenAPI document."""

    method: str
    path: str
    make: Endpoint
    meaning: str
    body: str = ""


# --- plans ------------------------------------------------------------------------------------------------


async def make_plan(desk: Desk, request: Request) -> Answer:
    """Start a plan."""
    command, *words = missions.command_words(desk.folder, await _body(request))
    return _started(desk, desk.plans.plan(command, words))


async def list_plans(desk: Desk, _request: Request) -> Answer:
    """All plans."""
    return {"plans": desk.plans.all_states()}


async def plan_state(desk: Desk, request: Request) -> Answer:
    """State of a plan."""
    return desk.plans.state(_name(request))


async def cancel_plan(desk: Desk, request: Request) -> Answer:
    """Cancel a plan."""
    desk.plans.cancel(_name(request))
    return desk.plans.state(_name(request))


async def plan_events(desk: Desk, request: Request) -> Answer:
    """Server-sent events of a plan."""
    desk.plans.state(_name(request))

    async def lines() -> AsyncIterator[bytes]:
        async for event in desk.plans.follow(_name(request)):
            kind = event["event"]
            yield f"event: {kind}\ndata: {json.dumps(event)}\n\n".encode()

    return StreamingResponse(lines(), media_type="text/event-stream")


async def plan_front(desk: Desk, request: Request) -> Answer:
    """Points of the front."""
    return await run_in_threadpool(views.front_view, desk.plans.require_front(_name(request)))


async def plan_point(desk: Desk, request: Request) -> Answer:
    """One point of the front."""
    place = desk.plans.require_front(_name(request))
    return await run_in_threadpool(views.point_view, place, _number(request.path_params["number"]))


async def point_limits(desk: Desk, request: Request) -> Answer:
    """What limits a point of the front."""
    place = desk.plans.require_done(_name(request))
    return await run_in_threadpool(views.limits_view, place, _number(request.path_params["number"]))


async def plan_wind(desk: Desk, request: Request) -> Answer:
    """The wind of a plan."""
    return await run_in_threadpool(views.wind_view, desk.plans.require_front(_name(request)))


async def find_beacon(desk: Desk, request: Request) -> Answer:
    """What a beacon would save."""
    return _started(desk, desk.plans.beacons(_name(request)))


async def plan_beacons(desk: Desk, request: Request) -> Answer:
    """The places at which a beacon was tried."""
    return await run_in_threadpool(views.beacons_view, desk.plans.require_done(_name(request)))


async def plan_departures(desk: Desk, request: Request) -> Answer:
    """The starts of a study of departures."""
    return await run_in_threadpool(views.departures_view, desk.plans.require_done(_name(request)))


async def plan_export(desk: Desk, request: Request) -> Answer:
    """A plan in the format of other programs."""
    place, point = desk.plans.require_done(_name(request)), request.query_params.get("point")
    number, kind = None if point is None else _number(point), request.path_params["kind"]
    name, content = await run_in_threadpool(views.export_view, place, kind, number)
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type="application/octet-stream", headers=headers)


async def choose_point(desk: Desk, request: Request) -> Answer:
    """Another point of the front as the plan."""
    number = _number((await _fields(request, ("point",))).get("point"))
    rows = await plan_front(desk, request)
    if number >= len(rows["points"]):
        raise DataError(f"there is no point {number}; the front has {len(rows['points'])}")
    job = desk.plans.derive(_name(request), "choose", ("--point", str(number)), f"point_{number}")
    return _started(desk, job)


async def replan(desk: Desk, request: Request) -> Answer:
    """The rest of a flight planned again after a position fix."""
    given = await _fields(request, ("time", "fix"))
    time, fix = given.get("time"), given.get("fix")
    numbers = [time, *fix] if isinstance(fix, list) else []
    if len(numbers) != 4 or not all(isinstance(x, int | float) and abs(x) < MOST_TIME for x in numbers):
        raise ConfigError(
            f'expected {{"time": SECONDS, "fix": [LATITUDE, LONGITUDE, SD_M]}}, got {shown_json(given)}'
        )
    time, *fix = map(float, numbers)
    words = ("--time", f"{time!r}", f"--fix={','.join(map(repr, fix))}")
    return _started(desk, desk.plans.derive(_name(request), "replan", words, f"replan_{time:.0f}"))


# --- missions ---------------------------------------------------------------------------------------------


async def explain(_desk: Desk, request: Request) -> Answer:
    """A formula, or the formula of a pattern, in words."""
    asked = await _fields(request, ("formula", "pattern", "goals", "avoid", "order"))
    return await run_in_threadpool(missions.explained_formula, asked)


async def read_map(desk: Desk, request: Request) -> Answer:
    """A GeoJSON or KML file as features with roles."""
    name = request.query_params.get("name", "map.geojson")
    return await run_in_threadpool(missions.read_map, desk.folder, name, await request.body())


async def keep_backdrop(desk: Desk, request: Request) -> Answer:
    """A map to lie under the drawing, copied into the folder."""
    name = request.query_params.get("name", "")
    return await run_in_threadpool(backdrop.keep_backdrop, desk.folder, name, await request.body())


async def show_backdrop(desk: Desk, request: Request) -> Answer:
    """The shapes or the image of a file that was copied earlier."""
    return await run_in_threadpool(backdrop.backdrop, desk.folder, request.path_params["name"])


async def keep_wind(desk: Desk, request: Request) -> Answer:
    """A file of winds, copied into the folder."""
    return {"path": desk.folder.keep_wind(request.query_params.get("name", ""), await request.body())}


async def show_choices(_desk: Desk, _request: Request) -> Answer:
    """Names of vehicles, winds, patterns and examples."""
    return await run_in_threadpool(missions.choices_of_desk)


async def example(_desk: Desk, request: Request) -> Answer:
    """The map of an example."""
    return await run_in_threadpool(missions.example_map, request.path_params["name"])


async def read_draft(desk: Desk, _request: Request) -> Answer:
    """The mission as it was last drawn."""
    return desk.draft.read()


async def write_draft(desk: Desk, request: Request) -> Answer:
    """Keep the mission that is drawn; refused if another tab has written since."""
    given = await _fields(request, ("revision", "mission"))
    return desk.draft.write(given.get("revision"), given.get("mission"))


async def document(_desk: Desk, _request: Request) -> Answer:
    """The OpenAPI document."""
    return openapi()


PLAN = "/api/plans/{id}"
ROUTES = (
    Operation("POST", "/api/plans", make_plan, "start a plan; answers its id at once",
              "overrides: settings as on the command line; or map (GeoJSON) and formula; "
              "command: plan, departure (compares starts) or wind (without a plan)"),
    Operation("GET", "/api/plans", list_plans, "all plans in the folder, the newest first"),
    Operation("GET", PLAN, plan_state, "status, directory, error and command line"),
    Operation("DELETE", PLAN, cancel_plan, "cancel a running plan"),
    Operation("GET", PLAN + "/events", plan_events, "server-sent events: stage, progress, paths, status"),
    Operation("GET", PLAN + "/front", plan_front, "points, with the columns of front.csv"),
    Operation("GET", PLAN + "/points/{number}", plan_point, "path, ellipses, log, flights, risk and limits"),
    Operation("GET", PLAN + "/points/{number}/limits", point_limits, "prices, and the tightest segments"),
    Operation("GET", PLAN + "/wind", plan_wind, "the expected wind at some times, and its deviation"),
    Operation("POST", PLAN + "/beacons", find_beacon, "try a beacon at many places; answers an id"),
    Operation("GET", PLAN + "/beacons", plan_beacons, "failure with a beacon at each place, and a summary"),
    Operation("GET", PLAN + "/departures", plan_departures, "failure of each start at common lengths"),
    Operation("GET", PLAN + "/exports/{kind}", plan_export, "a file for other programs; ?point=N"),
    Operation("POST", PLAN + "/choose", choose_point, "make a point the plan; answers an id",
              "point: its number"),
    Operation("POST", PLAN + "/replan", replan, "plan the rest again; answers an id",
              "time [s after departure], fix [latitude, longitude, sd in m]"),
    Operation("POST", "/api/formula", explain, "a formula or pattern in words, or its error and column",
              "formula; or pattern with goals, avoid, order"),
    Operation("POST", "/api/maps", read_map, "a GeoJSON or KML file (?name=FILE) as features", "the file"),
    Operation("POST", "/api/backdrops", keep_backdrop, "copy a map to lie below the drawing (?name=FILE)",
              "the file"),
    Operation("GET", "/api/backdrops/{name}", show_backdrop, "areas, lines and points, or an image"),
    Operation("POST", "/api/winds", keep_wind, "copy a file of winds (?name=FILE)", "the file"),
    Operation("GET", "/api/choices", show_choices, "names of vehicles, winds, patterns, examples"),
    Operation("GET", "/api/examples/{name}", example, "the map of an example"),
    Operation("GET", "/api/mission", read_draft, "the mission as it was last drawn, with its revision"),
    Operation("PUT", "/api/mission", write_draft, "keep it; 409 if revision is not the last one",
              "revision, mission"),
    Operation("GET", "/api/openapi.json", document, "this document"),
)  # fmt: skip


def openapi() -> dict[str, Any]:
    """The OpenAPI 3.1 document of ``ROUTES``."""
    paths: dict[str, Any] = {}
    for row in ROUTES:
        names = [part[1:-1] for part in row.path.split("/") if part.startswith("{")]
        entry: dict[str, Any] = {
            "summary": row.meaning,
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
    desk = Desk(Plans(folder), folder, Draft(folder))

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        jobs = asyncio.create_task(desk.plans.run_jobs())
        try:
            yield
        finally:
            jobs.cancel()
            with suppress(asyncio.CancelledError):
                await jobs

    routes = [Route(row.path, _endpoint(desk, row.make), methods=[row.method]) for row in ROUTES]
    pages = [Route("/", _page_file), Route("/desk/{name}", _page_file)]
    return Guard(Starlette(routes=[*routes, *pages], lifespan=lifespan), token, port)


def _endpoint(desk: Desk, make: Endpoint) -> Callable[[Request], Any]:
    async def answer(request: Request) -> Response:
        try:
            found = await make(desk, request)
        except (ParetoLtlError, OSError) as error:
            missing = isinstance(error, DataError) and str(error).startswith("there is no")
            status = getattr(error, "status", 404 if missing else 400)
            return JSONResponse({"error": one_line(error)}, status)
        return found if isinstance(found, Response) else JSONResponse(found)

    return answer


async def _page_file(request: Request) -> Response:
    return file_of_page(request.path_params.get("name", "index.html"), PAGE)


def file_of_page(name: str, package: str) -> Response:
    """The file ``name`` of a page, from its ``package`` or from the components that all pages share."""
    parts = (file for folder in (package, FOLDER) for file in files(folder).iterdir())
    known = {file.name: file for file in parts if file.name.rpartition(".")[2] in KINDS}
    if name not in known:
        return JSONResponse({"error": "there is no such file"}, 404)
    return Response(known[name].read_bytes(), media_type=KINDS[name.rpartition(".")[2]])


def _started(desk: Desk, job: Job) -> Response:
    return JSONResponse(desk.plans.state(job.name), 202)


def _name(request: Request) -> str:
    return str(request.path_params["id"])


def _number(value: Any) -> int:
    text = str(value)
    if not (text.isascii() and text.isdigit()) or len(text) > 6:
        raise ConfigError(f"expected the number of a point, got {shown_json(value)}")
    return int(text)


async def _body(request: Request) -> Any:
    """The JSON of a request; ConfigError if it is not JSON, or if its header does not declare JSON."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise ConfigError("send JSON, with Content-Type: application/json")
    try:
        return json.loads(await request.body())
    except (ValueError, RecursionError):
        raise ConfigError("the body of the request is not JSON") from None


async def _fields(request: Request, known: tuple[str, ...]) -> Mapping[str, Any]:
    body = await _body(request)
    if not isinstance(body, dict) or not set(body) <= set(known):
        raise ConfigError(f"expected an object with {', '.join(known)}, got {shown_json(body)}")
    return body
