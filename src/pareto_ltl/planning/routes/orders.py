"""Mission orders: the labels read one after another until the automaton accepts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.planning.pack_logic import helpful_delta
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.support.arrays import FloatArray

BEGUN = 400  # unfinished orders of one length that are extended


@dataclass(frozen=True, slots=True)
class MissionOrder:
    """A mission order: the label read at each transition, and the automaton state before it."""

    labels: tuple[frozenset[str], ...]
    states: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Begun:
    """An unfinished order: its labels, the states before them and the one after the last.

    ``length`` [m] estimates the way, from the middle of a cell to the nearest middle of the next label.
    """

    labels: tuple[frozenset[str], ...]
    states: tuple[int, ...]
    state: int
    at: FloatArray
    length: float

    def followed_by(self, label: frozenset[str], state: int, middles: FloatArray) -> _Begun:
        """The order with one more label, shown around ``middles`` (n, 2) [m]."""
        far = np.hypot(*(middles - self.at).T)
        near = int(far.argmin())
        return _Begun(
            (*self.labels, label),
            (*self.states, self.state),
            state,
            middles[near],
            self.length + float(far[near]),
        )


def mission_order(problem: Problem, path: PlannedPath) -> MissionOrder | None:
    """The order in which ``path`` visits regions; None if a transition needs no region."""
    before = np.concatenate([[problem.logic.initial], path.q[:-1]])
    turns = np.flatnonzero(path.q != before)
    cells = problem.locate(path.x[turns])
    labels = tuple(problem.labels[c] & set(problem.atoms) for c in cells)
    return MissionOrder(labels, tuple(int(before[t]) for t in turns)) if all(labels) else None


def possible_orders(problem: Problem, most: int) -> list[MissionOrder]:
    """Orders that the automaton allows, each transition closer to acceptance; ``most`` at most.

    Trees find the orders that suit their samples; another one may be better after smoothing. Of more than
    ``BEGUN`` unfinished orders of one length, the orders with the shortest way are extended.
    """
    logic, places = problem.logic, _label_places(problem)
    delta, start = helpful_delta(logic), problem.scene.start
    found: list[MissionOrder] = []
    level = [_Begun((), (), int(delta[logic.initial, problem.locate(start[None])[0]]), start, 0.0)]
    while level and len(found) < most:
        longer: list[_Begun] = []
        for begun in level:
            if logic.distance[begun.state] == 0.0:
                if begun.labels:
                    found.append(MissionOrder(begun.labels, begun.states))
                continue
            for label, (column, middles) in places.items():
                then = int(delta[begun.state, column])
                if logic.distance[then] < logic.distance[begun.state]:
                    longer.append(begun.followed_by(label, then, middles))
        if len(longer) > BEGUN:
            longer = sorted(longer, key=lambda one: one.length)[:BEGUN]
        level = longer
    return found[:most]


def _label_places(problem: Problem) -> dict[frozenset[str], tuple[int, FloatArray]]:
    """For each label a cell that shows it, and the middles of all such cells (n, 2)."""
    atoms = set(problem.atoms)
    shown = sorted(
        {(tuple(sorted(label & atoms)), c) for c, label in enumerate(problem.labels) if label & atoms}
    )
    cells: dict[frozenset[str], list[int]] = {}
    for names, c in shown:
        cells.setdefault(frozenset(names), []).append(c)
    polygons = problem.decomposition.cells
    middles = {label: np.array([polygons[c].mean(axis=0) for c in own]) for label, own in cells.items()}
    order = dict.fromkeys(frozenset(names) for names, _ in reversed(shown))
    return {label: (cells[label][0], middles[label]) for label in order}
