"""An autopilot that holds positions: the same flights as a robot with ``robot.feedback_time=60``."""

from __future__ import annotations

from dataclasses import replace

from numpy.random import SeedSequence

from exported_plans import Flown
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.pack import build_problem
from pareto_ltl_apps.exports.exported import held_course_rate


def test_the_rate_is_that_of_a_robot_with_feedback(flown: Flown) -> None:
    run, path = flown.result, flown.exported.plan.path
    settings = run.settings
    other = build_problem(
        replace(settings.robot, feedback_time=60.0),
        settings.planner, settings.wind, flown.result.scene,
        flown.result.wind, flown.result.cells, flown.result.automaton, settings.fidelity,
    )  # fmt: skip
    rate = held_course_rate(flown.problem, path, 600, SeedSequence(4))
    flights = simulate_flights(other, path.u, 600, "coherent", SeedSequence(4), path.x)
    assert rate.failures == int(flights.failed.sum())
    assert rate.law == "coherent"


def test_who_knows_where_he_is_fails_less_often(flown: Flown) -> None:
    path = flown.exported.plan.path
    blind = simulate_flights(flown.problem, path.u, 4000, "coherent", SeedSequence(4), path.x)
    assert held_course_rate(flown.problem, path, 4000, SeedSequence(4)).failures < blind.failed.sum()
