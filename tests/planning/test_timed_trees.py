"""Trees with time windows and deadlines: plans that wait, hurry and go round."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from oracle.segments import states_of_flight
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.windows import Window
from plane_logic.letters import states_along
from problems import box, make_problem, make_scene, steady_wind

DT = 100.0  # [s] a step of the test robot, which flies 1 km in it


def first_visit(problem: Problem, x: FloatArray) -> float:
    """When the mission is complete [s]."""
    q = states_along(problem.cells, problem.logic, x)
    return DT * float(np.flatnonzero(problem.logic.distance[q] == 0.0)[0])


def grown(
    formula: str, windows: dict[str, Window], forbidden: tuple[str, ...] = (), **regions: FloatArray
) -> Problem:
    scene = make_scene(regions or {"a": box(12, 8, 16, 12)}, start=(4.0, 10.0))
    scene = replace(scene, windows=windows, forbidden=forbidden)
    return make_problem(formula, scene, steady_wind(scene, gust=(0.3, 0.3)), fidelity="full")


def paths_of(problem: Problem) -> list[FloatArray]:
    forest = grow_forest(PlannerConfig(trees=2, n_max=600), problem, SeedSequence(4))
    return [forest.trees[j].path(v) for j, v in forest.accepted]


@pytest.mark.no_cover  # coverage slows the compiler down, and other tests run the same lines
def test_trees_wait_for_a_region_that_opens_later() -> None:
    problem = grown("F a", {"a": Window("a", 30 * DT, math.inf)})
    found = paths_of(problem)
    assert found
    assert all(30 * DT <= first_visit(problem, x) <= 45 * DT for x in found)


def test_trees_wait_in_front_of_a_wall_until_it_is_gone() -> None:
    wall = {"a": box(12, 8, 16, 12), "w": box(8, -1, 9, 21)}
    problem = grown("F a", {"w": Window("w", -math.inf, 20 * DT)}, ("w",), **wall)
    found = paths_of(problem)
    assert found
    assert all(first_visit(problem, x) >= 20 * DT for x in found)


def test_trees_go_round_an_obstacle_while_it_stands() -> None:
    regions = {"a": box(12, 8, 16, 12), "w": box(8, 7, 9, 13)}
    problem = grown("F a", {"w": Window("w", -math.inf, math.inf)}, ("w",), **regions)
    found = paths_of(problem)
    assert found
    for x in found:
        assert np.isfinite(problem.logic.distance[states_of_flight(problem, x)]).all()


def test_no_vertex_is_grown_that_a_deadline_has_passed() -> None:
    problem = grown("F[0,700s] a", {})
    assert all(first_visit(problem, x) <= 7 * DT for x in paths_of(problem))
    late = grown("F[0,600s] a", {})  # 8 km away: 8 steps
    forest = grow_forest(PlannerConfig(trees=1, n_max=300), late, SeedSequence(4))
    assert len(forest.accepted) == 0
    assert forest.trees[0].step.max() < 7
