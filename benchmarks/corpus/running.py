"""Runs of the missions: each a process of its own, with its CPU time; finished ones are not repeated."""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus.missions import Mission

TIMED_OUT = 124
LARGE = ("trees.npz", "front.npz", "deployments.npz", "wind.nc", "cells.json")  # not kept
VARIANTS: dict[str, list[str]] = {  # words of each
    "full": [],
    "quick": ["planner=quick"],
    "bare": [],  # on the map without its landmarks
}


STOPPED = threading.Event()  # by a signal: the runs of this process are stopped and not recorded


@dataclass(frozen=True, slots=True)
class Task:
    """One run."""

    mission: str
    variant: str
    seed: int

    @property
    def key(self) -> tuple[str, str, int]:
        return self.mission, self.variant, self.seed


def tasks(missions: Sequence[Mission], seeds: Sequence[int], variants: Sequence[str]) -> list[Task]:
    """All runs, seed by seed; without landmarks only the missions that have some."""
    return [
        Task(mission.name, variant, seed)
        for seed in seeds
        for mission in missions
        for variant in variants
        if variant != "bare" or mission.tags["landmarks"]
    ]


def prepare(missions: Sequence[Mission], out: Path, identity: dict[str, Any]) -> None:
    """Write the files of the missions; exits if the folder holds runs of other missions or settings."""
    out.mkdir(parents=True, exist_ok=True)
    mark = out / "corpus.json"
    if mark.exists() and json.loads(mark.read_text()) != identity:
        sys.exit(
            f"{mark} is of {mark.read_text().strip()}, not of {json.dumps(identity)}; choose another --out"
        )
    mark.write_text(json.dumps(identity) + "\n")
    for mission in missions:
        mission.write(out / "missions" / mission.name)


def read_rows(out: Path) -> list[dict[str, Any]]:
    """The finished runs; a line that a killed process left incomplete is ignored."""
    file = out / "rows.jsonl"
    rows = []
    for line in file.read_text().splitlines() if file.exists() else []:
        with suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


def read_tags(out: Path) -> dict[str, dict[str, Any]]:
    """The tags of the missions of a folder, by name."""
    files = sorted((out / "missions").glob("*/mission.json"))
    return {file.parent.name: json.loads(file.read_text())["tags"] for file in files}


def run_all(wanted: Sequence[Task], out: Path, asked: argparse.Namespace) -> None:
    """Run what is not finished yet, in ``asked.jobs`` lanes, and add the rows to rows.jsonl."""
    done = {(row["mission"], row["variant"], row["seed"]) for row in read_rows(out)}
    missing = [task for task in wanted if task.key not in done]
    file = out / "rows.jsonl"
    if file.exists() and not file.read_text().endswith("\n"):
        file.write_text(file.read_text() + "\n")  # after a line that a killed process left incomplete
    lock = threading.Lock()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: STOPPED.set())

    def run(task: Task) -> None:
        if STOPPED.is_set():
            return
        row = run_one(task, out, asked.words, asked.limit)
        if STOPPED.is_set():
            return
        with lock:
            done.add(task.key)
            with file.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
            print(shown(row), f"{len(done)} runs", flush=True)

    with ThreadPoolExecutor(asked.jobs) as lanes:
        for ended in [lanes.submit(run, task) for task in missing]:
            ended.result()
    if STOPPED.is_set():
        sys.exit("stopped; the same command continues")


def command(task: Task, out: Path, words: Sequence[str]) -> list[str]:
    """The command line of one run."""
    folder = out / "missions" / task.mission
    own = json.loads((folder / "mission.json").read_text())["words"]
    if task.variant == "bare":
        own = [word.replace(f"{folder}/map.", f"{folder}/bare.") for word in own]
    target = f"hydra.run.dir='{result_folder(task, out)}'"
    fixed = [f"seed={task.seed}", "report=none", "exports=none", target]
    return [sys.executable, "-m", "pareto_ltl", "plan", *own, *VARIANTS[task.variant], *fixed, *words]


