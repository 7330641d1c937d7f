"""Flights of one plan in winds of its law, whose telemetry has faults: lost, old, doubled, foreign, jumping.

The truth is one simulated flight of the law. Where heading or airspeed are lost the robot may turn away from
its plan, which nobody can see. The same flight is also watched without faults: a position outside of the 99 %
ellipse of both watches is one of the 1 % that the law allows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence
from pymavlink.dialects.v20 import all as mavlink2

from coherent import SCENE, STEPS, coherent_problem
from flight_quantities.frames import local_plane
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.records import Plan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.flight import link as links
from pareto_ltl_apps.flight.belief import Belief
from pareto_ltl_apps.flight.clocks import Clock, StampClock, SteadyClock
from pareto_ltl_apps.flight.link import STALE, Link, LinkSettings
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.sends import Sender
from pareto_ltl_apps.flight.telemetry import Reading
from pareto_ltl_apps.flight.vehicle import AGE, OURS, Vehicle
from pareto_ltl_apps.flight.watch import ELLIPSE, Watch, WatchSettings

PROBLEM = coherent_problem(scene=replace(SCENE, crs=local_plane(44.0, -87.0)))
PATH = evaluate_path(PROBLEM, STEPS[:7], "given", tolerance=10.0)
PLAN = Plan(PATH, "F a", ("a",), PROBLEM.motion.dt, 20.0, 0.05, "full", "worth", ())
DT, SECONDS = PROBLEM.motion.dt, int(len(PATH.u) * PROBLEM.motion.dt)
SETTINGS = WatchSettings(every=30.0, members=50, alarm=1.0)
AUTOPILOT, GIMBAL, COMPANION, OTHER = (7, 1), (7, 154), (7, 191), (9, 1)
FIX_SD, FIX_TIMES = 80.0, (150, 400)
OUTSIDE = math.sqrt(-2.0 * math.log(0.01))  # standard deviations of the 99 % ellipse
# By which both estimates may differ without any effect of the faults [sd]: the standard error of the distance
# at the ellipse, whose axes come from so many members, which a fault makes others.
SAME = OUTSIDE / math.sqrt(2.0 * SETTINGS.members)
SENDS = ("wind", "heading", "speed", "position")
WIND, POSITION, SPEED, HEADING = 43004, 43003, 43000, 43002


@dataclass
class Heard:
    """A message when it comes [s], by our clock or its stamp: its kind, source, and fields."""

    at: float
    kind: str
    values: tuple[Any, ...]
    source: tuple[int, int] = AUTOPILOT
    copy: bool = False  # the same bytes as the one before it


@dataclass
class Stream:
    """A true flight, and what is heard of it."""

    x: FloatArray
    u: FloatArray
    heard: list[Heard] = field(default_factory=list)
    log: bool = False
    faults: list[str] = field(default_factory=list)
    noise: dict[int, FloatArray] = field(default_factory=dict)  # of the satellite fixes [m]
    windows: dict[str, tuple[float, float]] = field(default_factory=dict)  # in which signals are lost
    step: tuple[float, float] = (math.inf, 0.0)  # of the stamps: when, and by how much [s]


def true_flight(seed: SeedSequence, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (SECONDS + 1, 2) [m], and velocities through the air, ``turned`` [rad] from the plan."""
    belief, x, flown = Belief(PROBLEM, 1, seed), [], []
    for second in range(SECONDS):
        x.append(belief._members()[0])  # noqa: SLF001
        c, s = math.cos(turned[second]), math.sin(turned[second])
        velocity = np.array([[c, s], [-s, c]]) @ PATH.u[min(int(second / DT), len(PATH.u) - 1)]
        flown.append(velocity)
        belief.advance(1.0, velocity)
    x.append(belief._members()[0])  # noqa: SLF001
    return np.array(x), np.array(flown)


