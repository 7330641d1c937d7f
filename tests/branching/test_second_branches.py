"""Plans that branch again in each branch, and at landmarks that they pass.

Their files, cards, scripts and claims are those of the plans of ``test_branches`` and ``test_rejoin``.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from branching.test_branches import PHI1, SELDOM, SMALL, in_branches, misstated, swapped, turned
from exports.test_lua import HEADING, commands, flight, needs_lua
from lies.editing import Lie, edited
from pareto_ltl.extend import plans_on_branches
from pareto_ltl.planning.plan_files import read_plan, write_plan
from pareto_ltl.run.plan_run import Run
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.flight.following import follow
from pareto_ltl_apps.flight.telemetry import Reading
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify
from small_plans import phi1

FIRST, SECOND = 4, 9  # hours and steps


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan that branches at two fixes, each branch at the second one by itself."""
    place = tmp_path_factory.mktemp("branches") / "twice"
    at = [float(FIRST), float(SECOND)]
    branch = {"leaves": 2, "at": at, "fixes": 2, "rejoin": False}
    pareto_ltl.plan("phi1", PHI1, out=place, branch=branch, **SMALL)
    return place


def test_branches_of_branches_lower_the_failure_again(twice: Path) -> None:
    tree = Run.open(twice).plan.branching
    assert tree is not None
    assert tree.fixes == 2
    again = [one for one in tree.branches if one.then is not None]
    assert again
    for one in again:
        assert one.then is not None
        assert one.then.fix.step == SECOND
        assert [own.name for own in one.then.branches] == [f"{one.name}1", f"{one.name}2"]
        assert one.then.rate == one.rate
        assert one.then.rate.failure < one.then.alone.failure
        assert one.then.rate.runs == sum(own.rate.runs for own in one.then.branches)
    last = tree.front[-1]
    assert last.fixes == 2
    assert last.leaves == len(list(tree.ends()))
    assert last.rate.failure < tree.front[1].rate.failure


def test_a_plan_of_two_fixes_is_written_and_read_back(twice: Path, tmp_path: Path) -> None:
    write_plan(tmp_path, read_plan(twice))
    assert (tmp_path / "plan.json").read_bytes() == (twice / "plan.json").read_bytes()
    plan = Run.open(twice).plan
    assert plan.branching is not None
    for before, branch, on_it in plans_on_branches(plan):
        assert before.branching is not None
        first = before.branching.fix.step
        assert on_it.branching is branch.then
        assert (on_it.path.u[first:] == branch.path.u).all()
        with (twice / f"branch_{branch.name}.csv").open(newline="") as file:
            assert int(next(csv.DictReader(file))["leg"]) == first
    page, cells = (twice / "branch_cards.html").read_text(), list(plan.branching.all_branches())
    questions = 1 + sum(one.then is not None for _, one in cells)
    assert page.count("<section>") == questions + len(cells)
    assert all(f"Table {one.name}<" in page for _, one in cells)
    roles = [
        one["properties"]["role"] for one in json.loads((twice / "plan.geojson").read_text())["features"]
    ]
    assert roles.count("branch") == len(cells)
    assert roles.count("branch line") == questions


