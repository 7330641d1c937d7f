"""The convex programme of refinement, stated once a run in cvxpy and solved many times by Clarabel.

This is the only module that imports cvxpy. ``fidelity.refine=convex`` and ``sampled`` differ in the objective
alone: the length and the bounds on the risk, or a quadratic model of the failure rate.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock, Thread
from typing import Any

import numpy as np

from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.course import FACE_MARGIN
from pareto_ltl.planning.refine.obligations import face_deviations, path_obligations
from pareto_ltl.planning.refine.search_map import search_map
from pareto_ltl.planning.refine.separation import ROWS, Separation, separation
from pareto_ltl.planning.refine.step_programme import RIDGE, Descent, motion_values
from pareto_ltl.support.arrays import FloatArray

LOG = logging.getLogger(__name__)

FINEST = 1e-3  # smallest standard deviation that the risk model resolves, in full steps
RELIEF = 50.0  # penalty for violating a constraint by a full step; above every multiplier observed
PIECES = (0.5, 1.0, 1.5, 2.0, 2.4, 2.8, 3.2, 3.6, 4.1)  # tangents of 1 - Φ for witnesses
LINE_PIECES = (1.5, 2.4)  # tangents of 1 - Φ for lines, besides the one at the iterate
SURE = 10.0  # standard deviations that count as certainty
SHARE = 0.96  # share of epsilon to plan with: tangents lie below the curve, and σ changes with the path
FREE = 1e3  # a limit that no path reaches: full steps, probabilities
TOLERANCE = 1e-6  # of the constraints, and of the gap between primal and dual


def import_early() -> None:
    """Import cvxpy in a thread: it takes about a second."""
    Thread(target=__import__, args=("cvxpy",)).start()


@dataclass(frozen=True, slots=True)
class Shape:
    """All that the statement depends on: sizes, B⁻¹, and whether there is a least airspeed."""

    steps: int
    witnesses: int
    faces: int
    b_inv: tuple[tuple[float, float], ...]
    slowest: bool


@dataclass(frozen=True, slots=True)
class _Unknowns:
    """Variables of the programme: points, relief of each, lengths, risks of lines and of witnesses."""

    x: Any
    y: Any
    relief: Any
    length: Any
    chi: Any
    rho: Any
    at: Any


def _dot(c: Any, row: int, u: Any, v: Any) -> Any:
    """c' (u, v) of column pair ``row`` of ``c``."""
    import cvxpy as cp

    return cp.multiply(c[:, 2 * row], u) + cp.multiply(c[:, 2 * row + 1], v)


def state(shape: Shape) -> tuple[Any, dict[str, Any], _Unknowns]:
    """The programme about an iterate x̄ for paths of at most ``steps`` steps, its parameters and variables.

        minimise    λ_l Σ_t l_t + λ_r (Σ_tk χ_tk + Σ_wj ρ_wj) + g'x + ½ Σ_t ‖L_t' (x_t - x̄_t)‖² + relief
        subject to  ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ airspeed left,      F_t = A + dt Dμ(x̄_t)
                    û_t' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed    along the last control
                    ‖x_{t+1} - x_t‖ ≤ l_t,    Σ_t l_t ≤ L_max
                    c_tk' x_e ≥ h_tk + z σ_e      for both ends e of segment t and its closest lines k
                    χ_tk ≥ tangents of 1 - Φ at (c_tk' x_e - h_tk) / σ_e, one of them that of x̄
                    Σ_k χ_tk ≤ ε
                    a_j' x_w ≤ b_j              at the witness steps
                    ρ_wj ≥ tangents of 1 - Φ at (b_j - a_j' x_w) / σ_j, one of them that of x̄
                    |x_t - x̄_t| ≤ trust,       x_t on the map

    Relief, a penalised slack variable of each point, makes every instance feasible, so that an iterate which
    violates a constraint can be corrected. Lengths are in full steps (u_max dt); positions count from the
    middle of the map.

    Eq. (M50) of docs/mathematics_methods.md.
    """
    import cvxpy as cp

    n = shape.steps + 1
    v = _Unknowns(
        x=cp.Variable(n), y=cp.Variable(n), relief=cp.Variable(n, nonneg=True), length=cp.Variable(n - 1),
        chi=cp.Variable((n - 1, ROWS), nonneg=True),
        rho=cp.Variable((shape.witnesses, shape.faces), nonneg=True) if shape.witnesses else None,
        at=cp.Variable((shape.witnesses, 2)) if shape.witnesses else None,
    )  # fmt: skip
    given = {name: cp.Parameter(size) for name, size in _sizes(shape).items()}
    given |= {name: cp.Parameter(nonneg=True) for name in ("per_length", "weight", "longest", "epsilon")}
    given |= {"root": cp.Parameter((n, 3))}
    bend = [
        cp.multiply(given["root"][:, 0], v.x)
        + cp.multiply(given["root"][:, 1], v.y)
        - given["root_at"][:, 0],
        cp.multiply(given["root"][:, 2], v.y) - given["root_at"][:, 1],
    ]
    risks = cp.sum(v.chi) if v.rho is None else cp.sum(v.chi) + cp.sum(v.rho)
    cost = (
        given["per_length"] * cp.sum(v.length) + given["weight"] * risks + RELIEF * cp.sum(v.relief)
        + _sum_dot(given["gradient"], v) + 0.5 * cp.sum_squares(cp.hstack(bend))
    )  # fmt: skip
    constraints = [*_motion(shape, given, v), *_clearance(given, v), *_visits(shape, given, v)]
    return cp.Problem(cp.Minimize(cost), constraints), given, v


