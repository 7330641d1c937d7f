"""Time windows and deadlines: what flights read, by brute force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import binom

from ltlf import Formula
from oracle.margin import mission_margin
from oracle.path_risk import ordered_bound, theorem2_bound
from oracle.segments import states_of_flight
from pareto_ltl.extend import Deployment, simulate_flights
from pareto_ltl.logic import parse_formula
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.windows import Window
from plane_logic.letters import states_along
from problems import KM, RARE, along, box, make_problem, make_scene, steady_wind

DT = 100.0  # [s] a step of the test robot, which flies 1 km in it
REGIONS = {"a": box(14, 8, 18, 12), "b": box(8, 3, 9, 19), "c": box(1, 12, 19, 14), "d": box(2, 2, 6, 6)}
WINDOWS = {
    "a": Window("a", 2 * DT, 5 * DT),
    "late": Window("d", 3.5 * DT, math.inf),
    "soon": Window("c", -math.inf, 2.5 * DT),
    "gate": Window("b", 0.5 * DT, 3.5 * DT),
}
VISITS = (
    "F a", "F(late & F a)", "F soon | F a", "F d & F soon", "F[0,250s] d", "F[150s,350s] (a | c) & F late",
    "F(a & X F d)", "F[0,100s] soon | F[300s,400s] late",
)  # fmt: skip
AVOIDS = (
    "!gate U a",
    "!soon U late",
    "F late & G[0,250s] !c",
    "!(F[150s,300s] b) & F d",
    "(!gate & !soon) U d",
)


def task(formula: str, forbidden: tuple[str, ...] = (), fidelity: str = "full", gust: float = 1.0) -> Problem:
    scene = make_scene(REGIONS, [box(11, 1, 13, 5)], start=(2.0, 10.0))
    scene = replace(scene, windows=WINDOWS, forbidden=forbidden)
    return make_problem(formula, scene, steady_wind(scene, gust=(gust, gust)), fidelity=fidelity)


TASKS = {formula: task(formula) for formula in (*VISITS, *AVOIDS)} | {
    f"{formula}, gate closed": task(formula, ("gate",)) for formula in ("F a", "F d", "F[0,350s] c")
}


# --- by brute force ---------------------------------------------------------------------------


def shown_at(problem: Problem, place: FloatArray, time: float) -> set[str]:
    """Propositions that hold at a place and time, from the polygons of the map and the windows."""
    if problem.locate(place[None])[0] < 0:
        return set()
    inside = {name for name, polygon in REGIONS.items() if in_box(polygon, place)}
    timed = {name for name, w in WINDOWS.items() if w.region in inside and w.begin <= time <= w.end}
    return {name for name in inside if name not in WINDOWS} | timed


def in_box(polygon: FloatArray, place: FloatArray) -> bool:
    return bool((place >= polygon.min(axis=0)).all() and (place <= polygon.max(axis=0)).all())


def satisfied(tree: Formula, word: Sequence[set[str]], t: int = 0) -> bool:
    """Whether a finite word satisfies a formula of visits; spans count from the first letter."""
    if tree.op == "name":
        return tree.name in word[t]
    if tree.op in "&|":
        return (all if tree.op == "&" else any)(satisfied(arg, word, t) for arg in tree.args)
    if tree.op == "X":
        return t + 1 < len(word) and satisfied(tree.args[0], word, t + 1)
    assert tree.op == "F"
    begin, end = tree.span or (-math.inf, math.inf)
    later = range(t, len(word))
    return any(begin <= s * DT <= end and satisfied(tree.args[0], word, s) for s in later)


on_grid = st.integers(-4, 83).map(lambda k: 0.25 * k + 0.0373)  # never along an edge
places = st.lists(st.tuples(on_grid, on_grid), min_size=2, max_size=7)


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(VISITS), places)
def test_flights_complete_what_the_formula_says_at_the_times_of_their_steps(
    formula: str, where: list[tuple[float, float]]
) -> None:
    problem, x = TASKS[formula], KM * np.array(where)
    word = [shown_at(problem, place, DT * t) for t, place in enumerate(x)]
    done = problem.logic.distance[states_along(problem.cells, problem.logic, x)] == 0.0
    wanted = [satisfied(parse_formula(formula), word[: t + 1]) for t in range(len(x))]
    np.testing.assert_array_equal(done, wanted)
    assert Deployment.judged(problem, "independent", x[None]).accepted[0] == wanted[-1]


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(sorted(TASKS)), places)
def test_the_plain_road_reads_the_same_letters(formula: str, where: list[tuple[float, float]]) -> None:
    problem, x = TASKS[formula], KM * np.array(where)
    assume((np.linalg.norm(np.diff(x, axis=0), axis=1) > 1.0).all())
    found = states_along(problem.cells, problem.logic, x)
    np.testing.assert_array_equal(found, states_of_flight(problem, x))


@settings(deadline=None, max_examples=150)
@given(places)
def test_an_obstacle_that_stands_for_a_time_is_met_on_the_way_while_it_stands(
    where: list[tuple[float, float]],
) -> None:
    """Along the way places are sampled densely; the obstacle counts on a step during which it stands."""
    problem, x = TASKS["F a, gate closed"], KM * np.array(where)
    low, high = REGIONS["b"].min(axis=0), REGIONS["b"].max(axis=0)
    lost = reached = False
    for t, end in enumerate(x):
        begin = x[max(t - 1, 0)]
        way = begin + np.linspace(0, 1, 4001)[:, None] * (end - begin)
        met = ((way > low) & (way < high)).all(axis=1)
        near = ((way > low - 30.0) & (way < high + 30.0)).all(axis=1)
        stands = WINDOWS["gate"].meets(DT * max(t - 1, 0), DT * t)
        assume(not stands or met.any() == near.any())  # not a grazing touch, which samples may miss
        ends = [((p > low) & (p < high)).all() for p in (begin, end)]
        at_step = ends[1] and WINDOWS["gate"].holds_at(DT * t)
        passed = met.any() and not any(ends)
        if stands and not reached and (at_step or passed):
            lost = True
        reached = reached or (not lost and "a" in shown_at(problem, end, DT * t))
    state = states_along(problem.cells, problem.logic, x)[-1]
    distance = problem.logic.distance[state]
    assert (distance == 0.0) == reached
    assert math.isinf(distance) == (lost and not reached)


# --- margins and bounds -----------------------------------------------------------------------


@pytest.mark.parametrize("formula", sorted(TASKS))
def test_margins_are_those_of_the_plain_road_and_agree_with_the_verdict(formula: str) -> None:
    from pareto_ltl.planning.margin_model import margin_model, margin_scratch
    from plane_logic.margin import Slope, smoothed_failure

    problem, rng = TASKS[formula], np.random.default_rng(3)
    base = along((2, 10), (7, 10), (10, 13), (15, 11), step=1.9)
    x = base + rng.normal(0.0, 2.5 * KM, (40, *base.shape))
    model = margin_model(problem)
    scratch = margin_scratch(model, len(x), x.shape[1] - 1)
    slope = Slope(np.zeros(base.shape), np.zeros((len(base), 3)))
    model = model._replace(
        faces=model.faces._replace(ptr=np.zeros(1, np.int64)),
        corners=model.corners._replace(
            cell=np.empty(0, np.int64), radius=np.empty(0), ptr=np.zeros(1, np.int64)
        ),
    )
    smoothed_failure(model, base, np.ascontiguousarray((x - base).transpose(1, 2, 0)), 1e6, slope, scratch)
    wanted = np.array([mission_margin(problem, flight) for flight in x])
    near = np.abs(wanted) < 1e5
    np.testing.assert_allclose(scratch.margins[near], wanted[near], atol=1e-6)
    np.testing.assert_array_equal(np.sign(scratch.margins[~near]), np.sign(wanted[~near]))
    accepted = Deployment.judged(problem, "independent", x).accepted
    clear = np.abs(wanted) > 1.0
    np.testing.assert_array_equal(accepted[clear], wanted[clear] > 0.0)


@pytest.mark.parametrize("formula", sorted(TASKS))
def test_the_ordered_bound_holds_and_is_that_of_the_plain_road(formula: str) -> None:
    """More failures than the bound allows would come by chance less than once in a million."""
    problem = task(formula.removesuffix(", gate closed"), ("gate",) * formula.endswith("closed"), "paper")
    for through in ([(2, 10), (7, 13), (4, 4)], [(2, 10), (5, 13), (16, 10)]):
        path = evaluate_path(problem, along(*through, step=0.9), "by hand", tight=False)
        plain = ordered_bound(problem, path.x, path.cov)
        assert path.objectives.mission_risk_ordered == pytest.approx(plain, abs=1e-9)
        flights = simulate_flights(problem, path.u, 4000, "independent", SeedSequence(1), path.x)
        missed = int((~flights.accepted).sum())
        assert binom.sf(missed - 1, 4000, min(plain + 1e-9, 1.0)) > RARE


def test_the_papers_bound_counts_visits_while_a_region_counts() -> None:
    problem = task("F a", fidelity="paper")
    x = along((2, 10), (16, 10), step=0.9)
    path = evaluate_path(problem, x, "too late", tight=False)
    assert path.objectives.mission_risk_paper == 0.0  # no visit, no witness: its known fault
    early = make_problem(
        "F a", replace(problem.scene, windows={"a": Window("a", 0.0, 16 * DT)}), fidelity="paper"
    )
    path = evaluate_path(early, x, "in time", tight=False)
    visits = theorem2_bound(early, path.x, path.cov, early.locate(path.x))
    assert path.objectives.mission_risk_paper == pytest.approx(visits.sum())
