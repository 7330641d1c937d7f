"""A second process that compiles the stages after growth while the first compiles and grows the trees.

On a machine that has compiled nothing yet, numba takes half a minute for growth and as long for the later
stages. The second process runs these on the same problem with few flights, and leaves its machine code in
numba's cache; its results are discarded. A marker file beside the machine code says that this was done.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run.records import FOREST, PROBLEM, WIND, Records
from pareto_ltl.support.files import write_bytes
from pareto_ltl.support.fingerprints import code_fingerprint, data_fingerprint
from pareto_ltl.support.second_process import begin_process, can_begin_one, end_process, requests, send

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Forest
    from pareto_ltl.run.pipeline import Run
    from pareto_ltl.settings import Settings
    from pareto_ltl.wind.records import WindField

LOG = logging.getLogger(__name__)
PROGRAM = "from pareto_ltl.run.compiling import serve; serve()"
LATER_STAGES = ("front", "plan", "forecasts", "deployment")
NOTICE = "compiling for this machine, about half a minute; later runs find the machine code on disk"
LONGEST = 600.0  # [s] that the run waits for the process; then it compiles by itself


class CompilingProcess:
    """The second process, which begins when the problem is known."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._wind: WindField | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def record_made(self, name: str, record: Any) -> None:
        """Begin the process with the problem, unless all that it needs is already compiled."""
        if name == WIND.name:
            self._wind = record
        if name != PROBLEM.name or self._process is not None or self._wind is None:
            return
        marker = code_marker(record, self._settings)
        if marker is None or marker.exists():
            return
        LOG.info(NOTICE)
        if sys.stderr.isatty():  # where progress is shown
            print(f"pareto-ltl: {NOTICE}", file=sys.stderr)
        with suppress(OSError):
            self._process = begin_process(PROGRAM)
            task = (self._settings, self._wind, record, marker)
            send(self._process.stdin, task)

    def wait(self) -> None:
        """Return when the process has ended, after ``LONGEST`` at the latest."""
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(LONGEST)

    def end(self) -> None:
        """End the process at once."""
        if self._process is not None:
            end_process(self._process)


@contextmanager
def compiling_process(settings: Settings) -> Iterator[CompilingProcess | None]:
    """A compiling process for the duration of the block; None if there is no core for it."""
    process = CompilingProcess(settings) if can_begin_one() else None
    try:
        yield process
    finally:
        if process is not None:
            process.end()


def code_marker(problem: Problem, settings: Settings) -> Path | None:
    """The marker of compiled code for such a problem; its name depends on types, kernels and choices.

    None if nothing is compiled (``NUMBA_DISABLE_JIT``).
    """
    import numba

    from pareto_ltl.kernels.growth import grow

    if numba.config.DISABLE_JIT:
        return None
    kinds = [settings.fidelity.refine, settings.fidelity.judge, *settings.deployment.laws]
    told = [code_fingerprint("kernels"), numba.__version__, sys.version, str(numba.typeof(problem.world))]
    stats = grow.stats  # type: ignore[attr-defined]  # of numba's dispatcher
    return Path(stats.cache_path) / f"compiled-{data_fingerprint([*told, *kinds])[:32]}"


# --- in the compiling process ------------------------------------------------------------------


def serve() -> None:
    """Read (settings, wind, problem, marker) from the standard input, compile, and write the marker.

    The process ends when the run ends.
    """
    logging.disable()
    settings, wind, problem, marker = requests().get()
    try:
        carry_out_small(settings, wind, problem)
        write_bytes(marker, b"")
    except Exception as error:  # the run reports the same error
        LOG.debug("nothing is compiled ahead: %s", error)
    finally:
        os._exit(0)  # a thread still reads the standard input, so that an ordinary end would fail


def carry_out_small(settings: Settings, wind: Any, problem: Problem) -> Run:
    """The later stages with few flights and one path; after a stage that fails, the others are left out."""
    from pareto_ltl.run.pipeline import Run

    small = replace(
        settings,
        refine=replace(settings.refine, flights=10, sweep_flights=10, points=2),
        selection=replace(settings.selection, draws=10, runs=10, rule="priority"),
        deployment=replace(settings.deployment, runs=10),
        planner=replace(settings.planner, budget_seconds=None),
    )
    run = Run(small, records=Records({PROBLEM: problem, WIND: wind, FOREST: one_line_forest(problem)}))
    run.budget.end()
    with suppress(Exception):  # the run reports the same error
        for name in LATER_STAGES:
            run.perform(run.table[name])
    return run


def one_line_forest(problem: Problem) -> Forest:
    """A forest of one tree whose only path is a taut line through the mission."""
    import numpy as np

    from pareto_ltl.planning.growth import mission_columns
    from pareto_ltl.planning.records import Forest, Tree
    from pareto_ltl.planning.refine.starts import line_starts, unlike_starts

    columns = mission_columns(problem) + 1
    lines = line_starts(problem)
    start = next(iter(unlike_starts(problem, lines).values()), None) or lines[0]
    n = len(start.x)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(start.x, axis=0), axis=1))])
    rows = np.zeros(n, np.int64)
    tree = Tree(
        x=start.x, parent=np.arange(n) - 1, step=np.arange(n), q=rows, cell=problem.locate(start.x),
        length=length, risk=np.zeros((n, columns)), swaps=np.empty((0, 2, 2 + columns)), beta=np.zeros(2),
        seconds=0.0, reach={},
    )  # fmt: skip
    return Forest((tree,), np.array([[0, n - 1]]), 0.0, mission_columns(problem))
