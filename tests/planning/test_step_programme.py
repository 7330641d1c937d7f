"""The cone programme of a step of the refinement, against a plain statement that cvxpy solves itself."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from numpy.random import SeedSequence

from levels import AT_NIGHT
from pareto_ltl.extend import draw_flights
from pareto_ltl.kernels.chance import add_breach
from pareto_ltl.kernels.descent import OVERLONG, RIDGE, Sample, Solves
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.convex.programme import Descent
from pareto_ltl.planning.evaluate import propagate, propagate_controls
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.sampled import ConstrainedRefiner, Refiner
from pareto_ltl.planning.routes.taut_lines import CAP, FACE_MARGIN
from pareto_ltl.planning.separation import chance_along
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.arrays import FloatArray
from plane_logic.margin import Slope
from problems import along, box, make_problem, make_scene, smooth_wind, steady_wind
from solves import next_means

SCENE = make_scene({"a": box(14, 8, 18, 12), "b": box(8, 15, 12, 19)}, [box(7, 8, 9, 12)], start=(2, 10))
BENT = {"a": [[1.0, 0.002], [-0.001, 0.999]], "b": [[0.9, 0.2], [-0.1, 1.1]]}
ROBOTS = {
    "still air": (RobotConfig(dt=100.0, u_max=10.0), steady_wind(SCENE)),
    "coherent wind": (RobotConfig(dt=100.0, u_max=10.0), smooth_wind(SCENE)),
    "feedback": (
        RobotConfig(dt=100.0, u_max=10.0, feedback_time=900.0, start_sd=100.0),
        smooth_wind(SCENE, speed=2.0, sd=0.5),
    ),
    "matrices": (RobotConfig(dt=100.0, u_max=10.0, **BENT), smooth_wind(SCENE)),
    "least airspeed": (RobotConfig(dt=100.0, u_max=10.0, u_min=3.0, **BENT), smooth_wind(SCENE)),
}
STIFF = 2.0
WAY = along((2, 10), (8, 6.2), (14, 8), (15, 11), step=0.6)  # 29 steps
TRUST, LONGEST = 0.7, 15_500.0


@pytest.fixture(scope="module", params=ROBOTS)
def problem(request) -> Problem:
    robot, wind = ROBOTS[request.param]
    return make_problem("F(a & F b)", SCENE, wind, robot, fidelity="full")


def descent_at(flight: Flight, seed: int) -> Descent:
    """Slopes and curvatures as of some tens of flights whose binding events pull in any direction."""
    rng, n = np.random.default_rng(seed), len(flight.x)
    normal = rng.standard_normal((40, 2))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    steps = rng.integers(1, n, 40)
    gradient, hessian = np.zeros((n, 2)), np.tile([2e-8, 0.0, 2e-8], (n, 1))
    np.add.at(gradient, steps, -normal * 2e-5)
    outer = np.column_stack([normal[:, 0] ** 2, normal[:, 0] * normal[:, 1], normal[:, 1] ** 2])
    np.add.at(hessian, steps, 2e-8 * outer)
    return Descent(gradient, hessian, 0.2)


def plainly(problem: Problem, flight: Flight, descent: Descent, trust: float, longest: float) -> FloatArray:
    """The programme in metres and with whole matrices, as its docstring states it."""
    motion, x, steps = problem.motion, flight.x, len(flight.u)
    wind, slope = wind_and_gradient(problem.wind, x[:-1])
    X, size = cp.Variable(x.shape), problem.reach
    change = X - x
    cost = [cp.sum(cp.multiply(descent.gradient, change)) / descent.value]
    for t in range(steps + 1):
        xx, xy, yy = descent.hessian[t] / descent.value
        H = np.array([[xx, xy], [xy, yy]]) + RIDGE / size**2 * np.eye(2)
        cost.append(0.5 * cp.quad_form(change[t] / size, H * size**2))
    held = [X[0] == x[0], cp.abs(change) <= trust * size]
    for t in range(steps):
        blown = motion.a @ X[t] + motion.dt * (wind[t] + flight.shift[t] + slope[t] @ change[t])
        control = motion.b_inv @ (X[t + 1] - blown) / motion.dt
        held.append(cp.norm(control) <= CAP * flight.speed[t])
        if motion.u_min > 0.0:
            held.append(flight.u[t] / np.linalg.norm(flight.u[t]) @ control >= motion.u_min / CAP)
    low, high = problem.scene.bounds
    held += [low[None] + FACE_MARGIN <= X, high[None] - FACE_MARGIN >= X]
    held.append(sum(cp.norm(X[t + 1] - X[t]) for t in range(steps)) <= longest)
    stated = cp.Problem(cp.Minimize(sum(cost)), held)
    stated.solve(solver=cp.CLARABEL)
    assert stated.status == cp.OPTIMAL
    return np.asarray(X.value)


def model_value(problem: Problem, flight: Flight, descent: Descent, y: FloatArray) -> float:
    """What the step is expected to gain, as a share of the failure."""
    d = y - flight.x
    xx, xy, yy = descent.hessian.T
    bend = xx * d[:, 0] ** 2 + 2 * xy * d[:, 0] * d[:, 1] + yy * d[:, 1] ** 2
    bend += descent.value * RIDGE / problem.reach**2 * (d**2).sum(axis=1)
    return float(((descent.gradient * d).sum() + 0.5 * bend.sum()) / descent.value)


def path_length(x: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())


def linear_controls(problem: Problem, flight: Flight, y: FloatArray) -> FloatArray:
    """Airspeed that each step of ``y`` asks for, in the wind linearised about ``flight``, (T,) [m/s]."""
    motion = problem.motion
    wind, slope = wind_and_gradient(problem.wind, flight.x[:-1])
    blown = wind + flight.shift + np.einsum("tij,tj->ti", slope, (y - flight.x)[:-1])
    control = (y[1:] - y[:-1] @ motion.a.T - motion.dt * blown) @ motion.b_inv.T / motion.dt
    return np.asarray(control)


# --- one programme, two roads ---------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "longest"), [(0, LONGEST), (1, LONGEST), (2, 25_000.0)])
def test_the_solved_step_is_that_of_the_plain_statement(problem: Problem, seed: int, longest: float) -> None:
    flight = propagate(problem, WAY)
    descent = descent_at(flight, seed)
    found = next_means(problem, flight, descent, TRUST, longest)
    expected = plainly(problem, flight, descent, TRUST, longest)
    assert found is not None
    best, reached = (model_value(problem, flight, descent, y) for y in (expected, found))
    assert best < -0.05  # there is something to gain
    assert reached == pytest.approx(best, abs=1e-4)
    np.testing.assert_allclose(found, expected, atol=0.01 * problem.reach)


@pytest.mark.parametrize("seed", range(200 if AT_NIGHT else 16))
def test_a_step_that_keeps_away_from_lines_is_that_of_the_plain_statement(seed: int) -> None:
    """Any robot, path, epsilon, stiffness of its penalty, and length: 200 programmes at night."""
    rng = np.random.default_rng(seed)
    robot, wind = list(ROBOTS.values())[seed % len(ROBOTS)]
    planner = PlannerConfig(epsilon=float(rng.choice([0.3, 0.1, 0.02])))
    problem = make_problem("F(a & F b)", SCENE, wind, robot, planner, fidelity="full")
    bend = 45.0 * rng.standard_normal((len(WAY), 2)).cumsum(axis=0)
    flight = Refiner(problem, margin_model(problem)).flown(WAY + bend - bend[0])
    model = descent_at(flight, seed)
    chance = chance_along(problem, flight, float(rng.choice([2.0, 20.0])))
    breach = add_breach(chance, flight, Slope(model.gradient, model.hessian))
    model = replace(model, value=model.value + breach)
    longest = rng.uniform(0.99, 1.05) * path_length(flight.x)
    found = next_means(problem, flight, model, TRUST, longest)
    assert found is not None
    expected = plainly(problem, flight, model, TRUST, longest)
    best, reached = (model_value(problem, flight, model, y) for y in (expected, found))
    assert best < -0.01
    assert reached == pytest.approx(best, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_speeds_length_map_and_trust_region_hold(problem: Problem, seed: int) -> None:
    flight = propagate(problem, WAY)
    y = next_means(problem, flight, descent_at(flight, seed), TRUST, LONGEST)
    assert y is not None
    speed = np.linalg.norm(linear_controls(problem, flight, y), axis=1)
    assert (speed <= CAP * flight.speed + 1e-4 * problem.motion.u_max).all()
    assert (speed >= problem.motion.u_min / CAP - 1e-4 * problem.motion.u_max).all()
    assert path_length(y) <= LONGEST * (1.0 + 1e-5)
    assert path_length(y) > 0.99 * LONGEST  # the cap binds
    assert (np.abs(y - flight.x) <= (TRUST + 1e-4) * problem.reach).all()
    np.testing.assert_array_equal(y[0], flight.x[0])
    assert (np.abs(y - flight.x).max() > 0.5 * TRUST * problem.reach).all()


def test_a_map_border_beside_the_path_holds(problem: Problem) -> None:
    flight = propagate(problem, along((2, 10), (6, 0.4), (12, 4), step=0.6))
    descent = descent_at(flight, 0)
    pulled = Descent(descent.gradient + np.array([0.0, 1e-3]), descent.hessian, descent.value)
    y = next_means(problem, flight, pulled, TRUST, 25_000.0)
    assert y is not None
    low, high = problem.scene.bounds
    assert (y >= low).all()
    assert (y <= high).all()
    assert y[:, 1].min() < 10.0


def test_a_length_that_no_path_can_have_gives_no_answer(problem: Problem) -> None:
    flight = propagate(problem, WAY)
    assert next_means(problem, flight, descent_at(flight, 0), TRUST, 5_000.0) is None
    assert next_means(problem, flight, descent_at(flight, 0), TRUST, LONGEST) is not None


def test_the_least_airspeed_binds() -> None:
    """Pulled back along its way, a path slows down to it and no further."""
    robot, wind = RobotConfig(dt=100.0, u_max=10.0, u_min=5.5), steady_wind(SCENE)
    problem = make_problem("F(a & F b)", SCENE, wind, robot, fidelity="full")
    flight = propagate(problem, WAY)
    pull = np.zeros_like(WAY)
    pull[1:] = WAY[1:] - WAY[:-1]
    descent = Descent(1e-4 * pull / np.linalg.norm(pull, axis=1).max(), descent_at(flight, 0).hessian, 0.2)
    y = next_means(problem, flight, descent, TRUST, 20_000.0)
    assert y is not None
    speed = np.linalg.norm(linear_controls(problem, flight, y), axis=1)
    assert speed.min() == pytest.approx(5.5 / CAP, rel=1e-3)


# --- all solves of one width ------------------------------------------------------------------------


class PlainRefiner(ConstrainedRefiner):
    """The decisions of a descent in Python, each programme as it is stated, without chance constraints."""

    def next_means(self, flight: Flight, here: Descent, trust: float, cap: float) -> FloatArray | None:
        return plainly(self.problem, flight, here, trust, cap)

    def penalty(self, flight: Flight, longest: float) -> float:
        return OVERLONG * max(0.0, path_length(flight.x) / longest - 1.0)


@pytest.mark.parametrize("robot", [name for name in ROBOTS if name != "still air"])
@pytest.mark.parametrize(("number", "rel"), [(1, 0.05), (4, 0.25)])
def test_a_descent_takes_the_plain_decisions(robot: str, number: int, rel: float) -> None:
    """Their gains are alike: programmes have flat directions, along which solutions of equal cost differ."""
    settings, wind = ROBOTS[robot]
    planner = PlannerConfig(epsilon=None)  # a penalty in one, a constraint in the other
    robot = replace(settings, start_sd=400.0)
    problem = make_problem("F a", SCENE, wind, robot, planner, fidelity="full")
    flights, width, longest = draw_flights(problem, "coherent", 120, SeedSequence(1)), 300.0, 15_800.0
    model = margin_model(problem)
    ends = []
    for refiner in (Refiner(problem, model), PlainRefiner(problem, model)):
        flight = refiner.flown(WAY)
        off = flights.deviations(flight)
        here, _ = refiner.slope(flight.x, off, width, 150)
        sample = Sample(off, width, 120 / 150, 0.0, here.value)
        solves = Solves(number, TRUST, longest, chance_along(problem, flight, STIFF))
        end = refiner.descended(flight, here, sample, solves)
        value = refiner.slope(end.x, off, width, 150)[0].value
        ends.append((end, value))
        assert value < 0.95 * here.value
    (fast, reached), (_, expected) = ends
    assert here.value - reached == pytest.approx(here.value - expected, rel=rel)
    again = propagate_controls(problem, fast.u, problem.world.law)
    np.testing.assert_allclose(fast.cov, again.cov, rtol=1e-6)
