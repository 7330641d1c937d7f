"""What every request must have: the address of this server, no foreign origin, and the token."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qs

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOSTS = ("127.0.0.1", "localhost")
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
class Refusal:
    """The status and the text of the answer to a request that is not accepted."""

    status: int
    text: str


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
            answer = JSONResponse({"error": refusal.text}, refusal.status)
            await answer(scope, receive, send_guarded)

    def refusal(self, scope: Scope) -> Refusal | None:
        """Why the request of ``scope`` is refused; None if it is accepted."""
        given = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]]
        headers: Mapping[str, str] = dict(given)
        if sum(name == "host" for name, _ in given) != 1 or headers["host"] not in self._hosts():
            return Refusal(421, f"the host must be {HOSTS[0]}:{self.port}")
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self._hosts()}:
            return Refusal(403, "requests of other pages are refused")
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return Refusal(403, "requests of other sites are refused")
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > MOST_BYTES or "transfer-encoding" in headers:
            return Refusal(413, f"send at most {MOST_BYTES:,} bytes, with their number in Content-Length")
        if self._needs_token(scope) and not self._has_token(scope, headers):
            return Refusal(
                401, "the token is missing or wrong: use the address that pareto-ltl serve printed"
            )
        return None

    def _hosts(self) -> tuple[str, ...]:
        return tuple(f"{host}:{self.port}" for host in HOSTS)

    def _needs_token(self, scope: Scope) -> bool:
        return not str(scope["path"]).startswith("/desk/")

    def _has_token(self, scope: Scope, headers: Mapping[str, str]) -> bool:
        kind, _, given = headers.get("authorization", "").partition(" ")
        if scope["path"] == "/" and not given:  # a browser opens the page without a header
            kind, given = "Bearer", parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return kind.lower() == "bearer" and secrets.compare_digest(given.encode(), self.token.encode())
