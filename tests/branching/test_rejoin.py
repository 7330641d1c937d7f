"""A plan that flies the measured distance off: planned, exported, followed, verified; lies about it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import pareto_ltl
from branching.test_branches import AT, PHI1, SELDOM, SMALL, STEP, as_flown, in_branches
from exports.test_lua import HEADING, SPEED, commands, flight, needs_lua
from lies.editing import Lie, edited
from pareto_ltl.planning.plan_files import read_plan, write_plan
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.exports.branches import branch_lines
from pareto_ltl_apps.flight.following import follow
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify

SECOND = 9.0  # [h]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("rejoin") / "run"
    branch = {"leaves": 2, "at": [AT, SECOND], "fixes": 2, "rejoin": True}
    pareto_ltl.plan("phi1", PHI1, out=place, branch=branch, seed=3, **SMALL)
    return place


def test_flown_off_distances_lower_the_failure(made: Path) -> None:
    tree = Run.open(made).plan.branching
    assert tree is not None
    assert tree.fix.rejoin > 0
    assert tree.difference[2] < 0.0
    # Most of what the position can give: with a table for each side alone, a third of the failures remains.
    assert tree.rate.failure < 0.4 * tree.alone.failure
    assert [row.leaves for row in tree.front if row.fixes == 1] == [1, 2]


def test_it_is_written_and_read_back(made: Path, tmp_path: Path) -> None:
    write_plan(tmp_path, read_plan(made))
    assert (tmp_path / "plan.json").read_bytes() == (made / "plan.json").read_bytes()
    content = json.loads((made / "plan.json").read_text())
    content["branches"]["fix"]["rejoin_steps"] = -1
    (tmp_path / "plan.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match="rejoin_steps: expected a whole number from 1 on"):
        read_plan(tmp_path)


def test_people_read_what_to_add(made: Path) -> None:
    run = Run.open(made)
    tree = run.plan.branching
    assert tree is not None
    later = 1000.0 * tree.fix.counter
    rate = 1000.0 / (tree.fix.rejoin * run.plan.dt) + later
    assert later > 0.0
    told = next(
        line for line in branch_lines(run.plan, run.scene.frame) if "flown off" in line or "off in" in line
    )
    assert f"{rate:.3g} m/s less along the planned track" in told
    card = (made / "branch_cards.html").read_text()
    assert "And fly the distance off" in card
    assert "from then to the" in card
    assert f"from then on {later:.3g} m/s" in (made / "plan.kml").read_text()
    assert "behind" in card
    assert f"{rate:.3g} m/s more to the right" in (made / "plan.kml").read_text()


@needs_lua
def test_the_script_adds_it_to_the_legs_after_the_fix(made: Path, tmp_path: Path) -> None:
    """Headings and airspeeds of the branch with the change; without a position, those of the branch."""
    pareto_ltl.export(made, tmp_path, ["lua"])
    run = Run.open(made)
    plan, frame = run.plan, run.scene.frame
    tree = plan.branching
    assert tree is not None
    fix, air = tree.fix, plan.air
    branch = tree.branches[0]
    place = fix.place + 30_000.0 * fix.ahead @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    branch = tree.branches[int(tree.chosen(place[None])[0])]
    lon, lat = (float(part[0]) for part in frame.to_geographic(place[None]))
    until = 10.0 + min(SECOND, AT + fix.rejoin) * 3600.0 - 1.0

    def sent(measured: bool) -> tuple[list[float], list[float]]:
        told = f"fix = 3, lat = {round(1e7 * lat)}, lng = {round(1e7 * lon)}, " if measured else ""
        events = (
            "{ t = 10, armed = true, mode = 15, user = 0 }, "
            f"{{ t = {10 + AT * 3600 - 60}, {told}user = {0 if measured else branch_number} }}, "
            f"{{ t = {until} }}"
        )
        out = flight(tmp_path / "plan.lua", events)
        headings, speeds = (
            [one[1][1] for one in commands(out, kind) if one[0] >= AT * 3600.0 - 1.0]
            for kind in (HEADING, SPEED)
        )
        return headings, speeds

    branch_number = tree.branches.index(branch) + 1
    log = branch.navigation
    assert log.heading_true is not None
    n = len(sent(True)[0])
    assert n >= 1
    (headings, speeds), (plain, _) = sent(True), sent(False)
    changes = fix.changes(place, plan.dt)
    turn = float(frame.north(fix.place)[0])  # of grid north, from true north [rad]
    for k in range(n):
        v, angle = log.airspeed[k], math.radians(plain[k])
        east, north = changes[int(k >= fix.rejoin)]
        e = v * math.sin(angle) + east * math.cos(turn) + north * math.sin(turn)
        o = v * math.cos(angle) - east * math.sin(turn) + north * math.cos(turn)
        motion = run.problem.motion
        true = min(max(math.hypot(e, o), motion.u_min), motion.u_max)
        wanted = true if air is None else float(air.calibrated(np.array([true]))[0])
        # The script takes distances from latitude and longitude by two coefficients: 60 m off at 30 km.
        assert headings[k] == pytest.approx(math.degrees(math.atan2(e, o)) % 360.0, abs=0.2)
        assert speeds[k] == pytest.approx(wanted, abs=0.05)  # one ratio to true airspeeds
    # An aircraft that banks flies another heading after a turn, since the turn takes time.
    assert plain[:n] == pytest.approx(log.heading_true[:n].tolist(), abs=0.5)
    assert max(abs(a - b) for a, b in zip(plain, headings, strict=False)) > 1.0


def test_follow_says_what_to_add_and_goes_on_with_it(made: Path, tmp_path: Path) -> None:
    run = Run.open(made)
    tree = run.plan.branching
    assert tree is not None
    off = np.array([2000.0, -1500.0])
    flown = as_flown(run, off)
    events = list(follow(made, flown, out=tmp_path / "once", settings=SELDOM))
    chosen = next(event for event in events if event["event"] == "branch")
    first, later = tree.fix.changes(run.plan.path.x[STEP] + off, run.plan.dt)
    assert chosen["change"] == pytest.approx(first.tolist(), abs=0.02)
    assert chosen["later"] == pytest.approx(later.tolist(), abs=0.02)
    assert chosen["seconds"] == tree.fix.rejoin * run.plan.dt
    again = list(follow(made, flown, out=tmp_path / "once", resume=True, settings=SELDOM))
    assert again[-1]["promised"] == events[-1]["promised"]


# --- the checker ------------------------------------------------------------------------------------


def test_the_checker_finds_no_fault(made: Path) -> None:
    assert [finding for finding in verify(made) if not finding.holds] == []


LIES = (
    Lie(
        "nothing is flown off",
        in_branches(lambda tree: tree["fix"].pop("rejoin_steps")),
        ("branches: positions given the cell", "branches: failure rate with branches"),
    ),
    Lie(
        "it is flown off in twice the time",
        in_branches(lambda tree: tree["fix"].update(rejoin_steps=2 * tree["fix"]["rejoin_steps"])),
        ("branches: positions given the cell",),
    ),
    Lie(
        "no drift is countered",
        in_branches(lambda tree: tree["fix"].pop("counter_per_s")),
        ("branches: positions given the cell",),
    ),
    Lie(
        "it goes on with the drift",
        in_branches(lambda tree: tree["fix"].update(counter_per_s=-tree["fix"]["counter_per_s"])),
        ("branches: where the plan branches", "branches: positions given the cell"),
    ),
    Lie(
        "it is flown off after the end",
        in_branches(lambda tree: tree["fix"].update(rejoin_steps=1000)),
        ("branches: where the plan branches",),
    ),
)


@pytest.mark.parametrize("lie", LIES, ids=lambda lie: lie.name)
def test_a_lie_about_it_is_caught(made: Path, tmp_path: Path, lie: Lie) -> None:
    result = open_evidence(edited(made, tmp_path / "lie", lie))
    claims = [claim for claim in CLAIMS if claim.name in lie.caught]
    assert [finding.claim for finding in findings(result, claims) if finding.holds] == []
    assert {claim.name for claim in claims} == {*lie.caught}
