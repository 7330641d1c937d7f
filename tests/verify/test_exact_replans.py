"""A robot without errors in calm air knows its position, so that no covariance can be a unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pareto_ltl
from pareto_ltl.extend import Frame
from pareto_ltl_verify.judge import verify
from small_plans import COMMON

EXACT = {"airspeed_sd": None, "heading_sd": None, "clock_sd": None}
POSITION = "replan: position given the fixes"


def test_all_claims_of_a_plan_remade_from_a_known_position_hold(tmp_path: Path) -> None:
    settings = COMMON | {"wind": "calm", "robot": COMMON["robot"] | EXACT}
    flown = pareto_ltl.plan("phi1", "F a", **settings, out=tmp_path / "flown")
    expected = flown.plan.path.x[2]
    for name, east in (("on the plan", 0.0), ("off the plan", 300.0)):
        place = tmp_path / name
        (lon,), (lat,) = Frame(flown.scene.crs).to_geographic(expected + np.array([east, 0.0]))
        pareto_ltl.replan(tmp_path / "flown", 2 * flown.plan.dt, (lat, lon, 200.0), out=place)
        findings = verify(place)
        assert POSITION in {finding.claim for finding in findings}
        assert [finding.claim for finding in findings if not finding.holds] == []
