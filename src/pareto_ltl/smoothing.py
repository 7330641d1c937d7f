"""Convex smoothing of tree paths (Section 4.8 of the design; the only room that knows cvxpy).

A tree path is right but crooked, and it spends more steps than it needs. Smoothing has three moves. *Pull*
draws a taut line through the path's own places of witness, around the corners of whatever the line would
cut. *Walk* flies a line with as few steps as the wind allows, since every step adds covariance. *Bend*
solves one convex programme about the last iterate, propagates exactly, and repeats.

Whatever comes out was flown by :func:`pareto_ltl.problem.evaluate` like any other path; an iterate that
fails there is never returned.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.config import SmoothingConfig
from pareto_ltl.errors import InfeasibleError
from pareto_ltl.kernels import tables as kt
from pareto_ltl.problem import Problem, accepted, evaluate, half_planes
from pareto_ltl.problem import faces as faces_of
from pareto_ltl.records import Path

if TYPE_CHECKING:
    import cvxpy as cp

MARGIN = 2.0  # [m] kept from every face, so that the solver's rounding harms nobody
CAP = 0.999  # share of u_max planned with: the wind is not quite linear over a trust region
ROWS = 3  # half planes a point keeps to, the tightest ones
FINEST = 1e-3  # smallest standard deviation that the risk model resolves, in full steps
GAIN = 1e-4  # of the merit: less ends the rounds
RELIEF = 50.0  # price of breaking a constraint by a full step; above every multiplier met
PIECES = (0.5, 1.0, 1.5, 2.0, 2.4, 2.8, 3.2, 3.6, 4.1)  # tangents of 1 - Φ for witnesses
TAIL = (2.6, 3.4)  # and for obstacles, where s ≥ z
LONG = 1.25  # lines of this many times the fewest steps are not worth the solver's time
ALIKE = 1e-3  # objectives that differ by less are the same
BESIDE = 1.3  # a gate lies within this many margins of both its obstacles
TOUCH = 1e-3  # [m] a place this much too near still lies on the margin
ANCHOR = 0.02  # how far from a region's rim towards its middle a line may touch it
FAR = 10.0  # standard deviations that count as certainty


# --- what a step owes the mission --------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Duties:
    """What the automaton asks of each step of a path.

    Attributes
    ----------
    q : (T+1,) int
        Planned automaton state after each step.
    witness : tuple of (step, part)
        Convex parts of regions that hold the position at a step.
    avoid : (T+1, C) bool
        Cells whose label would spoil the plan at a step.
    """

    q: IntArray
    witness: tuple[tuple[int, int], ...]
    avoid: BoolArray


def duties(problem: Problem, x: FloatArray, cov: FloatArray) -> Duties:
    """Read off what must hold for the means ``x`` (T+1, 2) to do what they do.

    A transition is put off to the safest step of the same visit, where the automaton does not mind.
    """
    logic = problem.tables.logic
    cell = problem.locate(x)
    q = _states(logic, cell)
    missed = _missed(problem, x, cov)
    before = np.concatenate([[logic.initial], q[:-1]])
    planned, witness = q.copy(), []
    for t in np.flatnonzero(q != before):
        parts = _needed(problem, x[t], int(before[t]), int(q[t]), int(cell[t]))
        if not parts:
            continue
        best = t
        if logic.covers[q[t], before[t]]:
            last = t
            while last + 1 < len(x) and q[last + 1] == q[t]:
                last += 1
            risk = missed[t : last + 1, parts].sum(axis=1)
            held = np.all(_slack(problem, x[t : last + 1])[:, parts] > 0.0, axis=1)
            held[0] = True
            best = t + int(np.argmin(np.where(held, risk, np.inf)))
        planned[t:best] = before[t]
        witness += [(int(best), part) for part in parts]
    return Duties(planned, tuple(witness), _spoiling(problem, planned))


def _states(logic: kt.Logic, cell: IntArray) -> IntArray:
    q, state = np.empty(len(cell), np.int64), logic.initial
    for t, c in enumerate(cell):
        state = q[t] = logic.delta[state, c]  # c = -1 is the column of no label
    return q


def _needed(problem: Problem, x: FloatArray, before: int, after: int, cell: int) -> list[int]:
    """Convex parts that must hold ``x`` for the step from ``before`` to ``after``."""
    logic, label = problem.tables.logic, problem.labels[cell] if cell >= 0 else frozenset()
    if logic.covers[logic.delta[before, -1], after]:
        return []
    column = {shown: c for c, shown in enumerate(problem.labels)} | {frozenset(): len(problem.labels)}
    atoms = [
        a for a in sorted(label & set(problem.atoms))
        if label - {a} not in column or not logic.covers[logic.delta[before, column[label - {a}]], after]
    ] or sorted(label & set(problem.atoms))[:1]  # fmt: skip
    slack = _slack(problem, x[None])[0]
    parts = [np.flatnonzero(problem.tables.regions.atom == problem.atoms.index(a)) for a in atoms]
    return [int(p[np.argmax(slack[p])]) for p in parts if len(p)]


def _spoiling(problem: Problem, q: IntArray) -> BoolArray:
    """Cells with a label whose reading at step t leads to no state as good as the planned one."""
    logic = problem.tables.logic
    labelled = np.array([bool(label) for label in problem.labels], bool)
    before = np.concatenate([[logic.initial], q[:-1]])
    return np.asarray(~logic.covers[logic.delta[before][:, :-1], q[:, None]] & labelled, bool)


def _slack(problem: Problem, x: FloatArray) -> FloatArray:
    """Distance to the nearest face of every region part, positive inside, (T+1, parts)."""
    faces = problem.tables.regions.faces
    return np.asarray(np.minimum.reduceat(faces.offset - x @ faces.normal.T, faces.ptr[:-1], axis=1), float)


def _missed(problem: Problem, x: FloatArray, cov: FloatArray) -> FloatArray:
    """Eq. (6) of every region part, (T+1, parts)."""
    from scipy.special import ndtr

    faces = problem.tables.regions.faces
    gap, sd = faces.offset - x @ faces.normal.T, _deviation(faces.normal, cov)
    return np.asarray(np.add.reduceat(ndtr(-gap / np.maximum(sd, 1e-3)), faces.ptr[:-1], axis=1), float)


def _deviation(normal: FloatArray, cov: FloatArray) -> FloatArray:
    """√(c_k' Σ_t c_k) of every step and face, (T+1, F); ``cov`` (T+1, 3) holds xx, xy, yy."""
    n = normal.T
    variance = cov @ np.stack([n[0] ** 2, 2 * n[0] * n[1], n[1] ** 2])
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), float)


