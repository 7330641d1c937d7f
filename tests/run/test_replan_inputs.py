"""Several fixes, alarms, newer forecasts, and the rest of the old plan as a candidate of the new front."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from coherent import SCENE
from pareto_ltl.planning.records import NO_PROMISE
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.flight.newer_wind import in_newer_wind
from pareto_ltl_apps.flight.replanning import comparison_lines
from pareto_ltl_apps.flight.rest_of_flight import field_alarms, warn_of_use
from pareto_ltl_verify.claims.replan import CLAIMS
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import findings, verify
from problems import smooth_wind
from quick_wind import QUICK_WIND

SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 3, "n_max": 1500, "max_steps": 80},
    "refine": {"flights": 60, "sweep_flights": 20, "classes": 1, "points": 4},
    "selection": {"draws": 300, "runs": 800},
    "wind": QUICK_WIND,
    "deployment": {"runs": 40},
    "report": "none",
}
FIRST, LAST = 6, 10  # steps of half an hour


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / "full"
    pareto_ltl.plan("phi2", "F(a & F b)", fidelity="full", out=place, **SMALL)
    return place


def near(made: Path, step: int, off: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    """Latitude and longitude of a place ``off`` [m] from the plan at ``step``."""
    results = Run.open(made)
    lon, lat = results.scene.frame.to_geographic(results.plan.path.x[step] + np.array(off))
    return float(lat[0]), float(lon[0])


def table(place: Path, *rows: tuple[Any, ...], head: str = "time,lat,lon,sd_m") -> Path:
    file = place / "fixes.csv"
    file.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n", encoding="utf-8")
    return file


# --- several fixes --------------------------------------------------------------------------------


def test_two_fixes_in_a_file_give_a_plan_whose_claims_hold(made: Path, tmp_path: Path) -> None:
    file = table(
        tmp_path,
        ("2018-10-09T05:00:00Z", *near(made, LAST, (7e3, -5e3)), 400.0),
        ("3h", *near(made, FIRST, (3e3, -2e3)), 900.0),
    )
    place = tmp_path / "rest"
    assert run_command_line(["replan", str(made), "--fixes", str(file), "--out", str(place)]) == 0
    told = json.loads((place / "replan.json").read_text())
    assert [fix["step"] for fix in told["fixes"]] == [FIRST, LAST]
    assert told["step"] == LAST
    assert told["alarms"] == []
    found = verify(place)
    assert not [finding.claim for finding in found if not finding.holds]
    names = [finding.claim for finding in found]
    assert "replan: position given the fixes" in names
    assert "replan: expected wind given the fixes" in names


def test_an_earlier_fix_tells_more_than_none(made: Path) -> None:
    last = (LAST * 1800.0, *near(made, LAST, (7e3, -5e3)), 2000.0)
    first = (FIRST * 1800.0, *near(made, FIRST, (3e3, -2e3)), 300.0)
    alone, both = (pareto_ltl.replan(made, fixes=rows).situation.learnt for rows in ([last], [first, last]))
    assert alone is not None
    assert both is not None
    assert both.sd < alone.sd
    assert (both.told**2).sum() > (alone.told**2).sum()


def test_a_fix_between_two_steps_is_moved_along_the_plan(made: Path) -> None:
    path = Run.open(made).plan.path
    between = 0.75 * path.x[LAST] + 0.25 * path.x[LAST - 1]
    lon, lat = Run.open(made).scene.frame.to_geographic(between)
    done = pareto_ltl.replan(made, (LAST - 0.25) * 1800.0, (float(lat[0]), float(lon[0]), 100.0))
    assert done.situation.step == LAST
    assert done.situation.learnt is not None
    assert np.linalg.norm(done.situation.learnt.mean - path.x[LAST]) < 50.0


@pytest.mark.parametrize(
    ("rows", "head", "said"),
    [
        ([], "time,lat,lon,sd_m", "0 fixes; expected 1 to 200"),
        ([("3h", 37.0, -94.0)], "time,lat,lon,sd_m", "3 values for 4 columns"),
        ([("3h", "here", -94.0, 100)], "time,lat,lon,sd_m", "are not three numbers"),
        (
            [("3h", 37.0, -94.0, 0)],
            "time,lat,lon,sd_m",
            "line 2: its standard deviation must be at least 0.01 m",
        ),
        ([("-1h", 37.0, -94.0, 100)], "time,lat,lon,sd_m", "line 2: time"),
        ([("0", 37.0, -94.0, 100)], "time,lat,lon,sd_m", "before the first step"),
        ([("90h", 37.0, -94.0, 100)], "time,lat,lon,sd_m", "after the last step"),
        ([("3h", 37.0, -94.0, 100), ("3h", 38.0, -94.0, 100)], "time,lat,lon,sd_m", "contradict each other"),
        ([("3h", 1.0, 2.0, 100)], "time,x,y,sd_m", "expected time,lat,lon,sd_m"),
        ([("3h", 1.0, 2.0, 100)], "when,lat,lon,sd_m", "the columns are"),
    ],
)
def test_a_file_of_fixes_that_cannot_be_used_is_refused_in_one_line(
    made: Path, tmp_path: Path, rows: list[tuple[Any, ...]], head: str, said: str
) -> None:
    with pytest.raises((ConfigError, DataError), match=said) as caught:
        pareto_ltl.replan(made, fixes=table(tmp_path, *rows, head=head))
    assert "\n" not in str(caught.value)


def test_rows_that_are_no_fixes_are_refused(made: Path) -> None:
    with pytest.raises(ConfigError, match="fix 1 has 0 values; expected time, latitude, longitude"):
        pareto_ltl.replan(made, fixes=[("3h", *near(made, FIRST), 500.0), ()])


def test_two_equal_and_very_accurate_fixes_are_learnt(made: Path) -> None:
    place = near(made, LAST)
    done = pareto_ltl.replan(made, fixes=[("5h", *place, 0.01), ("5h", *place, 0.01)])
    assert done.situation.learnt is not None
    assert done.situation.learnt.sd < 0.02


def test_one_fix_and_several_or_another_time_are_refused(made: Path, tmp_path: Path) -> None:
    file = table(tmp_path, ("3h", *near(made, FIRST), 300.0))
    with pytest.raises(ConfigError, match="both given"):
        pareto_ltl.replan(made, "3h", (37.0, -94.0, 100.0), fixes=file)
    with pytest.raises(ConfigError, match="a plan begins at its last fix"):
        pareto_ltl.replan(made, "5h", fixes=file)
    with pytest.raises(DataError, match="cannot be read"):
        pareto_ltl.replan(made, fixes=tmp_path / "none.csv")


# --- alarms ---------------------------------------------------------------------------------------


def test_a_fix_outside_the_law_is_an_alarm_without_a_promise(made: Path, tmp_path: Path) -> None:
    place = tmp_path / "alarm"
    done = pareto_ltl.replan(made, "5h", (*near(made, LAST - 3), 300.0), out=place)
    assert done.plan.facts()["fails"] == NO_PROMISE
    (alarm,) = done.situation.alarms
    assert "standard deviations" in alarm
    assert "is a clock wrong by 90 min" in alarm
    assert "outside the law" in alarm
    assert done.advice == "alarm"
    assert done.plan.promise is None
    lines = "\n".join(comparison_lines(done))
    assert "ALARM" in lines
    assert "failure rate of" not in lines
    assert "no files to fly are written (no mission.plan" in lines
    told = json.loads((place / "replan.json").read_text())
    assert told["old"] is told["new"] is told["difference"] is None
    assert json.loads((place / "plan.json").read_text())["promise"] is None
    assert not [finding.claim for finding in verify(place) if not finding.holds]


@pytest.fixture(scope="module")
def alarmed(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("alarmed") / "rest"
    shown = {"formats": ["kml", "qgc"], "flights": 500}
    pareto_ltl.replan(made, "5h", (*near(made, LAST - 3), 300.0), out=place)
    pareto_ltl.export(place, place, **shown)
    return place


def test_no_file_of_a_plan_after_an_alarm_has_a_probability(alarmed: Path) -> None:
    there = {file.name for file in alarmed.iterdir()}
    files = {"kml", "qgc"}  # written by hand afterwards
    assert not there & {one.file for key, one in FORMATS.items() if key not in files}
    assert not (alarmed / "exports").exists()
    assert not there & {"front.csv", "front.npz", "deployments.npz"}
    metrics = json.loads((alarmed / "metrics.json").read_text())
    assert not [name for name in metrics if "failure" in name or "risk" in name or "promise" in name]
    plan = json.loads((alarmed / "plan.json").read_text())
    risks = ("mission_risk_paper", "mission_risk", "mission_risk_ordered", "collision_risk")
    assert {plan["objectives"][name] for name in risks} == {None}
    assert plan["prices"] == []
    assert "segments" not in plan
    for name in ("plan.kml", "mission.plan"):
        text = (alarmed / name).read_text()
        assert NO_PROMISE.capitalize() in text
        assert "% (95 %" not in text
    page = pareto_ltl.page(alarmed, alarmed.parent / "page.html").read_text()
    assert "no promise" in page
    assert '"planned": [[' in page.replace('"planned":[', '"planned": [')
    assert "upper bound for the plan" not in page


def test_a_plan_after_an_alarm_is_replanned_and_has_no_front_to_choose_from(alarmed: Path) -> None:
    done = pareto_ltl.replan(alarmed, "2h", (*near(alarmed, 4), 300.0))
    assert not done.situation.alarms
    assert done.plan.promise is not None
    with pytest.raises(DataError, match="made after an alarm"):
        pareto_ltl.choose(alarmed, failure=0.05)


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("plan.json", lambda told: told["objectives"].update(mission_risk=0.01)),
        ("metrics.json", lambda told: told.update(failure_coherent=0.0)),
    ],
)
def test_a_probability_after_an_alarm_is_a_lie(alarmed: Path, file: str, change: Any) -> None:
    honest = (alarmed / file).read_text()
    told = json.loads(honest)
    change(told)
    try:
        (alarmed / file).write_text(json.dumps(told))
        found = {finding.claim: finding.holds for finding in findings(open_evidence(alarmed), CLAIMS)}
    finally:
        (alarmed / file).write_text(honest)
    assert found["replan: alarms, and no promise after them"] is False


# --- a newer forecast -----------------------------------------------------------------------------


def forecast(
    place: Path, scale: float = 1.0, first: int = 3, hours: int = 36, shift: float = 0.0, add: float = 0.0
) -> Path:
    """The winds of the sample from an hour of 9 October on, times ``scale`` and more ``add`` [m/s]."""
    from pareto_ltl.support.resources import SAMPLE_WINDS

    head, *rows = SAMPLE_WINDS.read_text(encoding="utf-8").splitlines()
    names = head.split(",")
    times = sorted({row.split(",")[names.index("time")] for row in rows})[
        first // 3 : (first + hours) // 3 + 1
    ]
    kept = []
    for row in rows:
        cells = dict(zip(names, row.split(","), strict=True))
        if cells["time"] not in times:
            continue
        cells["u"], cells["v"] = (str(float(cells[name]) * scale + add) for name in ("u", "v"))
        cells["lon"] = str(float(cells["lon"]) + shift)
        kept.append(",".join(cells[name] for name in names))
    file = place / "newer.csv"
    file.write_text("\n".join([head, *kept]) + "\n", encoding="utf-8")
    return file


@pytest.mark.parametrize("fixed", [False, True])
def test_the_rest_is_planned_in_a_newer_forecast(made: Path, tmp_path: Path, fixed: bool) -> None:
    fix = (*near(made, LAST, (4e3, 2e3)), 400.0) if fixed else None
    place = tmp_path / "newer"
    done = pareto_ltl.replan(made, "5h", fix, wind=forecast(tmp_path, 0.9), out=place)
    assert "newer.csv" in done.wind
    assert done.situation.learnt is not None
    assert (done.situation.learnt.sd < 450.0) == fixed
    assert Run.open(place).wind.error is not None
    assert Run.open(place).wind.error.parts
    assert json.loads((place / "replan.json").read_text())["wind"] == done.wind
    assert not [finding.claim for finding in verify(place) if not finding.holds]


def test_a_forecast_that_is_far_from_the_old_one_is_an_alarm(made: Path, tmp_path: Path) -> None:
    done = pareto_ltl.replan(made, "5h", wind=forecast(tmp_path, add=12.0))
    (alarm,) = done.situation.alarms
    assert "the newer forecast moves the robot" in alarm
    assert done.plan.promise is None


def test_a_robot_that_returns_to_its_path_raises_no_alarm(made: Path, tmp_path: Path) -> None:
    run = Run.open(made)
    newer, (alarm,) = in_newer_wind(run, forecast(tmp_path, first=0, add=12.0))
    assert "the newer forecast moves the robot" in alarm
    assert field_alarms(run.problem.with_feedback(3600.0), newer.problem, run.plan.path) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"hours": 3, "first": 0}, "is not covered by the wind of"),
        ({"shift": 120.0}, "within .* km of the scene"),
    ],
)
def test_a_forecast_of_another_time_or_place_is_refused(
    made: Path, tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(DataError, match=said) as caught:
        pareto_ltl.replan(made, "5h", wind=forecast(tmp_path, **changes))
    assert "the newer forecast cannot be used" in str(caught.value)
    with pytest.raises(ConfigError, match="no such file"):
        pareto_ltl.replan(made, "5h", wind=tmp_path / "none.grib2")


def test_an_older_or_shorter_forecast_is_used_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    hours = 3600.0 * np.arange(4.0)
    old = replace(smooth_wind(SCENE, until=None), leads=hours)
    for late, ends, words in (
        (7200.0, 3.0, ()),
        (7200.0, 1.5, ("ends 1.5 h before the old plan would arrive",)),
        (-3600.0, 3.0, ("begins 1 h before it",)),
    ):
        caplog.clear()
        new = replace(old, leads=hours + 7200.0 - late, until=3600.0 * ends)
        with caplog.at_level(logging.WARNING):
            warn_of_use(old, new, 7200.0, 3.0 * 3600.0)
        assert len(caplog.messages) == len(words)
        assert all(word in caplog.text for word in words)


def test_a_forecast_that_ends_before_the_old_plan_gives_a_new_plan_and_no_rate_of_the_old_one(
    made: Path, tmp_path: Path
) -> None:
    """The old plan arrives at 10:00 or later; the last field, of 9:00, is valid until 9:30."""
    place, newer = tmp_path / "short", forecast(tmp_path, first=0, hours=9, add=2.0)
    done = pareto_ltl.replan(made, "1h", wind=newer, out=place)
    assert done.old is None
    assert done.advice == "outlasted"
    assert len(done.plan.path.u) < len(done.rest.u)
    assert "ends before the rest of the old plan would arrive" in "\n".join(comparison_lines(done))
    told = json.loads((place / "replan.json").read_text())
    assert told["old"] is told["difference"] is None
    assert told["new"]["failure"] == done.new.failure
    assert not [finding.claim for finding in verify(place) if not finding.holds]


# --- the rest of the old plan ---------------------------------------------------------------------


def test_the_new_plan_is_not_worse_than_the_rest_of_the_old_one(made: Path) -> None:
    """With a rule that prefers short paths, the rule's choice fails more often than the rest."""
    for off in ((2e3, 1e3), (8e3, -9e3)):
        done = pareto_ltl.replan(made, "3h", (*near(made, FIRST, off), 300.0))
        assert done.difference[1] <= 0.0
        assert done.advice in ("new", "either")


