"""The requirements of the mission: on each step of a path, and the orders in which labels may be read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.planning.pack_logic import helpful_delta, step_epochs
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

BEGUN = 400  # unfinished orders of one length that are extended


@dataclass(frozen=True, slots=True)
class Obligations:
    """The requirements of the automaton on each step of a path.

    Attributes
    ----------
    q : (T+1,) int
        Planned automaton state after each step.
    witness : tuple of (step, part)
        Convex parts of regions that hold the position at a step.
    avoid : (T+1, C) bool
        Cells whose label would lead to a worse state at a step, or on the segment to it or from it.
    """

    q: IntArray
    witness: tuple[tuple[int, int], ...]
    avoid: BoolArray


def path_obligations(problem: Problem, x: FloatArray, cov: FloatArray) -> Obligations:
    """The conditions at each step under which the automaton reads the same as along the means ``x`` (T+1, 2).

    A transition is moved to the safest step of the same visit if the automaton allows it. ``cov`` (T+1, 3)
    holds xx, xy, yy [m²].
    """
    logic = problem.logic
    cell = problem.locate(x)
    q = problem.states(x)
    missed = _visits_missed(problem, x, cov)
    epoch = step_epochs(logic.epoch, len(x))
    before = np.concatenate([[logic.initial], q[:-1]])
    planned, witness = q.copy(), []
    for t in np.flatnonzero(q != before):
        groups = _needed_parts(problem, int(t), int(before[t]), int(q[t]), int(cell[t]))
        if not groups:
            continue
        last = t
        while logic.covers[q[t], before[t]] and last + 1 < len(x) and q[last + 1] == q[t]:
            if epoch[last + 1] != epoch[t]:
                break
            last += 1
        risk, parts = _safest_parts(problem, x[t : last + 1], missed[t : last + 1], groups)
        best = t + int(np.argmin(risk))
        planned[t:best] = before[t]
        witness += [(int(best), int(part)) for part in parts[best - t]]
    return Obligations(planned, tuple(witness), _spoiling_cells(problem, planned, cell))


def completes(problem: Problem, x: FloatArray) -> bool:
    """Whether the labels along ``x`` complete the mission, flyable or not."""
    return bool(problem.logic.distance[problem.states(x)[-1]] == 0.0)


def _needed_parts(problem: Problem, t: int, before: int, after: int, cell: int) -> list[IntArray]:
    """For each region that step ``t`` must be in, its convex parts, one of which must hold the position.

    Then its letter leads from ``before`` to ``after``, as the letter of ``cell`` does.
    """
    logic, label = problem.reading(t), problem.labels[cell] if cell >= 0 else frozenset()
    if logic.covers[logic.delta[before, -1], after]:
        return []
    column = {shown: c for c, shown in enumerate(problem.labels)} | {frozenset(): len(problem.labels)}
    atoms = [
        a for a in sorted(label & set(problem.atoms))
        if label - {a} not in column or not logic.covers[logic.delta[before, column[label - {a}]], after]
    ] or sorted(label & set(problem.atoms))[:1]  # fmt: skip
    found = [np.flatnonzero(problem.theorem2.atom == problem.atoms.index(a)) for a in atoms]
    return [parts for parts in found if len(parts)]


def _safest_parts(
    problem: Problem, x: FloatArray, missed: FloatArray, groups: list[IntArray]
) -> tuple[FloatArray, IntArray]:
    """Sum (n,) of the risks of missing one part of each group at ``x`` (n, 2), and the parts (n, groups).

    The part with the least risk ``missed`` (n, parts) is taken. Parts that do not hold the mean are left out,
    and the risk is inf if none of a group is left; at the first step the nearest part is then taken.
    """
    faces, rows = problem.theorem2.faces, np.arange(len(x))
    # distance to the nearest face of every part, positive inside
    slack = np.minimum.reduceat(faces.offset - x @ faces.normal.T, faces.ptr[:-1], axis=1)
    risk, chosen = np.zeros(len(x)), np.empty((len(x), len(groups)), np.int64)
    for k, parts in enumerate(groups):
        own = np.where(slack[:, parts] > 0.0, missed[:, parts], np.inf)
        best = own.argmin(axis=1)
        if np.isinf(own[0, best[0]]):
            best[0] = slack[0, parts].argmax()
            own[0, best[0]] = missed[0, parts[best[0]]]
        risk += own[rows, best]
        chosen[:, k] = parts[best]
    return risk, chosen


def _spoiling_cells(problem: Problem, q: IntArray, cell: IntArray) -> BoolArray:
    """Cells whose label a path must not read at a step, or not meet on the segment to or from it, (T+1, C).

    Reading such a label leads to no state as good as the planned one ``q`` (T+1,); ``cell`` (T+1,) is
    planned.
    """
    logic = problem.logic
    labelled = np.array([bool(label) for label in problem.labels], bool)
    before = np.concatenate([[logic.initial], q[:-1]])
    epoch = step_epochs(logic.epoch, len(q))
    spoils = ~logic.covers[logic.delta[epoch, before][:, :-1], q[:, None]] & labelled
    met = logic.loses[epoch, q][:, :-1] & (np.arange(len(labelled)) != cell[:, None])
    met[1:] |= logic.loses[epoch[1:], q[:-1]][:, :-1] & (np.arange(len(labelled)) != cell[1:, None])
    return np.asarray(spoils | met, bool)


def _visits_missed(problem: Problem, x: FloatArray, cov: FloatArray) -> FloatArray:
    """Bound (6) on the risk of missing every region part, (T+1, parts)."""
    from scipy.special import ndtr

    faces = problem.theorem2.faces
    gap, sd = faces.offset - x @ faces.normal.T, face_deviations(faces.normal, cov)
    return np.asarray(np.add.reduceat(ndtr(-gap / np.maximum(sd, 1e-3)), faces.ptr[:-1], axis=1), float)


def face_deviations(normal: FloatArray, cov: FloatArray) -> FloatArray:
    """√(c_k' Σ_t c_k) of every step and face, (T+1, F); ``cov`` (T+1, 3) holds xx, xy, yy."""
    n = normal.T
    variance = cov @ np.stack([n[0] ** 2, 2 * n[0] * n[1], n[1] ** 2])
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), float)


# --- mission orders: the labels read one after another until the automaton accepts -----------------------


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


def possible_orders(problem: Problem, limit: int) -> list[MissionOrder]:
    """Orders that the automaton allows, each transition closer to acceptance; ``limit`` at most.

    Those with fewer transitions come first, of these those with the shortest way. Trees find the orders that
    suit their samples; another one may be better after smoothing. Of more than ``BEGUN`` unfinished orders of
    one length, the orders with the shortest way are extended.
    """
    logic, places = problem.logic, _label_places(problem)
    delta, start = helpful_delta(logic), problem.scene.start
    found: list[MissionOrder] = []
    level = [_Begun((), (), int(delta[logic.initial, problem.locate(start[None])[0]]), start, 0.0)]
    while level and len(found) < limit:
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
        level = sorted(longer, key=lambda one: one.length)[:BEGUN]
    return found[:limit]


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
