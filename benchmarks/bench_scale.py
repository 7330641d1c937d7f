"""Plans of large problems, in processes of their own: 30 s and 1 GiB; large trees. ``make scale`` has all.

python -m pytest benchmarks/bench_scale.py
"""

from __future__ import annotations

import math
import resource
import subprocess
import sys

import pytest

from scale.__main__ import all_cases, measure
from scale.case import GIBIBYTE

CASES = {case.name: case for case in all_cases()}
LINES = [
    (f"{name}, {model}", size)
    for name, size in (("steps", 500), ("coverage", 10), ("obstacles", 300), ("obstacles", 1000))
    for model in ("paper", "full")
]  # coverage of ten regions is an automaton of 1,024 states
LINES += [("vertices", 1_000_000)]  # of each of ten trees
AIMS = [
    ("coverage", 14, 3.0),
    ("coverage", 12, 1.5),
    ("states", 6561, 2.0),
    ("steps", 1000, 2.0),
    ("regions", 50, 1.5),
]


@pytest.fixture(scope="module")
def unit(tmp_path_factory) -> float:
    """CPU seconds of a default run of phi2, after one that compiles."""
    folder = tmp_path_factory.mktemp("phi2")
    command = [sys.executable, "-m", "pareto_ltl", "+experiment=phi2", f"hydra.run.dir={folder}"]
    for _ in range(2):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize(("name", "size", "aim"), AIMS)
def test_a_wall_of(benchmark, unit, name, size, aim):
    case = CASES[f"{name}, full"]
    measure(case, case.sizes[0])  # compiles
    found = benchmark.pedantic(measure, (case, size), rounds=1)
    seconds = found.seconds if math.isfinite(found.seconds) else math.inf
    benchmark.extra_info["figures"] = [("runs of phi2", seconds / unit, aim)]


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
        ("memory [GiB]", memory / GIBIBYTE, case.memory / GIBIBYTE),
    ]
