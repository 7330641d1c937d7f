"""Telemetry from an autopilot and messages to it, by MAVLink (pymavlink, the extra ``follow``).

Nothing here arms, disarms or changes a mode.
"""

from __future__ import annotations

import hashlib
import math
import os
import sys
import time as clock
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pareto_ltl.inflight.telemetry import Reading, Typed
from pareto_ltl.inflight.vehicle import KINDS, Sender, Vehicle, at_leg, at_status
from pareto_ltl.inflight.watch import Event, Watch, alarm, event_of
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extras import require_extra
from pareto_ltl.support.reading import refuse_special
from pareto_ltl.world.windows import utc_moment

STALE = 5.0  # [s] after its last heartbeat the mode of a vehicle is not known any longer
BEAT = 1.0  # [s] between two heartbeats, and the longest wait for a message
REOPENING = 0.2  # [s] between attempts to open a serial port again
IDLE = 5.0  # [s] without a message after which the time is passed on
KEY_BYTES = 32
LITTLE = 1e-3  # [s] between messages of one time of the vehicle


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


def logged_readings(path: Path, time_zero: str | None, given: str | None) -> Iterator[Reading]:
    """The readings of a ``.tlog``, ``.bin`` or ``.log`` file.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    mavutil = _mavutil()
    if not path.is_file():
        raise DataError(f"{path}: no such file; give a .tlog, .bin, .log or .csv file")
    try:
        log = mavutil.mavlink_connection(str(path), dialect="all")
    except (OSError, ValueError, IndexError, KeyError) as error:
        raise DataError(f"{path}: cannot be read as a log of an autopilot ({error})") from None
    departure, vehicle = departure_time(time_zero, given), Vehicle()
    with closing(log):
        while (message := log.recv_msg()) is not None:
            if message.get_type() == "BAD_DATA":
                yield Reading(math.nan)
                continue
            departure = message._timestamp if departure is None else departure  # noqa: SLF001
            if (reading := vehicle.reading(message, departure)) is not None:
                yield reading


def _mavutil() -> Any:
    os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads it when a connection is opened
    require_extra("follow", "MAVLink")
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
        Which of :data:`~pareto_ltl.inflight.sends.KINDS` are sent; nothing by default.
    system : int
        Number of the vehicle; 0: the first autopilot that is heard.
    key : bytes
        Key of the signatures; without a key messages are not signed, and signatures are not checked.
    prologue : tuple of mapping
        Messages before the departure, with their heights.
    own_clock : bool
        Whether time is taken from the vehicle, since its first message, and not from the arrival of its
        messages: for a simulated vehicle that flies faster than real time.
    """

    departure: str | None = None
    sends: tuple[str, ...] = ()
    system: int = 0
    key: bytes = b""
    prologue: tuple[dict[str, Any], ...] = ()
    own_clock: bool = False


