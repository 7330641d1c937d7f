"""Bend: the convex programme about an iterate (the only module that imports cvxpy)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.cone_form import Statement
from pareto_ltl.planning.refine.course import FACE_MARGIN
from pareto_ltl.planning.refine.obligations import face_deviations, path_obligations
from pareto_ltl.planning.refine.parametrised import ParametrisedProgramme
from pareto_ltl.planning.refine.risk_sharing import ROWS, RiskSharing, risk_sharing
from pareto_ltl.planning.refine.search_map import search_map
from pareto_ltl.planning.refine.step_programme import motion_values
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

FINEST = 1e-3  # smallest standard deviation that the risk model resolves, in full steps
RELIEF = 50.0  # penalty for violating a constraint by a full step; above every multiplier observed
PIECES = (0.5, 1.0, 1.5, 2.0, 2.4, 2.8, 3.2, 3.6, 4.1)  # tangents of 1 - Φ for witnesses
SURE_DEVIATIONS = 10.0  # standard deviations that count as certainty


@dataclass(frozen=True, slots=True)
class Programme:
    """One parametrised problem for all paths of a run of at most ``steps`` steps.

    Lengths are in full steps (u_max dt), positions count from the middle of the map.
    """

    stated: ParametrisedProgramme
    steps: int
    witnesses: int
    faces: int

    def give(self, **values: Any) -> None:
        """Set parameters."""
        self.stated.give(**values)

    def solve(self) -> FloatArray | None:
        """Positions (``steps`` + 1, 2), or None where the solver found none."""
        found = self.stated.solve()
        return None if found is None else np.column_stack(found)


@dataclass(frozen=True, slots=True)
class _Unknowns:
    """Variables of the programme; ``near`` models the risk of the nearest faces at each step."""

    x: Any
    y: Any
    relief: Any
    near: Any
    length: Any
    risk: Any
    at: Any

    def dot(self, normal: Any, row: int) -> Any:
        """Half plane ``row`` of every point: c' x."""
        return _dot(normal, row, self.x, self.y)


def _dot(normal: Any, row: int, u: Any, v: Any) -> Any:
    import cvxpy as cp

    return cp.multiply(normal[:, 2 * row], u) + cp.multiply(normal[:, 2 * row + 1], v)


@dataclass(frozen=True, slots=True)
class SmoothingShape:
    """All that the statement of a smoothing programme depends on.

    Attributes
    ----------
    b_inv : tuple of tuple of float
        B⁻¹.
    slowest : bool
        Whether there is a least airspeed.
    """

    steps: int
    witnesses: int
    faces: int
    b_inv: tuple[tuple[float, float], ...]
    slowest: bool
    sharing: RiskSharing


def smoothing_programme(problem: Problem, steps: int, witnesses: int, faces: int) -> Programme:
    """The programme of :func:`state_smoothing` for paths of at most ``steps`` steps."""
    motion = problem.motion
    b_inv = tuple(tuple(row) for row in motion.b_inv.tolist())
    shape = SmoothingShape(steps, witnesses, faces, b_inv, motion.u_min > 0.0, risk_sharing(problem))
    stated = ParametrisedProgramme(
        partial(state_smoothing, shape), repr(shape), feasibility=1e-7, scaled=True
    )
    return Programme(stated, steps, witnesses, faces)


