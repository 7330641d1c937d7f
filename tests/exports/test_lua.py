"""``plan.lua`` in a Lua interpreter, against a stand-in for the part of ArduPilot's API that it uses."""

from __future__ import annotations

import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exported_plans import Flown
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.exports.kinds import FORMATS

LUA = shutil.which("lua5.3") or shutil.which("lua5.4") or shutil.which("lua")
AUTOPILOT = Path(__file__).parent / "autopilot.lua"
needs_lua = pytest.mark.skipif(LUA is None, reason="no Lua interpreter on PATH (Debian: lua5.3)")
SPEED, HEADING, WIND = 43000, 43002, 43004


def flight(script: Path, events: str) -> list[list[str]]:
    """The words of each line that the autopilot prints."""
    assert LUA is not None
    done = subprocess.run(
        [LUA, str(AUTOPILOT), str(script), f"{{ {events} }}"],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [line.split(" ", 2 if line.startswith("text") else -1) for line in done.stdout.splitlines()]


def commands(lines: list[list[str]], command: int) -> list[tuple[float, list[float]]]:
    """Seconds after the departure at 10 s, and parameters, of each accepted command."""
    return [
        (float(line[0]) - 10.0, [float(word) for word in line[2:]])
        for line in lines
        if line[1:2] == [str(command)]
    ]


@needs_lua
def test_the_script_flies_the_table_by_the_clock(flown: Flown) -> None:
    log = flown.exported.log
    events = f"{{ t = 10, armed = true, mode = 15 }}, {{ t = {log.t[-1] + 60} }}"
    lines = flight(flown.folder / "plan.lua", events)
    for command, wanted in ((SPEED, log.calibrated), (HEADING, log.heading), (WIND, log.wind_speed_sd)):
        sent = [one for one in commands(lines, command) if one[0] >= 0.0]
        np.testing.assert_allclose([p[1] for _, p in sent], wanted, rtol=1e-6)
        assert (np.abs(np.array([t for t, _ in sent]) - log.t[:-1]) <= 0.21).all()
    (first,) = [one for one in commands(lines, WIND) if one[0] < 0.0]  # on the ground
    assert first[1] == pytest.approx([log.wind_speed[0], log.wind_speed_sd[0], log.wind_from[0]], rel=1e-6)
    assert {p[0] for _, p in commands(lines, HEADING)} == {1.0}
    assert lines[-1] == ["text", "4", "plan: the plan has ended; choose a mode"]


@needs_lua
def test_nothing_is_set_outside_of_guided_and_the_leg_of_the_clock_afterwards(flown: Flown) -> None:
    log = flown.exported.log
    left, back = log.t[1] + 100.0, log.t[3] + 50.0
    events = (
        "{ t = 5, armed = true }, { t = 10, mode = 15 }, "
        f"{{ t = {10 + left}, mode = 11 }}, {{ t = {10 + back}, mode = 15 }}, {{ t = {10 + back + 9} }}"
    )
    sent = commands(flight(flown.folder / "plan.lua", events), HEADING)
    assert [round(t) for t, _ in sent] == [0, round(log.t[1]), round(back)]
    assert sent[-1][1][1] == pytest.approx(log.heading[3], rel=1e-6)


@needs_lua
def test_a_refused_command_is_sent_until_it_is_accepted(flown: Flown) -> None:
    events = "{ t = 10, armed = true, mode = 15, deny = 43002 }, { t = 30, take = 43002 }, { t = 60 }"
    lines = flight(flown.folder / "plan.lua", events)
    assert [round(t) for t, _ in commands(lines, HEADING)] == [20]
    assert len(commands(lines, SPEED)) == 1
    assert [line[2] for line in lines if line[0] == "text"][1:] == [
        "plan: command 43002 is not accepted; it is sent again"
    ]


@needs_lua
def test_the_prologue_needs_the_height_of_the_ground_and_no_satellites(flown: Flown, tmp_path: Path) -> None:
    script, log = flown.folder / "plan.lua", flown.exported.log
    assert not [line for line in flight(script, "{ t = 9 }") if line[0] in ("origin", "home", "position")]
    given = tmp_path / "plan.lua"
    given.write_text(script.read_text().replace("local GROUND = nil", "local GROUND = 301.5"))
    start = [str(round(1e7 * float(value[0]))) for value in (log.lat, log.lon)]
    assert [line[:4] for line in flight(given, "{ t = 9 }")][:3] == [
        [kind, *start, "30150"] for kind in ("origin", "home", "position")
    ]
    located = flight(given, "{ t = 0, fix = 3 }, { t = 9 }")
    assert [line[1] for line in located] == [str(WIND)]
    again = flight(given, "{ t = 0, fix = 3, deny = 43004 }, { t = 5, take = 43004 }, { t = 9 }")
    assert [round(float(line[0])) for line in again] == [5]


@needs_lua
def test_a_name_cannot_end_the_comment(flown: Flown, tmp_path: Path) -> None:
    exported = replace(flown.exported, name="]] gcs:send_text(0, 'x') --[[")
    script = tmp_path / "plan.lua"
    script.write_bytes(FORMATS["lua"].content(exported))
    assert [line[1] for line in flight(script, "{ t = 5 }")] == [str(WIND)]


def test_legs_without_airspeed_have_no_heading_and_fixes_are_refused(flown: Flown) -> None:
    log = flown.exported.log
    drifting = replace(log, heading=np.where(np.arange(len(log.heading)) == 1, math.nan, log.heading))
    text = FORMATS["lua"].content(replace(flown.exported, log=drifting)).decode()
    assert text.count(", -1, ") == 1
    assert "@" not in text.split("]]", 1)[1]
    with pytest.raises(DataError, match="counts on position fixes"):
        FORMATS["lua"].content(replace(flown.exported, log=replace(log, fixes=(2,))))
