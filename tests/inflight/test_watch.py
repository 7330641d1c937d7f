"""A watch: what it says, what it refuses, and that nothing stops it or is lost."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence

from coherent import coherent_problem
from flight_quantities.medium import WATER
from levels import AT_NIGHT
from pareto_ltl.planning.power import Body, EnergyModel
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.flight.journal import SCHEMA, Journal, read_journal
from pareto_ltl_apps.flight.lines import event_line
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.telemetry import Reading, Sieve
from pareto_ltl_apps.flight.watch import Watch, WatchSettings
from watched import DT, FLIGHT_TIME, PATH, PLAN, PROBLEM, heading_of

BEGIN: Event = {
    "event": "begin", "time": 0.0, "schema": SCHEMA, "plan": "x", "formula": "F a", "departure": None,
    "members": 100,
}  # fmt: skip
SPOILT = {  # lines that are no event, and why
    "nonsense": "no event",
    "[1]": "no event",
    '{"event":"flown","time":1,"seconds":1,"east":1}': "the event flown has no north",
    '{"event":"flown","seconds":1,"east":1,"north":0}': "the event flown has no time",
    '{"event":"flown","time":1,"seconds":-1,"east":1,"north":0}': "seconds of the event flown is -1",
    '{"event":"flown","time":NaN,"seconds":1,"east":1,"north":0}': "time of the event flown is None",
    '{"event":"flown","time":1,"seconds":1,"east":1e9,"north":0}': "faster than 1000 m/s",
    '{"event":"fix","time":1,"place":[1],"given":[1,1],"sd":1,"distance":1,"use":"learnt"}': "place of the",
    '{"event":"fix","time":1,"place":[1,1],"given":[1,1],"sd":1,"distance":1,"use":"x"}': "use of the",
    "[" * 100_000: "no event",
}


def new_watch(problem: Problem = PROBLEM, **more: float) -> Watch:
    cfg = WatchSettings(**{"every": 400.0, "lines": 400.0, "members": 100, **more})  # type: ignore[arg-type]
    return Watch(problem, PLAN, cfg, SeedSequence(2))


def as_planned(every: float = 20.0, until: float = FLIGHT_TIME, fixes: dict[float, tuple] | None = None):
    """Telemetry of the planned controls, with fixes (x, y, sd) at some times."""
    fixes = dict(fixes or {})
    for t in np.arange(0.0, until + 1e-9, every):
        heading, airspeed = heading_of(PATH.u[min(int((t + 1e-6) / DT), len(PATH.u) - 1)])
        x, y, sd = fixes.pop(float(t), (math.nan, math.nan, math.nan))
        yield Reading(float(t), heading, airspeed, None if math.isnan(x) else (x, y), sd)


def kinds(events: Iterable[Event]) -> list[str]:
    return [event["event"] for event in events if event["event"] != "flown"]


def alarms(events: Iterable[Event]) -> dict[str, str]:
    return {event["kind"]: event["text"] for event in events if event["event"] == "alarm"}


def test_a_flight_as_planned_keeps_its_corridor_and_its_promise() -> None:
    events = list(new_watch(alarm=1.0).events(as_planned()))
    status = [event for event in events if event["event"] in ("status", "end")]
    assert [event["time"] for event in status[:-1]] == list(np.arange(0.0, FLIGHT_TIME, 400.0))
    assert events[-1]["event"] == "end"
    assert set(alarms(events)) == {"goal"}  # of the flights of this plan 57 % fail
    assert events[-1]["complete"] == pytest.approx(1.0 - events[-1]["failure"])
    assert all(event["corridor"] < 0.01 for event in status)
    assert all(event["law"] == "coherent" for event in status)
    np.testing.assert_allclose([events[-1]["x"], events[-1]["y"]], PATH.x[-1], atol=2.5)
    goals = [event["goal"] for event in status]
    assert goals[0] == ["a"]
    line = event_line(status[0])
    assert "coherent winds" in line
    assert "next a in" in line
    for event in events:
        json.dumps(event, allow_nan=False)


def test_a_wrong_heading_leaves_the_corridor_and_raises_the_alarm() -> None:
    wrong = [Reading(r.time, r.heading + 30.0, r.airspeed) for r in as_planned()]
    events = list(new_watch(alarm=0.9).events(wrong))
    assert "outside the corridor of 99 %" in alarms(events)["corridor"]
    assert "more than --alarm 0.9" in alarms(events)["promise"]
    lines = [event_line(event) for event in events if event["event"] == "alarm"]
    assert all("What can be done: " in line for line in lines)


def test_a_fix_narrows_the_ellipse() -> None:
    place = PATH.x[10] + [200.0, -100.0]
    watch = new_watch()
    events = list(watch.events(as_planned(fixes={1000.0: (*place, 30.0)})))
    fix = next(k for k, event in enumerate(events) if event["event"] == "fix")
    before = [event["major"] for event in events[:fix] if event["event"] == "status"][-1]
    after = next(event for event in events[fix:] if event["event"] == "status")
    assert events[fix]["use"] == "learnt"
    assert after["major"] < 0.2 * before
    assert np.hypot(after["x"] - place[0], after["y"] - place[1]) < 60.0


def test_a_lying_fix_is_an_alarm_and_changes_nothing() -> None:
    """A jump of the position, as of a jammed receiver."""
    far = PATH.x[10] + [9e3, 9e3]
    honest, lied = (new_watch(alarm=1.0) for _ in "ab")
    told = list(lied.events(as_planned(fixes={1000.0: (*far, 10.0)})))
    plain = list(honest.events(as_planned()))
    assert "it is not used" in alarms(told)["fix"]
    assert "probability" in alarms(told)["fix"]
    assert (told[-1]["x"], told[-1]["major"]) == pytest.approx((plain[-1]["x"], plain[-1]["major"]))


def test_fixes_that_agree_with_each_other_are_believed_in_the_end() -> None:
    off = np.array([7e3, -6e3])
    given_ = {t: (*(PATH.x[int(t / DT)] + off), 20.0) for t in (1000.0, 1200.0, 1400.0)}
    watch = new_watch(alarm=1.0)
    events = list(watch.events(as_planned(until=1500.0, fixes=given_)))
    uses = [event["use"] for event in events if event["event"] == "fix"]
    assert uses == ["refused", "refused", "restarted"]
    assert (
        "what was learnt of the wind is forgotten"
        in [event["text"] for event in events if event["event"] == "alarm" and event["kind"] == "fix"][-1]
    )
    assert np.hypot(*(np.array([events[-1]["x"], events[-1]["y"]]) - PATH.x[15] - off)) < 600.0


def test_nothing_is_flown_after_the_end_of_the_plan() -> None:
    """A vehicle that has landed is silent: the last airspeed does not carry it on."""
    heard = as_planned(every=20.0, until=FLIGHT_TIME - 40.0)
    events = list(new_watch(alarm=1.0).events([*heard, Reading(FLIGHT_TIME + 70.0)]))
    assert events[-1]["time"] == pytest.approx(FLIGHT_TIME)
    assert "corridor" not in alarms(events)


def test_silence_is_an_alarm_and_the_plan_is_assumed() -> None:
    readings = [r for r in as_planned() if not 800.0 < r.time < 2000.0]
    events = list(new_watch(alarm=1.0).events(readings))
    assert (
        "no heading and airspeed for 1200 s: the controls of the plan are assumed"
        in alarms(events)["silence"]
    )
    np.testing.assert_allclose([events[-1]["x"], events[-1]["y"]], PATH.x[-1], atol=2.5)


def test_fixes_in_quick_succession_are_thinned_and_counted() -> None:
    fixes = {float(t): (*PATH.x[10], 50.0) for t in range(1000, 1010)}
    events = list(new_watch(alarm=1.0).events(as_planned(every=1.0, until=1010.0, fixes=fixes)))
    assert kinds(events).count("fix") == 1
    assert events[-1]["refused"] == {"position within 10 s of the last": 9}


def test_the_sieve_names_every_reading_that_it_refuses() -> None:
    sieve = Sieve(20.0)
    given_ = [
        Reading(0.0, 10.0, 5.0), Reading(0.0, 10.0, 5.0), Reading(2.0, 10.0, 5.0), Reading(1.0, 10.0, 5.0),
        Reading(math.nan, 10.0, 5.0), Reading(3.0, math.inf, 5.0), Reading(4.0, 10.0, 500.0),
        Reading(9e9, 10.0, 5.0), Reading(5.0, 10.0, 5.0, (math.nan, 1.0), 5.0),
        Reading(6.0, 10.0, 5.0, (1.0, 1.0), -5.0), Reading(7.0, 370.0, 5.0, (1.0, 1.0), 5.0),
    ]  # fmt: skip
    passed = list(sieve.usable(given_))
    assert [reading.time for reading in passed] == [0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert passed[-1].heading == 10.0
    assert passed[-1].place == (1.0, 1.0)
    assert dict(sieve.refused) == {
        "doubled": 1, "late": 1, "no time": 1, "heading": 1, "airspeed": 1, "clock jumps ahead": 1,
        "position": 2,
    }  # fmt: skip


def test_readings_within_a_microsecond_are_one() -> None:
    stream = [Reading(0.0, 0.0, 0.0), Reading(2e-309, 0.0, 0.0), *as_planned(every=50.0)]
    times = [event["time"] for event in new_watch(members=50, every=1200.0).events(stream)]
    assert times == sorted(times)
    sieve = Sieve(20.0)
    assert [r.time for r in sieve.usable([Reading(1.0, 0.0, 5.0), Reading(1.0 + 4e-7, 0.0, 5.0)])] == [1.0]
    assert dict(sieve.refused) == {"doubled": 1}


def test_two_readings_far_ahead_that_agree_are_believed() -> None:
    times = [0.0, 10.0, 50_000.0, 20.0, 60_000.0, 60_001.0]
    passed = [r.time for r in Sieve(20.0).usable(Reading(t, 0.0, 5.0) for t in times)]
    assert passed == [0.0, 10.0, 20.0, 60_001.0]


def test_times_never_go_back_where_parts_of_steps_are_not_round() -> None:
    stream = [Reading(29.0, 0.0, 0.0), *as_planned(every=50.0)]  # 29 / DT * DT is less than 29
    times = [event["time"] for event in new_watch(members=50, every=1200.0).events(stream)]
    assert times[0] == 29.0
    assert times == sorted(times)


def test_a_silence_passes_whatever_the_length_of_a_step() -> None:
    dt = 33.4  # 3 dt % dt is almost dt
    watch = new_watch(coherent_problem(robot=RobotConfig(dt=dt, u_max=20.0)), members=50, every=1200.0)
    end = dt * len(PATH.u)
    assert list(watch.events([Reading(0.0, 0.0, 5.0), Reading(end)]))[-1]["time"] == pytest.approx(end)


numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-1e4, 1e5),
    st.integers(0, 40).map(lambda k: 100.0 * k),
)
readings = st.builds(Reading, numbers, numbers, numbers, st.none() | st.tuples(numbers, numbers), numbers)


@settings(deadline=None, max_examples=10_000 if AT_NIGHT else 60)
@given(st.lists(readings, max_size=40), st.lists(st.integers(0, 70), max_size=30))
def test_no_stream_stops_a_watch(spoilt: list[Reading], places: list[int]) -> None:
    """Lost, late, doubled and spoilt telemetry: every event is finite, and time never goes back."""
    stream = list(as_planned(every=50.0))
    for at, reading in zip(places, spoilt, strict=False):
        stream.insert(at % len(stream), reading)
    events = list(new_watch(members=50, every=1200.0).events(stream))
    assert events[-1]["event"] == "end"
    times = [event["time"] for event in events]
    assert times == sorted(times)
    for event in events:
        json.dumps(event, allow_nan=False)
        event_line(event)


@pytest.mark.parametrize("cut", range(0, 50))
def test_a_killed_watch_continues_as_if_nothing_had_been(cut: int, tmp_path) -> None:
    """The journal cut at 50 random bytes, then the telemetry from there on."""
    fixes = {1000.0: (*(PATH.x[10] + [200.0, 90.0]), 40.0), 2200.0: (*(PATH.x[22] + [8e3, 0.0]), 40.0)}
    whole, journal = new_watch(alarm=1.0), Journal(tmp_path / "follow.jsonl")
    ended = []
    for event in (BEGIN, *whole.events(as_planned(fixes=dict(fixes)))):
        journal.write(event)
        ended.append(event)
    journal.close()
    text = (tmp_path / "follow.jsonl").read_bytes()
    at = int(np.random.default_rng(cut).integers(1, len(text)))
    (tmp_path / "follow.jsonl").write_bytes(text[:at])
    again = new_watch(alarm=1.0)
    kept = list(read_journal(tmp_path / "follow.jsonl"))
    assert len(kept) == text[:at].count(b"\n")
    again.resume(kept)
    if not kept or kept[-1]["event"] == "end":
        return
    rest = [r for r in as_planned(fixes=dict(fixes)) if r.time > again.time + 1e-9]
    done = {event["time"] for event in kept if event["event"] == "fix"}
    late = [
        Reading(again.time + 1e-3, *heading_of(PATH.u[min(int((again.time + 1e-6) / DT), len(PATH.u) - 1)]))
    ]
    if again.time in fixes and again.time not in done:  # what was heard in the last instant is heard again
        late = [Reading(late[0].time, late[0].heading, late[0].airspeed, fixes[again.time][:2], 40.0)]
    rest = [*late, *rest]
    last = list(again.events(rest))[-1]
    for key in ("x", "y", "major", "minor"):
        assert last[key] == pytest.approx(ended[-1][key], rel=1e-3, abs=2.0)


def test_a_journal_that_was_cut_off_twice_is_still_read(tmp_path) -> None:
    path = tmp_path / "follow.jsonl"
    for cut in (b'{"event":"flo', b"\xc3", b"nonsense\n", b""):
        journal = Journal(path)
        journal.write(BEGIN)
        journal.close()
        with path.open("ab") as file:
            file.write(cut)
        assert all(event == BEGIN for event in read_journal(path))
    assert len(list(read_journal(path))) == 4


def test_a_damaged_journal_is_named(tmp_path) -> None:
    path = tmp_path / "follow.jsonl"
    flown = {"event": "flown", "time": 1.0, "seconds": 1.0, "east": 20.0, "north": 0.0}
    for spoilt, why in SPOILT.items():
        path.write_text(f"{json.dumps(BEGIN)}\n{spoilt}\n{json.dumps(flown)}\n")
        with pytest.raises(DataError, match=rf"line 2: .*{why}.*; start a new watch with another --out"):
            list(read_journal(path))
    old = BEGIN | {"schema": "pareto_ltl.follow/1"}
    path.write_text(f"{json.dumps(old)}\n{json.dumps(flown)}\n")
    with pytest.raises(DataError, match=r"line 1: expected the schema 'pareto_ltl.follow/2', found"):
        list(read_journal(path))
    known = {**flown, "new": 1, "text": "\ud800"}
    path.write_text("\n".join(map(json.dumps, (BEGIN, known, {"event": "later", "time": 2}, flown))) + "\n")
    assert [event["event"] for event in read_journal(path)] == ["begin", "flown", "later", "flown"]
    assert list(read_journal(path))[1] == {**flown, "new": 1, "text": "?"}
    with pytest.raises(DataError, match="cannot be read"):
        list(read_journal(tmp_path / "none"))


def test_a_flight_as_planned_is_in_its_corridor_within_steps() -> None:
    """Half-way along a leg the planned position is half-way, not at the next step."""
    events = list(new_watch(every=30.0, alarm=1.0).events(as_planned(every=10.0, until=6.0 * DT)))
    status = [event for event in events if event["event"] == "status"]
    assert len({event["time"] % DT for event in status}) > 2
    assert max(event["corridor"] for event in status) < 0.1
    assert "corridor" not in alarms(events)


def test_an_old_forecast_is_an_alarm_and_its_age_counts_from_its_start() -> None:
    cfg = WatchSettings(every=400.0, members=50, alarm=1.0, wind_age=2500.0)
    for issued, raised in ((math.nan, 2600.0), (-1000.0, 1600.0)):
        watch = Watch(PROBLEM, PLAN, cfg, SeedSequence(2), issued)
        ages = [e["time"] for e in watch.events(as_planned()) if e["event"] == "alarm" and e["kind"] == "age"]
        assert len(ages) == 1
        assert raised - 100.0 < ages[0] <= raised + 400.0


def test_a_battery_that_ends_before_the_plan_is_an_alarm() -> None:
    for rate, raised in ((0.5, False), (1.2, True)):
        stream = [
            Reading(r.time, r.heading, r.airspeed, battery=max(0.0, 1.0 - rate * r.time / FLIGHT_TIME))
            for r in as_planned(every=50.0)
        ]
        events = list(new_watch(alarm=1.0).events(stream))
        assert ("energy" in alarms(events)) is raised
        assert events[-1]["battery"] == pytest.approx(max(0.0, 1.0 - rate), abs=0.02)


def test_the_energy_that_is_needed_is_that_of_the_plan() -> None:
    model = EnergyModel(Body(base=50.0, drag=0.01), None)
    problem = replace(PROBLEM, energy=model)
    whole = model.of(PATH.u, DT)
    status = [e for e in new_watch(problem, alarm=1.0).events(as_planned()) if e["event"] == "status"]
    assert [event["energy_needed"] for event in status] == pytest.approx([whole] * len(status), rel=1e-6)
    halfway = {**status[0], "shown": True, "energy": 3600.0 * 12_345.6, "energy_needed": 3600.0 * 42_789.4}
    assert event_line(halfway).endswith("12,346 Wh used of 42,789 by the end")
    small = replace(PROBLEM, energy=EnergyModel(model.curve, 0.9 * whole))
    assert "Wh are needed" in alarms(new_watch(small, alarm=1.0).events(as_planned()))["energy"]


def test_what_the_autopilot_believes_of_the_wind_is_said_and_not_used() -> None:
    stream = [Reading(r.time, r.heading, r.airspeed, wind=(270.0, 9.5)) for r in as_planned()]
    told, plain = (list(new_watch(alarm=1.0).events(s))[-1] for s in (stream, as_planned()))
    assert told["heard_wind"] == [270.0, 9.5]
    assert "(autopilot: 270/9.5)" in event_line(told)
    assert (told["x"], told["wind"]) == (plain["x"], plain["wind"])


def test_in_water_a_line_says_where_the_current_sets_to() -> None:
    wrong = [Reading(r.time, r.heading + 30.0, r.airspeed) for r in as_planned()]
    cfg = WatchSettings(every=400.0, members=100, alarm=0.9)
    events = list(Watch(PROBLEM, PLAN, cfg, SeedSequence(2), medium=WATER).events(wrong))
    assert "fail in coherent currents, more than" in alarms(events)["promise"]
    end = events[-1] | {"wind": [0.0, 0.123], "wind_from": 200.0, "wind_sd": 0.05}
    in_water = event_line(end)
    assert "in coherent currents" in in_water
    assert "; current to 020/0.12 m/s, sd 0.05" in in_water
    assert "wind" not in in_water


# --- goals, alarms that come again, and what is off the map ---------------------------------------


def test_a_goal_that_is_not_reached_is_said_and_the_mission_is_not_complete() -> None:
    wrong = [Reading(r.time, r.heading + 30.0, r.airspeed) for r in as_planned()]
    events = list(new_watch(alarm=1.0).events(wrong))
    (goal,) = [event for event in events if event["event"] == "goal"]
    assert (goal["goal"], goal["planned"]) == (["a"], 3200.0)
    assert goal["probability"] < 0.1
    assert event_line(goal).startswith("+0:53:20  a: planned for 0:53:20, reached with probability ")
    assert "the plan leaves a, which is reached with probability" in alarms(events)["goal"]
    assert "the mission is NOT complete (complete with probability" in event_line(events[-1])
    assert events[-1]["complete"] < 0.1
    later = [event for event in events if event["event"] == "status" and event["time"] >= 3200.0]
    assert all("a reached with probability" in event_line(event) for event in later)


def test_a_mission_that_is_complete_is_said() -> None:
    near = {DT * k: (*PATH.x[k], 30.0) for k in (8, 16, 24, 30, 33)}
    events = list(new_watch(alarm=1.0).events(as_planned(fixes=near)))
    assert events[-1]["complete"] > 0.95
    assert "the mission is complete (complete with probability" in event_line(events[-1])
    assert "goal" not in alarms(events)


def test_a_telemetry_that_ends_early_does_not_complete_the_mission() -> None:
    end = list(new_watch(alarm=1.0).events(as_planned(until=1000.0)))[-1]
    assert end["complete"] == 0.0
    assert "end of the telemetry, 0:41:40 before its end: the mission is NOT complete" in event_line(end)


def test_a_failure_rate_that_doubles_is_a_new_alarm() -> None:
    rules = new_watch(alarm=0.2).rules
    new = []
    for rate in (0.1, 0.25, 0.3, 0.45, 0.51, 0.6, 0.76, 0.9, 0.1, 0.3):
        texts = [text for _, text in rules._promise({"fails": 1, "flights": 9, "failure": rate})]  # noqa: SLF001
        if len(texts) == 2:
            new.append((rate, texts[1].rpartition(", ")[2]))
    assert new == [
        (0.51, "after 25 % at the last alarm"), (0.76, "after 51 % at the last alarm"),
        (0.9, "after 76 % at the last alarm"),
    ]  # fmt: skip
    events = list(new_watch(alarm=0.2, every=100.0).events(as_planned()))
    assert len([e for e in events if e["event"] == "alarm" and e["kind"] == "promise"]) == 1
    wrong = [Reading(r.time, r.heading + 18.0, r.airspeed) for r in as_planned(every=50.0)]
    events = list(new_watch(alarm=0.2, every=100.0).events(wrong))
    assert len([e for e in events if e["event"] == "alarm" and e["kind"] == "promise"]) >= 2


def test_a_position_off_the_map_is_an_alarm_once() -> None:
    far = dict.fromkeys((1000.0, 1020.0, 1040.0), (-900000.0, 900000.0, 20.0))
    zero = {2000.0: (0.0, -1.0, 5.0)}
    events = list(new_watch(alarm=1.0).events(as_planned(fixes={**far, **zero})))
    said = [event for event in events if event["event"] == "alarm" and event["kind"] == "map"]
    assert len(said) == 1
    assert "is off the map; it is not used" in said[0]["text"]
    assert said[0]["advice"]
    assert events[-1]["refused"] == {"position off the map": 4}
    assert event_line(events[-2]) == "+0:58:20  not used: 4 position off the map"


def test_refused_positions_of_one_second_do_not_agree_with_each_other() -> None:
    off = {1000.0 + t: (*(PATH.x[10] + [7e3, -6e3]), 20.0) for t in range(9)}
    events = list(new_watch(alarm=1.0).events(as_planned(every=1.0, until=1100.0, fixes=off)))
    assert [event["use"] for event in events if event["event"] == "fix"] == ["refused"]


def test_lost_signals_are_an_alarm_and_are_not_flown_for_long() -> None:
    def stream() -> Iterable[Reading]:
        for reading in as_planned(every=1.0, until=3000.0):
            if 1000.0 <= reading.time < 2500.0:
                yield Reading(reading.time, lost=("heading",))
            else:
                yield reading

    events = list(new_watch(alarm=1.0).events(stream()))
    assert "no heading for more than 2 s" in alarms(events)["signals"]
    assert "no heading and airspeed for 121 s" in alarms(events)["silence"]


def test_lines_come_at_events_and_every_ten_minutes() -> None:
    events = list(new_watch(every=60.0, lines=600.0, alarm=1.0).events(as_planned()))
    lines = [event_line(event) for event in events if event["event"] == "status"]
    shown = [line for line in lines if line]
    assert len(lines) > 50
    assert [line[:8] for line in shown] == [f"+0:{10 * k:02d}:00" for k in range(6)]
    assert max(map(len, shown)) < 200