def degrees(x: FloatArray) -> tuple[float, float]:
    """Latitude and longitude of a position (2,) [m]."""
    lon, lat = PROBLEM.scene.frame.to_geographic(x[None])
    return float(lat[0]), float(lon[0])


def gps(at: float, place: tuple[float, float], source: tuple[int, int] = AUTOPILOT, fix: int = 3) -> Heard:
    lat, lon = (round(1e7 * value) for value in place)
    return Heard(at, "gps", (round(1e6 * at), fix, lat, lon, round(1e3 * FIX_SD)), source)


def honest(x: FloatArray, u: FloatArray, noise: dict[int, FloatArray]) -> list[Heard]:
    """What an autopilot says: a heartbeat, a heading and an airspeed each second, and two satellite fixes."""
    lon, lat = PROBLEM.scene.frame.to_geographic(x)
    north = PROBLEM.scene.frame.convergence(lon, lat)
    found = []
    for second, (east, up) in enumerate(u):
        yaw = math.atan2(east, up) + north[second]
        found += [
            Heard(second + 0.1, "beat", (1, 3, 128, 15)),
            Heard(second + 0.2, "attitude", (second + 0.2, yaw)),
            Heard(second + 0.3, "hud", (math.hypot(east, up),)),
        ]
        if second in FIX_TIMES:
            found.append(gps(second + 0.4, degrees(x[second] + noise[second])))
    return found


# --- faults ---------------------------------------------------------------------------------------


Fault = Callable[[Stream, Generator], None]
FAULTS: dict[str, Fault] = {}


def fault(make: Fault) -> Fault:
    """Register a fault by the name of its function."""
    FAULTS[make.__name__] = make
    return make


def window(rng: Generator, least: float, most: float) -> tuple[float, float]:
    """A span of the flight [s]."""
    long = float(rng.uniform(least, most))
    return (begin := float(rng.uniform(10.0, SECONDS - 10.0))), begin + long


LOST = ("stale_heading", "stale_airspeed", "gap")  # faults in which the robot may turn unseen


def stale(kinds: tuple[str, ...], name: str) -> None:
    def make(stream: Stream, rng: Generator) -> None:
        begin, end = stream.windows[name]
        stream.heard = [one for one in stream.heard if not (begin <= one.at < end and one.kind in kinds)]

    FAULTS[name] = make


stale(("attitude",), "stale_heading")
stale(("hud",), "stale_airspeed")
stale(("attitude", "hud", "beat", "gps"), "gap")


@fault
def looped(stream: Stream, rng: Generator) -> None:
    """A router sends back what we send: an estimate of a position, at a place where the robot is not."""
    begin, end = window(rng, 30.0, 300.0)
    for second in np.arange(begin, min(end, SECONDS), 12.0):
        lat, lon = degrees(PATH.x[min(int(second / DT), len(PATH.x) - 1)])
        values = (43003, second, 20.0, round(1e7 * lat), round(1e7 * lon))
        stream.heard.append(Heard(float(second), "estimate", values, OURS))


@fault
def foreign(stream: Stream, rng: Generator) -> None:
    """A gimbal's attitude, a companion's receiver and airspeed, and another vehicle."""
    begin, end = window(rng, 60.0, 500.0)
    wrong = degrees(PATH.x[0] + [3e3, 9e3])
    for second in np.arange(begin, min(end, SECONDS), 1.0):
        for source in (GIMBAL, COMPANION, OTHER):
            stream.heard.append(Heard(second + 0.15, "attitude", (second, rng.uniform(-3.0, 3.0)), source))
            stream.heard.append(Heard(second + 0.25, "hud", (rng.uniform(0.0, 30.0),), source))
        stream.heard.append(gps(second + 0.3, wrong, COMPANION))
        stream.heard.append(Heard(second + 0.05, "beat", (18, 8, 0, 0), COMPANION))
        stream.heard.append(Heard(second + 0.05, "beat", (26, 8, 0, 0), GIMBAL))


