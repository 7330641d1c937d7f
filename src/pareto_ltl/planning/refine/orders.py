"""Mission orders: the labels read one after another until the automaton accepts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath


@dataclass(frozen=True, slots=True)
class MissionOrder:
    """A mission order: the label read at each transition, and the automaton state before it."""

    labels: tuple[frozenset[str], ...]
    states: tuple[int, ...]


def mission_order(problem: Problem, path: PlannedPath) -> MissionOrder | None:
    """The order in which ``path`` visits; None where a transition needs no region at all."""
    before = np.concatenate([[problem.world.logic.initial], path.q[:-1]])
    turns = np.flatnonzero(path.q != before)
    labels = tuple(path.label[t] & set(problem.atoms) for t in turns)
    return MissionOrder(labels, tuple(int(before[t]) for t in turns)) if all(labels) else None


def possible_orders(problem: Problem, most: int) -> list[MissionOrder]:
    """Orders that the automaton allows, every transition one nearer to acceptance; ``most`` at most.

    Trees find the order that suited their samples; another one may be better once smoothed.
    """
    logic, atoms = problem.world.logic, set(problem.atoms)
    shown = sorted(
        {(tuple(sorted(label & atoms)), c) for c, label in enumerate(problem.labels) if label & atoms}
    )
    column = dict(reversed([(frozenset(names), c) for names, c in shown]))
    found: list[MissionOrder] = []
    start = int(logic.delta[logic.initial, problem.locate(problem.scene.start[None])[0]])
    queue: list[tuple[tuple[frozenset[str], ...], tuple[int, ...], int]] = [((), (), start)]
    while queue and len(found) < most:
        labels, states, q = queue.pop(0)
        if logic.distance[q] == 0.0:
            if labels:
                found.append(MissionOrder(labels, states))
            continue
        for label, c in column.items():
            then = int(logic.delta[q, c])
            if logic.distance[then] < logic.distance[q]:
                queue.append(((*labels, label), (*states, q), then))
    return found
