"""One row a job, and one group for each combination of swept settings without its seeds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.simulation.flights import clopper_pearson
from pareto_ltl.studies.sweeps import jobs
from pareto_ltl.studies.sweeps.jobs import State
from pareto_ltl.studies.sweeps.manifest import Manifest

CLOCK = ("memory_mib",)
STATUSES = ("ok", "infeasible", "failed", "running", "pending")
RATES = ("failure", "mission_failure", "collision")  # of deployments, one a law


@dataclass(frozen=True, slots=True)
class Row:
    """A job as the table shows it; numbers of the clock are kept apart from results."""

    job: str
    overrides: Mapping[str, str]
    state: State

    @property
    def results(self) -> dict[str, float | None]:
        return {name: value for name, value in self.state.metrics.items() if not is_clock(name)}

    @property
    def clock(self) -> dict[str, float | None]:
        return {name: value for name, value in self.state.metrics.items() if is_clock(name)}


@dataclass(frozen=True, slots=True)
class Group:
    """Jobs that differ in their seeds alone.

    Attributes
    ----------
    counts : mapping of str to int
        Jobs by status.
    quartiles : mapping of str to (3,) list
        Lower quartile, median, upper quartile of every metric over the jobs that have it.
    rates : mapping of str to dict
        Pooled over all simulated flights: ``events`` of ``runs``, their ``rate`` and its exact 95 %
        interval, ``low`` and ``high``. ``completed`` counts jobs that found a plan, of those with an answer.
    """

    overrides: Mapping[str, str]
    counts: Mapping[str, int]
    quartiles: Mapping[str, list[float]]
    rates: Mapping[str, Mapping[str, float]]


def is_seed(key: str) -> bool:
    """Whether a setting is one more throw of the dice: ``seed``, ``scene.random.seed``."""
    return key.rpartition(".")[2] == "seed"


def is_clock(name: str) -> bool:
    """Whether a metric differs from one execution to the next."""
    return name.startswith("seconds_") or name.endswith(("_seconds", "_per_second")) or name in CLOCK


def rows(place: Path, manifest: Manifest, given_up: Mapping[str, str] | None = None) -> list[Row]:
    """Every point of the sweep in the order of its grid, with what its directory says."""
    known = given_up or {}
    table = []
    for point in manifest.points:
        state = jobs.look(place / point.job)
        if not state.answered and point.job in known:
            state = State("failed", known[point.job], record=state.record)
        table.append(Row(point.job, point.overrides, state))
    return table


def counts(table: Sequence[Row]) -> dict[str, int]:
    """Rows by status."""
    found = [row.state.status for row in table]
    return {status: found.count(status) for status in STATUSES if status in found}


def columns(tables: Iterable[Mapping[str, Any]]) -> list[str]:
    """Names in the order in which they first appear."""
    return list(dict.fromkeys(name for table in tables for name in table))


def groups(table: Sequence[Row]) -> list[Group]:
    """The rows by all their settings but the seeds, in the order of the grid."""
    members: dict[tuple[tuple[str, str], ...], list[Row]] = {}
    for row in table:
        key = tuple((name, value) for name, value in row.overrides.items() if not is_seed(name))
        members.setdefault(key, []).append(row)
    return [_group(dict(key), found) for key, found in members.items()]


def _group(overrides: Mapping[str, str], members: Sequence[Row]) -> Group:
    answered = [row for row in members if row.state.answered]
    metrics = [row.state.metrics for row in answered]
    return Group(overrides, counts(members), _quartiles(metrics), _rates(answered, metrics))


def _quartiles(metrics: Sequence[jobs.Metrics]) -> dict[str, list[float]]:
    summary = {}
    for name in columns(metrics):
        values = [value for table in metrics if (value := table.get(name)) is not None]
        if values:
            summary[name] = [float(q) for q in np.quantile(values, [0.25, 0.5, 0.75])]
    return summary


def _rates(answered: Sequence[Row], metrics: Sequence[jobs.Metrics]) -> dict[str, dict[str, float]]:
    """Rates over all flights of all jobs, as if they were one experiment."""
    pooled = {}
    if answered:
        pooled["completed"] = _rate(sum(row.state.status == "ok" for row in answered), len(answered))
    laws = [name.removeprefix("runs_") for name in columns(metrics) if name.startswith("runs_")]
    for name in (f"{rate}_{law}" for law in laws for rate in RATES):
        law = next(law for law in laws if name.endswith(f"_{law}"))
        pairs = [
            (share * runs, runs)
            for table in metrics
            if (share := table.get(name)) is not None and (runs := table.get(f"runs_{law}")) is not None
        ]
        if pairs:
            pooled[name] = _rate(round(math.fsum(e for e, _ in pairs)), round(math.fsum(n for _, n in pairs)))
    return pooled


def _rate(events: int, runs: int) -> dict[str, float]:
    low, high = clopper_pearson(events, runs)
    return {"events": events, "runs": runs, "rate": events / runs, "low": low, "high": high}
