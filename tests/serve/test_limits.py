"""Limits of connections, and of the time and size of requests; formulas of clients that go."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import httpx
import pytest

from desk import MOST, RunningDesk, running_desk
from pareto_ltl_apps.desk import explaining
from pareto_ltl_apps.desk.app import desk_app
from pareto_ltl_apps.desk.explaining import Explainer, explained_formula
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.limits import Limits
from pareto_ltl_apps.desk.server import LoopbackServer, loopback_server

LIMITS = Limits(connections=8, headers=1.0, body=1.5, header_bytes=4096)
FIVE_GOALS = "F a & F b & F c & F d & F e"
SLOW = (
    "F(" + " & F(".join(f"r{k}" for k in range(15)) + ")" * 15
)  # takes a second or two, as 2^15 letters are compared; on a busy machine less than is allowed


@contextmanager
def served(folder: Path, limits: Limits = LIMITS) -> Iterator[LoopbackServer]:
    """The application of a desk, without its workers, on a port of the loopback address."""
    desk = DeskFolder.opened(folder)
    server = loopback_server(lambda token, port: desk_app(desk, token, port), 0, "", limits, lifespan="off")
    thread = Thread(target=server.serve, daemon=True)
    thread.start()
    while not server.server.started:
        time.sleep(0.01)
    yield server
    server.server.should_exit = True
    thread.join(MOST)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[LoopbackServer]:
    with served(tmp_path) as running:
        yield running


def connection(server: LoopbackServer) -> socket.socket:
    found = socket.create_connection(("127.0.0.1", server.guard.port), timeout=MOST)
    found.settimeout(MOST)
    return found


def until_closed(found: socket.socket) -> bytes:
    """What the server sends until it closes the connection."""
    parts = []
    try:
        while part := found.recv(65_536):
            parts.append(part)
    except ConnectionResetError:
        pass
    return b"".join(parts)


def head(server: LoopbackServer, method: str, path: str, *more: str) -> bytes:
    lines = [f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{server.guard.port}", *more]
    return ("\r\n".join([*lines, f"Authorization: Bearer {server.guard.token}"]) + "\r\n\r\n").encode()


def trickled(found: socket.socket, content: bytes, begin: float, pause: float = 0.1) -> float:
    """Seconds until the server ends a connection that gets one byte of ``content`` now and then."""
    found.settimeout(pause)
    for byte in content:
        try:
            found.sendall(bytes([byte]))
            if not found.recv(65_536):
                break
        except TimeoutError:
            continue
        except (ConnectionError, BrokenPipeError):
            break
    return time.monotonic() - begin


@pytest.mark.parametrize("kind", ["silent", "slow", "after another"])
def test_headers_have_a_time(server: LoopbackServer, kind: str) -> None:
    with connection(server) as found:
        if kind == "after another":
            found.sendall(head(server, "GET", "/api/mission"))
            assert b"200 OK" in found.recv(65_536)
        begin = time.monotonic()
        if kind == "silent":
            assert b"408" in until_closed(found)
            lasted = time.monotonic() - begin
        else:
            lasted = trickled(found, head(server, "GET", "/" + "x" * 1000), begin)
    assert 0.5 * LIMITS.headers < lasted < LIMITS.headers + 30


@pytest.mark.parametrize("token", [True, False])
def test_bodies_have_a_time(server: LoopbackServer, token: bool) -> None:
    request = head(server, "POST", "/api/maps", "Content-Length: 1000", "Connection: keep-alive")
    if not token:  # it is refused before its body is read
        request = request.replace(server.guard.token.encode(), b"wrong")
    with connection(server) as found:
        found.sendall(request)
        lasted = trickled(found, b"x" * 900, time.monotonic(), pause=0.05)
    assert lasted < LIMITS.body + 30
    with httpx.Client(base_url=server.address.partition("/?")[0]) as client:
        assert client.get("/desk/main.js").status_code == 200


def test_headers_have_a_size(server: LoopbackServer) -> None:
    for request in (
        head(server, "GET", "/api/mission", f"X: {'x' * 2 * LIMITS.header_bytes}"),
        head(server, "GET", f"/api/mission?{'x' * 2 * LIMITS.header_bytes}"),
        head(server, "GET", "/api/mission", *(f"X{k}: {k}" for k in range(LIMITS.header_bytes // 3))),
        b"x" * (2 * LIMITS.header_bytes),
    ):
        with connection(server) as found:
            with suppress(ConnectionError):
                for place in range(0, len(request), 1000):  # what comes in one piece is not counted in parts
                    found.sendall(request[place : place + 1000])
                    time.sleep(0.02)
            answer = until_closed(found)
            assert not answer or b" 400 " in answer.splitlines()[0]


def test_a_length_that_is_a_lie_gives_no_answer_of_the_next(server: LoopbackServer) -> None:
    body = b'{"formula": "F a"}'
    sent = head(
        server, "POST", "/api/formula", f"Content-Length: {len(body)}", f"Content-Length: {len(body) + 1}"
    )
    for request in (
        sent,
        head(server, "POST", "/api/maps", "Transfer-Encoding: chunked", "Content-Length: 4"),
    ):
        with connection(server) as found:
            found.sendall(request + body)
            assert until_closed(found).split()[1] in (b"400", b"413")


def test_connections_have_a_number(server: LoopbackServer) -> None:
    silent = [connection(server) for _ in range(LIMITS.connections)]
    time.sleep(0.2)
    with connection(server) as one_more:
        assert b" 503 " in until_closed(one_more).splitlines()[0]
    for found in silent:
        until_closed(found)  # after LIMITS.headers
        found.close()
    with connection(server) as found:
        found.sendall(head(server, "GET", "/api/mission", "Connection: close"))
        assert b"200 OK" in until_closed(found)


def test_a_client_that_goes_in_its_body_leaves_no_error(
    server: LoopbackServer, caplog: pytest.LogCaptureFixture
) -> None:
    with connection(server) as found:
        found.sendall(head(server, "POST", "/api/maps", "Content-Length: 1000") + b"x")
    time.sleep(0.3)
    assert "Traceback" not in caplog.text
    assert "Exception" not in caplog.text


# --- formulas -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDesk]:
    with running_desk(tmp_path_factory.mktemp("desk")) as running:
        yield running


def test_the_process_answers_what_the_function_does(desk: RunningDesk) -> None:
    made: dict[str, Any] = {"pattern": "sequence", "goals": ["b", "a"]}
    odd: list[dict[str, Any]] = [{}, {"formula": 5}, {"goals": {"a": 1}}, {"pattern": "no such"}]
    for asked in ({"formula": FIVE_GOALS}, {"formula": "F(a & )"}, made, *odd):
        for _ in range(2):  # the second answer is from memory
            answer = desk.client.post("/api/formula", json=asked)
            assert answer.status_code == 200
            assert answer.json() == json.loads(json.dumps(explained_formula(asked)))


def test_a_formula_of_a_client_that_goes_does_not_delay_the_next(desk: RunningDesk) -> None:
    def asked(formula: str, patience: float) -> Any:
        return desk.client.post("/api/formula", json={"formula": formula}, timeout=patience).json()

    assert asked("F a", MOST)["words"]
    begin = time.monotonic()
    assert asked(SLOW, MOST)["words"]
    slow = time.monotonic() - begin
    for k in range(10):
        with pytest.raises(httpx.ReadTimeout):
            asked(f"{SLOW} | F x{k}".replace("r14", f"x{k}"), 0.2)
    begin = time.monotonic()
    assert asked("F(b & F c)", MOST)["words"] == "reach b, then c"
    # A new process begins, which takes longer on a busy machine; the ten before would need ten times that.
    assert time.monotonic() - begin < 5 * slow


def test_other_requests_are_answered_while_a_formula_is_explained(desk: RunningDesk) -> None:
    answers: list[httpx.Response] = []

    def ask() -> None:
        with httpx.Client(base_url=desk.client.base_url, headers=desk.client.headers, timeout=MOST) as client:
            answers.append(client.post("/api/formula", json={"formula": SLOW.replace("r1 ", "first ")}))

    asking = Thread(target=ask)
    asking.start()
    times = []
    for _ in range(20):
        begin = time.monotonic()
        assert desk.client.get("/api/mission").status_code == 200
        times.append(time.monotonic() - begin)
    assert sorted(times)[10] < 1.0  # on a busy machine too
    asking.join(MOST)
    assert answers[0].json()["names"][0] == "first"


def test_the_newest_formula_is_explained_first() -> None:
    async def asked() -> list[str]:
        explainer = Explainer()
        order: list[str] = []

        async def ask(formula: str, name: str) -> None:
            assert (await explainer.explained({"formula": formula}))["names"][0] == name
            order.append(name)

        await explainer.start()
        try:
            tasks = [asyncio.ensure_future(ask(SLOW.replace("r1 ", "first "), "first"))]
            while explainer.waiting or explainer.working is None:
                await asyncio.sleep(0)
            tasks += [asyncio.ensure_future(ask(f"F {name}", name)) for name in ("oldest", "newest")]
            await asyncio.gather(*tasks)
        finally:
            await explainer.close()
        return order

    assert asyncio.run(asked()) == ["first", "newest", "oldest"]


def test_a_formula_that_takes_too_long_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    async def asked() -> tuple[Any, Any, Any]:
        explainer = Explainer()
        await explainer.start()
        try:
            late = await explainer.explained({"formula": SLOW})
            monkeypatch.setattr(explaining, "MAX_TIME", MOST)
            again = asyncio.ensure_future(explainer.explained({"formula": "F a"}))
            fine = await again
            assert explainer.process is not None
            dying = asyncio.ensure_future(explainer.explained({"formula": SLOW}))
            await asyncio.sleep(0.3)
            explainer.process.kill()
            return late, fine, await dying
        finally:
            await explainer.close()

    monkeypatch.setattr(explaining, "MAX_TIME", 0.5)
    late, fine, dead = asyncio.run(asked())
    assert "use fewer goals" in late["error"]
    assert fine["words"] == "reach a"
    assert "ended early" in dead["error"]
