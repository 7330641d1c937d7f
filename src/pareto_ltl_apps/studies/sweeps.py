"""Sweeps: the list of the runs on disk, a row for each run, and a group for all seeds of the other settings.

``sweep_summary`` writes the tables, the figure and the page from them. Neither imports Hydra;
``hydra_plugins.pareto_ltl_plugins`` connects them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from careful_io.files import write_json
from careful_io.fingerprints import text_fingerprint
from careful_io.reading import Advice
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.schemas import read_document
from pareto_ltl_apps.studies.jobs import JobState, Metrics, RunJob
from pareto_ltl_apps.studies.tables import quartiles_of, rate_interval

MANIFEST_SCHEMA = "pareto_ltl.sweep/1"
NEWEST_SWEEP = "sweep.json"
OLDER_SWEEPS = "sweeps"
SWEEP_FILES = Advice("is this the folder of a sweep?", "run the sweep again")
CLOCK_METRICS = ("memory_mib",)
JOB_STATUSES = ("ok", "infeasible", "failed", "running", "pending")
POOLED_RATES = ("failure", "mission_failure", "collision")  # of deployments, for each law

# --- the list --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """One run: its directory, and the settings in which it differs from the others."""

    job: str
    overrides: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class FigureChoice:
    """Axes of the figure of a sweep: ``x`` setting or metric, ``y`` metric, ``by`` setting."""

    x: str | None = None
    y: str | None = None
    by: str | None = None


@dataclass(frozen=True, slots=True)
class SweepManifest:
    """All points of a sweep in the order of its grid.

    Attributes
    ----------
    swept : tuple of str
        Settings with several values, in the order in which they were given.
    fixed : tuple of str
        Overrides that all jobs share, as on the command line.
    """

    points: tuple[SweepPoint, ...]
    swept: tuple[str, ...]
    fixed: tuple[str, ...] = ()
    figure: FigureChoice = FigureChoice()

    @property
    def key(self) -> str:
        """Fingerprint of this set of jobs, which distinguishes sweeps in the same folder."""
        return text_fingerprint("\n".join(point.job for point in self.points))[:12]

    def write_to(self, place: Path) -> None:
        """Write it as the newest sweep of ``place``, and into its folder of all sweeps."""
        content = {
            "schema": MANIFEST_SCHEMA,
            "sweep": self.key,
            "swept": self.swept,
            "fixed": self.fixed,
            "figure": asdict(self.figure),
            "points": [asdict(point) for point in self.points],
        }
        (place / OLDER_SWEEPS).mkdir(parents=True, exist_ok=True)
        write_json(place / OLDER_SWEEPS / f"{self.key}.json", content)
        write_json(place / NEWEST_SWEEP, content)


def read_manifest(place: Path, key: str | None = None) -> SweepManifest:
    """The newest sweep of ``place``, or the one named ``key``; all runs of the folder if it has no list.

    Raises
    ------
    DataError
        If there is no such sweep, or a file of another version.
    """
    path = place / NEWEST_SWEEP if key is None else place / OLDER_SWEEPS / f"{key}.json"
    if key is None and not path.is_file():
        return manifest_of_runs(place)
    if not path.is_file():
        there = ", ".join(sorted(file.stem for file in (place / OLDER_SWEEPS).glob("*.json"))) or "none"
        raise DataError(f"{place} holds no sweep {key!r}; there are: {there}")
    content = read_document(path, {MANIFEST_SCHEMA: "sweep"}, SWEEP_FILES)
    points = tuple(SweepPoint(point["job"], point["overrides"]) for point in content["points"])
    figure = FigureChoice(**content["figure"])
    return SweepManifest(points, tuple(content["swept"]), tuple(content["fixed"]), figure)


def manifest_of_runs(place: Path) -> SweepManifest:
    """A list made from the directories: a point for each, with the overrides in which they differ."""
    if not place.is_dir():
        raise DataError(f"there is no folder {place}; expected the folder of a sweep")
    records = {path.parent.name: _recorded_overrides(path) for path in sorted(place.glob("*/run.json"))}
    if not records:
        raise DataError(f"{place} holds no jobs: expected sub-directories with a run.json")
    keys = list(dict.fromkeys(key for record in records.values() for key in record))
    swept = [key for key in keys if len({record.get(key) for record in records.values()}) > 1]
    first = next(iter(records.values()))
    points = [
        SweepPoint(job, {key: record.get(key, "") for key in swept})
        for job, record in sorted(
            records.items(), key=lambda item: [_number_or_word(item[1].get(key, "")) for key in swept]
        )
    ]
    fixed = tuple(f"{key}={first[key]}" for key in keys if key not in swept)
    return SweepManifest(tuple(points), tuple(swept), fixed)


def _recorded_overrides(path: Path) -> dict[str, str]:
    try:
        words: Sequence[str] = read_document(path, "run").get("overrides") or ()
    except DataError:
        return {}
    return {key.lstrip("+"): value for key, _, value in (word.partition("=") for word in words)}


def _number_or_word(value: str) -> tuple[int, float, str]:
    """Numbers by size, then words by letter."""
    try:
        return 0, float(value), ""
    except ValueError:
        return 1, 0.0, value


# --- rows and groups -------------------------------------------------------------------------


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
    quartiles = {}
    for name in column_names(metrics):
        if values := [value for run in metrics if (value := run.get(name)) is not None]:
            quartiles[name] = list(quartiles_of(values))
    return SeedGroup(overrides, status_counts(members), quartiles, _pooled_rates(answered, metrics))


def _pooled_rates(answered: Sequence[SweepRow], metrics: Sequence[Metrics]) -> dict[str, dict[str, float]]:
    """Rates over all flights of all runs, as if they were one experiment."""
    pooled = {}
    if answered:
        plans = sum(row.state.status == "ok" for row in answered)
        pooled["completed"] = _rate_entry(plans, len(answered))
    laws = [name.removeprefix("runs_") for name in column_names(metrics) if name.startswith("runs_")]
    for law in laws:
        for name in (f"{rate}_{law}" for rate in POOLED_RATES):
            pairs = [
                (share * runs, runs)
                for run in metrics
                if (share := run.get(name)) is not None and (runs := run.get(f"runs_{law}")) is not None
            ]
            if pairs:
                events, runs = (math.fsum(column) for column in zip(*pairs, strict=True))
                pooled[name] = _rate_entry(round(events), round(runs))
    return pooled


def _rate_entry(events: int, runs: int) -> dict[str, float]:
    rate, low, high = rate_interval(events, runs)
    return {"events": events, "runs": runs, "rate": rate, "low": low, "high": high}
