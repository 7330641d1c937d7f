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

from pareto_ltl import __version__
from pareto_ltl.support.error_lines import one_line
from pareto_ltl.support.errors import ConfigError, NotFoundError, ParetoLtlError
from pareto_ltl.support.reading import Advice, parse_json, read_json, shown_json
from pareto_ltl_apps.desk import backdrop, missions, views
from pareto_ltl_apps.desk.earth import LONGEST_NAME, ground_view
from pareto_ltl_apps.desk.explaining import Explainer
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.plans import Job, Plans
from pareto_ltl_apps.desk.server import Guard, LoopbackServer, loopback_server
from pareto_ltl_apps.view.components import FOLDER
from pareto_ltl_apps.view.geography import places_named

MOST_TIME = 1e8  # [s] after departure
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
class Asked:
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


Endpoint = Callable[[Asked], Any]


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
async def make_plan(asked: Asked) -> Answer:
    """Start a plan; answers its id at once."""
    given = asked.fields("command", "overrides", "settings", "map", "formula")
    command, *words = await run_in_threadpool(missions.command_words, asked.folder, given)
    return asked.started(asked.plans.plan(command, words))


@operation("GET", "/api/plans")
async def list_plans(asked: Asked) -> Answer:
    """All plans in the folder, the newest first."""
    return {"plans": asked.plans.all_states()}


@operation("GET", PLAN)
async def plan_state(asked: Asked) -> Answer:
    """Status, directory, error and command line."""
    return asked.plans.state(asked.name)


@operation("DELETE", PLAN)
async def cancel_plan(asked: Asked) -> Answer:
    """Cancel a running plan."""
    asked.plans.cancel(asked.name)
    return asked.plans.state(asked.name)


@operation("GET", PLAN + "/events")
async def plan_events(asked: Asked) -> Answer:
    """Server-sent events: stage, progress, paths, status."""
    asked.plans.state(asked.name)

    async def lines() -> AsyncIterator[bytes]:
        async for event in asked.plans.follow(asked.name):
            yield f"event: {event['event']}\ndata: {json.dumps(event)}\n\n".encode()

    return StreamingResponse(lines(), media_type="text/event-stream")


@operation("GET", PLAN + "/front")
def plan_front(asked: Asked) -> Answer:
    """Points, with the columns of front.csv."""
    return views.front_view(asked.front)


@operation("GET", PLAN + "/points/{number}")
def plan_point(asked: Asked) -> Answer:
    """Path, ellipses, log, flights, risk and limits of a point."""
    return views.point_view(asked.front, asked.number)


@operation("GET", PLAN + "/points/{number}/limits")
def point_limits(asked: Asked) -> Answer:
    """Prices, and the tightest segments."""
    return views.limits_view(asked.done, asked.number)


@operation("GET", PLAN + "/wind")
def plan_wind(asked: Asked) -> Answer:
    """The expected wind at some times, and its deviation."""
    return views.wind_view(asked.front)


@operation("POST", PLAN + "/beacons")
async def find_beacon(asked: Asked) -> Answer:
    """Try a beacon at many places; answers an id."""
    return asked.started(asked.plans.beacons(asked.name))


@operation("GET", PLAN + "/beacons")
def plan_beacons(asked: Asked) -> Answer:
    """Failure with a beacon at each place, and a summary."""
    return views.beacons_view(asked.done)


@operation("GET", PLAN + "/check")
def plan_check(asked: Asked) -> Answer:
    """The last check in a newer forecast: GO or NO-GO, and its lines."""
    return views.check_view(asked.done)


@operation("GET", PLAN + "/departures")
def plan_departures(asked: Asked) -> Answer:
    """Starts, common lengths [m] and failure of each start at them."""
    return read_json(asked.done / "departures.json")


@operation("GET", PLAN + "/exports/{kind}")
def plan_export(asked: Asked) -> Answer:
    """A file for other programs; ?point=N takes that point instead of the plan."""
    number = _number(asked.query("point")) if asked.query("point") else None
    name, content = views.export_view(asked.done, asked.request.path_params["kind"], number)
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type="application/octet-stream", headers=headers)


