"""Planning of full fidelity: growth, smoothing, ranking, acceptance, position fixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.kernels.path import collision_bound
from pareto_ltl.planning import growth, problem, selection
from pareto_ltl.planning import refine as smoothing
from pareto_ltl.planning.records import Front
from pareto_ltl.settings import (
    FidelityConfig,
    PlannerConfig,
    RobotConfig,
    SceneConfig,
    SelectionConfig,
    SmoothingConfig,
)
from pareto_ltl.simulation import acceptance
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world.scene_files import scene_from_dict as from_dict
from pareto_ltl.world.scene_files import scene_to_dict as to_dict
from pareto_ltl.world.scene_settings import scene_from_settings as read_scene
from problems import KM, box, make_problem, make_scene, smooth_wind

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
    return growth.forest(PLANNER, task, SeedSequence(1), record_swaps=True)


@pytest.fixture(scope="module")
def front(task, forest):
    raw = selection.tree_front(task, forest)
    smooth = smoothing.smooth(SmoothingConfig(), task, (*raw, *selection.orders(task, forest)))
    return selection.front(smooth, raw, full=True)


# --- growth ---------------------------------------------------------------------------------------


def test_every_vertex_costs_what_the_exact_evaluation_says(task, forest):
    """V agrees. The R of growth takes faces greedily, and so is never below the cheapest division into
    runs; it trusts the
    reflection, which the exact evaluation looks into."""
    trusted = np.zeros((100, 100, 2, 2))  # Cov(e_t, e_s) >= Var e_s everywhere
    whole = replace(task, tables=task.tables._replace(delta=10.0))
    rng = np.random.default_rng(0)
    for tree in forest.trees:
        for v in rng.choice(len(tree), 25, replace=False):
            path = problem.evaluate(whole, tree.path(int(v)), "")
            assert path.q[-1] == tree.q[v]
            assert path.objectives.length == pytest.approx(tree.length[v], rel=1e-9)
            three = np.ascontiguousarray(path.cov.reshape(-1, 4)[:, [0, 1, 3]])
            least = collision_bound(task.tables, path.x, three, trusted)
            assert least <= tree.risk[v, 1] * (1 + 1e-5) + 1e-5
            if task.automaton.accepting[path.q[-1]]:
                assert path.objectives.mission_risk == pytest.approx(tree.risk[v, 0], abs=1e-6)


def test_steps_keep_to_epsilon_and_paths_to_delta(task, forest):
    for tree in forest.trees:
        assert tree.risk[:, 1].max() <= task.tables.delta
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
    assert [growth.chooses("mixed", j) for j in range(4)] == [False, True, False, True]
    assert growth.chooses("tchebycheff", 0)
    with pytest.raises(ConfigError, match=r"fidelity\.parents"):
        FidelityConfig(parents="best")


def test_the_same_seed_gives_the_same_forest_whatever_the_threads(task, forest):
    again = growth.forest(replace(PLANNER, threads=1), task, SeedSequence(1))
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
    rows = np.array([selection.objective_row(p.objectives, full=True) for p in front.paths])
    for k, row in enumerate(rows):
        others = np.delete(rows, k, axis=0)
        assert not np.any(np.all(others <= row, axis=1) & np.any(others < row, axis=1))


def test_every_order_of_the_mission_is_offered_to_smoothing():
    wind = smooth_wind(SCENE, speed=1.0, sd=0.1, gust=0.1)
    p = make_problem("F a & F b", SCENE, wind, ROBOT, PLANNER, fidelity="full")
    orders = smoothing.possible_orders(p, 8)
    assert {order.labels for order in orders} == {
        (frozenset("a"), frozenset("b")), (frozenset("b"), frozenset("a")),
    }  # fmt: skip


def test_ranking_estimates_the_rate_of_linear_flights(task, front):
    """Against nonlinear flights: in a mild wind the two rates agree within their sampling error."""
    ranked = acceptance.ranked(task, front, 4000, SeedSequence(3))
    assert len(ranked.estimates) == len(front.paths)
    for path, estimate in list(zip(ranked.paths, ranked.estimates, strict=True))[:3]:
        flights = deployment.fly(task, path.u, 4000, "coherent", SeedSequence(4), path.x)
        rate = float((~flights.accepted | flights.collided).mean())
        error = np.sqrt(max(rate * (1 - rate), 1e-3) / 4000)
        assert abs(rate - estimate) < 8 * error + 0.1 * rate


def test_the_accepted_path_kept_its_promise_in_simulation(task, front):
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    ranked = acceptance.ranked(task, front, 500, SeedSequence(3))
    path, verdict = acceptance.accept(SelectionConfig(), task, wind, ranked, SeedSequence(5))
    assert path in ranked.paths
    assert verdict.passed
    assert verdict.low <= verdict.bound
    assert 0.0 < verdict.linearity < acceptance.LINEAR


def test_a_path_whose_bound_is_broken_is_passed_over(task, front, caplog):
    """The first choice is given a bound of nothing, as a broken formula would; the next one is flown."""
    wind = smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)
    first, second = front.paths[0], front.paths[-1]
    off = np.zeros_like(first.u)
    liar = replace(
        first, u=off, objectives=replace(first.objectives, mission_risk=0.0, collision_risk=0.0, length=0.0)
    )
    pair = Front((liar, second), (), 0.0, front.reference, full=True)
    path, verdict = acceptance.accept(SelectionConfig(runs=300), task, wind, pair, SeedSequence(5))
    assert path is second
    assert verdict.passed
    assert "its bound is" in caplog.text


def test_an_unreliable_linearisation_is_said(task, front, caplog):
    wind = smooth_wind(SCENE, length=1.0 * KM)
    acceptance.accept(SelectionConfig(runs=50), task, wind, front, SeedSequence(5))
    assert "length scale" in caplog.text


# --- position fixes ---------------------------------------------------------------------------------

MARKED = replace(make_scene({"a": box(13, 13, 19, 19)}, start=(2.0, 2.0)), landmarks=(box(4, 4, 12.5, 12.5),))
WAY = np.linspace([2.0, 2.0], [16.0, 16.0], 29) * KM


def marked(scene=MARKED, **robot):
    options = {"dt": 100.0, "u_max": 25.0, "start_sd": 300.0, "fix_sd": 50.0} | robot
    wind = smooth_wind(scene, speed=2.0, sd=0.7, gust=0.3, rho=0.9)
    return make_problem("F a", scene, wind, RobotConfig(**options), PLANNER, fidelity="full")


def test_a_landmark_collapses_what_is_unknown_and_lowers_the_risk():
    with_fix = problem.evaluate(marked(), WAY, "")
    without = problem.evaluate(marked(replace(MARKED, landmarks=())), WAY, "")
    assert len(with_fix.fixes) >= 1
    first = with_fix.fixes[0]
    np.testing.assert_allclose(with_fix.cov[: first + 1], without.cov[: first + 1], rtol=1e-5)
    assert np.trace(with_fix.cov[-1]) < 0.5 * np.trace(without.cov[-1])


@pytest.mark.statistical
def test_flights_with_fixes_spread_as_foreseen():
    """The robot of the simulation runs the estimator itself. The few flights that miss the landmark count
    as failed,
    and what is foreseen is how the others go on."""
    p = marked()
    path = problem.evaluate(p, WAY, "")
    flights = deployment.fly(p, path.u, 20_000, "coherent", SeedSequence(1), path.x)
    at_fix = flights.x[:, path.fixes[0]]
    found_it = np.all((at_fix >= 4.0 * KM) & (at_fix <= 12.5 * KM), axis=1)
    assert 0.97 < found_it.mean() < 1.0
    for t in (path.fixes[0], path.fixes[0] + 1, path.fixes[0] + 4, len(WAY) - 1):
        found = np.cov(flights.x[found_it, t].T)
        expected = path.cov[t]
        wide = np.sqrt(np.trace(expected))
        assert np.sqrt(np.trace(found)) == pytest.approx(wide, rel=0.1)
    failures = int((~flights.accepted).sum())
    assert failures / 20_000 - 5 * np.sqrt(failures + 1) / 20_000 <= path.objectives.mission_risk


def test_a_fix_that_may_well_be_missed_is_not_counted_on():
    small = replace(MARKED, landmarks=(box(8.9, 8.9, 9.1, 9.1),))
    assert problem.evaluate(marked(small, fix_risk=0.02), WAY, "").fixes == ()


def test_feedback_and_fixes_leave_less_airspeed_for_the_path():
    p = marked(fix_gain=0.5)
    steps = len(WAY) - 1
    room = smoothing.allowed(p, WAY)
    first = problem.evaluate(p, WAY, "").fixes[0]
    assert room.shape == (steps,)
    assert np.all(room[:first] == 1.0)
    assert room[first] < 1.0


def settings_of(**changes):
    base = {
        "bounds": [[0, 0], [20, 20]], "start": [2, 2], "obstacles": [],
        "regions": {"a": [[13, 13], [19, 13], [19, 19], [13, 19]]},
    }  # fmt: skip
    return SceneConfig(**(base | changes))


def test_landmarks_survive_the_way_through_scene_json():
    scene = read_scene(settings_of(landmarks=[[[5, 5], [8, 5], [8, 8]]]))
    assert len(scene.landmarks) == 1
    again = from_dict(to_dict(scene))
    np.testing.assert_array_equal(again.landmarks[0], scene.landmarks[0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"landmarks": [[[5, 5], [8, 5], [8, 8]]], "obstacles": [[[6, 4], [9, 4], [9, 9]]]},
            "landmark 1 overlaps obstacle 1",
        ),
        ({"landmarks": [[[5, 5], [9, 5], [6, 6], [5, 9]]]}, "landmark 1 is not convex"),
        ({"landmarks": [[[15, 15], [25, 15], [25, 25]]]}, "landmark 1"),
    ],
)
def test_a_landmark_that_no_robot_can_use_is_refused(changes, message):
    with pytest.raises(DataError, match=message):
        read_scene(settings_of(**changes))


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"feedback": 1.5}, "robot.feedback"), ({"fix_gain": -0.1}, "robot.fix_gain"),
        ({"effort_risk": 0.0}, "robot.effort_risk"), ({"fix_sd": 0.0}, "robot.fix_sd"),
    ],
)  # fmt: skip
def test_settings_of_feedback_and_fixes_are_checked(settings, key):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        RobotConfig(**settings)
