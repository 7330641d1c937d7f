"""A flight from plan to plan: new plans, who decides, and the journal of each."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.flight import replans as module
from pareto_ltl_apps.flight.following import Session, follow
from pareto_ltl_apps.flight.journal import read_journal
from pareto_ltl_apps.flight.replans import Forecasts, Replans, ReplanSettings
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.telemetry import Reading
from pareto_ltl_apps.flight.watch import WatchSettings
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
WATCHING = WatchSettings(every=1800.0, members=400, alarm=1.0)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / "phi1"
    pareto_ltl.plan("phi1", "F a", out=place, **SMALL)
    return place


def flight(made: Path, off: float = 25e3) -> Iterator[Reading]:
    """The planned controls, with a fix beside the expected position after a third of them."""
    results = pareto_ltl.load_results(made)
    plan, scene = results.plan, results.scene
    assert plan.navigation is not None
    assert plan.navigation.heading_true is not None
    third = len(plan.path.u) // 3
    for k in range(len(plan.path.u)):
        for minute in range(30):
            place, sd = None, float("nan")
            if (k, minute) == (third, 5):
                lon, lat = scene.frame.to_geographic(plan.path.x[third : third + 1] + off)
                place, sd = (float(lat[0]), float(lon[0])), 500.0
            heading, airspeed = plan.navigation.heading_true[k], plan.navigation.airspeed[k]
            yield Reading(k * 1800.0 + minute * 60.0, float(heading), float(airspeed), place, sd)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A new plan is made before the watch goes on, and is better in the same flights."""
    whole = subprocess.Popen

    def patient(*args: Any, **more: Any) -> Any:
        process = whole(*args, **more)
        process.wait()
        return process

    monkeypatch.setattr(module.subprocess, "Popen", patient)


def followed(made: Path, folder: Path, **more: Any) -> tuple[list[Event], Session]:
    session = Session(pareto_ltl.load_results(made), folder, WATCHING, ReplanSettings(**more))
    return list(session.events(flight(made))), session


def test_a_plan_is_offered_only_if_fewer_of_the_same_flights_fail(
    made: Path, tmp_path: Path, at_once: None
) -> None:
    events, session = followed(made, tmp_path / "f", enabled=True)
    found = next(event for event in events if event["event"] == "replanned")
    assert found["better"] is (found["new"] < found["old"] and found["better"])
    assert not [event for event in events if event["event"] == "switched"]  # nobody typed y
    assert session.folder == tmp_path / "f"


def test_after_a_switch_the_new_plan_is_followed_from_what_was_flown(
    made: Path, tmp_path: Path, at_once: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Replans, "_compared", lambda *_: (0.5, 0.1, True))
    events, session = followed(made, tmp_path / "f", enabled=True, auto=True)
    switch = next(event for event in events if event["event"] == "switched")
    assert session.folder == Path(switch["directory"]) / "follow"
    first, second = (list(read_journal(place / "follow.jsonl")) for place in (tmp_path / "f", session.folder))
    assert first[-1] == switch
    assert second[0]["event"] == "begin"
    assert second[-1]["event"] == "end"
    until = switch["time"] - switch["at"]
    flown = sum(event["seconds"] for event in second if event["event"] == "flown" and event["time"] <= until)
    assert flown == pytest.approx(until)
    status = next(event for event in second if event["event"] == "status")
    place = next(event["place"] for event in first if event["event"] == "fix")
    assert np.hypot(status["x"] - place[0], status["y"] - place[1]) < 60e3
    assert all(json.dumps(event, allow_nan=False) for event in second)
    with pytest.raises(ConfigError, match="this flight goes on with another plan"):
        list(follow(made, [], out=tmp_path / "f", resume=True, settings=WATCHING))


def test_a_file_of_the_wind_folder_is_taken_once_and_when_it_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(module, "clock", SimpleNamespace(monotonic=lambda: now[0]))
    (tmp_path / "old.csv").write_text("old")
    looks = Forecasts(tmp_path)
    found = []
    for second in range(0, 30, 3):
        now[0] = float(second)
        if second in (6, 9):
            with (tmp_path / "new.csv").open("a") as file:
                file.write("part")
        if second == 15:
            (tmp_path / "next.csv.part").write_text("later")
        if second == 18:
            shutil.move(tmp_path / "next.csv.part", tmp_path / "next.csv")
        found.append(looks.newest())
    assert [path.name for path in found if path is not None] == ["new.csv", "next.csv"]
    assert found.index(tmp_path / "new.csv") == 4  # the size was the same at two looks
    assert Forecasts(None).newest() is None


def test_a_damaged_forecast_is_an_alarm_and_the_watch_goes_on(
    made: Path, tmp_path: Path, at_once: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOOK", 0.0)
    wind = tmp_path / "wind"
    wind.mkdir()

    def stream() -> Iterator[Reading]:
        for count, reading in enumerate(flight(made)):
            if count == 60:
                (wind / "new.csv").write_text("no,forecast\n1,2\n")
            yield reading

    settings = ReplanSettings(wind_folder=wind)
    session = Session(pareto_ltl.load_results(made), tmp_path / "f", WATCHING, settings)
    events = list(session.events(stream()))
    said = [event["text"] for event in events if event["event"] == "alarm" and event["kind"] == "replan"]
    assert len(said) == 1
    assert said[0].startswith("no new plan: ")
    assert events[-1]["event"] == "end"


def test_a_full_disk_is_an_alarm_and_the_watch_goes_on(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pareto_ltl_apps.flight.journal.os.fsync", full)
    events, _ = followed(made, tmp_path / "f")
    alarms = [event["text"] for event in events if event["event"] == "alarm" and event["kind"] == "journal"]
    assert len(alarms) == 1
    assert "No space left" in alarms[0]
    assert events[-1]["event"] == "end"
