"""Edges between claims: those that are left out bring nothing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oracle.margin import flight_margin
from pareto_ltl.planning.margin_model import (
    hazards_bar,
    margin_model,
    margin_scratch,
    nearest_order,
    pack_guards,
    shown_letters,
)
from pareto_ltl.planning.pack_logic import LIVE, Reading
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.sampled import Refiner
from pareto_ltl.support.arrays import FloatArray
from plane_logic.margin import Slope, smoothed_failure
from plane_logic.margin_events import Guards
from problems import KM, along, box, make_problem, make_scene, steady_wind
from strategies import formulas

REGIONS = {"a": box(2, 8, 6, 12), "b": box(4, 10, 9, 15), "c": box(12, 8, 16, 12)}  # a and b overlap


@cache
def task(formula: str) -> Problem:
    return make_problem(formula, make_scene(REGIONS))


def letter_margins(rng: np.random.Generator, letters: int, steps: int) -> FloatArray:
    """Margins (T, M) of letters that places show one of, or none."""
    shown = -rng.exponential(1.0, (steps, letters))
    for t in range(steps):
        if letters and rng.random() < 0.7:
            inside = rng.integers(letters)
            depth = -shown[t, inside]
            shown[t] = np.minimum(shown[t], -depth)  # cells do not overlap: the others are as far away
            shown[t, inside] = depth
    return shown


def by_all_claims(logic: Reading, column: list[int], shown: FloatArray) -> FloatArray:
    """W_T(p) by the definition; the margin of a set of letters without the empty one is its best letter's."""
    W = np.full(len(logic.delta), -np.inf)
    W[logic.initial] = np.inf
    for now in shown:
        after = np.full_like(W, -np.inf)
        for q in range(len(W)):
            for p in range(len(W)):
                good = logic.covers[logic.delta[q, [*column, -1]], p]
                inside = now[good[:-1]].max(initial=-np.inf)
                outside = -now[~good[:-1]].max(initial=-np.inf)
                after[p] = max(after[p], min(W[q], outside if good[-1] else inside))
        W = after
    return W


def by_guards(guards: Guards, initial: int, states: int, shown: FloatArray) -> FloatArray:
    W = np.full(states, -np.inf)
    W[initial] = np.inf
    for now in shown:
        after = np.full_like(W, -np.inf)
        for e, (q, p) in enumerate(zip(guards.source, guards.target, strict=True)):
            listed = now[guards.letter[guards.ptr[e] : guards.ptr[e + 1]]].max(initial=-np.inf)
            after[p] = max(after[p], min(W[q], -listed if guards.spared[e] else listed))
        W = after
    return W


@settings(deadline=None, max_examples=150)
@given(formulas("abc"), st.integers(0, 2**32 - 1), st.integers(1, 6))
@example("X b U !a M !c", 1, 3)
def test_edges_that_are_left_out_change_no_margin_of_acceptance(formula: str, seed: int, steps: int) -> None:
    problem, rng = task(formula), np.random.default_rng(seed)
    logic = problem.logic
    column = [int(cells[0]) for cells in shown_letters(problem)]
    guards, accepting = pack_guards(logic, column), logic.distance == 0.0
    for _ in range(5):
        shown = letter_margins(rng, len(column), steps)
        wanted = by_all_claims(problem.reading(0), column, shown)[accepting].max(initial=-np.inf)
        found = by_guards(guards, logic.initial, len(logic.distance), shown)[accepting].max(initial=-np.inf)
        assert found == wanted


@pytest.mark.parametrize(
    ("formula", "patient"),
    [("F(a & F b)", True), ("X X F a", False), ("F(a & X b)", False), ("!b U a", True)],
)
def test_patient_edges_leave_every_claim_as_it_is_where_nothing_is_shown(formula: str, patient: bool) -> None:
    problem = task(formula)
    logic, letters = problem.logic, shown_letters(problem)
    guards = pack_guards(logic, [int(cells[0]) for cells in letters])
    assert guards.patient == patient
    far = np.full((1, len(letters)), -np.inf)
    for q in np.flatnonzero(np.isfinite(logic.distance)):
        held = by_guards(guards, int(q), len(logic.distance), far)
        assert (held[q] == np.inf) or not patient


@pytest.mark.parametrize(
    ("formula", "bar"),
    [
        ("F a", True),
        ("!b U a", True),
        ("F a & (!b U c)", True),  # harmless once c is visited
        ("(!b U a) | F(b & F c)", False),  # b ends one way and begins the other
        ("F(a & X(!b & !c))", False),  # counts steps
    ],
)
def test_hazards_bar_the_way_where_they_end_the_mission_or_do_nothing(formula: str, bar: bool) -> None:
    assert hazards_bar(task(formula).logic) is bar


# --- the order of one path in a large automaton -----------------------------------------------------

GRID = ((3, 0), (8, 0), (13, 0), (16, 5), (12, 8), (7, 8), (2, 8))
SQUARES = {name: box(x, y, x + 2, y + 2) for name, (x, y) in zip("abcdefg", GRID, strict=True)}
COVERAGE = " & ".join(f"F {name}" for name in SQUARES)  # 128 states
TOUR = along((1, 1), *((x + 1, y + 1) for x, y in GRID), step=0.9)