def test_a_plan_of_two_fixes_is_explained_and_verified(
    twice: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["explain", str(twice), "--branches"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    tree = Run.open(twice).plan.branching
    assert tree is not None
    assert f"{FIRST}:00:00 after departure" in told
    assert f"{SECOND}:00:00 after departure" in told
    assert all(f"{one.name}: {one.cell.words}" in told for _, one in tree.all_branches())
    assert [finding for finding in verify(twice) if not finding.holds] == []


def test_follow_takes_a_branch_at_each_fix(twice: Path, tmp_path: Path) -> None:
    run = Run.open(twice)
    plan, frame = run.plan, run.scene.frame
    for _, branch, on_it in plans_on_branches(plan):
        if len(branch.name) == 1:
            continue
        readings, headings = [], on_it.navigation.heading_true  # type: ignore[union-attr]
        for minute in range(SECOND * 60 + 20):
            k, place = minute // 60, None
            if minute in (FIRST * 60, SECOND * 60):
                lon, lat = (float(part[0]) for part in frame.to_geographic(on_it.path.x[k][None]))
                place = (lat, lon)
            speed = float(np.hypot(*on_it.path.u[k]))
            readings.append(Reading(60.0 * minute, float(headings[k]), speed, place, 500.0))
        events = list(follow(twice, readings, out=tmp_path / branch.name, settings=SELDOM))
        chosen = [event["name"] for event in events if event["event"] == "branch"]
        assert chosen == [branch.name[0], branch.name]
        assert events[-1]["promised"] == branch.rate.failure


@needs_lua
def test_the_script_takes_the_branch_of_each_fix(twice: Path, tmp_path: Path) -> None:
    """By the numbers that the pilot sets, and by the positions that a receiver reports."""
    pareto_ltl.export(twice, tmp_path, ["lua"])
    run = Run.open(twice)
    frame = run.scene.frame

    def event(hours: float, x: np.ndarray) -> str:
        lon, lat = (float(part[0]) for part in frame.to_geographic(x[None]))
        return (
            f"{{ t = {10 + hours * 3600 - 60}, fix = 3, lat = {round(1e7 * lat)}, lng = {round(1e7 * lon)} }}"
        )

    for _, branch, on_it in plans_on_branches(run.plan):
        if len(branch.name) == 1:
            continue
        end = 10 + on_it.path.t[-1] + 3 * 3600.0
        wanted = branch.navigation.heading_true
        assert wanted is not None
        begin = "{ t = 10, armed = true, mode = 15"
        numbers = f"{begin}, user = {'ABCD'.index(branch.name[0]) + 1}, second = {branch.name[1]} }}, "
        measured = f"{begin} }}, {event(FIRST, on_it.path.x[FIRST])}, {event(SECOND, on_it.path.x[SECOND])}, "
        for events in (numbers, measured):
            sent = commands(flight(tmp_path / "plan.lua", events + f"{{ t = {end} }}"), HEADING)
            late = [one[1][1] for one in sent if one[0] >= SECOND * 3600.0 - 1.0]
            assert late == pytest.approx(wanted.tolist(), abs=0.5)


def _of_second(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    """Change the branches of the first branch that branches again."""
    return in_branches(
        lambda tree: change(next(row["branches"] for row in tree["branches"] if "branches" in row))
    )


@pytest.mark.parametrize(
    "lie",
    [
        Lie("tables swapped", _of_second(swapped), ("branches: positions given the cell",)),
        Lie("a line turned round", _of_second(turned), ("branches: positions given the cell",)),
        Lie(
            "a wrong share",
            _of_second(misstated),
            ("branches: shares",),
        ),
        Lie(
            "another step",
            _of_second(lambda tree: tree["fix"].update(step=SECOND - 1)),
            ("branches: where the plan branches",),
        ),
        Lie(
            "names of the other branch",
            _of_second(lambda tree: [row.update(name="B" + row["name"][1]) for row in tree["branches"]]),
            ("branches: where the plan branches",),
        ),
    ],
    ids=lambda lie: lie.name,
)
def test_a_lie_about_a_second_fix_is_caught(twice: Path, tmp_path: Path, lie: Lie) -> None:
    result = open_evidence(edited(twice, tmp_path / "lie", lie))
    claims = [claim for claim in CLAIMS if claim.name in lie.caught]
    assert [finding.claim for finding in findings(result, claims) if finding.holds] == []
    assert {claim.name for claim in claims} == {*lie.caught}


def test_a_plan_branches_in_landmarks_that_it_passes(tmp_path: Path) -> None:
    """Fixes have the error and the places of the landmarks, are missed outside, and steer nothing."""
    place = tmp_path / "landmark"
    marks = [
        [[0.6, 6.5], [3.1, 6.5], [3.1, 9.4], [0.6, 9.4]],
        [[5.6, 6.6], [7.2, 6.6], [7.2, 7.9], [5.6, 7.9]],
    ]
    branch = {"leaves": 2, "available": 0.8, "fixes": 2}
    run = pareto_ltl.plan(phi1(landmarks=marks), PHI1, out=place, branch=branch, **SMALL)
    tree = run.plan.branching
    assert tree is not None
    assert tree.fix.landmark is not None
    assert tree.fix.inside(tree.fix.place[None])[0]
    assert (tree.fix.sd, tree.fix.available) == (run.settings.robot.fix_sd, 0.8)
    assert run.plan.path.fixes == ()
    assert tree.difference[2] < 0.0
    later = [one.then.fix for one in tree.branches if one.then is not None]
    assert later
    assert all(one.landmark is not None and one.inside(one.place[None])[0] for one in later)
    assert all((one.landmark != tree.fix.landmark).any() for one in later)
    taken = sum(one.rate.runs for one in tree.branches)
    assert taken < 0.8 * tree.rate.runs + 6 * math.sqrt(0.16 * tree.rate.runs)  # outside it is not taken
    assert [finding for finding in verify(place) if not finding.holds] == []
