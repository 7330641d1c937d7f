"""Starts of the sampled refinement: a path for each mission order and each way past the obstacles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pareto_ltl.planning.evaluate import propagate, square_matrices
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, Tree
from pareto_ltl.planning.refine.pacing import paced_line
from pareto_ltl.planning.refine.path_classes import PathClass, crossed_rays, path_class, reduced_word
from pareto_ltl.planning.refine.taut_lines import possible_orders, taut_line, walk_line
from pareto_ltl.planning.selection import accepted_rows
from pareto_ltl.support.arrays import FloatArray

DISTANCES = (2.6, 2.0, 1.4, 1.1, 0.8, 0.4, 0.0)  # standard deviations that taut lines keep from obstacles
ORDERS = 24  # mission orders that lines are drawn for
CLASSES = 16  # classes of tree paths that are refined, those with the least risk
FLIPPED = 0.15  # of the map's size: obstacles closer to a path than this are also passed on the other side
BEYOND = 0.03  # of the map's size: distance from the obstacle on the other side


@dataclass(frozen=True, slots=True)
class Start:
    """Means (T+1, 2) [m] to begin with, and how they were made."""

    x: FloatArray
    origin: str


class _Waiting(NamedTuple):
    x: FloatArray
    cov: FloatArray


def unlike_starts(problem: Problem, starts: Iterable[Start]) -> dict[PathClass, Start]:
    """Of the starts that complete the mission, the first of each class."""
    found: dict[PathClass, Start] = {}
    for start in starts:
        kind = path_class(problem, start.x)
        if problem.logic.distance[kind.state] == 0.0:
            found.setdefault(kind, start)
    return found


def first_starts(problem: Problem, forest: Forest) -> dict[PathClass, Start]:
    """Tree paths and taut lines, one of each class."""
    return unlike_starts(problem, [*tree_starts(problem, forest), *line_starts(problem)])


# --- trees ------------------------------------------------------------------------------------


def tree_starts(problem: Problem, forest: Forest) -> list[Start]:
    """The accepted path of least V + R of each class, the safest first."""
    rows = accepted_rows(forest)
    if len(rows) == 0:
        return []
    kinds = [_vertex_classes(problem, tree) for tree in forest.trees]
    best: dict[object, Start] = {}
    for k in np.lexsort((rows[:, -1], rows[:, :-1].sum(axis=1))):
        j, v = (int(i) for i in forest.accepted[k])
        if kinds[j][v] not in best:
            best[kinds[j][v]] = Start(forest.trees[j].path(v), f"tree {j} vertex {v}")
        if len(best) == CLASSES:
            break
    return list(best.values())


def _vertex_classes(problem: Problem, tree: Tree) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """States and cells where the state changes, and rays crossed, on the path to every vertex."""
    crossed = crossed_rays(problem.decomposition.obstacles, tree.x[np.maximum(tree.parent, 0)], tree.x)
    found: list[tuple[tuple[int, ...], tuple[int, ...]]] = []
    rows = zip(tree.parent.tolist(), tree.q.tolist(), tree.cell.tolist(), strict=True)
    for v, (parent, q, cell) in enumerate(rows):
        if parent < 0:
            found.append(((q, cell), ()))
            continue
        order, word = found[parent]
        if q != tree.q[parent]:
            order = (*order, q, cell)
        found.append((order, reduced_word(word, crossed.get(v, ()))))
    return found


# --- lines ------------------------------------------------------------------------------------


def line_starts(problem: Problem) -> list[Start]:
    """Taut lines of every order that the automaton allows, each at several distances from obstacles.

    The distances are in standard deviations of a robot that waits at the start for as long as the line takes.
    """
    waits = np.repeat(problem.scene.start[None], problem.horizon + 1, axis=0)
    waiting = _Waiting(waits[:1], square_matrices(propagate(problem, waits).cov))
    found = []
    for plan in possible_orders(problem, ORDERS):
        for z in DISTANCES:
            line = taut_line(problem, plan, waiting, 1.0, z)
            x = None if line is None else walk_line(problem, line)
            if x is not None and 2 < len(x) <= problem.horizon:
                x = paced_line(problem, x)
                found.append(Start(x, f"taut line, {z:g} deviations from obstacles"))
    return found


# --- the other side ---------------------------------------------------------------------------


def flipped_starts(problem: Problem, x: FloatArray, origin: str) -> list[Start]:
    """Copies of ``x`` (T+1, 2) [m], each bent to the other side of one near obstacle."""
    size = float(np.ptp(problem.scene.bounds, axis=0).mean())
    found = []
    for k, obstacle in enumerate(problem.decomposition.obstacles):
        middle = obstacle.mean(axis=0)
        radius = float(np.linalg.norm(obstacle - middle, axis=1).max())
        gap = np.linalg.norm(x - middle, axis=1)
        t = int(np.argmin(gap[1:])) + 1
        if gap[t] > radius + FLIPPED * size or gap[t] < 1.0:
            continue
        push = (middle - x[t]) / gap[t] * (gap[t] + radius + BEYOND * size)
        window = max(2.0, (radius + gap[t]) / problem.reach)
        bump = np.exp(-0.5 * ((np.arange(len(x)) - t) / window) ** 2)
        bump[0] = 0.0
        low, high = problem.scene.bounds
        found.append(Start(np.clip(x + bump[:, None] * push, low, high), f"{origin}, past obstacle {k}"))
    return found