def _sizes(shape: Shape) -> dict[str, tuple[int, ...]]:
    """Sizes of the parameters that may have any sign."""
    n, T, W, F = shape.steps + 1, shape.steps, shape.witnesses, shape.faces
    sizes: dict[str, tuple[int, ...]] = {
        "gradient": (n, 2), "root_at": (n, 2), "cap": (T,), "F": (T, 4), "g": (T, 2), "low": (n, 2),
        "high": (n, 2),
    }  # fmt: skip
    for end in "01":
        sizes |= {f"need{end}": (T, ROWS), f"c_sd{end}": (T, 2 * ROWS), f"h_sd{end}": (T, ROWS)}
        sizes |= {f"steep{end}": (T, 2 * ROWS), f"level{end}": (T, ROWS)}
    sizes |= {"c": (T, 2 * ROWS)}
    if W:
        sizes |= {"pick": (W, n), "a": (W, 2 * F), "b": (W, F), "inside": (W, F)}
        sizes |= {"slope": (W, 2 * F), "height": (W, F)}
    if shape.slowest:
        sizes |= {"ahead": (T, 2), "behind": (T, 2), "floor": (T,)}
    return sizes


def _sum_dot(gradient: Any, v: _Unknowns) -> Any:
    return gradient[:, 0] @ v.x + gradient[:, 1] @ v.y


def _motion(shape: Shape, given: Mapping[str, Any], v: _Unknowns) -> Iterator[Any]:
    """Airspeed and length of each step, the longest length, the trust region and the map."""
    import cvxpy as cp

    x, y = v.x, v.y

    def push(row: int) -> Any:
        moved = shape.b_inv[row][0] * x[1:] + shape.b_inv[row][1] * y[1:]
        return moved - _dot(given["F"], row, x[:-1], y[:-1]) - given["g"][:, row]

    if shape.slowest:
        along = _dot(given["ahead"], 0, x[1:], y[1:]) - _dot(given["behind"], 0, x[:-1], y[:-1])
        yield along + v.relief[1:] >= given["floor"]
    yield cp.SOC(given["cap"] + v.relief[1:], cp.vstack([push(0), push(1)]), axis=0)
    yield cp.SOC(v.length, cp.vstack([x[1:] - x[:-1], y[1:] - y[:-1]]), axis=0)
    yield cp.sum(v.length) <= given["longest"]
    for k, u in enumerate((x, y)):
        yield u >= given["low"][:, k]
        yield u <= given["high"][:, k]


