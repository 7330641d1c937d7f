"""Limits of connections: how many there are, how long a request may take to arrive, and how large it is.

uvicorn limits the time between two requests, but not the time in which one arrives: a client that sends a
byte now and then would hold a connection for ever.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a server.

    Attributes
    ----------
    connections : int
        Open at a time.
    headers, body : float
        Time for all headers, and for the whole body of a request [s].
    header_bytes : int
        Of all headers of a request.
    """

    connections: int = 100
    headers: float = 10.0
    body: float = 60.0
    header_bytes: int = 32_768


class BoundedProtocol(H11Protocol):
    """HTTP/1.1 within ``limits``."""

    limits: ClassVar[Limits] = Limits()

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.awaited: Any = None  # state of the client in which the timer was started
        self.timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection, or refuse it if there are too many."""
        super().connection_made(transport)
        if len(self.connections) > self.limits.connections:
            self._refuse(503, f"this server has {self.limits.connections} connections already; close some")
        self._watch()

    def data_received(self, data: bytes) -> None:
        """Read a part of a request."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        self._unset_timer()

    def _watch(self) -> None:
        """Start a timer when headers or a body begin to be awaited; stop it when they are complete."""
        state = self.conn.their_state
        waiting = state in (h11.IDLE, h11.SEND_BODY) and not self.transport.is_closing()
        if waiting and state is self.awaited:
            return
        self._unset_timer()
        if waiting:
            seconds = self.limits.headers if state is h11.IDLE else self.limits.body
            self.awaited, self.timer = state, self.loop.call_later(seconds, self._too_slow, seconds)

    def _unset_timer(self) -> None:
        if self.timer is not None:
            self.timer.cancel()
        self.awaited, self.timer = None, None

    def _too_slow(self, seconds: float) -> None:
        self._refuse(408, f"the request did not arrive within {seconds:g} s")

    def _refuse(self, status: int, text: str) -> None:
        """Answer, if no answer has begun, and close the connection."""
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            content = text.encode()
            headers = [
                ("content-type", "text/plain; charset=utf-8"), ("content-length", str(len(content))),
                ("connection", "close"),
            ]  # fmt: skip
            parts = (
                h11.Response(status_code=status, headers=headers),
                h11.Data(data=content),
                h11.EndOfMessage(),
            )
            for part in parts:
                self.transport.write(self.conn.send(part) or b"")
        self.transport.close()


def bounded(limits: Limits) -> type[BoundedProtocol]:
    """The protocol with these limits."""
    return type("BoundedProtocol", (BoundedProtocol,), {"limits": limits})
