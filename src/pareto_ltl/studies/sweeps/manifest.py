"""The list of a sweep on disk: its directories, and which settings vary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_json
from pareto_ltl.support.fingerprints import text_fingerprint
from pareto_ltl.support.reading import Advice
from pareto_ltl.support.schemas import read_document

MANIFEST_SCHEMA = "pareto_ltl.sweep/1"
NEWEST_SWEEP = "sweep.json"
OLDER_SWEEPS = "sweeps"
SWEEP_FILES = Advice("is this the folder of a sweep?", "run the sweep again")


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
    content = read_document(path, "sweep", SWEEP_FILES, version=MANIFEST_SCHEMA)
    return _manifest_from(content)


def _manifest_from(content: Mapping[str, Any]) -> SweepManifest:
    return SweepManifest(
        tuple(SweepPoint(point["job"], point["overrides"]) for point in content["points"]),
        tuple(content["swept"]),
        tuple(content["fixed"]),
        FigureChoice(**content["figure"]),
    )


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
        for job, record in sorted(records.items(), key=lambda item: _sort_key(item[1], swept))
    ]
    return SweepManifest(
        tuple(points), tuple(swept), tuple(f"{key}={first[key]}" for key in keys if key not in swept)
    )


def _recorded_overrides(path: Path) -> dict[str, str]:
    try:
        words: Sequence[str] = read_document(path, "run").get("overrides") or ()
    except DataError:
        return {}
    return {key.lstrip("+"): value for key, _, value in (word.partition("=") for word in words)}


def _sort_key(record: Mapping[str, str], swept: Sequence[str]) -> list[tuple[int, float, str]]:
    return [_number_or_word(record.get(key, "")) for key in swept]


def _number_or_word(value: str) -> tuple[int, float, str]:
    """Numbers by size, then words by letter."""
    try:
        return 0, float(value), ""
    except ValueError:
        return 1, 0.0, value
