"""The studies of the evaluation of the paper, by the command line, on all cores.

python -m pytest benchmarks/bench_evaluation.py
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

BUDGETS = {"compare": 30.0, "convergence": 300.0}  # [s], twenty seeds, two cores


def call(folder: Path, *argv: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pareto_ltl", *argv]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("mission", ["phi1", "phi2"])
@pytest.mark.parametrize("study", BUDGETS)
def test_study(benchmark, tmp_path, study, mission):
    benchmark.extra_info["budget"] = BUDGETS[study]
    assert (
        call(tmp_path, f"+experiment={mission}", "deployment.runs=1", "report=none").returncode == 0
    )  # caches
    done = benchmark.pedantic(call, (tmp_path, f"pipelines={study}", f"+experiment={mission}"), rounds=1)
    assert done.returncode == 0, done.stderr
