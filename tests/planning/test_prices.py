"""Prices of limits: against finite differences of the failures and of the programme, and names of limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.random import SeedSequence

from pareto_ltl.extend import draw_flights, simulate_flights
from pareto_ltl.planning import prices
from pareto_ltl.planning.convex import programme
from pareto_ltl.planning.evaluate import completing_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.margin_model import margin_model, margin_scratch
from pareto_ltl.planning.refine import Effort, sampled_paths
from pareto_ltl.planning.refine.effort import Polish
from pareto_ltl.planning.refine.sampled import Refiner
from pareto_ltl.planning.refine.sweep import first_of
from pareto_ltl.planning.separation import separation
from pareto_ltl.settings import PlannerConfig, RobotConfig, preset
from pareto_ltl.support.arrays import length_of
from plane_logic import margin as km
from problems import box, make_problem, make_scene, smooth_wind

STEP = 2.0  # [m] of a finite difference


def task(wider: float = 0.0, thicker: float = 0.0):
    """Two regions, larger by ``wider`` [m] on every side, with an obstacle between them, thicker likewise."""
    rounded = shapely.geometry.polygon.orient(
        shapely.Polygon(box(8.5, 7.5, 11.5, 11.5)).buffer(500.0 + thicker)
    )
    grow = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    scene = make_scene(
        {"a": box(13, 2, 17, 6) + wider * grow, "b": box(3, 13, 7, 17) + wider * grow},
        [np.array(rounded.exterior.coords)[:-1]],
        start=(2.0, 3.0),
    )
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=150.0)
    models = replace(preset("full"), border="open")
    wind = smooth_wind(scene, speed=1.5, sd=0.6, gust=0.3)
    planner = PlannerConfig(trees=2, n_max=500, epsilon=None)
    return make_problem("F(a & F b)", scene, wind, robot, planner, fidelity=models), planner


@pytest.fixture(scope="module")
def planned():
    """The problem, its shortest refined path, and flights of it."""
    problem, planner = task()
    effort = Effort(flights=300, sweep_flights=100, classes=2, points=4, scouts=1)
    flights = draw_flights(problem, "coherent", 1200, SeedSequence(1))
    forest = grow_forest(planner, problem, SeedSequence(3))
    path = sampled_paths(effort, problem, forest, first_of(flights))[0]
    return problem, path, simulate_flights(problem, path.u, 4000, "coherent", SeedSequence(2), path.x).x


def smoothed(problem, path, positions):
    """The failure that prices are derivatives of."""
    off = np.ascontiguousarray(np.moveaxis(positions - path.x, 0, 2))
    model, width = margin_model(problem), prices.WIDTH * float(np.ptp(problem.scene.bounds, axis=0).mean())
    slope = km.Slope(np.zeros((len(path.x), 2)), np.zeros((len(path.x), 3)))
    return km.smoothed_failure(
        model, path.x, off, width, slope, margin_scratch(model, len(positions), len(path.x))
    )


def found(limits, kind):
    return sum(price.saving for price in limits if price.kind == kind)


def test_prices_of_places_are_derivatives_of_the_failures(planned):
    problem, path, positions = planned
    _, listed = prices.limits_of(problem, path, [positions])
    for kind, name in (("obstacle", "thicker"), ("region", "wider")):
        ends = [smoothed(task(**{name: way * STEP})[0], path, positions) for way in (-1.0, 1.0)]
        slope = (ends[1] - ends[0]) / (2.0 * STEP) * (1.0 if kind == "obstacle" else -1.0)
        assert slope > 0.0
        assert found(listed, kind) == pytest.approx(slope, rel=0.03)


def test_prices_of_segments_add_up_to_those_of_barriers(planned):
    problem, path, positions = planned
    limits, listed = prices.limits_of(problem, path, [positions])
    assert limits.price.sum() == pytest.approx(found(listed, "obstacle"), rel=1e-9)
    places = [price for price in listed if price.kind in {"obstacle", "region"}]
    assert {price.name for price in places} == {"obstacle 1", "a", "b"}
    for price in places:
        assert 0 <= price.step < len(path.x)


@pytest.fixture(scope="module")
def binding(planned):
    """A programme in which airspeed, length and the lines of the obstacle bind."""
    problem, path, positions = planned
    tight = 0.3 * float(separation(problem, propagate(problem, path.x)).risk.max())
    refiner = Refiner(replace(problem, epsilon=tight), margin_model(problem))
    off = np.ascontiguousarray(np.moveaxis(positions - path.x, 0, 2))
    model, _ = refiner.slope(path.x, off, 300.0, len(positions))
    return refiner.problem, refiner.flown(path.x), model, 0.999 * length_of(path.x)


def value(problem, flight, model, longest):
    """The least value of the objective, and the solution."""
    stated = programme.programme(problem, len(flight.u))
    solution = stated.descend(flight, replace(model, hessian=model.hessian.copy()), 0.4, longest)
    return solution.value, solution


def test_multipliers_are_derivatives_of_the_least_objective(binding, monkeypatch):
    problem, flight, model, longest = binding
    _, solution = value(problem, flight, model, longest)

    def slope(change, step):
        low, high = (value(*change(way * step))[0] for way in (-1.0, 1.0))
        return (low - high) / (2.0 * step)

    assert solution.longer > 0.0
    assert slope(lambda by: (problem, flight, model, longest + by), 5.0) == pytest.approx(
        solution.longer, rel=0.02
    )
    assert solution.faster > 0.0
    speeds = lambda by: (problem, flight._replace(speed=flight.speed + by), model, longest)  # noqa: E731
    assert slope(speeds, 0.004) == pytest.approx(solution.faster, rel=0.02)

    def farther(by):
        def moved(*args, **kwargs):
            lines = separation(*args, **kwargs)
            return replace(lines, offset=lines.offset - by)

        monkeypatch.setattr(programme, "separation", moved)
        return problem, flight, model, longest

    assert solution.clearer.sum() > 0.0
    # The tangents of the risk move with the lines, which the multipliers leave out: up to 18 %.
    assert slope(farther, 2.0) == pytest.approx(solution.clearer.sum(), rel=0.3)


def test_the_price_of_the_length_is_the_derivative_of_the_polished_failure(planned):
    problem, path, _ = planned
    flights = draw_flights(problem, "coherent", 4000, SeedSequence(5))
    refiner, length = Refiner(problem, margin_model(problem)), length_of(path.x)
    how = Polish((prices.WIDTH * float(np.ptp(problem.scene.bounds, axis=0).mean()),), 8)
    settled = refiner.polish(refiner.polish(path.x, flights, how, length).flight.x, flights, how, length)
    change = 0.005 * length
    ends = [refiner.polish(settled.flight.x, flights, how, length + by).smoothed for by in (-change, change)]
    polished = completing_path(problem, settled.flight.x, "polished")
    _, listed = prices.limits_of(problem, polished, [flights.positions(settled.flight)])
    slope = (ends[0] - ends[1]) / (2.0 * change)
    assert slope > 0.0
    assert found(listed, "length") == pytest.approx(slope, rel=0.3)


def test_prices_are_means_over_blocks_with_their_standard_error(planned):
    problem, path, positions = planned
    _, listed = prices.limits_of(problem, path, np.split(positions, 4))
    each = [prices.limits_of(problem, path, [block])[1] for block in np.split(positions, 4)]
    for price in listed[:2]:
        of_blocks = [next(row.saving for row in rows if row.name == price.name) for rows in each]
        assert price.saving == pytest.approx(np.mean(of_blocks), rel=1e-9)
        assert price.error == pytest.approx(np.std(of_blocks, ddof=1) / 2.0, rel=1e-9)
        assert price.error > 0.0


def test_errors_state_how_far_prices_of_other_flights_are(planned):
    problem, path, positions = planned
    _, listed = prices.limits_of(problem, path, np.split(positions, 8))
    others = simulate_flights(problem, path.u, 16000, "coherent", SeedSequence(12), path.x).x
    _, exact = prices.limits_of(problem, path, np.split(others, 8))
    for price in listed[:3]:
        other = next(row for row in exact if row.name == price.name)
        assert abs(price.saving - other.saving) < 6.0 * np.hypot(price.error, other.error)
        assert price.error == pytest.approx(2.0 * other.error, rel=0.8)  # a quarter of the flights


def test_no_barriers_have_no_limits_and_certain_flights_no_prices(planned):
    problem, path, _ = planned
    scene = replace(problem.scene, obstacles=())
    bare = make_problem("F(a & F b)", scene, fidelity="full", robot=RobotConfig(dt=100.0, u_max=18.0))
    limits, listed = prices.limits_of(bare, path, [np.repeat(path.x[None], 50, axis=0)])
    assert limits is None
    assert listed == ()


@pytest.mark.parametrize(("widths", "shown"), [(0.5, True), (7.0, False)])
def test_flights_far_from_every_limit_give_no_price(widths, shown):
    """All of 4,000 flights pass an obstacle at the same distance of so many widths τ."""
    scene = make_scene({"a": box(15, 8, 19, 12)}, [box(8, 0, 12, 9)], start=(2.0, 10.0))
    problem = make_problem(
        "F a", scene, smooth_wind(scene, speed=0.0, sd=0.1), RobotConfig(dt=100.0, u_max=12.0),
        PlannerConfig(epsilon=None), fidelity=preset("full"),
    )  # fmt: skip
    tau = prices.WIDTH * float(np.ptp(scene.bounds, axis=0).mean())
    y = 9_000.0 + widths * tau
    x = np.column_stack([np.linspace(2_000.0, 17_000.0, 16), np.full(16, y)])
    path = completing_path(problem, x, "straight")
    rng = np.random.default_rng(5)
    positions = path.x + rng.normal(0.0, 0.05 * tau, (4000, 1, 2))
    _, listed = prices.limits_of(problem, path, np.split(positions, 4))
    assert ({price.kind for price in listed} == {"obstacle"}) is shown
