"""Convex smoothing where there are many obstacles, or outlines with many corners."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import shapely

from large_maps import MEGABYTE, SIDE, Waiting, many_discs, rough_disc
from pareto_ltl.planning import separation, smoothing
from pareto_ltl.planning.evaluate import completes_mission, evaluate_path, propagate
from pareto_ltl.planning.routes.obligations import path_obligations, possible_orders
from pareto_ltl.planning.routes.taut_lines import taut_line, walk_line
from pareto_ltl.settings import SmoothingConfig
from pareto_ltl.support.arrays import square_matrices
from problems import KM, box, make_problem, make_scene, rough_wind

QUICK = SmoothingConfig(candidates=2, rounds=4, weights=[10.0])


def breezy(scene, variance):
    return rough_wind(scene, speed=2.0, variance=variance, slots=8, hours=0.5, until=np.inf)


def flown(problem, z):
    """A path along a line that keeps ``z`` standard deviations from obstacles: more than it needs to."""
    order = possible_orders(problem, 1)[0]
    wait = np.repeat(problem.scene.start[None], 80, axis=0)
    cov = square_matrices(propagate(problem, wait).cov)
    x = walk_line(problem, taut_line(problem, order, *Waiting(wait[:1], cov), 1.0, z))
    return evaluate_path(problem, x, "by hand", tight=False)


def traced(problem, path):
    """Smoothed versions of a path, and the memory [MB] that this took at most, kernels compiled."""
    smoothing.smooth_paths(QUICK, problem, [path])
    tracemalloc.start()
    try:
        found = smoothing.smooth_paths(QUICK, problem, [path])
        return found, tracemalloc.get_traced_memory()[1] / MEGABYTE
    finally:
        tracemalloc.stop()


def test_a_map_with_300_obstacles_is_smoothed():
    regions = {"a": box(16, 16, 18, 18), "b": box(2, 15, 4, 17)}
    scene = make_scene(regions, many_discs(300, 1, (0.15, 0.35)), start=(1, 1), side=SIDE)
    problem = make_problem("F(a & F b)", scene, breezy(scene, 1e-4))
    path = flown(problem, 4.5)
    smoothed, peak = traced(problem, path)
    assert smoothed
    for one in smoothed:
        assert completes_mission(problem, evaluate_path(problem, one.x, one.origin))
        assert one.objectives.length < 0.98 * path.objectives.length
    assert peak < 100.0


@pytest.fixture(scope="module", params=["F a", "!a U b"])
def detailed(request):
    """A region of 2,000 corners that is not convex: to be visited, or to be avoided."""
    middle = (13.0, 13.0) if request.param == "F a" else (10.5, 9.0)
    regions = {"a": rough_disc(east=middle[0], north=middle[1]), "b": box(16, 16, 18, 18)}
    scene = make_scene(regions, [box(5, 15, 6, 16)], side=SIDE)
    return make_problem(request.param, scene, breezy(scene, 0.05))


def test_a_region_of_2000_corners_is_smoothed(detailed):
    goal = flown(detailed, 4.0).x[-1]
    detour = np.array([[1.0, 1.0], [3.0, 12.0], [12.0, 17.0], goal / KM]) * KM
    path = evaluate_path(detailed, walk_line(detailed, detour), "by hand")
    smoothed, peak = traced(detailed, path)
    assert smoothed
    for one in smoothed:
        assert completes_mission(detailed, evaluate_path(detailed, one.x, one.origin))
    merits = [smoothing.SmoothingTask(QUICK, None, detailed, path.objectives.length).merit(p, 10.0)
              for p in (path, *smoothed)]  # fmt: skip
    assert min(merits[1:]) < merits[0]
    assert peak < 100.0


def test_a_programme_has_few_faces_though_the_region_has_2000():
    angle = 2 * np.pi * np.arange(2000) / 2000
    disc = (np.array([13.0, 13.0]) + 3 * np.column_stack([np.cos(angle), np.sin(angle)])) * KM
    scene = make_scene({"a": disc}, [box(5, 15, 6, 16)], side=SIDE)
    problem = make_problem("F a", scene, breezy(scene, 0.05))
    assert np.diff(problem.theorem2.faces.ptr).max() == 2000
    path = flown(problem, 4.0)
    model = smoothing.fitting_programme(problem, [smoothing.Start(path.x, "")])
    assert model.shape.faces <= 40
    (best,) = smoothing.smooth_paths(SmoothingConfig(candidates=1, rounds=2, weights=[10.0]), problem, [path])
    witness = best.x[
        [t for t, _ in path_obligations(problem, best.x, propagate(problem, best.x).cov).witness]
    ]
    assert shapely.contains_xy(shapely.Polygon(disc), witness).all()


def test_what_must_be_avoided_is_drawn_as_one_shape():
    """Its polygons, few and around all cells, are asked for in segments in which all cells are avoided."""
    regions = {"a": rough_disc(east=10.5, north=9.0), "b": box(16, 16, 18, 18)}
    scene = make_scene(regions, [box(5, 15, 6, 16)], side=SIDE)
    problem = make_problem("!a U b", scene, breezy(scene, 0.05))
    path = flown(problem, 4.0)
    owed = path_obligations(problem, path.x, propagate(problem, path.x).cov)
    cells = [k for k, label in enumerate(problem.labels) if "a" in label]
    flight = propagate(problem, path.x)
    polygons, asked = separation.forbidden_polygons(problem), separation.avoided(problem, flight, owed.avoid)
    assert len(cells) > 500
    assert asked.shape[1] == len(polygons) < 100
    by_step = owed.avoid[:, cells].all(axis=1)
    by_segment = by_step[1:] & by_step[:-1]
    of_a = asked[:, (asked == by_segment[:, None]).all(axis=0)]
    assert by_step[1:-1].all()
    assert of_a.shape[1] > 1
