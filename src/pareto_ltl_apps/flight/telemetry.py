"""Telemetry as readings in order of time: from a table, or from anything that yields :class:`Reading`.

Readings that cannot be used are counted by their fault, and never end a watch. What the pilot types are
position fixes, and the answer to a new plan.
"""

from __future__ import annotations

import csv
import math
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO

import numpy as np

from careful_io.messages import shown_value
from careful_io.reading import refuse_special
from flight_quantities.atmosphere import true_airspeed
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.departure import seconds_after
from pareto_ltl.support.errors import DataError

NEEDED = ("time", "heading_true")
TRUE, CALIBRATED = "airspeed_tas_m_s", "airspeed_cas_m_s"  # columns of the two airspeeds
SHORT = {TRUE: "airspeed_tas", CALIBRATED: "airspeed_cas"}  # without the unit, which is the same
PLACES = {True: ("lat", "lon"), False: ("x", "y")}  # by whether the map is on Earth
SD = "fix_sd_m"
FASTEST = 1.5  # of the largest airspeed of the robot: a faster reading is an error
JUMP = 3600.0  # [s] a reading so much later than the last one is a jump of the clock until a second agrees
MICROSECONDS = 6  # decimal places of times [s]
LATE = 1.0  # [s] a position may be older than the last reading: its error grows by the way flown since
LEAST_SD, MAX_SD = 0.01, 1e6  # [m] of a usable fix


@dataclass(frozen=True, slots=True)
class Reading:
    """What a robot reports at one time.

    Attributes
    ----------
    time : float
        Seconds after departure.
    heading, airspeed : float
        True heading of the airspeed [deg] and the true airspeed [m/s]; NaN if they are not known.
    place : (float, float) or None
        Measured latitude and longitude [deg], or x and y [m] on a map without a place on Earth.
    sd : float
        Standard deviation of ``place`` in each direction [m].
    wind : (float, float) or None
        What the autopilot believes of the wind: where it comes from [deg], and its speed [m/s]. It is
        reported, and not used.
    battery : float
        Share of the energy that the autopilot believes is left.
    lost : tuple of str
        Signals that were older than 2 s: ``heading``, ``airspeed``.
    fault : str
        Why a record could not be used; it has no time then.
    """

    time: float
    heading: float = math.nan
    airspeed: float = math.nan
    place: tuple[float, float] | None = None
    sd: float = math.nan
    wind: tuple[float, float] | None = None
    battery: float = math.nan
    lost: tuple[str, ...] = ()
    fault: str = ""


@dataclass(slots=True)
class Sieve:
    """Passes the usable readings of a stream on, in order of time; ``refused`` counts the others by fault.

    Several readings may have one time: only one that is the same in all values is doubled. A position that is
    a little late is passed on at the time of the last reading.

    Parameters
    ----------
    u_max : float
        Largest airspeed of the robot [m/s].
    """

    u_max: float
    refused: Counter[str] = field(default_factory=Counter)
    last: float = -math.inf
    ahead: float | None = None
    known: set[str] = field(default_factory=set)  # readings of the last time

    def usable(self, readings: Iterable[Reading]) -> Iterator[Reading]:
        """The usable readings; a reading with a wrong place or airspeed keeps its other values."""
        for reading in readings:
            if reading.fault or reading.time is None or not math.isfinite(reading.time):
                self.refused[reading.fault or "no time"] += 1
                continue
            time = round(reading.time, MICROSECONDS)  # so that the parts of a step add up to it
            text = repr(replace(reading, time=time))
            if time < self.last:
                if reading.place is None or time < self.last - LATE:
                    self.refused["late"] += 1
                    continue
                yield Reading(self.last, math.nan, math.nan, *self._fix(reading, self.last - time))
            elif time == self.last and text in self.known:
                self.refused["doubled"] += 1
            elif self._jumps(time):
                self.refused["clock jumps ahead"] += 1
            else:
                self.known = {text} if time > self.last else {*self.known, text}
                self.last, self.ahead = time, None
                wind = reading.wind if reading.wind and all(map(math.isfinite, reading.wind)) else None
                battery = reading.battery if 0.0 <= reading.battery <= 1.0 else math.nan
                motion, fix = self._motion(reading), self._fix(reading)
                yield Reading(time, *motion, *fix, wind, battery, reading.lost)

    def _jumps(self, time: float) -> bool:
        """Whether ``time`` is far ahead of the last one, and no reading before it was as far ahead."""
        if not math.isfinite(self.last) or time < self.last + JUMP:
            return False
        agreed = self.ahead is not None and 0.0 <= time - self.ahead < JUMP
        self.ahead = time
        return not agreed

    def _motion(self, reading: Reading) -> tuple[float, float]:
        heading, airspeed = reading.heading, reading.airspeed
        if math.isnan(heading) and math.isnan(airspeed):
            return math.nan, math.nan
        if not (math.isfinite(heading) and -360.0 <= heading <= 720.0):
            self.refused["heading"] += 1
        elif not 0.0 <= airspeed <= FASTEST * self.u_max:
            self.refused["airspeed"] += 1
        else:
            return heading % 360.0, airspeed
        return math.nan, math.nan

    def _fix(self, reading: Reading, late: float = 0.0) -> tuple[tuple[float, float] | None, float]:
        """The place and its standard deviation [m], with the way that can be flown while it was ``late``."""
        if reading.place is None:
            return None, math.nan
        if not all(map(math.isfinite, reading.place)) or not LEAST_SD <= reading.sd <= MAX_SD:
            self.refused["position"] += 1
            return None, math.nan
        return reading.place, math.hypot(reading.sd, FASTEST * self.u_max * late)