def test_the_rest_with_its_controls_is_a_path_of_the_race(made: Path) -> None:

    done = pareto_ltl.replan(made, "3h", (*near(made, FIRST, (2e3, 1e3)), 300.0))
    assert done.run is not None
    same = done.run.records["candidates"][0]
    np.testing.assert_allclose(same.u, done.rest.u, atol=1e-6)
    assert same.origin == "rest of the old plan, same controls"


# --- lies -----------------------------------------------------------------------------------------


def test_lies_about_what_fixes_show_are_caught(made: Path, tmp_path: Path) -> None:
    place = tmp_path / "rest"
    pareto_ltl.replan(made, "5h", (*near(made, LAST, (7e3, -5e3)), 400.0), out=place)
    file = place / "replan.json"
    honest = json.loads(file.read_text())
    lies: dict[str, dict[str, Any]] = {
        "replan: start, spread and time of the rest": {"time_s": honest["time_s"] + 600.0},
        "replan: alarms, and no promise after them": {"fixes": [honest["fixes"][0] | {"distance": 5.0}]},
        "replan: failure rates of the old and the new plan": {
            "new": honest["new"] | {"failure": 0.9, "high": 1.0}
        },
        "replan: the rest of the old plan": {"step": honest["step"] + 1},
        "replan: position given the fixes": {"fixes": [honest["fixes"][0] | {"sd": 4000.0}]},
        "replan: expected wind given the fixes": {"fixes": [honest["fixes"][0] | {"place": [0.0, 0.0]}]},
    }  # fmt: skip
    for claim, lie in lies.items():
        file.write_text(json.dumps(honest | lie))
        found = {f.claim: f.holds for f in findings(open_evidence(place), CLAIMS)}
        assert not found[claim]
    file.write_text(json.dumps(honest))
    assert all(f.holds for f in findings(open_evidence(place), CLAIMS))
