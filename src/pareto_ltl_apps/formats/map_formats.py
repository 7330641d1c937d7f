"""The format of a map file, from its content: features and what was not read, or the way to convert it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from careful_io import reading
from careful_io.reading import Advice, read_bounded, shown_json
from pareto_ltl.extend import MapFormats, SceneSketch
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats import map_airspace as airspace
from pareto_ltl_apps.formats import map_fences as fences
from pareto_ltl_apps.formats.feature_limit import refuse_many_features
from pareto_ltl_apps.formats.map_archive import KmlSources, any_file, is_archive
from pareto_ltl_apps.formats.map_features import FeatureReader
from pareto_ltl_apps.formats.map_file import MapFile, needs_a_map
from pareto_ltl_apps.formats.map_kml import read_kml
from pareto_ltl_apps.formats.map_openair import is_openair, read_openair
from pareto_ltl_apps.formats.map_plane import sketch_features
from pareto_ltl_apps.formats.map_roles import RoleRules

SCENE_FILES = MapFormats.ADVICE
ZONE_FILES = Advice("check scene.zones", "write the file again, or leave it out")
SUFFIXES = (".kml", ".kmz")
SHAPES = (
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
)
TO_GEOJSON = "convert it with ogr2ogr -f GeoJSON map.geojson FILE (GDAL), or in QGIS"
HEAD = 2000  # bytes of a file that show its format
BLANK = b"\xef\xbb\xbf \t\r\n"  # before the first character of a text
RECORD_SEPARATOR = b"\x1e"  # before each text of RFC 8142
FOREIGN_BYTES = (  # the first bytes, and what a file that begins with them is
    (b"SQLite format 3", "a GeoPackage or another database"),
    (b"\x00\x00\x27\x0a", "a shapefile"),
    (b"fgb", "FlatGeobuf"),
    (b"PAR1", "GeoParquet"),
    (b"II*\x00", "a GeoTIFF, an image"),
    (b"MM\x00*", "a GeoTIFF, an image"),
    (b"%PDF", "a PDF"),
)
FOREIGN_XML = {  # the root element
    "gpx": "a GPX file, which has no areas",
    "FeatureCollection": "GML",
    "AIXMBasicMessage": "AIXM",
    "AIXM-Snapshot": "AIXM",
    "AIRSPACE": "airspace in XML",
    "osm": "OpenStreetMap data",
}
FOREIGN_TEXTS = (
    (r"^\s*#\s*saved by", "an old fence or polygon file of Mission Planner",
     "load it there and save the fence as .waypoints"),
    (r"^\s*(POLYGON|MULTIPOLYGON|GEOMETRYCOLLECTION|SRID=)\s*[Z(\d=]", "well-known text (WKT)", TO_GEOJSON),
    (r"^\s*0\s*\r?\n\s*SECTION", "DXF", TO_GEOJSON),
    (r"^\s*(TYPE|INCLUDE|VERSION)\s*=", "airspace in the TNP format", "save it as OpenAir"),
    (r"^[^\n{]*[,;\t][^\n{]*\n", "a table", f"make features of its rows: {TO_GEOJSON}"),
)  # fmt: skip


def read_sketch(path: Path, zones: Sequence[str] = (), roles: Any = ()) -> SceneSketch | Mapping[str, Any]:
    """The map of a file with the features of the files ``zones``, or the document of a run's ``scene.json``.

    ``roles`` are ``scene.roles``. DataError for a damaged file, or one that is no map.
    """
    found, rules = read_map_file(path), RoleRules.of(roles or {})
    if not isinstance(found, MapFile):
        if zones:
            raise DataError(
                f"scene file {path} is in metres, so scene.zones cannot be added to it; add them to the map "
                "in degrees"
            )
        return found
    if text := needs_a_map(found):
        raise DataError(text)
    return sketch_features([found, *map(_zone_file, zones)], FeatureReader(rules))


def _zone_file(name: str) -> MapFile:
    """The features of a file of ``scene.zones``; those without a role are obstacles."""
    found = read_map_file(Path(name).expanduser(), ZONE_FILES)
    if not isinstance(found, MapFile):
        raise DataError(f"scene file {name} is in metres; scene.zones are files in degrees")
    return replace(found, role=found.role or "obstacle")


def read_map_file(path: Path, advice: Advice = SCENE_FILES) -> MapFile | Mapping[str, Any]:
    """The features of a map file, or the document of a run's ``scene.json``.

    Raises
    ------
    DataError
        If the file cannot be read, or has another format; the message names it, and how to convert it.
    """
    where = f"scene file {path}"
    if is_archive(path):
        return read_kml(where, KmlSources.of(path, advice), advice)
    content = read_bounded(path, advice)
    for begin, kind in FOREIGN_BYTES:
        if content.startswith(begin):
            raise DataError(f"{where} is {kind}; {TO_GEOJSON}")
    start = content[:HEAD].lstrip(BLANK)
    if _is_kml(path, start):
        _refuse_foreign_xml(where, start)
        return read_kml(where, KmlSources.of(path, advice), advice)
    if start[:1] in b"{[" and start:
        return _from_json(path, where, content, advice)
    if content.lstrip()[:1] == RECORD_SEPARATOR:
        return _sequence(where, [text for text in content.split(RECORD_SEPARATOR) if text.strip()], advice)
    return _from_text(path, where, content, advice)


def _is_kml(path: Path, start: bytes) -> bool:
    return start.startswith(b"<") or path.suffix.lower() == ".kml"


def linked_files(path: Path, readable: Callable[[Path], bool] = any_file) -> tuple[Path, ...]:
    """The files in the folder of the map ``path`` to which its links lead, also through one another.

    Of those that are not ``readable`` the links are not followed. A map that cannot be read has none; the
    stage that reads it reports that.
    """
    try:
        with path.open("rb") as file:
            if not (_is_kml(path, file.read(HEAD).lstrip(BLANK)) or is_archive(path)):
                return ()  # other formats have no links
        sources = KmlSources.of(path, SCENE_FILES, readable)
    except (DataError, OSError):
        return ()
    with suppress(DataError):
        read_kml(f"scene file {path}", sources, SCENE_FILES)
    return tuple(dict.fromkeys(sources.beside))


def _refuse_foreign_xml(where: str, start: bytes) -> None:
    """DataError for XML of another kind, from the name of its first element."""
    names = re.findall(rb"<(?:[\w.-]+:)?([A-Za-z][\w.-]*)", start)
    root = names[0].decode("ascii", "replace") if names else ""
    if root in FOREIGN_XML:
        raise DataError(f"{where} is {FOREIGN_XML[root]}; {TO_GEOJSON}")


def _from_text(path: Path, where: str, content: bytes, advice: Advice) -> MapFile | Mapping[str, Any]:
    text = reading.decoded_text(content, where, advice)
    if fences.is_waypoints(text):
        return fences.read_waypoints(where, text)
    if is_openair(text):
        return read_openair(where, text)
    for pattern, kind, cure in FOREIGN_TEXTS:
        if re.search(pattern, text[:2000]):
            raise DataError(f"{where} is {kind}; {cure}")
    return _from_json(path, where, content, advice)


def _from_json(path: Path, where: str, content: bytes, advice: Advice) -> MapFile | Mapping[str, Any]:
    refuse_many_features(where, content, b'"geometry"')
    lines = content.strip().splitlines()
    if len(lines) > 1 and all(
        line.strip()[:1] == b"{" and line.strip()[-1:] == b"}" for line in lines if line.strip()
    ):
        return _sequence(where, [line for line in lines if line.strip()], advice)
    data = reading.parse_json(content, str(path), advice)
    if isinstance(data, list) and airspace.is_openaip(data):
        return airspace.read_openaip(where, data)
    if not isinstance(data, dict):
        raise DataError(
            f"{where} is {reading.json_kind(data)}, and so neither a GeoJSON FeatureCollection nor KML"
        )
    if fences.is_plan(data):
        return fences.read_plan(where, data)
    if airspace.is_openaip(data.get("items")):
        return airspace.read_openaip(where, data["items"])
    if airspace.is_ed269(data):
        return airspace.read_ed269(where, data)
    return _geojson(where, data)


def _geojson(where: str, data: dict[str, Any]) -> MapFile | Mapping[str, Any]:
    kind = data.get("type")
    if kind == "FeatureCollection" or (
        kind is None and isinstance(data.get("features"), list) and "bounds" not in data
    ):
        if "geometryType" in data or "spatialReference" in data:
            raise DataError(f"{where} is JSON of Esri, not GeoJSON; {TO_GEOJSON}")
        members = {
            key: value for key, value in data.items() if key not in ("type", "features", "crs", "bbox")
        }
        crs = crs_name(where, data.get("crs"))
        return MapFile(where, "GeoJSON", data.get("features", []), crs, members=members)
    if kind == "Feature":
        return MapFile(where, "GeoJSON", [data], crs_name(where, data.get("crs")))
    if kind in SHAPES:
        return MapFile(where, "GeoJSON", [{"type": "Feature", "properties": {}, "geometry": data}])
    if kind == "Topology":
        raise DataError(f"{where} is TopoJSON; {TO_GEOJSON}")
    if "bounds" in data:
        return data
    raise DataError(
        f"{where} is neither a GeoJSON FeatureCollection nor a run's scene.json; expected one of the two, or "
        "KML"
    )


def _sequence(where: str, texts: list[bytes], advice: Advice) -> MapFile:
    """A sequence of GeoJSON texts (RFC 8142), one feature each; a line that is none is a fault."""
    features, faults = list[Any](), list[str]()
    for number, text in enumerate(texts, 1):
        try:
            one = reading.parse_json(text, f"{where}: text {number}", advice)
        except DataError as error:
            faults.append(str(error))
            continue
        kind = one.get("type") if isinstance(one, dict) else None
        if kind == "FeatureCollection" and isinstance(one.get("features"), list):
            features += one["features"]
        elif kind == "Feature":
            features.append(one)
        elif kind in SHAPES:
            features.append({"type": "Feature", "properties": {}, "geometry": one})
        else:
            faults.append(f"{where}: text {number} is {shown_json(one)}; expected a GeoJSON Feature")
    return MapFile(where, "GeoJSON", features, faults=tuple(faults))


def crs_name(where: str, member: Any) -> str | None:
    """The name in the member ``crs`` of GeoJSON before RFC 7946; None for degrees (WGS 84)."""
    if member is None:
        return None
    properties = member.get("properties") if isinstance(member, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise DataError(
            f"{where}: crs is {shown_json(member)}; expected a name such as urn:ogc:def:crs:EPSG::3857, or "
            "no crs for longitude and latitude"
        )
    return None if name.upper().endswith(("CRS84", "EPSG::4326", "EPSG:4326")) else name


FORMATS = MapFormats(read_sketch, linked_files)
