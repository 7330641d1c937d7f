"""The convex programme of a step, stated once a run (:mod:`~.statement`) and solved often by Clarabel.

``fidelity.refine=convex`` and ``sampled`` differ in the objective alone: the length and the bounds on the
risk, or a quadratic model of the failure rate. In the sweeps of ``sampled`` the latter is solved without
chance constraints, by :mod:`plane_kernels.step_solver`, whose memory and limits are at the end.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from itertools import repeat
from threading import Lock, Thread
from typing import Any

import numpy as np

from pareto_ltl.kernels.descent import RIDGE, SLOWEST, Limits
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.convex.statement import LineLimit, Shape, Statement, state
from pareto_ltl.planning.evaluate import airspeed_limits, propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.obligations import face_deviations, path_obligations
from pareto_ltl.planning.routes.search_map import search_map
from pareto_ltl.planning.routes.taut_lines import CAP, FACE_MARGIN
from pareto_ltl.planning.separation import Separation, separation
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from pareto_ltl.support.arrays import FloatArray
from plane_kernels.step_solver import StepModel, Work

LOG = logging.getLogger(__name__)

FINEST = 1e-3  # smallest standard deviation that the risk model resolves, in full steps
SURE = 10.0  # standard deviations that count as certainty
RESERVED = 0.04  # share of epsilon not planned with: tangents lie below the curve, σ changes with the path
LEAST_SHARE = 0.1  # of epsilon that is left for the lines of a segment, whatever polygons without a line need
FREE = 1e3  # a limit that no path reaches: full steps, probabilities
TOLERANCE = 1e-6  # of the constraints, and of the gap between primal and dual


def import_early() -> None:
    """Import cvxpy in a thread, with ``scipy.stats``, which it imports: both are slow."""
    Thread(target=import_module, args=("cvxpy",)).start()


@dataclass(frozen=True, slots=True)
class Descent:
    """Local model for a step: gradient (T+1, 2) [1/m], Hessian (T+1, 3) [1/m²] and value of the failure."""

    gradient: FloatArray
    hessian: FloatArray
    value: float


@dataclass(frozen=True, slots=True)
class Solution:
    """The solution of a programme, and what it would gain by easier limits (its multipliers).

    Attributes
    ----------
    x : (T+1, 2) float
        Means [m].
    value : float
        The least value of the objective.
    faster, longer : float
        Fall of the objective for a larger airspeed [1/(m/s)] and for a longer path [1/m].
    clearer : (T,) float
        Fall of the objective if the lines of a segment were farther away [1/m].
    """

    x: FloatArray
    value: float
    faster: float
    longer: float
    clearer: FloatArray


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
    _stated: Statement | None = None
    _lock: Lock = field(default_factory=Lock)

    # --- the two objectives ---

    def bend(self, x: FloatArray, weight: float, trust: float, shortest: float) -> Solution | None:
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

    def descend(self, flight: Flight, model: Descent, trust: float, longest: float) -> Solution | None:
        """Means that lower a quadratic ``model`` of the failure about the means of ``flight``.

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

    def _padded(self, rows: FloatArray, rest: float | FloatArray = 0.0, *, steps: bool = False) -> FloatArray:
        """``rows`` of every point (or step), and ``rest`` for those after the path."""
        full = np.full((self._points - steps, *rows.shape[1:]), rest)
        full[: len(rows)] = rows
        return full

    def _motion(self, flight: Flight) -> dict[str, FloatArray]:
        """F_t, g_t and the airspeed left; steps after the path stay in place in still air."""
        motion, centre, unit = self.problem.motion, self.problem.scene.bounds.mean(axis=0), self.problem.reach
        x = flight.x[:-1]
        mean, gradient = wind_and_gradient(self.problem.wind, x)
        g = ((motion.a @ centre - centre) + motion.dt * (mean + flight.shift)) / unit
        g -= motion.dt * np.einsum("tij,tj->ti", gradient, (x - centre) / unit)
        F = (motion.b_inv @ (motion.a + motion.dt * gradient)).reshape(-1, 4)
        values = {
            "cap": self._padded(CAP * (flight.speed / motion.u_max), 1.0, steps=True),
            "F": self._padded(F, motion.b_inv.ravel(), steps=True),
            "g": self._padded(g @ motion.b_inv.T, steps=True),
        }
        if self.shape.slowest:
            values |= self._least_airspeeds(flight, values["F"], values["g"])
        return values

    def _least_airspeeds(self, flight: Flight, F: FloatArray, g: FloatArray) -> dict[str, FloatArray]:
        """Half planes of controls that are fast enough: ahead' x_{t+1} - behind' x_t ≥ floor, in full steps.

        They are û' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed with the rows B⁻¹ F_t of ``F`` (S, 4) and
        B⁻¹ g_t of ``g`` (S, 2); steps after the path are not constrained. û is the direction of the control.

        The least airspeed is u_min with reserves, divided by ``CAP``, so that rounding leaves a margin. It is
        at most ``SLOWEST`` of the largest airspeed, so that a robot with u_min close to u_max keeps a choice:
        its controls are scaled into their limits afterwards.
        """
        motion, speed = self.problem.motion, np.linalg.norm(flight.u, axis=1)[:, None]
        heading = np.where(
            speed > 0.0, flight.u / np.maximum(speed, 1e-9), [1.0, 0.0]
        )  # east without control
        least, limit = airspeed_limits(self.problem, flight.speed)
        floor = np.minimum(least / CAP, SLOWEST * CAP * limit) / motion.u_max
        u = self._padded(heading, steps=True)
        return {
            "ahead": u @ motion.b_inv,
            "behind": np.einsum("ti,tij->tj", u, F.reshape(-1, 2, 2)),
            "floor": self._padded(floor, -1.0, steps=True) + (u * g).sum(axis=1),
        }

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
        limit = np.full(len(flight.u), FREE)
        if soft and math.isfinite(lines.limit):
            limit = np.maximum((1.0 - RESERVED) * lines.limit - lines.elsewhere, LEAST_SHARE * lines.limit)
        return {
            **self._motion(flight), **self._lines(lines, x, soft=soft),
            "low": lower, "high": upper, "left": self._padded(limit, FREE, steps=True),
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

    def _solved(self, values: Mapping[str, Any], x: FloatArray) -> Solution | None:
        """The solution for these parameters about the means ``x`` (T+1, 2) [m]; None if there is none.

        A new solver for each programme: one that is kept scales by the data it saw first, so that results
        would depend on the order of the programmes.
        """
        import cvxpy as cp

        with self._lock:
            sizes = {name: np.shape(value) for name, value in values.items()}
            stated = self._stated = self._stated or state(self.shape, sizes)
            for name, value in values.items():
                stated.given[name].value = value
            self.solves += 1
            try:
                stated.form.solve(
                    solver=cp.CLARABEL, warm_start=False, ignore_dpp=False, tol_gap_abs=TOLERANCE,
                    tol_gap_rel=TOLERANCE, tol_feas=TOLERANCE, max_threads=1,
                    iterative_refinement_enable=False,  # it takes half as long again
                )  # fmt: skip
            except cp.SolverError as error:
                LOG.debug("programme %d: %s", self.solves, error)
                return None
            if stated.form.status != cp.OPTIMAL:
                LOG.debug("programme %d: %s", self.solves, stated.form.status)
                return None
            value = float(stated.form.value)
            points = np.column_stack([stated.unknowns.x.value, stated.unknowns.y.value])
            unit, steps = self.problem.reach, len(x) - 1
            faster = float(stated.airspeed.dual_value[0][:steps].sum()) * CAP / self.problem.motion.u_max
            longer = float(stated.longest.dual_value) / unit
            clearer = sum(map(_eased, repeat(stated), stated.lines), np.zeros(self.shape.steps)) / unit
        if not np.isfinite(points).all():
            return None
        means = self.problem.scene.bounds.mean(axis=0) + unit * points[1 : len(x)]
        return Solution(np.vstack([x[:1], means]), value, faster, longer, clearer[:steps])


def _eased(stated: Statement, row: LineLimit) -> FloatArray:
    """Fall of the objective for a full step of clearance from the lines of ``row``, by segment."""
    gain = row.share * row.constraint.dual_value
    if not row.per:
        return np.asarray(gain)
    rows = stated.given[row.per + row.end].value[:, 2 * row.k : 2 * row.k + 2]
    return np.asarray(gain * np.hypot(*rows.T))


def programme(problem: Problem, steps: int, witnesses: int = 0, faces: int = 0) -> Programme:
    """The programme of ``problem`` for paths of at most ``steps`` steps and ``witnesses`` witnesses."""
    motion = problem.motion
    b_inv = tuple(tuple(row) for row in motion.b_inv.tolist())
    return Programme(problem, Shape(steps, witnesses, faces, b_inv, motion.u_min > 0.0))


@lru_cache(maxsize=2)
def programmes_of(problem: Problem) -> dict[int, Programme]:  # noqa: ARG001 - the key of the cache
    """The programmes of ``problem`` by size, kept for the last two problems."""
    return {}


def programme_for(problem: Problem, steps: int) -> Programme:
    """The programme for a path of ``steps`` steps: the next size on a ladder of ratios up to 3/2.

    The size depends on the number of steps alone, so that results do not depend on the order of the solves.
    """
    block = 1 << max(steps.bit_length() - 2, 0)
    size = -(-steps // block) * block
    return programmes_of(problem).setdefault(size, programme(problem, size))


# --- one step of the sampled refinement -----------------------------------------------------------


def path_limits(problem: Problem) -> Limits:
    """What holds for all paths of ``problem``: map, full step, airspeed, start."""
    low, high = problem.scene.bounds
    return Limits(low + FACE_MARGIN, high - FACE_MARGIN, problem.reach, CAP, problem.start_variance)


def step_memory(problem: Problem, steps: int) -> tuple[StepModel, Work]:
    """Memory of the programme of a solve in ``steps`` steps, and to solve it in.

    Lengths are in full steps, speeds are shares of the largest one.
    """
    motion = problem.motion
    held = steps if motion.u_min > 0.0 else 0  # least airspeeds
    model = StepModel(
        np.empty((steps + 1, 2)), np.empty((steps + 1, 3)), motion.b_inv, np.empty((steps, 2, 2)),
        np.empty((held, 2)), np.empty((2 * steps, 3)), np.empty(4 * steps + 1 + held),
    )  # fmt: skip
    cones = len(model.cone)
    work = Work(
        np.zeros((3, steps + 1, 3)), np.zeros((9, cones, 3)), np.zeros((7, len(model.line))), np.empty(cones),
        np.empty((steps + 1, 3)), np.empty((steps, 2, 2)),
    )  # fmt: skip
    return model, work
