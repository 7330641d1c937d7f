"""Sweeps: overhead of a job, 200 small jobs, the summary of 2,000 jobs.

python -m pytest benchmarks/bench_sweep.py
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

SMALL = (
    "+experiment=phi1", "name=small", "wind=calm", "planner.trees=2", "planner.n_max=500",
    "fidelity.refine=none",     "deployment.runs=50", "report=none", "hydra/launcher=joblib",
)  # fmt: skip


def sweep(folder: Path, *argv: str) -> Path:
    words = [sys.executable, "-m", "pareto_ltl", "-m", *SMALL, *argv]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "multirun" / "small"


def seconds_of_runs(place: Path) -> list[float]:
    with (place / "timings.csv").open(newline="") as file:
        return [float(row["run_seconds"]) for row in csv.DictReader(file)]


def test_two_hundred_small_jobs(benchmark, tmp_path):
    """Time of the whole sweep, and its overhead per job and core without the time of the runs."""
    benchmark.extra_info["budget"] = 240.0
    cores = len(os.sched_getaffinity(0))
    began = time.perf_counter()
    place = benchmark.pedantic(sweep, (tmp_path, "seed=range(0,200)"), rounds=1)
    spent = time.perf_counter() - began
    runs = seconds_of_runs(place)
    assert len(runs) == 200
    benchmark.extra_info["figures"] = [("overhead of a job [s]", (spent * cores - sum(runs)) / 200, 1.5)]


def test_a_sweep_that_is_done_already(benchmark, tmp_path):
    benchmark.extra_info["budget"] = 10.0
    sweep(tmp_path, "seed=range(0,4)")
    benchmark.pedantic(sweep, (tmp_path, "seed=range(0,4)"), rounds=2)


def test_summary_of_two_thousand_jobs(benchmark, tmp_path):
    """Copies of one job with other names, and the list of jobs of the sweep."""
    benchmark.extra_info["budget"] = 10.0
    place = sweep(tmp_path, "seed=range(0,2)", "planner.epsilon=0.05,0.1")
    content = json.loads((place / "sweep.json").read_text())
    model = content["points"][0]
    points = []
    for number in range(2000):
        job = f"{number:016x}"
        (place / job).mkdir()
        for name in ("run.json", "metrics.json"):
            shutil.copy(place / model["job"] / name, place / job / name)
        points.append(
            {
                "job": job,
                "overrides": {"seed": str(number % 500), "planner.epsilon": f"0.0{number // 500 + 1}"},
            }
        )
    (place / "sweep.json").write_text(json.dumps(content | {"points": points}))
    words = [sys.executable, "-m", "pareto_ltl", "sweep", str(place)]
    done = benchmark.pedantic(subprocess.run, (words,), {"capture_output": True, "text": True}, rounds=2)
    assert done.stdout.startswith("2000 ok of 2000 jobs"), done.stderr