def result_folder(task: Task, out: Path) -> Path:
    """Where the results of one run are."""
    return out / "runs" / f"{task.mission}-{task.variant}-{task.seed}"


def run_one(task: Task, out: Path, words: Sequence[str], limit: float) -> dict[str, Any]:
    """Plan once; the row of the run."""
    folder = result_folder(task, out)
    folder.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    with (folder / "said.txt").open("w+") as said:
        process = subprocess.Popen(
            command(task, out, words), stdout=said, stderr=said, start_new_session=True
        )
        code, cpu = wait(process, begun + limit)
        said.seek(0)
        lines = [line.strip() for line in said if line.strip()]
    row = {
        "mission": task.mission,
        "variant": task.variant,
        "seed": task.seed,
        "code": code,
        "cpu": round(cpu, 1),
    }
    row |= {"seconds": round(time.monotonic() - begun, 1), "cold": is_cold(folder)}
    row |= (
        results(folder)
        if code == 0
        else {"said": "too slow" if code == TIMED_OUT else "".join(lines[-1:])[:500]}
    )
    for name in LARGE:
        (folder / name).unlink(missing_ok=True)
    return row


def is_cold(folder: Path) -> bool:
    """Whether a run compiled kernels, so that its time does not count."""
    log = folder / "run.log"
    return log.exists() and "compiling for this machine" in log.read_text(encoding="utf-8", errors="replace")


def wait(process: subprocess.Popen[Any], deadline: float) -> tuple[int, float]:
    """Exit code and CPU seconds of a process and its children; its group is killed at ``deadline``."""
    code = None
    while True:
        pid, status, used = os.wait4(process.pid, os.WNOHANG if code is None else 0)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode if code is None else code, used.ru_utime + used.ru_stime
        if code is None and (STOPPED.is_set() or time.monotonic() > deadline):
            os.killpg(process.pid, signal.SIGKILL)
            code = TIMED_OUT
        time.sleep(0.1)


def unit_seconds(out: Path, words: Sequence[str], limit: float) -> float:
    """CPU seconds of a warm default run of phi2: the second of two; measured once for ``out``."""
    kept = out / "unit.json"
    if not kept.exists():
        target = [f"hydra.run.dir={out / 'unit'}", "report=none", "exports=none"]
        plan = [sys.executable, "-m", "pareto_ltl", "plan", "+experiment=phi2", *target, *words]
        for _ in range(2):
            process = subprocess.Popen(plan, stdout=subprocess.DEVNULL, start_new_session=True)
            code, cpu = wait(process, time.monotonic() + limit)
        if code:
            sys.exit(f"phi2, the unit of CPU time, ended with exit code {code}: {' '.join(plan)}")
        kept.write_text(json.dumps({"cpu": cpu}) + "\n")
    return float(json.loads(kept.read_text())["cpu"])


def results(folder: Path) -> dict[str, Any]:
    """What a run found: promise with its interval, length [m], front (failure, low, high, length [m])."""
    metrics = json.loads((folder / "metrics.json").read_text())
    plan = json.loads((folder / "plan.json").read_text())
    with (folder / "front.csv").open(newline="") as file:
        names = ("failure", "failure_low", "failure_high", "length_m")
        front = [[float(row[name]) for name in names] for row in csv.DictReader(file)]
    return {
        "promise": metrics["promise_failure"],
        "low": metrics["promise_low"],
        "high": metrics["promise_high"],
        "length": metrics["length_m"],
        "epsilon_kept": metrics.get("epsilon_kept", 1.0),  # earlier versions have no other plan
        "front": front,
        "origin": plan["origin"],
        "order": plan["order"],
    }


def shown(row: dict[str, Any]) -> str:
    """One line about a run."""
    name = f"{row['mission']} {row['variant']:<5} seed {row['seed']}: "
    if row["code"]:
        return f"{name}exit code {row['code']}, {row['cpu']:.0f} CPU s, {row['said'][:150]}"
    promise = (
        f"{100 * row['promise']:.3g} % over {row['length'] / 1e3:.4g} km, {len(row['front'])} on the front"
    )
    return f"{name}{promise}, {row['cpu']:.0f} CPU s"
