"""``plan.fpl``: the expected positions as a flight plan of Garmin, which ForeFlight and others open."""

from __future__ import annotations

import re
import unicodedata
from xml.etree import ElementTree as Xml

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.xml_text import add, xml_bytes

NAMESPACE = "http://www8.garmin.com/xmlschemas/FlightPlan/v1"
KIND = "USER WAYPOINT"
LONGEST = 25  # characters of names and comments: capital letters, digits, spaces and slashes


def plan_fpl(exported: ExportedPlan) -> bytes:
    """The file: a waypoint for each step, ``P000`` the departure. The format has no times and no heights."""
    log = exported.log
    root = Xml.Element("flight-plan", {"xmlns": NAMESPACE})
    add(root, "file-description", " ".join(exported.sentences()))
    if log.utc is not None:
        add(root, "created", log.utc[0])
    table, route = add(root, "waypoint-table"), Xml.Element("route")
    add(route, "route-name", short_text(exported.name))
    add(route, "flight-plan-index", "1")
    for k, (lat, lon) in enumerate(zip(log.lat, log.lon, strict=True)):
        place, point = add(table, "waypoint"), add(route, "route-point")
        add(place, "identifier", f"P{k:03d}")
        add(place, "type", KIND)
        add(place, "country-code", "")
        add(place, "lat", f"{lat:.8f}")
        add(place, "lon", f"{-180.0 if lon >= 180.0 else lon:.8f}")
        add(place, "comment", short_text(" ".join(sorted(exported.plan.path.label[k]))))
        add(point, "waypoint-identifier", f"P{k:03d}")
        add(point, "waypoint-type", KIND)
        add(point, "waypoint-country-code", "")
    root.append(route)
    return xml_bytes(root)


def short_text(text: str) -> str:
    """``text`` in the letters of a navigator; accents are left out, other signs become spaces."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().upper()
    return " ".join(re.sub(r"[^A-Z0-9/]+", " ", plain).split())[:LONGEST]
