"""The time step of a map: short for its places, long enough for a flight, readable."""

from __future__ import annotations

import logging
import re
from typing import Any

import numpy as np
import pytest
import yaml

from pareto_ltl.settings import RobotConfig, SceneConfig
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl.world.time_step import (
    READABLE,
    fitting_step,
    narrowest_place,
    passage_width,
    polygon_width,
    too_long,
    with_time_step,
)
from problems import SCENES, box, make_scene

STEPS = 200


def corridor(width: float) -> Scene:
    """A wall from south to north with one gap ``width`` km wide between the start and the region."""
    walls = [box(9, 0, 11, 10 - width / 2), box(9, 10 + width / 2, 11, 20)]
    return make_scene({"a": box(14, 8, 18, 12)}, walls, start=(3.0, 10.0))


@pytest.mark.parametrize("name", ["phi1", "phi2"])
def test_the_ready_maps_have_half_an_hour(name: str) -> None:
    scene = scene_from_settings(SceneConfig(**yaml.safe_load((SCENES / f"{name}.yaml").read_text())))
    assert fitting_step(RobotConfig(), scene, STEPS) == 1800.0
    assert too_long(RobotConfig(dt=1800.0), scene, STEPS) == ""


@pytest.mark.parametrize("side", [2.0, 20.0, 200.0, 2000.0])
@pytest.mark.parametrize("u_max", [5.0, 15.0, 30.0, 60.0])
def test_a_full_step_is_short_for_the_map_and_a_flight_has_few_enough(side: float, u_max: float) -> None:
    k = side / 20.0
    scene = make_scene({"a": k * box(15, 15, 17, 17), "b": k * box(3, 14, 6, 17)}, start=(k, k), side=side)
    dt = fitting_step(RobotConfig(u_max=u_max), scene, STEPS)
    assert dt in READABLE
    assert u_max * dt <= 0.6 * narrowest_place(scene).width
    assert 30e3 * k / (u_max * dt) < STEPS


def test_a_flight_that_would_have_too_many_steps_gets_longer_ones() -> None:
    scene = make_scene({"a": box(1900, 1900, 1901, 1901)}, start=(10.0, 10.0), side=2000.0)
    dt = fitting_step(RobotConfig(), scene, STEPS)
    assert 30.0 * dt * STEPS > 2.0e6 * np.sqrt(2)
    assert dt < 2.0 * fitting_step(RobotConfig(), scene, STEPS + 1)


@pytest.mark.parametrize("width", [0.5, 1.0, 2.0, 4.0])
def test_the_width_of_a_passage_is_measured_to_a_cell_of_the_raster(width: float) -> None:
    assert passage_width(corridor(width)) == pytest.approx(1e3 * width, abs=300.0)


def test_a_passage_that_nothing_needs_does_not_count() -> None:
    scene = corridor(0.5)
    free = Scene(scene.bounds, scene.start, {"a": box(2, 2, 6, 6)}, scene.obstacles)
    assert passage_width(free) > 4e3
    assert passage_width(Scene(scene.bounds, scene.start, scene.regions)) == np.inf


def test_the_width_of_a_polygon_is_that_between_its_closest_parallels() -> None:
    turned = np.array([[0.0, 0.0], [3.0, 4.0], [-1.0, 7.0], [-4.0, 3.0]])
    assert polygon_width(turned) == pytest.approx(5.0)
    assert polygon_width(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 2.0], [0.0, 2.0]])) == pytest.approx(2.0)


def test_a_step_longer_than_a_region_is_told_with_one_that_fits(caplog: pytest.LogCaptureFixture) -> None:
    scene = make_scene({"a": box(15, 15, 16, 16)}, start=(1.0, 1.0))
    with caplog.at_level(logging.WARNING):
        assert with_time_step(RobotConfig(dt=1800.0), scene, STEPS).dt == 1800.0
    assert "a full step of 54.0 km (robot.dt=1800 at 30 m/s) is longer than region 'a' is wide" in caplog.text
    advised = re.search(r"set robot\.dt=(\S+),", caplog.text)
    assert advised is not None
    assert too_long(RobotConfig(dt=float(advised[1])), scene, STEPS) == ""


def test_auto_becomes_a_number_that_the_log_names(caplog: pytest.LogCaptureFixture) -> None:
    scene = corridor(2.0)
    with caplog.at_level(logging.INFO):
        chosen = with_time_step(RobotConfig(), scene, STEPS)
    assert chosen.dt == fitting_step(RobotConfig(), scene, STEPS)
    assert f"robot.dt=auto: {chosen.dt:g} s" in caplog.text


@pytest.mark.parametrize(
    "dt", ["Auto", "half an hour", True, None, [600.0], {}, 0.0, -1.0, 10**400, float("nan")]
)
def test_a_time_step_that_is_neither_a_number_nor_auto_is_one_line(dt: Any) -> None:
    with pytest.raises(ConfigError, match=r"robot\.dt must lie in \[0\.001, 1000000\] \[s\] or be auto, got"):
        RobotConfig(dt=dt)


def test_a_whole_number_is_the_same_time_step() -> None:
    assert repr(RobotConfig(dt=600).dt) == "600.0"


def test_a_step_is_too_long_beyond_so_many_widths_of_the_narrowest_place() -> None:
    scene = corridor(1.0)
    width = narrowest_place(scene).width
    robot = RobotConfig(dt=2.0 * width / 10.0, u_max=10.0)
    assert "passage" in too_long(robot, scene, STEPS)
    assert "passage" in too_long(robot, scene, STEPS, times=1.99)
    assert too_long(robot, scene, STEPS, times=2.01) == ""