@dataclass(slots=True)
class VehicleClock:
    """Time after departure by the clock of a vehicle, which may be faster than ours.

    ``first`` and ``last`` are the time of the vehicle [s], seconds after departure, and our time [s] of a
    message; ``same`` counts the messages since the last one that have its time.
    """

    first: tuple[float, float, float] | None = None
    last: tuple[float, float, float] | None = None
    same: int = 0

    def of_message(self, boot: float, now: float, after: float) -> float:
        """Time of a message sent at ``boot``; ``after``, by our clock, for the first one and without it.

        Of several messages at one time of the vehicle, each is a little later.
        """
        if self.first is None or not math.isfinite(boot):
            self.first = self.last = (boot, after, now) if math.isfinite(boot) else None
            return after
        assert self.last is not None
        self.same = self.same + 1 if boot == self.last[0] else 0
        self.last = (boot, self.first[1] + boot - self.first[0], now)
        return self.last[1] + LITTLE * self.same

    def without_message(self, now: float) -> float | None:
        """Time if the vehicle's clock went on at its rate since the last message; None before the second."""
        if self.first is None or self.last is None or self.last[2] <= self.first[2]:
            return None
        rate = (self.last[1] - self.first[1]) / (self.last[2] - self.first[2])
        return self.last[1] + rate * (now - self.last[2])


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
        self.departure, self.settings = departure_time(time_zero, settings.departure), settings
        device, _, rate = address.partition(",")
        try:
            self.port = _mavutil().mavlink_connection(
                device, baud=int(rate or 57600), dialect="all", source_system=255, autoreconnect=True
            )
        except (OSError, ValueError) as error:
            raise DataError(
                f"{address}: cannot be opened ({error}); give an address such as udpin:127.0.0.1:14550"
            ) from None
        if settings.key:
            self.port.setup_signing(settings.key)
        self.vehicle, self.typed = Vehicle(settings.system), typed
        self.sender = Sender(self.port.mav, self.vehicle)
        self.leg: tuple[int, int] | None = None  # the watch and its step whose heading was sent
        self.beaten, self.prepared, self.known = -math.inf, False, 0
        self.clock = VehicleClock() if settings.own_clock else None

    def readings(self) -> Iterator[Reading]:
        """The readings of the vehicle; without any for a while, the time alone. Ctrl-C ends them."""
        if self.typed is not None:
            self.typed.start()
        quiet = clock.time()
        while True:
            now = clock.time()
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
            if message is not None and message.get_type() != "BAD_DATA":
                self.departure = message._timestamp if self.departure is None else self.departure  # noqa: SLF001
                if (reading := self.vehicle.reading(message, self.departure)) is not None:
                    quiet = now
                    yield replace(reading, time=self._time(now))
            if self.departure is not None:
                while self.typed is not None and self.typed.fixes:
                    first, second, sd = self.typed.fixes.popleft()
                    yield Reading(self._time(now), place=(first, second), sd=sd)
                if now > quiet + IDLE:
                    quiet = now
                    own = None if self.clock is None else self.clock.without_message(now)
                    yield Reading(now - self.departure if own is None else own)

    def _time(self, now: float) -> float:
        """Seconds after departure of the last message."""
        assert self.departure is not None
        after = now - self.departure
        return after if self.clock is None else self.clock.of_message(self.vehicle.boot, now, after)

    # --- sending ---

    def answers(self, watch: Watch, event: Event) -> Iterator[Event]:
        """Send what follows from an event; yields what was sent, and alarms about it."""
        time, sends = event["time"], self.settings.sends
        for kind, text in self.sender.checked():
            yield alarm(time, kind, text)
        if len(self.vehicle.strangers) > self.known:
            self.known = len(self.vehicle.strangers)
            others = ", ".join(map(str, sorted(self.vehicle.strangers)))
            text = f"vehicle {self.vehicle.system} is followed; others on this link are ignored: {others}"
            yield alarm(time, "vehicles", text)
        if not self.vehicle.heard or not sends:
            return
        if "prologue" in sends and not self.prepared:
            yield from self._prologue(time)
        if event["event"] == "status":
            yield from self._sent(at_status(sends, event), time)
        leg = (id(watch), watch.belief.step)
        if event["event"] in ("flown", "status") and leg != self.leg and not watch.over:
            if not self.vehicle.guided or clock.time() > self.vehicle.beaten + STALE:
                return  # no mode is changed: headings follow once the pilot has chosen GUIDED
            self.leg = leg
            yield from self._sent(at_leg(sends, watch), time)

    def _prologue(self, time: float) -> Iterator[Event]:
        """Origin, home and position of an aeroplane of ArduPilot that reports no satellite fix, once."""
        vehicle = self.vehicle
        if not vehicle.plane or vehicle.satellites is not False or clock.time() > vehicle.beaten + STALE:
            return
        self.prepared = True
        if vehicle.armed:
            text = "the vehicle is armed already: origin, home and position are not sent; set them by hand"
            yield alarm(time, "prologue", text)
            return
        yield from self._sent(((f"{message['name']}", message) for message in self.settings.prologue), time)

    def _sent(self, messages: Iterator[tuple[str, dict[str, Any]]], time: float) -> Iterator[Event]:
        for text, message in messages:
            self.sender.send(message)
            yield event_of("sent", time, text=text, command=message.get("command"))
