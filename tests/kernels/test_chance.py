"""The penalty of segments that break epsilon: against plain NumPy, and its derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from pareto_ltl.kernels.chance import LEAST_SHARE, RESERVE, STIFF, add_breach, deviations_for
from pareto_ltl.kernels.margin import Slope
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.refine.separation import Separation, chance_along, excess, separation
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.arrays import FloatArray
from problems import along, box, make_problem, make_scene, smooth_wind

SCENE = make_scene({"a": box(15, 8, 19, 12)}, [box(7, 0, 9, 9.5), box(11, 10.5, 13, 20)], start=(2, 10))
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
    assert deviations_for(0.7) == 0.0


def plainly(part: Separation, x: FloatArray, risk: FloatArray, nearer: FloatArray, epsilon: float) -> float:
    """The penalty of means ``x`` with the lines of ``part``; ``nearer`` (T, 2) is their z_tk."""
    total = 0.0
    for t, k in np.argwhere(part.owner >= 0):
        z = (x[t : t + 2] @ part.normal[t, k] - part.offset[t, k]) / part.sd[t, :, k]
        others = risk[t] - ndtr(-nearer[t, k])
        wanted = -ndtri(max(epsilon - others, LEAST_SHARE * epsilon)) + RESERVE
        total += 0.5 * STIFF * (np.maximum(wanted - z, 0.0) ** 2).sum()
    return total


@pytest.mark.parametrize("epsilon", [0.02, 0.2])
def test_the_penalty_is_the_square_of_what_the_ends_lack(epsilon: float) -> None:
    problem = problem_with(epsilon)
    flight, slope = propagate(problem, WAY), empty_slope()
    value = add_breach(chance_along(problem, flight), flight, slope)
    assert value > 0.0
    part = separation(problem, flight)
    ends = np.stack([flight.x[:-1], flight.x[1:]], axis=1)
    nearer = (((ends @ part.normal[:, 0, :, None])[..., 0] - part.offset[:, :1]) / part.sd[..., 0]).min(
        axis=1
    )

    def at(x: FloatArray) -> float:
        return plainly(part, x, part.risk, nearer, epsilon)

    assert value == pytest.approx(at(flight.x), rel=1e-3)
    assert excess(problem, flight).max() > 0.0
    moves, h = np.eye(2 * len(WAY)).reshape(-1, *WAY.shape), 0.5
    slopes = [(at(flight.x + h * move) - at(flight.x - h * move)) / (2.0 * h) for move in moves]
    np.testing.assert_allclose(slope.gradient.ravel(), slopes, rtol=2e-3, atol=1e-9)
    curves = [
        (at(flight.x + h * move) - 2.0 * at(flight.x) + at(flight.x - h * move)) / h**2 for move in moves
    ]
    np.testing.assert_allclose(slope.hessian[:, [0, 2]].ravel(), curves, rtol=2e-2, atol=1e-9)


@pytest.mark.parametrize("epsilon", [None, 0.999])
def test_a_path_that_keeps_epsilon_has_no_penalty(epsilon: float | None) -> None:
    problem = problem_with(epsilon)
    far = along((2, 10), (10, 10), (16, 10), step=0.6) if epsilon else WAY
    flight = propagate(problem, far)
    slope = Slope(np.zeros((len(far), 2)), np.zeros((len(far), 3)))
    if epsilon is None:
        assert math.isinf(chance_along(problem, flight).limit)
        assert add_breach(chance_along(problem, flight), flight, slope) == 0.0
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
    assert add_breach(chance_along(problem, flight), flight, slope) > 0.0
    assert slope.gradient[:, 1].min() < 0.0  # northwards, away from the region
