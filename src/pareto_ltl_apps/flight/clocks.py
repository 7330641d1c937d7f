"""Times of messages in seconds after departure: by our clock, by the stamps of a log, by a simulated vehicle.

Our clock is monotonic while a vehicle is listened to, so that a step of the wall clock is no time of flight.
``time_boot_ms`` of a message says how old it is: a message that comes much later than its fellows is not
used. The stamps of a log come from the wall clock of the program that wrote it; there the vehicle's time
counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

ODD = 2.0  # [s] by which two clocks may disagree on the time between two messages
SETTLED = 10.0  # [s] of odd messages that agree with each other, after which their clock is believed
ALIKE = 1.0  # [s] by which odd messages may disagree with each other
GAIN = 0.002  # of a message: 10 a second follow the drift of a crystal, and a slow link, in a minute


class Clock(Protocol):
    """Turns the time of a vehicle into seconds after departure; ``jumps`` [s] are taken by the reader."""

    jumps: list[float]

    def of_message(self, boot: float, arrival: float) -> float | None:
        """Time of a message; None if it is old, or its clock is not believed yet.

        Parameters
        ----------
        boot : float
            Time of the vehicle [s]; NaN if the message has none.
        arrival : float
            When it came [s after departure], by our clock or by its stamp.
        """
        ...

    def without_message(self, arrival: float) -> float:
        """Time of a moment without a message."""
        ...


@dataclass(slots=True)
class Odd:
    """Messages of another clock in a row: ``ahead`` [s] of the believed one, since ``since`` [s]."""

    ahead: float
    since: float


@dataclass(slots=True)
class SteadyClock:
    """Of a vehicle that is listened to: ``offset`` is its time less ours, both [s]."""

    jumps: list[float] = field(default_factory=list)
    offset: float | None = None
    begun: float = math.nan
    late: float = 0.0  # of the last message with a time
    odd: Odd | None = None

    def of_message(self, boot: float, arrival: float) -> float | None:
        """Time of a message; see :class:`Clock`."""
        if not math.isfinite(boot):
            return arrival - self.late
        if self.offset is None:
            self.offset, self.begun = boot - arrival, arrival
        ahead = boot - arrival - self.offset
        if ahead > ODD and arrival < self.begun + SETTLED:  # the first ones had waited in a buffer
            self.offset, ahead = boot - arrival, 0.0
        if abs(ahead) > ODD and not self._believed(ahead, arrival):
            return None
        if abs(ahead) > ODD:
            self.jumps.append(ahead)
            self.offset, ahead = boot - arrival, 0.0
        self.odd = None
        self.offset += GAIN * ahead
        self.late = max(arrival + self.offset - boot, 0.0)
        return min(boot - self.offset, arrival)

    def _believed(self, ahead: float, now: float) -> bool:
        """Whether only messages ``ahead`` of the believed clock have come for a while."""
        if self.odd is None or abs(ahead - self.odd.ahead) > ALIKE:
            self.odd = Odd(ahead, now)
        return now >= self.odd.since + SETTLED

    def without_message(self, arrival: float) -> float:
        """Time of a moment without a message."""
        return arrival


@dataclass(slots=True)
class StampClock:
    """Of a log: times of the vehicle count; between them stamps do, but none of their steps.

    ``boot`` [s], ``time`` [s after departure] and the stamp ``began`` are of the last message with a time of
    the vehicle; ``stamp`` is of the last message at all, and ``since`` the time between both.
    """

    jumps: list[float] = field(default_factory=list)
    boot: float = math.nan
    time: float = math.nan
    began: float = math.nan
    stamp: float = math.nan
    since: float = 0.0
    odd: Odd | None = None

    def of_message(self, boot: float, arrival: float) -> float | None:
        """Time of a message; see :class:`Clock`."""
        if math.isnan(self.time):
            if math.isfinite(boot):
                self._set(boot, arrival, arrival)
            return arrival
        now = self.without_message(arrival)
        if not math.isfinite(boot):
            return now
        passed = boot - self.boot
        if passed < -ODD:  # a restart, or messages that are written a second time
            if self.odd is None or boot < self.odd.ahead:
                self.odd = Odd(boot, arrival)
            if boot < self.odd.ahead + SETTLED:
                return None
            self.jumps.append(passed)
            self._set(boot, now, arrival)
            return now
        self.odd = None
        if abs(passed - (arrival - self.began)) > ODD:
            self.jumps.append(passed - (arrival - self.began))
        if passed >= 0.0:
            self._set(boot, self.time + passed, arrival)
            return self.time
        return self.time + passed

    def _set(self, boot: float, time: float, stamp: float) -> None:
        self.boot, self.time, self.began, self.stamp, self.since = boot, time, stamp, stamp, 0.0

    def without_message(self, arrival: float) -> float:
        """Time of a moment without a time of the vehicle."""
        self.since += min(max(arrival - self.stamp, 0.0), ODD)
        self.stamp = arrival
        return self.time + self.since


@dataclass(slots=True)
class VehicleClock:
    """Of a simulated vehicle, which may be faster than our clock: its own time since its first message.

    ``first`` and ``last`` are the time of the vehicle [s], seconds after departure, and our time [s] of a
    message.
    """

    jumps: list[float] = field(default_factory=list)
    first: tuple[float, float, float] | None = None
    last: tuple[float, float, float] | None = None

    def of_message(self, boot: float, arrival: float) -> float | None:
        """Time of a message; see :class:`Clock`. One without a time has the time of the last one."""
        if not math.isfinite(boot):
            return arrival if self.last is None else self.last[1]
        if self.first is None or self.last is None:
            self.first = self.last = (boot, arrival, arrival)
            return arrival
        if boot < self.last[0]:
            return None
        self.last = (boot, self.first[1] + boot - self.first[0], arrival)
        return self.last[1]

    def without_message(self, arrival: float) -> float:
        """Time if the vehicle's clock went on at its rate since the last message; ours before the second."""
        if self.first is None or self.last is None:
            return arrival
        if self.last[2] <= self.first[2]:
            return self.last[1]
        rate = (self.last[1] - self.first[1]) / (self.last[2] - self.first[2])
        return self.last[1] + rate * (arrival - self.last[2])
