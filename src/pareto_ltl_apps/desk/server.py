"""A server on the loopback address, and what each request must have.

It needs the address of the server, no foreign origin, and the token, which is new for each start, or the
cookie of a browser that had it.
"""

from __future__ import annotations

import logging
import secrets
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qs

import uvicorn
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.desk.limits import Limits, bounded
from pareto_ltl_apps.desk.sessions import MISSING, RefusedError, Sessions

LOG = logging.getLogger("uvicorn.error")  # on the standard error of the server

ADDRESS = "127.0.0.1"
HOSTS = (ADDRESS, "localhost")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}
MOST_BYTES = 32_000_000  # of the body of a request


SINGLE = ("host", "origin", "authorization", "content-type", "content-length", "cookie", "sec-fetch-site")
READING = ("GET", "HEAD")  # methods that change nothing


@dataclass(frozen=True, slots=True)
class Guard:
    """Checks each request before ``app`` gets it, and adds the security headers to each answer.

    Attributes
    ----------
    token : str
        Needed by programs (``Authorization: Bearer``). In the address of the page it becomes a cookie, as
        does the one-time token of ``sessions``; scripts and styles hold no data and need none.
    port : int
        The port of the server: a request that names another one, or another host, was redirected here.
    """

    app: ASGIApp
    token: str
    port: int
    sessions: Sessions = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sessions", Sessions(self.token, f"pareto_ltl_{self.port}"))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                added = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message["headers"] = [*message.get("headers", ()), *added]
            await send(message)

        answer = self.answer(scope)
        await (self.app if answer is None else answer)(scope, receive, send_guarded)

    def answer(self, scope: Scope) -> Response | None:
        """A refusal, or the redirection of a browser that begins a session; None if ``app`` answers."""
        given = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]]
        headers = dict(given)
        refusal = self._refusal([name for name, _ in given], headers)
        if refusal is not None:
            return JSONResponse({"error": refusal[1]}, refusal[0])
        known = str(scope["path"]).startswith("/desk/") or self._is_known(scope, headers)
        token = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["path"] == "/" and scope["method"] == "GET" and "authorization" not in headers:
            return None if known and not token else self._session(token, known)
        return None if known else JSONResponse({"error": MISSING}, 401)

    def _session(self, token: str, known: bool) -> Response:
        """Begin a session, unless the browser has one; the token leaves its address."""
        if known:
            return RedirectResponse("/", 303)
        try:
            session = self.sessions.begun(token)
        except RefusedError as error:
            if str(error) != MISSING:
                LOG.warning("the browser was refused: %s", error)
            return PlainTextResponse(f"{error}\n", 401)
        return RedirectResponse("/", 303, {"set-cookie": self.sessions.set_cookie(session)})

    def _refusal(self, names: Sequence[str], headers: Mapping[str, str]) -> tuple[int, str] | None:
        """Status and text for a request that is refused whatever token it has; None if there is no reason."""
        if twice := [name for name in SINGLE if names.count(name) > 1]:
            return 400, f"the header {twice[0]} occurs twice"
        if headers.get("host") not in self._hosts():
            return 421, f"the host must be {HOSTS[0]}:{self.port}"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self._hosts()}:
            return 403, "requests of other pages are refused"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return 403, "requests of other sites are refused"
        length = headers.get("content-length", "0")
        if not (length.isascii() and length.isdigit()):
            return 400, "Content-Length must be a number"
        if len(length) > len(str(MOST_BYTES)) or int(length) > MOST_BYTES or "transfer-encoding" in headers:
            return 413, f"send at most {MOST_BYTES:,} bytes, with their number in Content-Length"
        return None

    def _hosts(self) -> tuple[str, ...]:
        return tuple(f"{host}:{self.port}" for host in HOSTS)

    def _is_known(self, scope: Scope, headers: Mapping[str, str]) -> bool:
        """Whether a request has the token, or the cookie of a session.

        With a cookie, which a browser adds by itself, a request that changes something must say that it comes
        from this page.
        """
        kind, _, token = headers.get("authorization", "").partition(" ")
        if kind:
            return kind.lower() == "bearer" and self.sessions.has_token(token)
        if scope["method"] not in READING and "origin" not in headers:
            return False
        return self.sessions.has_session(headers.get("cookie", ""))


@dataclass(frozen=True, slots=True)
class LoopbackServer:
    """A server that listens on the loopback address.

    Attributes
    ----------
    address : str
        The address of the page with the token of programs.
    """

    address: str
    guard: Guard
    listening: socket.socket
    server: uvicorn.Server

    def browser_address(self) -> str:
        """An address of the page that works once, for the command line of a browser."""
        return f"{self.address.partition('=')[0]}={self.guard.sessions.one_time()}"

    def serve(self) -> None:
        """Serve until a signal."""
        with self.listening:
            self.server.run(sockets=[self.listening])


def loopback_server(
    app: Callable[[str, int], Guard], port: int, instead: str, limits: Limits | None = None, **options: Any
) -> LoopbackServer:
    """A server of what ``app`` makes from token and port; ``instead`` says what to do if the port is taken.

    Raises
    ------
    ConfigError
        If the port is taken.
    """
    listening, token, limits = socket.socket(), secrets.token_urlsafe(24), limits or Limits()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
    except OSError as error:
        listening.close()
        raise ConfigError(f"port {port} of {ADDRESS} is not free ({error.strerror}); {instead}") from None
    listening.listen()
    number = listening.getsockname()[1]
    guard = app(token, number)
    config = uvicorn.Config(
        guard, log_level="warning", access_log=False, server_header=False, ws="none", proxy_headers=False,
        http=bounded(limits), h11_max_incomplete_event_size=limits.header_bytes, **options,
    )  # fmt: skip
    return LoopbackServer(
        f"http://{ADDRESS}:{number}/?token={token}", guard, listening, uvicorn.Server(config)
    )
