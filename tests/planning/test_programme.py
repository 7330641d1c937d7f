"""The convex programme: against the solver of the sweeps, and its chance constraints on the front."""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from itertools import cycle, islice

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.stats import norm

from pareto_ltl.extend import draw_flights
from pareto_ltl.planning.convex import programme
from pareto_ltl.planning.convex.programme import Descent
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.prices import segment_limits
from pareto_ltl.planning.refine import Effort, sampled_paths
from pareto_ltl.planning.refine.effort import Polish
from pareto_ltl.planning.refine.sampled import ConstrainedRefiner, Refiner
from pareto_ltl.planning.refine.starts import first_starts
from pareto_ltl.planning.refine.sweep import first_of
from pareto_ltl.planning.separation import barrier_names, breach_text, separation, within_limits
from pareto_ltl.settings import PlannerConfig, RefineConfig, RobotConfig, preset
from pareto_ltl.support.arrays import square_matrices
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_verify.gaussians import segment_risks
from pareto_ltl_verify.geometry import beyond_bounds, convex
from problems import box, make_problem, make_scene, smooth_wind
from solves import next_means

PLANNER = PlannerConfig(trees=3, n_max=600)
REFINE = RefineConfig(flights=300, sweep_flights=100, classes=2, points=5)
ANGLES = np.linspace(0.0, 2.0 * np.pi, 1440, endpoint=False)
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


def task(planner=PLANNER, border="wall"):
    """Two regions with two obstacles between them, and walls."""
    scene = make_scene(
        {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)},
        [box(7, 1, 9, 6), box(10, 9, 13, 12)],
        start=(2.0, 3.0),
    )
    scene = replace(scene, border=border)
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=100.0)
    wind = smooth_wind(scene, speed=1.5, sd=0.3, gust=0.3)
    models = replace(preset("full"), border=border)
    return make_problem("F(a & F b)", scene, wind, robot, planner, fidelity=models)


@pytest.fixture(scope="module")
def grown():
    problem = task()
    return problem, grow_forest(PLANNER, problem, SeedSequence(3))


@pytest.fixture(scope="module")
def lines(grown):
    """Means of starts."""
    return [start.x for start in first_starts(*grown).values()]


def swept_risks(problem, x):
    """Σ_j Φ(-z_j) of every segment by a sweep of directions, each polygon and wall for itself."""
    cov = square_matrices(propagate(problem, x).cov)
    sd = np.sqrt(np.einsum("ki,tij,kj->tk", DIRECTIONS, cov, DIRECTIONS))
    total = np.zeros(len(x) - 1)
    for polygon in problem.decomposition.obstacles:
        z = (x @ DIRECTIONS.T - (polygon @ DIRECTIONS.T).max(axis=0)) / sd
        total += norm.cdf(-np.minimum(z[:-1], z[1:]).max(axis=1))
    low, high = problem.scene.bounds
    for k, (along, gap) in enumerate([(0, x - low), (1, x - low), (0, high - x), (1, high - x)]):
        z = gap[:, k % 2] / np.sqrt(cov[:, along, along])
        total += norm.cdf(-np.minimum(z[:-1], z[1:]))
    return total


def some_descent(rng, x, problem):
    """A random quadratic model of a failure."""
    root = rng.normal(size=(len(x), 2, 2)) / problem.reach
    hessian = np.einsum("tij,tkj->tik", root, root)
    gradient = rng.normal(size=(len(x), 2)) / problem.reach
    return Descent(gradient, np.ascontiguousarray(hessian[:, [0, 0, 1], [0, 1, 1]]), 1.0)


def model_value(problem, model, x, y):
    """g'd + ½ d'Hd with the ridge of both solvers, relative to the failure."""
    d = (y - x) / problem.reach
    h = model.hessian * problem.reach**2 + [1e-4, 0.0, 1e-4]
    quadratic = h[:, 0] * d[:, 0] ** 2 + 2.0 * h[:, 1] * d[:, 0] * d[:, 1] + h[:, 2] * d[:, 1] ** 2
    return float((model.gradient * problem.reach * d).sum() + 0.5 * quadratic.sum())


