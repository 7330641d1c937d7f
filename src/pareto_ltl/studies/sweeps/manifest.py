"""The points of a sweep, on disk: which directories are its own, and what was varied."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pareto_ltl.run.results import read_json, write_json
from pareto_ltl.support.errors import DataError

SCHEMA = "pareto_ltl.studies.sweeps/1"
NEWEST = "sweep.json"
HISTORY = "sweeps"


@dataclass(frozen=True, slots=True)
class Point:
    """One job: the directory it is done in, and the settings that make it differ from the others."""

    job: str
    overrides: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Figure:
    """What the figure of a sweep shows: setting or metric, metric, setting."""

    x: str | None = None
    y: str | None = None
    by: str | None = None


@dataclass(frozen=True, slots=True)
class Manifest:
    """All points of a sweep in the order of its grid.

    Attributes
    ----------
    swept : tuple of str
        Settings with several values, in the order in which they were given.
    fixed : tuple of str
        What all jobs share, as on the command line.
    """

    points: tuple[Point, ...]
    swept: tuple[str, ...]
    fixed: tuple[str, ...] = ()
    figure: Figure = Figure()

    @property
    def key(self) -> str:
        """Names this set of jobs, so that another sweep into the same folder is another one."""
        return hashlib.sha256("\n".join(point.job for point in self.points).encode()).hexdigest()[:12]

    def write(self, place: Path) -> None:
        """Write it as the newest of ``place``, and among all sweeps that ever went there."""
        content = {
            "schema": SCHEMA,
            "sweep": self.key,
            "swept": self.swept,
            "fixed": self.fixed,
            "figure": asdict(self.figure),
            "points": [asdict(point) for point in self.points],
        }
        (place / HISTORY).mkdir(parents=True, exist_ok=True)
        write_json(place / HISTORY / f"{self.key}.json", content)
        write_json(place / NEWEST, content)


def read(place: Path, key: str | None = None) -> Manifest:
    """The newest sweep of ``place``, or the one named ``key``; all jobs that are there if none was noted."""
    path = place / NEWEST if key is None else place / HISTORY / f"{key}.json"
    if key is None and not path.is_file():
        return found(place)
    if not path.is_file():
        there = ", ".join(sorted(file.stem for file in (place / HISTORY).glob("*.json"))) or "none"
        raise DataError(f"{place} holds no sweep {key!r}; there are: {there}")
    content = read_json(path)
    if content.get("schema") != SCHEMA:
        raise DataError(
            f"{path}: expected schema {SCHEMA!r}, found {content.get('schema')!r}; "
            "read it with the version of pareto-ltl that wrote it"
        )
    return _manifest(content)


def _manifest(content: Mapping[str, Any]) -> Manifest:
    return Manifest(
        tuple(Point(point["job"], point["overrides"]) for point in content["points"]),
        tuple(content["swept"]),
        tuple(content["fixed"]),
        Figure(**content["figure"]),
    )


def found(place: Path) -> Manifest:
    """What the directories themselves say: a row for each, columns where their overrides differ."""
    if not place.is_dir():
        raise DataError(f"there is no folder {place}; expected the folder of a sweep")
    records = {path.parent.name: _overrides(path) for path in sorted(place.glob("*/run.json"))}
    if not records:
        raise DataError(f"{place} holds no jobs: expected sub-directories with a run.json")
    keys = list(dict.fromkeys(key for record in records.values() for key in record))
    swept = [key for key in keys if len({record.get(key) for record in records.values()}) > 1]
    first = next(iter(records.values()))
    points = [
        Point(job, {key: record.get(key, "") for key in swept})
        for job, record in sorted(records.items(), key=lambda item: _order(item[1], swept))
    ]
    return Manifest(
        tuple(points), tuple(swept), tuple(f"{key}={first[key]}" for key in keys if key not in swept)
    )


def _overrides(path: Path) -> dict[str, str]:
    try:
        words: Sequence[str] = read_json(path).get("overrides") or ()
    except DataError:
        return {}
    return {key.lstrip("+"): value for key, _, value in (word.partition("=") for word in words)}


def _order(record: Mapping[str, str], swept: Sequence[str]) -> list[tuple[int, float, str]]:
    return [sortable(record.get(key, "")) for key in swept]


def sortable(value: str) -> tuple[int, float, str]:
    """Numbers by size, then words by letter."""
    try:
        return 0, float(value), ""
    except ValueError:
        return 1, 0.0, value
