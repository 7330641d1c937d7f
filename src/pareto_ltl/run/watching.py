"""A function that follows the runs of this process while they work: stages, progress, records.

The desk sets it in its worker; without it nothing is reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

from pareto_ltl.run.records import RecordKey, Records

if TYPE_CHECKING:
    from pareto_ltl.support.arrays import FloatArray

Found = Sequence[tuple[float, "FloatArray"]]  # failure rates on the flights of the search, and paths


class Watcher(Protocol):
    """The calls that a run makes while it works."""

    def stage(self, name: str) -> None:
        """The stage ``name`` begins."""

    def progress(self, done: int, total: int, state: str, found: Found) -> None:
        """The present stage has done ``done`` of ``total``; ``state`` and ``found`` are the result so far."""

    def made(self, key: RecordKey[Any], records: Records) -> None:
        """The record of ``key`` was made; ``records`` has it and all before."""


class NoWatcher:
    """Ignores all calls."""

    def stage(self, name: str) -> None:
        """Ignore a stage."""

    def progress(self, done: int, total: int, state: str, found: Found) -> None:
        """Ignore progress."""

    def made(self, key: RecordKey[Any], records: Records) -> None:
        """Ignore a record."""


_WATCHERS: list[Watcher] = [NoWatcher()]


def watcher() -> Watcher:
    """The function that follows the runs of this process."""
    return _WATCHERS[0]


def watch_runs(new: Watcher) -> None:
    """Let ``new`` follow all later runs of this process, in place of the one before."""
    _WATCHERS[0] = new
