"""One step of the sampled refinement: a quadratic model of the failure within the limits of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.planning.evaluate import airspeed_limits
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.course import FACE_MARGIN
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.path import Flight
    from pareto_ltl.kernels.step_solver import StepModel, Work

RIDGE = 1e-4  # curvature added to that of the failure, relative to it, for a full step squared
NARROWEST = 0.99  # upper limit of the least airspeed in a programme, as a share of the largest one


@dataclass(frozen=True, slots=True)
class Descent:
    """Local model for a step: gradient (T+1, 2) [1/m], Hessian (T+1, 3) [1/m²] and value of the failure."""

    gradient: FloatArray
    hessian: FloatArray
    value: float


def next_means(
    problem: Problem, flight: Flight, descent: Descent, trust: float, longest: float
) -> FloatArray | None:
    """Means (T+1, 2) [m] that minimise the model about those of ``flight``; None if the solver finds none.

    The programme, about the means x̄ and in full steps, is

        minimise    g' (x - x̄) + ½ (x - x̄)' H (x - x̄)
        subject to  ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ airspeed left,     F_t = A + dt Dμ(x̄_t)
                    û_t' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed    where there is one
                    Σ_t ‖x_{t+1} - x_t‖ ≤ L_max
                    |x_t - x̄_t| ≤ trust,    x_t on the map

    û_t is the direction of the last control: the half plane lies within the set of controls that are fast
    enough, which is not convex. ``trust`` in full steps, ``longest`` [m].

    Eq. (M56) of docs/mathematics_methods.md.
    """
    from pareto_ltl.kernels.step_solver import MOST, X, solve_step

    model = step_model(problem, flight, descent, trust, longest)
    work = step_memory(model)
    if solve_step(model, work) >= MOST:
        return None
    return np.asarray(flight.x + problem.reach * work.points[X, :, :2])


def step_model(
    problem: Problem, flight: Flight, descent: Descent, trust: float, longest: float
) -> StepModel:  # fmt: skip
    """The input of the solver: lengths in full steps, speeds as shares of the largest one."""
    from pareto_ltl.kernels.step_solver import StepModel

    motion, unit, x, T = problem.motion, problem.reach, flight.x, len(flight.u)
    hessian = descent.hessian * (unit * unit / descent.value)
    hessian[:, [0, 2]] += RIDGE
    push = flight.u / motion.u_max
    cone = np.zeros((T, 2, 3))
    cone[:, 0, 0], cone[:, 0, 1:] = CAP * flight.speed / motion.u_max, push
    cone[:, 1, 1:] = np.diff(x, axis=0) / unit
    low, high = (problem.scene.bounds + np.array([[FACE_MARGIN], [-FACE_MARGIN]]))[:, None] - x[1:]
    lower, upper = np.maximum(low / unit, -trust), np.minimum(high / unit, trust)
    box = np.column_stack([np.maximum(lower, upper), -np.minimum(lower, upper)])
    heading, least = np.zeros((0, 2)), np.zeros(0)
    if motion.u_min > 0.0:
        heading = headings(flight)
        least = (heading * push).sum(axis=1) - least_speeds(problem, flight)
    return StepModel(
        gradient=descent.gradient * (unit / descent.value),
        hessian=hessian,
        ahead=motion.b_inv,
        behind=motion.b_inv @ blown_along(problem, flight),
        heading=heading,
        cone=cone.reshape(-1, 3),
        line=np.concatenate([box.ravel(), [longest / unit], least]),
    )


def blown_along(problem: Problem, flight: Flight) -> FloatArray:
    """F_t = A + dt Dμ(x̄_t), (T, 2, 2): the linear map of each step on a small displacement."""
    from pareto_ltl.kernels.wind_slopes import wind_slopes

    slopes = np.empty((len(flight.u), 2, 2))
    wind_slopes(problem.wind, flight.x, slopes)
    return np.asarray(problem.motion.a + problem.motion.dt * slopes)


def step_memory(model: StepModel) -> Work:
    """Memory to solve a programme in."""
    from pareto_ltl.kernels.step_solver import Work

    cones, T = len(model.cone), len(model.behind)
    return Work(
        np.zeros((3, T + 1, 3)), np.zeros((9, cones, 3)), np.zeros((7, len(model.line))), np.empty(cones),
        np.empty((T + 1, 3)), np.empty((T, 2, 2)),
    )  # fmt: skip


def headings(flight: Flight) -> FloatArray:
    """Directions (T, 2) of the controls; east for a control of 0."""
    speed = np.linalg.norm(flight.u, axis=1)[:, None]
    return np.where(speed > 0.0, flight.u / np.maximum(speed, 1e-9), [1.0, 0.0])


def least_speeds(problem: Problem, flight: Flight) -> FloatArray:
    """Least airspeed to plan with (T,), as a share of the largest one.

    It is u_min with reserves, divided by ``CAP``, so that rounding leaves a margin. It is at most
    ``NARROWEST`` of the largest airspeed, so that a robot with u_min close to u_max keeps a choice: its
    controls are scaled into their limits afterwards.
    """
    least, most = airspeed_limits(problem, flight.speed)
    return np.asarray(np.minimum(least / CAP, NARROWEST * CAP * most) / problem.motion.u_max)


def motion_values(problem: Problem, flight: Flight, size: int) -> dict[str, FloatArray]:
    """F_t, g_t and the airspeed left, padded to ``size`` steps; added steps stay in place in still air."""
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
    B⁻¹ g_t of ``g`` (S, 2); steps after the path are not constrained.
    """
    motion, T = problem.motion, len(flight.u)
    heading = np.zeros_like(g)
    heading[:T] = headings(flight)
    floor = np.full(len(g), -1.0)
    floor[:T] = least_speeds(problem, flight)
    return {
        "ahead": heading @ motion.b_inv,
        "behind": np.einsum("ti,tij->tj", heading, F.reshape(-1, 2, 2)),
        "floor": floor + (heading * g).sum(axis=1),
    }
