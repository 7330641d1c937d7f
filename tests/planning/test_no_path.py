"""Why there is no path: the reason is told from others, and the setting that is advised works."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.planning import no_path, shortest_mission
from pareto_ltl.planning.evaluate import completing_path
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.no_path import explain_no_line, explain_no_path, explain_no_safe_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.starts import Start
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.selection import tree_front
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig, preset
from pareto_ltl.support.errors import InfeasibleError
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
    models = replace(preset(fidelity), judge="bound")
    problem = task(corridor(width), cfg, models)
    assert plans(cfg, problem) == 0
    text = explained(problem, cfg)
    law = {"paper": "independent", "full": "coherent"}[fidelity]
    assert f"in {law} winds; the least risk found" in text
    assert re.search(r"is [\d.e-]+ %: allow it with planner\.", text)
    better = follow(cfg, text)
    assert plans(better, task(corridor(width), better, models)) > 0


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


def faster(text: str) -> RobotConfig:
    """The robot with the airspeed that ``text`` advises."""
    (advised,) = re.findall(r"set robot\.u_max=([\d.]+)", text)
    return RobotConfig(dt=100.0, u_max=float(advised))


def explained(problem: Problem, cfg: PlannerConfig = CFG) -> str:
    """The text where trees have no path, or none that the plan allows."""
    forest = grow_forest(cfg, problem, SeedSequence(11))
    assert not tree_front(problem, forest)
    if len(forest.accepted):
        return explain_no_safe_path(cfg, problem, SEEDS)
    return explain_no_path(cfg, problem, forest, SEEDS)


def test_wind_stronger_than_the_robot_is_told_with_an_airspeed_that_finds_a_path() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    wind = steady_wind(scene, mean=(-10.5, 0.0), until=np.inf)
    wind.mean[:, 0, 0] = 0.0
    text = explained(make_problem("F a", scene, wind, planner=CFG))
    assert (
        "on the shortest line the expected wind, up to 10.5 m/s, is too strong for robot.u_max = 10 m/s"
        in text
    )
    assert plans(CFG, make_problem("F a", scene, wind, faster(text), CFG)) > 0


def test_too_few_steps_are_told_with_a_number_that_finds_a_path() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    cfg = replace(CFG, max_steps=5)
    text = explained(make_problem("F a", scene, planner=cfg), cfg)
    assert "takes 20.1 min against the expected wind" in text
    assert "planner.max_steps = 5 steps of 100 s are 8.3 min" in text
    more = replace(CFG, max_steps=int(advised_settings(text)["max_steps"]))
    assert plans(more, make_problem("F a", scene, planner=more)) > 0
    assert plans(cfg, make_problem("F a", scene, None, faster(text), cfg)) > 0


@pytest.mark.parametrize("headwind", [0.0, 5.0])
def test_wind_that_ends_too_early_is_told_with_the_time_needed_and_what_helps(headwind: float) -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, [box(8, 4, 10, 12)], start=(3, 10))
    scene = replace(scene, time_zero="2018-10-09T18:00:00+00:00")
    wind = steady_wind(scene, mean=(-headwind, 0.0), until=1000.0)
    text = explained(make_problem("F a", scene, wind, planner=CFG))
    # From (3, 10) around the corners (8, 12) and (10, 12) to the corner (15, 12) of a.
    legs = 1000 * np.array([[5, 2], [2, 0], [5, 0]])
    lengths = np.hypot(*legs.T)
    across = headwind * legs[:, 1] / lengths
    speeds = np.sqrt((CAP * 10.0) ** 2 - across**2) - headwind * legs[:, 0] / lengths
    (told,) = re.findall(r"the shortest line takes ([\d.]+) min", text)
    assert float(told) == pytest.approx((lengths / speeds).sum() / 60, abs=0.2)
    assert re.search(r"the wind is known for 1[5-8].\d min, until 2018-10-09T18:1[5-8]Z", text)
    assert "too close" not in text
    assert plans(CFG, make_problem("F a", scene, wind, faster(text), CFG)) > 0
    assert "set wind.hold_last=true" in text
    held = steady_wind(scene, mean=(-headwind, 0.0), until=np.inf)
    assert plans(CFG, make_problem("F a", scene, held, planner=CFG)) > 0


def test_a_region_behind_a_forbidden_one_is_named_with_those_before_it() -> None:
    regions = {"a": box(15, 8, 17, 12), "b": box(12, 0, 13, 20), "c": box(5, 8, 7, 12)}
    scene = replace(make_scene(regions, start=(3, 10)), border="wall")
    with pytest.raises(InfeasibleError) as error:
        grow_forest(CFG, make_problem("!b U a & F c", scene, planner=CFG), SeedSequence(11))
    closed = "the border and regions that the mission forbids close every way after c to region 'a'"
    assert closed in str(error.value)


def test_a_deadline_that_is_too_early_is_named_and_a_later_one_finds_a_path() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    text = explained(make_problem("F[0,10min] a", scene, planner=CFG))
    assert "takes 20.1 min against the expected wind at robot.u_max = 10 m/s and is too late" in text
    assert "(the time span from 0 s until 10 min after departure): make them longer" in text
    assert "forbids" not in text
    assert plans(CFG, make_problem("F[0,1h] a", scene, planner=CFG)) > 0
    assert plans(CFG, make_problem("F[0,10min] a", scene, None, faster(text), CFG)) > 0


def test_without_a_plan_the_cause_is_what_stops_the_best_line() -> None:
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    assert explain_no_line(CFG, make_problem("F a", scene, planner=CFG)) == ""
    late = explain_no_line(CFG, make_problem("F[0,10min] a", scene, planner=CFG))
    assert "is too late for its time spans" in late
    closed = make_scene({"a": box(15, 8, 17, 12)}, [box(9, 0, 10, 20)], start=(3, 10))
    assert "close every way from the start to region 'a'" in explain_no_line(
        CFG, make_problem("F a", closed, planner=CFG)
    )


def test_an_airspeed_is_advised_after_a_line_has_been_flown_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The estimate is too small, as if the line were straighter than what can be flown."""
    scene = make_scene({"a": box(2, 8, 5, 12)}, start=(15, 10))
    storm = steady_wind(scene, mean=(11.0, 0.0), until=np.inf)
    storm.mean[:, 0, 0] = 0.0  # calm enough somewhere
    problem = make_problem("F a", scene, storm, RobotConfig(dt=100.0, u_max=10.0), CFG)
    monkeypatch.setattr(shortest_mission, "_least_airspeed", lambda *_: 10.5)
    assert not shortest_mission.can_be_flown(shortest_mission.with_airspeed(problem, 10.5))
    text = explain_no_line(CFG, problem)
    assert "is too strong for robot.u_max = 10 m/s: set robot.u_max=" in text
    u_max = float(text.partition("set robot.u_max=")[2].split(",")[0])
    faster_robot = RobotConfig(dt=100.0, u_max=u_max)
    assert explain_no_line(CFG, make_problem("F a", scene, storm, faster_robot, CFG)) == ""
    monkeypatch.setattr(shortest_mission, "TRIALS", 1)
    assert "give the robot more airspeed" in explain_no_line(CFG, problem)


