"""The choice of a parent: Eqs. (11) and (12)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence

from pareto_ltl.kernels import tree as kernel
from pareto_ltl.kernels.parents import Candidate, Dominance, improves
from pareto_ltl.planning import growth
from pareto_ltl.planning.growth import GrowthOptions
from pareto_ltl.planning.product_graph import cell_fans, product_graph
from pareto_ltl.planning.tree_models import tree_models
from pareto_ltl.settings import PlannerConfig
from plane_kernels.types import Point
from problems import KM, box, make_problem, make_scene, steady_wind


@pytest.fixture(scope="module")
def problem():
    """Any order of b and c after a: the states "b is left" and "c is left" cannot be compared."""
    scene = make_scene({"a": box(1, 1, 3, 3), "b": box(16, 1, 18, 3), "c": box(1, 16, 3, 18)}, start=(10, 10))
    return make_problem("F(a & F b & F c)", scene, steady_wind(scene))


class Bench:
    """A tree whose vertices are put where a test wants them."""

    def __init__(self, problem, beta=(0.0, 0.0)):
        cfg = PlannerConfig(trees=1, n_max=50)
        graph = product_graph(problem.decomposition, problem.logic, problem.scene.bounds)
        grove = growth.GrowthTask(cfg, problem, tree_models(problem), graph, cell_fans(problem.decomposition))
        self.problem = problem
        self.tree = growth.plant_tree(grove, SeedSequence(0), 0, GrowthOptions())
        search = self.tree.search
        rule = search.settings.rule._replace(beta_length=beta[0], beta_risk=beta[1])
        self.search = search._replace(settings=search.settings._replace(rule=rule))

    def state(self, *visits):
        automaton = self.problem.automaton
        q = automaton.initial
        for name in visits:
            q = automaton.step(q, {name})
        return q

    def place(self, x):
        """The point at ``x`` [km] and its cell."""
        point = np.array(x) * KM
        return Point(*point), int(self.problem.locate(point[None])[0])

    def add(self, x, q, length, risk=(-1.0, -1.0, -1.0)):
        """A vertex at ``x`` [km] that came ``length`` [km] in automaton state ``q``."""
        self.search.state.risks[kernel.BEST] = risk
        there, cell = self.place(x)
        return kernel.add_vertex(self.search, there, cell, q, 0, length * KM, self.tree.rng)

    def choose(self, x, original):
        """The parent that a new vertex at ``x`` [km], reached from ``original``, is given."""
        s, (there, cell) = self.search, self.place(x)
        v, delta = s.tree, s.world.mission.logic.delta[0]
        length = v.length[original] + math.dist(v.x[original], there)
        q = int(delta[v.q[original], cell])
        first = kernel.propose(s, original, there, cell, q, kernel.BEST)
        kernel.appraise(s, first)
        parent, q_new, length_new = kernel.choose_parent(s, first, length, self.tree.rng)
        assert length_new == pytest.approx(v.length[parent] + math.dist(v.x[parent], there))
        assert q_new == delta[v.q[parent], cell]
        return parent


def test_a_shorter_way_in_the_same_state_is_taken(problem):
    bench = Bench(problem)
    q = bench.state("a")
    longer, shorter = bench.add((9, 10), q, 20), bench.add((10, 9), q, 15)
    assert bench.choose((9.5, 9.5), longer) == shorter
    assert bench.choose((9.5, 9.5), shorter) == shorter


def test_a_shorter_way_that_forgets_a_visit_is_not_taken(problem):
    bench = Bench(problem)
    ahead, behind = bench.add((9, 10), bench.state("a", "b"), 20), bench.add((10, 9), bench.state("a"), 5)
    assert bench.choose((9.5, 9.5), ahead) == ahead
    assert bench.choose((9.5, 9.5), behind) == behind  # 15 km more are not paid for progress while beta = 0


def test_states_that_cannot_be_compared_are_not_exchanged(problem):
    """Both are one visit from the end and d_A is equal, but they lack different regions."""
    bench = Bench(problem, beta=(50 * KM, 1.0))
    b_left, c_left = bench.state("a", "c"), bench.state("a", "b")
    assert problem.automaton.distance[b_left] == problem.automaton.distance[c_left] == 1
    longer = bench.add((9, 10), b_left, 20)
    bench.add((10, 9), c_left, 5)
    assert bench.choose((9.5, 9.5), longer) == longer


def test_progress_may_cost_up_to_beta(problem):
    for beta, taken in ((14.0, False), (16.0, True)):
        bench = Bench(problem, beta=(beta * KM, 0.0))
        behind, ahead = bench.add((9, 10), bench.state("a"), 5), bench.add((10, 9), bench.state("a", "b"), 20)
        assert (bench.choose((9.5, 9.5), behind) == ahead) == taken


def test_a_risk_may_grow_up_to_beta(problem):
    for beta, taken in ((0.0, False), (0.02, False), (0.04, True)):
        bench = Bench(problem, beta=(0.0, beta))
        q = bench.state("a")
        safe, short = bench.add((9, 10), q, 20, (0.01, -1, -1)), bench.add((10, 9), q, 15, (0.04, -1, -1))
        assert (bench.choose((9.5, 9.5), safe) == short) == taken


@pytest.mark.parametrize(("longer", "allowed"), [(9.0, True), (11.0, False)])
def test_a_lower_risk_may_cost_at_most_the_slack_of_length(longer, allowed):
    slack = Dominance(beta_length=10.0, beta_risk=0.0)
    risks = np.array([[0.01], [0.02]])
    new, old = Candidate(1.0, 100.0 + longer, 0), Candidate(1.0, 100.0, 1)
    assert improves(slack, risks, new, old, False) == allowed  # Eq. (11)
    assert improves(slack, risks, new, old, True)  # Eq. (12) alone


def test_a_parent_out_of_reach_is_not_taken(problem):
    bench = Bench(problem)
    q = bench.state("a")
    near, far = bench.add((9, 10), q, 20), bench.add((10.6, 9.5), q, 5)
    assert bench.choose((9.5, 9.5), near) == near
    assert bench.choose((9.7, 9.5), near) == far


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_a_chain_of_exchanges_still_improves_on_the_original(problem, seed):
    """Each is better than the one before in something; the last must be so than the first (Eqs. 11, 12)."""
    rng = np.random.default_rng(seed)
    slack, more_risk = rng.uniform(0, 5), rng.uniform(0, 0.5)
    bench = Bench(problem, beta=(slack * KM, more_risk))
    q = bench.state("a")
    vertices = [
        bench.add(
            rng.uniform(9, 10, 2), q, rng.uniform(18, 22), (rng.uniform(0, 0.5), rng.uniform(0, 0.5), -1)
        )
        for _ in range(8)
    ]
    chosen, v = bench.choose((9.5, 9.5), vertices[0]), bench.search.tree

    def objectives(vertex):
        return np.array([v.length[vertex] + math.dist(v.x[vertex], (9500.0, 9500.0)), *v.risk[vertex, :2]])

    if chosen != vertices[0]:
        gain = objectives(chosen) - objectives(vertices[0])
        assert gain.min() < 0
        assert np.all(gain <= np.array([slack * KM, more_risk, more_risk]) + 1e-9)
    else:  # then nobody dominates it
        assert not any(np.all(objectives(w) < objectives(chosen)) for w in vertices[1:])
