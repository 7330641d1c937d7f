"""``plan.kml`` (OGC KML 2.2), ``plan.gpx`` (GPX 1.1), and ``plan.fpl``, a flight plan of Garmin.

The same content gives the same bytes.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from careful_io.names import joined_names
from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.branches import dividing_lines, reach_of
from pareto_ltl_apps.exports.degrees import united_rings
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.geojson import named_outlines, tube_rings
from pareto_ltl_apps.exports.navigation_log import LEG_COLUMNS

FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # in XML 1.0, even escaped


def element(tag: str, *content: Xml.Element | str | None, **attributes: str) -> Xml.Element:
    """An element with a text or with other elements, of which None is left out.

    Characters that XML cannot hold become question marks.
    """
    made = Xml.Element(tag, {key: FORBIDDEN.sub("?", value) for key, value in attributes.items()})
    for part in content:
        if isinstance(part, str):
            made.text = FORBIDDEN.sub("?", part)
        elif part is not None:
            made.append(part)
    return made


def leaves(texts: Mapping[str, str | None]) -> list[Xml.Element]:
    """An element with a text for each of ``texts`` that is not None."""
    return [element(tag, text) for tag, text in texts.items() if text is not None]


def xml_bytes(root: Xml.Element) -> bytes:
    """The file of ``root``, one element on each line."""
    Xml.indent(root)
    text: bytes = Xml.tostring(root, "utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"


# --- KML -----------------------------------------------------------------------------------------

TUBE = 0.95  # share of whole flights that stay in the area that is drawn
STYLES = {  # line colour, its width, fill colour: aabbggrr
    "route": ("ff00a5ff", 3, None),
    "region": ("ff3c8c3c", 2, "503c8c3c"),
    "obstacle": ("ff303030", 2, "80303030"),
    "landmark": ("ffb46432", 2, "50b46432"),
    "border": ("ff808080", 1, "00808080"),
    "corridor": ("ff00a5ff", 1, "3000a5ff"),
}
AT_LEGS = [*LEG_COLUMNS][:6]  # numbers of a leg that its position states


def plan_kml(exported: ExportedPlan) -> bytes:
    """The document: the route and the positions at their height, the map and the areas on the ground."""
    styles = [style_of(name, *drawn) for name, drawn in STYLES.items()]
    line = coordinates_text(Frame(exported.crs).line_degrees(exported.log.x), _height(exported))
    tube = exported.corridor.whole[exported.corridor.level(TUBE)]
    areas = f"{TUBE * 100:g} % of whole flights, {exported.law_words}"
    return kml_bytes(
        exported.name,
        " ".join(exported.sentences()),
        *styles,
        placemark("route", "route", _shape("LineString", line, exported)),
        *_branches(exported),
        element("Folder", element("name", "positions"), *_positions(exported)),
        element("Folder", element("name", "map"), *_map(exported)),
        placemark(areas, "corridor", _polygon(tube_rings(exported.crs, exported.corridor, float(tube)))),
    )


def _branches(exported: ExportedPlan) -> Iterator[Xml.Element]:
    """A folder with the route of each branch and the lines between the cells; none without branches."""
    crs = exported.crs
    if not exported.branches:
        return

    def line(points: FloatArray) -> Xml.Element:
        text = coordinates_text(Frame(crs).line_degrees(points), _height(exported))
        return _shape("LineString", text, exported)

    routes = [
        placemark(
            f"branch {one.name}: {one.branch.cell.words}", "route", line(one.log.x), one.log.time_utc(0)
        )
        for one in exported.branches
    ]
    between = [
        placemark(f"line {what}", "border", line(ends))
        for tree, plan in exported.questions()
        for what, ends in dividing_lines(tree, reach_of(tree, plan))
    ]
    yield element("Folder", element("name", "branches"), *routes, *between)


def kml_bytes(name: str, description: str, *content: Xml.Element) -> bytes:
    """The file of a document with ``content``."""
    about = leaves({"name": name, "description": description})
    return xml_bytes(
        element("kml", element("Document", *about, *content), xmlns="http://www.opengis.net/kml/2.2")
    )


def style_of(name: str, color: str | None, width: int, fill: str | None) -> Xml.Element:
    """How lines and areas are drawn; None leaves it to the reader."""
    outline = None if color is None else element("color", color)
    area = None if fill is None else element("PolyStyle", element("color", fill))
    return element("Style", element("LineStyle", outline, element("width", str(width))), area, id=name)


def placemark(name: str, style: str, shape: Xml.Element, utc: str | None = None) -> Xml.Element:
    """A shape with a name and a style, and with its time if it has one."""
    return element("Placemark", element("name", name), _stamp(utc), element("styleUrl", f"#{style}"), shape)


def _positions(exported: ExportedPlan) -> Iterator[Xml.Element]:
    log = exported.log
    for k, (lat, lon) in enumerate(zip(log.lat, log.lon, strict=True)):
        reported = {"radius_95_m": f"{log.radius[k]:.3f}", "wind_law": log.law}
        if k < log.legs:
            leg = log.leg(k)
            reported |= {name: f"{leg[name]:.6f}" for name in AT_LEGS if np.isfinite(leg[name])}
        data = (element("Data", element("value", value), name=name) for name, value in reported.items())
        yield element(
            "Placemark",
            element("name", f"{k} {region_text(exported, k)}".strip()),
            _stamp(log.time_utc(k)),
            element("ExtendedData", *data),
            _shape("Point", f"{lon:.8f},{lat:.8f}{_height(exported)}", exported),
        )


def _stamp(utc: str | None) -> Xml.Element | None:
    return None if utc is None else element("TimeStamp", element("when", utc))


def _height(exported: ExportedPlan) -> str:
    """The height [m] as the end of coordinates."""
    return f",{exported.height.metres:.1f}"


def _shape(tag: str, coordinates: str, exported: ExportedPlan) -> Xml.Element:
    """A shape above the sea or above the ground."""
    mode = "absolute" if exported.height.of_sea else "relativeToGround"
    return element(tag, element("altitudeMode", mode), element("coordinates", coordinates))


def _map(exported: ExportedPlan) -> Iterator[Xml.Element]:
    for role, name, outlines in named_outlines(exported.scene):
        polygons = [
            _polygon([Frame(exported.crs).outline_degrees(ring) for ring in rings])
            for rings in united_rings(outlines)
        ]
        shape = polygons[0] if len(polygons) == 1 else element("MultiGeometry", *polygons)
        yield placemark(name, "border" if role == "bounds" else role, shape)


def _polygon(rings: Sequence[FloatArray]) -> Xml.Element:
    tags = ["outerBoundaryIs", *["innerBoundaryIs"] * (len(rings) - 1)]
    bounds = (boundary(coordinates_text(ring), tag) for tag, ring in zip(tags, rings, strict=True))
    return element("Polygon", element("tessellate", "1"), *bounds)


def boundary(coordinates: str, tag: str = "outerBoundaryIs") -> Xml.Element:
    """A ring of a polygon."""
    return element(tag, element("LinearRing", element("coordinates", coordinates)))


def coordinates_text(lonlats: Iterable[Any], height: str = "", digits: int = 8) -> str:
    """Longitudes and latitudes [deg] as KML has them, each with the end ``height``."""
    return " ".join(f"{lon:.{digits}f},{lat:.{digits}f}{height}" for lon, lat in lonlats)


# --- GPX -----------------------------------------------------------------------------------------


def plan_gpx(exported: ExportedPlan) -> bytes:
    """The file: one ``rtept`` for each step, with its time if the map names a departure.

    ``ele`` is above mean sea level: it is written for pressure levels and depths. The height of the ground is
    unknown, so that heights above it are in the description.
    """
    log, height, departure = exported.log, exported.height, exported.log.time_utc(0)
    above = "" if height.of_sea else f", {height.metres:g} m above the ground of the start"
    points = []
    for k, (lat, lon) in enumerate(_places(exported)):
        about = {
            "ele": f"{height.metres:.1f}" if height.of_sea else None,
            "time": log.time_utc(k),
            "name": f"{k} {region_text(exported, k)}".strip(),
            "desc": f"95 % of positions within {log.radius[k] / 1e3:.3f} km, {exported.law_words}{above}",
        }
        points.append(element("rtept", *leaves(about), lat=lat, lon=lon))
    planned = None  # OpenCPN sets the departure of its table by it
    if departure is not None:
        planned = element("extensions", element("opencpn:planned_departure", departure))
    about = {"name": exported.name, "desc": " ".join(exported.sentences()), "time": departure}
    root = element(
        "gpx",
        element("metadata", *leaves(about)),
        element("rte", element("name", exported.name), planned, *points),
        version="1.1", creator="pareto_ltl", xmlns="http://www.topografix.com/GPX/1/1",
        **{"xmlns:opencpn": "http://www.opencpn.org"},
    )  # fmt: skip
    return xml_bytes(root)


def _places(exported: ExportedPlan) -> Iterator[tuple[str, str]]:
    """Latitude and longitude, -180 and not 180, of each step."""
    for lat, lon in zip(exported.log.lat, exported.log.lon, strict=True):
        yield f"{lat:.8f}", f"{-180.0 if lon >= 180.0 else lon:.8f}"


def region_text(exported: ExportedPlan, k: int) -> str:
    """The regions that step ``k`` is in."""
    return joined_names(exported.plan.path.label[k])


# --- FPL -----------------------------------------------------------------------------------------

KIND = "USER WAYPOINT"
LONGEST = 25  # characters of names and comments: capital letters, digits, spaces and slashes


def plan_fpl(exported: ExportedPlan) -> bytes:
    """The file: a waypoint for each step, ``P000`` the departure. The format has no times and no heights."""
    points, places = [], []
    for k, (lat, lon) in enumerate(_places(exported)):
        kind = {"identifier": f"P{k:03d}", "type": KIND, "country-code": ""}
        comment = short_text(" ".join(sorted(exported.plan.path.label[k])))
        places.append(element("waypoint", *leaves(kind | {"lat": lat, "lon": lon, "comment": comment})))
        points.append(
            element("route-point", *leaves({f"waypoint-{tag}": text for tag, text in kind.items()}))
        )
    about = {"file-description": " ".join(exported.sentences()), "created": exported.log.time_utc(0)}
    route = {"route-name": short_text(exported.name), "flight-plan-index": "1"}
    root = element(
        "flight-plan",
        *leaves(about),
        element("waypoint-table", *places),
        element("route", *leaves(route), *points),
        xmlns="http://www8.garmin.com/xmlschemas/FlightPlan/v1",
    )
    return xml_bytes(root)


def short_text(text: str) -> str:
    """``text`` in the letters of a navigator; accents are left out, other signs become spaces."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().upper()
    return " ".join(re.sub(r"[^A-Z0-9/]+", " ", plain).split())[:LONGEST]