# --- exact motion, also of what may not be flown -----------------------------------------------


def propagate(problem: Problem, x: FloatArray) -> FloatArray:
    """Covariances (T+1, 3) along means that may be too fast or cross an obstacle.

    The kernel of the exact evaluation runs on an empty map, so nothing is written down twice.
    """
    from pareto_ltl.kernels import path as kernel

    far = 1e12
    none = kt.Faces(np.zeros(1, np.int64), np.empty((0, 2)), np.empty(0))
    box = kt.Faces(
        np.array([0, 4]), np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]), np.full(4, far)
    )
    zero, one = np.zeros(1, np.int64), np.array([0, 1])
    open_map = problem.tables._replace(
        obstacles=none, regions=kt.Regions(none, np.empty(0, np.int64)),
        cells=kt.Cells(-far, -far, far, far, 1, one, zero, box, np.zeros((1, 0), bool)),
        logic=kt.Logic(np.zeros((1, 2), np.int64), np.zeros(1), np.ones((1, 1), bool), 0),
    )  # fmt: skip
    n = len(x)
    cov = np.empty((n, 3))
    kernel.evaluate(
        open_map, np.ascontiguousarray(x), problem.start_variance, math.inf, cov, np.empty((n - 1, 2)),
        np.empty(n, np.int64), np.empty(n, np.int64), np.empty(0), np.empty((n, 0)),
    )  # fmt: skip
    return cov


