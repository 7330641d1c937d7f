"""Letters on the way between steps: three roads to one state, and V holds for what is read there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import binom

from levels import AT_NIGHT
from oracle.path_risk import ordered_bound
from oracle.segments import meeting_bounds, states_of_flight
from pareto_ltl.extend import Forecast, simulate_flights
from pareto_ltl.planning.evaluate import ordered_mission_risk, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.support.arrays import FloatArray, IntArray, square_matrices
from pareto_ltl_verify.flights import Ground
from pareto_ltl_verify.formula import Dfa
from pareto_ltl_verify.geometry import convex
from plane_logic.letters import states_along
from problems import KM, MISSIONS, RARE, box, make_problem, make_scene, paper_problem, steady_wind

REGIONS = {"a": box(14, 8, 18, 12), "b": box(8, 3, 9, 19), "c": box(1, 12, 19, 14)}
FORMULAS = (
    "!b U a",
    "F a & (!b U c)",
    "(!b U a) | F(b & F c)",
    "c U (c & b)",
    "(!b & !c) U (a & X(!b U c))",
)
SHARES = np.linspace(0.0, 1.0, 2001)


def task(formula: str, fidelity: str = "full", gust: float = 1.0, strip: FloatArray | None = None) -> Problem:
    regions = REGIONS if strip is None else {"a": REGIONS["a"], "b": strip}
    scene = make_scene(regions, [box(11, 1, 13, 5)], start=(2, 10))
    return make_problem(formula, scene, steady_wind(scene, gust=(gust, gust)), fidelity=fidelity)


TASKS = {formula: task(formula) for formula in FORMULAS}


def sampled_states(problem: Problem, x: FloatArray) -> IntArray:
    """States from dense samples of each step: the cells between the cells of its ends."""
    logic = problem.reading(0)
    cells = problem.locate(x)
    q = int(logic.delta[logic.initial, cells[0]])
    states = [q]
    for t in range(1, len(x)):
        if logic.delta[q, cells[t - 1]] == q:
            seen = problem.locate(x[t - 1] + SHARES[:, None] * (x[t] - x[t - 1]))
            for cell in seen[np.append(True, np.diff(seen) != 0)]:
                if cell >= 0 and cell not in (cells[t - 1], cells[t]) and logic.harm[q, cell]:
                    q = int(logic.delta[q, cell])
        q = int(logic.delta[q, cells[t]])
        states.append(q)
    return np.array(states)


def grazes(problem: Problem, x: FloatArray) -> bool:
    """Whether a step passes a corner so closely that samples may miss the cell."""
    corners = np.vstack(problem.decomposition.cells)
    for p, q in itertools.pairwise(x):
        share = np.clip(((corners - p) @ (q - p)) / max(float((q - p) @ (q - p)), 1e-9), 0, 1)
        if np.linalg.norm(p + share[:, None] * (q - p) - corners, axis=1).min() < 100.0:
            return True
    return False


on_grid = st.integers(-4, 83).map(lambda k: 0.25 * k + 0.0373)  # never along an edge, which is no interior
place = st.tuples(on_grid, on_grid)


@settings(deadline=None, max_examples=60)
@given(st.sampled_from(FORMULAS), st.lists(place, min_size=2, max_size=5))
def test_states_along_a_path_are_those_of_dense_samples_and_of_the_plain_road(
    formula: str, places: list[tuple[float, float]]
) -> None:
    problem, x = TASKS[formula], KM * np.array(places)
    assume((np.linalg.norm(np.diff(x, axis=0), axis=1) > 1.0).all())
    found = states_along(problem.cells, problem.logic, x)
    np.testing.assert_array_equal(found, states_of_flight(problem, x))
    if not grazes(problem, x):
        np.testing.assert_array_equal(found, sampled_states(problem, x))


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(FORMULAS[:4]), st.lists(place, min_size=2, max_size=5))
def test_the_independent_judge_reads_the_same(formula: str, places: list[tuple[float, float]]) -> None:
    problem, x = TASKS[formula], KM * np.array(places)
    assume((np.linalg.norm(np.diff(x, axis=0), axis=1) > 1.0).all() and not grazes(problem, x))
    a = problem.automaton
    dfa = Dfa(
        tuple(a.letters), tuple(a.atoms), tuple(map(tuple, a.delta.tolist())), int(a.initial),
        tuple(map(bool, a.accepting)),
    )  # fmt: skip
    parts = {name: tuple(map(convex, found)) for name, found in problem.decomposition.regions.items()}
    ground = Ground(problem.scene.bounds, parts, tuple(map(convex, problem.decomposition.obstacles)), dfa)
    np.testing.assert_array_equal(ground.states(x[None])[0], states_along(problem.cells, problem.logic, x))


@pytest.mark.parametrize("fidelity", ["paper", "full"])
def test_a_forbidden_strip_narrower_than_a_step_cannot_be_jumped(fidelity: str) -> None:
    east = np.tile([10.0, 0.0], (14, 1))
    strip = box(8.3, 0, 8.6, 20)
    barred, free = (task(formula, fidelity, 0.0, strip) for formula in ("!b U a", "F a"))
    assert not simulate_flights(barred, east, 3, "independent", SeedSequence(0)).accepted.any()
    assert simulate_flights(free, east, 3, "independent", SeedSequence(0)).accepted.all()


@pytest.mark.parametrize("name", MISSIONS)
def test_the_missions_of_the_paper_have_no_letter_that_does_harm(name: str) -> None:
    logic = paper_problem(name).world.mission.logic
    assert not logic.harm.any()
    assert len(logic.hazards.cell) == 0


@pytest.mark.parametrize("formula", FORMULAS)
def test_v_of_a_path_is_its_plain_recursion(formula: str) -> None:
    problem, rng = TASKS[formula], np.random.default_rng(5)
    values = []
    for _ in range(12):
        turn = KM * rng.uniform([4, 6], [10, 16], 2)
        legs = [np.linspace([2 * KM, 10 * KM], turn, 9), np.linspace(turn, [16 * KM, 10 * KM], 12)[1:]]
        flight = propagate(problem, np.vstack(legs))
        cov = square_matrices(flight.cov)
        values.append(ordered_mission_risk(problem, flight))
        assert values[-1] == pytest.approx(ordered_bound(problem, flight.x, cov), rel=1e-6, abs=1e-9)
        assert (meeting_bounds(problem, flight.x, cov) >= 0.0).all()
    if formula == "F a & (!b U c)":
        assert min(values) < 1.0


@pytest.mark.parametrize(
    ("law", "heights"), [("independent", (9.02, 9.1, 9.2)), ("coherent", (9.2, 9.5, 10.0))]
)
def test_v_bounds_the_flights_that_meet_a_forbidden_strip(law: str, heights: tuple[float, ...]) -> None:
    """Steps of 1 km beside a strip 400 m wide: at the steps alone, few flights are seen in it."""
    problem = task("!b U a", gust=0.4, strip=box(8, 0, 8.4, 9))
    between = 0
    for height in heights:
        line = np.array([[2, 10], [7, height], [9.5, height], [15, 10]]) * KM
        x = np.vstack([np.linspace(p, q, 7)[:-1] for p, q in itertools.pairwise(line)] + [line[-1:]])
        u = propagate(problem, x, problem.laws[law]).u
        bound = Forecast.of(problem, u, law).mission_risk
        flights = simulate_flights(problem, u, 4000, law, SeedSequence(3), x)
        missed = int((~flights.accepted).sum())
        assert binom.sf(missed - 1, 4000, bound) > RARE
        at_steps = np.array([(problem.locate(f) == problem.logic.hazards.cell[0]).any() for f in flights.x])
        between += int((~flights.accepted & ~at_steps).sum())
    assert between > 10  # the strip was met between steps


@pytest.mark.parametrize("fidelity", ["paper", "full"] if AT_NIGHT else ["paper"])  # full compiles for 40 s
def test_trees_go_round_a_forbidden_strip(fidelity: str) -> None:
    problem = task("!b U a", fidelity, 0.2, box(8, 0, 8.4, 14))
    forest = grow_forest(PlannerConfig(trees=2, n_max=400, threads=1), problem, SeedSequence(1))
    assert len(forest.accepted) > 0
    for tree in forest.trees:
        for v in range(0, len(tree), 7):
            states = states_along(problem.cells, problem.logic, tree.path(v))
            assert states[-1] == tree.q[v]
            assert np.isfinite(problem.logic.distance[states]).all()
