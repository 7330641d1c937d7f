"""From a map as people draw it to a :class:`Scene`: read, checked, in the metres of one plane.

Three ways in: the ``scene`` settings (coordinates in any unit), a GeoJSON FeatureCollection in
degrees, and the ``scene.json`` of an earlier run. Harmless habits are put right (a repeated closing
corner, a clockwise outline, an obstacle that sticks out of the map); everything else is refused in one
line, in the coordinates of the author.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    import shapely

TOLERANCE = 1e-9  # of the map's size: lengths below are rounding
MARGIN = 0.05  # of the drawing's size, around a GeoJSON map without bounds
ROLES = ("region", "obstacle", "start", "bounds", "landmark")
WORDS = frozenset(  # of the formula language: no names for regions
    ["true", "false", "not", "and", "or", "xor", "next", "eventually", "until", *"XFUMGRW"]
)
HOLE_WAY_OUT = "draw it as several features, one outline each"


@dataclass(frozen=True, slots=True)
class _Sketch:
    """A map before its checks: every outline (n, 2) already in metres, under the name users know it by.

    ``show`` writes a point of the plane in the author's coordinates, ``key`` turns a field into how
    the author spells it, ``where`` opens every message.
    """

    where: str
    bounds: FloatArray
    start: FloatArray
    regions: tuple[tuple[str, FloatArray], ...]
    obstacles: tuple[tuple[str, FloatArray], ...]
    show: Callable[[FloatArray], str]
    crs: str | None = None
    time_zero: str | None = None
    landmarks: tuple[tuple[str, FloatArray], ...] = ()

    @property
    def tolerance(self) -> float:
        return TOLERANCE * float((self.bounds[1] - self.bounds[0]).max())


def read_scene(cfg: SceneConfig, time_zero: str | None = None) -> Scene:
    """The map of ``cfg``, checked, in metres.

    Parameters
    ----------
    cfg : SceneConfig
        With ``file`` set, the file alone says where things are. Otherwise ``x = (coordinate - c) unit``,
        where c is the middle of the bounds if the map has a ``centre`` on Earth, and 0 if it has none.
    time_zero : str or None
        Departure, ISO 8601 UTC; None keeps what the file says.
    """
    sketch = _from_file(Path(cfg.file).expanduser()) if cfg.file else _from_settings(cfg)
    scene = _checked(sketch)
    return replace(scene, time_zero=time_zero) if time_zero else scene


def to_dict(scene: Scene) -> dict[str, Any]:
    """``scene`` as plain containers, the content of ``scene.json``."""
    return {
        "bounds": scene.bounds.tolist(),
        "start": scene.start.tolist(),
        "regions": {name: polygon.tolist() for name, polygon in scene.regions.items()},
        "obstacles": [polygon.tolist() for polygon in scene.obstacles],
        "landmarks": [polygon.tolist() for polygon in scene.landmarks],
        "crs": scene.crs,
        "time_zero": scene.time_zero,
    }


def from_dict(data: Mapping[str, Any]) -> Scene:
    """The scene that :func:`to_dict` wrote, bit by bit."""
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


# --- three ways in --------------------------------------------------------------------------------


def _from_settings(cfg: SceneConfig) -> _Sketch:
    where = f"scene {cfg.name!r}"
    bounds = _bounds(where, "scene.bounds", cfg.bounds)
    middle = bounds.mean(axis=0) if cfg.centre is not None else np.zeros(2)

    def metres(corners: FloatArray) -> FloatArray:
        scaled: FloatArray = (corners - middle) * cfg.unit
        return scaled

    def show(point: FloatArray) -> str:
        x, y = point / cfg.unit + middle
        return f"({x:.6g}, {y:.6g})"

    return _Sketch(
        where=where,
        bounds=metres(bounds),
        start=metres(_start(where, "scene.start", cfg.start)),
        regions=tuple(_outlines(where, "region", cfg.regions.items(), metres)),
        obstacles=tuple(_outlines(where, "obstacle", _numbered(cfg.obstacles), metres)),
        show=show,
        crs=projection.plane(*cfg.centre) if cfg.centre is not None else None,
        landmarks=tuple(_outlines(where, "landmark", _numbered(cfg.landmarks), metres)),
    )


def _from_file(path: Path) -> _Sketch:
    where = f"scene file {path}"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{where} cannot be read ({error.strerror or error}); check scene.file") from None
    except ValueError as error:
        raise DataError(f"{where} is not JSON ({error}); expected GeoJSON or a run's scene.json") from None
    if isinstance(data, dict) and data.get("type") == "FeatureCollection":
        return _from_geojson(where, data.get("features") or [])
    if isinstance(data, dict) and "bounds" in data:
        return _from_results(where, data)
    raise DataError(
        f"{where} is neither a GeoJSON FeatureCollection nor a run's scene.json; expected one of the two"
    )


def _from_results(where: str, data: Mapping[str, Any]) -> _Sketch:
    regions, obstacles = data.get("regions") or {}, data.get("obstacles") or []
    if not isinstance(regions, dict) or not isinstance(obstacles, list):
        raise DataError(f"{where}: expected regions as {{name: corners}} and obstacles as a list of corners")
    return _Sketch(
        where=where,
        bounds=_bounds(where, "bounds", data["bounds"]),
        start=_start(where, "start", data.get("start") or []),
        regions=tuple(_outlines(where, "region", regions.items(), np.copy)),
        obstacles=tuple(_outlines(where, "obstacle", _numbered(obstacles), np.copy)),
        show=lambda point: f"({point[0]:.6g} m, {point[1]:.6g} m)",
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=tuple(_outlines(where, "landmark", _numbered(data.get("landmarks") or []), np.copy)),
    )


def _from_geojson(where: str, features: Sequence[Any]) -> _Sketch:
    """A plane that touches the Earth in the middle of the drawing; straight edges stay straight in it."""
    drawn = list(_features(where, features))
    everything = np.concatenate([corners for _, _, corners in drawn]) if drawn else np.zeros((0, 2))
    if len(everything) == 0:
        raise DataError(f"{where} has no features; expected a role ({', '.join(ROLES)}) on each")
    _check_degrees(where, everything)
    wrap = everything[:, 0].max() - everything[:, 0].min() > 180  # drawn across the 180th meridian

    def degrees(corners: FloatArray) -> FloatArray:
        return np.stack([corners[:, 0] % 360 if wrap else corners[:, 0], corners[:, 1]], axis=1)

    frame = [c for role, _, c in drawn if role == "bounds"]
    box = degrees(frame[0] if frame else everything)
    middle = (box.min(axis=0) + box.max(axis=0)) / 2
    crs = projection.plane(float(middle[1]), float(middle[0]))

    def metres(corners: FloatArray) -> FloatArray:
        lon, lat = degrees(corners).T
        return projection.to_plane(crs, lon, lat)

    def show(point: FloatArray) -> str:
        lon, lat = projection.to_geographic(crs, point[None])
        return f"(longitude {lon[0]:.6g}, latitude {lat[0]:.6g})"

    return _Sketch(
        where=where,
        bounds=_box(metres(_dense(frame[0]))) if frame else _box(metres(everything), MARGIN),
        start=metres(next((c for role, _, c in drawn if role == "start"), np.zeros((0, 2)))).reshape(-1),
        regions=tuple((name, metres(c)) for role, name, c in drawn if role == "region"),
        obstacles=tuple((name, metres(c)) for role, name, c in drawn if role == "obstacle"),
        show=show,
        crs=crs,
        landmarks=tuple((name, metres(c)) for role, name, c in drawn if role == "landmark"),
    )


def _features(where: str, features: Sequence[Any]) -> Iterator[tuple[str, str, FloatArray]]:
    """Role, name and corners (n, 2) [deg] of every outline of a GeoJSON FeatureCollection."""
    seen: set[tuple[str, str]] = set()
    counts: dict[str, int] = {}
    for number, feature in enumerate(features, 1):
        properties = (feature.get("properties") or {}) if isinstance(feature, dict) else {}
        role, name = properties.get("role"), properties.get("name")
        if role not in ROLES:
            raise DataError(f"{where}: feature {number} has role {role!r}; expected {', '.join(ROLES)}")
        if role == "region" and not name:
            raise DataError(f"{where}: feature {number} is a region; give it the property name")
        many = role in ("obstacle", "landmark")
        counts[role] = counts.get(role, 0) + 1
        what = {"region": f"region {name!r}"}.get(role, f"{role} {name or counts[role]}" if many else role)
        key = (role, str(name) if role == "region" else "")
        if not many and key in seen:
            raise DataError(
                f"{where} has {what} twice; keep one" + (f", or {HOLE_WAY_OUT}" * (role == "region"))
            )
        seen.add(key)
        for corners in _geometry(where, what, role, feature.get("geometry") or {}):
            yield role, str(name) if role == "region" else what, corners


def _geometry(where: str, what: str, role: str, geometry: Mapping[str, Any]) -> list[FloatArray]:
    """The outlines of one feature; an obstacle may have several, or holes, and is then cut up."""
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if role == "start":
        if kind != "Point":
            raise DataError(f"{where}: the start is a {kind}; expected a Point")
        return [_start(where, "start", list(coordinates or [])[:2])[None]]
    if kind not in ("Polygon", "MultiPolygon") or not coordinates:
        raise DataError(f"{where}: {what} is a {kind}; expected a Polygon")
    polygons = [coordinates] if kind == "Polygon" else list(coordinates)
    try:
        outlines = [[[corner[:2] for corner in ring] for ring in rings] for rings in polygons]
    except TypeError:
        raise DataError(f"{where}: the coordinates of {what} are no {kind} as GeoJSON writes it") from None
    rings = [[_corners(where, what, ring) for ring in rings] for rings in outlines]
    if role != "obstacle" and (len(rings) != 1 or len(rings[0]) != 1):
        raise DataError(f"{where}: {what} has a hole or several parts; {HOLE_WAY_OUT}")
    return [part for polygon in rings for part in _without_holes(where, what, polygon)]


def _without_holes(where: str, what: str, rings: list[FloatArray]) -> list[FloatArray]:
    """A polygon with holes as triangles (an obstacle may well enclose free space)."""
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


def _dense(corners: FloatArray) -> FloatArray:
    """``corners`` with points along each edge: parallels bulge in the plane, and the box must hold them."""
    steps = np.linspace(0, 1, 33)[:-1, None]
    return np.concatenate(
        [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )


def _box(points: FloatArray, margin: float = 0.0) -> FloatArray:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.stack([low - margin * (high - low), high + margin * (high - low)])


# --- numbers as they were typed -------------------------------------------------------------------


def _bounds(where: str, key: str, value: Any) -> FloatArray:
    """South-west and north-east corner (2, 2), in the author's unit."""
    expected = "expected [[west, south], [east, north]]"
    if value is None or len(value) == 0:
        raise DataError(f"{where} has no bounds; give {key} as [[west, south], [east, north]]")
    bounds = _numbers(value)
    if bounds is None or bounds.shape != (2, 2):
        raise DataError(f"{where}: {key} is {_plain(value)}; {expected}")
    if not np.isfinite(bounds).all():
        raise DataError(f"{where}: {key} {_plain(value)} has a number that is not finite; {expected}")
    (west, south), (east, north) = bounds.tolist()
    if west >= east or south >= north:
        raise DataError(
            f"{where}: {key} {_plain(value)} is turned round or empty; {expected}, west < east, south < north"
        )
    return bounds