def _clearance(given: Mapping[str, Any], v: _Unknowns) -> Iterator[Any]:
    """Both ends of each segment beyond its lines, and the risk that remains at most epsilon."""
    import cvxpy as cp

    ends = {"0": (v.x[:-1], v.y[:-1], v.relief[:-1]), "1": (v.x[1:], v.y[1:], v.relief[1:])}
    for k in range(ROWS):
        for end, (x, y, relief) in ends.items():
            chi = v.chi[:, k]
            yield _dot(given["c"], k, x, y) + relief >= given[f"need{end}"][:, k]
            s = _dot(given[f"c_sd{end}"], k, x, y) - given[f"h_sd{end}"][:, k]
            for piece in tail_tangents(LINE_PIECES, s):
                yield chi >= piece
            yield chi >= given[f"level{end}"][:, k] - _dot(given[f"steep{end}"], k, x, y)
    yield cp.sum(v.chi, axis=1) <= given["epsilon"] + 0.05 * (v.relief[:-1] + v.relief[1:])


def _visits(shape: Shape, given: Mapping[str, Any], v: _Unknowns) -> Iterator[Any]:
    """Witness steps: inside the region, and the risk of missing it."""
    if not shape.witnesses:
        return
    yield v.at[:, 0] == given["pick"] @ v.x
    yield v.at[:, 1] == given["pick"] @ v.y
    for k in range(shape.faces):
        s = given["b"][:, k] - _dot(given["a"], k, v.at[:, 0], v.at[:, 1])
        yield s >= given["inside"][:, k]
        for piece in tail_tangents(PIECES, s):
            yield v.rho[:, k] >= piece
        yield v.rho[:, k] >= given["height"][:, k] + _dot(given["slope"], k, v.at[:, 0], v.at[:, 1])


def tail_tangents(points: Sequence[float], s: Any) -> list[Any]:
    """Tangents of 1 - Φ at ``points``: it is convex for s ≥ 0, and their maximum models it."""
    return [
        0.5 * math.erfc(m / math.sqrt(2)) - math.exp(-m * m / 2) / math.sqrt(2 * math.pi) * (s - m)
        for m in points
    ]


# --- the programme of a problem ------------------------------------------------------------------


