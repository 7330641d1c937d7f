"""Scenes in files: a GeoJSON FeatureCollection in degrees, and the ``scene.json`` of a run in metres."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
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

BOUNDS_MARGIN = 0.05  # of the extent of a GeoJSON map without bounds
FEATURE_ROLES = ("region", "obstacle", "start", "bounds", "landmark")
HOLE_ADVICE = "draw it as several features, one outline each"


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """``scene`` as dicts and lists, the content of ``scene.json``."""
    return {
        "bounds": scene.bounds.tolist(),
        "start": scene.start.tolist(),
        "regions": {name: polygon.tolist() for name, polygon in scene.regions.items()},
        "obstacles": [polygon.tolist() for polygon in scene.obstacles],
        "landmarks": [polygon.tolist() for polygon in scene.landmarks],
        "crs": scene.crs,
        "time_zero": scene.time_zero,
    }


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """The inverse of :func:`scene_to_dict`, exact to the bit; DataError if a key is missing."""
    missing = [key for key in ("bounds", "start", "regions", "obstacles") if key not in data]
    if missing:
        raise DataError(f"scene.json lacks {', '.join(missing)}; was it written by this program?")
    return Scene(
        bounds=np.array(data["bounds"], float),
        start=np.array(data["start"], float),
        regions={name: np.array(polygon, float) for name, polygon in data["regions"].items()},
        obstacles=tuple(np.array(polygon, float) for polygon in data["obstacles"]),
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=tuple(np.array(polygon, float) for polygon in data.get("landmarks") or ()),
    )


def sketch_file(path: Path) -> SceneSketch:
    """The map in a GeoJSON file or a ``scene.json``; DataError if it is neither or cannot be read."""
    where = f"scene file {path}"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{where} cannot be read ({error.strerror or error}); check scene.file") from None
    except ValueError as error:
        raise DataError(f"{where} is not JSON ({error}); expected GeoJSON or a run's scene.json") from None
    if isinstance(data, dict) and data.get("type") == "FeatureCollection":
        return _sketch_geojson(where, data.get("features") or [])
    if isinstance(data, dict) and "bounds" in data:
        return _sketch_results(where, data)
    raise DataError(
        f"{where} is neither a GeoJSON FeatureCollection nor a run's scene.json; expected one of the two"
    )


def _sketch_results(where: str, data: Mapping[str, Any]) -> SceneSketch:
    regions, obstacles = data.get("regions") or {}, data.get("obstacles") or []
    if not isinstance(regions, dict) or not isinstance(obstacles, list):
        raise DataError(f"{where}: expected regions as {{name: corners}} and obstacles as a list of corners")
    return SceneSketch(
        where=where,
        bounds=read_bounds(where, "bounds", data["bounds"]),
        start=read_start(where, "start", data.get("start") or []),
        regions=tuple(read_outlines(where, "region", regions.items(), np.copy)),
        obstacles=tuple(read_outlines(where, "obstacle", numbered_outlines(obstacles), np.copy)),
        show=lambda point: f"({point[0]:.6g} m, {point[1]:.6g} m)",
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=tuple(
            read_outlines(where, "landmark", numbered_outlines(data.get("landmarks") or []), np.copy)
        ),
    )


def _sketch_geojson(where: str, features: Sequence[Any]) -> SceneSketch:
    """The map in a plane centred on it; edges between corners are straight lines in this plane."""
    drawn = list(_drawn_features(where, features))
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


def _drawn_features(where: str, features: Sequence[Any]) -> Iterator[tuple[str, str, FloatArray]]:
    """Role, name and corners (n, 2) [deg] of every outline of a GeoJSON FeatureCollection."""
    seen: set[tuple[str, str]] = set()
    counts: dict[str, int] = {}
    for number, feature in enumerate(features, 1):
        properties = (feature.get("properties") or {}) if isinstance(feature, dict) else {}
        role, name = properties.get("role"), properties.get("name")
        if role not in FEATURE_ROLES:
            raise DataError(
                f"{where}: feature {number} has role {role!r}; expected {', '.join(FEATURE_ROLES)}"
            )
        if role == "region" and not name:
            raise DataError(f"{where}: feature {number} is a region; give it the property name")
        many = role in ("obstacle", "landmark")
        counts[role] = counts.get(role, 0) + 1
        what = {"region": f"region {name!r}"}.get(role, f"{role} {name or counts[role]}" if many else role)
        key = (role, str(name) if role == "region" else "")
        if not many and key in seen:
            raise DataError(
                f"{where} has {what} twice; keep one" + (f", or {HOLE_ADVICE}" * (role == "region"))
            )
        seen.add(key)
        for corners in _feature_outlines(where, what, role, feature.get("geometry") or {}):
            yield role, str(name) if role == "region" else what, corners


def _feature_outlines(where: str, what: str, role: str, geometry: Mapping[str, Any]) -> list[FloatArray]:
    """The outlines of one feature; an obstacle with several parts or holes gives several outlines."""
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if role == "start":
        if kind != "Point":
            raise DataError(f"{where}: the start is a {kind}; expected a Point")
        return [read_start(where, "start", list(coordinates or [])[:2])[None]]
    if kind not in ("Polygon", "MultiPolygon") or not coordinates:
        raise DataError(f"{where}: {what} is a {kind}; expected a Polygon")
    polygons = [coordinates] if kind == "Polygon" else list(coordinates)
    try:
        outlines = [[[corner[:2] for corner in ring] for ring in rings] for rings in polygons]
    except TypeError:
        raise DataError(f"{where}: the coordinates of {what} are no {kind} as GeoJSON writes it") from None
    rings = [[read_corners(where, what, ring) for ring in rings] for rings in outlines]
    if role != "obstacle" and (len(rings) != 1 or len(rings[0]) != 1):
        raise DataError(f"{where}: {what} has a hole or several parts; {HOLE_ADVICE}")
    return [part for polygon in rings for part in _without_holes(where, what, polygon)]


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
