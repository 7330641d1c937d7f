"""In calm air barriers are tens of standard deviations away, and any of them may be called the nearest."""

from __future__ import annotations

import json
from pathlib import Path

import pareto_ltl
from pareto_ltl_verify.claims.limits import FAR
from pareto_ltl_verify.judge import verify

CLAIM = "plan: limits of its segments"


def test_the_order_of_far_barriers_is_no_claim_and_a_near_one_cannot_be_called_far(tmp_path: Path) -> None:
    pareto_ltl.plan(
        "phi1", "F(a & F b & F c)", wind="calm", planner="quick", report="none", out=tmp_path / "r"
    )
    path = tmp_path / "r" / "plan.json"
    assert [finding for finding in verify(tmp_path / "r") if not finding.holds] == []
    content = json.loads(path.read_text())
    near = min(range(len(content["segments"])), key=lambda k: content["segments"][k]["deviations"])
    assert content["segments"][near]["deviations"] < FAR
    content["segments"][near]["deviations"] = FAR + 1.0
    path.write_text(json.dumps(content))
    assert CLAIM in {finding.claim for finding in verify(tmp_path / "r") if not finding.holds}
