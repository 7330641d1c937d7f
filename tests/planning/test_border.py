"""The border of the map as a wall: in settings and files, in R, in growth, in smoothing and in flights."""

from __future__ import annotations

from dataclasses import replace
from math import erfc, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import binom

from careful_io.files import write_json
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.evaluate import collision_risk, evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.pack import pack_barriers
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.selection import tree_front
from pareto_ltl.planning.smoothing import smooth_paths
from pareto_ltl.settings import (
    FidelityConfig,
    PlannerConfig,
    RobotConfig,
    SceneConfig,
    Settings,
    SmoothingConfig,
    preset,
)
from pareto_ltl.simulation.records import read_deployments, write_deployments
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from problems import KM, RARE, along, box, make_problem, make_scene, smooth_wind, steady_wind

ROBOT = RobotConfig(dt=100.0, u_max=10.0)


def strip(border: str, south: float = 8.0) -> Scene:
    """A way east with an obstacle above it; regions ``a`` lies at its end."""
    scene = make_scene({"a": box(15, 1, 19, 5)}, [box(7, south, 12, 20)], start=(2, 2.5))
    return replace(scene, border=border)


def task(scene: Scene, fidelity: str | FidelityConfig = "full", **limits: float) -> Problem:
    wind = smooth_wind(scene, speed=1.0, sd=0.6, gust=0.5)
    return make_problem("F a", scene, wind, ROBOT, PlannerConfig(**limits), fidelity=fidelity)  # type: ignore[arg-type]


# --- settings and files -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("border", "fidelity", "expected"),
    [
        ("auto", "paper", "open"),
        ("auto", "full", "wall"),
        ("wall", "paper", "wall"),
        ("open", "full", "open"),
    ],
)
def test_the_border_is_that_of_the_scene_or_of_the_fidelity(
    border: str, fidelity: str, expected: str
) -> None:
    assert Settings.of({"scene": {"border": border}, "fidelity": fidelity}).border == expected


@pytest.mark.parametrize("border", ["open", "wall"])
def test_a_map_file_keeps_its_border_unless_the_settings_name_one(border: str, tmp_path: Path) -> None:
    content = scene_to_dict(strip(border))
    assert scene_from_dict(content).border == border
    write_json(tmp_path / "scene.json", content)
    cfg = SceneConfig(file=str(tmp_path / "scene.json"))
    other = {"open": "wall", "wall": "open"}[border]
    assert scene_from_settings(cfg, border=other).border == border
    assert scene_from_settings(replace(cfg, border=other)).border == other
    del content["border"]
    write_json(tmp_path / "scene.json", content)
    assert scene_from_settings(cfg, border=other).border == other


# --- R and the chance constraint --------------------------------------------------------------


def upper(x: float) -> float:
    """1 - Φ(x)."""
    return 0.5 * erfc(x / sqrt(2))


@hypothesis_settings(deadline=None, max_examples=25)
@given(st.floats(0.3, 9.0), st.floats(0.1, 1.5))
def test_r_of_a_map_without_obstacles_is_the_chance_of_each_wall(height: float, gust: float) -> None:
    """A straight way in independent winds: each wall costs min(Σ p, 2 Φ(-least gap / largest σ))."""
    scene = replace(make_scene({"a": box(15, 1, 19, 5)}, start=(5, height)), border="wall")
    problem = make_problem("F a", scene, steady_wind(scene, gust=(gust, gust)), ROBOT, fidelity="paper")
    x = np.column_stack([np.linspace(5, 12, 8), np.full(8, height)]) * KM
    flight = propagate(problem, x)
    sd = np.sqrt(flight.cov[:, 0])
    expected = 0.0
    for gap in (x[:, 0], 20 * KM - x[:, 0], x[:, 1], 20 * KM - x[:, 1]):
        each = sum(upper(g / s) for g, s in zip(gap, sd, strict=True) if s > 0)
        expected += min(each, 2 * upper(gap.min() / sd.max()), 1.0)
    assert collision_risk(problem, flight, problem.world.law) == pytest.approx(min(expected, 1.0), rel=1e-9)
    free = replace(problem, scene=replace(scene, border="open"))
    assert len(pack_barriers(free.scene, free.obstacles).ptr) == 1