def _start(where: str, key: str, value: Any) -> FloatArray:
    if value is None or len(value) == 0:
        raise DataError(f"{where} has no start; give {key} as [x, y]")
    start = _numbers(value)
    if start is None or start.shape != (2,) or not np.isfinite(start).all():
        raise DataError(f"{where}: {key} is {_plain(value)}; expected [x, y], two finite numbers")
    return start


def _numbered(polygons: Sequence[Any]) -> list[tuple[str, Any]]:
    return [(str(number), polygon) for number, polygon in enumerate(polygons, 1)]


def _outlines(
    where: str, kind: str, items: Any, metres: Callable[[FloatArray], FloatArray]
) -> Iterator[tuple[str, FloatArray]]:
    for name, polygon in items:
        what = f"region {name!r}" if kind == "region" else f"{kind} {name}"
        yield str(name) if kind == "region" else what, metres(_corners(where, what, polygon))


def _corners(where: str, what: str, polygon: Any) -> FloatArray:
    """Corners (n, 2) without repetitions, in the author's unit."""
    if not isinstance(polygon, list | tuple | np.ndarray):
        raise DataError(f"{where}: {what} is {polygon!r}; expected a list of corners [[x, y], ...]")
    for number, corner in enumerate(polygon, 1):
        point = _numbers(corner)
        if point is None or point.shape != (2,):
            raise DataError(f"{where}: {what}: corner {number} is {_plain(corner)}; expected [x, y]")
        if not np.isfinite(point).all():
            raise DataError(f"{where}: {what}: corner {number} is {_plain(corner)}; expected finite numbers")
    corners = np.array(polygon, float).reshape(-1, 2)
    corners = corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]
    if len(corners) < 3:
        raise DataError(f"{where}: {what} has {len(corners)} distinct corners; a polygon needs at least 3")
    return corners