def test_the_line_that_comes_farthest_is_named_with_its_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines that cannot be flown as they are, though the shortest one in straight legs can."""
    scene = make_scene({"a": box(15, 8, 17, 12)}, start=(3, 10))
    problem = make_problem("F a", scene, planner=CFG)
    ends = (6e3, 13e3)  # both too short: neither reaches the region
    short = [Start(np.linspace([3e3, 10e3], [end, 10e3], 30), f"to {end:g}") for end in ends]
    fast = Start(np.linspace([3e3, 10e3], [16e3, 10e3], 3), "three steps")
    monkeypatch.setattr(no_path, "first_starts", lambda _: dict(enumerate([fast, *short])))
    text = explain_no_line(CFG, problem)
    assert (
        "of 3 lines of the map the one that comes farthest (to 6000, 3.0 km, 29 steps) cannot be flown"
        in text
    )
    assert "the expected path does not complete the mission: at its end a is still to be visited" in text
    monkeypatch.setattr(no_path, "first_starts", lambda _: {0: fast})
    assert "cannot be flown: the path needs more airspeed than robot.u_max at step 1 of 2" in explain_no_line(
        CFG, problem
    )


@pytest.mark.parametrize(
    ("formula", "where"),
    [
        ("!b U a", "it is lost 5 min after departure, in b"),
        ("F[0,10min] a", "at its end a is still to be visited in time"),
        ("F (a & F b)", "at its end b is still to be visited"),
    ],
)
def test_a_path_that_loses_the_mission_says_when_and_where(formula: str, where: str) -> None:
    scene = make_scene({"a": box(15, 8, 17, 12), "b": box(6, 8, 8, 12)}, start=(3, 10))
    problem = make_problem(formula, scene, robot=RobotConfig(dt=50.0, u_max=10.0), planner=CFG)
    x = np.column_stack([np.linspace(3e3, 16e3, 27), np.full(27, 10e3)])
    with pytest.raises(InfeasibleError, match=f"does not complete the mission: {where}"):
        completing_path(problem, x, "a line", tight=False)


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


def test_where_only_walls_are_in_the_way_the_open_border_is_advised() -> None:
    scene = replace(make_scene({"a": box(8, 0, 14, 0.6)}, start=(5, 5)), border="wall")
    cfg = PlannerConfig(trees=2, n_max=600, threads=1, epsilon=0.02)
    models = replace(preset("full"), judge="bound")
    problem = make_problem(
        "F a",
        scene,
        steady_wind(scene, gust=(0.3, 0.3)),
        RobotConfig(dt=100.0, u_max=10.0),
        cfg,
        fidelity=models,
    )
    text = explained(problem, cfg)
    assert text.endswith("if the robot may leave the map, set scene.border=open, which finds one")
    free = make_problem(
        "F a",
        replace(scene, border="open"),
        steady_wind(scene, gust=(0.3, 0.3)),
        RobotConfig(dt=100.0, u_max=10.0),
        cfg,
        fidelity=models,
    )
    assert tree_front(free, grow_forest(cfg, free, SeedSequence(11)))
