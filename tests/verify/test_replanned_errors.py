"""A plan remade after a fix that lies aside: the checker derives the law of the robot's own errors again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import pareto_ltl
from lies.editing import holds
from pareto_ltl.extend import Frame
from pareto_ltl.settings import RobotConfig
from pareto_ltl_verify.judge import verify
from small_plans import COMMON

ERRORS = "replan: the robot's own errors given the fixes"
SD = {"airspeed_sd": 0.02, "heading_sd": 3.0, "clock_sd": 2.0}


@pytest.fixture(scope="module")
def remade(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan in calm air, remade after a fix two standard deviations to the right of it."""
    folder = tmp_path_factory.mktemp("remade")
    settings = COMMON | {"wind": "calm", "robot": COMMON["robot"] | SD}
    flown = pareto_ltl.plan("phi1", "F a", **settings, out=folder / "flown")
    x, step = flown.plan.path.x, 3
    ahead = (x[step] - x[0]) / np.linalg.norm(x[step] - x[0])
    right = np.array([ahead[1], -ahead[0]]) * np.linalg.norm(x[step] - x[0])
    place = x[step] + 2.0 * np.radians(SD["heading_sd"]) * right
    (lon,), (lat,) = Frame(flown.scene.crs).to_geographic(place)
    done = pareto_ltl.replan(folder / "flown", step * flown.plan.dt, (lat, lon, 100.0), out=folder / "new")
    assert done.run is not None
    robot = done.run.settings.robot
    # Clockwise, by nearly as much as the fix lies aside, and known far better than before.
    assert robot.heading_bias == pytest.approx(6.0, abs=0.5)
    assert robot.heading_sd is not None
    assert robot.heading_sd < 1.0
    return folder / "new"


def failing(place: Path) -> list[str]:
    return [finding.claim for finding in verify(place) if not finding.holds]


def test_all_claims_hold(remade: Path) -> None:
    assert ERRORS in {finding.claim for finding in verify(remade)}
    assert failing(remade) == []


def test_the_compass_is_corrected(remade: Path) -> None:
    """Flown 6 degrees to the right of what it shows, the plan's headings lie 6 degrees to the left."""
    plan = json.loads((remade / "plan.json").read_text())
    x, u = np.array(plan["x"]), np.array(plan["u"])
    turn = np.angle(np.diff(x, axis=0) @ [1.0, 1j] / (u @ [1.0, 1j]), deg=True)
    bias = yaml.safe_load((remade / "config_resolved.yaml").read_text())["robot"]["heading_bias"]
    np.testing.assert_allclose(turn, -bias, atol=0.1)


def test_errors_that_do_not_follow_from_the_fix_are_found(remade: Path) -> None:
    config = remade / "config_resolved.yaml"
    text = config.read_text()
    settings = yaml.safe_load(text)
    settings["robot"]["heading_bias"] = 0.0
    try:
        config.write_text(yaml.safe_dump(settings))
        assert not holds(remade, ERRORS)
    finally:
        config.write_text(text)


def test_expected_errors_need_a_standard_deviation() -> None:
    with pytest.raises(pareto_ltl.ConfigError, match=r"robot\.heading_bias needs robot\.heading_sd"):
        RobotConfig(heading_bias=2.0)
    with pytest.raises(pareto_ltl.ConfigError, match="be the correlations of a covariance matrix"):
        RobotConfig(**SD, error_correlation=[0.9, 0.9, -0.9])
    with pytest.raises(pareto_ltl.ConfigError, match="three pairs of numbers"):
        RobotConfig(**SD, start_error_covariance=[[0.0, 0.0]])