def state_smoothing(shape: SmoothingShape) -> Statement:
    """The convex programme about an iterate x̄, for paths of at most ``steps`` steps.

        minimise    Σ ‖x_{t+1} - x_t‖ / L₀ + λ (Σ_w Σ_j ρ_wj + Σ_t χ_t) + relief
        subject to  ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ u_max dt,    F_t = A + dt Dμ(x̄_t)
                    û_t' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ u_min dt   along the last control, if u_min > 0
                    c' x_t ≥ d + z σ            one face of every obstacle for both ends of a step
                    a_j' x_w ≤ b_j              at the witness steps
                    ρ_wj ≥ tangents of 1 - Φ at (b_j - a_j' x_w) / σ_j, one of them that of x̄
                    χ_t  ≥ tangents of 1 - Φ at (c' x_t - d) / σ for the nearest faces
                    |x_t - x̄_t| ≤ trust,       x_t on the map,

    and what :mod:`~pareto_ltl.planning.refine.risk_sharing` adds. Relief, a penalised slack variable of each
    point, makes every instance feasible, so that an iterate which violates a constraint can be corrected.

    Eq. (M50) of docs/mathematics_methods.md.
    """
    import cvxpy as cp

    steps, witnesses, faces, sharing = shape.steps, shape.witnesses, shape.faces, shape.sharing
    n = steps + 1
    v = _Unknowns(
        cp.Variable(n), cp.Variable(n), cp.Variable(n, nonneg=True),
        cp.Variable((n, sharing.columns), nonneg=True), cp.Variable(steps),
        cp.Variable((witnesses, faces), nonneg=True), cp.Variable((witnesses, 2)),
    )  # fmt: skip
    shapes: dict[str, tuple[int, ...]] = {
        "cap": (steps,), "low": (n, 2), "high": (n, 2), "F": (steps, 4), "g": (steps, 2),
        "c": (n, 2 * ROWS), "d": (n, ROWS), "c_sd": (n, 2 * ROWS), "d_sd": (n, ROWS),
        "pick": (witnesses, n), "a": (witnesses, 2 * faces), "b": (witnesses, faces),
        "inside": (witnesses, faces), "slope": (witnesses, 2 * faces), "height": (witnesses, faces),
    }  # fmt: skip
    if shape.slowest:
        shapes |= {"ahead": (steps, 2), "behind": (steps, 2), "floor": (steps,)}
    given: dict[str, Any] = {key: cp.Parameter(shape) for key, shape in shapes.items()}
    given |= sharing.parameters(n)
    given |= {key: cp.Parameter(nonneg=True) for key in ("per_length", "weight")}
    constraints = [
        *_motion_constraints(shape.b_inv, given, v),
        *_clearance_constraints(sharing, given, v),
        *_witness_constraints(given, v, faces),
    ]
    cost = (
        given["per_length"] * cp.sum(v.length)
        + given["weight"] * (cp.sum(v.risk) + cp.sum(v.near))
        + RELIEF * cp.sum(v.relief)
    )
    return Statement(cp.Problem(cp.Minimize(cost), constraints), given, (v.x, v.y))


def _motion_constraints(
    b_inv: Sequence[Sequence[float]], given: Mapping[str, Any], v: _Unknowns
) -> list[Any]:
    """Constraints on airspeed and length of each step, the trust region, and the positions of witnesses."""
    import cvxpy as cp

    x, y = v.x, v.y

    def push(row: int) -> Any:
        moved = b_inv[row][0] * x[1:] + b_inv[row][1] * y[1:]
        return moved - _dot(given["F"], row, x[:-1], y[:-1]) - given["g"][:, row]

    slowest = []
    if "floor" in given:
        along = _dot(given["ahead"], 0, x[1:], y[1:]) - _dot(given["behind"], 0, x[:-1], y[:-1])
        slowest = [along + v.relief[1:] >= given["floor"]]
    return [
        *slowest,
        cp.SOC(given["cap"] + v.relief[1:], cp.vstack([push(0), push(1)]), axis=0),
        cp.SOC(v.length, cp.vstack([x[1:] - x[:-1], y[1:] - y[:-1]]), axis=0),
        x >= given["low"][:, 0], x <= given["high"][:, 0], y >= given["low"][:, 1], y <= given["high"][:, 1],
        v.at[:, 0] == given["pick"] @ x, v.at[:, 1] == given["pick"] @ y,
    ]  # fmt: skip


