"""``search_area.geojson`` and ``search_area.kml``: where to look for a robot after its last telemetry.

The belief is carried on with the controls of the plan. The areas are ellipses of the linear law, one for each
share and time.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from pareto_ltl.exports.corridor import FINEST
from pareto_ltl.exports.degrees import outline_degrees
from pareto_ltl.exports.ellipses import ellipse_outlines, ellipse_scale
from pareto_ltl.exports.xml_text import add, xml_bytes
from pareto_ltl.inflight.watch import Event
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.files import write_bytes
from pareto_ltl.world.projection import utc_times
from pareto_ltl.world.scene import Scene

SHARES = (0.5, 0.9, 0.99)  # probabilities of the areas
CORNERS = 48
FILLS = {0.5: "90 0000c8", 0.9: "60 0078ff", 0.99: "40 00c8ff"}  # aabbggrr


def write_search_area(scene: Scene, end: Event, folder: Path) -> tuple[Path, ...]:
    """Write the areas of an event ``end``; nothing on a map without a place on Earth, or after the plan."""
    if scene.crs is None or not end["ahead"]:
        return ()
    areas = search_areas(scene, end["ahead"])
    text = (
        f"Areas that hold the robot with 50, 90 and 99 % if it flies on as planned, {end['law']} winds; last "
        f"telemetry {end['time']:.0f} s after departure."
    )
    geojson = {"type": "FeatureCollection", "description": text, "features": areas}
    paths = folder / "search_area.geojson", folder / "search_area.kml"
    write_bytes(paths[0], json.dumps(geojson).encode())
    write_bytes(paths[1], _kml(areas, text))
    return paths


def search_areas(scene: Scene, ahead: Sequence[Event]) -> list[dict[str, Any]]:
    """GeoJSON features: a polygon for each time and share."""
    crs = scene.crs
    assert crs is not None
    mean, cov = (np.array([row[key] for row in ahead]) for key in ("mean", "cov"))
    cov = cov + FINEST**2 * np.eye(2)  # the start of a plan is known exactly
    times = [float(row["time"]) for row in ahead]
    utc = utc_times(scene.time_zero, np.array(times))
    found = []
    for share in SHARES:
        scale = np.full(len(mean), ellipse_scale(share))
        for k, outline in enumerate(ellipse_outlines(mean, cov, scale, CORNERS)):
            about = {"probability": share, "t_s": times[k], "time_utc": None if utc is None else utc[k]}
            ring = _ring(crs, outline)
            found.append({
                "type": "Feature", "properties": about,
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            })  # fmt: skip
    return found


def _ring(crs: str, outline: FloatArray) -> list[list[float]]:
    ring = np.round(outline_degrees(crs, outline), 7).tolist()
    return ring if ring[0] == ring[-1] else [*ring, ring[0]]


def _kml(areas: Sequence[dict[str, Any]], text: str) -> bytes:
    root = Xml.Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = add(root, "Document")
    add(document, "name", "search area")
    add(document, "description", text)
    for share, fill in FILLS.items():
        style = add(document, "Style", id=f"p{100 * share:.0f}")
        add(add(style, "LineStyle"), "width", "1")
        add(add(style, "PolyStyle"), "color", fill.replace(" ", ""))
    for area in reversed(areas):  # the widest first, below the others
        about = area["properties"]
        place = add(document, "Placemark")
        add(place, "name", f"{100 * about['probability']:.0f} %, {about['time_utc'] or about['t_s']}")
        if about["time_utc"]:
            add(add(place, "TimeStamp"), "when", about["time_utc"])
        add(place, "styleUrl", f"#p{100 * about['probability']:.0f}")
        ring = add(add(add(place, "Polygon"), "outerBoundaryIs"), "LinearRing")
        corners = area["geometry"]["coordinates"][0]
        add(ring, "coordinates", " ".join(f"{lon:.7f},{lat:.7f}" for lon, lat in corners))
    return xml_bytes(root)
