"""``plan.kml`` (OGC KML 2.2): route, expected positions in time, map, and the area of whole flights."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from pareto_ltl.exports.degrees import line_degrees, outline_degrees
from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.geojson import titled_outlines, tube_rings
from pareto_ltl.exports.gpx import region_text
from pareto_ltl.exports.xml_text import add, xml_bytes
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.polygons import united_rings

NAMESPACE = "http://www.opengis.net/kml/2.2"
TUBE = 0.95  # share of whole flights that stay in the area that is drawn
STYLES = {  # line colour, its width, fill colour: aabbggrr
    "route": ("ff00a5ff", 3, None),
    "region": ("ff3c8c3c", 2, "503c8c3c"),
    "obstacle": ("ff303030", 2, "80303030"),
    "landmark": ("ffb46432", 2, "50b46432"),
    "border": ("ff808080", 1, "00808080"),
    "corridor": ("ff00a5ff", 1, "3000a5ff"),
}


def plan_kml(exported: ExportedPlan) -> bytes:
    """The document: the route and the positions at their height, the map and the areas on the ground."""
    root = Xml.Element("kml", {"xmlns": NAMESPACE})
    document = add(root, "Document")
    add(document, "name", exported.name)
    add(document, "description", " ".join(exported.sentences()))
    for name, (color, width, fill) in STYLES.items():
        style = add(document, "Style", id=name)
        line = add(style, "LineStyle")
        add(line, "color", color)
        add(line, "width", str(width))
        if fill is not None:
            add(add(style, "PolyStyle"), "color", fill)
    _add_route(document, exported)
    _add_positions(document, exported)
    _add_map(document, exported)
    _add_tube(document, exported)
    return xml_bytes(root)


def _add_route(document: Xml.Element, exported: ExportedPlan) -> None:
    place = _placemark(document, "route", "route")
    line = add(place, "LineString")
    height = _altitude_mode(line, exported)
    add(line, "coordinates", _coordinates(line_degrees(exported.crs, exported.log.x), height))


def _add_positions(document: Xml.Element, exported: ExportedPlan) -> None:
    log, folder = exported.log, add(document, "Folder")
    add(folder, "name", "positions")
    for k, (lat, lon) in enumerate(zip(log.lat, log.lon, strict=True)):
        place = add(folder, "Placemark")
        add(place, "name", f"{k} {region_text(exported, k)}".strip())
        if log.utc is not None:
            add(add(place, "TimeStamp"), "when", log.utc[k])
        _add_data(place, _leg_data(exported, k))
        point = add(place, "Point")
        height = _altitude_mode(point, exported)
        add(point, "coordinates", f"{lon:.8f},{lat:.8f}{height}")


def _altitude_mode(shape: Xml.Element, exported: ExportedPlan) -> str:
    """Write whether the height is above the sea or the ground; return it as the end of coordinates [m]."""
    height = exported.height
    add(shape, "altitudeMode", "absolute" if height.of_sea else "relativeToGround")
    return f",{height.metres:.1f}"


def _leg_data(exported: ExportedPlan, k: int) -> dict[str, str]:
    log = exported.log
    told = {"radius_95_m": f"{log.radius[k]:.3f}", "wind_law": log.law}
    if k == len(log.airspeed):
        return told
    numbers = {
        "heading_true_deg": log.heading[k], "airspeed_m_s": log.airspeed[k], "duration_s": log.duration[k],
        "wind_m_s": log.wind_speed[k], "wind_from_deg": log.wind_from[k], "wind_sd_m_s": log.wind_sd[k],
    }  # fmt: skip
    return told | {key: f"{value:.6f}" for key, value in numbers.items() if np.isfinite(value)}


def _add_map(document: Xml.Element, exported: ExportedPlan) -> None:
    scene, folder = exported.scene, add(document, "Folder")
    add(folder, "name", "map")
    drawn = [("region", name, outlines) for name, outlines in scene.regions.items()]
    drawn += [
        ("border" if role == "bounds" else role, name, (corners,))
        for role, name, corners in titled_outlines(scene)
    ]
    for style, name, outlines in drawn:
        place, polygons = _placemark(folder, name, style), united_rings(outlines)
        parent = place if len(polygons) == 1 else add(place, "MultiGeometry")
        for rings in polygons:
            _add_polygon(parent, [outline_degrees(exported.crs, ring) for ring in rings])


def _add_tube(document: Xml.Element, exported: ExportedPlan) -> None:
    corridor = exported.corridor
    size = float(corridor.whole[corridor.level(TUBE)])
    name = f"{TUBE * 100:g} % of whole flights, {corridor.law} winds"
    place = _placemark(document, name, "corridor")
    _add_polygon(place, tube_rings(exported.crs, corridor, size))


def _placemark(parent: Xml.Element, name: str, style: str) -> Xml.Element:
    place = add(parent, "Placemark")
    add(place, "name", name)
    add(place, "styleUrl", f"#{style}")
    return place


def _add_data(place: Xml.Element, told: dict[str, str]) -> None:
    extended = add(place, "ExtendedData")
    for name, value in told.items():
        add(add(extended, "Data", name=name), "value", value)


def _add_polygon(place: Xml.Element, rings: list[FloatArray]) -> None:
    polygon = add(place, "Polygon")
    add(polygon, "tessellate", "1")
    for tag, ring in zip(["outerBoundaryIs", *["innerBoundaryIs"] * len(rings)], rings, strict=False):
        add(add(add(polygon, tag), "LinearRing"), "coordinates", _coordinates(ring))


def _coordinates(lonlats: Any, height: str = "") -> str:
    return " ".join(f"{lon:.8f},{lat:.8f}{height}" for lon, lat in lonlats)
