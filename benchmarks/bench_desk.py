"""The planning desk on phi2, with a warm server: the first path, the whole front, and a click on a point.

python -m pytest benchmarks/bench_desk.py
"""

from __future__ import annotations

import json
import time
from itertools import count

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the desk needs the extra serve")
from desk import running_desk

PLANS = 5


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    with running_desk(tmp_path_factory.mktemp("desk")) as running:
        yield running


def planned(desk, seed: int) -> tuple[str, float, float]:
    """The id of a plan of phi2, and the seconds from the request to its first path and its whole front."""
    began, first, front = time.perf_counter(), None, None
    words = ["+experiment=phi2", f"seed={seed}"]
    name = desk.client.post("/api/plans", json={"overrides": words}).json()["id"]
    with desk.client.stream("GET", f"/api/plans/{name}/events") as stream:
        for line in stream.iter_lines():
            event = json.loads(line.removeprefix("data:")) if line.startswith("data:") else {}
            if event.get("event") == "paths":
                first = first or time.perf_counter() - began
                if event["source"] == "front":
                    front = time.perf_counter() - began
    assert desk.client.get(f"/api/plans/{name}").json()["status"] == "done"
    return name, first, front


def test_plan(benchmark, desk):
    seeds, moments = count(), []

    def run():
        return moments.append(planned(desk, next(seeds))[1:])

    benchmark.pedantic(run, rounds=PLANS, warmup_rounds=1)
    first, front = np.median(moments[1:], axis=0)
    limits = [("first path [s]", float(first), 1.0), ("whole front [s]", float(front), 5.0)]
    benchmark.extra_info["figures"] = limits


def test_click_on_a_point(benchmark, desk):
    name, *_ = planned(desk, 100)
    points = len(desk.client.get(f"/api/plans/{name}/front").json()["points"])
    numbers = iter(range(points))
    benchmark.extra_info["budget"] = 0.1

    def click() -> None:
        desk.client.get(f"/api/plans/{name}/points/{next(numbers)}").raise_for_status()

    benchmark.pedantic(click, rounds=points)
