"""One step of growth at a time: samples, steering, the choice of a parent."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence

from pareto_ltl.kernels import tree as kernel
from pareto_ltl.kernels.data import Motion
from pareto_ltl.planning import growth
from pareto_ltl.planning.product_graph import fans, product
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.world.cells import Decomposition
from problems import KM, RARE, box, chi_square_chance, make_problem, make_scene, steady_wind

some = settings(deadline=None, max_examples=60)
within = st.floats(-50.0, 50.0)


# --- samples -----------------------------------------------------------------------------------------


def test_samples_of_a_cell_are_uniform():
    """Counts in the parts that a grid cuts out of an irregular cell, against their areas."""
    other = box(-9, -9, -8, -8)
    cell = np.array([[0, 0], [6, 1], [7, 4], [3, 8], [1, 5]]) * KM
    decomposition = Decomposition((other, cell), (frozenset(),) * 2, np.empty((0, 2), np.int64), (), {})
    fan, rng, n = fans(decomposition), np.random.default_rng(5), 6000
    points = np.array([kernel.sample_cell(fan, 1, rng) for _ in range(n)])
    squares = [shapely.box(x, y, x + KM, y + KM) for x in np.arange(8) * KM for y in np.arange(9) * KM]
    areas = shapely.area(shapely.intersection(shapely.Polygon(cell), squares))
    counts = np.array([shapely.contains_xy(square, points).sum() for square in squares], float)
    assert counts[areas == 0].sum() == 0
    assert counts.sum() == n
    big = areas > 0.1 * KM**2  # bins of less expect too few draws for the chi-square law
    expected = n * areas / areas.sum()
    rest = [counts[~big].sum()], [expected[~big].sum()]
    chance = chi_square_chance(np.append(counts[big], rest[0]), np.append(expected[big], rest[1]))
    assert chance > RARE


# --- steering ----------------------------------------------------------------------------------------


def steered(motion, start, wind, target):
    """One step from ``start`` towards ``target`` in a given wind; the new point, the control, success."""
    x, drifted = np.array([start]), (motion.a @ start + motion.dt * np.array(wind))[None]
    px, py, moved = kernel.steer(motion, x, drifted, 0, motion.u_max, *target)
    u = motion.b_inv @ (np.array([px, py]) - drifted[0]) / motion.dt
    return np.array([px, py]), u, moved


def robot(b=((1.0, 0.0), (0.0, 1.0)), a=((1.0, 0.0), (0.0, 1.0))):
    return Motion(
        np.array(a), np.array(a), 0.0, 0.0, 0.0, 0.0, 0.0, np.linalg.inv(np.array(b)), 100.0, 10.0, 2.0
    )


MODELS = [robot(), robot(b=((0.9, 0.2), (-0.1, 1.1)), a=((1.001, 0.002), (-0.003, 0.998)))]


@some
@given(
    st.sampled_from(MODELS), st.tuples(within, within), st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
    st.tuples(within, within),
)  # fmt: skip
def test_a_step_ends_on_the_line_at_the_target_or_at_full_airspeed(motion, start, wind, target):
    start, target = KM * np.array(start), KM * np.array(target)
    distance = math.dist(start, target)
    assume(distance > 1.0)
    end, u, moved = steered(motion, start, wind, target)
    if not moved:
        return
    along = (target - start) / distance
    progress = float((end - start) @ along)
    assert progress >= -1e-6
    np.testing.assert_allclose(end, start + progress * along, atol=1e-5)
    assert np.linalg.norm(u) <= motion.u_max * kernel.ROUNDING
    if abs(progress - distance) > 1e-6:
        assert np.linalg.norm(u) == pytest.approx(motion.u_max, rel=1e-9)
    if progress < distance - 1e-6:
        ahead = start + (progress + 1.0) * along  # one metre farther would be too fast
        beyond = motion.b_inv @ (ahead - motion.a @ start - motion.dt * np.array(wind)) / motion.dt
        assert np.linalg.norm(beyond) > motion.u_max


def test_still_air_gives_a_full_step_and_tail_wind_a_longer_one():
    target = (100 * KM, 0.0)
    for wind, reach in (
        ((0.0, 0.0), 1000.0),
        ((4.0, 0.0), 1400.0),
        ((-4.0, 0.0), 600.0),
        ((0.0, 6.0), 800.0),
    ):
        end, _, moved = steered(robot(), np.zeros(2), wind, target)
        assert moved
        np.testing.assert_allclose(end, [reach, 0.0], atol=1e-6)


@pytest.mark.parametrize("wind", [(-10.5, 0.0), (0.0, 10.5), (-7.5, 7.5)])
def test_wind_that_cannot_be_stemmed_ends_the_extension(wind):
    assert not steered(robot(), np.zeros(2), wind, (100 * KM, 0.0))[2]


def test_strong_wind_from_behind_still_allows_steps_along_it():
    end, u, moved = steered(robot(), np.zeros(2), (15.0, 0.0), (100 * KM, 0.0))
    assert moved
    np.testing.assert_allclose(end, [2500.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(u, [10.0, 0.0], atol=1e-9)


def test_every_step_obeys_the_airspeed_even_where_the_wind_overshoots_the_target():
    """The wind carries the robot 1500 m, its motors hold back 1000 m: a target 100 m off is flown past."""
    end, u, moved = steered(robot(), np.zeros(2), (15.0, 0.0), (100.0, 0.0))
    assert moved
    assert np.linalg.norm(u) <= 10.0 * kernel.ROUNDING
    np.testing.assert_allclose(end, [500.0, 0.0], atol=1e-6)


def test_a_target_under_the_robot_is_no_move():
    assert not steered(robot(), np.array([5.0, 5.0]), (0.0, 0.0), (5.0, 5.0))[2]


# --- the choice of a parent ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem():
    """Any order of b and c after a: the states "b is left" and "c is left" cannot be compared."""
    scene = make_scene({"a": box(1, 1, 3, 3), "b": box(16, 1, 18, 3), "c": box(1, 16, 3, 18)}, start=(10, 10))
    return make_problem("F(a & F b & F c)", scene, steady_wind(scene))


class Bench:
    """A tree whose vertices are put where a test wants them."""

    def __init__(self, problem, beta=(0.0, 0.0)):
        cfg = PlannerConfig(trees=1, n_max=50)
        graph = product(problem.decomposition, problem.tables.logic, problem.scene.bounds)
        self.problem = problem
        self.nursery = growth._plant(
            cfg, problem, graph, SeedSequence(0), number=0, swaps=False, stop=False, reselect=True
        )
        self.nursery.habits = self.nursery.habits._replace(beta_length=beta[0], beta_risk=beta[1])

    def state(self, *visits):
        automaton = self.problem.automaton
        q = automaton.initial
        for name in visits:
            q = automaton.step(q, {name})
        return q

    def add(self, x, q, length, risk=(-1.0, -1.0, -1.0)):
        """A vertex at ``x`` [km] that came ``length`` [km] in automaton state ``q``."""
        p, n = self.problem, self.nursery
        n.growing.risks[1] = risk
        x, y = np.array(x) * KM
        cell = int(p.locate(np.array([[x, y]]))[0])
        return kernel.add_vertex(
            p.tables, n.vertices, n.growing, n.habits, x, y, cell, q, 0, length * KM, n.rng
        )

    def choose(self, x, original):
        """The parent that a new vertex at ``x`` [km], reached from ``original``, is given."""
        p, n = self.problem, self.nursery
        x, y = np.array(x) * KM
        cell = int(p.locate(np.array([[x, y]]))[0])
        v = n.vertices
        length = v.length[original] + math.dist(v.x[original], (x, y))
        kernel.price(p.tables, v, original, cell, x, y, n.growing.risks, 1)
        q = int(p.tables.logic.delta[v.q[original], cell])
        parent, q_new, length_new = kernel.choose_parent(
            p.tables, v, n.growing, n.habits, x, y, cell, original, q, length, n.rng
        )
        assert length_new == pytest.approx(v.length[parent] + math.dist(v.x[parent], (x, y)))
        assert q_new == p.tables.logic.delta[v.q[parent], cell]
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
    chosen, v = bench.choose((9.5, 9.5), vertices[0]), bench.nursery.vertices

    def objectives(vertex):
        return np.array([v.length[vertex] + math.dist(v.x[vertex], (9500.0, 9500.0)), *v.risk[vertex, :2]])

    if chosen != vertices[0]:
        gain = objectives(chosen) - objectives(vertices[0])
        assert gain.min() < 0
        assert np.all(gain <= np.array([slack * KM, more_risk, more_risk]) + 1e-9)
    else:  # then nobody dominates it
        assert not any(np.all(objectives(w) < objectives(chosen)) for w in vertices[1:])
