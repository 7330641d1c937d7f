"""In calm air barriers are tens of standard deviations away, and any of them may be called the nearest."""

from __future__ import annotations

import json
from pathlib import Path

import pareto_ltl
from pareto_ltl_verify.claims.limits import FAR
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify

CLAIM = "plan: limits of its segments"


def test_the_order_of_far_barriers_is_no_claim_and_a_near_one_cannot_be_called_far(tmp_path: Path) -> None:
    pareto_ltl.plan(
        "phi1", "F(a & F b & F c)", wind="calm", report="none", exports="none", out=tmp_path / "r",
        planner={"trees": 2, "n_max": 1500}, refine={"flights": 100, "sweep_flights": 60, "points": 4},
        selection={"draws": 100, "runs": 500}, deployment={"runs": 100},
    )  # fmt: skip
    path = tmp_path / "r" / "plan.json"
    assert [finding for finding in verify(tmp_path / "r") if not finding.holds] == []
    content = json.loads(path.read_text())
    near = min(range(len(content["segments"])), key=lambda k: content["segments"][k]["deviations"])
    assert content["segments"][near]["deviations"] < FAR
    content["segments"][near]["deviations"] = FAR + 1.0
    path.write_text(json.dumps(content))
    (changed,) = findings(open_evidence(tmp_path / "r"), [claim for claim in CLAIMS if claim.name == CLAIM])
    assert not changed.holds
