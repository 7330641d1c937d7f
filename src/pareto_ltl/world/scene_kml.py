"""KML (OGC 12-007r2) and KMZ as the features of a GeoJSON map.

The role of a Placemark is its ExtendedData ``role``, else the name of a folder around it (Regions, Obstacles,
Landmarks, Border, Start), else its name if that is start or border. Other ExtendedData are the properties
of GeoJSON; a TimeSpan gives ``from`` and ``until``. A document type declaration is refused, since entities
can expand a small file to fill the memory.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from pareto_ltl.support import reading
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.reading import MAX_BYTES, MAX_DEPTH, Advice
from pareto_ltl.world.scene_sketch import MapFaults

MOST_ELEMENTS = 1_000_000
SUFFIXES = (".kml", ".kmz")
FOLDERS = {  # names of folders in lower case, without a plural s
    "region": "region", "obstacle": "obstacle", "landmark": "landmark", "border": "border",
    "bound": "border", "start": "start",
}  # fmt: skip
GEOMETRIES = ("Point", "LineString", "LinearRing", "Polygon", "MultiGeometry")


def kml_features(path: Path, advice: Advice, faults: MapFaults, role: str = "") -> list[dict[str, Any]]:
    """The Placemarks of a KML or KMZ file as GeoJSON features; others are ``faults``.

    ``role`` is used for Placemarks without a role. DataError if the file is neither KML nor KMZ.
    """
    where = f"scene file {path}"
    data = _kmz_content(path, advice) if path.suffix.lower() == ".kmz" else reading.read_bounded(path, advice)
    reading.refuse_many_features(where, data, rb"</(?:[\w.-]+:)?Placemark\s*>")
    root = _parsed(where, data)
    if root.tag != "kml":
        raise DataError(f"{where} has the root element {shown_text(root.tag)!r}; expected kml")
    read = faults.each(_placemarks(root, role), lambda item: _feature(where, *item))
    return [feature for _, feature in read]


def _kmz_content(path: Path, advice: Advice) -> bytes:
    """The content of the first KML file in a KMZ archive."""
    reading.refuse_special(path)
    try:
        with zipfile.ZipFile(path) as archive:
            name = next(name for name in archive.namelist() if name.lower().endswith(".kml"))
            with archive.open(name) as file:
                data = file.read(MAX_BYTES + 1)
    except StopIteration:
        raise DataError(f"{path}: there is no KML file in it; {advice.damaged}") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); {advice.missing}") from error
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise DataError(f"{path}: not a KMZ archive ({error}); {advice.damaged}") from error
    if len(data) > MAX_BYTES:
        raise DataError(f"{path}: has more than {MAX_BYTES / 2**20:g} MiB, which is the limit")
    return data


# --- XML ----------------------------------------------------------------------------------------------


def _parsed(where: str, data: bytes) -> Element:
    """The root element of an XML text, with tags without prefixes.

    DataError if it is not XML or has a document type.
    """
    parser, builder, depth, count = expat.ParserCreate(), TreeBuilder(), 0, 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH or count > MOST_ELEMENTS:
            raise DataError(f"{where} is nested too deeply or has more than {MOST_ELEMENTS:,} elements")
        builder.start(name.rpartition(":")[2], attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name.rpartition(":")[2])

    def refuse(*_: Any) -> None:
        raise DataError(f"{where} has a document type (DOCTYPE), which no map needs; remove it")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = builder.data, refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # the latter two: an unknown encoding
        raise DataError(f"{where} is not XML as KML is written ({error}); correct the map") from None
    return builder.close()


def _text(element: Element | None) -> str:
    return "" if element is None else (element.text or "").strip()


# --- Placemarks ---------------------------------------------------------------------------------------


def _placemarks(element: Element, role: str) -> Iterator[tuple[Element, str]]:
    """Every Placemark, with the role of the nearest folder that has one."""
    for inner in element:
        if inner.tag == "Placemark":
            yield inner, role
        elif inner.tag in ("Document", "Folder"):
            yield from _placemarks(inner, _named_role(_text(inner.find("name"))) or role)


def _named_role(name: str) -> str:
    """The role of a folder with this name; empty if it has none."""
    return FOLDERS.get(name.strip().lower().removesuffix("s"), "")


def _feature(where: str, place: Element, role: str) -> dict[str, Any]:
    name = _text(place.find("name"))
    span = place.find("TimeSpan")
    times = {} if span is None else {"from": _text(span.find("begin")), "until": _text(span.find("end"))}
    properties: dict[str, Any] = times
    for data in place.iter("Data"):
        properties[data.get("name", "").strip().lower()] = _text(data.find("value"))
    for data in place.iter("SimpleData"):
        properties[data.get("name", "").strip().lower()] = _text(data)
    own = _named_role(name)
    properties["role"] = properties.get("role") or role or (own if own in ("start", "border") else None)
    if properties["role"] is None:
        raise DataError(
            f"{where}: Placemark {shown_text(name)!r} has no role; put it into a folder named Regions, "
            "Obstacles, Landmarks, Border or Start, or give it the ExtendedData role"
        )
    properties["name"] = properties.get("name") or name or None
    shape = next((element for element in place if element.tag in GEOMETRIES), None)
    if shape is None:
        raise DataError(f"{where}: Placemark {shown_text(name)!r} has no {', '.join(GEOMETRIES[:-1])}")
    geometry = _geometry(f"{where}: Placemark {shown_text(name)!r}", shape)
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _geometry(what: str, shape: Element) -> dict[str, Any]:
    """A KML geometry as a GeoJSON geometry."""
    if shape.tag == "MultiGeometry":
        inner = [_geometry(what, part) for part in shape if part.tag in GEOMETRIES]
        return {"type": "GeometryCollection", "geometries": inner}
    if shape.tag == "Polygon":
        rings = [*shape.findall("outerBoundaryIs")[:1], *shape.findall("innerBoundaryIs")]
        inside = [ring for boundary in rings for ring in boundary.iter("LinearRing")]
        return {"type": "Polygon", "coordinates": [_corners(what, ring) for ring in inside]}
    corners = _corners(what, shape)
    if shape.tag == "Point":
        return {"type": "Point", "coordinates": corners[0] if corners else []}
    return {"type": "LineString", "coordinates": corners}


def _corners(what: str, shape: Element) -> list[list[float]]:
    """[Longitude, latitude] of each corner [deg]."""
    try:
        corners = _text(shape.find("coordinates")).split()
        return [[float(number) for number in corner.split(",")[:2]] for corner in corners]
    except ValueError:
        raise DataError(f"{what}: its coordinates are no numbers; expected longitude,latitude ...") from None
