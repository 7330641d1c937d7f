"""Why there is no path: the reason is told from others, and the setting that is advised works."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.no_path import explain_no_path, explain_no_safe_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.selection import tree_front
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig, preset
from pareto_ltl.world.scene import Scene
from problems import box, make_problem, make_scene, smooth_wind, steady_wind

SEEDS = SeedSequence(11)
CFG = PlannerConfig(trees=2, n_max=300, threads=1)


def corridor(width: float) -> Scene:
    """A wall with one gap ``width`` km wide."""
    walls = [box(9, 0, 11, 10 - width / 2), box(9, 10 + width / 2, 11, 20)]
    return make_scene({"a": box(14, 8, 18, 12)}, walls, start=(3, 10))


def task(
    scene: Scene,
    cfg: PlannerConfig,
    fidelity: str | FidelityConfig = "paper",
    formula: str = "F a",
    **wind: Any,
) -> Problem:
    options = {"speed": 1.0, "sd": 0.5, "gust": 1.0} | wind
    robot = RobotConfig(dt=100.0, u_max=10.0)
    return make_problem("F a", scene, smooth_wind(scene, **options), robot, cfg, fidelity=fidelity)


def advised_settings(text: str) -> Mapping[str, float]:
    """The settings of section planner that ``text`` advises."""
    return {name: float(value) for name, value in re.findall(r"planner\.(\w+)=([\d.e-]+)", text)}


def follow(cfg: PlannerConfig, text: str) -> PlannerConfig:
    found = advised_settings(text)
    assert found, text
    return replace(cfg, **{name: int(v) if name == "n_max" else v for name, v in found.items()})


def plans(cfg: PlannerConfig, problem: Problem) -> int:
    return len(tree_front(problem, grow_forest(cfg, problem, SeedSequence(11))))


@pytest.mark.parametrize(
    ("width", "fidelity"), [(0.8, "paper"), (1.5, "paper"), (1.5, "full"), (2.5, "full")]
)
def test_a_gap_that_is_only_risky_is_told_with_limits_that_let_a_path_through(
    width: float, fidelity: str
) -> None:
    cfg = replace(CFG, epsilon=0.001, delta=0.01)
    problem = task(corridor(width), cfg, fidelity)
    forest = grow_forest(cfg, problem, SeedSequence(11))
    assert len(forest.accepted) == 0
    text = explain_no_path(cfg, problem, forest, SEEDS)
    law = {"paper": "independent", "full": "coherent"}[fidelity]
    assert f"in {law} winds; the least risk found" in text
    assert re.search(r"is [\d.e-]+ %: allow it with planner\.", text)
    better = follow(cfg, text)
    assert plans(better, task(corridor(width), better, fidelity)) > 0


def test_paths_that_break_delta_alone_name_the_delta_that_keeps_one() -> None:
    cfg = replace(CFG, epsilon=0.5, delta=1e-4)
    bounded = replace(preset("full"), judge="bound")
    problem = task(corridor(1.5), cfg, bounded)
    assert plans(cfg, problem) == 0
    text = explain_no_safe_path(cfg, problem, SEEDS)
    assert set(advised_settings(text)) == {"delta"}
    better = follow(cfg, text)
    assert plans(better, task(corridor(1.5), better, bounded)) > 0


def test_too_few_vertices_are_told_with_a_number_that_finds_a_path() -> None:
    scene = make_scene({"a": box(8, 2, 10, 4), "b": box(14, 14, 16, 16)})
    cfg = replace(CFG, n_max=12)
    problem = make_problem("F(a & F b)", scene, planner=cfg)
    forest = grow_forest(cfg, problem, SeedSequence(11))
    assert len(forest.accepted) == 0
    text = explain_no_path(cfg, problem, forest, SEEDS)
    assert re.search(r"set planner\.n_max=\d+, which finds one", text)
    better = follow(cfg, text)
    assert plans(better, make_problem("F(a & F b)", scene, planner=better)) > 0


def test_wind_stronger_than_the_robot_is_not_called_risk() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    wind = steady_wind(scene, mean=(-10.5, 0.0), until=np.inf)
    wind.mean[:, 0, 0] = 0.0
    problem = make_problem("F a", scene, wind, planner=CFG)
    text = explain_no_path(CFG, problem, grow_forest(CFG, problem, SeedSequence(11)), SEEDS)
    assert "had too little airspeed against the wind" in text
    assert "raise robot.u_max (now 10 m/s)" in text


def test_too_few_steps_are_not_called_risk() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    cfg = replace(CFG, max_steps=5)
    problem = make_problem("F a", scene, planner=cfg)
    text = explain_no_path(cfg, problem, grow_forest(cfg, problem, SeedSequence(11)), SEEDS)
    assert "raise planner.max_steps" in text


def test_a_deadline_that_is_too_early_is_named_and_a_later_one_finds_a_path() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    problem = make_problem("F[0,10min] a", scene, planner=CFG)
    text = explain_no_path(CFG, problem, grow_forest(CFG, problem, SeedSequence(11)), SEEDS)
    assert "were too late for the mission: make its time spans longer" in text
    assert "(the time span from 0 s until 10 min after departure), or let the robot fly faster" in text
    assert "forbids" not in text
    assert plans(CFG, make_problem("F[0,1h] a", scene, planner=CFG)) > 0


def test_a_forbidden_region_is_named_beside_a_deadline() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12), "b": box(8, 0, 10, 14)}, start=(3, 10))
    problem = make_problem("!b U a & F[0,10min] a", scene, planner=CFG)
    text = explain_no_path(CFG, problem, grow_forest(CFG, problem, SeedSequence(11)), SEEDS)
    assert "broke the mission: move the regions that it forbids, or make its time spans longer" in text


def test_a_step_too_long_for_the_map_is_told_first() -> None:
    scene = make_scene({"a": box(15, 15, 16, 16)}, [box(6, 6, 9, 9)], start=(1, 1))
    robot = RobotConfig(dt=1800.0, u_max=10.0)
    problem = make_problem("F a", scene, steady_wind(scene, gust=(3.0, 3.0)), robot, CFG)
    text = explain_no_path(CFG, problem, grow_forest(CFG, problem, SeedSequence(11)), SEEDS)
    assert "a full step of 18.0 km (robot.dt=1800 at 10 m/s) is longer than region 'a' is wide" in text
    assert "set robot.dt=" in text


@pytest.mark.no_cover  # coverage slows the compiler down, and other tests run the same lines
def test_a_gap_beyond_every_limit_of_the_path_bound_is_told_with_the_step_bound() -> None:
    problem = task(corridor(0.8), CFG, "full")
    text = explain_no_path(CFG, problem, grow_forest(CFG, problem, SeedSequence(11)), SEEDS)
    assert "in coherent winds" in text
    assert "fidelity.collision_bound=step" in text
    better = follow(CFG, text)
    models = replace(problem.fidelity, collision_bound="step")
    assert plans(better, task(corridor(0.8), better, models)) > 0