def _numbers(value: Any) -> FloatArray | None:
    try:
        return np.array(value, float)
    except (TypeError, ValueError):
        return None


def _plain(value: Any) -> str:
    return str(value.tolist() if isinstance(value, np.ndarray) else value)


# --- checks on the whole map, in metres -----------------------------------------------------------


def _checked(sketch: _Sketch) -> Scene:
    if not sketch.regions:
        raise DataError(f"{sketch.where} has no regions; a mission needs at least one place to visit")
    if len(sketch.start) == 0:
        raise DataError(f"{sketch.where} has no start; add a Point with the property role: start")
    for name, _ in sketch.regions:
        _check_name(sketch, name)
    regions = {name: _sound(sketch, f"region {name!r}", corners) for name, corners in sketch.regions}
    obstacles = [(what, _sound(sketch, what, corners)) for what, corners in sketch.obstacles]
    _check_inside(sketch, "start", sketch.start[None])
    for name, corners in regions.items():
        _check_inside(sketch, f"region {name!r}", corners)
    clipped = [(what, part) for what, corners in obstacles for part in _clip(sketch, corners)]
    _check_start(sketch, clipped)
    _check_overlap(sketch, regions, clipped)
    landmarks = [(what, _sound(sketch, what, corners)) for what, corners in sketch.landmarks]
    _check_landmarks(sketch, landmarks, clipped)
    return Scene(
        bounds=sketch.bounds,
        start=sketch.start,
        regions=regions,
        obstacles=tuple(part for _, part in clipped),
        crs=sketch.crs,
        time_zero=sketch.time_zero,
        landmarks=tuple(corners for _, corners in landmarks),
    )