def wind_and_gradient(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """μ(x_t, t) (T, 2) [m/s] and Dμ (T, 2, 2) [1/s] at the rows of ``x``, one a step.

    μ is bilinear on the lattice, so ∂μ/∂x runs linearly between the differences along the cell's lower and
    upper side. Beyond the lattice the wind is constant.
    """
    wind = problem.tables.wind
    top = np.array(wind.mean.shape[1:3]) - 1
    g = (x - [wind.west, wind.south]) * wind.per_metre
    inside = (g >= 0) & (g <= top)
    g = np.clip(g, 0, top)
    i, j = np.minimum(g.astype(np.int64), top - 1).T
    fx, fy = (g - np.column_stack([i, j])).T[..., None]
    k, w = wind.slot[: len(x)], wind.weight[: len(x), None]
    after = np.minimum(k + 1, len(wind.mean) - 1)
    (c00, c10), (c01, c11) = (
        [(1 - w) * wind.mean[k, i + a, j + b] + w * wind.mean[after, i + a, j + b] for a in (0, 1)]
        for b in (0, 1)
    )
    mean = (1 - fy) * ((1 - fx) * c00 + fx * c10) + fy * ((1 - fx) * c01 + fx * c11)
    along = (1 - fy) * (c10 - c00) + fy * (c11 - c01)
    across = (1 - fx) * (c01 - c00) + fx * (c11 - c10)
    gradient = np.stack([along, across], axis=-1) * wind.per_metre * inside[:, None, :]
    return mean, gradient


# --- walk: the fewest steps along a line -------------------------------------------------------


def walk(problem: Problem, line: FloatArray) -> FloatArray | None:
    """Means (T+1, 2) along ``line`` (n, 2) through all its corners, in steps as long as the wind allows.

    None where the wind is too strong, or known no longer.
    """
    motion = problem.tables.motion
    x, last = [line[0]], problem.horizon
    for corner in line[1:]:
        while np.linalg.norm(corner - x[-1]) > MARGIN:
            if len(x) > last:
                return None
            s = _longest(motion, x[-1], corner, _wind(problem.tables.wind, x[-1], len(x) - 1))
            if s <= 1e-3:
                return None
            x.append(corner if s >= 1.0 else x[-1] + s * (corner - x[-1]))
        x[-1] = corner
    return np.array(x)


def _wind(wind: kt.Wind, x: FloatArray, step: int) -> FloatArray:
    """μ at one place and step, for loops in Python: a tenth of the time of :func:`wind_and_gradient`."""
    gx, gy = (float(x[0]) - wind.west) * wind.per_metre, (float(x[1]) - wind.south) * wind.per_metre
    nx, ny = wind.mean.shape[1:3]
    gx, gy = min(max(gx, 0.0), nx - 1.0), min(max(gy, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    k, w = wind.slot[step], wind.weight[step]
    block = wind.mean[k, i : i + 2, j : j + 2]
    if w > 0.0:
        block = (1 - w) * block + w * wind.mean[k + 1, i : i + 2, j : j + 2]
    fx, fy = gx - i, gy - j
    return np.asarray(
        (1 - fx) * ((1 - fy) * block[0, 0] + fy * block[0, 1])
        + fx * ((1 - fy) * block[1, 0] + fy * block[1, 1])
    )


def _longest(motion: kt.Motion, x: FloatArray, goal: FloatArray, wind: FloatArray) -> float:
    """Largest s ≤ 1 such that one step reaches x + s (goal - x): ‖c + s g‖ ≤ u_max is a quadratic."""
    c = motion.b_inv @ (x - motion.a @ x - motion.dt * wind) / motion.dt
    g = motion.b_inv @ (goal - x) / motion.dt
    aa, bb, cc = float(g @ g), float(g @ c), float(c @ c) - (CAP * motion.u_max) ** 2
    disc = bb * bb - aa * cc
    return 0.0 if disc < 0.0 else min(1.0, (math.sqrt(disc) - bb) / aa)


# --- pull: a taut line -------------------------------------------------------------------------


def _corners(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Where a taut line may bend: corners, and vectors v such that corner + r v clears both faces by r."""
    at, out = [np.empty((0, 2))], [np.empty((0, 2))]
    for polygon in polygons:
        normal = half_planes(polygon)[0]
        pair = np.stack([np.roll(normal, 1, axis=0), normal], axis=1)
        sharp = np.abs(np.linalg.det(pair)) > 1e-6
        at.append(polygon[sharp])
        out.append(np.linalg.solve(pair[sharp], np.ones((int(sharp.sum()), 2, 1)))[..., 0])
    return np.vstack(at), np.vstack(out)


def _gates(faces: kt.Faces, widest: float) -> tuple[FloatArray, FloatArray]:
    """Where a taut line may bend in a gap too narrow for the corners themselves.

    With the distance r to keep, the gap between two obstacles is the meeting of half planes ``c' x ≥ d + r``,
    and a taut line bends where two of their rims cross: at p + r v for one pair of faces. Kept are the
    crossings beside both obstacles and clear of all, for some r up to ``widest``.
    """
    owner = np.repeat(np.arange(len(faces.ptr) - 1), np.diff(faces.ptr))
    k, m = np.nonzero(owner[:, None] < owner)
    pair = np.stack([faces.normal[k], faces.normal[m]], axis=1)
    cross = np.abs(np.linalg.det(pair)) > 0.1
    k, m, pair = k[cross], m[cross], pair[cross]
    at = np.linalg.solve(pair, np.stack([faces.offset[k], faces.offset[m]], axis=1)[..., None])[..., 0]
    grow = np.linalg.solve(pair, np.ones((len(pair), 2, 1)))[..., 0]
    kept = np.zeros(len(at), bool)
    for r in (0.4 * widest, 0.7 * widest, widest):
        gap = (at + r * grow) @ faces.normal.T - faces.offset
        depth = np.maximum.reduceat(gap, faces.ptr[:-1], axis=1) if len(at) else np.empty((0, 1))
        rows = np.arange(len(at))
        beside = (depth[rows, owner[k]] <= BESIDE * r) & (depth[rows, owner[m]] <= BESIDE * r)
        kept |= beside & (depth >= r - TOUCH).all(axis=1)
    return at[kept], grow[kept]


@dataclass(frozen=True, slots=True)
class Order:
    """A mission order: the label read at each transition, and the automaton state before it."""

    labels: tuple[frozenset[str], ...]
    states: tuple[int, ...]


def order(problem: Problem, path: Path) -> Order | None:
    """The order in which ``path`` visits; None where a transition needs no region at all."""
    before = np.concatenate([[problem.tables.logic.initial], path.q[:-1]])
    turns = np.flatnonzero(path.q != before)
    labels = tuple(path.label[t] & set(problem.atoms) for t in turns)
    return Order(labels, tuple(int(before[t]) for t in turns)) if all(labels) else None


@dataclass(frozen=True, slots=True)
class _Floor:
    """Places to be at while one transition is awaited, and the walls in between.

    Place k lies at ``at[k] + r grow[k]`` where r is the distance to keep on arrival, and has ``room[k] +
    r more[k]`` to spare at each face; ``margin`` says which faces ask for r (those of obstacles).
    """

    at: FloatArray
    grow: FloatArray
    faces: kt.Faces
    margin: FloatArray
    room: FloatArray
    more: FloatArray
    first_goal: int


def _floor(
    problem: Problem, at: FloatArray, grow: FloatArray, label: frozenset[str], state: int, depth: float
) -> _Floor:
    """Goals show ``label``; cells whose label spoils waiting in ``state`` are walls as obstacles are."""
    logic, polygons = problem.tables.logic, problem.decomposition.cells
    spoils = ~logic.covers[logic.delta[state, :-1], state]
    walls = [
        cell for cell, shown, bad in zip(polygons, problem.labels, spoils, strict=True)
        if bad and shown and shown & set(problem.atoms) != label
    ]  # fmt: skip
    goals = _anchors(problem, label, depth)
    bends, out = _corners(walls)
    places = np.vstack([at, bends + MARGIN * out, goals])
    growth = np.vstack([grow, np.zeros((len(places) - len(grow), 2))])
    hard, soft = problem.tables.obstacles, faces_of(walls)
    faces = kt.Faces(
        np.concatenate([hard.ptr, hard.ptr[-1] + soft.ptr[1:]]), np.vstack([hard.normal, soft.normal]),
        np.concatenate([hard.offset, soft.offset]),
    )  # fmt: skip
    margin = np.concatenate([np.ones(len(hard.offset)), np.zeros(len(soft.offset))])
    room, more = places @ faces.normal.T - faces.offset, growth @ faces.normal.T - margin
    return _Floor(places, growth, faces, margin, room, more, len(places) - len(goals))


def taut(problem: Problem, plan: Order, path: Path, depth: float) -> FloatArray | None:
    """The shortest line (n, 2) that visits in the given order and keeps z σ from every obstacle.

    Dijkstra over (transitions done, place) in a visibility graph of the vertices of ``path``, corners of
    obstacles that grow with the time of arrival (σ of the path at that step), and points of the regions.
    Two places see each other if one face of every obstacle is cleared at both (Section 4.5). ``depth`` in
    [0, 1] says how deep into a region a visit goes: 0 the rim, 1 the middle.
    """
    low, high = problem.scene.bounds + np.array([[MARGIN], [-MARGIN]])
    sd = np.sqrt(np.maximum(np.linalg.eigvalsh(path.cov)[:, -1], 0.0))
    at, grow = _corners(problem.decomposition.obstacles)
    gates, wider = _gates(problem.tables.obstacles, problem.tables.z * float(sd.max()))
    at, grow = np.vstack([at, gates, path.x]), np.vstack([grow, wider, np.zeros_like(path.x)])
    floors = [
        _floor(problem, at, grow, label, state, depth)
        for label, state in zip(plan.labels, plan.states, strict=True)
    ]

    def keep(metres: FloatArray) -> FloatArray:
        step = np.minimum(metres / problem.reach, len(sd) - 1.0)
        return np.asarray(problem.tables.z * np.interp(step, np.arange(len(sd)), sd) + MARGIN, float)

    best: dict[tuple[int, int], float] = {(0, -1): 0.0}
    came: dict[tuple[int, int], tuple[int, int]] = {}
    where: dict[tuple[int, int], FloatArray] = {(0, -1): problem.scene.start}
    queue: list[tuple[float, tuple[int, int]]] = [(0.0, (0, -1))]
    while queue:
        length, here = heapq.heappop(queue)
        if length > best[here]:
            continue
        if here[0] == len(floors):
            return _trace(came, where, here)
        x, floor = where[here], floors[here[0]]
        ends = floor.at + floor.grow * keep(length + np.linalg.norm(floor.at - x, axis=1))[:, None]
        total = length + np.linalg.norm(ends - x, axis=1)
        own = (
            x @ floor.faces.normal.T - floor.faces.offset - keep(np.array([length])) * floor.margin >= -TOUCH
        )
        seen = _share(floor.faces, (floor.room + keep(total)[:, None] * floor.more >= -TOUCH) & own)
        seen &= np.all((ends >= low) & (ends <= high), axis=1)
        for k in np.flatnonzero(seen):
            there = (here[0] + int(k >= floor.first_goal), int(k))
            if total[k] < best.get(there, math.inf):
                best[there], came[there], where[there] = float(total[k]), here, ends[k]
                heapq.heappush(queue, (float(total[k]), there))
    return None


def _trace(
    came: dict[tuple[int, int], tuple[int, int]],
    where: dict[tuple[int, int], FloatArray],
    here: tuple[int, int],
) -> FloatArray:
    line = [where[here]]
    while here in came:
        here = came[here]
        line.append(where[here])
    return np.array(line[::-1])


def _anchors(problem: Problem, label: frozenset[str], depth: float) -> FloatArray:
    """Points of the cells that show ``label``: corners and middles of edges, drawn towards the middle."""
    found = []
    for cell, shown in zip(problem.decomposition.cells, problem.labels, strict=True):
        if shown & set(problem.atoms) == label:
            middle = cell.mean(axis=0)
            rim = np.vstack([cell, (cell + np.roll(cell, -1, axis=0)) / 2])
            found.append(rim + max(depth, ANCHOR) * (middle - rim) if depth < 1 else middle[None])
    return np.vstack(found)


def _share(faces: kt.Faces, clear: BoolArray) -> BoolArray:
    """Which rows of ``clear`` (P, F) have a face of every obstacle."""
    if len(faces.ptr) == 1:
        return np.ones(len(clear), bool)
    return np.asarray(np.logical_or.reduceat(clear, faces.ptr[:-1], axis=1).all(axis=1), bool)


def pull(problem: Problem, x: FloatArray, cov: FloatArray, keep: Sequence[int]) -> FloatArray:
    """The shortest line through vertices of ``x`` (T+1, 2) from the first to the last past those in ``keep``.

    Vertices i < j may be joined if one face of every obstacle is cleared at both.
    """
    faces = problem.tables.obstacles
    clear = x @ faces.normal.T - faces.offset >= problem.tables.z * _deviation(faces.normal, cov) - TOUCH
    stops = np.array(sorted({0, *keep}))
    cost, previous = np.zeros(len(x)), np.zeros(len(x), np.int64)
    for j in range(1, len(x)):
        first = stops[np.searchsorted(stops, j) - 1]
        joined = _share(faces, clear[first:j] & clear[j])
        joined[-1] = True  # as flown
        reach = cost[first:j] + np.linalg.norm(x[first:j] - x[j], axis=1)
        k = int(np.argmin(np.where(joined, reach, np.inf)))
        cost[j], previous[j] = reach[k], first + k
    rows = [len(x) - 1]
    while rows[-1] > 0:
        rows.append(int(previous[rows[-1]]))
    return x[rows[::-1]]


# --- bend: the convex programme ----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Programme:
    """One parametrised problem for all paths of a run of at most ``steps`` steps.

    Lengths are in full steps (u_max dt), positions count from the middle of the map. cvxpy canonicalises
    once; after that its tensors turn parameters into Clarabel's matrices, and the solver keeps its
    symbolic factorisation. This takes 2 ms less a solve than ``problem.solve``.
    """

    problem: cp.Problem
    given: dict[str, cp.Parameter]
    position: tuple[int, int]  # ids of the variables x and y
    steps: int
    witnesses: int
    faces: int
    engine: dict[str, Any]

    def solve(self) -> FloatArray | None:
        """Positions (``steps`` + 1, 2), or None where the solver found none."""
        import clarabel

        if not self.engine:
            self._start()
        form = self.engine["form"]
        q, _, A, b = form.apply_parameters()
        solver = self.engine.get("solver")
        if solver is None:
            P = self.engine["P"]
            solver = clarabel.DefaultSolver(P, q, -A, b, self.engine["cones"], self.engine["settings"])
            self.engine["solver"] = solver
        else:
            solver.update(q=q, A=-A, b=b)
        answer = solver.solve()
        if answer.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            return None
        z = np.array(answer.x)
        n = self.steps + 1
        columns = [form.var_id_to_col[key] for key in self.position]
        found = np.column_stack([z[column : column + n] for column in columns])
        return found if np.isfinite(found).all() else None

    def _start(self) -> None:
        import clarabel
        import cvxpy as cp
        from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
        from scipy.sparse import csc_array

        data, _, _ = self.problem.get_problem_data(cp.CLARABEL)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        settings.tol_gap_abs = settings.tol_gap_rel = 1e-6
        settings.tol_feas, settings.iterative_refinement_enable = 1e-7, False  # refinement costs 40 % of a solve
        n = len(data["c"])
        self.engine.update(
            form=data[cp.settings.PARAM_PROB], cones=dims_to_solver_cones(data["dims"]), settings=settings,
            P=csc_array((n, n)),
        )  # fmt: skip


def programme(problem: Problem, steps: int, witnesses: int, faces: int) -> Programme:
    """minimise  Σ ‖x_{t+1} - x_t‖ / L₀ + λ (Σ_w Σ_j ρ_wj + Σ_t χ_t) + relief
    subject to   ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ u_max dt,  F_t = A + dt Dμ(x̄_t)
                 c' x_t ≥ d + z σ         one face of every obstacle for both ends of a step
                 a_j' x_w ≤ b_j           at the witness steps
                 ρ_wj ≥ tangents of 1 - Φ at (b_j - a_j' x_w) / σ_j, one of them that of the last iterate
                 χ_t  ≥ tangents of 1 - Φ at (c' x_t - d) / σ for the nearest faces
                 |x_t - x̄_t| ≤ trust,  x_t on the map.

    Relief makes every instance feasible, so that a line which is not yet flyable can be mended.
    """
    import cvxpy as cp

    n, b_inv = steps + 1, problem.tables.motion.b_inv
    x, y, relief, near = (
        cp.Variable(n),
        cp.Variable(n),
        cp.Variable(n, nonneg=True),
        cp.Variable(n, nonneg=True),
    )
    length, risk = cp.Variable(steps), cp.Variable((witnesses, faces), nonneg=True)
    at = cp.Variable((witnesses, 2))
    shapes: dict[str, tuple[int, ...]] = {
        "low": (n, 2), "high": (n, 2), "F": (steps, 4), "g": (steps, 2),
        "c": (n, 2 * ROWS), "d": (n, ROWS), "c_sd": (n, 2 * ROWS), "d_sd": (n, ROWS),
        "pick": (witnesses, n), "a": (witnesses, 2 * faces), "b": (witnesses, faces),
        "inside": (witnesses, faces), "slope": (witnesses, 2 * faces), "height": (witnesses, faces),
    }  # fmt: skip
    given: dict[str, Any] = {key: cp.Parameter(shape) for key, shape in shapes.items()}
    given |= {key: cp.Parameter(nonneg=True) for key in ("per_length", "weight")}

    def dot(normal: Any, row: int, u: Any, v: Any) -> Any:
        return cp.multiply(normal[:, 2 * row], u) + cp.multiply(normal[:, 2 * row + 1], v)

    def push(row: int) -> Any:
        moved = b_inv[row, 0] * x[1:] + b_inv[row, 1] * y[1:]
        return moved - dot(given["F"], row, x[:-1], y[:-1]) - given["g"][:, row]

    constraints = [
        cp.SOC(CAP + relief[1:], cp.vstack([push(0), push(1)]), axis=0),
        cp.SOC(length, cp.vstack([x[1:] - x[:-1], y[1:] - y[:-1]]), axis=0),
        x >= given["low"][:, 0], x <= given["high"][:, 0], y >= given["low"][:, 1], y <= given["high"][:, 1],
        at[:, 0] == given["pick"] @ x, at[:, 1] == given["pick"] @ y,
    ]  # fmt: skip
    for k in range(ROWS):
        constraints.append(dot(given["c"], k, x, y) + relief >= given["d"][:, k])
        constraints += [
            near >= piece for piece in _tangents(TAIL, dot(given["c_sd"], k, x, y) - given["d_sd"][:, k])
        ]
    for k in range(faces):
        s = given["b"][:, k] - dot(given["a"], k, at[:, 0], at[:, 1])
        constraints.append(s >= given["inside"][:, k])
        constraints += [risk[:, k] >= piece for piece in _tangents(PIECES, s)]
        constraints.append(risk[:, k] >= given["height"][:, k] + dot(given["slope"], k, at[:, 0], at[:, 1]))
    cost = (
        given["per_length"] * cp.sum(length)
        + given["weight"] * (cp.sum(risk) + cp.sum(near))
        + RELIEF * cp.sum(relief)
    )
    return Programme(
        cp.Problem(cp.Minimize(cost), constraints), given, (x.id, y.id), steps, witnesses, faces, {}
    )


def _tangents(points: Sequence[float], s: Any) -> list[Any]:
    """Tangents of 1 - Φ, which is convex for s ≥ 0: their maximum is its model."""
    return [
        0.5 * math.erfc(m / math.sqrt(2)) - math.exp(-m * m / 2) / math.sqrt(2 * math.pi) * (s - m)
        for m in points
    ]


def bend(
    model: Programme,
    problem: Problem,
    x: FloatArray,
    cov: FloatArray,
    weight: float,
    trust: float,
    shortest: float,
) -> FloatArray | None:
    """One convex solve about the iterate ``x`` (T+1, 2)."""
    centre, unit, n = problem.scene.bounds.mean(axis=0), problem.reach, len(x)
    scaled = (x - centre) / unit
    todo = duties(problem, x, cov)
    if len(todo.witness) > model.witnesses:
        return None
    set_motion(model, problem, x)
    low, high = (problem.scene.bounds + np.array([[MARGIN], [-MARGIN]]) - centre) / unit
    padded = np.vstack([scaled, np.repeat(scaled[-1:], model.steps + 1 - n, axis=0)])
    model.given["low"].value = np.minimum(np.maximum(padded - trust, low), high)
    model.given["high"].value = np.maximum(np.minimum(padded + trust, high), low)
    model.given["low"].value[0] = model.given["high"].value[0] = scaled[0]
    set_clearance(model, problem, x, cov, todo.avoid, soft=weight > 0)
    set_witnesses(model, problem, x, cov, todo.witness, soft=weight > 0)
    model.given["per_length"].value = unit / max(shortest, 1e-3 * unit)
    model.given["weight"].value = weight
    found = model.solve()
    return None if found is None else np.vstack([x[:1], centre + unit * found[1:n]])


def set_motion(model: Programme, problem: Problem, x: FloatArray) -> None:
    """F_t and g_t of B⁻¹ (x_{t+1} - F_t x_t - g_t); steps beyond the path stand still in still air."""
    motion, centre, unit = problem.tables.motion, problem.scene.bounds.mean(axis=0), problem.reach
    T = len(x) - 1
    mean, gradient = wind_and_gradient(problem, x[:-1])
    F = motion.a + motion.dt * gradient
    g = ((motion.a @ centre - centre) + motion.dt * mean) / unit
    g -= motion.dt * np.einsum("tij,tj->ti", gradient, (x[:-1] - centre) / unit)
    model.given["F"].value = np.vstack(
        [(motion.b_inv @ F).reshape(T, 4), np.tile(motion.b_inv.ravel(), (model.steps - T, 1))]
    )
    model.given["g"].value = np.vstack([g @ motion.b_inv.T, np.zeros((model.steps - T, 2))])


def separating(faces: kt.Faces, clearance: FloatArray) -> IntArray:
    """For every step and obstacle the face of largest least ``clearance`` (T+1, F) at both ends, (T, m)."""
    both = np.minimum(clearance[:-1], clearance[1:])
    # Where faces tie, as at a corner, the one that clears more in all goes first.
    both = both + 1e-6 * (clearance[:-1] + clearance[1:])
    spans = zip(faces.ptr[:-1], faces.ptr[1:], strict=True)
    return np.column_stack([i + np.argmax(both[:, i:j], axis=1) for i, j in spans]).astype(np.int64)


def set_clearance(
    model: Programme, problem: Problem, x: FloatArray, cov: FloatArray, avoid: BoolArray, *, soft: bool
) -> None:
    """The tightest half planes of every point: obstacles' faces for its two steps, forbidden cells' faces."""
    normal, offset, sd, room = tightest(problem, x, cov, avoid)
    centre, unit, n = problem.scene.bounds.mean(axis=0), problem.reach, len(x)
    c, d = np.zeros((model.steps + 1, ROWS, 2)), np.full((model.steps + 1, ROWS), -FAR)
    c_sd, d_sd = np.zeros_like(c), np.full_like(d, -FAR)
    if room.shape[1]:
        count = min(ROWS, room.shape[1])
        rows = np.argsort(room, axis=1, kind="stable")[:, :count]
        t = np.arange(n)[:, None]
        normal, reach = normal[t, rows], (offset[t, rows] - normal[t, rows] @ centre) / unit
        spread, known = sd[t, rows] / unit, np.isfinite(room[t, rows])
        z = np.where(spread > 0, problem.tables.z, 0.0)
        need = reach + z * spread + MARGIN / unit
        c[:n, :count] = np.where(known[..., None], normal, 0.0)
        d[:n, :count] = np.where(known, need, -FAR)
        if soft:
            known &= spread > 0
            fine = np.maximum(spread, FINEST)
            c_sd[:n, :count] = np.where(known[..., None], normal / fine[..., None], 0.0)
            d_sd[:n, :count] = np.where(known, reach / fine, -FAR)
    model.given["c"].value, model.given["d"].value = c.reshape(-1, 2 * ROWS), d
    model.given["c_sd"].value, model.given["d_sd"].value = c_sd.reshape(-1, 2 * ROWS), d_sd


def tightest(
    problem: Problem, x: FloatArray, cov: FloatArray, avoid: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Half planes that each point keeps to: normals (T+1, P, 2), and offsets, σ and room left (T+1, P).

    σ is 0 at forbidden cells, whose label the mean alone decides; room is inf where nothing is asked.
    """
    faces, n = problem.tables.obstacles, len(x)
    sd = _deviation(faces.normal, cov)
    room = x @ faces.normal.T - faces.offset - problem.tables.z * sd
    chosen = separating(faces, room) if len(faces.ptr) > 1 else np.empty((n - 1, 0), np.int64)
    rows = np.hstack(
        [np.vstack([chosen[:1], chosen]), np.vstack([chosen, chosen[-1:]])]
    )  # step before, step after
    m, t = chosen.shape[1], np.arange(n)[:, None]
    left = room[t, rows]
    left[:, m:][rows[:, m:] == rows[:, :m]] = np.inf  # the same face twice
    parts = [(faces.normal[rows], faces.offset[rows], sd[t, rows], left)]
    cells = problem.tables.cells.faces
    for cell in np.flatnonzero(avoid.any(axis=0)):
        own = slice(cells.ptr[cell], cells.ptr[cell + 1])
        gap = x @ cells.normal[own].T - cells.offset[own]
        k = np.argmax(gap, axis=1)
        least = np.where(avoid[:, cell], gap.max(axis=1), np.inf)[:, None]
        parts.append((cells.normal[own][k][:, None], cells.offset[own][k][:, None], np.zeros((n, 1)), least))
    normal, offset, spread, left = (np.concatenate(p, axis=1) for p in zip(*parts, strict=True))
    return normal, offset, spread, left


def set_witnesses(
    model: Programme, problem: Problem, x: FloatArray, cov: FloatArray, witness: Sequence[tuple[int, int]], *,
    soft: bool,
) -> None:  # fmt: skip
    """Regions that hold the position at a step; without ``soft`` their faces are only not crossed."""
    from scipy.special import ndtr

    faces, centre, unit = problem.tables.regions.faces, problem.scene.bounds.mean(axis=0), problem.reach
    pick = np.zeros((model.witnesses, model.steps + 1))
    pick[:, 0] = 1.0  # a place left empty looks at the start and asks nothing
    a, b = np.zeros((model.witnesses, model.faces, 2)), np.full((model.witnesses, model.faces), FAR)
    inside, height, slope = np.full_like(b, -FAR), np.zeros_like(b), np.zeros_like(a)
    for k, (t, part) in enumerate(witness):
        rows = slice(faces.ptr[part], faces.ptr[part + 1])
        normal, n = faces.normal[rows], int(faces.ptr[part + 1] - faces.ptr[part])
        fine = np.maximum(_deviation(normal, cov[t : t + 1])[0] / unit, FINEST) if soft else np.ones(n)
        pick[k, 0], pick[k, t] = 0.0, 1.0
        a[k, :n] = normal / fine[:, None]
        b[k, :n] = (faces.offset[rows] - normal @ centre) / unit / fine
        inside[k, :n] = MARGIN / unit / fine
        if soft:
            s = np.maximum(b[k, :n] - a[k, :n] @ (x[t] - centre) / unit, 0.0)
            steep = np.exp(-s * s / 2) / math.sqrt(2 * math.pi)
            height[k, :n] = ndtr(-s) + steep * (s - b[k, :n])
            slope[k, :n] = steep[:, None] * a[k, :n]
    model.given["pick"].value, model.given["inside"].value = pick, inside
    model.given["a"].value, model.given["b"].value = a.reshape(-1, 2 * model.faces), b
    model.given["slope"].value, model.given["height"].value = slope.reshape(-1, 2 * model.faces), height


# --- the room's one service --------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Start:
    """Means to begin with, the mission order they follow and the tree path they come from."""

    x: FloatArray
    plan: Order | None
    origin: str


def smooth(
    cfg: SmoothingConfig,
    problem: Problem,
    paths: Sequence[Path],
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Path, ...]:
    """Smoothed versions of ``paths``, every one flown and accepted, none dominated by another.

    Parameters
    ----------
    cfg : SmoothingConfig
        ``candidates`` lines are smoothed at most, each once for every one of ``weights``: λ in
        ``length / shortest + λ (mission risk + collision risk)``.
    paths : sequence of Path
        Accepted, by mission risk.
    progress : callable
        Called with (lines done, lines in all).
    """
    wanted = cfg.enabled and len(paths) > 0 and len(problem.tables.regions.atom) > 0
    begun = starts(cfg, problem, paths) if wanted else []
    if not begun:
        return ()
    certain = not any(path.cov.any() for path in paths)
    weights = [0.0] if certain else sorted(cfg.weights, reverse=True)
    model = fitting(problem, begun)
    shortest = min(p.objectives.length for p in paths)
    found: list[Path] = []
    for k, start in enumerate(begun):
        x = start.x
        for weight in weights:  # the safest first: it needs the most steps, and its line the least change
            path = improve(cfg, model, problem, x, weight, shortest)
            if path is not None:
                found.append(replace(path, origin=f"{start.origin}, smoothed at risk weight {weight:g}"))
                x = path.x
        if progress is not None:
            progress(k + 1, len(begun))
    return worthwhile(problem, found, paths)


def worthwhile(problem: Problem, found: Sequence[Path], paths: Sequence[Path]) -> tuple[Path, ...]:
    """Those of ``found`` that nothing else equals to a thousandth, with their ordered bound."""
    rows = [_row(p) for p in paths]
    kept = []
    for path in sorted(found, key=lambda p: tuple(_row(p))):
        row = _row(path)
        if not any((other <= row * (1 + ALIKE)).all() for other in rows):
            rows.append(row)
            kept.append(path)
    return tuple(evaluate(problem, p.x, p.origin) for p in kept)


def _row(path: Path) -> FloatArray:
    o = path.objectives
    return np.array([o.mission_risk_paper, o.collision_risk, o.length])


def starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[Path]) -> list[Start]:
    """A taut line for every mission order, then the paths themselves, pulled and flown in the fewest steps.

    Under uncertainty a taut line visits the middle of each region, since steps can be taken from a path
    more easily than added.
    """
    depth = 1.0 if any(path.cov.any() for path in paths) else 0.0
    found: list[Start] = []
    firsts: dict[Order, Path] = {}
    for path in paths:
        plan = order(problem, path)
        if plan is not None:
            firsts.setdefault(plan, path)
    for plan, path in firsts.items():
        line = taut(problem, plan, path, depth)
        x = None if line is None else walk(problem, line)
        if x is not None and completes(problem, x):
            found.append(Start(x, plan, f"{path.origin}, drawn taut"))
    for k in np.unique(np.linspace(0, len(paths) - 1, min(cfg.candidates, len(paths))).astype(int)):
        x = shortened(problem, paths[k].x)
        start = Start(paths[k].x if x is None else x, order(problem, paths[k]), paths[k].origin)
        if not any(_alike(problem, start, other) for other in found):
            found.append(start)
    fewest = min((len(start.x) for start in found), default=0)
    return [start for start in found if 1 < len(start.x) <= LONG * fewest][: cfg.candidates]


def _alike(problem: Problem, one: Start, other: Start) -> bool:
    """Whether two lines are never more than half a step apart."""
    if one.plan != other.plan:
        return False
    gap = np.linalg.norm(one.x[:, None] - other.x[None], axis=2)
    return bool(max(gap.min(axis=0).max(), gap.min(axis=1).max()) < problem.reach / 2)


def shortened(problem: Problem, x: FloatArray) -> FloatArray | None:
    """``x`` pulled taut between its witnesses and flown in the fewest steps; None where the mission fails."""
    cov = propagate(problem, x)
    y = walk(problem, pull(problem, x, cov, [t for t, _ in duties(problem, x, cov).witness]))
    return y if y is not None and completes(problem, y) else None


def completes(problem: Problem, x: FloatArray) -> bool:
    """Whether the labels along ``x`` complete the mission, flyable or not."""
    logic = problem.tables.logic
    return bool(logic.distance[_states(logic, problem.locate(x))[-1]] == 0.0)


def fitting(problem: Problem, begun: Sequence[Start]) -> Programme:
    """A programme that all starts fit into, in sizes rounded up so that they seldom change."""
    steps = max(len(start.x) for start in begun) - 1
    witnesses = max(len(duties(problem, start.x, propagate(problem, start.x)).witness) for start in begun)
    faces = int(np.diff(problem.tables.regions.faces.ptr).max())
    return programme(problem, -(-steps // 8) * 8, witnesses + 1, faces)


def improve(
    cfg: SmoothingConfig, model: Programme, problem: Problem, x: FloatArray, weight: float, shortest: float
) -> Path | None:
    """Bend, then once more with the steps that this set free taken out; None where nothing flew."""
    best = rounds(cfg, model, problem, x, weight, shortest)
    if best is None:
        return None
    y = shortened(problem, best.x)
    if y is None or len(y) >= len(best.x):
        return best
    other = rounds(cfg, model, problem, y, weight, shortest)
    if other is None:
        return best
    return min(best, other, key=lambda path: merit(path, weight, shortest))


def rounds(
    cfg: SmoothingConfig, model: Programme, problem: Problem, x: FloatArray, weight: float, shortest: float
) -> Path | None:
    """Bend and fly by turns until there is nothing to gain; the best that flew."""
    best, value = None, math.inf
    for _ in range(cfg.rounds):
        y = bend(model, problem, x, propagate(problem, x), weight, cfg.trust, shortest)
        if y is None:
            break
        path = fly(problem, y)
        if path is None and best is not None:
            path = damped(problem, best.x, y)
        x = y
        if path is None:
            continue
        now = merit(path, weight, shortest)
        gain = (value - now) / now
        if gain > 0.0:
            best, value = path, now
        if gain < GAIN:
            break
    return best


def merit(path: Path, weight: float, shortest: float) -> float:
    """length / shortest + λ (f_o + R)."""
    o = path.objectives
    return o.length / shortest + weight * (o.mission_risk_paper + o.collision_risk)


def fly(problem: Problem, x: FloatArray) -> Path | None:
    """The path along ``x`` if it is feasible and completes the mission."""
    try:
        path = evaluate(problem, x, "", ordered=False)
    except InfeasibleError:
        return None
    return path if accepted(problem, path) else None


def damped(problem: Problem, old: FloatArray, new: FloatArray) -> Path | None:
    """The longest of a few steps from what flew towards what did not."""
    for s in (0.5, 0.25, 0.125):
        path = fly(problem, old + s * (new - old))
        if path is not None:
            return path
    return None


__all__ = ["smooth"]
