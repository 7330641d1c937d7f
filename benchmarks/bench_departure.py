"""Seven starts of phi2 against one run, both warm.

python -m pytest benchmarks/bench_departure.py
"""

from __future__ import annotations

import os
import time

from bench_run import call

LAST = "departure.last=2018-10-09T18:00:00Z"  # 00Z, 03Z, ... 18Z: seven starts
ONCE = "departure.seeds=1"
ROUNDS = 3


def spent(tmp_path, *words: str) -> tuple[float, float]:
    """Elapsed seconds and CPU seconds of all cores."""
    begin, before = time.perf_counter(), os.times()
    done = call(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - begin, cpu


def test_seven_starts(benchmark, tmp_path):
    """All are measured in turn, so that other work on the machine slows all; the least ratio counts."""
    one, seven = ("+experiment=phi2",), ("departure", "+experiment=phi2", LAST)
    for words in (one, seven):
        call(tmp_path, *words)  # fits winds and compiles kernels
    times = [[spent(tmp_path, *words) for words in (one, (*seven, ONCE), seven)] for _ in range(ROUNDS)]
    clock, cpu, repeated = (
        min(row[which][k] / row[0][k] for row in times) for which, k in ((1, 0), (1, 1), (2, 1))
    )
    benchmark.extra_info["figures"] = [
        ("seven starts with one seed over one run, on the clock", clock, 2.5),
        ("seven starts with one seed over one run, CPU", cpu, 2.5),
        ("seven starts with up to three seeds over one run, CPU", repeated, 5.0),
    ]
    benchmark.pedantic(call, (tmp_path, *seven), rounds=1)
