"""Growth and smoothing with ``fidelity=full``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.stats import norm

from pareto_ltl.kernels.data import World
from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.records import objective_row
from pareto_ltl.planning.routes.obligations import possible_orders
from pareto_ltl.planning.smoothing import smooth_paths
from pareto_ltl.planning.tree_models import LEFT, tree_models
from pareto_ltl.settings import PlannerConfig, RobotConfig, SmoothingConfig
from problems import box, make_problem, make_scene, smooth_wind

ROBOT = RobotConfig(dt=100.0, u_max=10.0)
PLANNER = PlannerConfig(trees=4, n_max=600)
SCENE = make_scene(
    {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)},
    [box(7, 0.5, 9, 6), box(10, 10, 14, 13)],
    start=(2.0, 3.0),
)


@pytest.fixture(scope="module")
def task():
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    return make_problem("F(a & F b)", SCENE, wind, ROBOT, PLANNER, fidelity="full")


@pytest.fixture(scope="module")
def forest(task):
    return growth.grow_forest(PLANNER, task, SeedSequence(1))


@pytest.fixture(scope="module")
def front(task, forest):
    raw = selection.tree_front(task, forest)
    begun = (*raw, *selection.order_representatives(task, forest))
    return selection.build_front(smooth_paths(SmoothingConfig(), task, begun), raw)


# --- growth ---------------------------------------------------------------------------------------


def test_every_vertex_costs_what_the_exact_evaluation_says_in_the_models_of_the_trees(task, forest):
    published = replace(task, world=World(*tree_models(task)))
    rng = np.random.default_rng(0)
    for tree in forest.trees:
        for v in rng.choice(len(tree), 25, replace=False):
            path = evaluate_path(published, tree.path(int(v)), "")
            assert path.q[-1] == tree.q[v]
            assert path.objectives.length == pytest.approx(tree.length[v], rel=1e-9)
            assert path.objectives.mission_risk_paper == pytest.approx(tree.risk[v].sum(), abs=1e-6)


def test_trees_leave_the_airspeed_that_the_mean_shift_takes(task, forest):
    """They grow in the mean wind; the robot can fly their paths under the law of the plan."""
    motion, own = task.motion, tree_models(task).law.motion
    assert own.u_max == pytest.approx((1.0 - LEFT) * motion.u_max)
    taken = 0.0
    for j, v in forest.accepted[:: len(forest.accepted) // 20].tolist():
        path = evaluate_path(task, forest.trees[j].path(v), "", tight=False)
        taken = max(taken, np.linalg.norm(path.u, axis=1).max())
    assert own.u_max < taken <= motion.u_max * (1 + 1e-6)  # without the share that they leave it is too fast


def test_a_robot_with_nearly_one_airspeed_leaves_a_part_of_what_it_has(task):
    robot = replace(ROBOT, u_min=9.9)
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    motion = tree_models(make_problem("F a", SCENE, wind, robot, PLANNER, fidelity="full")).law.motion
    assert 9.9 < motion.u_min < motion.u_max < 10.0


def test_finished_paths_keep_to_delta(task, front):
    assert all(path.objectives.collision_risk <= task.world.collision.delta for path in front.paths)


@pytest.mark.parametrize("gap", [0.05, 0.2, 2.0])
def test_trees_keep_eq_10_or_what_the_start_allows(gap):
    """At 2 km, the quantile of epsilon divided among two obstacles; nearer, the start's own distance."""
    scene = replace(SCENE, start=np.array([7000.0 - 1000.0 * gap, 3000.0]))
    robot = replace(ROBOT, start_sd=100.0)
    problem = make_problem("F(a & F b)", scene, robot=robot, planner=PLANNER, fidelity="full")
    z = tree_models(problem).collision.z
    assert z == pytest.approx(min(norm.isf(PLANNER.epsilon / 2), 10.0 * gap))
    grown = growth.grow_forest(replace(PLANNER, n_max=20), problem, SeedSequence(1))
    assert all(len(tree) > 1 for tree in grown.trees)


def test_without_a_limit_trees_only_keep_out_of_obstacles():
    planner = replace(PLANNER, epsilon=None)
    problem = make_problem("F(a & F b)", SCENE, robot=ROBOT, planner=planner, fidelity="full")
    assert tree_models(problem).collision.z == 0.0


def test_the_same_seed_gives_the_same_forest_whatever_the_threads(task, forest):
    again = growth.grow_forest(replace(PLANNER, threads=1), task, SeedSequence(1))
    for one, other in zip(forest.trees, again.trees, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(one.risk, other.risk)


# --- smoothing and selection ----------------------------------------------------------------------


def test_smoothing_lowers_the_risk_of_the_trees_paths(task, forest, front):
    raw = selection.tree_front(task, forest)
    least = min(p.objectives.mission_risk + p.objectives.collision_risk for p in raw)
    best = min(p.objectives.mission_risk + p.objectives.collision_risk for p in front.paths)
    assert best < 0.8 * least


def test_the_front_is_not_dominated_in_v_r_and_length(front):
    rows = np.array([objective_row(p.objectives) for p in front.paths])
    for k, row in enumerate(rows):
        others = np.delete(rows, k, axis=0)
        assert not np.any(np.all(others <= row, axis=1) & np.any(others < row, axis=1))


def test_every_order_of_the_mission_is_offered_to_smoothing():
    wind = smooth_wind(SCENE, speed=1.0, sd=0.1, gust=0.1)
    p = make_problem("F a & F b", SCENE, wind, ROBOT, PLANNER, fidelity="full")
    orders = possible_orders(p, 8)
    assert {order.labels for order in orders} == {
        (frozenset("a"), frozenset("b")), (frozenset("b"), frozenset("a")),
    }  # fmt: skip