def order_refiner(formula: str) -> Refiner:
    scene = make_scene(SQUARES, start=(1, 1))
    problem = make_problem(formula, scene, steady_wind(scene), fidelity="full")
    return Refiner(problem, margin_model(problem))


@pytest.mark.parametrize("formula", [COVERAGE, f"{COVERAGE} & F(a & F b)", f"{COVERAGE} & (!g U f)"])
@pytest.mark.parametrize("spread", [0.2, 1.2])
def test_the_margin_in_the_order_of_a_path_is_a_lower_limit_and_the_same_near_it(
    formula: str, spread: float
) -> None:
    refiner = order_refiner(formula)
    one = refiner.model_along(TOUR)
    assert len(one.logic.distance) <= LIVE < len(refiner.model.logic.distance)
    rng = np.random.default_rng(4)
    off = np.ascontiguousarray((spread * KM * rng.standard_normal((200, 1, 2))).repeat(len(TOUR), 1))
    off = np.ascontiguousarray(np.moveaxis(off, 0, 2))
    margins = []
    for model in (one, refiner.model):
        scratch = margin_scratch(model, 200, len(TOUR))
        slope = Slope(np.zeros(TOUR.shape), np.zeros((len(TOUR), 3)))
        smoothed_failure(model, TOUR, off, 1e5, slope, scratch)
        margins.append(scratch.margins)
    assert (margins[0] <= margins[1] + 1e-9).all()
    near = np.isclose(*margins, rtol=0.0, atol=1e-9)
    assert near.all() if spread < 1.0 else near.mean() > 0.5
    assert (margins[1] > 0.0).any()


def test_a_path_that_passes_a_place_between_two_steps_has_its_order() -> None:
    refiner = order_refiner(COVERAGE)
    problem = refiner.problem
    in_a = ((SQUARES["a"][0] <= TOUR) & (SQUARES["a"][2] >= TOUR)).all(axis=1)
    assert in_a.any()
    assert problem.logic.distance[problem.states(TOUR[~in_a])[-1]] > 0.0
    assert refiner.model_along(TOUR[~in_a]) is refiner.model_along(TOUR)


@pytest.mark.parametrize("formula", [COVERAGE, f"{COVERAGE} & (!g U f)"])
def test_a_path_beside_the_places_has_the_order_in_which_it_comes_closest(formula: str) -> None:
    refiner = order_refiner(formula)
    beside = TOUR + np.array([0.0, 1.05 * KM])  # 50 m beyond every place that lies in a row
    states = refiner.problem.states(beside)
    assert refiner.problem.logic.distance[states[-1]] > 0.0
    assert refiner.model_along(beside) is refiner.model_along(TOUR)
    order = nearest_order(refiner.model, beside)
    assert set(refiner.problem.states(TOUR).tolist()) <= set(order.tolist())
    half = refiner.model_along(TOUR[: len(TOUR) // 2])  # the other places are far
    assert len(half.logic.distance) <= LIVE


def test_a_path_that_can_read_no_letters_in_any_order_has_no_order() -> None:
    refiner = order_refiner(f"{COVERAGE} & F(a & F(b & F(c & F a)))")
    point = np.array([[9.0, 1.0]]) * KM  # one step: the letters are read once, b first
    assert nearest_order(refiner.model, point).tolist() == [refiner.model.logic.initial]
    assert refiner.model_along(point) is refiner.model


def test_many_hazards_are_polished_in_the_order_of_a_path() -> None:
    places = SQUARES | {f"h{k}": box(0.2 + k, 12, 0.8 + k, 12.6) for k in range(18)}
    scene = make_scene(places, start=(1, 1))
    formula = f"F(a & F(b & F c)) & (({' & '.join(f'!h{k}' for k in range(18))}) U c)"
    problem = make_problem(formula, scene, steady_wind(scene), fidelity="full")
    refiner = Refiner(problem, margin_model(problem))
    assert len(problem.logic.distance) <= 16 < len(problem.logic.hazards.cell)
    assert len(refiner.model_along(TOUR).logic.distance) < len(problem.logic.distance)


def test_a_hazard_that_is_met_between_two_steps_may_lead_to_acceptance() -> None:
    places = {"a": box(15, 15, 17, 17), "b": box(8, 0, 10, 2), "c": box(16, 0, 18, 2)}
    scene = make_scene(places, start=(1, 1))
    problem = make_problem("(!b U a) | F(b & F c)", scene, steady_wind(scene), fidelity="full")
    model, x = margin_model(problem), np.array([[1.0, 1], [5, 1], [13, 1], [17, 1]]) * KM
    assert not model.guards.barring
    scratch, slope = margin_scratch(model, 1, len(x)), Slope(np.zeros(x.shape), np.zeros((len(x), 3)))
    smoothed_failure(model, x, np.zeros((len(x), 2, 1)), 100.0, slope, scratch)  # b is far from all steps
    assert scratch.margins[0] == pytest.approx(min(flight_margin(problem, x), 1e18), abs=1e-6)
    assert scratch.margins[0] > 0.0