def _check_landmarks(
    sketch: _Sketch, landmarks: Sequence[tuple[str, FloatArray]], obstacles: Sequence[tuple[str, FloatArray]]
) -> None:
    """A robot must be able to be in all of a landmark: inside the map, convex, clear of obstacles."""
    import shapely

    for what, corners in landmarks:
        _check_inside(sketch, what, corners)
        polygon = shapely.Polygon(corners)
        if shapely.convex_hull(polygon).area > polygon.area + sketch.tolerance * polygon.length:
            raise DataError(f"{sketch.where}: {what} is not convex; split it into convex landmarks")
        for name, outline in obstacles:
            common = shapely.intersection(polygon, shapely.Polygon(outline))
            if common.area > sketch.tolerance * polygon.length:
                at = shapely.get_coordinates(shapely.point_on_surface(common))[0]
                raise DataError(
                    f"{sketch.where}: {what} overlaps {name} at {sketch.show(at)}, where no robot can be; "
                    "move one, or cut the obstacle out of the landmark"
                )


def _check_name(sketch: _Sketch, name: str) -> None:
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        better = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "goal"
        better = better if not better[0].isdigit() else f"r{better}"
        raise DataError(
            f"{sketch.where}: region name {name!r} cannot stand in a formula; use letters, digits and _, "
            f"not a digit first, e.g. {better!r}"
        )
    if name in WORDS:
        raise DataError(
            f"{sketch.where}: region name {name!r} is an operator of the formula language; "
            f"rename it, e.g. {'region_' + name!r}"
        )


