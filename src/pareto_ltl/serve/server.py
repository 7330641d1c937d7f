"""A server on the loopback address, and what each request must have.

It needs the address of the server, no foreign origin, and the token, which is new for each start.
"""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs

import uvicorn
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pareto_ltl.support.errors import ConfigError

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


@dataclass(frozen=True, slots=True)
class Guard:
    """Checks each request before ``app`` gets it, and adds the security headers to each answer.

    Attributes
    ----------
    token : str
        Needed by the page (in its address) and by the API (``Authorization: Bearer``); scripts and styles of
        the page hold no data and need none.
    port : int
        The port of the server: a request that names another one, or another host, was redirected here.
    """

    app: ASGIApp
    token: str
    port: int

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

        refusal = self.refusal(scope)
        if refusal is None:
            await self.app(scope, receive, send_guarded)
        else:
            status, text = refusal
            answer = JSONResponse({"error": text}, status)
            await answer(scope, receive, send_guarded)

    def refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and text of the refusal of a request; None if it is accepted."""
        given = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]]
        headers: Mapping[str, str] = dict(given)
        if sum(name == "host" for name, _ in given) != 1 or headers["host"] not in self._hosts():
            return 421, f"the host must be {HOSTS[0]}:{self.port}"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self._hosts()}:
            return 403, "requests of other pages are refused"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return 403, "requests of other sites are refused"
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > MOST_BYTES or "transfer-encoding" in headers:
            return 413, f"send at most {MOST_BYTES:,} bytes, with their number in Content-Length"
        free = str(scope["path"]).startswith("/desk/")
        if not free and not self._has_token(scope, headers):
            return 401, "the token is missing or wrong: use the address that pareto-ltl serve printed"
        return None

    def _hosts(self) -> tuple[str, ...]:
        return tuple(f"{host}:{self.port}" for host in HOSTS)

    def _has_token(self, scope: Scope, headers: Mapping[str, str]) -> bool:
        kind, _, given = headers.get("authorization", "").partition(" ")
        if scope["path"] == "/" and not given:  # a browser opens the page without a header
            kind, given = "Bearer", parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return kind.lower() == "bearer" and secrets.compare_digest(given.encode(), self.token.encode())


def loopback_server(
    app: Callable[[str, int], Guard], port: int, instead: str, **options: Any
) -> tuple[str, Callable[[], None]]:
    """The address with the token, and a function that serves until a signal.

    ``app`` makes the application from token and port; ``instead`` says what to do if the port is taken.

    Raises
    ------
    ConfigError
        If the port is taken.
    """
    listening, token = socket.socket(), secrets.token_urlsafe(24)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
    except OSError as error:
        listening.close()
        raise ConfigError(f"port {port} of {ADDRESS} is not free ({error.strerror}); {instead}") from None
    listening.listen()
    number = listening.getsockname()[1]
    config = uvicorn.Config(
        app(token, number), log_level="warning", access_log=False, server_header=False, ws="none", **options
    )

    def serve() -> None:
        with listening:
            uvicorn.Server(config).run(sockets=[listening])

    return f"http://{ADDRESS}:{number}/?token={token}", serve
