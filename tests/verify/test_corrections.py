"""Corrections of robots with feedback and fixes: larger than the airspeed that plans reserve for them?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

import pareto_ltl
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_verify.evidence import open_evidence
from small_plans import COMMON, MISSIONS

RUNS = 20_000
RARE = 1e-7  # of a test that fails by chance


@pytest.mark.statistical
@pytest.mark.parametrize("feedback", [0.0, 0.3])
def test_corrections_exceed_their_reserve_at_most_as_often_as_allowed(
    feedback: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The independent simulation, without the limit of the airspeed, that records what it would fly."""
    scene, _, changes = MISSIONS["fixes"]
    options = COMMON | changes | {"robot": {"dt": 1800.0, "feedback": feedback, "fix_gain": 0.5}}
    options |= {
        "planner": COMMON["planner"] | {"max_steps": 100, "delta": 0.95, "epsilon": 0.25},
        "fidelity": {"judge": "bound", "refine": "none"},
    }
    plan = pareto_ltl.plan(scene, "F(a & F b)", out=tmp_path / "run", **options).plan
    assert plan.path.fixes
    result = open_evidence(tmp_path / "run")
    simulator = result.simulator("coherent")
    wanted: list[FloatArray] = []

    def unlimited(u: FloatArray) -> FloatArray:
        wanted.append(u)
        return u

    monkeypatch.setattr(type(simulator), "_within_speed", lambda _self, u: unlimited(u))
    simulator.fly(RUNS, np.random.default_rng(5))
    calls, rest = divmod(len(wanted), len(plan.path.u))
    assert (calls, rest) == (1 + (feedback > 0), 0)
    controls = wanted[calls - 1 :: calls]  # the last of a step has all corrections
    left = simulator.guide.speed
    first = plan.path.fixes[0]
    assert (left[first:] < result.robot.u_max).all()
    shares = []
    for t in range(first, len(controls)):
        over = np.linalg.norm(controls[t] - plan.path.u[t], axis=1) > result.robot.u_max - left[t]
        shares.append(over.mean())
        assert binom.sf(over.sum() - 1, RUNS, result.robot.effort_risk) > RARE, t
    assert len(shares) > 10
    assert max(shares) > 0.3 * result.robot.effort_risk  # the reserve is not much larger than necessary