def _clearance_constraints(sharing: RiskSharing, given: Mapping[str, Any], v: _Unknowns) -> list[Any]:
    """Constraints that keep each point in its half planes, and the model of the risk that remains."""
    constraints = []
    for k in range(ROWS):
        constraints.append(v.dot(given["c"], k) + v.relief >= given["d"][:, k])
        near = v.near[:, sharing.column(k)]
        s = v.dot(given["c_sd"], k) - given["d_sd"][:, k]
        constraints += [near >= piece for piece in tail_tangents(sharing.tangents, s)]
        constraints += sharing.row_constraints(given, near, partial(v.dot, row=k), k)
    return constraints + sharing.limits(given, v.near, v.relief)


def _witness_constraints(given: Mapping[str, Any], v: _Unknowns, faces: int) -> list[Any]:
    """Constraints of witness steps: inside the region, and the model of the risk of missing it."""
    constraints = []
    for k in range(faces):
        s = given["b"][:, k] - _dot(given["a"], k, v.at[:, 0], v.at[:, 1])
        constraints.append(s >= given["inside"][:, k])
        constraints += [v.risk[:, k] >= piece for piece in tail_tangents(PIECES, s)]
        tangent = given["height"][:, k] + _dot(given["slope"], k, v.at[:, 0], v.at[:, 1])
        constraints.append(v.risk[:, k] >= tangent)
    return constraints


def tail_tangents(points: Sequence[float], s: Any) -> list[Any]:
    """Tangents of 1 - Φ at ``points``: it is convex for s ≥ 0, and their maximum models it."""
    return [
        0.5 * math.erfc(m / math.sqrt(2)) - math.exp(-m * m / 2) / math.sqrt(2 * math.pi) * (s - m)
        for m in points
    ]


def bend_path(
    model: Programme,
    problem: Problem,
    x: FloatArray,
    cov: FloatArray,
    weight: float,
    trust: float,
    shortest: float,
) -> FloatArray | None:
    """Solve the convex programme about the iterate ``x`` (T+1, 2) [m].

    Returns the new positions (T+1, 2) [m], or None if there is no solution or more witnesses than in
    ``model``. ``cov`` (T+1, 2, 2) [m²], ``weight`` λ of the risk, ``trust`` the half width of the trust
    region [full steps], ``shortest`` L₀ [m].
    """
    centre, unit, n = problem.scene.bounds.mean(axis=0), problem.reach, len(x)
    scaled = (x - centre) / unit
    todo = path_obligations(problem, x, cov)
    if len(todo.witness) > model.witnesses:
        return None
    set_motion(model, problem, x)
    low, high = (problem.scene.bounds + np.array([[FACE_MARGIN], [-FACE_MARGIN]]) - centre) / unit
    padded = np.vstack([scaled, np.repeat(scaled[-1:], model.steps + 1 - n, axis=0)])
    lower = np.minimum(np.maximum(padded - trust, low), high)
    upper = np.maximum(np.minimum(padded + trust, high), low)
    lower[0] = upper[0] = scaled[0]
    model.give(low=lower, high=upper)
    set_clearance(model, problem, x, cov, todo.avoid, soft=weight > 0)
    set_witnesses(model, problem, x, cov, todo.witness, soft=weight > 0)
    model.give(per_length=unit / max(shortest, 1e-3 * unit), weight=weight)
    found = model.solve()
    return None if found is None else np.vstack([x[:1], centre + unit * found[1:n]])


def set_motion(model: Programme, problem: Problem, x: FloatArray) -> None:
    """Limits of the airspeed, and F_t and g_t of B⁻¹ (x_{t+1} - F_t x_t - g_t)."""
    model.give(**motion_values(problem, propagate(problem, x), model.steps))


def separating(faces: kd.Faces, clearance: FloatArray) -> IntArray:
    """For every step and obstacle the face with the most ``clearance`` (T+1, F) at the closer end, (T, m)."""
    both = np.minimum(clearance[:-1], clearance[1:])
    # Where faces tie, as at a corner, the one with the larger sum of both clearances is taken.
    both = both + 1e-6 * (clearance[:-1] + clearance[1:])
    largest = np.maximum.reduceat(both, faces.ptr[:-1], axis=1)
    rows = np.where(
        both == np.repeat(largest, np.diff(faces.ptr), axis=1), np.arange(both.shape[1]), both.shape[1]
    )
    return np.asarray(np.minimum.reduceat(rows, faces.ptr[:-1], axis=1), np.int64)


