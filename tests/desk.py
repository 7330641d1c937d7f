"""A desk for tests: the server as a process, a client with its token, and a small mission."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from quick_wind import wind_words

MOST = 180.0  # [s] that a slow machine may take
SMALL = [
    "robot=light_aircraft", "robot.dt=60.0", "robot.level=null", "planner.trees=1", "planner.n_max=400",
    "refine.flights=20", "refine.sweep_flights=10", "refine.classes=1", "refine.points=2",
    "selection=worth", "selection.draws=20", "selection.runs=200", "deployment.runs=10", "report=none",
    *wind_words(),
]  # fmt: skip
HOP = ["+experiment=hop", *SMALL]


@dataclass
class RunningDesk:
    """A server, its address with the token, and a client."""

    process: subprocess.Popen[str]
    address: str
    client: httpx.Client

    def ended(self, name: str) -> dict[str, Any]:
        """The state of a plan that has ended."""
        last = time.monotonic() + MOST
        while time.monotonic() < last:
            state: dict[str, Any] = self.client.get(f"/api/plans/{name}").json()
            if state["status"] != "running":
                return state
            time.sleep(0.1)
        pytest.fail(f"{name} is running after {MOST} s")

    def planned(self, **request: Any) -> dict[str, Any]:
        """The state of a new plan that has ended."""
        answer = self.client.post("/api/plans", json=request)
        assert answer.status_code == 202, answer.text
        return self.ended(answer.json()["id"])


@contextmanager
def running_desk(
    folder: Path, largest_file: int | None = None, browser: str | None = None
) -> Iterator[RunningDesk]:
    """A desk on a free port.

    ``largest_file`` [bytes] stands for a disk that is full; ``browser``: a command that opens the page.
    """
    limit = [] if largest_file is None else ["prlimit", f"--fsize={largest_file}"]
    words = [*limit, sys.executable, "-m", "pareto_ltl", "serve", "--port", "0", "--folder", str(folder)]
    process = subprocess.Popen(
        words if browser else [*words, "--no-browser"],
        stdout=subprocess.PIPE, text=True, env=os.environ | ({"BROWSER": browser} if browser else {}),
    )  # fmt: skip
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        base, _, token = address.partition("/?token=")
        with httpx.Client(
            base_url=base, headers={"Authorization": f"Bearer {token}"}, timeout=MOST
        ) as client:
            yield RunningDesk(process, address, client)
    finally:
        process.terminate()
        process.communicate(timeout=30)


@dataclass(frozen=True)
class DirectClient:
    """Requests to an application in this process, without a server."""

    app: Any
    base: str

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        """The answer to one request."""

        async def answered() -> httpx.Response:
            transport = httpx.ASGITransport(self.app)
            async with httpx.AsyncClient(transport=transport, base_url=self.base) as client:
                return await client.request(method, path, **options)

        return asyncio.run(answered())

    def get(self, path: str, **options: Any) -> httpx.Response:
        return self.request("GET", path, **options)

    def post(self, path: str, **options: Any) -> httpx.Response:
        return self.request("POST", path, **options)