def test_both_solvers_of_a_step_find_the_same_value(grown, lines):
    """Without a line in reach the two programmes are the same; the sweep's ends at a gap of 1e-6."""
    problem = task(PlannerConfig(trees=3, n_max=600, epsilon=None), border="open")
    problem = replace(problem, decomposition=replace(problem.decomposition, obstacles=()))
    rng, refiner = np.random.default_rng(5), Refiner(problem, margin_model(problem))
    gaps = []
    for x in islice(cycle(lines), 200):
        flight = refiner.flown(x)
        model = some_descent(rng, flight.x, problem)
        longest = 1.02 * float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
        one = programme.programme_for(problem, len(flight.u)).descend(flight, model, 0.3, longest)
        other = next_means(problem, flight, model, 0.3, longest)
        values = [model_value(problem, model, flight.x, y) for y in (one.x, other)]
        gaps.append(abs(values[0] - values[1]) / (1.0 + abs(values[1])))
    assert max(gaps) < 1e-5
    assert np.median(gaps) < 2e-6


def test_larger_programmes_have_the_same_solution(grown, lines):
    problem, _ = grown
    x, refiner = lines[0], Refiner(problem, margin_model(problem))
    flight, model = refiner.flown(x), some_descent(np.random.default_rng(8), x, problem)
    ways = [
        programme.programme(problem, len(x) - 1 + more).descend(flight, model, 0.2, 1e9).x for more in (0, 9)
    ]
    np.testing.assert_allclose(ways[0], ways[1], atol=0.01 * problem.reach)


def test_risks_of_lines_and_of_all_other_polygons_are_the_risk_of_a_segment(monkeypatch):
    """Between two rows of boxes more polygons than lines count: the programme leaves them their risks."""
    walls = [box(4.0 * k, low, 4.0 * k + 2.5, low + 4.0) for k in range(5) for low in (3.0, 12.5)]
    scene = make_scene({"a": box(18, 9, 20, 11)}, walls, start=(1.0, 10.0))
    robot = RobotConfig(dt=300.0, u_max=12.0, start_sd=2000.0)
    wind = smooth_wind(scene, speed=1.5, sd=0.3, gust=0.3)
    problem = make_problem("F a", scene, wind, robot, PLANNER, fidelity=preset("full"))
    x = np.column_stack([np.linspace(1000.0, 19000.0, 8), np.full(8, 10000.0)])
    flight = propagate(problem, x)
    lines = separation(problem, flight)
    apart = lines.elsewhere
    assert apart.max() > 0.2 * lines.risk.max()
    gaps = np.einsum("tki,tei->tek", lines.normal, np.stack([x[:-1], x[1:]], axis=1))
    z = (gaps - lines.offset[:, None]) / lines.sd
    rows = np.where(lines.owner >= 0, norm.cdf(-z.min(axis=1)), 0.0).sum(axis=1)
    np.testing.assert_allclose(rows + apart, lines.risk, atol=1e-9)
    given = {}
    monkeypatch.setattr(programme.Programme, "_solved", lambda self, values, x: given.update(values))
    descent = some_descent(np.random.default_rng(1), x, problem)
    programme.programme(problem, len(x) - 1).descend(flight, descent, 0.3, 1e9)
    limit = np.maximum(0.96 * problem.epsilon - apart, 0.1 * problem.epsilon)
    np.testing.assert_allclose(given["left"], limit)


def test_a_polish_brings_the_risk_of_every_segment_below_epsilon(grown, lines):
    problem, _ = grown
    flights = draw_flights(problem, "coherent", 300, SeedSequence(1))
    refiner = ConstrainedRefiner(problem, margin_model(problem))
    risky = [x for x in lines if separation(problem, refiner.flown(x)).risk.max() > 2.0 * problem.epsilon]
    after = []
    for x in risky:
        longest = 1.1 * np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
        found = refiner.polish(x, flights, Polish((200.0,), 10), longest)
        after.append(separation(problem, found.flight).risk.max() / problem.epsilon)
    # The others pass gaps that are too narrow for epsilon at their length: they come as close as they can.
    assert len(risky) >= 6
    assert sum(one <= 1.0 for one in after) >= len(risky) // 2
    assert np.median(after) <= 1.05
    assert sum(one.solves for one in programme.programmes_of(problem).values()) >= len(risky)


