"""Scenes in files: a GeoJSON FeatureCollection in degrees, and the ``scene.json`` of a run in metres."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.reading import Advice, read_json_value, shown_json
from pareto_ltl.support.schemas import check_document
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_sketch import (
    SceneSketch,
    numbered_outlines,
    read_bounds,
    read_corners,
    read_outlines,
    read_start,
)
from pareto_ltl.world.windows import TimedPlace, Window

BOUNDS_MARGIN = 0.05  # of the extent of a GeoJSON map without bounds
FEATURE_ROLES = ("region", "obstacle", "start", "bounds", "landmark")
SCENE_FILES = Advice("check scene.file", "correct the map: GeoJSON or a run's scene.json")
HOLE_ADVICE = "draw it as several features, one outline each"


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """``scene`` as dicts and lists, the content of ``scene.json``."""
    return {
        "bounds": scene.bounds.tolist(),
        "start": scene.start.tolist(),
        "regions": {name: polygon.tolist() for name, polygon in scene.regions.items()},
        "obstacles": [polygon.tolist() for polygon in scene.obstacles],
        "landmarks": [polygon.tolist() for polygon in scene.landmarks],
        "border": scene.border,
        "crs": scene.crs,
        "time_zero": scene.time_zero,
    } | _timed(scene)


def _timed(scene: Scene) -> dict[str, Any]:
    """The windows of ``scene``; nothing for a map without any."""
    windows = {name: window.as_dict() for name, window in scene.windows.items()}
    return {"windows": windows, "forbidden": list(scene.forbidden)} if windows else {}


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """The inverse of :func:`scene_to_dict`, exact to the bit; DataError if a key is missing."""
    missing = [key for key in ("bounds", "start", "regions", "obstacles") if key not in data]
    if missing:
        raise DataError(f"scene.json lacks {', '.join(missing)}; was it written by this program?")
    _check_departure("scene.json", data.get("time_zero"))
    return Scene(
        bounds=np.array(data["bounds"], float),
        start=np.array(data["start"], float),
        regions={name: np.array(polygon, float) for name, polygon in data["regions"].items()},
        obstacles=tuple(np.array(polygon, float) for polygon in data["obstacles"]),
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=tuple(np.array(polygon, float) for polygon in data.get("landmarks") or ()),
        border=data.get("border") or "open",
        windows={name: Window.from_dict(window) for name, window in (data.get("windows") or {}).items()},
        forbidden=tuple(data.get("forbidden") or ()),
    )


def sketch_file(path: Path) -> SceneSketch:
    """The map in a GeoJSON file or a ``scene.json``; DataError if it is neither or cannot be read."""
    data = read_json_value(path, SCENE_FILES)
    where = f"scene file {path}"
    if isinstance(data, dict) and data.get("type") == "FeatureCollection":
        return _sketch_geojson(where, data.get("features", []), _crs_name(where, data.get("crs")))
    if isinstance(data, dict) and "bounds" in data:
        return _sketch_results(path, data)
    raise DataError(
        f"{where} is neither a GeoJSON FeatureCollection nor a run's scene.json; expected one of the two"
    )


def _sketch_results(path: Path, data: Mapping[str, Any]) -> SceneSketch:
    check_document(data, "scene", str(path), SCENE_FILES)
    where = f"scene file {path}"
    _check_departure(where, data.get("time_zero"))
    obstacles, landmarks = (numbered_outlines(data.get(key, ())) for key in ("obstacles", "landmarks"))
    return SceneSketch(
        where=where,
        bounds=read_bounds(where, "bounds", data["bounds"]),
        start=read_start(where, "start", data.get("start") or []),
        regions=tuple(read_outlines(where, "region", data["regions"].items(), np.copy)),
        obstacles=tuple(read_outlines(where, "obstacle", obstacles, np.copy)),
        show=lambda point: f"({point[0]:.6g} m, {point[1]:.6g} m)",
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=tuple(read_outlines(where, "landmark", landmarks, np.copy)),
        border=data.get("border"),
        timed=tuple(
            TimedPlace(name, w["region"], w.get("begin"), w.get("end"), name in (data.get("forbidden") or ()))
            for name, w in (data.get("windows") or {}).items()
        ),
    )


def _check_departure(where: str, time_zero: str | None) -> None:
    try:
        datetime.fromisoformat(time_zero or "2000-01-01")
    except ValueError:
        raise DataError(
            f"{where}: time_zero is {shown_text(repr(time_zero))}; expected an ISO 8601 time such as "
            "2018-10-09T18:00:00Z"
        ) from None


def _sketch_geojson(where: str, features: Any, crs_name: str | None) -> SceneSketch:
    """The map in a plane centred on it; edges between corners are straight lines in this plane.

    Coordinates of ``crs_name`` become degrees first; None stands for degrees (WGS 84).
    """
    if not isinstance(features, list):
        raise DataError(f"{where}: /features: expected an array of features, got {shown_json(features)}")
    drawn = list(_drawn_features(where, features))
    if crs_name is not None:
        drawn = [(role, name, projection.degrees_of(where, crs_name, c)) for role, name, c in drawn]
    everything = np.concatenate([corners for _, _, corners in drawn]) if drawn else np.zeros((0, 2))
    if len(everything) == 0:
        raise DataError(f"{where} has no features; expected a role ({', '.join(FEATURE_ROLES)}) on each")
    _check_degrees(where, everything)
    wrap = everything[:, 0].max() - everything[:, 0].min() > 180  # the map crosses the 180th meridian

    def degrees(corners: FloatArray) -> FloatArray:
        return np.stack([corners[:, 0] % 360 if wrap else corners[:, 0], corners[:, 1]], axis=1)

    frame = [c for role, _, c in drawn if role == "bounds"]
    box = degrees(frame[0] if frame else everything)
    middle = (box.min(axis=0) + box.max(axis=0)) / 2
    crs = projection.local_plane(float(middle[1]), float(middle[0]))

    def metres(corners: FloatArray) -> FloatArray:
        lon, lat = degrees(corners).T
        return projection.to_plane(crs, lon, lat)

    def show(point: FloatArray) -> str:
        lon, lat = projection.to_geographic(crs, point[None])
        return f"(longitude {lon[0]:.6g}, latitude {lat[0]:.6g})"

    return SceneSketch(
        where=where,
        bounds=_bounding_box(metres(_subdivided_outline(frame[0])))
        if frame
        else _bounding_box(metres(everything), BOUNDS_MARGIN),
        start=metres(next((c for role, _, c in drawn if role == "start"), np.zeros((0, 2)))).reshape(-1),
        regions=tuple((name, metres(c)) for role, name, c in drawn if role == "region"),
        obstacles=tuple((name, metres(c)) for role, name, c in drawn if role == "obstacle"),
        show=show,
        crs=crs,
        landmarks=tuple((name, metres(c)) for role, name, c in drawn if role == "landmark"),
    )


def _crs_name(where: str, member: Any) -> str | None:
    """The name in the member ``crs``, which GeoJSON had before RFC 7946; None for degrees (WGS 84)."""
    if member is None:
        return None
    name = member.get("properties", {}).get("name") if _is_named_crs(member) else None
    if not isinstance(name, str):
        raise DataError(
            f"{where}: crs is {shown_json(member)}; expected a name such as urn:ogc:def:crs:EPSG::3857, or "
            "no crs for longitude and latitude"
        )
    return None if name.upper().endswith(("CRS84", "EPSG::4326", "EPSG:4326")) else name


def _is_named_crs(member: Any) -> bool:
    return isinstance(member, dict) and isinstance(member.get("properties"), dict)


def _drawn_features(where: str, features: Sequence[Any]) -> Iterator[tuple[str, str, FloatArray]]:
    """Role, name and corners (n, 2) [deg] of every outline of a GeoJSON FeatureCollection."""
    seen: set[tuple[str, str]] = set()
    counts: dict[str, int] = {}
    for number, feature in enumerate(features, 1):
        properties = _member(where, number, feature, "properties")
        role, name = properties.get("role"), properties.get("name")
        if role not in FEATURE_ROLES:
            roles = ", ".join(FEATURE_ROLES)
            raise DataError(f"{where}: feature {number} has role {shown_text(repr(role))}; expected {roles}")
        if role == "region" and not name:
            raise DataError(f"{where}: feature {number} is a region; give it the property name")
        if not isinstance(name, str | int | None):
            raise DataError(f"{where}: feature {number}: expected a text as name, got {shown_json(name)}")
        many = role in ("obstacle", "landmark")
        counts[role] = counts.get(role, 0) + 1
        named = shown_text(str(name or counts[role]))
        what = {"region": f"region {named!r}"}.get(role, f"{role} {named}" if many else role)
        key = (role, str(name) if role == "region" else "")
        if not many and key in seen:
            raise DataError(
                f"{where} has {what} twice; keep one" + (f", or {HOLE_ADVICE}" * (role == "region"))
            )
        seen.add(key)
        for corners in _feature_outlines(where, what, role, _member(where, number, feature, "geometry")):
            yield role, str(name) if role == "region" else what, corners


def _member(where: str, number: int, feature: Any, name: str) -> Mapping[str, Any]:
    """The object ``name`` of a feature; empty where it is missing or null."""
    member = feature.get(name) if isinstance(feature, dict) else feature
    if feature is None or not isinstance(member, dict | None):
        raise DataError(
            f"{where}: feature {number}: expected an object {name!r} in an object, got {shown_json(member)}"
        )
    return member or {}


def _feature_outlines(where: str, what: str, role: str, geometry: Mapping[str, Any]) -> list[FloatArray]:
    """The outlines of one feature; an obstacle with several parts or holes gives several outlines."""
    kind, coordinates = shown_text(str(geometry.get("type"))), geometry.get("coordinates")
    if role == "start":
        if kind != "Point":
            raise DataError(f"{where}: the start is a {kind}; expected a Point")
        place = coordinates[:2] if isinstance(coordinates, list) else coordinates
        return [read_start(where, "start", place)[None]]
    if kind not in ("Polygon", "MultiPolygon") or not coordinates:
        raise DataError(f"{where}: {what} is a {kind}; expected a Polygon")
    polygons: Any = [coordinates] if kind == "Polygon" else coordinates
    if not _are_nested_lists(polygons, 4) or not all(polygons):
        raise DataError(f"{where}: the coordinates of {what} are no {kind} as GeoJSON writes it")
    rings = [
        [read_corners(where, what, [corner[:2] for corner in ring]) for ring in rings] for rings in polygons
    ]
    if role != "obstacle" and (len(rings) != 1 or len(rings[0]) != 1):
        raise DataError(f"{where}: {what} has a hole or several parts; {HOLE_ADVICE}")
    return [part for polygon in rings for part in _without_holes(where, what, polygon)]


def _are_nested_lists(value: Any, levels: int) -> bool:
    """Whether ``value`` is a list of lists of lists ..., with ``levels`` levels or more."""
    return isinstance(value, list) and (
        levels == 1 or all(_are_nested_lists(item, levels - 1) for item in value)
    )


def _without_holes(where: str, what: str, rings: list[FloatArray]) -> list[FloatArray]:
    """A polygon with holes as triangles, since an obstacle may enclose free space."""
    if len(rings) == 1:
        return rings
    import shapely

    polygon = shapely.Polygon(rings[0], rings[1:])
    if not polygon.is_valid:
        raise DataError(f"{where}: {what}: its holes cross its outline or each other; redraw them")
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    return [shapely.get_coordinates(triangle)[:3] for triangle in triangles]


def _check_degrees(where: str, corners: FloatArray) -> None:
    bad = (np.abs(corners[:, 1]) > 90) | (np.abs(corners[:, 0]) > 360)
    if bad.any():
        x, y = corners[bad][0]
        raise DataError(f"{where}: [{x:.6g}, {y:.6g}] is not [longitude, latitude] in degrees; swap the two?")


def _subdivided_outline(corners: FloatArray) -> FloatArray:
    """``corners`` with points along each edge, since parallels are curved in the plane."""
    steps = np.linspace(0, 1, 33)[:-1, None]
    return np.concatenate(
        [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )


def _bounding_box(points: FloatArray, margin: float = 0.0) -> FloatArray:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.stack([low - margin * (high - low), high + margin * (high - low)])


__all__ = ["scene_from_dict", "scene_to_dict", "sketch_file"]
