"""The process that runs command lines for a desk, one after another, with all that a plan needs in memory.

It reads one JSON object on each line of its standard input, ``{"id": ..., "argv": [...]}``, and writes one
for each event. The end of its input ends it, so that it does not outlive its server.
"""

from __future__ import annotations

import io
import json
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from typing import IO, Any

from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.records import FOREST, FRONT, PROBLEM, RecordKey, Records
from pareto_ltl.run.watching import watch_runs

MOST_PATHS = 40  # paths of the search trees that are reported
PAUSE = 0.1  # [s] between two reports of progress
WARMED = (
    "pareto_ltl.planning.refine", "pareto_ltl.planning.growth", "pareto_ltl.simulation.judging",
    "pareto_ltl.report.figures", "pareto_ltl.exports.formats", "pareto_ltl.wind.field",
)  # fmt: skip


class Reporter:
    """Writes the events of the present job; a watcher of its run."""

    def __init__(self, stream: IO[str]) -> None:
        self.stream, self.job = stream, ""
        self.last = 0.0  # when the last progress was reported [s]

    def send(self, event: str, **values: Any) -> None:
        """Write one event."""
        self.stream.write(json.dumps({"id": self.job, "event": event, **values}) + "\n")
        self.stream.flush()

    def stage(self, name: str) -> None:
        """Report the begin of a stage."""
        self.send("stage", stage=name)

    def progress(self, done: int, total: int, state: str) -> None:
        """Report the progress of the present stage."""
        if (now := time.monotonic()) < self.last + PAUSE:
            return
        self.last = now
        self.send("progress", done=int(done), total=int(total), state=state)

    def made(self, key: RecordKey[Any], records: Records) -> None:
        """Report the paths known so far, when the search trees or the front are made."""
        if key == FOREST:
            from pareto_ltl.planning.selection import unlike_paths

            with suppress(ValueError):
                self._send_paths(
                    "search", records, unlike_paths(records[PROBLEM], records[FOREST])[:MOST_PATHS]
                )
        elif key == FRONT:
            self._send_paths("front", records, records[FRONT].paths)

    def _send_paths(self, source: str, records: Records, paths: Sequence[PlannedPath]) -> None:
        from pareto_ltl.exports.degrees import lonlat
        from pareto_ltl.report.page.points import bound_of

        crs, rates = records[PROBLEM].scene.crs, records[FRONT].rates if source == "front" else ()
        points = [
            {
                "failure": rates[k].failure if rates else bound_of(path.objectives),
                "length_m": path.objectives.length,
                "line": None if crs is None else lonlat(crs, path.x).round(5).tolist(),
            }
            for k, path in enumerate(paths)
        ]
        self.send("paths", source=source, bound=not rates, points=points)


def work(run: Callable[[list[str]], int]) -> None:
    """Run the command lines that arrive, with ``run``, until the input ends."""
    reporter = Reporter(_own_output())
    jobs: queue.Queue[dict[str, Any]] = queue.Queue()
    threading.Thread(target=_read_jobs, args=(jobs,), daemon=True).start()
    watch_runs(reporter)
    _warm()
    reporter.send("ready")
    while True:
        job = jobs.get()
        reporter.job = job["id"]
        reporter.send("begun")
        said, errors = io.StringIO(), io.StringIO()
        with redirect_stdout(said), redirect_stderr(errors):
            code = run([str(word) for word in job["argv"]])
        lines = [line for line in errors.getvalue().splitlines() if line.startswith("pareto-ltl: ")]
        error = lines[-1].removeprefix("pareto-ltl: ") if code and lines else ""
        reporter.send("ended", code=code, error=error)


def _own_output() -> IO[str]:
    """The standard output for events alone; whatever else writes to it writes to the standard error."""
    kept = os.dup(1)
    os.dup2(2, 1)
    return os.fdopen(kept, "w", encoding="utf-8")


def _read_jobs(jobs: queue.Queue[dict[str, Any]]) -> None:
    for line in sys.stdin:
        jobs.put(json.loads(line))
    os.kill(os.getpid(), signal.SIGTERM)  # a run records how it ended; see support/stopping.py


def _warm() -> None:
    """Import what the stages of a plan would import one after another."""
    from importlib import import_module

    for name in WARMED:
        import_module(name)
