"""Probabilities against sampling, against scipy, and as promises that simulated flights must keep."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import binom, multivariate_normal

from oracle import path_risk as risk
from oracle.segments import meeting_bounds
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.pack_logic import harmful_letters
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.world.cells import half_planes
from pareto_ltl_verify.gaussians import in_polygon, left_out
from pareto_ltl_verify.geometry import convex
from problems import KM, RARE, along, box, make_problem, make_scene, random_covariances, steady_wind
from strategies import convex_polygons

some = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


# --- one polygon, one Gaussian -------------------------------------------------------------------------


@some
@given(seeds)
def test_the_probability_of_a_box_is_that_of_scipy(seed):
    rng = np.random.default_rng(seed)
    (cov,) = random_covariances(rng, 1, 2.0)
    low = rng.uniform(-4, 2, 2)
    high = low + rng.uniform(0.1, 6, 2)
    polygon = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    mean = rng.uniform(-2, 2, 2)
    # inclusion and exclusion of corners: scipy integrates quadrants of two dimensions exactly
    cdf = multivariate_normal(mean, cov).cdf
    expected = cdf(high) - cdf([low[0], high[1]]) - cdf([high[0], low[1]]) + cdf(low)
    assert in_polygon(convex(polygon), mean, cov) == pytest.approx(expected, abs=2e-8)


@pytest.mark.statistical
@settings(deadline=None, max_examples=12)
@given(convex_polygons(), seeds)
def test_the_probability_of_a_polygon_is_the_share_of_samples_in_it(polygon, seed):
    rng = np.random.default_rng(seed)
    (cov,) = random_covariances(rng, 1, 150.0)
    mean = polygon.mean(axis=0) + rng.uniform(-150, 150, 2)
    n = 20_000
    samples = rng.multivariate_normal(mean, cov, n)
    hits = int(shapely.contains_xy(shapely.Polygon(polygon), samples).sum())
    p = in_polygon(convex(polygon), mean, cov)
    assert min(binom.cdf(hits, n, p + 1e-12), binom.sf(hits - 1, n, p + 1e-12)) > RARE / 100


@some
@given(convex_polygons(), seeds)
def test_pieces_add_up_and_moving_the_world_changes_nothing(polygon, seed):
    rng = np.random.default_rng(seed)
    (cov,) = random_covariances(rng, 1, 150.0)
    mean, shift = polygon.mean(axis=0) + rng.uniform(-400, 400, 2), rng.uniform(-1e4, 1e4, 2)
    whole = in_polygon(convex(polygon), mean, cov)
    pieces = [np.array([polygon[0], polygon[i], polygon[i + 1]]) for i in range(1, len(polygon) - 1)]
    assert sum(in_polygon(convex(p), mean, cov) for p in pieces) == pytest.approx(whole, abs=1e-10)
    assert in_polygon(convex(polygon + shift), mean + shift, cov) == pytest.approx(whole, abs=1e-9)
    assert in_polygon(convex(3 * polygon), 3 * mean, 9 * cov) == pytest.approx(whole, abs=1e-10)


def test_a_mean_on_an_edge_or_a_corner_is_no_special_case():
    cov, big = np.eye(2), 50.0  # so large that only the nearest faces count
    square = np.array([[0, 0], [big, 0], [big, big], [0, big]])
    assert in_polygon(convex(square), np.array([25.0, 0.0]), cov) == pytest.approx(0.5, abs=1e-12)
    assert in_polygon(convex(square), np.array([0.0, 0.0]), cov) == pytest.approx(0.25, abs=1e-12)
    assert in_polygon(convex(square), np.array([25.0, 25.0]), cov) == pytest.approx(1.0, abs=1e-12)
    assert in_polygon(convex(square), np.array([-40.0, 25.0]), cov) == pytest.approx(0.0, abs=1e-12)


@some
@given(convex_polygons(), seeds)
def test_the_half_plane_bounds_hold(polygon, seed):
    rng = np.random.default_rng(seed)
    normals, offsets = half_planes(polygon)
    for cov in random_covariances(rng, 5, 200.0):
        mean = polygon.mean(axis=0) + rng.uniform(-400, 400, 2)
        exact = in_polygon(convex(polygon), mean, cov)
        assert risk.inside_bound(normals, offsets, mean, cov) >= exact - 1e-9
        assert left_out(convex(polygon), mean, cov) >= 1 - exact - 1e-9


def test_a_certain_position_is_inside_or_outside():
    normals, offsets = half_planes(box(0, 0, 1, 1))
    none = np.zeros((2, 2))
    assert left_out(convex(box(0, 0, 1, 1)), np.array([500.0, 500.0]), none) == 0.0
    assert risk.inside_bound(normals, offsets, np.array([1500.0, 500.0]), none) == 0.0
    assert risk.inside_bound(normals, offsets, np.array([500.0, 500.0]), none) == 1.0


# --- missions ------------------------------------------------------------------------------------------


def simulated(problem, path, runs=20_000, seed=1):
    """Flights whose positions are exactly Gaussian (the wind is the same everywhere)."""
    return deployment.simulate_flights(problem, path.u, runs, "independent", SeedSequence(seed))


def keeps(bound, failures, runs):
    """Would a true rate of ``bound`` show so many failures but once in ten million times?"""
    return failures <= 0 or bound >= 1 or binom.sf(failures - 1, runs, bound) > RARE


def breaks(bound, failures, runs):
    """Is a true rate of ``bound`` out of the question?"""
    return binom.sf(failures - 1, runs, bound) < RARE


STRONG, MILD = (20.0, 12.0), (3.0, 2.0)  # variances [m²/s²]

MISSIONS = {
    # formula, regions, way [km]
    "visit": ("F a", {"a": box(9, 9, 12, 12)}, ((1, 1), (10.5, 10.5))),
    "order": ("F(a & F b)", {"a": box(8, 2, 10, 4), "b": box(8, 9, 10, 11)}, ((1, 3), (9, 3), (9, 10))),
    "either": (
        "F(a & F b) | F(a & F c)",
        {"a": box(7, 1, 10, 4), "b": box(12, 7, 14, 9), "c": box(14, 7, 16, 9)},
        ((1, 3), (8.5, 2.5), (14, 8)),
    ),
    "both": (
        "F(a & F b & F c)",
        {"a": box(5, 1, 8, 4), "b": box(10, 1, 13, 4), "c": box(15, 1, 18, 4)},
        ((1, 2.5), (16.5, 2.5)),
    ),
    "avoid": ("!b U a", {"a": box(12, 2, 16, 6), "b": box(5, 5.8, 10, 9)}, ((1, 4), (14, 4))),
    "stay": ("F(a & X a & X X a)", {"a": box(10, 2, 14, 5)}, ((1, 3.5), (11.2, 3.5), (12.8, 3.5))),
    "overlap": ("F(a & b)", {"a": box(8, 1, 13, 6), "b": box(10, 3, 15, 8)}, ((1, 2), (11.5, 4.5))),
}


def flown(name):
    formula, regions, way = MISSIONS[name]
    scene = make_scene(regions, start=way[0])
    problem = make_problem(formula, scene, steady_wind(scene, mean=(1.5, -1.0), latent=(1.0, 0.5), gust=MILD))
    return problem, evaluate_path(problem, along(*way, step=0.8), name)


@pytest.mark.statistical
@pytest.mark.parametrize("name", MISSIONS)
def test_simulated_flights_fail_no_more_often_than_the_ordered_bound(name):
    problem, path = flown(name)
    result = simulated(problem, path)
    failures, runs = int((~result.accepted).sum()), len(result.accepted)
    assert failures > 20  # otherwise the scene tests nothing
    assert 0.0 < path.objectives.mission_risk_ordered < 1.0
    assert keeps(path.objectives.mission_risk_ordered, failures, runs)


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["visit", "order", "either", "both", "overlap"])
def test_the_papers_bound_holds_for_visits_made_in_their_order(name):
    problem, path = flown(name)
    result = simulated(problem, path)
    assert keeps(path.objectives.mission_risk_paper, int((~result.accepted).sum()), len(result.accepted))


@pytest.mark.statistical
def test_the_ordered_bound_is_not_far_above_the_truth_for_one_visit():
    """With one step in reach of the goal V is exact."""
    scene = make_scene({"a": box(9, 9, 11, 11)}, start=(9.1, 8.1))
    problem = make_problem("F a", scene, steady_wind(scene, gust=STRONG))
    path = evaluate_path(problem, np.array([[9.1, 8.1], [9.8, 9.8 - 1.1]]) * KM, "one step")
    exact = 1 - in_polygon(convex(box(9, 9, 11, 11)), path.x[1], path.cov[1])
    assert path.objectives.mission_risk_ordered == pytest.approx(exact, rel=1e-9)
    failures = int((~simulated(problem, path).accepted).sum())
    assert keeps(exact, failures, 20_000)
    assert keeps(1 - exact, 20_000 - failures, 20_000)


@pytest.mark.statistical
def test_a_visit_made_too_early_fools_the_paper_but_not_the_ordered_bound():
    """F(a & F b): b is crossed safely on the way to a, and only grazed when it counts."""
    scene = make_scene({"a": box(13, 1, 19, 7), "b": box(2, 1, 6, 7)}, start=(1, 4))
    problem = make_problem("F(a & F b)", scene, steady_wind(scene, gust=STRONG))
    path = evaluate_path(problem, along((1, 4), (4, 4), (16, 4), (5.4, 6.2), step=0.8), "there and back")
    result = simulated(problem, path)
    failures, runs = int((~result.accepted).sum()), len(result.accepted)
    assert problem.automaton.accepting[path.q[-1]]
    assert breaks(path.objectives.mission_risk_paper, failures, runs)
    assert keeps(path.objectives.mission_risk_ordered, failures, runs)
    assert path.objectives.mission_risk_ordered < 1.0


@pytest.mark.statistical
def test_a_forbidden_region_close_by_fools_the_paper_but_not_the_ordered_bound():
    """!b U a, past b at a small distance: the paper counts the visit of a alone."""
    scene = make_scene({"a": box(11, 1, 19, 7), "b": box(4, 4.6, 9, 9)}, start=(1, 4))
    problem = make_problem("!b U a", scene, steady_wind(scene, gust=(6.0, 6.0)))
    path = evaluate_path(problem, along((1, 4), (15, 4), step=0.8), "past b")
    result = simulated(problem, path)
    failures, runs = int((~result.accepted).sum()), len(result.accepted)
    assert breaks(path.objectives.mission_risk_paper, failures, runs)
    assert keeps(path.objectives.mission_risk_ordered, failures, runs)


def test_without_uncertainty_the_ordered_bound_is_the_run_of_the_automaton():
    scene = make_scene({"a": box(13, 1, 19, 7), "b": box(2, 1, 6, 7)}, start=(1, 4))
    problem = make_problem("F(a & F b)", scene, steady_wind(scene, gust=(0.0, 0.0)))
    half = evaluate_path(problem, along((1, 4), (16, 4), step=0.8), "half")
    whole = evaluate_path(problem, along((1, 4), (16, 4), (5, 4), step=0.8), "whole")
    assert half.objectives.mission_risk_ordered == 1.0
    assert whole.objectives.mission_risk_ordered == 0.0


def by_states(problem, x, cov):
    """The recursion of the ordered bound as it is written, one state and one label at a time; the start is
    known exactly and lies in no region."""
    automaton, states = problem.automaton, range(problem.automaton.n_states)
    letters, (_, loses) = automaton.letters, harmful_letters(automaton, automaton.letter_index(()))
    met, hazards = meeting_bounds(problem, x, cov), problem.logic.hazards.cell
    V = [0.0 if automaton.preorder[automaton.initial, p] else 1.0 for p in states]
    for t, (mean, c) in enumerate(zip(x, cov, strict=True)):
        P = dict.fromkeys(letters, 0.0)
        for cell, label in zip(problem.decomposition.cells, problem.labels, strict=True):
            if label and t > 0:
                P[label] += in_polygon(convex(cell), mean, c)
        P[frozenset()] = 1.0 - sum(p for label, p in P.items() if label)
        lost = [{s for k, s in enumerate(letters) if s and loses[q, k]} for q in states]
        way = [
            sum(m for m, cell in zip(met[t], hazards, strict=True) if problem.labels[cell] in lost[q])
            for q in states
        ]
        V = [
            min(
                1.0,
                *(
                    V[q]
                    + way[q]
                    + sum(
                        P[s]
                        for s in letters
                        if s not in lost[q] and not automaton.preorder[automaton.step(q, s), p]
                    )
                    for q in states
                ),
            )
            for p in states
        ]
    return min(V[p] for p in states if automaton.accepting[p])


@pytest.mark.parametrize("name", MISSIONS)
def test_the_ordered_bound_is_its_recursion(name):
    problem, path = flown(name)
    expected = by_states(problem, path.x, path.cov)
    found = risk.ordered_bound(problem, path.x, path.cov)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert found == pytest.approx(path.objectives.mission_risk_ordered, rel=1e-9, abs=1e-12)


def test_labels_are_shown_with_probabilities_that_sum_to_one():
    problem, path = flown("overlap")
    columns, P = risk.label_probabilities(problem, path.x, path.cov)
    assert P.shape == (len(path.x), len(columns))
    np.testing.assert_allclose(P.sum(axis=1), 1.0, atol=1e-12)
    assert columns[-1] == len(problem.labels)
    assert np.all(P >= 0)
    assert P[0].tolist() == [0.0] * (len(columns) - 1) + [1.0]
    mean, cov = path.x[-1], path.cov[-1]
    for k, cell in enumerate(columns[:-1]):
        exact = in_polygon(convex(problem.decomposition.cells[cell]), mean, cov)
        assert P[-1, k] == pytest.approx(exact, abs=1e-13)


# --- the paper's f_o -----------------------------------------------------------------------------------


def test_the_papers_risk_is_the_best_visit_of_each_region():
    problem, path = flown("both")
    cells = problem.locate(path.x)
    found = risk.theorem2_bound(problem, path.x, path.cov, cells)
    for i, name in enumerate(problem.atoms):
        part = convex(problem.scene.regions[name][0])
        visits = [t for t, label in enumerate(path.label) if name in label]
        bounds = [left_out(part, path.x[t], path.cov[t]) for t in visits]
        assert len(visits) > 1
        assert found[i] == pytest.approx(min(bounds))
    assert path.objectives.mission_risk_paper == pytest.approx(found.sum())


# --- collisions ----------------------------------------------------------------------------------------

OBSTACLES = [box(5, 6.2, 9, 9), box(11, 0, 15, 1.8), np.array([[16.0, 6.0], [18.0, 7.0], [17.0, 9.0]]) * KM]
WAYS = {
    "between": ((1, 4), (14, 4), (19, 4)),
    "round": ((2, 6), (3.5, 8), (4, 10.5), (11, 10.5), (11, 6)),
    "beside": ((4, 4.5), (19, 4.5)),
}


@pytest.mark.statistical
@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("gust", [(4.0, 4.0), (8.0, 2.0)])
def test_simulated_flights_collide_no_more_often_than_the_path_bound(name, gust):
    scene = make_scene({"a": box(18, 18, 19, 19)}, OBSTACLES, start=WAYS[name][0])
    wind = steady_wind(scene, mean=(1.0, -2.0), gust=gust)
    problem = make_problem("F a", scene, wind, planner=PlannerConfig(epsilon=0.9))
    path = evaluate_path(problem, along(*WAYS[name], step=0.7), name)
    result = simulated(problem, path)
    hits = int(result.collided.sum())
    assert hits > 20
    assert 0.0 < path.objectives.collision_risk <= 1.0
    assert keeps(path.objectives.collision_risk, hits, len(result.collided))