@operation("POST", PLAN + "/choose", body="point: its number")
async def choose_point(asked: Asked) -> Answer:
    """Make a point the plan; answers an id."""
    number = _number(asked.fields("point").get("point"))
    rows = await run_in_threadpool(plan_front, asked)
    if number >= len(rows["points"]):
        raise NotFoundError(f"there is no point {number}; the front has {len(rows['points'])}")
    job = asked.plans.derive(asked.name, "choose", ("--point", str(number)), f"point_{number}")
    return asked.started(job)


@operation("POST", PLAN + "/replan", body="time [s after departure], fix [latitude, longitude, sd in m]")
async def replan(asked: Asked) -> Answer:
    """Plan the rest of a flight again after a position fix; answers an id."""
    given = asked.fields("time", "fix")
    time, fix = given.get("time"), given.get("fix")
    numbers = [time, *fix] if isinstance(fix, list) else []
    if len(numbers) != 4 or not all(isinstance(x, int | float) and abs(x) < MOST_TIME for x in numbers):
        raise ConfigError(
            f'expected {{"time": SECONDS, "fix": [LATITUDE, LONGITUDE, SD_M]}}, got {shown_json(given)}'
        )
    time, *fix = map(float, numbers)
    words = ("--time", f"{time!r}", f"--fix={','.join(map(repr, fix))}")
    return asked.started(asked.plans.derive(asked.name, "replan", words, f"replan_{time:.0f}"))


# --- missions ---------------------------------------------------------------------------------------------


@operation("POST", "/api/formula", body="formula; or pattern with goals, avoid, order")
async def explain(asked: Asked) -> Answer:
    """A formula or pattern in words, or its error and column."""
    given = asked.fields("formula", "pattern", "goals", "avoid", "order")
    return await asked.while_connected(asked.explainer.explained(given))


@operation("POST", "/api/maps", body="the file")
def read_map(asked: Asked) -> Answer:
    """A GeoJSON or KML file (?name=FILE) as features with roles."""
    return missions.read_map(asked.folder, asked.query("name", "map.geojson"), asked.content)


@operation("POST", "/api/backdrops", body="the file")
def keep_backdrop(asked: Asked) -> Answer:
    """Copy a map to lie below the drawing (?name=FILE)."""
    return backdrop.keep_backdrop(asked.folder, asked.query("name"), asked.content)


@operation("GET", "/api/backdrops/{name}")
def show_backdrop(asked: Asked) -> Answer:
    """Areas, lines and points of a file that was copied earlier, or an image."""
    return backdrop.backdrop(asked.folder, asked.name)


@operation("POST", "/api/winds", body="the file")
def keep_wind(asked: Asked) -> Answer:
    """Copy a file of winds (?name=FILE)."""
    return {"path": asked.folder.keep_wind(asked.query("name"), asked.content)}


@operation("GET", "/api/ground")
def show_ground(asked: Asked) -> Answer:
    """Land, lakes, borders, cities (?box=WEST,SOUTH,EAST,NORTH&pixels=N)."""
    return ground_view(asked.query("box"), asked.query("pixels", "1000"))


@operation("GET", "/api/places")
def find_places(asked: Asked) -> Answer:
    """Cities by a part of their name (?find=NAME), the largest ones first."""
    return {"places": places_named(asked.query("find")[:LONGEST_NAME])}


@operation("GET", "/api/choices")
def show_choices(_asked: Asked) -> Answer:
    """Names of vehicles, winds, patterns, examples."""
    return missions.choices_of_desk()


@operation("GET", "/api/examples/{name}")
def example(asked: Asked) -> Answer:
    """The map of an example."""
    return missions.example_map(asked.name)


@operation("GET", "/api/mission")
async def read_draft(asked: Asked) -> Answer:
    """The mission as it was last drawn, with its revision."""
    return asked.folder.read_draft()


@operation("PUT", "/api/mission", body="revision, mission")
async def write_draft(asked: Asked) -> Answer:
    """Keep the mission that is drawn; 409 if revision is not the last one."""
    given = asked.fields("revision", "mission")
    return asked.folder.write_draft(given.get("revision"), given.get("mission"))


@operation("GET", "/api/openapi.json")
async def document(_asked: Asked) -> Answer:
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
            asked = Asked(plans, explainer, request, await request.body())
            found = await (make(asked) if iscoroutinefunction(make) else run_in_threadpool(make, asked))
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