@fault
def doubled(stream: Stream, rng: Generator) -> None:
    """Everything comes twice for a while, the copy up to 1.5 s later."""
    begin, end = window(rng, 30.0, 300.0)
    late = rng.uniform(0.0, 1.5)
    for one in [one for one in stream.heard if begin <= one.at < end and one.source == AUTOPILOT]:
        stream.heard.append(replace(one, at=one.at + late, copy=True))


@fault
def replayed(stream: Stream, rng: Generator) -> None:
    """Headings of an earlier time, turned by a quarter, with new numbers."""
    begin, end = window(rng, 20.0, 200.0)
    for one in [
        one for one in stream.heard if one.kind == "attitude" and begin - 150.0 <= one.at < end - 150.0
    ]:
        boot, yaw = one.values
        stream.heard.append(replace(one, at=one.at + 150.05, values=(boot, yaw + 1.5)))


@fault
def vehicle_clock(stream: Stream, rng: Generator) -> None:
    """The time of the vehicle jumps for the rest of the flight."""
    begin, _ = window(rng, 1.0, 2.0)
    jump = float(rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 5000.0))
    for one in stream.heard:
        if one.kind == "attitude" and one.at >= begin and one.source == AUTOPILOT:
            one.values = (max(one.values[0] + jump, 0.001), one.values[1])


@fault
def stamps(stream: Stream, rng: Generator) -> None:
    """The wall clock of who writes a log steps."""
    stream.log = True
    begin, _ = window(rng, 1.0, 2.0)
    jump = float(rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 119.0))
    stream.step = (begin, jump)


@fault
def damaged(stream: Stream, rng: Generator) -> None:
    """Records that are no message, and numbers that are none."""
    for second in rng.uniform(0.0, SECONDS, 30):
        kind, values = [("bad", ()), ("hud", (math.nan,)), ("attitude", (second, math.nan))][rng.integers(3)]
        stream.heard.append(Heard(float(second), kind, values))


@fault
def no_place(stream: Stream, rng: Generator) -> None:
    """Fixes at 0,0, and far away."""
    begin, end = window(rng, 5.0, 60.0)
    place = (0.0, 0.0) if rng.random() < 0.5 else degrees(PATH.x[0] + [9e3, 9e3])
    stream.heard += [gps(second + 0.45, place) for second in np.arange(begin, min(end, SECONDS), 1.0)]


def faulty_stream(seed: int) -> Stream:
    """Stream number ``seed``: one to three faults; while signals are lost, half of the robots turn away."""
    world, own = SeedSequence(seed).spawn(2)
    rng = np.random.default_rng(own)
    names = list(rng.choice(sorted(FAULTS), size=rng.integers(1, 4), replace=False))
    windows, turned = {}, np.zeros(SECONDS)
    for name in LOST:
        windows[name] = window(rng, 1.0, 250.0)
        if name in names and rng.random() < 0.5:
            begin, end = windows[name]
            turned[int(begin) + 1 : int(end)] = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5)
    x, u = true_flight(world, turned)
    noise = {second: FIX_SD * rng.standard_normal(2) for second in FIX_TIMES}
    stream = Stream(x, u, honest(x, u, noise), noise=noise, windows=windows)
    for name in sorted(names, key=lambda one: (one == "doubled", one)):
        FAULTS[name](stream, rng)
        stream.faults.append(str(name))
    stream.heard.sort(key=lambda one: one.at)
    return stream


# --- what a watch makes of it ---------------------------------------------------------------------