def read_log(
    path: Path, time_zero: str | None, *, on_earth: bool, density_ratio: float = 1.0
) -> Iterator[Reading]:
    """The readings of a table, as they come; UTC counts from the departure ``time_zero``.

    The columns are ``time,heading_true``, one of ``airspeed_tas_m_s`` (true) and ``airspeed_cas_m_s``
    (calibrated; ``density_ratio`` is ρ / ρ0 of its air) and, where the position was measured,
    ``lat,lon,fix_sd_m`` (or ``x,y,fix_sd_m``).

    Raises
    ------
    DataError
        If the file cannot be read, or columns are missing. A row that is wrong is a reading without a time.
    """
    refuse_special(path)
    try:
        with path.open(encoding="utf-8", errors="replace", newline="") as file:
            rows = csv.DictReader(file)
            rows.fieldnames = names = [str(name).strip() for name in rows.fieldnames or ()]
            airspeed = _airspeed_column(path, names, PLACES[on_earth])
            factor = 1.0 if airspeed in (TRUE, SHORT[TRUE]) else true_airspeed(1.0, density_ratio)
            for row in rows:
                yield _reading(row, airspeed, factor, PLACES[on_earth], time_zero)
    except (OSError, csv.Error) as error:
        raise DataError(f"{path}: cannot be read ({error}); give a CSV file of telemetry") from None


def _airspeed_column(path: Path, names: Sequence[str], places: Sequence[str]) -> str:
    """The column of the airspeed; DataError if its kind is not known, or another column is missing."""
    found = [name for name in (*SHORT, *SHORT.values()) if name in names]
    if missing := [name for name in NEEDED if name not in names]:
        raise DataError(
            f"{path}: no column {', '.join(missing)}; expected {','.join((*NEEDED, TRUE))} (or {CALIBRATED}) "
            f"in the first line and, for measured positions, {','.join((*places, SD))}"
        )
    if len(found) != 1:
        unknown = [name for name in names if "airspeed" in name]
        have = f"an airspeed of unknown kind, {shown_value(unknown[0])}" if unknown else "no airspeed"
        raise DataError(
            f"{path}: {'two airspeeds' if found else have}; give one column, {TRUE} if it is the true "
            f"airspeed, or {CALIBRATED} if it is calibrated, as of a pitot tube or of VFR_HUD"
        )
    return found[0]


def read_places(path: Path, time_zero: str | None, *, on_earth: bool) -> tuple[FloatArray, FloatArray]:
    """Times (n,) [s after departure] and places (n, 2) of a table ``time,lat,lon`` or ``time,x,y``.

    Raises
    ------
    DataError
        If the file cannot be read, columns or numbers are missing, or times do not increase.
    """
    refuse_special(path)
    names = PLACES[on_earth]
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [
                (_seconds(row["time"], time_zero), float(row[names[0]]), float(row[names[1]]))
                for row in csv.DictReader(file)
            ]
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise DataError(
            f"{path}: cannot be read ({error}); expected a CSV file time,{','.join(names)}"
        ) from None
    table = np.array(rows, float).reshape(-1, 3)
    if not len(table) or not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0.0).any():
        raise DataError(f"{path}: expected finite numbers, and times that increase")
    return table[:, 0], table[:, 1:]


def _seconds(text: str, time_zero: str | None) -> float:
    """Seconds after departure, of such a number or of an ISO 8601 time; NaN if ``text`` is neither."""
    with suppress(ValueError):
        return float(text)
    try:
        return seconds_after("time", text, time_zero)
    except DataError:
        return math.nan


def _reading(
    row: dict[str, str], airspeed: str, factor: float, places: Sequence[str], time_zero: str | None
) -> Reading:
    def number(name: str) -> float:
        try:
            return float(row.get(name) or "nan")
        except (TypeError, ValueError):
            return math.nan

    place = (number(places[0]), number(places[1])) if (row.get(places[0]) or "").strip() else None
    return Reading(
        _seconds((row.get("time") or "").strip(), time_zero), number("heading_true"),
        factor * number(airspeed), place, number(SD),
    )  # fmt: skip


def refused_text(refused: Counter[str]) -> str:
    """``12 late, 3 position`` for a message; empty if there are none."""
    return ", ".join(f"{count} {shown_value(fault)[1:-1]}" for fault, count in sorted(refused.items()))


# --- what the pilot types -----------------------------------------------------------------------


HELP = "type fix LAT,LON,SD (or fix X,Y,SD) for a position [deg and m], or y to fly the new plan"


class Typed:
    """Reads ``stream`` line by line in a thread.

    Attributes
    ----------
    fixes : deque of (float, float, float)
        Positions with their standard deviations [m], which are not taken yet.
    agreed : threading.Event
        Whether ``y`` was typed; who takes it clears it.
    """

    def __init__(self, stream: TextIO, complain: Callable[[str], None]) -> None:
        self.stream, self.complain = stream, complain
        self.fixes: deque[tuple[float, float, float]] = deque(maxlen=100)
        self.agreed = threading.Event()

    def start(self) -> None:
        """Begin to read."""
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self.stream:
            self.take(line)

    def take(self, line: str) -> None:
        """Take one line; one that is not understood is answered with what can be typed."""
        word, _, rest = line.strip().partition(" ")
        if word == "y" and not rest:
            self.agreed.set()
            return
        with suppress(ValueError):
            first, second, sd = map(float, rest.split(","))
            if word == "fix" and all(map(math.isfinite, (first, second, sd))) and sd > 0.0:
                self.fixes.append((first, second, sd))
                return
        if line.strip():
            self.complain(HELP)
