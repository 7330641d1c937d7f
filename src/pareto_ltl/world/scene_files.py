"""Map files: GeoJSON and KML in degrees, and the ``scene.json`` and ``cells.json`` of a run in metres.

KML (OGC 12-007r2) and KMZ become the features of a GeoJSON map. The role of a Placemark is its ExtendedData
``role``, else the name of a folder around it (Regions, Obstacles, Landmarks, Border, Start), else its name if
that is start or border. Other ExtendedData are the properties of GeoJSON; a TimeSpan gives ``from`` and
``until``. A document type declaration is refused, since entities can expand a small file to fill the memory.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from pareto_ltl.support import reading
from pareto_ltl.support.archives import stored
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_json
from pareto_ltl.support.messages import shown_text, shown_value
from pareto_ltl.support.reading import MAX_BYTES, MAX_DEPTH, Advice, read_bounded, refuse_many_features
from pareto_ltl.support.schemas import check_document
from pareto_ltl.world import scene_sketch as sk
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import AbsentPlace, Scene, fix_document, read_fix
from pareto_ltl.world.scene_geojson import crs_name, sketch_features
from pareto_ltl.world.scene_shapes import refuse_crossings
from pareto_ltl.world.scene_sketch import MapFaults, Place, SceneSketch
from pareto_ltl.world.windows import TimedPlace, Window

MOST_ELEMENTS = 1_000_000
SUFFIXES = (".kml", ".kmz")
FOLDERS = {  # names of folders in lower case, without a plural s
    "region": "region", "obstacle": "obstacle", "landmark": "landmark", "border": "border",
    "bound": "border", "start": "start",
}  # fmt: skip
GEOMETRIES = ("Point", "LineString", "LinearRing", "Polygon", "MultiGeometry")
SCENE_FILES = Advice("check scene.file", "correct the map: GeoJSON, KML or a run's scene.json")


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """``scene`` as dicts and lists, the content of ``scene.json``."""
    return {
        "bounds": scene.bounds.tolist(),
        "start": scene.start.tolist(),
        "regions": {name: _listed_region(outlines) for name, outlines in scene.regions.items()},
        "obstacles": [polygon.tolist() for polygon in scene.obstacles],
        "landmarks": [polygon.tolist() for polygon in scene.landmarks],
        "border": scene.border,
        "crs": scene.crs,
        "time_zero": scene.time_zero,
    } | _added(scene)


def _added(scene: Scene) -> dict[str, Any]:
    """The keys that only some maps have: windows, forbidden, simplified, names, fixes, absent places."""
    windows = {name: window.as_dict() for name, window in scene.windows.items()}
    timed = {"windows": windows, "forbidden": list(scene.forbidden)} if windows else {}
    names = {"obstacle_names": list(scene.obstacle_names)} if scene.obstacle_names else {}
    fixes = {"landmark_fixes": list(map(fix_document, scene.landmark_fixes))} if scene.landmark_fixes else {}
    absent = {"absent": [place.as_dict() for place in scene.absent]} if scene.absent else {}
    moved = {"simplified": scene.simplified} if scene.simplified else {}
    return timed | names | fixes | moved | absent


def _listed_region(outlines: tuple[FloatArray, ...]) -> list[Any]:
    """A region with one outline as that outline, any other as a list of outlines."""
    parts = [outline.tolist() for outline in outlines]
    return parts[0] if len(parts) == 1 else parts


def _region_parts(listed: list[Any]) -> list[Any]:
    """The list of outlines; the inverse of :func:`_listed_region`."""
    return listed if not listed or isinstance(listed[0][0], list) else [listed]


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """The inverse of :func:`scene_to_dict`, exact to the bit; DataError if a key is missing."""
    missing = [key for key in ("bounds", "start", "regions", "obstacles") if key not in data]
    if missing:
        raise DataError(f"scene.json lacks {', '.join(missing)}; was it written by this program?")
    _check_departure("scene.json", data.get("time_zero"))
    return Scene(
        bounds=np.array(data["bounds"], float),
        start=np.array(data["start"], float),
        regions={name: _polygons(_region_parts(listed)) for name, listed in data["regions"].items()},
        obstacles=_polygons(data["obstacles"]),
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=_polygons(data.get("landmarks") or ()),
        border=data.get("border") or "open",
        windows={name: Window.from_dict(window) for name, window in (data.get("windows") or {}).items()},
        forbidden=tuple(data.get("forbidden") or ()),
        simplified=data.get("simplified") or 0.0,
        obstacle_names=tuple(data.get("obstacle_names") or ()),
        landmark_fixes=tuple(
            read_fix("scene.json", f"landmark {number}", fix)
            for number, fix in enumerate(data.get("landmark_fixes") or (), 1)
        ),
        absent=_absent(data),
    )


def _absent(data: Mapping[str, Any]) -> tuple[AbsentPlace, ...]:
    return tuple(map(AbsentPlace.from_dict, data.get("absent") or ()))


def sketch_file(path: Path) -> SceneSketch:
    """The map of a GeoJSON, KML, KMZ or ``scene.json`` file; DataError for any other or a damaged file."""
    if path.suffix.lower() in SUFFIXES:
        faults = MapFaults(f"scene file {path}")
        return sketch_features(faults, kml_features(path, SCENE_FILES, faults), None)
    where, content = f"scene file {path}", read_bounded(path, SCENE_FILES)
    refuse_many_features(where, content, b'"geometry"')
    data = reading.parse_json(content, str(path), SCENE_FILES)
    if isinstance(data, dict) and data.get("type") == "FeatureCollection":
        return sketch_features(MapFaults(where), data.get("features", []), crs_name(where, data.get("crs")))
    if isinstance(data, dict) and "bounds" in data:
        return _sketch_results(path, data)
    raise DataError(
        f"{where} is neither a GeoJSON FeatureCollection nor a run's scene.json; expected one of the two"
    )


def _sketch_results(path: Path, data: Mapping[str, Any]) -> SceneSketch:
    check_document(data, "scene", str(path), SCENE_FILES)
    where = f"scene file {path}"
    faults = MapFaults(where)
    _check_departure(where, data.get("time_zero"))
    landmarks = data.get("landmarks") or ()
    obstacles = sk.numbered_outlines(data.get("obstacles", ()))
    names, fixes = data.get("obstacle_names") or (), data.get("landmark_fixes") or ()
    if names and len(names) != len(obstacles):
        faults.add(f"{where}: {len(names)} obstacle_names for {len(obstacles)} obstacles")
    elif names:
        obstacles = [(name or key, drawn) for (key, drawn), name in zip(obstacles, names, strict=True)]
    if fixes and len(fixes) != len(landmarks):
        faults.add(f"{where}: {len(fixes)} landmark_fixes for {len(landmarks)} landmarks")
    elif fixes:
        landmarks = [{"corners": drawn, "fix": fix} for drawn, fix in zip(landmarks, fixes, strict=True)]
    windows, forbidden = data.get("windows") or {}, data.get("forbidden") or ()
    for name, window in windows.items():
        if (region := window["region"]) not in data["regions"]:
            regions = ", ".join(data["regions"]) or "none"
            faults.add(
                f"{where}: window {shown_text(name)!r} is of {shown_value(region)}; regions are {regions}"
            )
    for name in sorted(set(forbidden) - set(windows)):
        faults.add(f"{where}: forbidden lists {shown_value(name)}, but windows has no such name")
    return SceneSketch(
        where=where,
        bounds=sk.read_bounds(where, "bounds", data["bounds"]),
        start=sk.read_start(where, "start", data.get("start") or []),
        regions=tuple(
            place
            for name, drawn in data["regions"].items()
            for place in (
                sk.read_places(faults, "region", [(name, drawn)], np.copy)
                if drawn
                else [Place(name, sk.called("region", name))]
            )
        ),
        obstacles=sk.read_places(faults, "obstacle", obstacles, np.copy),
        show=lambda point: f"({point[0]:.6g} m, {point[1]:.6g} m)",
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=sk.read_places(faults, "landmark", sk.numbered_outlines(landmarks), np.copy),
        border=data.get("border"),
        timed=tuple(
            TimedPlace(name, w["region"], w.get("begin"), w.get("end"), name in forbidden)
            for name, w in windows.items()
        ),
        simplified=data.get("simplified") or 0.0,
        absent=_absent(data),
        faults=tuple(faults.texts),
    )


def _check_departure(where: str, time_zero: str | None) -> None:
    try:
        datetime.fromisoformat("2000-01-01" if time_zero is None else time_zero)
    except ValueError:
        raise DataError(
            f"{where}: time_zero is {shown_text(repr(time_zero))}; expected an ISO 8601 time such as "
            "2018-10-09T18:00:00Z"
        ) from None


# --- files of a run ----------------------------------------------------------------------------


def write_scene(directory: Path, scene: Scene) -> None:
    """Write ``scene.json``."""
    write_json(directory / "scene.json", scene_to_dict(scene))


def read_scene(place: Path | str) -> Scene:
    """The map of ``scene.json``, a file or the directory that has it."""
    with stored(place, "scene.json", "a scene", "scene") as content:
        scene = scene_from_dict(content)
        refuse_crossings((*scene.region_outlines, *scene.obstacles, *scene.landmarks))
        return scene


def write_cells(directory: Path, decomposition: Decomposition) -> None:
    """Write ``cells.json``."""
    write_json(directory / "cells.json", asdict(decomposition))


def read_cells(place: Path | str) -> Decomposition:
    """The cells of ``cells.json``, a file or the directory that has it."""
    with stored(place, "cells.json", "a decomposition", "cells") as content:
        return Decomposition(
            cells=_polygons(content["cells"]),
            labels=tuple(frozenset(label) for label in content["labels"]),
            doors=np.array(content["doors"], np.int64).reshape(-1, 2),
            obstacles=_polygons(content["obstacles"]),
            regions={name: _polygons(parts) for name, parts in content["regions"].items()},
        )


def _polygons(lists: Sequence[Any]) -> tuple[FloatArray, ...]:
    return tuple(np.array(polygon, float) for polygon in lists)


# --- KML --------------------------------------------------------------------------------------------


def kml_features(path: Path, advice: Advice, faults: MapFaults, role: str = "") -> list[dict[str, Any]]:
    """The Placemarks of a KML or KMZ file as GeoJSON features; others are ``faults``.

    ``role`` is used for Placemarks without a role. DataError if the file is neither KML nor KMZ.
    """
    where = f"scene file {path}"
    data = _kmz_content(path, advice) if path.suffix.lower() == ".kmz" else read_bounded(path, advice)
    refuse_many_features(where, data, rb"</(?:[\w.-]+:)?Placemark\s*>")
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
