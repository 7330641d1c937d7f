"""Compiling before it is needed, or in a second process: small missions with the kernels of real runs.

Each entry of :data:`KINDS` is a mission that is planned, flown and exported in some seconds once its kernels
are compiled. Kernels depend on the models and on what a map has (landmarks, windows), not on sizes.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.files import process_lives
from careful_io.yaml_files import read_yaml
from pareto_ltl import Settings
from pareto_ltl.extend import Pipeline
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.resources import CONF
from typed_kernels.watching import compilation_watched

if TYPE_CHECKING:
    from pareto_ltl.extend import Forest, Problem

Sections = dict[str, Any]
Reported = Callable[[int, int, str], None]
SMALL: Sections = {
    "planner": {"trees": 2, "n_max": 4000, "max_steps": 60, "epsilon": 0.7},
    "smoothing": {"candidates": 1, "weights": [1.0]},
    "refine": {"flights": 20, "sweep_flights": 10, "classes": 1, "points": 2},
    "selection": {"draws": 20, "runs": 20},
    "wind": {"max_points": 40, "modes_max": 8, "spacing": 100e3, "modes_spacing": 100e3},
    "deployment": {"runs": 20},
    "report": "none",
}
ORDER = "F(a & F b & F c)"
BEACON = [[0.6, 6.5], [3.1, 6.5], [3.1, 9.4], [0.6, 9.4]]
NARROW = {"corners": BEACON, "fix": {"along": 2000.0, "across": 50.0, "bearing": 30.0}}
UNIT = 1e5  # [m] of the map
WAY = [(0.8, 0.7), (0.5, 2.0), (0.6, 4.5), (2.7, 4.5), (2.7, 6.4), (2.0, 7.7)]  # free of obstacles, to a
FIX = (37.0, -94.0, 500.0)  # latitude, longitude [deg], standard deviation [m]
FIX_TIME = 36e3  # [s] after departure, or the last step of a shorter plan


@dataclass(frozen=True, slots=True)
class Kind:
    """A small mission on the map phi1.

    Attributes
    ----------
    meaning : str
        What real runs it stands for.
    formula : str
        The mission.
    sections : dict
        Sections of the settings besides :data:`SMALL`, and keys of ``scene`` and ``robot``.
    replanned : bool
        Whether the rest of the flight is also planned again after a position fix.
    """

    meaning: str
    formula: str
    sections: Sections
    replanned: bool = False


def _changed(name: str) -> dict[str, Kind]:
    """The kinds of runs with one model of the preset ``name`` replaced by the model of the other preset."""
    (other,) = (values for preset, values in Settings.PRESETS.items() if preset != name)
    models = ("law", "mission_bound", "collision_bound", "refine")
    return {
        f"{name}-{model.replace('_', '-')}": Kind(
            f"fidelity={name} fidelity.{model}={other[model]}",
            ORDER,
            {"fidelity": {"name": name, model: other[model]}},
        )
        for model in models
    }


def _both(name: str, meaning: str, formula: str, sections: Sections) -> dict[str, Kind]:
    """The kind ``name`` in both presets."""
    return {
        f"{preset}-{name}": Kind(f"fidelity={preset}, {meaning}", formula, {"fidelity": preset, **sections})
        for preset in Settings.PRESETS
    }


SQUARES = {  # on the way to a
    name: [[x, y], [x + 0.6, y], [x + 0.6, y + 0.6], [x, y + 0.6]]
    for name, (x, y) in zip(
        "defghi", ((0.2, 1.6), (0.3, 3.0), (0.4, 4.2), (1.5, 4.2), (2.4, 4.2), (2.4, 6.0)), strict=True
    )
}
SEVEN = " & ".join(f"F {name}" for name in ("a", *SQUARES))
KINDS: dict[str, Kind] = {
    "full": Kind("fidelity=full", ORDER, {"fidelity": "full"}, replanned=True),
    "paper": Kind("fidelity=paper", ORDER, {"fidelity": "paper"}),
    "full-fixes": Kind(
        "landmarks with position fixes", "F a", {"scene": {"landmarks": [BEACON]}}, replanned=True
    ),
    **_both("feedback", "a robot that always knows its position", "F a", {"robot": {"feedback_time": 8e3}}),
    **_both("forbidden", "a region that must be avoided", "!c U a", {}),
    **_both("deadline", "a limit of time", "F[0,40h] a & F[0,60h] b", {}),
    **_both("calm", "no wind", "F a", {"wind": "calm"}),
    **_both("large", "an automaton of many states", SEVEN, {"scene": {"regions": SQUARES}}),
    "full-energy": Kind("a robot with a power curve", "F a", {"robot": "long_endurance"}),
    "full-narrow-fixes": Kind("landmarks with lines of position", "F a", {"scene": {"landmarks": [NARROW]}}),
    **_changed("full"),
    **_changed("paper"),
}
DEFAULT = ("full",)


@dataclass(frozen=True, slots=True)
class Warmed:
    """The cost of a kind: its name, the kernels that were compiled, and the time [s].

    ``complete`` is False if the small mission found no path: kernels of later stages may be missing.
    """

    name: str
    compiled: tuple[str, ...]
    seconds: float
    complete: bool = True


def warm_up(name: str, watcher: Callable[[str], None] = lambda _: None, *, grown: bool = True) -> Warmed:
    """Compile the kernels of ``KINDS[name]`` that are not on disk; ``watcher`` gets each name before.

    Without ``grown``, growth is left out, which takes half of the time; a path is given instead of trees.
    """
    began, compiled = time.monotonic(), list[str]()

    def note(kernel: str) -> None:
        compiled.append(kernel)
        watcher(kernel)

    complete = False
    with compilation_watched(note), TemporaryDirectory() as folder, suppress(InfeasibleError):
        (_plan if grown else _plan_given_path)(KINDS[name], Path(folder) / "plan")
        complete = True
    return Warmed(name, tuple(compiled), time.monotonic() - began, complete)


def small_sections(kind: Kind) -> Sections:
    """The settings of the small mission."""
    scene = read_yaml(CONF.file("scene", "phi1"))
    sections = {**SMALL, "robot": {"dt": 3600.0}, **kind.sections}
    changed = sections.pop("scene", {})
    scene |= changed | {"regions": scene["regions"] | changed.get("regions", {})}
    if isinstance(sections["robot"], str):
        sections["robot"] = read_yaml(CONF.file("robot", sections["robot"])) | {"dt": 3600.0, "level": None}
    return {**sections, "scene": scene}


def _plan(kind: Kind, folder: Path) -> None:
    from pareto_ltl import plan
    from pareto_ltl_apps.flight.replanning import replan

    sections = small_sections(kind)
    planned = plan(sections.pop("scene"), kind.formula, out=folder, **sections)
    if kind.replanned:
        replan(planned, min(FIX_TIME, float(planned.plan.path.t[-2])), FIX)


def _plan_given_path(kind: Kind, folder: Path) -> None:
    """Plan ``F a``, with a tree that is one path."""
    from pareto_ltl import Run

    settings = Settings.of({"pipelines": "plan", "mission": {"formula": "F a"}, **small_sections(kind)})
    made = Run(settings)
    forest = path_forest(made.problem)
    run = Run(settings, made.records | {"forest": forest}, directory=folder)
    Pipeline.of(settings, given=run.records).complete(run)


def path_forest(problem: Problem) -> Forest:
    """A tree of one branch along :data:`WAY`, with the start of ``problem`` as its root."""
    from pareto_ltl.extend import Forest, Tree

    corners = UNIT * (np.array(WAY) - WAY[0]) + problem.scene.start
    x = np.concatenate([np.linspace(a, b, 4)[:-1] for a, b in pairwise(corners)] + [corners[-1:]])
    steps, atoms = np.arange(len(x)), len(problem.atoms)
    length = np.concatenate([[0.0], np.hypot(*np.diff(x, axis=0).T).cumsum()])
    tree = Tree(
        x, steps - 1, steps, problem.states(x), problem.locate(x), length, np.zeros((len(x), atoms)),
        np.empty((0, 2, 2 + atoms)), np.zeros(2), 0.0, {},
    )  # fmt: skip
    return Forest((tree,), np.array([[0, len(x) - 1]]), 0.0)


def warm_up_all(names: Sequence[str], jobs: int, reported: Reported) -> Iterator[Warmed]:
    """Compile the kernels of ``names`` in at most ``jobs`` processes; yields the cost of each, as they end.

    ``reported`` is called with the number of kinds that are done, their total, and what is compiled now.
    """
    total = len(names)
    if min(jobs, total) < 2:
        for done, name in enumerate(names):
            yield warm_up(name, partial(_tell, reported, done, total, name))
        return
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as workers:
        waiting = {workers.submit(warm_up, name) for name in names}
        reported(0, total, f"{total} kinds of runs in {jobs} processes")
        for done, ended in enumerate(as_completed(waiting), 1):
            reported(done, total, ended.result().name)
            yield ended.result()


def _tell(report: Reported, done: int, total: int, name: str, kernel: str) -> None:
    report(done, total, f"{name}: {kernel}")


# --- the second process of a run (second_process.py) ---------------------------------------------


def second_process(kind: str, first: str) -> None:
    """Compile the kernels of ``kind`` except growth; end when the process ``first`` has ended."""

    def watch() -> None:
        while process_lives(int(first)):
            time.sleep(1.0)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
    warm_up(kind, grown=False)
