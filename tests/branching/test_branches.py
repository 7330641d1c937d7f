"""A plan that branches, end to end: planned, written, read, followed, verified; and lies about it."""

from __future__ import annotations

import csv
import html
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from exports.test_lua import HEADING, commands, flight, needs_lua
from lies.editing import Lie, edited, holds, in_json
from pareto_ltl.extend import plan_on_branch
from pareto_ltl.planning.plan_files import read_plan, write_plan
from pareto_ltl.planning.records import Plan
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.branching.stage import branched_plan
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.flight.following import follow
from pareto_ltl_apps.flight.sends import at_leg
from pareto_ltl_apps.flight.telemetry import Reading
from pareto_ltl_apps.flight.watch import WatchSettings
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify

SELDOM = WatchSettings(every=3600.0, members=100)
PHI1 = "F(a & F b & F c)"
AT, STEP = 5.0, 5  # [h] of the fix, and its step
SMALL: dict[str, Any] = {
    "robot": {"dt": 3600.0},
    "planner": {"trees": 1, "n_max": 150, "max_steps": 60},
    "refine": {"flights": 400, "sweep_flights": 100, "classes": 1, "points": 4},
    "selection": {"draws": 1000, "runs": 4000},
    "deployment": {"runs": 100},
    "report": "none",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("branches") / "run"
    pareto_ltl.plan("phi1", PHI1, out=place, branch={"leaves": 2, "at": [AT], "rejoin": False}, **SMALL)
    return place


def test_branches_lower_the_failure_in_the_same_winds(made: Path) -> None:
    tree = Run.open(made).plan.branching
    assert tree is not None
    assert len(tree.branches) == 2
    assert tree.difference[2] < 0.0
    assert tree.rate.failure < tree.alone.failure
    assert tree.rate.runs == 4000
    counts = [round(one.rate.failure * one.rate.runs) for one in tree.branches]
    assert sum(counts) == round(tree.rate.failure * tree.rate.runs)
    assert sum(one.share for one in tree.branches) == pytest.approx(1.0, abs=1e-6)
    assert tree.front[0].rate.failure > tree.front[1].rate.failure


def test_plan_json_has_schema_3_and_is_read_back(made: Path, tmp_path: Path) -> None:
    content = json.loads((made / "plan.json").read_text())
    assert content["schema"] == "pareto_ltl.plan/3"
    assert len(content["u"]) == len(content["t"]) - 1  # the plan that is flown without a fix
    write_plan(tmp_path, read_plan(made))
    assert (tmp_path / "plan.json").read_bytes() == (made / "plan.json").read_bytes()
    without = {key: value for key, value in content.items() if key != "branches"}
    (tmp_path / "plan.json").write_text(json.dumps(without | {"schema": "pareto_ltl.plan/2"}))
    assert read_plan(tmp_path).branching is None


def test_each_branch_has_a_table_from_the_fix_on(made: Path) -> None:
    plan = Run.open(made).plan
    assert plan.branching is not None
    for branch in plan.branching.branches:
        with (made / f"branch_{branch.name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert [int(row["leg"]) for row in rows] == list(range(STEP, STEP + len(rows)))
        assert float(rows[0]["t_s"]) == AT * 3600.0
        assert len(rows) == len(branch.path.t)
        assert (made / f"branch_{branch.name}_card.csv").is_file()
    page = (made / "branch_cards.html").read_text()
    assert page.count("<section>") == 3
    assert all(f"Table {one.name}" in page and one.cell.words in page for one in plan.branching.branches)
    named = json.loads((made / "mission.plan").read_text())["pareto_ltl"]
    assert "branch" in json.dumps(named)
    roles = [one["properties"]["role"] for one in json.loads((made / "plan.geojson").read_text())["features"]]
    assert roles.count("branch") == 2
    assert roles.count("branch line") == 1
    assert (made / "plan.kml").read_text().count("<name>branch ") == 2


def test_the_card_says_how_to_get_distances_by_hand_and_what_a_line_divides(made: Path) -> None:
    run = Run.open(made)
    tree, frame = run.plan.branching, run.scene.frame
    assert tree is not None
    page = html.unescape((made / "branch_cards.html").read_text())
    sums = re.findall(r"(-?[\d.]+) N ([+-]) ([\d.]+) E", page)
    place = tree.fix.place + np.array([20_000.0, -15_000.0]) @ tree.fix.axes
    (lon, lon0), (lat, lat0) = frame.to_geographic(np.stack([place, tree.fix.place]))
    found = [float(a) * (lat - lat0) + float(sign + b) * (lon - lon0) for a, sign, b in sums[:2]]
    assert found == pytest.approx([20.0, -15.0], abs=0.3)  # [km]; the map is not quite flat
    assert re.findall(r"<td>([A-D] \| [A-D])</td>", page) == ["A | B"]


@needs_lua
def test_the_script_takes_the_branch_of_the_reported_position(made: Path, tmp_path: Path) -> None:
    """Of a position on each side of the line, of a number that the pilot sets, and none without either."""
    pareto_ltl.export(made, tmp_path, ["lua"])
    run = Run.open(made)
    tree, frame = run.plan.branching, run.scene.frame
    assert tree is not None
    end = 10 + run.plan.path.t[-1] + 3 * 3600.0

    def headings(position: np.ndarray | None, asked: int = 0) -> list[float]:
        fix = ""
        if position is not None:
            lon, lat = (float(part[0]) for part in frame.to_geographic(position[None]))
            fix = f"fix = 3, lat = {round(1e7 * lat)}, lng = {round(1e7 * lon)}, "
        events = (
            f"{{ t = 10, armed = true, mode = 15, user = {asked} }}, "
            f"{{ t = {10 + AT * 3600 - 60}, {fix}user = {asked} }}, {{ t = {end} }}"
        )
        sent = commands(flight(tmp_path / "plan.lua", events), HEADING)
        return [one[1][1] for one in sent if one[0] >= AT * 3600.0 - 1.0]

    for number, branch in enumerate(tree.branches, 1):
        inside = branch.path.x[0]
        wanted = branch.navigation.heading_true
        assert wanted is not None
        for told in (headings(inside), headings(None, number)):
            assert told == pytest.approx(wanted.tolist(), abs=0.5)
    trunk = run.plan.navigation
    assert trunk is not None
    assert trunk.heading_true is not None
    assert headings(None) == pytest.approx(trunk.heading_true[STEP:].tolist(), abs=0.5)


def test_explain_says_when_to_measure_and_what_to_fly(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["explain", str(made), "--branches"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    tree = Run.open(made).plan.branching
    assert tree is not None
    assert "5:00:00 after departure" in told
    assert all(f"{one.name}: {one.cell.words}" in told for one in tree.branches)


def as_flown(run: Run, off: np.ndarray) -> list[Reading]:
    """Telemetry of a robot that flies as planned, and measures its position ``off`` [m] from the plan."""
    plan, frame = run.plan, run.scene.frame
    headings = plan.navigation.heading_true  # type: ignore[union-attr]
    speeds = np.hypot(*plan.path.u.T)
    readings = []
    for minute in range(int(AT * 60) + 30):
        k = min(minute // 60, len(speeds) - 1)
        place = None
        if minute == AT * 60:
            lon, lat = (float(part[0]) for part in frame.to_geographic((plan.path.x[STEP] + off)[None]))
            place = (lat, lon)
        readings.append(Reading(60.0 * minute, float(headings[k]), float(speeds[k]), place, 500.0))
    return readings


def test_follow_names_the_branch_that_a_fix_selects(made: Path, tmp_path: Path) -> None:
    run = Run.open(made)
    tree = run.plan.branching
    assert tree is not None
    for branch in tree.branches:
        off = branch.path.x[0] - run.plan.path.x[STEP]
        events = list(follow(made, as_flown(run, off), out=tmp_path / branch.name, settings=SELDOM))
        chosen = [event for event in events if event["event"] == "branch"]
        assert [event["name"] for event in chosen] == [branch.name]
        # The watch goes on with the branch: its promise is the one of the branch.
        assert events[-1]["promised"] == branch.rate.failure
        again = list(
            follow(made, as_flown(run, off), out=tmp_path / branch.name, resume=True, settings=SELDOM)
        )
        assert again[-1]["promised"] == branch.rate.failure
    nothing = list(follow(made, as_flown(run, np.zeros(2))[: STEP * 60 - 1], settings=SELDOM))
    assert not [event for event in nothing if event["event"] == "branch"]


def test_a_plan_on_a_branch_has_its_headings_and_places(made: Path) -> None:
    """What follow sends to an autopilot after the fix: headings from true north, not from the plane's."""
    plan = Run.open(made).plan
    assert plan.branching is not None
    for branch in plan.branching.branches:
        there = plan_on_branch(plan, branch)
        assert (there.path.u[:STEP] == plan.path.u[:STEP]).all()
        assert (there.path.u[STEP:] == branch.path.u).all()
        assert there.navigation is not None
        for name in ("airspeed", "lat", "lon", "heading_true"):
            own, first = getattr(branch.navigation, name), getattr(plan.navigation, name)
            assert (getattr(there.navigation, name)[STEP:] == own).all()
            assert (getattr(there.navigation, name)[:STEP] == first[:STEP]).all()
        (_, command), *_ = at_leg(["heading"], there, STEP, 1.0)
        assert command["params"][1] == branch.navigation.heading_true[0]  # type: ignore[index]


def test_replanning_from_a_plan_with_branches_makes_one_without(made: Path) -> None:
    run = Run.open(made)
    lon, lat = run.scene.frame.to_geographic(run.plan.path.x[[STEP]] + 3000.0)
    done = pareto_ltl.replan(made, f"{AT:g}h", (float(lat[0]), float(lon[0]), 500.0))
    assert done.run is not None
    assert done.plan.branching is None


# --- the checker ------------------------------------------------------------------------------------


def test_the_checker_finds_no_fault(made: Path) -> None:
    found = verify(made)
    assert [finding for finding in found if not finding.holds] == []
    assert sum(finding.claim.startswith("branches: ") for finding in found) == 10


def in_branches(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], Any]:
    """Change the key ``branches`` of ``plan.json``."""
    return in_json("plan.json", lambda content: change(content["branches"]))


def turned(tree: dict[str, Any]) -> None:
    """The cells are told the wrong way round, in numbers and words."""
    first, second = tree["branches"]
    for key in ("along", "left", "where", "share"):
        first[key], second[key] = second[key], first[key]


def swapped(tree: dict[str, Any]) -> None:
    first, second = tree["branches"]
    for key in set(first) - {"name", "where", "along", "left", "share", "rate"}:
        first[key], second[key] = second[key], first[key]


def misstated(tree: dict[str, Any]) -> None:
    """A share that is too large."""
    tree["branches"][0]["share"] += 0.05


def _shifted(tree: dict[str, Any]) -> None:
    """The line lies elsewhere, in numbers and words alike."""
    for row in tree["branches"]:
        for key in ("along", "left"):
            row[key] = [None if end is None else end + 9000.0 for end in row[key]]
        side = "left" if row["left"] != [None, None] else "along"
        at_least = row[side][0] is not None
        words = {
            ("left", True): "more than 9.0 km left of the planned track",
            ("left", False): "right of the planned track, or less than 9.0 km left of it",
            ("along", True): "more than 9.0 km ahead of the planned position (along the track)",
            (
                "along",
                False,
            ): "behind the planned position (along the track), or less than 9.0 km ahead of it",
        }
        row["where"] = words[side, at_least]


def _better(tree: dict[str, Any]) -> None:
    """A rate that is too good, with all that follows from it."""
    rate, alone = tree["rate"], tree["alone"]
    rate["failure"], rate["low"], rate["high"] = 0.004, 0.002, 0.008
    tree["difference"]["middle"] = rate["failure"] - alone["failure"]
    tree["difference"]["low"] = tree["difference"]["middle"] - 0.01


LIES = (
    Lie("a line turned round", in_branches(turned), ("branches: positions given the cell",)),
    Lie("two tables swapped", in_branches(swapped), ("branches: positions given the cell",)),
    Lie("a line moved", in_branches(_shifted), ("branches: shares",)),
    Lie(
        "a wrong share",
        in_branches(misstated),
        ("branches: shares",),
    ),
    Lie("a rate that is too good", in_branches(_better), ("branches: failure rate with branches",)),
    Lie(
        "words of the other side",
        in_branches(lambda tree: tree["branches"][0].update(where=tree["branches"][1]["where"])),
        ("branches: cells in words",),
    ),
    Lie(
        "a gap between the cells",
        in_branches(
            lambda tree: next(
                ends.__setitem__(0, ends[0] + 700.0)
                for row in tree["branches"]
                for ends in (row["along"], row["left"])
                if ends[0] is not None
            )
        ),
        ("branches: cells divide the plane",),
    ),
    Lie(
        "a fix at another place",
        in_branches(lambda tree: tree["fix"]["place"].__setitem__(0, tree["fix"]["place"][0] + 4000.0)),
        ("branches: where the plan branches",),
    ),
)


@pytest.mark.parametrize("lie", LIES, ids=lambda lie: lie.name)
def test_a_lie_about_branches_is_caught(made: Path, tmp_path: Path, lie: Lie) -> None:
    result = open_evidence(edited(made, tmp_path / "lie", lie))
    claims = [claim for claim in CLAIMS if claim.name in lie.caught]
    assert [finding.claim for finding in findings(result, claims) if finding.holds] == []
    assert {claim.name for claim in claims} == {*lie.caught}


def test_tables_that_areswapped_on_disk_are_caught(made: Path, tmp_path: Path) -> None:
    def swap(place: Path) -> None:
        one, other = place / "branch_A.csv", place / "branch_B.csv"
        first, second = one.read_bytes(), other.read_bytes()
        one.write_bytes(second)
        other.write_bytes(first)

    lie = Lie("swapped files", swap, ())
    assert not holds(edited(made, tmp_path / "lie", lie), "branches: steps and tables")


# --- bad input --------------------------------------------------------------------------------------


def branched_again(made: Path, **branch: Any) -> Plan:
    """The plan of ``made`` without its branches, branched by other settings: its front is not made again."""
    run = Run.open(made)
    plan = replace(run.plan, branching=None)
    fronts = (one for one in run.front.paths if np.array_equal(one.x, plan.path.x))
    path = next(fronts, run.front.paths[0])  # a trunk that is bent for its branches is not on the front
    settings = run.settings.with_sections(BranchConfig(leaves=2, **branch))
    return branched_plan(run.with_settings(settings), replace(plan, path=path))


def test_what_cannot_branch_is_refused_in_one_line(made: Path, tmp_path: Path) -> None:
    def planned(**more: Any) -> Any:
        return pareto_ltl.plan("phi1", PHI1, **SMALL | more)

    with pytest.raises(ConfigError, match=r"branch\.at = 99 h is not within the plan.*give times"):
        branched_again(made, at=[99.0])
    with pytest.raises(ConfigError, match=r"needs a position fix: branch\.at is empty and the map has no"):
        branched_again(made)
    with pytest.raises(ConfigError, match=r"branch\.fixes = 2 needs two different times in branch\.at"):
        branched_again(made, at=[5.0], fixes=2)
    with pytest.raises(ConfigError, match=r"always knows its position and needs no branches"):
        planned(branch={"leaves": 2, "at": [5.0]}, robot={"dt": 3600.0, "feedback_time": 60.0})
    with pytest.raises(ConfigError, match=r"needs fidelity\.law=coherent"):
        planned(branch={"leaves": 2, "at": [5.0]}, fidelity="paper")
    with pytest.raises(ConfigError, match=r"branch\.fixes = 2 has no effect with branch\.leaves = 1"):
        planned(branch={"at": [5.0, 9.0], "fixes": 2})
    with pytest.raises(ConfigError, match=r"branch\.fixes must"):
        planned(branch={"leaves": 2, "at": [5.0], "fixes": 3})
    with pytest.raises(ConfigError, match=r"branch\.leaves must"):
        planned(branch={"leaves": 5, "at": [5.0]})
    plain = tmp_path / "plain.json"
    content = json.loads((made / "plan.json").read_text())
    content["branches"]["branches"][0]["along"] = [3.0, 1.0]
    plain.write_text(json.dumps(content))
    with pytest.raises(DataError, match="the lower one first"):
        read_plan(plain)


def test_a_fix_that_says_nothing_gives_no_branches(
    made: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its error is a hundred times the drift: the plan stays one, and its file has no trace of branches."""
    plan = branched_again(made, at=[AT], fix_sd=1e6)
    assert plan.branching is None
    assert "branches do not pay" in caplog.text
    write_plan(tmp_path, plan)
    assert json.loads((tmp_path / "plan.json").read_text())["schema"] == "pareto_ltl.plan/2"
    assert math.isfinite(plan.promise.rate.failure)  # type: ignore[union-attr]
