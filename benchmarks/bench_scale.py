"""Plans of large problems, each in a process of its own: 30 s of CPU and 1 GiB. ``make scale`` has all sizes.

python -m pytest benchmarks/bench_scale.py
"""

from __future__ import annotations

import math

import pytest

from scale.__main__ import GIBIBYTE, all_cases, measure

CASES = {case.name: case for case in all_cases()}
LINES = [
    (f"{name}, {model}", size)
    for name, size in (("steps", 500), ("coverage", 10), ("obstacles", 300), ("obstacles", 1000))
    for model in ("paper", "full")
]  # coverage of ten regions is an automaton of 1,024 states


@pytest.mark.parametrize(("name", "size"), LINES)
def test_a_plan_of(benchmark, name, size):
    case = CASES[name]
    measure(case, case.sizes[0])  # compiles
    found = benchmark.pedantic(measure, (case, size), rounds=1)
    if found.fault:
        print(f"{name}, {size}: {found.fault}")
    seconds, memory = (value if math.isfinite(value) else math.inf for value in (found.seconds, found.memory))
    benchmark.extra_info["figures"] = [
        ("CPU seconds", seconds, case.limit),
        ("memory [GiB]", memory / GIBIBYTE, 1.0),
    ]
