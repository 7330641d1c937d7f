"""Telemetry from an autopilot and messages to it, by MAVLink (pymavlink, the extra ``follow``).

Nothing here arms, disarms or changes a mode.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import sys
import time as clock
from collections import deque
from collections.abc import Iterator
from contextlib import closing, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from careful_io.reading import refuse_special
from careful_io.times import utc_moment
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl_apps.exports.mavlink import NAMES
from pareto_ltl_apps.flight.airspeeds import Airspeeds
from pareto_ltl_apps.flight.clocks import StampClock, SteadyClock, VehicleClock
from pareto_ltl_apps.flight.rules import Event, alarm, event_of
from pareto_ltl_apps.flight.sends import (
    ACCEPTED,
    KINDS,
    PATIENCE,
    TRIES,
    Command,
    Sender,
    at_leg,
    at_status,
    trusted,
    wind_command,
)
from pareto_ltl_apps.flight.telemetry import Reading, Typed
from pareto_ltl_apps.flight.vehicle import OURS, Vehicle
from pareto_ltl_apps.flight.watch import Watch

STALE = 5.0  # [s] after its last heartbeat the mode of a vehicle is not known any longer
BEAT = 1.0  # [s] between two heartbeats, and the longest wait for a message
REOPENING = 0.2  # [s] between attempts to open a serial port again
IDLE = 2.0  # [s] without a message after which the time is passed on
KEY_BYTES = 32
DAMAGED = "damaged record"
STUMBLES = 1000  # records of a log in a row that pymavlink cannot read, after which there is no other


def departure_time(time_zero: str | None, given: str | None) -> float | None:
    """Unix time of the departure [s]; None: the first message. ``given`` is ``now`` or an ISO 8601 time.

    Raises
    ------
    ConfigError
        If ``given`` is no time.
    """
    text = given or time_zero
    if text is None or given == "now":
        return None
    try:
        return utc_moment(text).timestamp()
    except (ValueError, OverflowError):
        form = "now or a time such as 2018-10-09T06:00:00Z"
        raise ConfigError(f"--departure must be {form}, got {text}") from None


def signing_key(path: Path) -> bytes:
    """The key of MAVLink 2 in a file: 64 hexadecimal digits, or a passphrase, whose SHA-256 it is.

    Raises
    ------
    DataError
        If the file cannot be read, or is empty.
    """
    refuse_special(path)
    try:
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as a key ({error})") from None
    if not text:
        raise DataError(f"{path}: the key is empty; give 64 hexadecimal digits or a passphrase")
    with suppress(ValueError):
        if len(key := bytes.fromhex(text)) == KEY_BYTES:
            return key
    return hashlib.sha256(text.encode()).digest()


def logged_readings(
    path: Path, time_zero: str | None, given: str | None, airspeeds: Airspeeds | None = None
) -> Iterator[Reading]:
    """The readings of a ``.tlog``, ``.bin`` or ``.log`` file; damaged records are readings with a fault.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    mavutil = _mavutil()
    if not path.is_file():
        raise DataError(f"{path}: no such file; give a .tlog, .bin, .log or .csv file")
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # a line a damaged byte
        try:
            log = _opened(mavutil, path)
        except Exception as error:  # whatever a damaged log makes pymavlink raise
            raise DataError(f"{path}: cannot be read as a log of an autopilot ({error})") from None
    departure = departure_time(time_zero, given)
    vehicle = Vehicle(clock=StampClock(), airspeeds=airspeeds or Airspeeds())
    with closing(log):
        for message in _records(log):
            if message is None:
                yield Reading(math.nan, fault=DAMAGED)
                continue
            departure = message._timestamp if departure is None else departure  # noqa: SLF001
            try:
                reading = vehicle.reading(message, message._timestamp - departure)  # noqa: SLF001
            except (TypeError, ValueError, AttributeError, ArithmeticError):  # fields of another kind
                reading = Reading(math.nan, fault=DAMAGED)
            if reading is not None:
                yield reading
            while vehicle.clock.jumps:
                vehicle.clock.jumps.pop()
                yield Reading(math.nan, fault="step of a clock")


def _records(log: Any) -> Iterator[Any]:
    """The messages of a log of pymavlink; None for a piece that is damaged, once however long it is."""
    stumbled, damaged = 0, False
    while stumbled < STUMBLES:
        before, message = getattr(log, "offset", 0), None
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # a line a damaged byte
                message = log.recv_msg()
        except Exception:
            stumbled, bad = stumbled + 1, True
        else:
            bad = _skipped(log, message, before)
        if bad and not damaged:
            yield None
        damaged = bad and (message is None or message.get_type() == "BAD_DATA")
        if message is None and not (bad and stumbled):
            return
        if message is not None and message.get_type() != "BAD_DATA":
            stumbled = 0
            yield message


