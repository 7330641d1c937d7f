"""Growth and smoothing with ``fidelity=full``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.kernels.path_collision import REFLECT, GaussianPath, collision_bound
from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.growth import GrowthOptions
from pareto_ltl.planning.records import objective_row
from pareto_ltl.planning.refine import smooth_paths
from pareto_ltl.planning.routes.obligations import possible_orders
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig, SmoothingConfig
from pareto_ltl.support.errors import ConfigError
from problems import box, make_problem, make_scene, smooth_wind, three_columns

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
    return growth.grow_forest(PLANNER, task, SeedSequence(1), options=GrowthOptions(record_swaps=True))


@pytest.fixture(scope="module")
def front(task, forest):
    raw = selection.tree_front(task, forest)
    begun = (*raw, *selection.order_representatives(task, forest))
    return selection.build_front(smooth_paths(SmoothingConfig(), task, begun), raw)


# --- growth ---------------------------------------------------------------------------------------


def test_every_vertex_costs_what_the_exact_evaluation_says(task, forest):
    """V agrees. The R of growth takes faces greedily, and so is never below the cheapest division into runs;
    it trusts the reflection, which the exact evaluation looks into."""
    unasked = np.empty((0, 0, 2, 2))
    whole = with_delta(task, 10.0)
    rng = np.random.default_rng(0)
    for tree in forest.trees:
        for v in rng.choice(len(tree), 25, replace=False):
            path = evaluate_path(whole, tree.path(int(v)), "")
            assert path.q[-1] == tree.q[v]
            assert path.objectives.length == pytest.approx(tree.length[v], rel=1e-9)
            flown = GaussianPath(path.x, three_columns(path.cov), unasked, REFLECT)
            least = collision_bound(task.barriers, task.world.collision.nearby, flown)
            assert least <= tree.risk[v, 1] * (1 + 1e-5) + 1e-5
            if task.automaton.accepting[path.q[-1]]:
                assert path.objectives.mission_risk == pytest.approx(tree.risk[v, 0], abs=1e-6)


def with_delta(problem, delta):
    """The same problem with another planner.delta."""
    return replace(
        problem,
        world=problem.world._replace(collision=problem.world.collision._replace(delta=delta)),
    )


def test_finished_paths_keep_to_delta(task, forest, front):
    assert all(path.objectives.collision_risk <= task.world.collision.delta for path in front.paths)
    for tree in forest.trees:
        assert np.all((tree.risk[:, 0] >= 0.0) & (tree.risk[:, 0] <= 1.0))


def test_the_first_tree_only_takes_parents_that_are_no_worse_in_any_objective(forest):
    swaps = forest.trees[0].swaps
    assert len(swaps) > 10
    before, after = swaps[:, 0], swaps[:, 1]
    same = before[:, 0] == after[:, 0]
    assert np.all(after[:, 0] <= before[:, 0])
    assert np.all(after[same, 1] <= before[same, 1] * (1 + 1e-9))
    assert np.all(after[same, 2:] <= before[same, 2:] + 3e-6)


def test_half_of_the_trees_choose_by_a_tchebycheff_score(task):
    def scored(parents, number):
        rng = np.random.default_rng(number)
        rule = growth.RULE_MAKERS[parents](PLANNER, task, number, rng)
        assert rule.weight.sum() == pytest.approx(1.0)
        assert rule.scored == bool(np.ptp(rule.weight) > 0.0)  # the others rank parents by equal weights
        return rule.scored

    assert [scored("mixed", j) for j in range(4)] == [False, True, False, True]
    assert scored("tchebycheff", 0)
    assert not scored("scaled", 1)
    with pytest.raises(ConfigError, match=r"fidelity\.parents"):
        FidelityConfig(parents="best")


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
