"""All points of a sweep, whatever kills its jobs, its launcher or its disk.

A launcher gets a batch of points and comes back when all are done, or raises when one of them took it
down. What then has no answer is launched again: first all that had not begun, then each of those that were
at work, alone; where nothing tells which was to blame, one half and then the other. A point that is alone
and breaks its launch again is given up, and the others go on.
"""

from __future__ import annotations

import logging
import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from pareto_ltl.run import provenance
from pareto_ltl.run.results import read_json
from pareto_ltl.studies.sweeps import jobs
from pareto_ltl.studies.sweeps.manifest import Manifest, Point
from pareto_ltl.support import locks
from pareto_ltl.support.errors import ConfigError, DataError

log = logging.getLogger(__name__)

LOCK = ".sweep.lock"

Launch = Callable[[Sequence[Point]], None]
Tell = Callable[[str], None]


@contextmanager
def claimed(place: Path) -> Iterator[None]:
    """Have ``place`` for one sweep alone; a second one ends with a line."""
    place.mkdir(parents=True, exist_ok=True)
    note = f"process {os.getpid()} on {platform.node()}, since {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"
    try:
        with locks.held(place / LOCK, wait=False, note=note):
            yield
    except locks.TakenError as other:
        raise ConfigError(
            f"a sweep is at work in {place} already ({other}): wait for it, "
            "or give this one a folder of its own with hydra.sweep.dir=FOLDER"
        ) from None


@dataclass(slots=True)
class Conductor:
    """Launches what has no answer until all have one or are given up."""

    place: Path
    launch: Launch
    tell: Tell
    given_up: dict[str, str] = field(default_factory=dict)

    def conduct(self, points: Sequence[Point]) -> None:
        """Run ``points``; return when each was tried."""
        batches = [list(points)]
        while batches:
            if batch := batches.pop():
                batches += reversed(self._launched(batch))

    def _launched(self, batch: list[Point]) -> list[list[Point]]:
        """Launch ``batch``; the batches in which what is left of it must be launched again."""
        began = time.time()
        try:
            self.launch(batch)
        except Exception as error:
            reason = provenance.one_line(error)
            log.info("a launch of %d jobs broke: %s", len(batch), reason)
        else:
            return []
        self._settle(batch)
        fresh, hit = self._sort(batch, began)
        if len(batch) == 1:
            self._give_up(batch[0], reason, hit)
            return []
        if hit:
            self.tell(f"{len(hit)} of the jobs at work were killed; going on with the others")
            return [fresh, *([point] for point in hit)]
        if fresh:
            self.tell(f"a launch broke ({reason}); going on with {len(fresh)} jobs")
        middle = (len(fresh) + 1) // 2
        return [fresh[:middle], fresh[middle:]]

    def _settle(self, points: Sequence[Point]) -> None:
        """Wait for jobs that outlived their launch: a cluster goes on with them."""
        while any(locks.is_held(self.place / point.job / jobs.LOCK) for point in points):
            time.sleep(0.1)

    def _sort(self, points: Sequence[Point], began: float) -> tuple[list[Point], list[Point]]:
        """Those that had not begun, and those that were at work, when the launch broke."""
        fresh, hit = [], []
        for point in points:
            record = self.place / point.job / "run.json"
            begun = _changed(record) >= began - 1.0
            if not begun:
                fresh.append(point)
            elif _status(record) == "running":
                hit.append(point)
        return fresh, hit

    def _give_up(self, point: Point, reason: str, hit: Sequence[Point]) -> None:
        """Note where it belongs, if that can be written at all, that this job cannot be done."""
        state = jobs.look(self.place / point.job)
        if state.answered or (state.status == "failed" and not hit):
            return
        error = f"killed ({reason})" if hit else reason
        self.given_up[point.job] = error
        try:
            directory = self.place / point.job
            directory.mkdir(exist_ok=True)
            provenance.write(directory, {**state.record, "status": "failed", "error": error})
        except OSError as obstacle:
            log.info("%s: cannot be written (%s)", self.place / point.job, obstacle)


def _changed(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _status(path: Path) -> str:
    try:
        return str(read_json(path).get("status"))
    except DataError:
        return "running"


def unsettled(place: Path, manifest: Manifest, *, resume: bool) -> list[Point]:
    """The points that must be run: all, or those without an answer."""
    return [point for point in manifest.points if not (resume and jobs.settled(place / point.job))]