@pytest.mark.parametrize(
    ("law", "heights"), [("independent", (0.2, 0.4, 0.7)), ("coherent", (0.8, 1.2, 2.0))]
)
def test_flights_meet_walls_and_obstacles_no_more_often_than_r(law: str, heights: tuple[float, ...]) -> None:
    problem = task(strip("wall"), epsilon=0.9, delta=0.99)
    for height in heights:
        x = along((2, 2.5), (5, height), (16, height), step=0.8)
        flight = propagate(problem, x, problem.laws[law])
        bound = collision_risk(problem, flight, problem.laws[law])
        flights = simulate_flights(problem, flight.u, 4000, law, SeedSequence(1), x)
        hits = int((flights.collided | flights.off_map).sum())
        assert binom.sf(hits - 1, 4000, min(bound, 1.0)) > RARE
        assert hits > 0


@pytest.mark.parametrize("fidelity", ["paper", replace(preset("full"), judge="bound")])
def test_a_path_too_close_to_a_wall_breaks_the_chance_constraint(fidelity: str) -> None:
    x = along((2, 2.5), (5, 0.3), (16, 1.5), step=0.8)
    with pytest.raises(InfeasibleError, match="closer to an obstacle or a wall"):
        evaluate_path(task(strip("wall"), fidelity, epsilon=0.05), x, "")
    assert evaluate_path(task(strip("open"), fidelity, epsilon=0.05), x, "").x is x


# --- growth, smoothing, flights ---------------------------------------------------------------


def least_gap(problem: Problem, x: FloatArray) -> float:
    (west, south), (east, north) = problem.scene.bounds
    return float(np.min([x[:, 0] - west, east - x[:, 0], x[:, 1] - south, north - x[:, 1]]))


def smoothed(problem: Problem) -> tuple[PlannedPath, ...]:
    cfg = PlannerConfig(trees=2, n_max=800, threads=1)
    paths = tree_front(problem, grow_forest(cfg, problem, SeedSequence(4)))
    found = smooth_paths(SmoothingConfig(), problem, paths)
    assert len(found) > 0
    return found


def test_walls_push_plans_inwards_and_keep_flights_on_the_map() -> None:
    """Without walls the shortest way under the obstacle hugs the border."""
    rates, gaps = {}, {}
    for border in ("open", "wall"):
        problem = task(strip(border, south=2.0), epsilon=0.9, delta=0.99)
        path = min(smoothed(problem), key=lambda p: p.objectives.mission_risk + p.objectives.collision_risk)
        flights = simulate_flights(problem, path.u, 4000, "coherent", SeedSequence(2), path.x)
        rates[border], gaps[border] = flights.off_map.mean(), least_gap(problem, path.x)
        assert flights.walled == (border == "wall")
        np.testing.assert_array_equal(
            flights.failed, ~flights.accepted | flights.collided | (flights.off_map & flights.walled)
        )
    assert gaps["wall"] > gaps["open"]
    assert rates["wall"] < 0.6 * rates["open"]


def test_a_flight_leaves_the_map_at_any_step_and_by_any_side() -> None:
    scene = replace(make_scene({"a": box(9, 9, 11, 11)}, start=(10, 10)), border="wall")
    problem = make_problem("F a", scene, steady_wind(scene, gust=(0, 0), hours=1), ROBOT, PlannerConfig())
    for direction in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        out = np.repeat([np.array(direction, float) * 10.0], 11, axis=0)
        away = simulate_flights(problem, np.vstack([out, -out]), 2, "independent", SeedSequence(0))
        rim = simulate_flights(problem, out[:10], 2, "independent", SeedSequence(0))
        assert away.off_map.all()
        assert away.failed.all()
        assert away.accepted.all()
        assert not (rim.off_map | rim.failed).any()  # the rim itself is on the map


def test_deployments_are_read_back_with_their_border(tmp_path: Path) -> None:
    problem = task(strip("wall"))
    flights = simulate_flights(problem, np.full((12, 2), -5.0), 20, "coherent", SeedSequence(0))
    write_deployments(tmp_path, {"coherent": flights})
    again = read_deployments(tmp_path)["coherent"]
    assert again.walled
    np.testing.assert_array_equal(again.off_map, flights.off_map)
    np.testing.assert_array_equal(again.failed, flights.failed)
    assert flights.off_map.any()
