"""A local server in place of NOAA's archives, with the faults that a network can have."""

from __future__ import annotations

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from careful_io.times import seconds
from pareto_ltl_apps.formats import download, live


@dataclass
class NoaaServer:
    """Files by path, and the fault of each request for a path.

    ``fault(path, count)`` names the fault of the ``count``-th request (from 1): None, a status, ``html``,
    ``whole`` (no ranges), ``cut`` and ``short`` (the connection ends in the middle, or before the last byte),
    ``slow``, ``drop`` (no answer), or a
    ``Location`` to go to.
    """

    files: dict[str, bytes] = field(default_factory=dict)
    fault: Callable[[str, int], Any] = lambda path, count: None
    asked: Counter[str] = field(default_factory=Counter)
    ranges: list[tuple[str, str]] = field(default_factory=list)
    address: str = ""


def downloads_at(now: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Downloads as at the time ``now``, without a proxy, an earlier download or long pauses."""
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(download, "FIRST_PAUSE", 0.01)
    monkeypatch.setattr(live, "_FETCHED", {})
    monkeypatch.setattr(live, "_now", lambda: seconds(now))


class QuietServer(ThreadingHTTPServer):
    """A server whose threads end with it, and that says nothing of clients that hang up.

    A traceback of a thread that outlives its test would stand on the error stream of another one.
    """

    daemon_threads = False  # server_close waits for them

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


@contextmanager
def serving(server: NoaaServer) -> Iterator[NoaaServer]:
    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

        def do_GET(self) -> None:
            path = self.path.lstrip("/")
            server.asked[path] += 1
            fault = server.fault(path, server.asked[path])
            wanted = self.headers.get("Range")
            server.ranges.append((path, wanted or ""))
            if fault == "drop":
                self.close_connection = True
                return
            if isinstance(fault, int):
                self.send_error(fault)
                return
            if isinstance(fault, str) and "//" in fault:
                self.send_response(302)
                self.send_header("Location", fault)
                self.end_headers()
                return
            data = b"<html>not here</html>" if fault == "html" else server.files.get(path)
            if data is None:
                self.send_error(404)
                return
            self._answer(data, wanted, fault)

        def _answer(self, data: bytes, wanted: str | None, fault: Any) -> None:
            first, last = 0, len(data) - 1
            partial = wanted is not None and fault != "whole"
            if partial:
                start, end = str(wanted).removeprefix("bytes=").split("-")
                first, last = int(start), min(int(end or last), last)
            self.send_response(206 if partial else 200)
            if partial:
                self.send_header("Content-Range", f"bytes {first}-{last}/{len(data)}")
            body = data[first : last + 1]
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if fault in ("cut", "short"):
                self.wfile.write(body[: (len(body) + 1) // 2] if fault == "cut" else body[:-1])
                self.close_connection = True
            elif fault == "slow":
                for k in range(0, len(body), max(1, len(body) // 5)):
                    self.wfile.write(body[k : k + max(1, len(body) // 5)])
                    self.wfile.flush()
                    time.sleep(0.05)
            else:
                self.wfile.write(body)

    made = QuietServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    server.address = f"http://127.0.0.1:{made.server_port}"
    try:
        yield server
    finally:
        made.shutdown()
        made.server_close()
        thread.join()


def fake_message(body: bytes) -> bytes:
    """The frame of a GRIB2 message, without a field in it."""
    return b"GRIB" + bytes(3) + b"\x02" + (20 + len(body)).to_bytes(8, "big") + body + b"7777"


def inventory(fields: list[tuple[str, str, str, bytes]]) -> tuple[bytes, bytes]:
    """A file of messages (variable, level, forecast, message), and its inventory."""
    lines, offset = [], 0
    for number, (variable, level, forecast, message) in enumerate(fields, 1):
        lines.append(f"{number}:{offset}:d=2018100906:{variable}:{level}:{forecast}:")
        offset += len(message)
    return b"".join(message for *_, message in fields), ("\n".join(lines) + "\n").encode()