def _sound(sketch: _Sketch, what: str, corners: FloatArray) -> FloatArray:
    """``corners`` of a simple polygon with an inside, counter-clockwise."""
    import shapely

    if _thin(corners, sketch.tolerance):
        raise DataError(
            f"{sketch.where}: {what} is degenerate: all its corners lie on one line, from "
            f"{sketch.show(corners[0])} on; give it an inside, or remove it"
        )
    reason = shapely.is_valid_reason(shapely.Polygon(corners))
    if reason != "Valid Geometry":
        spot = re.search(r"\[(\S+) (\S+)\]", reason)
        at = np.array([float(v) for v in spot.groups()]) if spot else corners[0]
        raise DataError(
            f"{sketch.where}: {what} crosses or touches its own outline at {sketch.show(at)}; "
            f"list its corners in order along the outline"
        )
    return corners if shapely.is_ccw(shapely.LinearRing(corners)) else corners[::-1].copy()


def _thin(corners: FloatArray, tolerance: float) -> bool:
    """Whether all corners lie on one line, within ``tolerance`` [m]."""
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= tolerance)


def _check_inside(sketch: _Sketch, what: str, points: FloatArray) -> None:
    (west, south), (east, north) = sketch.bounds.tolist()
    beyond = np.max(
        [west - points[:, 0], points[:, 0] - east, south - points[:, 1], points[:, 1] - north], axis=0
    )
    worst = int(np.argmax(beyond))
    if beyond[worst] > sketch.tolerance:
        low, high = sketch.show(sketch.bounds[0]), sketch.show(sketch.bounds[1])
        raise DataError(
            f"{sketch.where}: {what} lies outside the bounds at {sketch.show(points[worst])}; "
            f"the bounds reach from {low} to {high}: move it, or widen them"
        )


def _clip(sketch: _Sketch, corners: FloatArray) -> list[FloatArray]:
    """The parts of an obstacle within the bounds; untouched where nothing sticks out."""
    low, high = sketch.bounds
    if (corners >= low).all() and (corners <= high).all():
        return [corners]
    import shapely

    box: shapely.Polygon = shapely.box(*low, *high)
    pieces = shapely.get_parts(shapely.intersection(shapely.Polygon(corners), box))
    least = sketch.tolerance * math.sqrt(box.area)
    return [
        np.clip(shapely.get_coordinates(shapely.orient_polygons(piece))[:-1], low, high)
        for piece in pieces
        if piece.geom_type == "Polygon" and piece.area > least
    ]


def _check_start(sketch: _Sketch, obstacles: Sequence[tuple[str, FloatArray]]) -> None:
    import shapely

    start = shapely.Point(sketch.start)
    for what, corners in obstacles:
        polygon = shapely.Polygon(corners)
        if polygon.contains(start) and polygon.exterior.distance(start) > sketch.tolerance:
            raise DataError(
                f"{sketch.where}: the start {sketch.show(sketch.start)} lies inside {what}; move either"
            )


def _check_overlap(
    sketch: _Sketch, regions: Mapping[str, FloatArray], obstacles: Sequence[tuple[str, FloatArray]]
) -> None:
    """Touching is fine: what counts is common area, beyond what rounding makes."""
    import shapely

    names = list(regions)
    places = [shapely.Polygon(corners) for corners in regions.values()]
    tree = shapely.STRtree(places)
    for what, corners in obstacles:
        polygon = shapely.Polygon(corners)
        for hit in sorted(tree.query(polygon, predicate="intersects")):
            common = shapely.intersection(polygon, places[hit])
            if common.area > sketch.tolerance * max(polygon.length, places[hit].length):
                at = shapely.get_coordinates(shapely.point_on_surface(common))[0]
                raise DataError(
                    f"{sketch.where}: {what} overlaps region {names[hit]!r} at {sketch.show(at)}; "
                    f"they may touch, not overlap: cut the obstacle out of the region, or move one"
                )


__all__ = ["from_dict", "read_scene", "to_dict"]
