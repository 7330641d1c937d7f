"""Memory of a planning desk over many plans: resident memory of the server and of its worker.

``PYTHONPATH=tests python benchmarks/desk_memory.py --plans 200`` plans small missions one after another,
looks at the front and at every point of each, and prints the memory after each tenth of them.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import psutil

from desk import HOP, RunningDesk, running_desk

MIB = 2**20


def used(desk: RunningDesk) -> tuple[float, float]:
    """Resident memory of the server and of its workers [MiB]."""
    server = psutil.Process(desk.process.pid)
    workers = sum(child.memory_info().rss for child in server.children(recursive=True))
    return server.memory_info().rss / MIB, workers / MIB


def plan_and_look(desk: RunningDesk, seed: int) -> None:
    """One plan, its front, its points and its wind."""
    state = desk.planned(overrides=[*HOP, f"seed={seed}"])
    if state["status"] != "done":
        raise SystemExit(f"seed {seed}: {state['error']}")
    place = f"/api/plans/{state['id']}"
    for number in range(len(desk.client.get(f"{place}/front").json()["points"])):
        desk.client.get(f"{place}/points/{number}").raise_for_status()
    desk.client.get(f"{place}/wind").raise_for_status()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=200)
    count = parser.parse_args().plans
    with tempfile.TemporaryDirectory() as folder, running_desk(Path(folder)) as desk:
        print("plans  server [MiB]  worker [MiB]")
        for seed in range(1, count + 1):
            plan_and_look(desk, seed)
            if seed == 1 or seed % max(1, count // 10) == 0:
                print(f"{seed:5}  {used(desk)[0]:12.0f}  {used(desk)[1]:12.0f}", flush=True)


if __name__ == "__main__":
    main()