def set_clearance(
    model: Programme, problem: Problem, x: FloatArray, cov: FloatArray, avoid: BoolArray, *, soft: bool
) -> None:
    """The tightest half planes of every point: obstacles' faces for its two steps, forbidden cells' faces."""
    from scipy.special import ndtr

    sharing = risk_sharing(problem)
    normal, offset, sd, room, before = tightest_planes(problem, x, cov, avoid)
    centre, unit, n = problem.scene.bounds.mean(axis=0), problem.reach, len(x)
    c, d = np.zeros((model.steps + 1, ROWS, 2)), np.full((model.steps + 1, ROWS), -SURE_DEVIATIONS)
    c_sd, d_sd, counted = np.zeros_like(c), np.full_like(d, -SURE_DEVIATIONS), np.zeros_like(d)
    steep, level = np.zeros_like(c), np.zeros_like(d)
    if room.shape[1]:
        count = min(ROWS, room.shape[1])
        rows = np.argsort(room, axis=1, kind="stable")[:, :count]
        t = np.arange(n)[:, None]
        normal, reach = normal[t, rows], (offset[t, rows] - normal[t, rows] @ centre) / unit
        spread, known = sd[t, rows] / unit, np.isfinite(room[t, rows])
        z = np.where(spread > 0, sharing.deviations, 0.0)
        need = reach + z * spread + FACE_MARGIN / unit
        c[:n, :count] = np.where(known[..., None], normal, 0.0)
        d[:n, :count] = np.where(known, need, -SURE_DEVIATIONS)
        if soft:
            known &= spread > 0
            fine = np.maximum(spread, FINEST)
            c_sd[:n, :count] = np.where(known[..., None], normal / fine[..., None], 0.0)
            d_sd[:n, :count] = np.where(known, reach / fine, -SURE_DEVIATIONS)
            counted[:n, :count] = known & before[t, rows]
            s = np.maximum(np.einsum("tki,ti->tk", c_sd[:n], (x - centre) / unit) - d_sd[:n], 0.0)
            slope = np.exp(-s * s / 2) / math.sqrt(2 * math.pi)
            steep[:n], level[:n] = slope[..., None] * c_sd[:n], ndtr(-s) + slope * (s + d_sd[:n])
    model.give(c=c.reshape(-1, 2 * ROWS), d=d, c_sd=c_sd.reshape(-1, 2 * ROWS), d_sd=d_sd)
    if "counted" in model.stated.form.places:
        model.give(counted=counted, steep=steep.reshape(-1, 2 * ROWS), level=level)


def tightest_planes(
    problem: Problem, x: FloatArray, cov: FloatArray, avoid: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]:
    """Half planes that bound each point: normals (T+1, P, 2); offsets, σ and remaining clearance (T+1, P).

    Clearance is inf where there is no bound. The last array marks the half planes of barriers for the step
    that ends at the point: its collision risk is their sum.
    """
    faces = problem.barriers
    sd = face_deviations(faces.normal, cov)
    normal, offset, spread, left = _bounding_planes(problem, faces, x, sd)
    before = np.zeros(left.shape, bool)
    before[:, : len(faces.ptr) - 1] = True
    walls, asked = forbidden_polygons(problem, avoid)
    if not asked.shape[1]:
        return normal, offset, spread, left, before
    # σ is 0, so that only the mean matters, unless the plan is judged by V, which counts the risk of meeting
    # the cell.
    counted = isinstance(problem.world.mission, kd.Ordered) and isinstance(
        problem.world.collision, kd.PathBound
    )
    sd = face_deviations(walls.normal, cov) if counted else np.zeros((len(x), len(walls.offset)))
    parts = _bounding_planes(problem, walls, x, sd)
    parts[3][~np.tile(asked, 2)] = np.inf
    normal, offset, spread, left = (
        np.concatenate(pair, axis=1) for pair in zip((normal, offset, spread, left), parts, strict=True)
    )
    return normal, offset, spread, left, np.hstack([before, np.zeros(parts[3].shape, bool)])


