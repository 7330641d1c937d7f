"""Trees: every edge re-evaluated by the reference, and the theorems that the paper claims for them."""

from __future__ import annotations

import logging
import time
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.special import ndtr

from careful_io import machine
from oracle import path_risk as risk
from pareto_ltl.kernels.tree import ROUNDING
from pareto_ltl.planning import growth, no_path, shortest_mission
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.growth import GrowthOptions
from pareto_ltl.planning.selection import hypervolume, non_dominated
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from pareto_ltl_verify.gaussians import spread_along
from problems import (
    KM,
    box,
    leaves,
    make_problem,
    make_scene,
    paper_problem,
    polygon_faces,
    rough_wind,
    rows_to,
    steady_wind,
    two_goals,
)

SMALL = PlannerConfig(trees=2, n_max=220, threads=1)
TURNED = RobotConfig(
    dt=100.0, u_max=10.0, start_sd=50.0, a=[[1.0, 0.01], [-0.02, 0.99]], b=[[1, 0.3], [0, 1]]
)
ORDERED = "F(a & F(b & F a)) & (!b U a)"


STRICT = replace(SMALL, epsilon_strict=True)


def grown(problem, cfg=SMALL, seed=0, progress=None, **options):
    return growth.grow_forest(cfg, problem, SeedSequence(seed), progress, GrowthOptions(**options))


@pytest.fixture(scope="module")
def phi1():
    return paper_problem("phi1")


@pytest.fixture(scope="module")
def swapped(phi1):
    """A forest with its re-selections on record."""
    return grown(phi1, PlannerConfig(trees=4, n_max=1500), record_swaps=True)


def test_an_interrupt_ends_the_threads_that_grow_trees(monkeypatch):
    def interrupt(done, total):
        raise KeyboardInterrupt

    monkeypatch.setattr(growth.Grove, "grow", lambda *arguments: time.sleep(0.001))
    began = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        grown(two_goals(), replace(SMALL, max_seconds=60.0), progress=interrupt)
    assert time.perf_counter() - began < 60.0


def test_trees_that_do_not_fit_into_memory_are_refused_with_the_bytes_of_a_vertex(monkeypatch):
    monkeypatch.setattr(machine, "available_memory", lambda: 1e9)
    with pytest.raises(ConfigError, match=r"planner\.n_max=9000000 needs .* 2 trees \(\d+ bytes per vertex"):
        grown(two_goals(), replace(SMALL, n_max=9_000_000))


# --- every edge, by the formulas -----------------------------------------------------------------------


def walk_ways(problem, tree):
    """Every path from the root to a leaf with its reference covariances and controls."""
    for leaf in leaves(tree):
        rows = rows_to(tree, leaf)
        cov, u = risk.propagate_independent(problem, tree.x[rows])
        yield rows, tree.x[rows], cov, u


CASES = {
    "visits": two_goals,
    "matrices": lambda: two_goals(robot=TURNED),
    "until": lambda: two_goals(ORDERED),
    "strict": lambda: two_goals(planner=PlannerConfig(epsilon=1e-4)),
}


@pytest.mark.parametrize("case", CASES)
def test_every_edge_of_every_tree_is_what_the_reference_computes(case):
    problem = CASES[case]()
    forest = grown(problem, replace(SMALL, n_max=150))
    limit = problem.epsilon / (len(problem.obstacles.ptr) - 1) * (1 + 1e-6)
    u_max = problem.motion.u_max * ROUNDING * (1 + 1e-12)
    for tree in forest.trees:
        assert len(tree) == 150
        seen = np.zeros(len(tree), bool)
        for rows, x, cov, u in walk_ways(problem, tree):
            seen[rows] = True
            np.testing.assert_array_equal(tree.step[rows], np.arange(len(rows)))
            np.testing.assert_array_equal(tree.cell[rows], problem.locate(x))
            run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
            np.testing.assert_allclose(tree.length[rows], run, rtol=1e-12)
            assert np.all(np.linalg.norm(u, axis=1) <= u_max)
            check_states(problem, tree, rows)
            check_obstacles(problem, x, cov, limit)
            check_risks(problem, tree, rows, x, cov)
        assert seen.all()


def check_states(problem, tree, rows):
    q = problem.automaton.initial
    for row in rows:
        q = problem.automaton.step(q, problem.labels[tree.cell[row]])
        assert tree.q[row] == q