class Wire:
    """Encodes what is heard, with the number of each source, and keeps what is sent."""

    def __init__(self) -> None:
        self.mav: dict[tuple[int, int], Any] = {}
        self.sent: list[tuple[float, int, tuple[float, ...]]] = []
        self.now = 0.0

    def message(self, one: Heard, last: dict[tuple[Any, ...], Any]) -> Any:
        if one.kind == "bad":
            return SimpleNamespace(get_type=lambda: "BAD_DATA")
        key = (one.source, one.kind, one.values)
        if one.copy:
            return last[key]
        coder = self.mav.setdefault(
            one.source, mavlink2.MAVLink(None, srcSystem=one.source[0], srcComponent=one.source[1])
        )
        message = ENCODERS[one.kind](*one.values)
        message.pack(coder)
        coder.seq = (coder.seq + 1) % 256
        last[key] = message
        return message

    def command_long_send(
        self, _system: int, _component: int, command: int, _again: int, *params: float
    ) -> None:
        self.sent.append((self.now, command, params))

    def command_int_send(
        self, _system: int, _component: int, _frame: int, command: int, *rest: float
    ) -> None:
        self.sent.append((self.now, command, rest[2:]))


def _attitude(boot: float, yaw: float) -> Any:
    milliseconds = round(1e3 * boot) % 2**32
    return mavlink2.MAVLink_attitude_message(milliseconds, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)


ENCODERS: dict[str, Callable[..., Any]] = {
    "beat": lambda kind, pilot, base, mode: mavlink2.MAVLink_heartbeat_message(kind, pilot, base, mode, 4, 3),
    "attitude": _attitude,
    "hud": lambda airspeed: mavlink2.MAVLink_vfr_hud_message(airspeed, 25.0, 0, 50, 100.0, 0.0),
    "gps": lambda at, fix, lat, lon, acc: mavlink2.MAVLink_gps_raw_int_message(
        at, fix, lat, lon, 0, 100, 100, 0, 0, 9, 0, acc
    ),
    "estimate": lambda command, at, sd, x, y: mavlink2.MAVLink_command_int_message(
        7, 1, 0, command, 0, 0, at, 0.0, sd, 0.0, x, y, 0.0
    ),
}


@dataclass
class Judged:
    """What was found of a stream."""

    statuses: int = 0
    outside: int = 0  # of the 99 % ellipse
    allowed: int = 0  # of those, in both watches
    warned: int = 0  # of the others, after an alarm
    silent: list[tuple[float, float, float]] = field(default_factory=list)  # time, distances in both watches
    unsafe: list[str] = field(default_factory=list)
    sent: int = 0
    alarms: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)


def distance(event: Event, x: FloatArray) -> float:
    """Of ``x`` (2,) from an estimate, in its standard deviations."""
    c, s = math.cos(event["angle"]), math.sin(event["angle"])
    along = np.array([[c, s], [-s, c]]) @ (x - [event["x"], event["y"]])
    return float(np.hypot(*(along / (np.array([event["major"], event["minor"]]) / ELLIPSE))))


def clean_distances(stream: Stream) -> dict[float, float]:
    """Distance of the truth from the estimate by time, when every message comes."""
    watch, found = Watch(PROBLEM, PLAN, SETTINGS, SeedSequence(3)), {}
    lon, lat = PROBLEM.scene.frame.to_geographic(stream.x)
    north = np.degrees(PROBLEM.scene.frame.convergence(lon, lat))

    def readings() -> Iterator[Reading]:
        for second, (east, up) in enumerate(stream.u):
            heading = math.degrees(math.atan2(east, up)) + north[second]
            yield Reading(second + 0.3, heading % 360.0, math.hypot(east, up))
            if second in FIX_TIMES:
                place = degrees(stream.x[second] + stream.noise[second])
                yield Reading(second + 0.4, place=place, sd=FIX_SD)

    for event in watch.events(readings()):
        if event["event"] == "status":
            found[event["time"]] = distance(event, true_place(stream, event["time"]))
    return found


def true_place(stream: Stream, time: float) -> FloatArray:
    at = min(max(time, 0.0), SECONDS)
    return np.array([np.interp(at, np.arange(SECONDS + 1), stream.x[:, k]) for k in range(2)])


