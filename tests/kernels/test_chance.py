"""The penalty of segments that break epsilon: against plain NumPy, and its derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import norm

from pareto_ltl.kernels.chance import DEEP, RESERVE, add_breach, deviations_for, risk_beyond
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.separation import Separation, chance_along, excess, separation
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.arrays import FloatArray
from plane_logic.margin import Slope
from problems import along, box, make_problem, make_scene, smooth_wind

SCENE = make_scene({"a": box(15, 8, 19, 12)}, [box(7, 0, 9, 9.5), box(11, 10.5, 13, 20)], start=(2, 10))
STIFF = 2.0
ROBOT = RobotConfig(dt=100.0, u_max=10.0, start_sd=150.0)
WAY = along((2, 10), (9, 9.9), (11, 10), (16, 10), step=0.6)


def problem_with(epsilon: float | None, formula: str = "F a"):
    return make_problem(
        formula, SCENE, smooth_wind(SCENE, speed=1.0, sd=0.6), ROBOT,
        PlannerConfig(epsilon=epsilon), fidelity="full",
    )  # fmt: skip


def empty_slope() -> Slope:
    return Slope(np.zeros((len(WAY), 2)), np.zeros((len(WAY), 3)))


@pytest.mark.parametrize("risk", [0.3, 0.05, 1e-2, 2.5e-3])
def test_a_quantile_is_that_of_the_normal_law(risk: float) -> None:
    assert deviations_for(risk) == pytest.approx(-ndtri(risk), abs=1e-3)
    assert risk_beyond(deviations_for(risk)) == pytest.approx(risk, rel=5e-3)


def test_deep_inside_an_obstacle_a_risk_falls_on_the_way_out() -> None:
    z = np.linspace(-8.0, 3.0, 400)
    risks = np.array([risk_beyond(one) for one in z])
    assert (np.diff(risks) < 0.0).all()
    wanted = np.array([deviations_for(one) for one in risks])
    assert (np.diff(wanted) > 0.0).all()
    np.testing.assert_allclose(np.diff(wanted)[z[1:] > 0.2], np.diff(z)[z[1:] > 0.2], rtol=0.02)


def quantile(risk: FloatArray) -> FloatArray:
    """Q⁻¹, continued by its tangent above DEEP."""
    exact = -ndtri(np.clip(risk, 1e-12, DEEP))
    return exact - np.maximum(risk - DEEP, 0.0) / norm.pdf(-ndtri(DEEP))


def plainly(part: Separation, x: FloatArray, epsilon: float) -> float:
    """The penalty of means ``x`` with the lines of ``part``, and what other lines add where it was made."""
    total, wanted = 0.0, quantile(np.array(epsilon)) + RESERVE
    for t in np.flatnonzero(2.0 * part.risk >= epsilon):
        rows = np.flatnonzero(part.owner[t] >= 0)
        z = (x[t : t + 2] @ part.normal[t, rows].T - part.offset[t, rows]) / part.sd[t][:, rows]
        beyond = np.where(z >= 0.0, ndtr(-z), 0.5 - z / math.sqrt(2.0 * math.pi))
        lacking = wanted - quantile(part.elsewhere[t] + beyond.sum(axis=1))
        total += 0.5 * STIFF * float((np.maximum(lacking, 0.0) ** 2).sum())
    return total


@pytest.mark.parametrize("epsilon", [0.02, 0.2])
def test_the_penalty_is_the_square_of_what_the_ends_lack(epsilon: float) -> None:
    problem = problem_with(epsilon)
    flight, slope = propagate(problem, WAY), empty_slope()
    value = add_breach(chance_along(problem, flight, STIFF), flight, slope)
    assert value > 0.0
    assert excess(problem, flight).max() > 0.0
    part = separation(problem, flight)
    assert value == pytest.approx(plainly(part, flight.x, epsilon), rel=1e-3)
    h = 0.5  # [m]
    slopes = [
        (plainly(part, flight.x + h * way, epsilon) - plainly(part, flight.x - h * way, epsilon)) / (2.0 * h)
        for way in np.eye(2 * len(WAY)).reshape(-1, *WAY.shape)
    ]
    np.testing.assert_allclose(slope.gradient.ravel(), slopes, rtol=5e-3, atol=1e-8)
    blocks = slope.hessian[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    assert np.linalg.eigvalsh(blocks).min() > -1e-15


@pytest.mark.parametrize("epsilon", [None, 0.999])
def test_a_path_that_keeps_epsilon_has_no_penalty(epsilon: float | None) -> None:
    problem = problem_with(epsilon)
    far = along((2, 10), (10, 10), (16, 10), step=0.6) if epsilon else WAY
    flight = propagate(problem, far)
    slope = Slope(np.zeros((len(far), 2)), np.zeros((len(far), 3)))
    if epsilon is None:
        assert math.isinf(chance_along(problem, flight, STIFF).limit)
        assert add_breach(chance_along(problem, flight, STIFF), flight, slope) == 0.0
        assert not excess(problem, flight).any()
    else:
        assert not excess(problem, flight).any()
        assert not slope.gradient.any()


def test_forbidden_regions_count_as_obstacles() -> None:
    scene = make_scene({"a": box(15, 8, 19, 12), "c": box(8, 4, 10, 9.7)}, [], start=(2, 10))
    problem = make_problem(
        "!c U a", scene, smooth_wind(scene, speed=1.0, sd=0.6), ROBOT,
        PlannerConfig(epsilon=0.02), fidelity="full",
    )  # fmt: skip
    flight, slope = propagate(problem, WAY), empty_slope()
    assert add_breach(chance_along(problem, flight, STIFF), flight, slope) > 0.0
    assert slope.gradient[:, 1].min() < 0.0  # northwards, away from the region