def test_every_refined_path_ends_in_the_programme_and_keeps_epsilon(grown, monkeypatch):
    problem, forest = grown
    solved = []
    descend = programme.Programme.descend
    monkeypatch.setattr(programme.Programme, "descend", lambda *args: solved.append(1) or descend(*args))
    flights = draw_flights(problem, "coherent", REFINE.flights, SeedSequence(5))
    found = sampled_paths(Effort.of(REFINE), problem, forest, first_of(flights))
    paths = within_limits(problem, found)
    assert len(solved) >= len(found) > 1
    assert len(paths) > 1
    for path in paths:
        ours = separation(problem, propagate(problem, path.x)).risk
        swept = swept_risks(problem, path.x)
        assert (ours <= swept + 1e-4).all()  # a polygon behind another one counts once
        assert ours.max() <= problem.epsilon * (1.0 + 1e-5)


def test_paths_that_break_epsilon_are_counted(grown, lines, caplog):
    problem, _ = grown
    paths = [evaluate_path(problem, x, "start", tolerance=1.0) for x in lines]
    risk = np.array([separation(problem, propagate(problem, x)).risk.max() for x in lines])
    middle = float(np.sort(risk)[len(risk) // 2 - 1 : len(risk) // 2 + 1].mean())
    with caplog.at_level(logging.INFO):
        kept = within_limits(replace(problem, epsilon=middle), paths)
    assert [path.x.tobytes() for path in kept] == [
        path.x.tobytes() for path, own in zip(paths, risk, strict=True) if own < middle
    ]
    assert f"{(risk > middle).sum()} of {len(lines)} refined paths are not on the front" in caplog.text


def test_the_least_epsilon_is_named_and_admits_a_path(grown, lines):
    problem, _ = grown
    x = max(lines, key=lambda x: separation(problem, propagate(problem, x)).risk.max())
    path = evaluate_path(problem, x, "start", tolerance=1.0)
    strict = replace(problem, epsilon=0.001)
    assert within_limits(strict, [path]) == ()
    text = breach_text(strict, [path])
    assert re.search(r"planner\.epsilon = 0\.001 in every segment.* at step", text)
    least = float(text.split("set planner.epsilon=")[1].split(",")[0])
    assert within_limits(replace(problem, epsilon=least), [path]) == (path,)
    assert within_limits(replace(problem, epsilon=1.0), [path]) == (path,)


def test_no_limit_needs_the_bound_of_paths():
    with pytest.raises(ConfigError, match=r"planner\.epsilon=null needs fidelity\.collision_bound=path"):
        make_problem(
            "F a",
            make_scene({"a": box(13, 2, 17, 6)}, [box(7, 1, 9, 6)]),
            smooth_wind(make_scene({"a": box(13, 2, 17, 6)}, [])),
            planner=PlannerConfig(epsilon=None),
            fidelity=preset("paper"),
        )


def test_limits_of_segments_are_those_of_a_sweep(grown, lines):
    """The road of the checker: a dense sweep of directions about each obstacle."""
    problem, _ = grown
    parts = tuple(map(convex, problem.decomposition.obstacles)) + beyond_bounds(problem.scene.bounds)
    for x in lines[:4]:
        limits = segment_limits(problem, x)
        z, risks = segment_risks(parts, x, square_matrices(propagate(problem, x).cov))
        apart = z.min(axis=1) > 0.0  # where a segment meets an obstacle any line will do
        np.testing.assert_allclose(limits.deviations[apart], z.min(axis=1)[apart], rtol=2e-3, atol=2e-3)
        np.testing.assert_allclose(limits.probability[apart], risks[apart], rtol=0.02, atol=1e-9)


def test_barriers_have_the_names_of_the_map(grown):
    problem, _ = grown
    names = barrier_names(problem)
    walls = ["the western border", "the eastern border", "the southern border", "the northern border"]
    assert names == ["obstacle 1", "obstacle 2", *walls]