def check_obstacles(problem, x, cov, limit):
    """Eq. (9) by the bound (10), and one face of every obstacle for both ends of a step."""
    z = problem.world.collision.z
    for normals, offsets in polygon_faces(problem.obstacles):
        touch = [risk.inside_bound(normals, offsets, m, c) for m, c in zip(x, cov, strict=True)]
        assert max(touch) <= limit
        gap = x @ normals.T - offsets
        sd = np.array([spread_along(normals, c) for c in cov])
        clear = gap >= z * sd - 1e-6 * (1 + np.abs(gap))
        assert np.all((clear[1:] & clear[:-1]).any(axis=1))


def check_risks(problem, tree, rows, x, cov):
    """f_o^i of every vertex on the way: running minima over the visits so far."""
    cells = tree.cell[rows]
    for k in {len(rows) - 1, len(rows) // 2, len(rows) // 4}:
        expected = risk.theorem2_bound(problem, x[: k + 1], cov[: k + 1], cells[: k + 1])
        np.testing.assert_allclose(tree.risk[rows[k]], expected, rtol=1e-7, atol=1e-15)


def test_accepted_vertices_are_those_with_nothing_left_to_do():
    problem = two_goals()
    forest = grown(problem)
    found = {(int(j), int(v)) for j, v in forest.accepted}
    for j, tree in enumerate(forest.trees):
        for v in range(len(tree)):
            assert ((j, v) in found) == bool(problem.automaton.accepting[tree.q[v]])
    assert len(found) > 0
    for j, v in found:  # and nothing grows on them
        assert v not in forest.trees[j].parent


def test_no_vertex_lies_in_the_trap():
    problem = two_goals("!b U a")
    assert problem.automaton.trap >= 0
    forest = grown(problem)
    assert all(problem.automaton.trap not in tree.q for tree in forest.trees)
    assert sum(tree.reach["trapped"] for tree in forest.trees) > 0


# --- theorems ------------------------------------------------------------------------------------------


def front_of(problem, tree, n):
    """Non-dominated (f_o, length) among the accepted of the first ``n`` vertices."""
    done = np.flatnonzero(problem.automaton.distance[tree.q[:n]] == 0.0)
    rows = np.column_stack([tree.risk[done].sum(axis=1), tree.length[done]])
    return rows[non_dominated(rows)] if len(rows) else rows


def test_a_larger_tree_begins_with_the_smaller_one(phi1):
    """What Theorem 3 rests on: a vertex keeps its path for ever."""
    few, many = (grown(phi1, PlannerConfig(trees=2, n_max=n)) for n in (400, 1100))
    for small, large in zip(few.trees, many.trees, strict=True):
        for name in ("x", "parent", "step", "q", "cell", "length", "risk"):
            np.testing.assert_array_equal(getattr(small, name), getattr(large, name)[:400])


def test_the_front_never_worsens_as_vertices_are_added(phi1, swapped):
    """Theorem 3: hypervolume grows, and every old front point is weakly dominated by the new front."""
    reference = np.array([3.0, 2.0 * max(tree.length.max() for tree in swapped.trees)])
    for tree in swapped.trees:
        fronts = [front_of(phi1, tree, n) for n in range(50, len(tree) + 1, 50)]
        volumes = [hypervolume(front, reference) for front in fronts]
        assert np.all(np.diff(volumes) >= -1e-12)
        assert volumes[-1] > 0.0
        assert len(set(volumes)) > 2  # it did improve on the way
        for old, new in pairwise(fronts):
            for point in old:
                assert np.any(np.all(new <= point, axis=1))


def test_without_slack_the_chosen_parent_dominates_the_original(swapped):
    """Theorem 4: for beta = 0 whatever the original improves, the chosen one improves as well."""
    first = swapped.trees[0]
    assert first.beta.tolist() == [0.0, 0.0]
    assert len(first.swaps) > 50
    assert len(first.swaps) == first.reach["reselected"]
    assert np.all(first.swaps[:, 1] <= first.swaps[:, 0])
    assert np.all((first.swaps[:, 1] < first.swaps[:, 0]).any(axis=1))


def test_with_slack_no_objective_worsens_by_more_than_beta(swapped):
    """Eq. (11); the automaton's distance has no slack, because q_new >= q_old."""
    for tree in swapped.trees[1:]:
        assert len(tree.swaps) > 50
        assert np.all(tree.beta > 0)
        slack = np.concatenate([[0.0, tree.beta[0]], np.full(tree.risk.shape[1], tree.beta[1])])
        worse = tree.swaps[:, 1] - tree.swaps[:, 0]
        assert np.all(worse <= slack + 1e-9)
        assert np.any(worse > 0)  # the slack is used


def test_every_re_selection_improves_some_weighted_sum(swapped):
    """Theorem 5, with the weights of its proof: λ_j* > β* / (β* - Δf_j*), the rest shared equally."""
    for tree in swapped.trees:
        beta = np.concatenate([[0.0, tree.beta[0]], np.full(tree.risk.shape[1], tree.beta[1])])
        for old, new in tree.swaps:
            delta = new - old
            best = int(np.argmin(delta / np.maximum(np.abs(old) + np.abs(new), 1e-300)))
            assert delta[best] < 0  # Eq. (12)
            most = np.delete(beta, best).max()
            bound = most / (most - delta[best])
            assert bound < 1
            weights = np.full(len(delta), (1 - (1 + bound) / 2) / (len(delta) - 1))
            weights[best] = (1 + bound) / 2
            assert weights.sum() == pytest.approx(1.0)
            assert weights @ new < weights @ old


def test_progress_in_the_automaton_is_never_lost_along_a_path(phi1, swapped):
    """Visits stay visited: each vertex accepts all that its parent accepted."""
    covers = phi1.logic.covers
    for tree in swapped.trees:
        assert np.all(covers[tree.q[1:], tree.q[tree.parent[1:]]])


def test_without_re_selection_no_parent_is_exchanged(phi1):
    plain = grown(phi1, PlannerConfig(trees=2, n_max=300), record_swaps=True, reselect=False)
    assert all(tree.reach["reselected"] == 0 and len(tree.swaps) == 0 for tree in plain.trees)


# --- the same forest -----------------------------------------------------------------------------------


def assert_same(one, other):
    np.testing.assert_array_equal(one.accepted, other.accepted)
    for a, b in zip(one.trees, other.trees, strict=True):
        for field in fields(a):
            if field.name == "reach":
                assert a.reach == b.reach
            elif field.name != "seconds":
                np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


def test_the_same_seed_gives_the_same_forest_whatever_the_threads(phi1):
    cfg = PlannerConfig(trees=5, n_max=500)
    forests = [grown(phi1, replace(cfg, threads=n), seed=3) for n in (1, 2, 4, 1)]
    for other in forests[1:]:
        assert_same(forests[0], other)
    assert not np.array_equal(forests[0].trees[0].x, forests[0].trees[1].x)
    assert not np.array_equal(forests[0].trees[0].x, grown(phi1, cfg, seed=4).trees[0].x)


def test_watching_the_progress_changes_nothing(phi1):
    seen = []
    cfg = PlannerConfig(trees=2, n_max=500)
    watched = grown(phi1, cfg, progress=lambda done, total: seen.append((done, total)))
    assert_same(watched, grown(phi1, cfg))
    assert all(1 <= done <= total == 1000 for done, total in seen)  # the second tree may begin late


def test_only_the_first_tree_goes_without_slack(phi1):
    cfg = PlannerConfig(trees=6, n_max=20, beta_length=0.5, beta_risk=0.02)
    betas = np.array([tree.beta for tree in grown(phi1, cfg).trees])
    assert betas[0].tolist() == [0.0, 0.0]
    assert np.all(betas[1:] > 0)
    assert np.all(betas <= [0.5 * phi1.reach, 0.02])
    assert len(np.unique(betas[1:], axis=0)) == 5


def test_trees_can_end_at_their_first_completed_mission(phi1):
    forest = grown(phi1, PlannerConfig(trees=4, n_max=2500), stop_at_first=True)
    for j, tree in enumerate(forest.trees):
        mine = forest.accepted[forest.accepted[:, 0] == j]
        assert mine[:, 1].tolist() == [len(tree) - 1]


def test_growth_ends_in_time(phi1):
    forest = grown(phi1, PlannerConfig(trees=1, n_max=10**6, max_seconds=0.2))
    assert forest.seconds < 10.0
    assert 2 < len(forest.trees[0]) < 10**6


# --- the wind's horizon ----------------------------------------------------------------------------------


def test_no_vertex_lies_beyond_the_wind_data():
    scene = two_goals().scene
    brief = two_goals(wind=rough_wind(scene, slots=2, hours=1.0))  # known at steps 0 to 36
    assert brief.horizon == 37
    forest = grown(brief, replace(SMALL, n_max=1500))
    steps = np.concatenate([tree.step for tree in forest.trees])
    assert steps.max() >= 36
    late = [tree.q[tree.step >= 37] for tree in forest.trees]
    assert all(np.all(brief.automaton.distance[q] == 0.0) for q in late)  # the last step may only complete
    assert steps.max() <= 37
    assert sum(tree.reach["beyond"] for tree in forest.trees) > 0


def test_the_last_field_is_held_only_when_asked_to():
    scene = two_goals().scene
    brief = rough_wind(scene, slots=2, hours=0.5)
    stopped = grown(two_goals(wind=brief))
    held = grown(two_goals(wind=replace(brief, until=np.inf)))
    assert max(tree.step.max() for tree in stopped.trees) <= 19
    assert max(tree.step.max() for tree in held.trees) > 25


def test_paths_are_no_longer_than_max_steps():
    short = PlannerConfig(trees=2, n_max=500, max_steps=20)
    forest = grown(two_goals(planner=short), short)
    assert max(tree.step.max() for tree in forest.trees) <= 20


# --- what cannot be ----------------------------------------------------------------------------------


def test_a_start_too_close_to_an_obstacle_is_refused_by_name():
    scene = make_scene({"a": box(15, 15, 17, 17)}, [box(5, 5, 8, 8)], start=(4.95, 6.0))
    problem = make_problem("F a", scene, robot=RobotConfig(dt=100.0, u_max=10.0, start_sd=100.0))
    with pytest.raises(
        InfeasibleError, match=r"start lies closer .* planner\.epsilon = 0\.05 .* robot\.start_sd"
    ):
        grown(problem)
    exact = make_problem("F a", scene)  # a start known exactly may be this close
    assert len(grown(exact).accepted) > 0


def test_a_start_too_close_names_the_limit_that_it_breaks(caplog):
    """Under the path bound trees keep to epsilon, as finished paths do."""
    scene = make_scene({"a": box(15, 15, 17, 17)}, [box(5, 5, 8, 8)], start=(5 - 0.145, 6.5))
    robot = RobotConfig(dt=100.0, u_max=10.0, start_sd=100.0)

    def problem(epsilon):
        return make_problem(
            "F a", scene, robot=robot, planner=PlannerConfig(epsilon=epsilon), fidelity="full"
        )

    risk_there = ndtr(-1.45)
    assert 0.05 < risk_there < 0.1
    assert len(evaluate_path(problem(0.1), scene.start[None], "").x) == 1
    with pytest.raises(InfeasibleError, match=r"closer to an obstacle than planner\.epsilon = 0\.05 allows"):
        grown(problem(0.05), STRICT)
    with caplog.at_level(logging.WARNING):
        assert len(grown(problem(0.05)).trees[0]) > 1
    assert "closer to an obstacle than planner.epsilon = 0.05 allows" in caplog.text
    assert len(grown(problem(0.1)).trees[0]) > 1


def test_a_start_too_close_to_a_wall_names_the_border():
    scene = replace(make_scene({"a": box(15, 15, 17, 17)}, start=(0.1, 9.0)), border="wall")
    robot = RobotConfig(dt=100.0, u_max=10.0, start_sd=100.0)
    tight = PlannerConfig(epsilon=0.05)
    with pytest.raises(InfeasibleError, match=r"an obstacle or the wall .* scene\.border=open"):
        grown(make_problem("F a", scene, robot=robot, planner=tight, fidelity="full"), STRICT)
    assert len(grown(make_problem("F a", replace(scene, border="open"), robot=robot)).trees[0]) > 1


def test_a_walled_in_region_is_reported_before_any_growth():
    walls = [box(11, 11, 19, 12), box(11, 18, 19, 19), box(11, 12, 12, 18), box(18, 12, 19, 18)]
    scene = make_scene({"a": box(14, 14, 16, 16), "b": box(2, 2, 4, 4)}, walls)
    with pytest.raises(InfeasibleError, match=r"no way through the map completes 'F a & F b'.*move"):
        grown(make_problem("F a & F b", scene))
    assert len(grown(make_problem("F b", scene)).accepted) > 0


def test_a_region_that_no_way_reaches_is_named_where_lines_do_not_tell(monkeypatch):
    monkeypatch.setattr(shortest_mission, "closed_way", lambda problem: "")
    walls = [box(11, 11, 19, 12), box(11, 18, 19, 19), box(11, 12, 12, 18), box(18, 12, 19, 18)]
    scene = make_scene({"a": box(14, 14, 16, 16), "b": box(2, 2, 4, 4)}, walls)
    with pytest.raises(InfeasibleError, match=r"no way after the first regions leads to \{a\}"):
        grown(make_problem("F a & F b", scene))


def test_a_start_whose_label_breaks_the_mission_is_reported():
    scene = make_scene({"a": box(14, 14, 16, 16), "b": box(2, 2, 4, 4)}, start=(3, 3))
    with pytest.raises(InfeasibleError, match="start's own label breaks the mission"):
        grown(make_problem("!b U a", scene))


def test_a_mission_that_the_start_completes_needs_no_flight():
    scene = make_scene({"a": box(0, 0, 4, 4)}, start=(2, 2))
    forest = grown(make_problem("F a", scene))
    assert forest.accepted.tolist() == [[0, 0], [1, 0]]
    assert [len(tree) for tree in forest.trees] == [1, 1]


def test_too_few_vertices_say_how_far_they_came_and_which_knob_to_turn():
    problem = make_problem("F(a & F b)", make_scene({"a": box(8, 2, 10, 4), "b": box(14, 14, 16, 16)}))
    cfg = PlannerConfig(trees=2, n_max=5)
    forest = grown(problem, cfg)
    assert len(forest.accepted) == 0
    text = no_path.explain_no_path(cfg, problem, forest)
    assert "10 vertices reached automaton states [0] of 3" in text
    assert "the nearest still 2 transition(s) from acceptance" in text
    points = np.vstack([tree.x for tree in forest.trees])
    miss = np.hypot(*np.maximum(np.maximum([8 * KM, 2 * KM] - points, points - [10 * KM, 4 * KM]), 0).T)
    assert f"{miss.min() / KM:.1f} km short of a" in text
    assert "raise planner.n_max (now 5)" in text
    assert "\n" not in text


def test_wind_that_holds_the_robot_back_is_named():
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    wind = steady_wind(scene, mean=(-9.9, 0.0), until=np.inf)
    cfg = PlannerConfig(trees=2, n_max=60, max_steps=25)
    problem = make_problem("F a", scene, wind, planner=cfg)
    forest = grown(problem, cfg)
    assert len(forest.accepted) == 0
    text = no_path.explain_no_path(cfg, problem, forest)
    assert (
        "the expected wind, up to 9.9 m/s, is too strong for robot.u_max = 10 m/s: set robot.u_max=" in text
    )

    storm = steady_wind(scene, mean=(-10.5, 0.0), until=np.inf)  # calm enough somewhere: one node
    storm.mean[:, 0, 0] = 0.0
    cfg = PlannerConfig(trees=2, n_max=60)
    problem = make_problem("F a", scene, storm, planner=cfg)
    forest = grown(problem, cfg)
    assert len(forest.accepted) == 0
    assert "is too strong for robot.u_max = 10 m/s: set robot.u_max=12" in no_path.explain_no_path(
        cfg, problem, forest
    )


def test_a_gap_that_is_too_narrow_for_epsilon_is_named():
    walls = [box(9, 0, 11, 9.7), box(9, 10.3, 11, 20)]
    scene = make_scene({"a": box(15, 8, 17, 12)}, walls, start=(3, 10))
    cfg = PlannerConfig(trees=2, n_max=200)
    problem = make_problem("F a", scene, steady_wind(scene, gust=(4.0, 4.0)), planner=cfg)
    forest = grown(problem, cfg)
    assert len(forest.accepted) == 0
    assert "came too close to obstacles: make the passages wider" in no_path.explain_no_path(
        cfg, problem, forest
    )


# --- near the optimum --------------------------------------------------------------------------------


def test_in_still_air_re_selection_brings_paths_near_the_straight_line():
    scene = make_scene({"a": box(14, 14, 16, 16)})
    problem = make_problem("F a", scene, steady_wind(scene, gust=(0.0, 0.0)))
    best = {}
    for reselect in (False, True):
        forest = grown(problem, PlannerConfig(trees=4, n_max=1000), reselect=reselect)
        best[reselect] = min(forest.trees[j].length[v] for j, v in forest.accepted)
    straight = np.hypot(13, 13) * KM
    assert straight <= best[True] <= 1.12 * straight
    assert best[True] < best[False]


def test_growth_leaves_most_of_a_time_budget_to_refinement():
    class QuarterSpent(Budget):
        def left(self, share=1.0):
            return max(share - 0.25, 0.0)

    cfg = PlannerConfig(trees=1, n_max=400_000, threads=1)
    forest = growth.grow_forest(cfg, two_goals(), SeedSequence(0), budget=QuarterSpent(1e6))
    assert len(forest.trees[0].x) < 0.9 * cfg.n_max
