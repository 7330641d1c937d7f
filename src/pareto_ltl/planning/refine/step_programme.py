"""One step of the sampled refinement: a quadratic model of the failure within the limits of the robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.planning.evaluate import airspeed_limits
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.reference import wind_and_gradient
from pareto_ltl.planning.refine.cone_form import Statement
from pareto_ltl.planning.refine.parametrised import ParametrisedProgramme
from pareto_ltl.planning.refine.taut_lines import CAP, FACE_MARGIN
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.path import Flight

RIDGE = (
    1e-4  # curvature where no flight is near its limit, as a share of the failure, for a full step squared
)
NARROWEST = 0.99  # least airspeed of a programme, at most, as a share of its largest one
SIZES = 8  # programmes come for multiples of this many steps


@dataclass(frozen=True, slots=True)
class Descent:
    """What a step goes by: gradient (T+1, 2) [1/m], Hessian (T+1, 3) [1/m²] and value of the failure."""

    gradient: FloatArray
    hessian: FloatArray
    value: float


def step_programme(steps: int, slowest: bool) -> ParametrisedProgramme:
    """The programme of :func:`state_step`."""
    return ParametrisedProgramme(partial(state_step, steps, slowest), f"step {steps} {slowest}")


def state_step(steps: int, slowest: bool) -> Statement:
    """The cone programme about means x̄ for paths of at most ``steps`` steps; lengths in full steps.

        minimise    g' (x - x̄) + ½ (x - x̄)' H (x - x̄)
        subject to  ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ airspeed left,     F_t = A + dt Dμ(x̄_t)
                    û_t' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed    with ``slowest``
                    Σ_t ‖x_{t+1} - x_t‖ ≤ L_max
                    |x_t - x̄_t| ≤ trust,    x_t on the map

    û_t is the direction of the last control: the half plane lies within the set of controls that are fast
    enough, which is not convex.
    """
    import cvxpy as cp

    n = steps + 1
    x, y, length = cp.Variable(n), cp.Variable(n), cp.Variable(steps)
    shapes = {
        "cost": (n, 2), "cap": (steps,), "F": (steps, 4), "g": (steps, 2), "low": (n, 2), "high": (n, 2),
    } | ({"ahead": (steps, 2), "behind": (steps, 2), "floor": (steps,)} if slowest else {})  # fmt: skip
    given: dict[str, Any] = {name: cp.Parameter(shape) for name, shape in shapes.items()}
    given |= {"longest": cp.Parameter(), "turn": cp.Parameter(4)}
    F, g, turn = given["F"], given["g"], given["turn"]
    push = [
        turn[2 * r] * x[1:] + turn[2 * r + 1] * y[1:]
        - cp.multiply(F[:, 2 * r], x[:-1]) - cp.multiply(F[:, 2 * r + 1], y[:-1]) - g[:, r]
        for r in (0, 1)
    ]  # fmt: skip
    constraints = [
        cp.SOC(given["cap"], cp.vstack(push), axis=0),
        cp.SOC(length, cp.vstack([x[1:] - x[:-1], y[1:] - y[:-1]]), axis=0),
        cp.sum(length) <= given["longest"],
        x >= given["low"][:, 0], x <= given["high"][:, 0], y >= given["low"][:, 1], y <= given["high"][:, 1],
    ]  # fmt: skip
    if slowest:
        ahead, behind = given["ahead"], given["behind"]
        along = cp.multiply(ahead[:, 0], x[1:]) + cp.multiply(ahead[:, 1], y[1:])
        along -= cp.multiply(behind[:, 0], x[:-1]) + cp.multiply(behind[:, 1], y[:-1])
        constraints.append(along >= given["floor"])
    cost = given["cost"]
    objective = cp.sum(cp.multiply(cost[:, 0], x) + cp.multiply(cost[:, 1], y))
    return Statement(cp.Problem(cp.Minimize(objective), constraints), given, (x, y))


@dataclass(slots=True)
class StepProgrammes:
    """The programmes of one problem, by size. Threads take turns: Clarabel holds the interpreter's lock."""

    problem: Problem
    _turn: Lock = field(default_factory=Lock)
    _sizes: dict[int, ParametrisedProgramme] = field(default_factory=dict)

    def next_means(self, flight: Flight, descent: Descent, trust: float, longest: float) -> FloatArray | None:
        """Means (T+1, 2) that the model prefers to those of ``flight``; None where the solver found none.

        ``trust`` in full steps, ``longest`` [m].
        """
        problem, x = self.problem, flight.x
        steps = len(x) - 1
        size = -(-steps // SIZES) * SIZES
        centre, unit = problem.scene.bounds.mean(axis=0), problem.reach
        scaled = _padded((x - centre) / unit, size + 1)
        low, high = (problem.scene.bounds + np.array([[FACE_MARGIN], [-FACE_MARGIN]]) - centre) / unit
        lower, upper = np.maximum(scaled - trust, low), np.minimum(scaled + trust, high)
        lower[0] = upper[0] = scaled[0]
        lower[steps + 1 :], upper[steps + 1 :] = -np.inf, np.inf
        lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
        H = np.zeros((size + 1, 3))
        H[: steps + 1] = descent.hessian * (unit * unit / descent.value)
        H[: steps + 1, [0, 2]] += RIDGE
        cost = np.zeros((size + 1, 2))
        cost[: steps + 1] = descent.gradient * (unit / descent.value)
        cost[:, 0] -= H[:, 0] * scaled[:, 0] + H[:, 1] * scaled[:, 1]
        cost[:, 1] -= H[:, 1] * scaled[:, 0] + H[:, 2] * scaled[:, 1]
        far = 1e3
        given = motion_values(problem, flight, size) | {
            "turn": problem.motion.b_inv.ravel(),
            "low": np.clip(lower, -far, far), "high": np.clip(upper, -far, far),
            "cost": cost, "longest": longest / unit,
        }  # fmt: skip
        with self._turn:
            if size not in self._sizes:
                self._sizes[size] = step_programme(size, slowest=problem.motion.u_min > 0.0)
            self._sizes[size].give(**given)
            found = self._sizes[size].solve(H)
        return (
            None
            if found is None
            else np.vstack([x[:1], centre + unit * np.column_stack(found)[1 : steps + 1]])
        )


def _padded(rows: FloatArray, n: int) -> FloatArray:
    """``rows`` with the last one repeated up to ``n``."""
    return np.vstack([rows, np.repeat(rows[-1:], n - len(rows), axis=0)])


def motion_values(problem: Problem, flight: Flight, size: int) -> dict[str, FloatArray]:
    """F_t, g_t and the airspeed left; steps beyond the path stand still in still air."""
    motion, centre, unit = problem.motion, problem.scene.bounds.mean(axis=0), problem.reach
    x = flight.x
    T = len(x) - 1
    mean, gradient = wind_and_gradient(problem.wind, x[:-1])
    mean = mean + flight.shift
    F = motion.a + motion.dt * gradient
    g = ((motion.a @ centre - centre) + motion.dt * mean) / unit
    g -= motion.dt * np.einsum("tij,tj->ti", gradient, (x[:-1] - centre) / unit)
    still = np.tile(motion.b_inv.ravel(), (size - T, 1))
    values = {
        "cap": np.concatenate([CAP * (flight.speed / motion.u_max), np.ones(size - T)]),
        "F": np.vstack([(motion.b_inv @ F).reshape(T, 4), still]),
        "g": np.vstack([g @ motion.b_inv.T, np.zeros((size - T, 2))]),
    }
    if motion.u_min > 0.0:
        values |= slowest_controls(problem, flight, values["F"], values["g"])
    return values


def slowest_controls(problem: Problem, flight: Flight, F: FloatArray, g: FloatArray) -> dict[str, FloatArray]:
    """Half planes of controls that are fast enough: ahead' x_{t+1} - behind' x_t ≥ floor, in full steps.

    They are û' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed with the rows B⁻¹ F_t of ``F`` (S, 4) and
    B⁻¹ g_t of ``g`` (S, 2); nothing is asked beyond the path. The floor is as far above the least airspeed as
    the cap is below the largest one. A robot with hardly any choice of airspeed gets some all the same: its
    controls are brought to their limits when they are flown.
    """
    motion, T = problem.motion, len(flight.u)
    least, most = airspeed_limits(problem, flight.speed)
    speed = np.linalg.norm(flight.u, axis=1)[:, None]
    heading = np.zeros_like(g)
    heading[:T] = np.where(speed > 0.0, flight.u / np.maximum(speed, 1e-9), [1.0, 0.0])
    floor = np.full(len(g), -1.0)
    floor[:T] = np.minimum(least / CAP, NARROWEST * CAP * most) / motion.u_max
    return {
        "ahead": heading @ motion.b_inv,
        "behind": np.einsum("ti,tij->tj", heading, F.reshape(-1, 2, 2)),
        "floor": floor + (heading * g).sum(axis=1),
    }