@dataclass(slots=True)
class Programme:
    """The programme of one problem, for paths of at most ``shape.steps`` steps.

    Attributes
    ----------
    solves : int
        How often it was solved.
    """

    problem: Problem
    shape: Shape
    solves: int = 0
    _stated: Any = None
    _lock: Lock = field(default_factory=Lock)

    # --- the two objectives ---

    def bend(self, x: FloatArray, weight: float, trust: float, shortest: float) -> FloatArray | None:
        """Means that lower length / ``shortest`` + ``weight`` (mission risk + collision risk) about ``x``.

        ``x`` (T+1, 2) and ``shortest`` are in metres, ``trust`` is the half width of the trust region [full
        steps]. None if the solver found no solution, or the path has more witnesses than the programme.
        """
        unit = self.problem.reach
        flight = propagate(self.problem, x)
        todo = path_obligations(self.problem, x, flight.cov)
        if len(todo.witness) > self.shape.witnesses:
            return None
        lines = separation(self.problem, flight, todo.avoid, trust * unit)
        values = {
            **self._limits(flight, trust, lines, soft=weight > 0),
            **self._witnesses(x, flight.cov, todo.witness, soft=weight > 0),
            "per_length": unit / max(shortest, 1e-3 * unit), "weight": weight, "longest": FREE,
            "gradient": np.zeros((self._points, 2)), "root": np.zeros((self._points, 3)),
            "root_at": np.zeros((self._points, 2)),
        }  # fmt: skip
        return self._solved(values, x)

    def descend(self, flight: Flight, model: Descent, trust: float, longest: float) -> FloatArray | None:
        """Means that lower a quadratic ``model`` of the failure about those of ``flight``.

        ``trust`` in full steps, ``longest`` [m]. None if the solver found no solution.
        """
        unit, n = self.problem.reach, len(flight.x)
        hessian = model.hessian * (unit * unit / model.value)
        xx, yy = hessian[:, 0] + RIDGE, hessian[:, 2] + RIDGE
        root = np.zeros((self._points, 3))
        root[:n, 0] = np.sqrt(xx)
        root[:n, 1] = hessian[:, 1] / root[:n, 0]
        root[:n, 2] = np.sqrt(np.maximum(yy - root[:n, 1] ** 2, 0.0))
        at = self._scaled(flight.x)
        values = {
            **self._limits(flight, trust, separation(self.problem, flight, around=trust * unit), soft=True),
            "per_length": 0.0, "weight": 0.0, "longest": longest / unit,
            "gradient": self._padded(model.gradient * (unit / model.value)), "root": root,
            "root_at": self._padded(np.column_stack([
                root[:n, 0] * at[:, 0] + root[:n, 1] * at[:, 1], root[:n, 2] * at[:, 1]
            ])),
        }  # fmt: skip
        return self._solved(values, flight.x)

    # --- parameters ---

    @property
    def _points(self) -> int:
        return self.shape.steps + 1

    def _scaled(self, x: FloatArray) -> FloatArray:
        """Positions in full steps from the middle of the map."""
        return np.asarray((x - self.problem.scene.bounds.mean(axis=0)) / self.problem.reach, float)

    def _padded(self, rows: FloatArray, rest: float = 0.0, *, steps: bool = False) -> FloatArray:
        """``rows`` of every point (or step), and ``rest`` for those after the path."""
        full = np.full((self._points - steps, *rows.shape[1:]), rest)
        full[: len(rows)] = rows
        return full

    def _limits(
        self, flight: Flight, trust: float, lines: Separation, *, soft: bool
    ) -> dict[str, FloatArray | float]:
        """Motion, trust region and lines; ``soft`` models the risks of the lines as well."""
        problem, n = self.problem, len(flight.x)
        margin = np.array([[FACE_MARGIN], [-FACE_MARGIN]])
        low, high = self._scaled(problem.scene.bounds + margin)
        x = self._scaled(flight.x)
        around = np.vstack([x, np.repeat(x[-1:], self._points - n, axis=0)])
        lower = np.minimum(np.maximum(around - trust, low), high)
        upper = np.maximum(np.minimum(around + trust, high), low)
        lower[0] = upper[0] = x[0]
        limit = SHARE * lines.limit if soft and math.isfinite(lines.limit) else FREE
        return {
            **motion_values(problem, flight, self.shape.steps), **self._lines(lines, x, soft=soft),
            "low": lower, "high": upper, "epsilon": limit,
        }  # fmt: skip

    def _lines(self, lines: Separation, x: FloatArray, *, soft: bool) -> dict[str, FloatArray]:
        """Lines that both ends of a segment keep beyond, and tangents of the risk at ``x`` [full steps]."""
        from scipy.special import ndtr

        unit, c = self.problem.reach, lines.normal
        used = lines.owner >= 0
        h = (lines.offset - c @ self.problem.scene.bounds.mean(axis=0)) / unit
        values = {"c": self._padded(c.reshape(len(c), -1), steps=True)}
        for end, points in (("0", x[:-1]), ("1", x[1:])):
            sd = lines.sd[:, int(end)] / unit
            need = np.where(used, h + lines.deviations * sd + FACE_MARGIN / unit, -SURE)
            fine = np.maximum(sd, FINEST)
            c_sd = c / fine[..., None] if soft else np.zeros_like(c)
            h_sd = np.where(used & soft, h / fine, -SURE)
            s = np.maximum(np.einsum("tki,ti->tk", c_sd, points) - h_sd, 0.0)
            slope = np.exp(-s * s / 2) / math.sqrt(2 * math.pi)
            parts = {
                "need": (need, -SURE), "c_sd": (c_sd, 0.0), "h_sd": (h_sd, -SURE),
                "steep": (slope[..., None] * c_sd, 0.0),
                "level": (np.where(used & soft, ndtr(-s) + slope * (s + h_sd), 0.0), 0.0),
            }  # fmt: skip
            for name, (rows, rest) in parts.items():
                values[name + end] = self._padded(rows.reshape(len(rows), -1), rest, steps=True)
        return values

    def _witnesses(
        self, x: FloatArray, cov: FloatArray, witness: Sequence[tuple[int, int]], *, soft: bool
    ) -> dict[str, FloatArray]:
        """The regions that hold the position at witness steps; ``soft`` models the risk of a miss as well."""
        from scipy.special import ndtr

        if not self.shape.witnesses:
            return {}
        faces, unit, W = search_map(self.problem).witness, self.problem.reach, self.shape.witnesses
        at, middle = self._scaled(x), self.problem.scene.bounds.mean(axis=0)
        pick = np.zeros((W, self._points))
        pick[:, 0] = 1.0  # an unused witness refers to the start and constrains nothing
        a, b = np.zeros((W, self.shape.faces, 2)), np.full((W, self.shape.faces), SURE)
        inside, height, slope = np.full_like(b, -SURE), np.zeros_like(b), np.zeros_like(a)
        for k, (t, part) in enumerate(witness):
            rows = slice(faces.ptr[part], faces.ptr[part + 1])
            normal, m = faces.normal[rows], int(faces.ptr[part + 1] - faces.ptr[part])
            fine = (
                np.maximum(face_deviations(normal, cov[t : t + 1])[0] / unit, FINEST) if soft else np.ones(m)
            )
            pick[k, 0], pick[k, t] = 0.0, 1.0
            a[k, :m] = normal / fine[:, None]
            b[k, :m] = (faces.offset[rows] - normal @ middle) / unit / fine
            inside[k, :m] = FACE_MARGIN / unit / fine
            if soft:
                s = np.maximum(b[k, :m] - a[k, :m] @ at[t], 0.0)
                steep = np.exp(-s * s / 2) / math.sqrt(2 * math.pi)
                height[k, :m] = ndtr(-s) + steep * (s - b[k, :m])
                slope[k, :m] = steep[:, None] * a[k, :m]
        return {
            "pick": pick, "inside": inside, "a": a.reshape(W, -1), "b": b, "slope": slope.reshape(W, -1),
            "height": height,
        }  # fmt: skip

    # --- solving ---

    def _solved(self, values: Mapping[str, Any], x: FloatArray) -> FloatArray | None:
        """The means (T+1, 2) [m] of the solution for these parameters; None if there is none.

        A new solver for each programme: one that is kept scales by the data it saw first, so that results
        would depend on the order of the programmes.
        """
        import cvxpy as cp

        with self._lock:
            if self._stated is None:
                self._stated = state(self.shape)
            form, given, v = self._stated
            for name, value in values.items():
                given[name].value = value
            self.solves += 1
            try:
                form.solve(
                    solver=cp.CLARABEL, warm_start=False, ignore_dpp=False, tol_gap_abs=TOLERANCE,
                    tol_gap_rel=TOLERANCE, tol_feas=TOLERANCE, max_threads=1,
                    iterative_refinement_enable=False,  # it takes half as long again
                )  # fmt: skip
            except cp.SolverError as error:
                LOG.debug("programme %d: %s", self.solves, error)
                return None
            if form.status != cp.OPTIMAL:
                LOG.debug("programme %d: %s", self.solves, form.status)
                return None
            points = np.column_stack([v.x.value, v.y.value])
        if not np.isfinite(points).all():
            return None
        centre = self.problem.scene.bounds.mean(axis=0)
        return np.vstack([x[:1], centre + self.problem.reach * points[1 : len(x)]])


def programme(problem: Problem, steps: int, witnesses: int = 0, faces: int = 0) -> Programme:
    """The programme of ``problem`` for paths of at most ``steps`` steps and ``witnesses`` witnesses."""
    motion = problem.motion
    b_inv = tuple(tuple(row) for row in motion.b_inv.tolist())
    return Programme(problem, Shape(steps, witnesses, faces, b_inv, motion.u_min > 0.0))


@dataclass(slots=True)
class Programmes:
    """The programmes of one problem by size, each stated at first use.

    The size depends on the number of steps alone, so that results do not depend on the order of the solves.
    """

    problem: Problem
    _of: dict[int, Programme] = field(default_factory=dict)
    _lock: Lock = field(default_factory=Lock)

    def of(self, steps: int) -> Programme:
        """The programme for a path of ``steps`` steps: the next size on a ladder of ratios up to 3/2."""
        block = 1 << max(steps.bit_length() - 2, 0)
        size = -(-steps // block) * block
        with self._lock:
            return self._of.setdefault(size, programme(self.problem, size))

    @property
    def solves(self) -> int:
        """How many programmes have been solved."""
        return sum(one.solves for one in self._of.values())
