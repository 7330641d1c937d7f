"""Airspace in the OpenAir format as GeoJSON features.

Format: http://www.winpilot.com/UsersGuide/UserAirspace.asp and its extension by Naviter, version 2. Circles
are Points with a buffer; arcs are polygons with a corner at every ``ARC`` degrees. Numbers without a unit are
feet in heights and nautical miles in radii.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from careful_io.messages import shown_text
from flight_quantities.lengths import NAUTICAL_MILE, Height, height
from pareto_ltl.extend import Unread
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.feature_limit import MAX_FEATURES
from pareto_ltl_apps.formats.map_file import MapFile

if TYPE_CHECKING:
    import pyproj

ARC = 2.5  # [deg] between corners of an arc: the polygon is within 0.03 % of the radius of it
RECORD = re.compile(r"(?m)^\s*(AC\s+\S|DP\s+\d|V\s+X\s*=)")
COMMAND = re.compile(r"([A-Za-z]{1,2})(?:\s+(.*))?")
COORDINATE = re.compile(
    r"(\d{1,3}(?:\.\d+)?)(?::(\d{1,2}(?:\.\d+)?))?(?::(\d{1,2}(?:\.\d+)?))?\s*([NS])[\s,]*"
    r"(\d{1,3}(?:\.\d+)?)(?::(\d{1,2}(?:\.\d+)?))?(?::(\d{1,2}(?:\.\d+)?))?\s*([EW])",
    re.I,
)
IN_WORDS = ("AT", "SP", "SB", "AF", "AG", "AI", "AX", "AA", "TB", "V Z", "V W")  # labels, pens, frequencies

Corner = tuple[float, float]


def is_openair(text: str) -> bool:
    """Whether ``text`` has records of OpenAir."""
    kinds = {match[1][:2].strip().upper() for match in RECORD.finditer(text[:200_000])}
    return "AC" in kinds and len(kinds) > 1


def read_openair(where: str, text: str) -> MapFile:
    """The airspaces of ``text``; DataError if there are none."""
    reader = _OpenAirReader(where)
    for number, line in enumerate(text.splitlines(), 1):
        if command := COMMAND.fullmatch(line.partition("*")[0].strip()):
            reader.command(number, command[1].upper(), (command[2] or "").strip())
    reader.finish()
    if not reader.features and not reader.faults:
        raise DataError(f"{where}: OpenAir without an airspace; expected records AC, AN, AL, AH and DP or DC")
    return MapFile(
        where, "OpenAir", reader.features, None, "obstacle", unread=reader.unread, faults=tuple(reader.faults)
    )


@dataclass(slots=True)
class _OpenAirReader:
    """Reads commands one after another; ``corners`` and ``properties`` belong to the current airspace."""

    where: str
    features: list[dict[str, Any]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    unread: Unread = field(default_factory=Unread)
    properties: dict[str, Any] = field(default_factory=dict)
    corners: list[Corner] = field(default_factory=list)
    circles: list[tuple[Corner, float]] = field(default_factory=list)
    centre: Corner | None = None
    clockwise: bool = True
    begun: int = 0

    def command(self, number: int, name: str, rest: str) -> None:
        """Read one line; a fault is added to ``faults``."""
        try:
            if name == "AC":
                self.finish()
                self.begun, self.properties = number, {"class": rest, "name": f"airspace of line {number}"}
            elif name == "V":
                self.variable(rest)
            elif self.begun:
                self.element(name, rest)
        except DataError as error:
            self.faults.append(f"{self.where}: line {number}: {error}")
        except (ValueError, IndexError):
            self.faults.append(f"{self.where}: line {number}: {name} {shown_text(rest)} is not OpenAir")

    def variable(self, rest: str) -> None:
        """A centre or a direction of arcs."""
        key, _, value = (part.strip() for part in rest.partition("="))
        if key.upper() == "X":
            self.centre = _coordinate(value)
        elif key.upper() == "D":
            self.clockwise = value.strip() != "-"

    def element(self, name: str, rest: str) -> None:
        """A property or a part of the outline of the current airspace."""
        if name == "AN":
            self.properties["name"] = rest or self.properties["name"]
        elif name == "AY":
            self.properties["type"] = rest
        elif name in ("AL", "AH"):
            self.properties["floor" if name == "AL" else "ceiling"] = self.limit(rest, name == "AL")
        elif name == "DP":
            self.corners.append(_coordinate(rest))
        elif name == "DC":
            self.circles.append((self.middle(), _miles(rest)))
        elif name == "DA":
            radius, first, last = rest.split(",")
            self.arc(_miles(radius), _miles(radius), float(first), float(last))
        elif name == "DB":
            first_end, last_end = (_coordinate(match[0]) for match in COORDINATE.finditer(rest))
            self.arc_between(first_end, last_end)
        elif name == "DY":
            title = shown_text(self.properties["name"])
            self.unread.lost[f"the airway {title!r} (DY): draw it as a LineString with a buffer"] += 1
        elif name not in IN_WORDS:
            self.unread.passed[f"the record {name}"] += 1

    def limit(self, text: str, lower: bool) -> str:
        """A height in canonical form; a text that is none is no limit, which is on the careful side."""
        try:
            found = height("", text, "ft") or Height(0.0, "AGL")
        except DataError:
            title = shown_text(self.properties["name"])
            self.unread.passed[f"the limit {shown_text(text)!r} of {title!r}, which is read as no limit"] += 1
            return "GND" if lower else "UNL"
        return limit_text(found)

    def middle(self) -> Corner:
        """The centre of circles and arcs; DataError without one."""
        if self.centre is None:
            raise DataError("a circle or an arc without a centre; expected V X=... before it")
        return self.centre

    def arc(self, first_radius: float, last_radius: float, first: float, last: float) -> None:
        """Add an arc from the azimuth ``first`` to ``last`` [deg], in the current direction."""
        turn = (last - first) % 360.0 if self.clockwise else -((first - last) % 360.0)
        if not math.isfinite(turn):
            raise DataError("an arc with angles that are no numbers")
        lon, lat = self.middle()
        steps = max(1, math.ceil(abs(turn) / ARC))
        for k in range(steps + 1):
            share = k / steps
            radius = first_radius + share * (last_radius - first_radius)
            east, north, _ = _earth().fwd(lon, lat, first + share * turn, radius)
            self.corners.append((float(east), float(north)))

    def arc_between(self, first: Corner, last: Corner) -> None:
        """Add an arc between two corners around the centre."""
        lon, lat = self.middle()
        begin, _, near = _earth().inv(lon, lat, *first)
        end, _, far = _earth().inv(lon, lat, *last)
        self.arc(float(near), float(far), float(begin), float(end))

    def finish(self) -> None:
        """Add the features of the current airspace."""
        if self.begun:
            title = shown_text(str(self.properties["name"]))
            if self.corners:
                outline = [list(corner) for corner in self.corners]
                self.add({"type": "Polygon", "coordinates": [[*outline, outline[0]]]}, self.properties)
            for centre, radius in self.circles:
                self.add({"type": "Point", "coordinates": list(centre)}, self.properties | {"buffer": radius})
            if not self.corners and not self.circles:
                self.unread.lost[f"the airspace {title!r} of line {self.begun}, which has no outline"] += 1
        self.properties, self.corners, self.circles, self.clockwise = {}, [], [], True

    def add(self, geometry: dict[str, Any], properties: dict[str, Any]) -> None:
        """Add one feature; DataError if there are too many."""
        if len(self.features) >= MAX_FEATURES:
            raise DataError(
                f"{self.where} has more than {MAX_FEATURES:,} airspaces; keep those near the mission"
            )
        self.features.append({"type": "Feature", "properties": dict(properties), "geometry": geometry})


def limit_text(found: Height) -> str:
    """The text of a height, which :func:`~flight_quantities.lengths.height` reads again."""
    if found.metres == math.inf:
        return "UNL"
    if found == (0.0, "AGL"):
        return "GND"
    return f"{found.metres:.15g} m {'STD' if found.datum == 'FL' else found.datum}".strip()


def _coordinate(text: str) -> Corner:
    match = COORDINATE.search(text)
    if match is None:
        raise DataError(f"{shown_text(text)!r} is no position; expected one such as 60:24:00 N 010:00:00 E")
    north, east = (_degrees(match.groups()[start : start + 4]) for start in (0, 4))
    if abs(north) > 90 or abs(east) > 180:
        raise DataError(f"{shown_text(text)!r} is not on Earth")
    return east, north


def _degrees(parts: tuple[str | None, ...]) -> float:
    whole, minutes, seconds, side = parts
    value = float(whole or 0) + float(minutes or 0) / 60 + float(seconds or 0) / 3600
    return -value if (side or "").upper() in "SW" else value


def _miles(text: str) -> float:
    """A radius in nautical miles, as metres."""
    radius = float(text) * NAUTICAL_MILE
    if not 0 < radius < 1e7:
        raise DataError(f"the radius {shown_text(text)} is not possible; expected nautical miles")
    return radius


def _earth() -> pyproj.Geod:
    import pyproj

    return pyproj.Geod(ellps="WGS84")
