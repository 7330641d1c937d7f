"""Plan a tiny mission with every combination of models; its trees have the costs of the paper's models.

Run uncompiled by ``planning/test_choices.py``, because combinations would compile for half a minute:

    NUMBA_DISABLE_JIT=1 python tests/choices.py
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels.data import World
from pareto_ltl.kernels.motion import airspeed
from pareto_ltl.planning.evaluate import completes_mission, evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Tree
from pareto_ltl.planning.selection import order_representatives, tree_front
from pareto_ltl.planning.tree_models import tree_models
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig
from pareto_ltl.settings.fidelity import COLLISION_BOUNDS, JUDGES, LAWS, MISSION_BOUNDS
from problems import box, make_problem, make_scene, smooth_wind

CHOICES = list(product(LAWS, MISSION_BOUNDS, COLLISION_BOUNDS, JUDGES))
SCENE = make_scene(
    {"a": box(4, 2, 7, 5), "b": box(2, 6, 5, 9)}, [box(1, 4, 3.5, 5.5)], start=(2.0, 3.0), side=10
)
PLANNER = PlannerConfig(trees=2, n_max=60, near=6, epsilon=0.3, delta=0.9, threads=1)


def tiny_problem(law: str, mission_bound: str, collision_bound: str, judge: str) -> Problem:
    """Two regions beside one obstacle, with the given models."""
    models = FidelityConfig(
        name="full", law=law, mission_bound=mission_bound, collision_bound=collision_bound, judge=judge
    )
    wind = smooth_wind(SCENE, speed=2.0, sd=0.5, gust=0.3)
    robot = RobotConfig(dt=100.0, u_max=10.0, start_sd=200.0)
    return make_problem("F(a & F b)", SCENE, wind, robot, PLANNER, fidelity=models)


def check_choice(problem: Problem) -> str:
    """Grow a forest, check all its vertices and that its paths serve the plan; a text of what was checked."""
    forest = grow_forest(PLANNER, problem, SeedSequence(3))
    published = replace(problem, world=World(*tree_models(problem)))
    for tree in forest.trees:
        for v in range(len(tree)):
            check_vertex(published, tree, v)
    mission = np.concatenate([tree.risk.sum(axis=1) for tree in forest.trees])
    assert np.any((mission > 1e-6) & (mission < 1.0))  # otherwise this tests nothing
    swaps = sum(tree.reach["reselected"] for tree in forest.trees)
    assert swaps > 0
    assert len(forest.accepted) > 0
    check_paths(problem, [forest.trees[j].path(v) for j, v in forest.accepted.tolist()])
    begun = order_representatives(problem, forest)
    assert begun
    assert all(completes_mission(problem, path) for path in begun)
    paths = tree_front(problem, forest)
    assert paths
    return f"{len(mission)} vertices, {swaps:.0f} exchanges, {len(paths)} of {len(forest.accepted)} accepted"


def check_vertex(published: Problem, tree: Tree, v: int) -> None:
    """Length, automaton state and risks of one vertex, which keeps the limits of the trees' own models."""
    path = evaluate_path(published, tree.path(v), "", tight=False)
    assert path.q[-1] == tree.q[v]
    np.testing.assert_allclose(path.objectives.length, tree.length[v], rtol=1e-9)
    mission = min(1.0, tree.risk[v].sum())
    np.testing.assert_allclose(mission, path.objectives.mission_risk, rtol=1e-6, atol=1e-9)


def check_paths(problem: Problem, paths: list[np.ndarray]) -> None:
    """The robot can fly the paths in the wind law of the plan, whose mean shift trees do not compute."""
    for x in paths:
        flight, motion = propagate(problem, x), problem.motion
        flown = [airspeed(motion, *(x[t + 1] - flight.free[t])) for t in range(len(x) - 1)]
        assert np.all(np.array(flown) <= flight.speed * (1 + 1e-6))


def main() -> None:
    """Check the choices given as words, or all; end with 1 and the names of those that failed."""
    failed = 0
    for choice in [tuple(words.split()) for words in sys.argv[1:]] or CHOICES:
        try:
            print("ok", *choice, check_choice(tiny_problem(*choice)), flush=True)
        except AssertionError as error:
            failed += 1
            print("FAILED", *choice, error, flush=True)
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
