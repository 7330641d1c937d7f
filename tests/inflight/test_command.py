"""``pareto-ltl follow`` as a user calls it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import pareto_ltl
from pareto_ltl.extend import Frame
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.flight.journal import read_journal
from pareto_ltl_apps.flight.telemetry import read_log
from patience import wait_until
from quick_wind import QUICK_WIND

SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 2, "n_max": 1000},
    "refine": {"flights": 100, "sweep_flights": 60, "points": 3},
    "selection": {"runs": 500, "draws": 100},
    "wind": QUICK_WIND,
    "deployment": {"runs": 40},
    "report": "none",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / "phi1"
    pareto_ltl.plan("phi1", "F a", out=place, **SMALL)
    return place


@pytest.fixture(scope="module")
def telemetry(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The planned headings and airspeeds, a row a minute, with a fix near the expected position."""
    plan = pareto_ltl.load_results(made).plan
    assert plan.navigation is not None
    assert plan.navigation.lat is not None
    assert plan.navigation.lon is not None
    assert plan.navigation.heading_true is not None
    rows, half = ["time,heading_true,airspeed_tas_m_s,lat,lon,fix_sd_m"], len(plan.path.u) // 2
    for k, (heading, airspeed) in enumerate(
        zip(plan.navigation.heading_true, plan.navigation.airspeed, strict=True)
    ):
        for minute in range(30):
            place = (
                f"{plan.navigation.lat[k]},{plan.navigation.lon[k]},3000"
                if (k, minute) == (half, 0)
                else ",,"
            )
            rows.append(f"{k * 1800 + minute * 60},{heading},{airspeed},{place}")
    file = tmp_path_factory.mktemp("telemetry") / "telemetry.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def test_a_log_becomes_lines_a_journal_and_a_figure(
    made: Path, telemetry: Path, tmp_path: Path, capsys
) -> None:
    words = ["follow", str(made), "--log", str(telemetry), "--out", str(tmp_path), "--every", "3600"]
    assert run_command_line([*words, "--flights", "200"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("+0:00:00  watching plan: F a")
    assert "in coherent winds (promised" in lines[1]
    assert any("position fix" in line and ", used" in line for line in lines)
    assert lines[-1].split("  ")[1].startswith("end of the telemetry")
    assert "complete with probability" in lines[-1]
    kinds = [event["event"] for event in read_journal(tmp_path / "follow.jsonl")]
    assert kinds[0] == "begin"
    assert kinds[-1] == "end"
    assert (tmp_path / "follow.png").stat().st_size > 10_000
    assert not (tmp_path / "search_area.geojson").read_bytes().count(b"NaN")


def test_the_wind_of_a_status_blows_from_true_north(made: Path, telemetry: Path) -> None:
    """At the edge of the map, where the plane is turned by degrees against north."""
    run = pareto_ltl.load_results(made)
    crs = str(run.scene.crs)
    readings = list(read_log(telemetry, run.scene.time_zero, on_earth=True))[:3]
    status = next(event for event in pareto_ltl.follow(run, readings) if event["event"] == "status")
    towards = float(Frame(crs).heading([[status["x"], status["y"]]], np.array([status["wind"]]))[0])
    assert status["wind_from"] == pytest.approx((towards + 180.0) % 360.0, abs=1e-6)
    assert abs((status["wind_from"] - np.degrees(np.arctan2(*-np.array(status["wind"])))) % 360.0) > 0.5


def test_the_search_area_is_where_the_plan_goes_on(made: Path, telemetry: Path, tmp_path: Path) -> None:
    """Nothing is heard after a third of the flight: the areas are around the planned positions, and grow."""
    rows, plan = telemetry.read_text().splitlines(), pareto_ltl.load_results(made).plan
    file = tmp_path / "lost.csv"
    file.write_text("\n".join(rows[: len(rows) // 3]) + "\n")
    words = ["follow", str(made), "--log", str(file), "--out", str(tmp_path / "lost"), "--flights", "100"]
    assert run_command_line(words) == 0
    areas = json.loads((tmp_path / "lost" / "search_area.geojson").read_text())["features"]
    steps = len(plan.path.u) - int((len(rows) // 3 - 2) * 60 / 1800)
    assert len(areas) == 3 * (steps + 1)
    last = [area for area in areas if area["properties"]["t_s"] == len(plan.path.u) * 1800.0]
    assert [area["properties"]["probability"] for area in last] == [0.5, 0.9, 0.99]
    assert plan.navigation is not None
    assert plan.navigation.lat is not None
    assert plan.navigation.lon is not None
    sizes = []
    for area in last:
        shape = shapely.geometry.shape(area["geometry"])
        assert shape.contains(shapely.Point(plan.navigation.lon[-1], plan.navigation.lat[-1]))
        sizes.append(shape.area)
    assert sizes[2] / sizes[0] == pytest.approx(np.log(0.01) / np.log(0.5), rel=0.02)
    kml = (tmp_path / "lost" / "search_area.kml").read_text()
    assert kml.count("<Placemark>") == len(areas)
    assert "coherent winds" in kml


def test_telemetry_of_another_day_gives_areas_from_the_exact_start(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "early.csv", tmp_path / "early"
    file.write_text("time,heading_true,airspeed_tas_m_s\n2001-01-01T00:00:00Z,10,20\n")
    words = ["follow", str(made), "--log", str(file), "--out", str(out), "--flights", "100"]
    assert run_command_line(words) == 0
    assert "1 before departure" in capsys.readouterr().out
    first = json.loads((out / "search_area.geojson").read_text())["features"][0]
    shape = shapely.geometry.shape(first["geometry"])
    assert shape.is_valid
    assert 0 < shape.area < 1e-9


def test_a_fix_starts_a_new_plan(made: Path, telemetry: Path, tmp_path: Path, capsys) -> None:
    words = ["follow", str(made), "--log", str(telemetry), "--out", str(tmp_path), "--every", "7200"]
    assert run_command_line([*words, "--flights", "100", "--replan"]) == 0
    said = next(event for event in read_journal(tmp_path / "follow.jsonl") if event["event"] == "replanned")
    document = json.loads((tmp_path / "replan_1" / "replan.json").read_text())
    assert (said["old"], said["new"]) == (document["old"]["failure"], document["new"]["failure"])
    line = next(line for line in capsys.readouterr().out.splitlines() if "a new plan from" in line)
    assert "coherent winds" in line
    assert str(tmp_path / "replan_1") in line
    assert pareto_ltl.load_results(tmp_path / "replan_1").plan.promise is not None


def test_json_has_one_object_an_event(made: Path, telemetry: Path, tmp_path: Path, capsys) -> None:
    words = ["follow", str(made), "--log", str(telemetry), "--out", str(tmp_path / "j"), "--json"]
    assert run_command_line([*words, "--every", "7200", "--flights", "100"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert events[-1]["event"] == "end"
    assert all("time" in event for event in events)
    assert events[0]["not_covered"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--log", "none.csv"], "cannot be read"),
        (["--log", "{bad}"], "no column heading_true; expected time,heading_true,airspeed_tas_m_s (or airs"),
        (
            ["--log", "{unknown}"],
            "an airspeed of unknown kind, 'airspeed_m_s'; give one column, airspeed_tas_m_s if it is the "
            "true airspeed, or airspeed_cas_m_s if it is calibrated",
        ),
        (["--log", "{both}"], "two airspeeds; give one column, airspeed_tas_m_s if"),
        (["--log", "{log}", "--alarm", "2"], "alarm must be a failure rate above 0 and at most 1, got 2"),
        (["--log", "{log}", "--send", "wind"], "--send needs --connect"),
        (["--log", "{log}", "--resume"], "there is no journal to resume; start without --resume"),
        (
            ["--log", "{used}", "--out", "{there}"],
            "is there already: give --resume to continue it, or another --out",
        ),
        (
            ["--connect", "udpin:127.0.0.1:0", "--send", "wings"],
            "expected some of wind, heading, speed, position",
        ),
    ],
)
def test_what_cannot_be_used_is_one_line(
    words: list[str], message: str, made: Path, telemetry: Path, tmp_path: Path, capsys
) -> None:
    bad, there = tmp_path / "bad.csv", tmp_path / "there"
    bad.write_text("time,speed\n0,1\n")
    there.mkdir()
    (there / "follow.jsonl").write_text("{}\n")
    unknown, both = tmp_path / "unknown.csv", tmp_path / "both.csv"
    unknown.write_text("time,heading_true,airspeed_m_s\n0,1,2\n")
    both.write_text("time,heading_true,airspeed_tas_m_s,airspeed_cas_m_s\n0,1,2,2\n")
    names = {
        "unknown": unknown,
        "both": both,
        "log": telemetry,
        "bad": bad,
        "used": telemetry,
        "there": there,
    }
    place = [] if "--out" in words else ["--out", str(tmp_path / "new")]
    given = [word.format(**names) for word in words]
    assert run_command_line(["follow", str(made), *given, *place]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert len(error.strip().splitlines()) == 1


def test_a_killed_process_is_resumed(made: Path, telemetry: Path, tmp_path: Path) -> None:
    """The same end as without the kill, from the same telemetry heard a second time."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    words = ["follow", str(made), "--log", str(telemetry), "--every", "300", "--flights", "200"]
    assert run_command_line([*words, "--out", str(whole)]) == 0
    process = subprocess.Popen(
        [sys.executable, "-m", "pareto_ltl", *words, "--out", str(killed)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    journal = killed / "follow.jsonl"
    wait_until(lambda: journal.exists() and b'"fix"' in journal.read_bytes())
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = list(read_journal(journal))
    assert before[-1]["event"] != "end"
    assert any(event["event"] == "fix" for event in before)  # a later one would correct the position
    assert run_command_line([*words, "--out", str(killed), "--resume"]) == 0
    one, other = (list(read_journal(place / "follow.jsonl"))[-1] for place in (whole, killed))
    assert list(read_journal(journal))[: len(before)] == before
    assert other["time"] == pytest.approx(one["time"])
    for key in ("x", "y", "major"):
        assert other[key] == pytest.approx(one[key], rel=0.01, abs=500.0)
