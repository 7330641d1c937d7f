"""A plan leg by leg: every leg, the nearest barrier in standard deviations, and laws beside probabilities."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pareto_ltl
from drawn_world import path_of, scene_of
from flight_quantities.medium import AIR, WATER
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.run.plan_run import Run
from pareto_ltl.world.windows import Window
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.view.legs import (
    Clearance,
    Leg,
    _goal_line,
    _legs_line,
    closest_barriers,
    of_one_heading,
)
from problems import along, box, make_problem, make_scene

BOX = np.array([[40.0, 10.0], [60.0, 10.0], [60.0, 30.0], [40.0, 30.0]])


def test_the_nearest_barrier_is_the_one_that_is_fewest_deviations_away() -> None:
    path = path_of(scene_of())
    cov = np.zeros((3, 2, 2))
    cov[1:] = [[[1.0, 0.0], [0.0, 4.0]], [[9.0, 0.0], [0.0, 16.0]]]
    way = replace(path, x=np.array([[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]]), cov=cov, u=np.ones((2, 2)))
    bounds = np.array([[-50.0, -60.0], [150.0, 50.0]])
    scene = replace(scene_of(), bounds=bounds, regions={}, obstacles=(BOX,), border="open")
    first, second = closest_barriers(scene, way)
    assert first is not None
    assert second is not None
    # 10 m north of the leg from 40 m on; the variance across grows linearly to 4 m² at 50 m.
    assert first.metres == pytest.approx(10.0)
    assert 10.0 / 2.0 <= first.deviations <= 10.0 / np.sqrt(0.8 * 4.0)
    assert second.name == "obstacle 1"
    walled = replace(scene, border="wall", obstacles=())
    last = closest_barriers(walled, way)[1]
    assert last is not None
    assert "border" in last.name
    assert closest_barriers(replace(walled, border="open"), way) == [None, None]


def test_a_leg_through_an_obstacle_has_no_clearance() -> None:
    path = path_of(scene_of())
    way = replace(
        path, x=np.array([[0.0, 20.0], [50.0, 20.0]]), cov=np.tile(np.eye(2), (2, 1, 1)), u=np.ones((1, 2))
    )
    (found,) = closest_barriers(replace(scene_of(), obstacles=(BOX,)), way)
    assert found is not None
    assert (found.metres, found.deviations) == (0.0, 0.0)


def test_explain_tells_every_leg_and_names_laws(
    page_result: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["explain", str(page_result), "--legs"]) == 0
    out = capsys.readouterr().out
    plan = Run.open(page_result).plan
    legs = [line for line in out.splitlines() if line[:7].strip().isdigit()]
    assert [int(line[:7]) for line in legs] == list(range(len(plan.path.u)))
    assert all("heading" in line or "drifting" in line for line in legs)
    assert plan.not_covered in " ".join(out.split())
    assert run_command_line(["explain", str(page_result)]) == 0
    lines, out = pareto_ltl.explain(page_result).splitlines(), capsys.readouterr().out
    assert " ".join(lines).split() == out.split()
    assert max(map(len, out.splitlines())) <= 80
    for line in lines:
        if " fails " in line or line.startswith("bound"):
            assert "winds" in line


def leg(number: int, heading: float, *, airspeed: float = 20.0, fix: bool = False) -> Leg:
    near = Clearance("obstacle 1", 9e3, 4.0 + number)
    return Leg(
        number, f"{number}:00Z", f"{number + 1}:00Z", heading, airspeed, 5.0, 90.0, 1.0, 0.95 * airspeed,
        near, 0.1, fix,
    )  # fmt: skip


def test_successive_legs_of_one_heading_have_one_line() -> None:
    """Across north too; a fix, a turn or another airspeed begins a new line."""
    headings = [359.0, 0.5, 1.5, 4.5, 5.0, 5.0, 5.0]
    legs = [leg(k, h, fix=k == 4, airspeed=20.0 + 2.0 * (k == 6)) for k, h in enumerate(headings)]
    groups = of_one_heading(legs)
    assert [[one.number for one in group] for group in groups] == [[0, 1, 2], [3, 4], [5], [6]]
    line = _legs_line(groups[0], AIR)
    assert line.split("; ")[0].split() == ["0-2", "0:00Z", "-", "3:00Z"]
    assert "heading 000.3 true, 20.0 m/s true (19.0 calibrated); wind 5.0 m/s from 090" in line
    assert "obstacle 1 at 9.0 km = 4.0 sd" in line
    assert _legs_line(groups[1], AIR).endswith("position fix at its end")
    assert of_one_heading([]) == []


def test_a_slow_leg_has_two_decimals_and_its_own_line() -> None:
    groups = of_one_heading([leg(k, 10.0, airspeed=v) for k, v in enumerate([0.35, 0.35, 0.26])])
    assert [len(group) for group in groups] == [2, 1]
    drift = replace(groups[0][0], wind=0.124, wind_sd=0.012, calibrated=math.nan)  # in the water
    assert "true, 0.35 m/s; wind 0.12 m/s from 090 (sd 0.01)" in _legs_line([drift], AIR)
    assert "true, 0.35 m/s; current 0.12 m/s sets to 270 (sd 0.01)" in _legs_line([drift], WATER)


def test_a_leg_to_a_region_with_a_window_names_the_proposition() -> None:
    scene = make_scene({"c": box(14, 8, 18, 12)}, start=(2.0, 10.0))
    scene = replace(scene, windows={"late": Window("c", 300.0)})
    problem = make_problem("F late", scene)
    path = evaluate_path(problem, along((2, 10), (16, 10), step=0.9), "by hand", tight=False)
    assert _goal_line(problem, path, 0, len(path.u)).startswith("to {late}: state 0 to 1 of 2")


def test_explain_tells_any_point(page_result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    front = Run.open(page_result).front
    last = len(front.paths) - 1
    assert run_command_line(["explain", str(page_result), "--point", str(last)]) == 0
    assert f"{len(front.paths[last].u)} legs" in capsys.readouterr().out
    assert run_command_line(["explain", str(page_result), "--point", "9999"]) == 2
    assert run_command_line(["explain", str(page_result), "--point", "-1"]) == 2
    assert run_command_line(["explain", str(page_result / "nowhere")]) == 2
    assert all(line.startswith("pareto-ltl: ") for line in capsys.readouterr().err.splitlines())