def _skipped(log: Any, message: Any, before: int) -> bool:
    """Whether pymavlink has left out bytes before ``message``, or at the end of a ``.bin`` file."""
    if message is not None and message.get_type() == "BAD_DATA":
        return True
    if not hasattr(log, "HEAD1"):  # of .bin files alone: others name what is damaged
        return False
    read, end = (0, log.data_len) if message is None else (message.fmt.len, log.offset)
    return bool(end - before > read)


def _opened(mavutil: Any, path: Path) -> Any:
    """The log of pymavlink; of two readers of ``.tlog`` files the one that survives damaged ones."""
    if path.suffix.lower() == ".tlog":
        mavutil.set_dialect("all")
        return mavutil.mavlogfile(str(path))
    return mavutil.mavlink_connection(str(path), dialect="all")


def _mavutil() -> Any:
    os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads it when a connection is opened
    EXTRAS.require("follow", "MAVLink")
    from pymavlink import mavutil

    mavutil.print = partial(print, file=sys.stderr)  # it prints what it does to the standard output
    return mavutil


# --- a connection ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """How a vehicle is listened to, and what is sent to it.

    Attributes
    ----------
    departure : str or None
        ``now``, or an ISO 8601 time; None: the departure of the plan.
    sends : tuple of str
        Which of :data:`~pareto_ltl_apps.flight.sends.KINDS` are sent; nothing by default.
    system : int
        Number of the vehicle; 0: the first autopilot that is heard.
    key : bytes
        Key of the signatures; without a key messages are not signed, and signatures are not checked.
    prologue : tuple of mapping
        Messages before the departure, with their heights.
    own_clock : bool
        Whether time is taken from the vehicle, since its first message, and not from our clock: for a
        simulated vehicle that flies faster than real time.
    airspeeds : Airspeeds
        Turns true airspeeds into the calibrated ones of the autopilot, and back.
    """

    departure: str | None = None
    sends: tuple[str, ...] = ()
    system: int = 0
    key: bytes = b""
    prologue: tuple[dict[str, Any], ...] = ()
    own_clock: bool = False
    airspeeds: Airspeeds = field(default_factory=Airspeeds)


class Link:
    """A connection to an autopilot: its readings, and what is sent to it.

    Parameters
    ----------
    address : str
        In pymavlink's form, e.g. ``udpin:127.0.0.1:14550``, ``tcp:127.0.0.1:5760`` or
        ``/dev/ttyUSB0,57600``.
    time_zero : str or None
        Departure of the plan.
    typed : Typed, optional
        What the pilot types.
    """

    def __init__(
        self, address: str, time_zero: str | None, settings: LinkSettings, typed: Typed | None = None
    ) -> None:
        if unknown := [kind for kind in settings.sends if kind not in KINDS]:
            raise ConfigError(f"--send {','.join(unknown)}: expected some of {', '.join(KINDS)}")
        departure = departure_time(time_zero, settings.departure)
        # The wall clock is read once: its later steps are no time of flight.
        self.departure = None if departure is None else departure - clock.time() + clock.monotonic()
        self.settings = settings
        device, _, rate = address.partition(",")
        try:
            self.port = _mavutil().mavlink_connection(
                device, baud=int(rate or 57600), dialect="all", source_system=OURS[0],
                source_component=OURS[1], autoreconnect=True,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            raise DataError(
                f"{address}: cannot be opened ({error}); give an address such as udpin:127.0.0.1:14550"
            ) from None
        if settings.key:
            self.port.setup_signing(settings.key)
        times = VehicleClock() if settings.own_clock else SteadyClock()
        self.vehicle = Vehicle(settings.system, clock=times, airspeeds=settings.airspeeds)
        self.typed, self.sender = typed, Sender(self.port.mav, self.vehicle)
        self.leg: tuple[int, int] | None = None  # the watch and its step whose heading was sent
        self.beaten, self.prepared, self.known, self.damaged = -math.inf, False, 0, False
        self.notes: deque[Event] = deque()  # of what was sent on the ground
        self.wind: Command | None = None  # the expected wind at the start

    def readings(self) -> Iterator[Reading]:
        """The readings of the vehicle; without any for a while, the time alone. Ctrl-C ends them."""
        if self.typed is not None:
            self.typed.start()
        quiet = clock.monotonic()
        while True:
            now = clock.monotonic()
            if self.settings.sends and now > self.beaten + BEAT:
                self.beaten = now
                self.port.mav.heartbeat_send(6, 8, 0, 0, 4)  # a ground station, active
            try:
                message = self.port.recv_match(blocking=True, timeout=BEAT)
            except KeyboardInterrupt:
                return
            except (OSError, TypeError):  # unplugged
                message = None
                clock.sleep(REOPENING)
                if hasattr(self.port, "reset"):  # a serial port; others are opened again by pymavlink
                    self.port.reset()
            now = clock.monotonic()
            if message is not None:
                self.departure = now if self.departure is None else self.departure
                if (reading := self._heard(message, now - self.departure)) is not None:
                    quiet = quiet if reading.fault else now
                    yield reading
            if self.departure is not None:
                self._on_ground(now - self.departure)
                time = self.vehicle.clock.without_message(now - self.departure)
                while self.typed is not None and self.typed.fixes:
                    first, second, sd = self.typed.fixes.popleft()
                    yield Reading(time, place=(first, second), sd=sd)
                if now > quiet + IDLE:
                    quiet = now
                    yield Reading(time, lost=self.vehicle.lost(time))

    def _heard(self, message: Any, arrival: float) -> Reading | None:
        """The reading of a message; one that is damaged is counted."""
        again, self.damaged = self.damaged, message.get_type() == "BAD_DATA"
        if self.damaged:
            return None if again else Reading(math.nan, fault=DAMAGED)
        return self.vehicle.reading(message, arrival)

    @property
    def now(self) -> float:
        """Seconds after departure by our clock; before the first message of ``--departure now``, 0."""
        return 0.0 if self.departure is None else clock.monotonic() - self.departure

    # --- sending ---

    def answers(self, watch: Watch, event: Event) -> Iterator[Event]:
        """Send what follows from an event; yields what was sent, and alarms about it."""
        time, sends = event["time"], self.settings.sends
        if event["event"] == "begin" and "wind" in sends:
            self.wind = wind_command(watch.wind_now(watch.belief.estimate()))
        while self.notes:
            yield self.notes.popleft() | {"time": time}
        yield from self._heard_of(time)
        if not self.vehicle.heard or not sends:
            return
        if event["event"] == "status":
            yield from self._sent(at_status(trusted(sends, watch, time), event), time)
        leg = (id(watch.plan), watch.belief.step)  # a branch is another plan
        if event["event"] in ("flown", "status") and leg != self.leg and not watch.over:
            if not self.vehicle.guided or self.now > self.vehicle.beaten + STALE:
                return  # no mode is changed: headings follow once the pilot has chosen GUIDED
            self.leg = leg
            factor = self.vehicle.airspeeds.calibrated(1.0, time)
            yield from self._sent(at_leg(sends, watch.plan, watch.belief.step, factor), time)

    def _heard_of(self, time: float) -> Iterator[Event]:
        """What the autopilot has answered, and alarms about its answers, its clock and other vehicles."""
        for command, result in self.sender.answers():
            name = NAMES.get(command, command)
            if result != ACCEPTED:
                yield alarm(time, "refused", f"the autopilot refuses {name} (result {result})")
            elif text := self.sender.explanation(command):
                yield event_of("answered", time, text=text, command=command, result=result)
        for command in self.sender.unanswered(clock.monotonic()):
            text = f"the autopilot does not acknowledge {NAMES[command]} within {TRIES * PATIENCE:g} s"
            yield alarm(time, "unacknowledged", text)
        while self.vehicle.clock.jumps:
            jump = self.vehicle.clock.jumps.pop(0)
            yield alarm(time, "clock", f"the clock of the vehicle jumped by {jump:+.0f} s: ours counts")
        if len(self.vehicle.strangers) > self.known:
            self.known = len(self.vehicle.strangers)
            others = ", ".join(map(str, sorted(self.vehicle.strangers)))
            text = f"vehicle {self.vehicle.system} is followed; others on this link are ignored: {others}"
            yield alarm(time, "vehicles", text)

    def _on_ground(self, now: float) -> None:
        """Send once, before the take-off, what the autopilot must know then.

        These are origin, home and position for an aeroplane of ArduPilot that reports no satellite fix, and
        the expected wind at the start, which PX4 takes on the ground only.
        """
        vehicle, sends = self.vehicle, self.settings.sends
        if self.prepared or not {"prologue", "wind"} & {*sends} or not vehicle.heard:
            return
        if now > vehicle.beaten + STALE:
            return
        if "prologue" in sends and vehicle.plane and vehicle.satellites is None:
            return  # it has not reported yet whether it has satellites
        if vehicle.armed:
            self.prepared = True
            if "prologue" in sends and vehicle.plane and not vehicle.satellites:
                text = "the vehicle is armed already: origin, home and position are not sent"
                self.notes.append(alarm(now, "prologue", text))
            return
        self.prepared = True
        messages = list[Command]()
        if "prologue" in sends and vehicle.plane and not vehicle.satellites:
            messages += [(f"{message['name']}", message) for message in self.settings.prologue]
        if self.wind is not None:
            messages.append(self.wind)
        self.notes += self._sent(iter(messages), now)

    def _sent(self, messages: Iterator[Command], time: float) -> Iterator[Event]:
        for text, message in messages:
            self.sender.send(message, clock.monotonic())
            yield event_of("sent", time, text=text, command=message.get("command"))
