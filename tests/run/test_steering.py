"""Paths between two points: the goal, epsilon by another road, and points that cannot be used."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import pareto_ltl
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_verify.gaussians import segment_risks
from pareto_ltl_verify.geometry import beyond_bounds, convex
from quick_wind import QUICK_WIND

SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 2, "n_max": 800, "max_steps": 60},
    "refine": {"points": 3, "flights": 100, "sweep_flights": 40, "classes": 1},
    "selection": {"draws": 100, "runs": 200},
    "wind": QUICK_WIND,
    "deployment": {"runs": 10},
    "report": "none",
}


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result; its mission has no effect on steering."""
    place = tmp_path_factory.mktemp("steering") / "run"
    pareto_ltl.plan("phi1", "F a", fidelity="full", out=place, **SMALL)
    return place


@pytest.mark.parametrize(("start", "end"), [((-4.2e5, -4.3e5), (3.5e5, -2e5)), ((-4e5, 3e5), (4e5, 2e5))])
def test_a_steered_path_reaches_the_goal_and_keeps_epsilon(
    planned: Path, start: tuple[float, float], end: tuple[float, float]
) -> None:
    results = pareto_ltl.load_results(planned)
    path = pareto_ltl.steer(results, start, end, radius=25e3)
    np.testing.assert_allclose(path.x[0], start)
    assert (np.abs(path.x[-1] - np.array(end)) <= 25e3).all()
    assert (np.linalg.norm(path.u, axis=1) <= results.plan.u_max * (1.0 + 1e-9)).all()
    parts = [convex(part) for part in results.cells.obstacles]
    if results.scene.walled:
        parts += beyond_bounds(results.scene.bounds)
    _, risks = segment_risks(parts, path.x, path.cov)
    assert risks.max() <= results.plan.epsilon * 1.02
    line = shapely.LineString(path.x)
    assert not any(line.crosses(shapely.Polygon(outline)) for outline in results.scene.obstacles)


def test_more_weight_on_risk_gives_a_safer_and_longer_path(planned: Path) -> None:
    low, high = (
        pareto_ltl.steer(planned, (-4.2e5, -4.3e5), (3.5e5, -2e5), weight=weight).objectives
        for weight in (0.01, 30.0)
    )
    assert high.mission_risk + high.collision_risk <= low.mission_risk + low.collision_risk
    assert high.length >= low.length * (1.0 - 1e-6)


def test_points_that_cannot_be_used_are_named(planned: Path) -> None:
    scene = pareto_ltl.load_results(planned).scene
    inside = shapely.Polygon(scene.obstacles[1]).representative_point()
    with pytest.raises(ConfigError, match=r"end .* lies outside the map"):
        pareto_ltl.steer(planned, (0.0, -4.5e5), (1e9, 0.0))
    with pytest.raises(ConfigError, match=r"start lies .* deep in obstacle 2"):
        pareto_ltl.steer(planned, (inside.x, inside.y), (0.0, -4.5e5))
    with pytest.raises(ConfigError, match="two numbers"):
        pareto_ltl.steer(planned, (0.0, np.nan), (0.0, -4.5e5))
    with pytest.raises(ConfigError, match="radius must be above 0 m"):
        pareto_ltl.steer(planned, (-4.2e5, -4.3e5), (3.5e5, -2e5), radius=0.0)
