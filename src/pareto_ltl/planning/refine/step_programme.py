"""One step of the sampled refinement: a quadratic model of the failure within the limits of the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.kernels.descent import SLOWEST, Limits
from pareto_ltl.kernels.path import Flight
from pareto_ltl.kernels.step_solver import StepModel, Work
from pareto_ltl.planning.evaluate import airspeed_limits
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.course import FACE_MARGIN
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from pareto_ltl.support.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Descent:
    """Local model for a step: gradient (T+1, 2) [1/m], Hessian (T+1, 3) [1/m²] and value of the failure."""

    gradient: FloatArray
    hessian: FloatArray
    value: float


def path_limits(problem: Problem) -> Limits:
    """What holds for all paths of ``problem``: map, full step, airspeed, start."""
    low, high = problem.scene.bounds
    return Limits(low + FACE_MARGIN, high - FACE_MARGIN, problem.reach, CAP, problem.start_variance)


def step_model(problem: Problem, steps: int) -> StepModel:
    """Memory of the programme of a solve in ``steps`` steps; lengths in full steps, speeds as shares."""
    motion = problem.motion
    held = steps if motion.u_min > 0.0 else 0  # least airspeeds
    return StepModel(
        np.empty((steps + 1, 2)), np.empty((steps + 1, 3)), motion.b_inv, np.empty((steps, 2, 2)),
        np.empty((held, 2)), np.empty((2 * steps, 3)), np.empty(4 * steps + 1 + held),
    )  # fmt: skip


def step_memory(model: StepModel) -> Work:
    """Memory to solve a programme in."""
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
    ``SLOWEST`` of the largest airspeed, so that a robot with u_min close to u_max keeps a choice: its
    controls are scaled into their limits afterwards.
    """
    least, most = airspeed_limits(problem, flight.speed)
    return np.asarray(np.minimum(least / CAP, SLOWEST * CAP * most) / problem.motion.u_max)


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
