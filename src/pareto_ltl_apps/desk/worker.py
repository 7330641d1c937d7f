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
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from typing import IO, Any

from pareto_ltl.extend import Frame, PlannedPath, Watcher, watched_by
from pareto_ltl.support.arrays import FloatArray, length_of

MAX_PATHS = 40  # paths of the search trees that are reported
LAST_WORDS = 20.0  # [s] in which a run whose server has gone can record how it ended
PAUSE = 0.1  # [s] between two reports of progress
WARMED = (  # what the stages of a plan would import one after another
    "pareto_ltl.planning.refine", "pareto_ltl.planning.growth", "pareto_ltl.simulation.judging",
    "pareto_ltl_apps.view.figures", "pareto_ltl_apps.exports.formats", "pareto_ltl.wind.field",
)  # fmt: skip
SMALL_PLAN = (
    "plan", "+experiment=hop", "selection=worth", "planner.trees=1", "planner.n_max=400", "refine.flights=20",
    "refine.sweep_flights=10", "refine.classes=1", "refine.points=2", "selection.draws=20",
    "selection.runs=200", "deployment.runs=10",
)  # fmt: skip
Known = tuple[float, float, FloatArray]  # failure, length [m], positions (T+1, 2) [m]


class Reporter(Watcher):
    """Writes the events of the present job; a watcher of its run."""

    def __init__(self, stream: IO[str]) -> None:
        self.stream, self.job = stream, ""
        self.crs: Any = None  # projection of the present job; None: no place on Earth
        self.last = 0.0  # when the last progress was reported [s]

    def send(self, event: str, **values: Any) -> None:
        """Write one event."""
        self.stream.write(json.dumps({"id": self.job, "event": event, **values}) + "\n")
        self.stream.flush()

    def stage(self, name: str) -> None:
        """Report the begin of a stage."""
        self.send("stage", stage=name)

    def progress(self, done: int, total: int, state: str, found: Watcher.Found) -> None:
        """Report the progress of the present stage, and the paths of refinement so far."""
        if found:
            lengths = [length_of(x) for _, x in found]
            paths = [(failed, length, x) for (failed, x), length in zip(found, lengths, strict=True)]
            self._send_paths("refinement", paths, bound=False)
        elif (now := time.monotonic()) >= self.last + PAUSE:
            self.last = now
            self.send("progress", done=int(done), total=int(total), state=state)

    def made(self, name: str, records: Mapping[str, Any]) -> None:
        """Report the paths known so far, when the search trees or the front are made."""
        if name == "problem":
            self.crs = records["problem"].scene.crs
        elif name == "forest":
            with suppress(ValueError):
                found = records["problem"].grown_paths(records["forest"])[:MAX_PATHS]
                self._send_paths("search", _by_bound(found), bound=True)
        elif name == "front":
            front = records["front"]
            paths = [
                (r.failure, p.objectives.length, p.x) for r, p in zip(front.rates, front.paths, strict=False)
            ]
            self._send_paths("front", paths or _by_bound(front.paths), bound=not paths)

    def _send_paths(self, source: str, paths: Iterable[Known], bound: bool) -> None:

        points = [
            {
                "failure": failure,
                "length_m": length,
                "line": None if self.crs is None else Frame(self.crs).lonlat(x).round(5).tolist(),
            }
            for failure, length, x in paths
        ]
        self.send("paths", source=source, bound=bound, points=points)


def _by_bound(paths: Iterable[PlannedPath]) -> list[Known]:
    from pareto_ltl_apps.view.page.points import bound_of

    return [(bound_of(path.objectives), path.objectives.length, path.x) for path in paths]


def work(run: Callable[[list[str]], int]) -> None:
    """Run the command lines that arrive, with ``run``, until the input ends."""
    reporter = Reporter(_own_output())
    jobs: queue.Queue[dict[str, Any]] = queue.Queue()
    threading.Thread(target=_read_jobs, args=(jobs,), daemon=True).start()
    for name in WARMED:
        import_module(name)
    if jobs.empty():
        load_kernels(run)
    reporter.send("ready")
    while True:
        job = jobs.get()
        reporter.job, reporter.crs = job["id"], None
        reporter.send("begun")
        said, errors = io.StringIO(), io.StringIO()
        with redirect_stdout(said), redirect_stderr(errors), watched_by(reporter):
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
    os.kill(os.getpid(), signal.SIGTERM)  # a run records how it ended; see pareto_ltl_apps/stopping.py
    time.sleep(LAST_WORDS)
    os._exit(128 + signal.SIGTERM)  # code that ignores exceptions, e.g. a finalizer, may have lost that one


def load_kernels(run: Callable[[list[str]], int], *words: str) -> None:
    """Make a small plan with the settings ``words`` and discard it: the next one finds its code in memory."""
    quiet = io.StringIO()
    with tempfile.TemporaryDirectory() as place, redirect_stdout(quiet), redirect_stderr(quiet):
        run([*SMALL_PLAN, *words, f"hydra.run.dir={place}/plan"])