def _bounding_planes(
    problem: Problem, faces: kd.Faces, x: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The face of each of m polygons that separates the step to a point, then that for the step from it.

    Normals (T+1, 2 m, 2), and offsets, σ and remaining clearance (T+1, 2 m); inf if both are the same face.
    """
    m, t = len(faces.ptr) - 1, np.arange(len(x))[:, None]
    room = risk_sharing(problem).room(x @ faces.normal.T - faces.offset, sd, FINEST * problem.reach)
    chosen = separating(faces, room) if m else np.empty((len(x) - 1, 0), np.int64)
    rows = np.hstack([np.vstack([chosen[:1], chosen]), np.vstack([chosen, chosen[-1:]])])
    left = room[t, rows]
    left[:, m:][rows[:, m:] == rows[:, :m]] = np.inf
    return faces.normal[rows], faces.offset[rows], sd[t, rows], left


def forbidden_polygons(problem: Problem, avoid: BoolArray) -> tuple[kd.Faces, BoolArray]:
    """Convex polygons around the cells to ``avoid`` (T+1, C), and at which steps to avoid each, (T+1, m).

    Where many cells with one label are merged into one shape, it is avoided at steps where all of them are.
    """
    polygons: list[FloatArray] = []
    asked = [np.zeros((len(avoid), 0), bool)]
    for group in search_map(problem).shown.values():
        hit = avoid[:, group.cells]
        if group.united:
            hit = np.repeat(np.all(hit, axis=1, keepdims=True), len(group.around), axis=1)
        wanted = np.flatnonzero(hit.any(axis=0))
        polygons += [group.around[k] for k in wanted]
        asked.append(hit[:, wanted])
    return pack_faces(polygons), np.hstack(asked)


def set_witnesses(
    model: Programme, problem: Problem, x: FloatArray, cov: FloatArray, witness: Sequence[tuple[int, int]], *,
    soft: bool,
) -> None:  # fmt: skip
    """Set the regions that hold the position at witness steps; ``soft`` models the risk of a miss as well."""
    from scipy.special import ndtr

    faces, centre, unit = search_map(problem).witness, problem.scene.bounds.mean(axis=0), problem.reach
    pick = np.zeros((model.witnesses, model.steps + 1))
    pick[:, 0] = 1.0  # an unused witness refers to the start and constrains nothing
    a, b = (
        np.zeros((model.witnesses, model.faces, 2)),
        np.full((model.witnesses, model.faces), SURE_DEVIATIONS),
    )
    inside, height, slope = np.full_like(b, -SURE_DEVIATIONS), np.zeros_like(b), np.zeros_like(a)
    for k, (t, part) in enumerate(witness):
        rows = slice(faces.ptr[part], faces.ptr[part + 1])
        normal, n = faces.normal[rows], int(faces.ptr[part + 1] - faces.ptr[part])
        fine = np.maximum(face_deviations(normal, cov[t : t + 1])[0] / unit, FINEST) if soft else np.ones(n)
        pick[k, 0], pick[k, t] = 0.0, 1.0
        a[k, :n] = normal / fine[:, None]
        b[k, :n] = (faces.offset[rows] - normal @ centre) / unit / fine
        inside[k, :n] = FACE_MARGIN / unit / fine
        if soft:
            s = np.maximum(b[k, :n] - a[k, :n] @ (x[t] - centre) / unit, 0.0)
            steep = np.exp(-s * s / 2) / math.sqrt(2 * math.pi)
            height[k, :n] = ndtr(-s) + steep * (s - b[k, :n])
            slope[k, :n] = steep[:, None] * a[k, :n]
    model.give(
        pick=pick, inside=inside, a=a.reshape(-1, 2 * model.faces), b=b,
        slope=slope.reshape(-1, 2 * model.faces), height=height,
    )  # fmt: skip
