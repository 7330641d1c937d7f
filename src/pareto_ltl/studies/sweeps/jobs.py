"""One job of a sweep: what its directory says of it, and doing it once."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pareto_ltl.run import provenance
from pareto_ltl.run.results import read_json
from pareto_ltl.support import locks
from pareto_ltl.support.errors import DataError

LOCK = "run.lock"
KEPT = (LOCK, ".hydra", "run.log")  # of a run that is made again
HASH = 16  # digits of the fingerprint that name a directory
ANSWERS = ("ok", "infeasible")  # a mission without a plan is an answer too
KILLED = "ended without a word: killed, out of memory, or its disk was full"

Metrics = Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class State:
    """What is known of a job.

    Attributes
    ----------
    status : str
        ``ok`` and ``infeasible`` are answers; ``failed``, ``running`` and ``pending`` are not.
    """

    status: str
    error: str | None = None
    metrics: Metrics = field(default_factory=dict)
    record: Mapping[str, Any] = field(default_factory=dict)

    @property
    def answered(self) -> bool:
        return self.status in ANSWERS


def look(directory: Path) -> State:
    """What a job's directory says; never an exception, for others must still be shown."""
    if not (directory / "run.json").is_file():
        at_work = locks.is_held(directory / LOCK)
        return State("running" if at_work else "pending")
    try:
        record = read_json(directory / "run.json")
    except DataError:
        return State("failed", "run.json cannot be read")
    status, error = str(record.get("status")), record.get("error")
    if status == "running":
        alive = locks.is_held(directory / LOCK)
        return State("running" if alive else "failed", None if alive else KILLED, record=record)
    if status not in ANSWERS:
        return State("failed", str(error), record=record)
    if not record.get("measured", status == "ok"):
        return State(status, error, record=record)
    try:
        return State(status, error, _metrics(directory / "metrics.json"), record)
    except DataError:
        at_work = locks.is_held(directory / LOCK)  # run.json comes just before metrics.json
        return State(
            "running" if at_work else "failed",
            None if at_work else "metrics.json is missing or damaged",
            record=record,
        )


def _metrics(path: Path) -> Metrics:
    table = read_json(path)
    numbers = all(
        value is None or (isinstance(value, float | int) and not isinstance(value, bool))
        for value in table.values()
    )
    if "completed" not in table or not numbers:
        raise DataError(f"{path}: not the metrics of a run")
    return table


def settled(directory: Path) -> bool:
    """Whether the job has its answer, made by this code from these settings and the same input files."""
    state = look(directory)
    return (
        state.answered
        and str(state.record.get("config_hash", "")).startswith(directory.name)
        and provenance.unchanged(state.record.get("inputs") or {})
    )


def once(directory: Path, work: Callable[[], object], *, resume: bool = True) -> bool:
    """Do ``work`` in ``directory`` unless it is done; return whether it was done now.

    Whoever comes second waits for the first, and then finds the answer.
    """
    directory.mkdir(parents=True, exist_ok=True)
    busy = locks.is_held(directory / LOCK)
    with locks.held(directory / LOCK):
        if (resume or busy) and settled(directory):
            return False
        clear(directory)
        work()
    return True


def clear(directory: Path) -> None:
    """Remove what an earlier attempt left behind; its log stays."""
    for path in directory.iterdir():
        if path.name in KEPT:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
