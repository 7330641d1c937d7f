"""One row for each run, and one group for all seeds of a combination of the other swept settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pareto_ltl.studies.jobs import JobState, Metrics
from pareto_ltl.studies.statistics import PooledRate, pooled_shares, quartiles_of
from pareto_ltl.studies.sweeps.manifest import SweepManifest
from pareto_ltl.studies.sweeps.runs import RunJob

CLOCK_METRICS = ("memory_mib",)
JOB_STATUSES = ("ok", "infeasible", "failed", "running", "pending")
POOLED_RATES = ("failure", "mission_failure", "collision")  # of deployments, for each law


@dataclass(frozen=True, slots=True)
class SweepRow:
    """A run in the table; times and memory are separate from results."""

    job: str
    overrides: Mapping[str, str]
    state: JobState

    @property
    def results(self) -> dict[str, float | None]:
        """Metrics that settings and seeds determine."""
        return {name: value for name, value in self.state.metrics.items() if not is_clock(name)}

    @property
    def clock(self) -> dict[str, float | None]:
        """Metrics that differ from one execution to the next."""
        return {name: value for name, value in self.state.metrics.items() if is_clock(name)}


@dataclass(frozen=True, slots=True)
class SeedGroup:
    """Runs that differ only in their seeds.

    Attributes
    ----------
    counts : mapping of str to int
        Runs by status.
    quartiles : mapping of str to (3,) list
        Lower quartile, median, upper quartile of every metric over the runs that have it.
    rates : mapping of str to dict
        Pooled over all simulated flights: ``events`` of ``runs``, their ``rate`` and its exact 95 %
        interval, ``low`` and ``high``. ``completed`` counts runs with a plan, of all runs with a result.
    """

    overrides: Mapping[str, str]
    counts: Mapping[str, int]
    quartiles: Mapping[str, list[float]]
    rates: Mapping[str, Mapping[str, float]]


def is_seed(key: str) -> bool:
    """Whether a setting only changes random numbers: ``seed``, ``scene.random.seed``."""
    return key.rpartition(".")[2] == "seed"


def is_clock(name: str) -> bool:
    """Whether a metric differs from one execution to the next."""
    return name.startswith("seconds_") or name.endswith(("_seconds", "_per_second")) or name in CLOCK_METRICS


def sweep_rows(
    place: Path, manifest: SweepManifest, given_up: Mapping[str, str] | None = None
) -> list[SweepRow]:
    """Every point of the sweep in the order of its grid, with the state of its directory."""
    known = given_up or {}
    rows = []
    for point in manifest.points:
        state = RunJob(place / point.job).look()
        if not state.answered and point.job in known:
            state = JobState("failed", known[point.job], record=state.record)
        rows.append(SweepRow(point.job, point.overrides, state))
    return rows


def status_counts(rows: Sequence[SweepRow]) -> dict[str, int]:
    """Number of rows by status, results first."""
    found = [row.state.status for row in rows]
    return {status: found.count(status) for status in JOB_STATUSES if status in found}


def column_names(mappings: Iterable[Mapping[str, Any]]) -> list[str]:
    """Keys of all ``mappings`` in the order in which they first appear."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))


def seed_groups(rows: Sequence[SweepRow]) -> list[SeedGroup]:
    """The rows by all their settings but the seeds, in the order of the grid."""
    members: dict[tuple[tuple[str, str], ...], list[SweepRow]] = {}
    for row in rows:
        key = tuple((name, value) for name, value in row.overrides.items() if not is_seed(name))
        members.setdefault(key, []).append(row)
    return [_seed_group(dict(key), found) for key, found in members.items()]


def _seed_group(overrides: Mapping[str, str], members: Sequence[SweepRow]) -> SeedGroup:
    answered = [row for row in members if row.state.answered]
    metrics = [row.state.metrics for row in answered]
    quartiles, rates = _metric_quartiles(metrics), _pooled_rates(answered, metrics)
    return SeedGroup(overrides, status_counts(members), quartiles, rates)


def _metric_quartiles(metrics: Sequence[Metrics]) -> dict[str, list[float]]:
    quartiles = {}
    for name in column_names(metrics):
        if values := [value for run in metrics if (value := run.get(name)) is not None]:
            quartiles[name] = list(quartiles_of(values))
    return quartiles


def _pooled_rates(answered: Sequence[SweepRow], metrics: Sequence[Metrics]) -> dict[str, dict[str, float]]:
    """Rates over all flights of all runs, as if they were one experiment."""
    pooled = {}
    if answered:
        plans = sum(row.state.status == "ok" for row in answered)
        pooled["completed"] = _rate_entry(PooledRate(plans, len(answered)))
    laws = [name.removeprefix("runs_") for name in column_names(metrics) if name.startswith("runs_")]
    for law in laws:
        for name in (f"{rate}_{law}" for rate in POOLED_RATES):
            pairs = [
                (share, runs)
                for run in metrics
                if (share := run.get(name)) is not None and (runs := run.get(f"runs_{law}")) is not None
            ]
            if pairs:
                pooled[name] = _rate_entry(pooled_shares(pairs))
    return pooled


def _rate_entry(found: PooledRate) -> dict[str, float]:
    low, high = found.interval
    return {"events": found.events, "runs": found.runs, "rate": found.rate, "low": low, "high": high}
