"""The robot's own errors in a result: its claims hold, and smaller errors than were flown are found out."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import pareto_ltl
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify
from small_plans import BEACONS, COMMON, phi1

ERRORS = {"airspeed_sd": 0.03, "heading_sd": 6.0, "clock_sd": 60.0}
CAUGHT = {
    "plan: motion", "plan: covariance", "plan: promised rate", "coherent: positions of the flights",
    "coherent: failure rate of new flights", "front: V and R of its paths",
}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / "errors"
    robot, flights = (
        COMMON["robot"] | ERRORS,
        {"selection": {"draws": 20, "runs": 2000}, "deployment": {"runs": 4000}},
    )
    pareto_ltl.plan("phi1", "F(a & F b)", **COMMON | flights | {"robot": robot, "out": place})
    return place


def test_all_claims_of_a_robot_with_errors_hold(made: Path) -> None:
    assert not [finding for finding in verify(made) if not finding.holds]


def test_all_claims_of_such_a_robot_that_takes_fixes_hold(tmp_path: Path) -> None:
    scene = phi1(landmarks=BEACONS)
    changes = {"robot": COMMON["robot"] | ERRORS, "deployment": {"runs": 1000}, "out": tmp_path / "fixes"}
    result = pareto_ltl.plan(scene, "F a", **COMMON | changes)
    assert result.plan.path.fixes
    assert not [finding for finding in verify(tmp_path / "fixes") if not finding.holds]


def test_smaller_errors_than_were_flown_are_found_out(made: Path, tmp_path: Path) -> None:
    """Half the errors, in the settings and in the text alike."""
    place = tmp_path / "lie"
    shutil.copytree(made, place)
    for name, old, new in (
        ("config_resolved.yaml", "airspeed_sd: 0.03", "airspeed_sd: 0.015"),
        ("config_resolved.yaml", "heading_sd: 6.0", "heading_sd: 3.0"),
        (
            "plan.json",
            "airspeed errors of 3 %, heading errors of 6",
            "airspeed errors of 1.5 %, heading errors of 3",
        ),
    ):
        text = (place / name).read_text(encoding="utf-8")
        assert text.count(old) == 1
        (place / name).write_text(text.replace(old, new), encoding="utf-8")
    claims = [claim for claim in CLAIMS if claim.name in CAUGHT]
    assert {
        finding.claim for finding in findings(open_evidence(place), claims) if not finding.holds
    } == CAUGHT
