"""Prices of limits: against finite differences of the failures and of the programme, and names of limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.random import SeedSequence

from pareto_ltl.kernels import margin as km
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.margin_model import margin_model, margin_scratch
from pareto_ltl.planning.records import Front, counted_rate
from pareto_ltl.planning.refine import prices, programme, sampled_paths
from pareto_ltl.planning.refine.sampled import Refiner, path_length
from pareto_ltl.planning.refine.separation import separation
from pareto_ltl.settings import PlannerConfig, RefineConfig, RobotConfig, preset
from pareto_ltl.simulation.common_flights import draw_flights
from pareto_ltl.simulation.flights import simulate_flights
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
    cfg = RefineConfig(flights=300, sweep_flights=100, classes=2, points=4)
    flights = draw_flights(problem, "coherent", 1200, SeedSequence(1))
    path = sampled_paths(cfg, problem, grow_forest(planner, problem, SeedSequence(3)), flights)[0]
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
    front = Front((path,), (), 0.0, np.ones(2))
    _, listed = prices.limits_of(problem, front, path, positions)
    for kind, name in (("obstacle", "thicker"), ("region", "wider")):
        ends = [smoothed(task(**{name: way * STEP})[0], path, positions) for way in (-1.0, 1.0)]
        slope = (ends[1] - ends[0]) / (2.0 * STEP) * (1.0 if kind == "obstacle" else -1.0)
        assert slope > 0.0
        assert found(listed, kind) == pytest.approx(slope, rel=0.03)


def test_prices_of_segments_add_up_to_those_of_barriers(planned):
    problem, path, positions = planned
    front = Front((path,), (), 0.0, np.ones(2))
    limits, listed = prices.limits_of(problem, front, path, positions)
    assert limits.price.sum() == pytest.approx(found(listed, "obstacle"), rel=1e-9)
    places = [price for price in listed if price.kind in {"obstacle", "region"}]
    assert {price.name for price in places} == {"obstacle 1", "a", "b"}
    for price in places:
        assert 0 <= price.step < len(path.x)


@pytest.fixture(scope="module")
def binding(planned):
    """A programme in which airspeed, length and the lines of the obstacle bind."""
    problem, path, positions = planned
    tight = 0.9 * float(separation(problem, propagate(problem, path.x)).risk.max())
    refiner = Refiner(replace(problem, epsilon=tight), margin_model(problem))
    off = np.ascontiguousarray(np.moveaxis(positions - path.x, 0, 2))
    model, _ = refiner.slope(path.x, off, 300.0, len(positions))
    return refiner.problem, refiner.flown(path.x), model, 0.999 * path_length(path.x)


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
    assert slope(speeds, 0.01) == pytest.approx(solution.faster, rel=0.02)

    def farther(by):
        def moved(*args, **kwargs):
            lines = separation(*args, **kwargs)
            return replace(lines, offset=lines.offset - by)

        monkeypatch.setattr(programme, "separation", moved)
        return problem, flight, model, longest

    assert solution.clearer.sum() > 0.0
    # The tangents of the risk move with the lines, which the multipliers leave out.
    assert slope(farther, 2.0) == pytest.approx(solution.clearer.sum(), rel=0.15)


def test_the_price_of_the_length_is_the_slope_of_the_front_beyond_the_plan(planned):
    _, path, _ = planned
    lengths = path.objectives.length * np.array([0.97, 1.0, 1.02, 1.04, 1.2])
    rates = 0.1 * (lengths / path.objectives.length) ** -3.0
    paths = tuple(
        replace(path, objectives=replace(path.objectives, costs={"length": length})) for length in lengths
    )
    judged = tuple(counted_rate("coherent", round(1e7 * rate), 10**7) for rate in rates)
    front = Front(paths, (), 0.0, np.ones(2), judged, failed=np.zeros((5, 1), bool))
    expected = 3.0 * 0.1 / path.objectives.length
    assert prices.front_slope(front, paths[1]) == pytest.approx(expected, rel=1e-3)
    assert prices.front_slope(front, paths[-1]) == 0.0
    twin = replace(paths[1], objectives=replace(path.objectives, costs={"length": lengths[1] * (1.0 + 1e-9)}))
    alike = Front(
        (paths[1], twin), (), 0.0, np.ones(2), (judged[1], judged[4]), failed=np.zeros((2, 1), bool)
    )
    assert prices.front_slope(alike, paths[1]) == 0.0


def test_no_barriers_have_no_limits_and_certain_flights_no_prices(planned):
    problem, path, _ = planned
    scene = replace(problem.scene, obstacles=())
    bare = make_problem("F(a & F b)", scene, fidelity="full", robot=RobotConfig(dt=100.0, u_max=18.0))
    front = Front((path,), (), 0.0, np.ones(2))
    limits, listed = prices.limits_of(bare, front, path, np.repeat(path.x[None], 50, axis=0))
    assert limits is None
    assert listed == ()
