"""New plans during a watch: after each position fix, ``pareto-ltl replan`` in a second process.

The watch goes on with the old plan. A new plan is announced with the failure rates of both, in the same
winds; to fly it is the pilot's decision.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pareto_ltl.inflight.watch import Event, Watch
from pareto_ltl.support.files import write_csv

LONGEST = 120.0  # [s] to wait for a new plan when the telemetry has ended


class Replans:
    """Plans again after each fix that is used; at most one process at a time, the newest fixes first.

    Parameters
    ----------
    directory : Path
        The result that is watched.
    folder : Path
        Gets ``fixes_N.csv`` and the results ``replan_N``.
    earlier : iterable of Event
        Of the journal that is continued.
    """

    def __init__(self, directory: Path, folder: Path, earlier: Iterable[Event] = ()) -> None:
        self.directory, self.folder = directory, folder
        self.fixes = [_row(event) for event in earlier if _learnt(event)]
        self.count = len(list(folder.glob("fixes_*.csv"))) if self.fixes else 0
        self.planned = len(self.fixes)  # fixes that the last process knows
        self.process: subprocess.Popen[str] | None = None

    def answers(self, watch: Watch, event: Event) -> Iterator[Event]:
        """Start a process after a fix; yields what a finished one found."""
        if _learnt(event):
            self.fixes.append(_row(event))
        if self.process is not None and (self.process.poll() is not None or event["event"] == "end"):
            yield from self._finished(event["time"])
        if self.process is None and len(self.fixes) > self.planned and not watch.over:
            self._start(on_earth=watch.problem.scene.crs is not None)
            if event["event"] == "end":
                yield from self._finished(event["time"])

    def _start(self, *, on_earth: bool) -> None:
        self.count, self.planned = self.count + 1, len(self.fixes)
        rows = self.folder / f"fixes_{self.count}.csv"
        write_csv(rows, ["time", *(("lat", "lon") if on_earth else ("x", "y")), "sd_m"], self.fixes)
        command = [sys.executable, "-m", "pareto_ltl", "replan", str(self.directory), "--fixes", str(rows)]
        self.process = subprocess.Popen(
            [*command, "--out", str(self._place())], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def _place(self) -> Path:
        return self.folder / f"replan_{self.count}"

    def _finished(self, time: float) -> Iterator[Event]:
        """The event of a process that has ended, or ends within ``LONGEST``."""
        assert self.process is not None
        try:
            _, errors = self.process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            self.process.kill()
            errors = f"no new plan within {LONGEST:g} s"
            self.process.communicate()
        failed, self.process = self.process.returncode != 0, None
        if failed:
            why = (errors.strip().splitlines() or ["the process was ended"])[-1]
            yield {"event": "alarm", "time": time, "kind": "replan", "text": f"no new plan: {why}"}
            return
        document = json.loads((self._place() / "replan.json").read_text(encoding="utf-8"))
        yield {
            "event": "replanned", "time": time, "directory": str(self._place()), "at": document["time_s"],
            "old": _rate(document["old"]), "new": _rate(document["new"]), "alarms": document["alarms"],
            "law": None if document["new"] is None else document["new"]["law"],
        }  # fmt: skip

    def stop(self) -> None:
        """End a process that still runs."""
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.communicate()


def _learnt(event: Event) -> bool:
    return bool(event["event"] == "fix" and event["use"] == "learnt")


def _row(event: Event) -> tuple[float, ...]:
    """Time, the two coordinates as they were given, and standard deviation."""
    return (event["time"], *event["given"], event["sd"])


def _rate(rate: dict[str, Any] | None) -> float | None:
    return None if rate is None else float(rate["failure"])
