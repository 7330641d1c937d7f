"""Starts of the sampled refinement: a path for each mission order and each way past the obstacles.

They come from a roadmap and taut lines, which depend on the map alone, and from the trees. Lines are flown
more slowly, or with a stop, where a time window opens after a robot at full speed would arrive.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import TypeAlias

import numpy as np

from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.evaluate import completing_path, propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, PlannedPath, Tree
from pareto_ltl.planning.refine.effort import USUAL, Effort
from pareto_ltl.planning.refine.sampled import resampled_means
from pareto_ltl.planning.routes.obligations import completes, possible_orders
from pareto_ltl.planning.routes.path_classes import PathClass, Word, crossed_rays, path_class, reduced_word
from pareto_ltl.planning.routes.roadmap import led_lines, roadmap_lines
from pareto_ltl.planning.routes.search_map import blocked_area, meets, sights
from pareto_ltl.planning.routes.taut_lines import taut_line, walk_line
from pareto_ltl.planning.selection import accepted_rows
from pareto_ltl.support.arrays import FloatArray, length_of, square_matrices
from pareto_ltl.support.errors import InfeasibleError

SIMILAR = 0.15  # relative difference of lengths that are similar
FLIPPED = 0.15  # of the map's size: obstacles closer to a path than this are also passed on the other side
BEYOND = 0.03  # of the map's size: distance from the obstacle on the other side
OVERSHOOT = 1.5  # standard deviations by which a path flies past a place before it returns to it
SHUTTLE = 0.8  # share of a full step that a robot with a least airspeed flies to and fro where it waits
TOO_SLOW = 0.8  # of the least airspeed: refinement lengthens a line that is flown a little too slowly
SLOWER = (0, 1, 2, 4, 8)  # steps added to a line that needs more airspeed than there is
STOPS = 12  # places along a line at which a stop is tried
TRIES = 300  # later arrivals of a line of the search; those that helped were among the first 50


StartKind: TypeAlias = tuple[PathClass, int]  # class, and number of the interval of lengths


@dataclass(frozen=True, slots=True)
class Start:
    """Means (T+1, 2) [m] to begin with, how they were made, and whether they are ``grown`` in a tree."""

    x: FloatArray
    origin: str
    grown: bool = False


def unlike_starts(problem: Problem, starts: Iterable[Start]) -> dict[StartKind, Start]:
    """Of the starts that complete the mission, the first of each class and similar length.

    A class can have several good paths: a longer one may pass a region twice.
    """
    found: dict[StartKind, Start] = {}
    for start in starts:
        kind = path_class(problem, start.x)
        if problem.logic.distance[kind.state] == 0.0:
            found.setdefault((kind, _length_box(length_of(start.x))), start)
    return found


def _length_box(length: float) -> int:
    """Number of the interval of lengths, ``SIMILAR`` wide, that holds ``length`` [m]."""
    return int(np.log(length + 1.0) / SIMILAR)


def first_starts(
    problem: Problem, forest: Forest | None = None, effort: Effort = USUAL
) -> dict[StartKind, Start]:
    """Taut lines, lines of the roadmap and tree paths, one of each class and similar length."""
    grown = [] if forest is None else tree_starts(problem, forest, effort)
    return unlike_starts(problem, [*line_starts(problem, effort), *roadmap_starts(problem, effort), *grown])


# --- trees ------------------------------------------------------------------------------------


def tree_starts(problem: Problem, forest: Forest, effort: Effort = USUAL) -> list[Start]:
    """The accepted path of least risk of each class and similar length, the safest first."""
    rows = accepted_rows(forest)
    if len(rows) == 0:
        return []
    kinds = [_vertex_classes(problem, tree) for tree in forest.trees]
    best: dict[object, Start] = {}
    for k in np.lexsort((rows[:, -1], rows[:, :-1].sum(axis=1))):
        j, v = (int(i) for i in forest.accepted[k])
        kind = kinds[j][v], _length_box(rows[k, -1])
        if kind not in best:
            best[kind] = Start(forest.trees[j].path(v), f"tree {j} vertex {v}", grown=True)
        if len(best) == effort.tree_classes:
            break
    return list(best.values())


def _vertex_classes(problem: Problem, tree: Tree) -> list[tuple[tuple[int, ...], tuple[Word, ...]]]:
    """States and cells where the state changes, and rays crossed leg by leg, on the path to every vertex."""
    crossed = crossed_rays(problem.decomposition.obstacles, tree.x[np.maximum(tree.parent, 0)], tree.x)
    found: list[tuple[tuple[int, ...], tuple[Word, ...]]] = []
    rows = zip(tree.parent.tolist(), tree.q.tolist(), tree.cell.tolist(), strict=True)
    for v, (parent, q, cell) in enumerate(rows):
        if parent < 0:
            found.append(((q, cell), ((),)))
            continue
        order, words = found[parent]
        words = (*words[:-1], reduced_word(words[-1], crossed.get(v, ())))
        if q != tree.q[parent]:
            order, words = (*order, q, cell), (*words, ())
        found.append((order, words))
    return found


# --- lines ------------------------------------------------------------------------------------


def line_starts(problem: Problem, effort: Effort = USUAL) -> list[Start]:
    """Taut lines of the first orders that the automaton allows, each at several distances from obstacles.

    The distances are in standard deviations of a robot that waits at the start for as long as the line takes.
    Orders after ``effort.varied_orders`` have one line each, at the largest distance that obstacles leave.
    Lines lead through the middle of regions or, where none of these can be flown before the wind ends, less
    far into them.
    """
    waits = np.repeat(problem.scene.start[None], problem.horizon + 1, axis=0)
    cov = square_matrices(propagate(problem, waits).cov)
    orders, found = possible_orders(problem, effort.orders), list[Start]()
    for depth in effort.depths:
        for number, plan in enumerate(orders):
            for z in effort.distances:
                line = taut_line(problem, plan, waits[:1], cov, depth, z)
                name = f"taut line, {z:g} deviations from obstacles"
                own = [] if line is None else _walked(problem, line, name)
                found += own
                if own and number >= effort.varied_orders:
                    break
        if found:
            break
    return found


def roadmap_starts(problem: Problem, effort: Effort = USUAL) -> list[Start]:
    """Lines of the roadmap, also led through landmarks, that can be flown before the wind ends."""
    lines = roadmap_lines(problem, effort.lines)
    led = led_lines(problem, lines)
    named = [(line, f"roadmap line {number}") for number, line in enumerate(lines)]
    named += [(line, f"line {number} through landmarks") for number, line in enumerate(led)]
    return [start for line, name in named for start in _walked(problem, line, name)]


def flown_lines(problem: Problem) -> list[PlannedPath]:
    """The taut lines and lines of the roadmap that can be flown, one of each class, some in more steps."""
    paths = (_flown_line(problem, start) for start in first_starts(problem).values())
    return [path for path in paths if path is not None]


def _flown_line(problem: Problem, start: Start) -> PlannedPath | None:
    """The line of ``start`` as it is, or else in the fewest more steps; None if none is a path."""
    steps = len(start.x) - 1
    for more in SLOWER:
        if steps + more > problem.horizon:
            break
        x = start.x if more == 0 else retimed_means(problem, start.x, steps + more)
        with suppress(InfeasibleError):
            return completing_path(problem, x, start.origin, tight=False)
    return None


def _walked(problem: Problem, line: FloatArray, origin: str) -> list[Start]:
    """``line`` (n, 2) [m] in steps, as a list of one start; empty if it takes too long."""
    x = walk_line(problem, line)
    if x is None or not 2 < len(x) <= problem.horizon + 1:
        return []
    return [Start(paced_line(problem, x), origin)]


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


def returning_starts(problem: Problem, flight: Flight, origin: str) -> list[Start]:
    """Copies of ``flight``, each of which flies past one place that is to be visited, and back through it.

    A robot that has missed a region may meet it on the second pass.
    """
    x, q = flight.x, problem.states(flight.x)
    blocked, found, (low, high) = blocked_area(problem), list[Start](), problem.scene.bounds
    for t in np.flatnonzero(np.diff(q)) + 1:
        heading = (x[t] - x[t - 1]) / max(float(np.linalg.norm(x[t] - x[t - 1])), 1e-9)
        sd = float(np.sqrt(np.linalg.eigvalsh(square_matrices(flight.cov[t : t + 1])[0])[-1]))
        there = np.clip(x[t] + OVERSHOOT * sd * heading, low, high)
        back = np.clip(x[t] - OVERSHOOT * sd * heading, low, high)
        rest = x[t + 1 :] if t + 1 < len(x) and q[-1] != q[t] else back[None]
        y = np.vstack([x[: t + 1], there, x[t], rest])
        if not meets(blocked, y[t : t + 3], y[t + 1 : t + 4]).any():
            found.append(Start(y, f"{origin}, returning"))
    return found


def led_starts(problem: Problem, flight: Flight, origin: str) -> list[Start]:
    """Copies of ``flight``, each led through one landmark on the way to one visit, where it does not meet it.

    A copy flies to the middle of the landmark and back. It leaves the flight as far before the nearest step
    as the landmark lies away, and is back as far behind it.
    """
    if not len(problem.landmarks):
        return []
    x, blocked, crossed, found = flight.x, blocked_area(problem), sights(problem, flight.x), list[Start]()
    turns = [0, *(np.flatnonzero(np.diff(problem.states(x))) + 1).tolist()]
    for k, corners in enumerate(problem.landmarks):
        middle = corners.mean(axis=0)
        gap = np.linalg.norm(x - middle, axis=1)
        for begin, end in pairwise(turns):
            if end - begin < 2 or crossed[begin:end, k].any():
                continue
            t = begin + int(np.argmin(gap[begin : end + 1]))
            away = int(np.ceil(gap[t] / problem.reach))
            out, back = max(begin, t - away), min(end, t + away)
            if not meets(blocked, x[[out, back]], np.broadcast_to(middle, (2, 2))).any():
                y = np.vstack([x[: out + 1], middle, x[back:]])
                found.append(Start(y, f"{origin}, through landmark {k + 1}"))
    return found


# --- delayed lines, for time windows that open after a robot at full speed would arrive ----------------


def retimed_means(
    problem: Problem, x: FloatArray, steps: int, needed: FloatArray | None = None
) -> FloatArray:
    """The line of ``x`` (T+1, 2) in ``steps`` steps; paced anew if these times do not complete the mission.

    Where pacing does not help, ``x`` is returned. ``needed`` as for
    :func:`~pareto_ltl.planning.refine.sampled.resampled_means`.
    """
    y = resampled_means(problem, x, steps, needed)
    if len(problem.logic.delta) == 1 or completes(problem, y) or not completes(problem, x):
        return y
    y = paced_line(problem, y, TRIES)
    return y if completes(problem, y) else x


def paced_line(problem: Problem, x: FloatArray, tries: int | None = None) -> FloatArray:
    """``x`` (T+1, 2) flown more slowly, or with a stop on the way, if only that completes the mission.

    Lines are walked at full speed, and may arrive before a window opens, or while a region is still
    forbidden. Without time windows, and if none of the first ``tries`` (all by default) of
    :func:`_later_lines` helps, ``x`` is returned.
    """
    if len(problem.logic.delta) == 1 or completes(problem, x):
        return x
    later = islice(_later_lines(problem, x), tries)
    return next((line for line in later if completes(problem, line)), x)


def _later_lines(problem: Problem, x: FloatArray) -> Iterator[FloatArray]:
    """Lines that arrive later than ``x`` (T+1, 2).

    First the whole line is slowed down, as little as necessary and hardly below the least airspeed; then it
    has a stop, the shortest first.
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    slowest = TOO_SLOW * problem.motion.u_min * problem.motion.dt
    limit = problem.horizon if slowest == 0.0 else min(problem.horizon, int(along[-1] / slowest))
    for steps in range(len(x), limit + 1):
        even = np.linspace(0.0, along[-1], steps + 1)
        yield np.stack([np.interp(even, along, x[:, k]) for k in (0, 1)], axis=1)
    for stop in range(1, problem.horizon + 2 - len(x)):
        for t in range(len(x) - 1, -1, -max(1, len(x) // STOPS)):
            yield np.concatenate([x[:t], _waiting(problem, x, t, stop), x[t + 1 :]])


def _waiting(problem: Problem, x: FloatArray, t: int, stop: int) -> FloatArray:
    """Position t of ``x`` and ``stop`` more: the same or, with a least airspeed, to and fro on the line."""
    there = np.repeat(x[t : t + 1], stop + 1, axis=0)
    if problem.motion.u_min > 0.0:
        other = x[t - 1] if t else x[1]
        way = other - x[t]
        there[1::2] += way * min(1.0, SHUTTLE * problem.reach / max(float(np.hypot(*way)), 1e-9))
    return there
