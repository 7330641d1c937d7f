"""Paths by their exact cost, and what controls promise under a wind law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coherent import STEPS, coherent_problem
from oracle import path_risk as risk
from pareto_ltl.extend import Forecast
from pareto_ltl.planning.evaluate import completes_mission, evaluate_path
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.errors import InfeasibleError
from problems import KM, box, make_problem, make_scene, rough_wind, two_goals


@pytest.fixture(scope="module")
def problem():
    return two_goals()


WAY = np.array([[2.0, 3.0], [2.5, 3.5], [3.0, 4.2]]) * KM


def test_an_evaluated_path_carries_its_cost(problem):
    path = evaluate_path(problem, WAY, "by hand")
    cov, u = risk.propagate_independent(problem, WAY)
    np.testing.assert_allclose(path.cov, cov, rtol=1e-9)
    np.testing.assert_allclose(path.u, u, rtol=1e-9)
    assert path.t.tolist() == [0.0, 100.0, 200.0]
    assert path.origin == "by hand"
    assert path.label == (frozenset(),) * 3
    assert path.objectives.length == pytest.approx(500 * np.sqrt(2) + np.hypot(500, 700))
    assert path.objectives.mission_risk_paper == 0.0  # nothing visited, nothing missed, says the paper
    assert path.objectives.mission_risk == 0.0  # which is what this problem judges by
    assert path.objectives.mission_risk_ordered == 1.0  # but the mission is not done
    assert not completes_mission(problem, path)


def test_a_start_in_the_goal_is_a_path_of_no_steps():
    problem = make_problem("F a", make_scene({"a": box(0, 0, 4, 4)}, start=(2, 2)))
    path = evaluate_path(problem, np.array([[2.0, 2.0]]) * KM, "stay")
    assert completes_mission(problem, path)
    assert path.u.shape == (0, 2)
    o = path.objectives
    assert (o.length, o.mission_risk, o.mission_risk_ordered, o.collision_risk) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("corner", "text"),
    [
        ((4.0, 6.0), r"needs more airspeed than robot\.u_max at step 3 of 3"),
        ((3.0, 4.2), None),
    ],
)
def test_a_path_that_cannot_be_flown_says_where(problem, corner, text):
    x = np.vstack([WAY, np.array(corner) * KM])
    if text is None:
        assert len(evaluate_path(problem, x, "").x) == 4
        return
    with pytest.raises(InfeasibleError, match=text):
        evaluate_path(problem, x, "")


def test_paths_off_the_map_or_too_near_an_obstacle_are_refused(problem):
    start = problem.scene.start
    off = np.vstack([start - np.array([0.0, 500.0 * i]) for i in range(8)])
    with pytest.raises(InfeasibleError, match="leaves the map or enters an obstacle at step 7 of 7"):
        evaluate_path(problem, off, "")
    near = np.vstack([start + np.array([490.0 * i, 0.0]) for i in range(11)])
    with pytest.raises(
        InfeasibleError, match=r"closer to an obstacle or a wall than planner\.epsilon allows at step \d+"
    ):
        evaluate_path(problem, near, "")
    brief = two_goals(wind=rough_wind(problem.scene, slots=2, hours=1 / 36))
    with pytest.raises(InfeasibleError, match="outlasts the wind data at step 3 of 4"):
        evaluate_path(brief, np.vstack([WAY, WAY[2:], WAY[2:]]), "")


# --- the coherent law -------------------------------------------------------------------------


def test_the_forecast_of_a_plan_is_the_plan():
    """Flying the controls forward gives back the means that they were made for."""
    p = coherent_problem()
    path = evaluate_path(p, STEPS, "by hand")
    seen = Forecast.of(p, path.u, "coherent")
    np.testing.assert_allclose(seen.x, STEPS, atol=0.1)
    np.testing.assert_allclose(seen.cov, path.cov, rtol=1e-4)
    assert seen.mission_risk == pytest.approx(path.objectives.mission_risk, abs=1e-6)
    assert seen.collision_risk == pytest.approx(path.objectives.collision_risk, rel=1e-3)


@pytest.mark.parametrize("dt", [50.0, 200.0])
def test_the_answer_hardly_depends_on_the_time_step(dt):
    """Of the coherent law; the independent one averages a shorter step's winds away."""

    def spread(step, law):
        p = coherent_problem(robot=RobotConfig(dt=step, u_max=60.0), hours=0.5)
        ratio = step / 100.0
        n = round((len(STEPS) - 1) / ratio)
        x = np.column_stack(
            [np.interp(np.linspace(0, 1, n + 1), np.linspace(0, 1, len(STEPS)), STEPS[:, i]) for i in (0, 1)]
        )
        u = evaluate_path(p, x, "").u
        return np.sqrt(np.trace(Forecast.of(p, u, law).cov[-1]))

    assert spread(dt, "coherent") == pytest.approx(spread(100.0, "coherent"), rel=0.06)
    assert abs(np.log(spread(dt, "independent") / spread(100.0, "independent"))) > 0.25


def test_a_path_above_delta_is_refused():
    scene = make_scene({"a": box(14, 14, 18, 18)}, [box(8.6, 3, 12, 9)], start=(2.0, 2.0))
    p = coherent_problem(scene, sd=2.0, planner=PlannerConfig(epsilon=0.999, delta=1e-9))
    bounded = replace(p, fidelity=replace(p.fidelity, judge="bound"))
    with pytest.raises(InfeasibleError, match=r"planner\.delta"):
        evaluate_path(bounded, STEPS, "")
    assert evaluate_path(p, STEPS, "").objectives.collision_risk > 1e-9  # where flights judge
