"""Whole runs by the command line: the missions, a cold start, a configuration error, calm wind, memory.

python -m pytest benchmarks/bench_run.py
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from shutil import unpack_archive
from statistics import median
from threading import Event, Thread

import psutil
import pytest

# Exact wind-free optima (visibility graph over the free space, regions closed), in metres.
CALM_OPTIMUM = {"phi1": 1_691_600.0, "phi2": 1_404_000.0}
BUDGETS = {"paper": 3.0, "full": 6.0}  # of a run [s]
# Where Python may write no .pyc file, every run compiles its source anew, which takes 4 s.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def call(folder: Path, *argv: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pareto_ltl", *argv]
    variables = ENVIRONMENT | environment
    return subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, check=False)


def metrics_of(runs: Path) -> dict[str, float]:
    """The metrics of the newest run in a folder of runs."""
    newest = max(runs.iterdir())
    return json.loads((newest / "metrics.json").read_text())


@pytest.mark.parametrize("fidelity", ["paper", "full"])
@pytest.mark.parametrize("mission", ["phi1", "phi2"])
def test_whole_run(benchmark, tmp_path, mission, fidelity):
    benchmark.extra_info["budget"] = BUDGETS[fidelity]
    words = (tmp_path, f"+experiment={mission}", f"fidelity={fidelity}")
    done = benchmark.pedantic(call, words, rounds=5, warmup_rounds=1)
    assert done.returncode == 0, done.stderr
    figures = metrics_of(tmp_path / "outputs" / mission)
    benchmark.extra_info.update({k: v for k, v in figures.items() if isinstance(v, float | int)})


@pytest.mark.parametrize("fidelity", ["paper", "full"])
def test_cold_start(benchmark, tmp_path, fidelity):
    """Seconds of a user's first run minus seconds of the second: compiling kernels and fitting winds."""
    empty = {"PARETO_LTL_CACHE": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    call(tmp_path, "+experiment=phi2", "planner.trees=-1")  # writes .pyc files, which an installation has
    spent: list[tuple[float, float]] = []

    def timed() -> None:
        start, before = time.perf_counter(), os.times().children_user
        done = call(tmp_path, "+experiment=phi2", f"fidelity={fidelity}", **empty)
        assert done.returncode == 0, done.stderr
        spent.append((os.times().children_user - before, time.perf_counter() - start))

    timed()
    benchmark.pedantic(timed, rounds=1)
    (cold_user, cold_wall), (warm_user, warm_wall) = spent
    benchmark.extra_info["figures"] = [
        ("more CPU than the second run [s]", cold_user - warm_user, 20.0),
        ("more time than the second run [s]", cold_wall - warm_wall, 20.0),
    ]


IMPORTS = "import numpy, scipy.optimize, matplotlib.pyplot, numba, sklearn.gaussian_process, hydra"
ROUNDS = 3


def cpu_of(folder: Path, *argv: str, **environment: str) -> float:
    """CPU time [s] of a process of Python and its children."""
    before = os.times()
    done = subprocess.run(
        [sys.executable, *argv], cwd=folder, env=ENVIRONMENT | environment, capture_output=True, check=False
    )
    after = os.times()
    assert done.returncode == 0, done.stderr.decode()
    return after.children_user + after.children_system - before.children_user - before.children_system


def test_ratios(benchmark, tmp_path):
    """CPU time of runs of phi2 over the time of imports, by turns in one benchmark: machines differ by three.

    The first run has empty caches. ``report=none`` is a run until its answer: figures and page follow.
    """
    empty = {"PARETO_LTL_CACHE": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    plan = ("-m", "pareto_ltl", "+experiment=phi2")
    kinds = {
        "full": (*plan,),
        "full until its answer": (*plan, "report=none"),
        "quick until its answer": (*plan, "planner=quick", "report=none"),
        "paper": (*plan, "fidelity=paper"),
        "paper until its answer": (*plan, "fidelity=paper", "report=none"),
        "--help": ("-m", "pareto_ltl", "--help"),
        "import pareto_ltl": ("-c", "import pareto_ltl"),
    }
    first = {}
    for preset in ("full", "paper"):
        place = {name: f"{folder}-{preset}" for name, folder in empty.items()}
        first[preset] = cpu_of(tmp_path, *kinds[preset], **place)
    for words in kinds.values():
        cpu_of(tmp_path, *words, **empty)
    spent: dict[str, list[float]] = {name: [] for name in ("imports", *kinds)}

    def turn() -> None:
        spent["imports"].append(cpu_of(tmp_path, "-c", IMPORTS))
        for name, words in kinds.items():
            spent[name].append(cpu_of(tmp_path, *words, **empty))

    benchmark.pedantic(turn, rounds=ROUNDS)
    unit = median(spent.pop("imports"))
    ratios = {name: median(times) / unit for name, times in spent.items()}
    limits = {"--help": 0.1, "import pareto_ltl": 0.05}
    benchmark.extra_info["figures"] = [
        *((f"{name}, over the imports", ratio, limits.get(name, 3.0)) for name, ratio in ratios.items()),
        *(
            (f"first over second run, {preset}", first[preset] / median(spent[preset]), 4.0)
            for preset in first
        ),
    ]


def test_branches(benchmark, tmp_path):
    """CPU time of phi1 with four branches, at one fix and at two, over the run without; caches are full."""
    plan = ("-m", "pareto_ltl", "+experiment=phi1_branches", "report=none")
    kinds = {
        "without branches": (*plan, "branch.leaves=1"),
        "4 branches": plan,
        "4 branches at each of 2 fixes": (*plan, "branch.at=[5.0,10.0]", "branch.fixes=2"),
    }
    for words in kinds.values():
        cpu_of(tmp_path, *words)
    spent: dict[str, list[float]] = {name: [] for name in kinds}

    def turn() -> None:
        for name, words in kinds.items():
            spent[name].append(cpu_of(tmp_path, *words))

    benchmark.pedantic(turn, rounds=ROUNDS)
    unit = median(spent.pop("without branches"))
    limits = {"4 branches": 4.0, "4 branches at each of 2 fixes": 12.0}
    benchmark.extra_info["figures"] = [
        (f"{name}, over the run without branches", median(times) / unit, limits[name])
        for name, times in spent.items()
    ]


def test_warm_process(benchmark, tmp_path):
    """A run that a warm process answers: the time until its answer is less than half of a plain one."""
    place = {"XDG_RUNTIME_DIR": tempfile.mkdtemp(prefix="w")}
    words = (tmp_path, "+experiment=phi2", "fidelity=paper", "report=none")
    plain = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        call(*words)
        plain.append(time.perf_counter() - began)
    assert call(tmp_path, "warm", **place).returncode == 0
    try:
        benchmark.pedantic(call, words, place, rounds=ROUNDS)
    finally:
        call(tmp_path, "warm", "--stop", **place)
        shutil.rmtree(place["XDG_RUNTIME_DIR"])
    ratio = benchmark.stats.stats.median / median(plain)
    benchmark.extra_info["figures"] = [("paper, over a plain run", ratio, 0.5)]


def test_first_run_from_a_wheel_with_machine_code(benchmark, tmp_path):
    """CPU time of the first run of phi2 over the second; growth against code for this processor."""
    dist, site, root = tmp_path / "dist", tmp_path / "site", Path(__file__).parents[1]
    subprocess.run([sys.executable, "-m", "build", "--wheel", "--outdir", dist, root], check=True)
    (pure,) = dist.glob("*.whl")
    command = [
        sys.executable,
        root / "release" / "machine_code.py",
        pure,
        "--kinds",
        "full",
        "--out",
        tmp_path,
    ]
    subprocess.run(command, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    unpack_archive(wheel, site, "zip")
    empty = {"PARETO_LTL_CACHE": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    spent: list[float] = []

    def timed() -> None:
        before = os.times()
        done = call(tmp_path, "+experiment=phi2", PYTHONPATH=str(site), **empty)
        assert done.returncode == 0, done.stderr
        after = os.times()
        spent.append(
            after.children_user + after.children_system - before.children_user - before.children_system
        )

    timed()
    benchmark.pedantic(timed, rounds=1)
    assert not list((tmp_path / "kernels").rglob("*.nbc"))
    shipped = metrics_of(tmp_path / "outputs" / "phi2")["nodes_per_second"]
    call(tmp_path, "+experiment=phi2")  # compiles, if needed
    call(tmp_path, "+experiment=phi2")
    here = metrics_of(tmp_path / "outputs" / "phi2")["nodes_per_second"]
    benchmark.extra_info["figures"] = [
        ("CPU of the first run over the second", spent[0] / spent[1], 1.5),
        ("speed of growth over code for this processor", shipped / here, 0.95, ">="),
    ]


@pytest.mark.parametrize("mission", ["phi1", "phi2"])
def test_calm_length(benchmark, tmp_path, mission):
    done = benchmark.pedantic(call, (tmp_path, f"+experiment={mission}_calm", "report=none"), rounds=1)
    assert done.returncode == 0, done.stderr
    ratio = metrics_of(tmp_path / "outputs" / f"{mission}_calm")["length_m"] / CALM_OPTIMUM[mission]
    benchmark.extra_info["figures"] = [("length over the optimum", ratio, 1.001)]


def test_help(benchmark, tmp_path):
    benchmark.extra_info["budget"] = 0.7
    assert benchmark.pedantic(call, (tmp_path, "--help"), rounds=5, warmup_rounds=1).returncode == 0


def test_configuration_error(benchmark, tmp_path):
    benchmark.extra_info["budget"] = 0.7
    words = (tmp_path, "+experiment=phi1", "planner.trees=-1")
    done = benchmark.pedantic(call, words, rounds=5, warmup_rounds=1)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1


@dataclass
class Memory:
    """Largest sum of the memory of this program's child processes and their children [bytes], by sampling."""

    peak: float = 0.0

    def watch(self, ended: Event) -> None:
        while not ended.wait(0.02):
            held = 0
            for process in psutil.Process().children(recursive=True):
                try:
                    held += process.memory_info().rss
                except psutil.Error:  # it has just ended
                    continue
            self.peak = max(self.peak, held)


@pytest.mark.parametrize("fidelity", ["paper", "full"])
def test_memory_of_a_run(benchmark, tmp_path, fidelity):
    """Memory of the run and its processes; shared pages count twice."""
    words = (tmp_path, "+experiment=phi2", f"fidelity={fidelity}")
    call(*words)  # compiles
    memory, ended = Memory(), Event()
    watching = Thread(target=memory.watch, args=(ended,))
    watching.start()
    done = benchmark.pedantic(call, words, rounds=1)
    ended.set()
    watching.join()
    assert done.returncode == 0, done.stderr
    benchmark.extra_info["figures"] = [("peak memory [GiB]", memory.peak / 2**30, 0.6)]
