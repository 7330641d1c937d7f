"""Whole runs by the command line: the missions, a configuration error, the optimum in calm wind, memory.

python -m pytest benchmarks/bench_run.py
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

# Exact wind-free optima (visibility graph over the free space, regions closed), in metres.
CALM_OPTIMUM = {"phi1": 1_691_600.0, "phi2": 1_404_000.0}


def call(folder: Path, *argv: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pareto_ltl", *argv]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("fidelity", ["paper", "full"])
@pytest.mark.parametrize("mission", ["phi1", "phi2"])
def test_whole_run(benchmark, tmp_path, mission, fidelity):
    benchmark.extra_info["budget"] = 6.0
    words = (tmp_path, f"+experiment={mission}", f"fidelity={fidelity}")
    done = benchmark.pedantic(call, words, rounds=3, warmup_rounds=1)
    assert done.returncode == 0, done.stderr
    newest = max((tmp_path / "outputs" / mission).iterdir())
    figures = json.loads((newest / "metrics.json").read_text())
    benchmark.extra_info.update({k: v for k, v in figures.items() if isinstance(v, float | int)})


@pytest.mark.parametrize("mission", ["phi1", "phi2"])
def test_calm_length(benchmark, tmp_path, mission):
    done = benchmark.pedantic(call, (tmp_path, f"+experiment={mission}_calm", "report=none"), rounds=1)
    assert done.returncode == 0, done.stderr
    newest = max((tmp_path / "outputs" / f"{mission}_calm").iterdir())
    metrics = json.loads((newest / "metrics.json").read_text())
    ratio = metrics["length_m"] / CALM_OPTIMUM[mission]
    benchmark.extra_info["figures"] = [("length over the optimum", ratio, 1.01)]


def test_help(benchmark, tmp_path):
    benchmark.extra_info["budget"] = 1.0
    assert benchmark.pedantic(call, (tmp_path, "--help"), rounds=5).returncode == 0


def test_configuration_error(benchmark, tmp_path):
    benchmark.extra_info["budget"] = 1.0
    done = benchmark.pedantic(call, (tmp_path, "+experiment=phi1", "planner.trees=-1"), rounds=5)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1


def test_memory_of_a_run(benchmark, tmp_path):
    def measured() -> float:
        pid = os.posix_spawn(
            sys.executable,
            [sys.executable, "-m", "pareto_ltl", "+experiment=phi2", f"hydra.run.dir={tmp_path}/run"],
            dict(os.environ),
        )
        _, status, usage = os.wait4(pid, 0)
        assert status == 0
        return usage.ru_maxrss * 1024.0  # Linux counts in KiB

    peak = benchmark.pedantic(measured, rounds=1)
    benchmark.extra_info["figures"] = [("peak memory [GiB]", peak / 2**30, 1.0)]
