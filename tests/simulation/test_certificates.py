"""Certificates: flights that keep to their lines succeed, by the verdict of the simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flown import succeeds
from pareto_ltl.kernels.claims import ClaimCosts, ClaimEdges, cheapest_claims
from pareto_ltl.planning.problem import Problem
from pareto_ltl.simulation.certificates import (
    LEAST_SD,
    Landscape,
    claim_edges,
    find_certificate,
    landscape,
)
from pareto_ltl.support.arrays import FloatArray
from problems import KM, along, box, make_problem, make_scene

REGIONS = {
    "a": box(12, 2, 17, 7), "b": box(15, 4, 19, 9), "c": box(3, 12, 8, 17), "h": box(9, 8, 12, 12),
}  # fmt: skip
OBSTACLES = [box(7, 0.5, 9, 6), box(10, 14, 14, 16)]
CONCAVE = {"a": np.array([[12, 2], [18, 2], [18, 8], [15, 5], [12, 8]]) * KM}
FORMULAS = (
    "F(a & F c)", "F(a & b) & F c", "F a | F(b & F c)", "!h U a", "!h U (a & b)", "F(a & X a)",
    "!c U (a & F c)", "(!h U a) | F(b & F c)",
)  # fmt: skip
WAY = ((2, 3), (5, 8), (13.5, 4), (16, 5), (13, 7.6), (8.5, 7.5), (6, 14))  # to a, to a & b, to c


def task(formula: str, regions: dict[str, FloatArray] = REGIONS, border: str = "open") -> Problem:
    scene = replace(make_scene(regions, OBSTACLES, start=(2.0, 3.0)), border=border)
    return make_problem(formula, scene, fidelity="full")


TASKS = {formula: task(formula) for formula in FORMULAS} | {
    "concave": task("F a", CONCAVE),
    "wall": task("F(a & F c)", border="wall"),
}


def seen_from(problem: Problem, x: FloatArray, sd: float) -> Landscape:
    return landscape(problem, x, np.tile(sd**2 * np.eye(2), (len(x), 1, 1)))


def keeps(scape: Landscape, lines, flights: FloatArray) -> FloatArray:
    """Which of ``flights`` (n, T+1, 2) keep to all lines, (n,)."""
    at = flights[:, lines.step]
    return np.all(np.einsum("nki,ki->nk", at, lines.normal) <= lines.offset - 1.0, axis=1)


on_map = st.tuples(st.floats(0.5, 19.5), st.floats(0.5, 19.5))


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(list(TASKS)), st.lists(on_map, min_size=1, max_size=4), st.integers(0, 2**32 - 1))
def test_flights_that_keep_to_the_lines_succeed(name, corners, seed):
    """The plan is a detour of a good way, the flight another one near it, the others near that flight."""
    problem, rng = TASKS[name], np.random.default_rng(seed)
    x = along(WAY[0], *corners[:-1], *WAY[1:], corners[-1], step=1.0)
    scape = seen_from(problem, x, sd=400.0)
    y = x + rng.uniform(0, 800) * rng.uniform(-1, 1, x.shape)
    lines = find_certificate(scape, y, ())
    if lines is None:
        return
    assert succeeds(problem, y)
    flights = y + rng.uniform(0, 600, (200, 1, 1)) * rng.uniform(-1, 1, (200, *y.shape))
    for flight in flights[keeps(scape, lines, flights)]:
        assert succeeds(problem, flight)


@pytest.mark.parametrize("name", list(TASKS))
def test_a_good_way_has_a_certificate_and_every_line_of_it_counts_at_its_step(name):
    """Otherwise the test above tests nothing."""
    problem = TASKS[name]
    x = along(*WAY, step=1.0)
    lines = find_certificate(seen_from(problem, x, sd=400.0), x, ())
    assert succeeds(problem, x)
    assert lines is not None
    assert len(lines) == len(set(lines.key)) > 3
    assert np.linalg.norm(lines.normal, axis=1) == pytest.approx(1.0)
    assert np.all(np.einsum("ki,ki->k", x[lines.step], lines.normal) < lines.offset)
    assert lines.sd == pytest.approx(400.0)


def all_edges(problem: Problem) -> ClaimEdges:
    """Every edge between claims, cell by cell, needless or not."""
    logic = problem.reading(0)
    labelled = [c for c, label in enumerate(problem.labels) if label]
    rows, shunned = [], []
    for q, p in np.ndindex(len(logic.delta), len(logic.delta)):
        if logic.covers[logic.delta[q, -1], p]:
            rows.append((q, p, -1))
            shunned.append(
                [
                    g
                    for g, c in enumerate(labelled)
                    if not logic.covers[logic.delta[q, c], p] and not logic.loses[q, c]
                ]
            )
        for g, c in enumerate(labelled):
            if logic.covers[logic.delta[q, c], p] and not logic.loses[q, c]:
                rows.append((q, p, g))
                shunned.append([])
    source, target, shown = np.array(rows).T.copy()
    cells = np.array([g for own in shunned for g in own], np.int64)
    return ClaimEdges(
        source, target, shown, np.cumsum([0, *map(len, shunned)]), cells,
        logic.loses[None][:, :, logic.hazards.cell].copy(), np.array([0, len(source)]), np.zeros(1, np.int64),
    )  # fmt: skip


def cheapest(problem, edges, costs):
    """What the cheapest run over ``edges`` costs."""
    logic, steps, states = problem.logic, len(costs[0]), len(problem.automaton.delta)
    least, via = np.empty((steps + 1, states)), np.empty((steps, states), np.int64)
    least[0] = np.where(logic.covers[logic.initial], 0.0, np.inf)
    cheapest_claims(edges, costs, least, via)
    return least[-1, logic.distance == 0.0].min()


def random_costs(rng, labelled, edges):
    costs = ClaimCosts(*(rng.uniform(0, 1, (6, n)) for n in (labelled, labelled, edges.loses.shape[2])))
    for table in costs:
        table[rng.random(table.shape) < 0.3] = np.inf
    return costs


@settings(deadline=None, max_examples=100)
@given(st.sampled_from(FORMULAS), st.integers(0, 2**32 - 1))
def test_edges_that_are_left_out_are_not_missed(formula, seed):
    """Random costs: the cheapest run over all edges costs as much as over those that are kept."""
    problem, rng = TASKS[formula], np.random.default_rng(seed)
    labelled = [c for c, label in enumerate(problem.labels) if label]
    kept = claim_edges(problem.logic, labelled, [[g] for g in range(len(labelled))])
    edges = all_edges(problem)
    assert len(kept.source) < len(edges.source)
    costs = random_costs(rng, len(labelled), edges)
    assert cheapest(problem, edges, costs) == pytest.approx(cheapest(problem, kept, costs))


@pytest.mark.parametrize("formula", FORMULAS)
def test_claims_that_large_automata_look_at_are_enough(formula, monkeypatch):
    """No run is cheaper than over all edges, and where nothing is lost between steps none costs more."""
    monkeypatch.setattr("pareto_ltl.simulation.certificates.LIVE", 1)
    problem, rng = TASKS[formula], np.random.default_rng(6)
    labelled = [c for c, label in enumerate(problem.labels) if label]
    kept = claim_edges(problem.logic, labelled, [[g] for g in range(len(labelled))])
    edges = all_edges(problem)
    for _ in range(30):
        costs = random_costs(rng, len(labelled), edges)
        ours, theirs = cheapest(problem, kept, costs), cheapest(problem, edges, costs)
        assert ours >= theirs - 1e-12
        if not len(problem.logic.hazards.cell):
            assert ours == pytest.approx(theirs)


def test_edges_of_a_large_automaton_are_as_many_as_its_transitions():
    names = "abcdefgh"
    regions = {name: box(2 + 2 * k, 3, 3 + 2 * k, 5) for k, name in enumerate(names)}
    problem = make_problem(" & ".join(f"F {name}" for name in names), make_scene(regions, start=(1.0, 1.0)))
    labelled = [c for c, label in enumerate(problem.labels) if label]
    edges = claim_edges(problem.logic, labelled, [[g] for g in range(len(labelled))])
    assert len(problem.automaton.delta) == 256
    assert len(edges.source) == 256 * (1 + 8)


def test_a_flight_that_fails_has_none():
    problem = TASKS["F(a & F c)"]
    for way in (WAY[:5], WAY[::-1], ((2, 3), (13.5, 4), (6, 14))):  # no c; a after c; through an obstacle
        x = along(*way, step=1.0)
        assert not succeeds(problem, x)
        assert find_certificate(seen_from(problem, x, sd=400.0), x, ()) is None


def test_faces_that_are_broken_are_not_rested_on():
    """Another visit takes the place of the one whose line is broken, as long as there is one."""
    problem = TASKS["F a | F(b & F c)"]
    x = along((2, 3), (5, 8), (13.5, 4), (14.5, 4), step=0.5)
    scape = seen_from(problem, x, sd=400.0)
    broken: set[tuple[float, ...]] = set()
    visits = []
    while (lines := find_certificate(scape, x, broken)) is not None:
        own = [key for key in lines.key if len(key) == 2 and key[1] < scape.shown[-1].stop]
        assert own
        assert not broken.intersection(own)
        visits.append(own[0][0])
        broken.update(own)
    inside = (x > [12 * KM, 2 * KM]).all(axis=1) & (x < [17 * KM, 7 * KM]).all(axis=1)
    assert sorted(set(visits)) == np.flatnonzero(inside).tolist()


def test_each_visit_is_the_one_least_likely_to_be_missed():
    problem = TASKS["F(a & F c)"]
    corners = (2, 3), (5, 8), (12.2, 6.6), (14.5, 4.5), (12.4, 6.8), (7.8, 12.5), (5.5, 14.5), (3.2, 16.8)
    x = along(*corners, step=0.5)
    scape = seen_from(problem, x, sd=400.0)
    lines = find_certificate(scape, x, ())
    assert lines is not None
    visits = {key[0] for key in lines.key if len(key) == 2 and key[1] < scape.shown[-1].stop}
    middles = np.array([[14.5, 4.5], [5.5, 14.5]]) * KM
    assert visits == {int(np.abs(x - middle).max(axis=1).argmin()) for middle in middles}


def test_a_line_along_the_way_passes_a_corner_that_no_face_clears():
    """From one side of an obstacle to another, close to its corner: no face has both ends beyond it."""
    scene = make_scene({"a": box(12, 12, 18, 18)}, [box(6, 2, 10, 6)], start=(2.0, 2.0))
    problem = make_problem("F a", scene, fidelity="full")
    x = np.array([[2.0, 2.0], [3.0, 3.0], [5.5, 5.8], [7.0, 7.0], [14.0, 14.0]]) * KM
    lines = find_certificate(seen_from(problem, x, sd=100.0), x, ())
    assert lines is not None
    touching = [i for i, key in enumerate(lines.key) if len(key) > 2]
    assert {int(lines.step[i]) for i in touching} >= {2, 3}
    for i in touching:
        gap = lines.offset[i] - np.array([[6, 2], [10, 2], [10, 6], [6, 6]]) * KM @ lines.normal[i]
        assert gap.max() == pytest.approx(0.0, abs=1e-6)  # the obstacle lies beyond the line and touches it


def test_positions_that_are_certain_need_no_line():
    problem = TASKS["F(a & F c)"]
    x = along(*WAY, step=1.0)
    scape = seen_from(problem, x, sd=0.0)
    lines = find_certificate(scape, x, ())
    assert lines is not None
    assert len(lines) == 0
    assert scape.sd.max() == LEAST_SD
