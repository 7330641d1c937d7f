"""KML (OGC 12-007r2) and KMZ as GeoJSON features.

The role of a Placemark is its ExtendedData ``role``, else the name of a folder around it (Regions, Obstacles,
Landmarks, Border, Start), else its name if that is start or border. Other ExtendedData are the properties of
GeoJSON; a TimeSpan, also of a folder around it, gives ``from`` and ``until``. A NetworkLink to a file in the
archive, or in the folder of the map, is read as a part of the map; no link to the network is opened.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any
from xml.etree.ElementTree import Element

from careful_io.messages import shown_text
from careful_io.reading import Advice
from pareto_ltl.extend import Unread
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.feature_limit import MAX_FEATURES, refuse_many_features
from pareto_ltl_apps.formats.map_archive import KmlSources, linked_name
from pareto_ltl_apps.formats.map_file import MapFile
from pareto_ltl_apps.formats.map_xml import parsed_xml, text_of

MAX_LINKS = 100  # files that one map may link to
FOLDERS = {  # names of folders in lower case, without a plural s
    "region": "region", "obstacle": "obstacle", "landmark": "landmark", "border": "border",
    "bound": "border", "start": "start",
}  # fmt: skip
KEEP_OUT = re.compile(r"(no[- ]?fly|keep[- ]?out|restricted|prohibited|danger|exclusion)( (zone|area)s?)?")
GEOMETRIES = ("Point", "LineString", "LinearRing", "Polygon", "MultiGeometry")
SHAPELESS = ("Model", "Track", "MultiTrack")  # geometries that are not read
HINT = (
    "put it into a folder named Regions, Obstacles, Landmarks, Border or Start, or give it the ExtendedData "
    "role"
)
NOT_SHAPES = (  # elements that cannot be obstacles
    "ScreenOverlay", "PhotoOverlay", "Tour", "Style", "StyleMap", "LookAt", "Camera", "TimeStamp", "Region",
    "ListStyle",
)  # fmt: skip
SILENT = (  # elements of a Document, a Folder or a Placemark that are read or describe it in words
    "name", "visibility", "open", "description", "Snippet", "snippet", "styleUrl", "Schema", "ExtendedData",
    "author", "link", "address", "phoneNumber", "AddressDetails", "TimeSpan", "Metadata", "balloonVisibility",
    "NetworkLinkControl", *GEOMETRIES,
)  # fmt: skip


def read_kml(where: str, sources: KmlSources, advice: Advice) -> MapFile:
    """The Placemarks of a KML or KMZ file and of the files that it links to; DataError if it is neither."""
    name = sources.main(lambda candidate: _has_roles(parsed_xml(where, sources.content(candidate, advice))))
    reader = _KmlReader(where, sources, advice)
    reader.read_file(name, _Inherited())
    for other in sources.others(reader.read):
        reader.unread.lost[f"{shown_text(other)} in the archive, to which the map has no link"] += 1
    return MapFile(where, "KML", reader.features, None, "", HINT, reader.unread, tuple(reader.faults))


@dataclass(frozen=True, slots=True)
class _Inherited:
    """What a Placemark inherits from the folders around it."""

    role: str = ""
    begin: str = ""
    end: str = ""

    def inside(self, folder: Element) -> _Inherited:
        """The same within ``folder``."""
        span = folder.find("TimeSpan")
        found = replace(self, role=named_role(text_of(folder.find("name"))) or self.role)
        if span is None:
            return found
        return replace(found, begin=text_of(span.find("begin")), end=text_of(span.find("end")))


def named_role(name: str) -> str:
    """The role of a folder with this name; empty if it has none."""
    simple = name.strip().lower()
    return FOLDERS.get(simple.removesuffix("s"), "obstacle" if KEEP_OUT.fullmatch(simple) else "")


def _has_roles(root: Element) -> bool:
    """Whether a KML file names a role: of a folder, in ExtendedData, or by a Placemark start or border."""
    names = (
        text_of(element.find("name")) for element in root.iter() if element.tag in ("Folder", "Document")
    )
    own = (text_of(place.find("name")).lower() for place in root.iter("Placemark"))
    keys = (
        data.get("name", "").strip().lower() for data in root.iter() if data.tag in ("Data", "SimpleData")
    )
    return any(map(named_role, names)) or "role" in keys or any(name in ("start", "border") for name in own)


class _KmlReader:
    """Reads one map with the files that it links to."""

    def __init__(self, where: str, sources: KmlSources, advice: Advice) -> None:
        self.where, self.sources, self.advice = where, sources, advice
        self.features: list[dict[str, Any]] = []
        self.unread, self.faults, self.read = Unread(), list[str](), list[str]()

    def read_file(self, name: str, given: _Inherited) -> None:
        """Read the file ``name`` of the sources, once."""
        if name in self.read:
            return
        self.read.append(name)
        where = self.where if len(self.read) == 1 else f"{self.where}: {shown_text(name)}"
        data = self.sources.content(name, self.advice)
        refuse_many_features(where, data, rb"</(?:[\w.-]+:)?Placemark\s*>")
        root = parsed_xml(where, data)
        if root.tag != "kml":
            raise DataError(f"{where} has the root element {shown_text(root.tag)!r}; expected kml")
        self.read_container(root, name, given)
        if len(self.features) > MAX_FEATURES:
            raise DataError(
                f"{self.where} has more than {MAX_FEATURES:,} features with its links; keep those near the "
                "mission"
            )

    def read_container(self, element: Element, name: str, given: _Inherited) -> None:
        """Read what ``element`` of the file ``name`` has inside."""
        for inner in element:
            if inner.tag in ("Document", "Folder"):
                self.read_container(inner, name, given.inside(inner))
            elif inner.tag in ("Placemark", "NetworkLink"):
                try:
                    (self.read_placemark if inner.tag == "Placemark" else self.read_link)(inner, name, given)
                except DataError as error:
                    self.faults.append(str(error))
            elif inner.tag in NOT_SHAPES:
                self.unread.passed[inner.tag] += 1
            elif inner.tag == "GroundOverlay":
                title = shown_text(text_of(inner.find("name")))
                self.unread.lost[f"GroundOverlay {title!r}, an image: draw its areas as Polygons"] += 1
            elif inner.tag not in SILENT:
                self.unread.lost[f"the element {shown_text(inner.tag)}"] += 1

    def read_link(self, link: Element, name: str, given: _Inherited) -> None:
        """Read the file of a NetworkLink; DataError if it is missing or lies elsewhere."""
        title = f"NetworkLink {shown_text(text_of(link.find('name')))!r}"
        places = [element.find("href") for element in link if element.tag in ("Link", "Url")]
        href = next((text for text in map(text_of, places) if text), "")
        if not href or re.match(r"[a-z][a-z0-9+.-]+:", href, re.I):
            address = f" to {shown_text(href)}" if href else " without an address"
            self.unread.lost[
                f"{title}{address}: the network is not opened; save the file beside the map, and link to it"
            ] += 1
            return
        if len(self.read) > MAX_LINKS:
            raise DataError(f"{self.where}: it links to more than {MAX_LINKS} files; unite them")
        other = linked_name(name, href)
        if other is None or not self.sources.has(other):
            raise DataError(
                f"{self.where}: {title} links to {shown_text(href)!r}, which is not in the "
                f"{self.sources.place}: put the file there, or remove the link"
            )
        self.read_file(other, given.inside(link))

    def read_placemark(self, place: Element, _name: str, given: _Inherited) -> None:
        """Add the feature of a Placemark."""
        name = text_of(place.find("name"))
        title = f"Placemark {shown_text(name)!r}"
        properties = _properties(place, given.inside(place))
        own = named_role(name)
        properties["role"] = (
            properties.get("role") or given.role or (own if own in ("start", "border") else None)
        )
        properties["name"] = properties.get("name") or name or None
        for inner in place:
            if inner.tag in NOT_SHAPES:
                self.unread.passed[inner.tag] += 1
        shapes = [element for element in place if element.tag in GEOMETRIES]
        odd = [element.tag for element in place.iter() if element.tag in SHAPELESS]
        for tag in odd:
            self.unread.lost[f"the {tag} of {title}: draw it as a LineString or a Polygon"] += 1
        if not shapes and odd:
            return
        if not shapes:
            raise DataError(f"{self.where}: {title} has no {', '.join(GEOMETRIES[:-1])}")
        modes = {text_of(mode) for mode in place.iter("altitudeMode")} - {
            "",
            "clampToGround",
            "clampToSeaFloor",
        }
        if modes and not {"floor", "ceiling"} & set(properties):
            self.unread.passed[
                f"altitudes (altitudeMode {', '.join(sorted(modes))}): the areas are active at all heights "
                "unless ExtendedData floor or ceiling limit them"
            ] += 1
        geometry = _geometry(f"{self.where}: {title}", shapes[0])
        self.features.append(
            {"type": "Feature", "title": title, "properties": properties, "geometry": geometry}
        )


def _properties(place: Element, given: _Inherited) -> dict[str, Any]:
    """ExtendedData of a Placemark, and its times."""
    found: dict[str, Any] = {}
    if given.begin or given.end:
        found = {"from": given.begin, "until": given.end}
    for data in place.iter("Data"):
        found[data.get("name", "").strip().lower()] = text_of(data.find("value"))
    for data in place.iter("SimpleData"):
        found[data.get("name", "").strip().lower()] = text_of(data)
    return found


def _geometry(what: str, shape: Element) -> dict[str, Any]:
    """A KML geometry as a GeoJSON geometry."""
    if shape.tag == "MultiGeometry":
        inner = [_geometry(what, part) for part in shape if part.tag in GEOMETRIES]
        return {"type": "GeometryCollection", "geometries": inner}
    if shape.tag == "Polygon":
        rings = [*shape.findall("outerBoundaryIs")[:1], *shape.findall("innerBoundaryIs")]
        inside = [ring for boundary in rings for ring in boundary.iter("LinearRing")]
        return {"type": "Polygon", "coordinates": [list(_corners(what, ring)) for ring in inside]}
    corners = list(_corners(what, shape))
    if shape.tag == "Point":
        return {"type": "Point", "coordinates": corners[0] if corners else []}
    if shape.tag == "LinearRing":
        return {"type": "Polygon", "coordinates": [corners] if corners else []}
    return {"type": "LineString", "coordinates": corners}


def _corners(what: str, shape: Element) -> Iterator[list[float]]:
    """[Longitude, latitude] of each corner [deg]."""
    try:
        for corner in re.sub(r"\s*,\s*", ",", text_of(shape.find("coordinates"))).split():
            yield [float(number) for number in corner.split(",")[:2]]
    except ValueError:
        raise DataError(f"{what}: its coordinates are no numbers; expected longitude,latitude ...") from None