def judged(seed: int, monkeypatch: Any) -> tuple[Stream, Judged]:
    """Watch stream ``seed`` with everything sent, and judge what was believed and sent."""
    stream, found, wire = faulty_stream(seed), Judged(), Wire()
    clock: Clock = StampClock() if stream.log else SteadyClock()
    vehicle = Vehicle(clock=clock)
    link = object.__new__(Link)
    link.settings, link.vehicle, link.leg = LinkSettings(None, () if stream.log else SENDS), vehicle, None
    link.sender, link.known, link.wind, link.prepared = Sender(wire, vehicle), 0, None, True
    link.notes, link.departure, link.damaged = links.deque(), 0.0, False
    monkeypatch.setattr(links, "clock", SimpleNamespace(monotonic=lambda: wire.now))
    watch = Watch(PROBLEM, PLAN, SETTINGS, SeedSequence(3))
    genuine: dict[str, float] = {}
    clean, raised = dict[float, float](), False

    def readings() -> Iterator[Reading]:
        last: dict[tuple[Any, ...], Any] = {}
        idle = 0.0
        for one in stream.heard:
            while not stream.log and one.at > idle + AGE:  # as Link.readings does when nothing comes
                idle += AGE
                wire.now = idle
                yield Reading(idle, lost=vehicle.lost(idle))
            begin, jump = stream.step
            wire.now = one.at
            if one.source == AUTOPILOT and not one.copy:
                genuine[one.kind] = (
                    one.at if all(map(math.isfinite, one.values)) else genuine.get(one.kind, 0.0)
                )
            stamp = one.at + (jump if one.at >= begin else 0.0)
            if (reading := link._heard(wire.message(one, last), stamp)) is not None:
                idle = one.at if not reading.fault else idle
                yield reading

    for event in watch.events(readings()):
        for one in [event, *([] if stream.log else link.answers(watch, event))]:
            if one["event"] == "alarm":
                raised = True
                found.alarms[one["kind"]] += 1
        vehicle.acknowledged += [(command, 0) for _, command, _ in wire.sent]
        judge_sent(wire, stream, genuine, found)
        if event["event"] in ("status", "end"):
            found.statuses += 1
            time = wire.now if stream.log or event["event"] == "end" else event["time"]
            far = distance(event, true_place(stream, time))
            if far > OUTSIDE:
                found.outside += 1
                clean = clean or clean_distances(stream)
                at = min(clean, key=lambda t: abs(t - time))
                if clean[at] > OUTSIDE or far < clean[at] + SAME:
                    found.allowed += 1
                elif raised:
                    found.warned += 1
                else:
                    found.silent.append((time, far, clean[at]))
    found.refused = watch.sieve.refused
    return stream, found


def judge_sent(wire: Wire, stream: Stream, genuine: dict[str, float], found: Judged) -> None:
    """Note every command that was not computed from fresh data."""
    for now, command, params in wire.sent:
        found.sent += 1
        if command in (SPEED, HEADING):
            legs = {min(max(int((now + late) / DT), 0), len(PATH.u) - 1) for late in (-AGE - 1.5, 0.0, 0.5)}
            east, north = PATH.u[sorted(legs)].T
            wanted = (
                np.hypot(east, north) if command == SPEED else np.degrees(np.arctan2(east, north)) % 360.0
            )
            if now > genuine.get("beat", -math.inf) + STALE:
                found.unsafe.append(f"{command} at {now:.1f} without a heartbeat")
            if np.abs(wanted - params[1]).min() > 1e-3:
                found.unsafe.append(f"{command} at {now:.1f} of another leg")
        elif command in (WIND, POSITION):
            old = now - min(genuine.get("attitude", -math.inf), genuine.get("hud", -math.inf))
            if old > 2.0 * AGE:
                found.unsafe.append(f"{command} at {now:.1f} from signals {old:.1f} s old")
        else:
            found.unsafe.append(f"{command} at {now:.1f}")
    wire.sent.clear()
