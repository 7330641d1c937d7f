"""Plan a tiny mission with every combination of models, and compare each vertex's costs with its path's.

Run uncompiled by ``planning/test_choices.py``, because each combination would compile for half a minute:

    NUMBA_DISABLE_JIT=1 python tests/choices.py
"""

from __future__ import annotations

import sys
from itertools import product

import numpy as np
from numpy.random import SeedSequence

from oracle import path_risk as risk
from pareto_ltl.kernels import collision_risk as kernel
from pareto_ltl.kernels.bounds import Ordered, PathBound
from pareto_ltl.kernels.path_collision import REFLECT, GaussianPath, collision_bound
from pareto_ltl.planning.evaluate import collision_memory, evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest, mission_columns
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Tree
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig
from pareto_ltl.settings.fidelity import COLLISION_BOUNDS, LAWS, MISSION_BOUNDS, PARENT_RULES
from pareto_ltl.support.arrays import FloatArray
from problems import box, make_problem, make_scene, smooth_wind

CHOICES = list(product(LAWS, MISSION_BOUNDS, COLLISION_BOUNDS, PARENT_RULES))
# Models of both presets. Tests that need such a combination compiled take this one, so that it compiles once.
COMPILED = ("coherent", "ordered", "step", "mixed")
SCENE = make_scene(
    {"a": box(4, 2, 7, 5), "b": box(2, 6, 5, 9)}, [box(1, 4, 3.5, 5.5)], start=(2.0, 3.0), side=10
)
PLANNER = PlannerConfig(trees=2, n_max=40, near=6, epsilon=0.3, delta=0.9, threads=1)


def tiny_problem(law: str, mission_bound: str, collision_bound: str, parents: str) -> Problem:
    """Two regions beside one obstacle, with the given models."""
    models = FidelityConfig(
        name="full", law=law, mission_bound=mission_bound, collision_bound=collision_bound, parents=parents
    )
    wind = smooth_wind(SCENE, speed=2.0, sd=0.5, gust=0.3)
    robot = RobotConfig(dt=100.0, u_max=10.0, start_sd=200.0)
    return make_problem("F(a & F b)", SCENE, wind, robot, PLANNER, fidelity=models)


def check_choice(problem: Problem) -> str:
    """Grow a forest and check all its vertices; return a text of what was checked."""
    forest = grow_forest(PLANNER, problem, SeedSequence(3))
    for tree in forest.trees:
        for v in range(len(tree)):
            check_vertex(problem, tree, v)
    columns = mission_columns(problem)
    risk_rows = np.vstack([tree.risk for tree in forest.trees])
    mission = risk_rows[:, :columns].sum(axis=1)
    assert np.any((mission > 1e-6) & (mission < 1.0))  # otherwise this tests nothing
    assert columns == risk_rows.shape[1] or np.any(risk_rows[:, -1] > 1e-4)
    swaps = sum(tree.reach["reselected"] for tree in forest.trees)
    assert swaps > 0
    return f"{len(risk_rows)} vertices, {swaps:.0f} exchanges, {len(forest.accepted)} accepted"


def check_vertex(problem: Problem, tree: Tree, v: int) -> None:
    """Length, automaton state, mission and collision columns of one vertex."""
    path = evaluate_path(problem, tree.path(v), "", tight=False)
    assert path.q[-1] == tree.q[v]
    np.testing.assert_allclose(path.objectives.length, tree.length[v], rtol=1e-9)
    columns = mission_columns(problem)
    mission = min(1.0, tree.risk[v, :columns].sum())
    if isinstance(problem.world.mission, Ordered):
        expected = ordered_at_state(problem, path.x, path.cov, int(tree.q[v]))
        if problem.automaton.accepting[tree.q[v]]:
            np.testing.assert_allclose(mission, path.objectives.mission_risk, rtol=1e-6, atol=1e-9)
    else:
        expected = path.objectives.mission_risk
    np.testing.assert_allclose(mission, expected, rtol=1e-6, atol=1e-9)
    assert tree.risk.shape[1] == columns + isinstance(problem.world.collision, PathBound)
    if isinstance(problem.world.collision, PathBound):
        check_collision(problem, path.x, tree.risk[v, -1])


def check_collision(problem: Problem, x: FloatArray, column: float) -> None:
    """The column is the greedy sum over steps, and never below R under the reflection principle."""
    bound, flight = problem.world.collision, propagate(problem, x)
    memory = collision_memory(bound, 2)
    before, added = None, 0.0
    for t in range(len(x)):
        here, far = gaussian(x[t], flight.cov[t]), kernel.FAR_DEVIATIONS
        leg = kernel.leg_between(before, here, far) if before else kernel.leg_of_start(here, far)
        at_step, more = kernel.pass_obstacles(bound, leg, memory, (t + 1) % 2, memory, t % 2)
        assert at_step <= problem.epsilon
        before, added = here, added + more
    np.testing.assert_allclose(column, added, rtol=1e-5, atol=1e-8)
    trusted = GaussianPath(flight.x, flight.cov, np.empty((0, 0, 2, 2)), REFLECT)
    assert collision_bound(bound.barriers, bound.nearby, trusted) <= column * (1 + 1e-5) + 1e-5


def gaussian(x: FloatArray, cov: FloatArray) -> kernel.Gaussian:
    """One position in the form that kernels take."""
    from pareto_ltl.kernels.data import Cov, Point

    return kernel.Gaussian(Point(*x.tolist()), Cov(*cov.tolist()))


def ordered_at_state(problem: Problem, x: FloatArray, cov: FloatArray, q: int) -> float:
    """V(q) after the last letter, by the recursion in plain NumPy."""
    logic = problem.reading(0)
    column, P = risk.label_probabilities(problem, x, cov)
    spoils = ~logic.covers[logic.delta[:, column]]
    V = np.where(logic.covers[logic.initial], 0.0, 1.0)
    for seen in P:
        V = np.minimum(1.0, (V[:, None] + np.einsum("qsp,s->qp", spoils, seen)).min(axis=0))
    return float(V[q])


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
