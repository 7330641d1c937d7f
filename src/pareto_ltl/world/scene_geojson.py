"""Maps in degrees: features with roles, in the form of GeoJSON (RFC 7946); KML is converted to this form.

The case of property names is ignored, and numbers may be texts, as some programs write them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.reading import shown_json
from pareto_ltl.world import projection
from pareto_ltl.world.scene import read_fix
from pareto_ltl.world.scene_sketch import MapFaults, Place, SceneSketch, called, read_corners, read_start
from pareto_ltl.world.windows import TimedPlace

BOUNDS_MARGIN = 0.05  # margin around a map without a border, as a share of its extent
FEATURE_ROLES = ("region", "obstacle", "start", "border", "landmark")
SYNONYMS = {"bounds": "border"}
LEVELS = {  # of lists in the coordinates of a geometry
    "Point": 1, "MultiPoint": 2, "LineString": 2, "MultiLineString": 3, "Polygon": 3, "MultiPolygon": 4
}  # fmt: skip
MOST_NESTED = 8  # levels of geometry collections
MOST_METRES = 1e7  # largest buffer or altitude
RECTANGULAR = 1e-9  # a border is a rectangle if it lacks at most this share of its bounding box

Drawn = tuple[str, Place]  # role, and the place in degrees


def sketch_features(faults: MapFaults, features: Any, crs_name: str | None) -> SceneSketch:
    """Convert features to a map in a plane centred on it, in which edges between corners are straight lines.

    Coordinates in the system ``crs_name`` are converted to degrees first; None means degrees (WGS 84).
    Features that are not valid are added to ``faults`` and left out; DataError if none is valid.
    """
    where = faults.where
    if not isinstance(features, list):
        raise DataError(f"{where}: /features: expected an array of features, got {shown_json(features)}")
    read = _FeatureReader(where, crs_name)
    found = [feature for _, feature in faults.each(enumerate(features, 1), lambda item: read.drawn(*item))]
    timed = tuple(window for _, _, window in found if window is not None)
    if not found:
        faults.refuse()
        raise DataError(f"{where} has no features; expected a role ({', '.join(FEATURE_ROLES)}) on each")
    drawn = _unwrapped([(role, place) for role, place, _ in found])
    everything = np.concatenate([place.corners for _, place in drawn])
    border = next((place for role, place in drawn if role == "border"), None)
    box = everything if border is None else border.corners
    middle = (box.min(axis=0) + box.max(axis=0)) / 2
    crs = projection.local_plane(float(middle[1]), float(middle[0]))

    def metres(corners: FloatArray) -> FloatArray:
        return projection.to_plane(crs, *corners.T)

    def show(point: FloatArray) -> str:
        lon, lat = projection.to_geographic(crs, point[None])
        return f"(longitude {lon[0]:.6g}, latitude {lat[0]:.6g})"

    def all_of(wanted: str) -> tuple[Place, ...]:
        return tuple(_turned(crs, place).moved(metres) for role, place in drawn if role == wanted)

    starts = all_of("start")
    reach = np.concatenate([_reach(place.moved(metres)) for _, place in drawn])
    bounds = _bounding_box(reach)
    with faults.noted():
        bounds = _bounds_in_plane(where, border, metres, reach)
    return SceneSketch(
        where=where,
        bounds=bounds,
        start=starts[0].lines[0].reshape(-1) if starts else np.zeros(0),
        regions=all_of("region"),
        obstacles=all_of("obstacle"),
        show=show,
        crs=crs,
        landmarks=all_of("landmark"),
        fence=None if border is None or _is_rectangle(border) else border.moved(metres),
        timed=timed,
        faults=tuple(faults.texts),
    )


def _turned(crs: str, place: Place) -> Place:
    """``place`` with the bearing of its fix from the y axis of the plane instead of true north."""
    if place.fix is None or math.isnan(place.fix.bearing):
        return place
    turn = math.degrees(float(projection.meridian_convergence(crs, *place.corners.mean(axis=0)[:, None])[0]))
    return replace(place, fix=place.fix._replace(bearing=place.fix.bearing - turn))


def _bounds_in_plane(
    where: str, border: Place | None, metres: Callable[[FloatArray], FloatArray], reach: FloatArray
) -> FloatArray:
    """Bounds (2, 2) [m]: the box around the border, or around ``reach`` (n, 2) [m] with a margin.

    A rectangular border is moved inwards by its buffer.
    """
    if border is None:
        return _bounding_box(reach, BOUNDS_MARGIN)
    outline = border.polygons[0][0]
    if not _is_rectangle(border):
        return _bounding_box(metres(outline))
    low, high = _bounding_box(metres(_subdivided_outline(outline)))
    bounds = np.stack([low + border.buffer, high - border.buffer])
    if (bounds[0] >= bounds[1]).any():
        raise DataError(f"{where}: nothing is left of the border within its buffer of {border.buffer:g} m")
    return bounds


def _reach(place: Place) -> FloatArray:
    """Corners of ``place`` [m], and points that bound its lines and points with their buffer."""
    aside = [line + side * place.buffer for line in place.lines for side in (-1.0, 1.0)]
    return np.concatenate([place.corners, *aside])


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


# --- features -----------------------------------------------------------------------------------------


@dataclass(slots=True)
class _FeatureReader:
    """Reads features one after another; ``seen`` has the roles and names that may occur once."""

    where: str
    crs_name: str | None
    seen: set[tuple[str, str]] = field(default_factory=set)
    counts: dict[str, int] = field(default_factory=dict)

    def drawn(self, number: int, feature: Any) -> tuple[str, Place, TimedPlace | None]:
        """Role, place [deg] and window of a feature; an obstacle with a window becomes a forbidden region."""
        where = self.where
        properties = {
            str(key).strip().lower(): value
            for key, value in _member(where, number, feature, "properties").items()
        }
        role, name = _role(where, number, properties), properties.get("name")
        if role == "region" and not name:
            raise DataError(f"{where}: feature {number} is a region; give it the property name")
        if not isinstance(name, str | int | None):
            raise DataError(f"{where}: feature {number}: expected a text as name, got {shown_json(name)}")
        self.counts[role] = self.counts.get(role, 0) + 1
        many = role in ("obstacle", "landmark")
        what = called(role, str(name or self.counts[role])) if many or role == "region" else role
        key = (role, str(name) if role == "region" else "")
        if not many and key in self.seen:
            raise DataError(
                f"{where} has {what} twice; keep one"
                + (", or draw both areas as one MultiPolygon" * (role == "region"))
            )
        self.seen.add(key)
        place = Place(str(name) if role == "region" else what, what)
        geometry = _member(where, number, feature, "geometry")
        if role == "start":
            return role, self._in_degrees(replace(place, lines=(_start_point(where, geometry),))), None
        if role == "landmark":
            place = replace(place, fix=read_fix(where, what, properties.get("fix")))
        place = _with_geometry(where, role, _with_numbers(where, place, properties), geometry)
        return _with_times(where, role, number, self._in_degrees(place), properties)

    def _in_degrees(self, place: Place) -> Place:
        name = self.crs_name
        if name is not None:
            place = place.moved(lambda corners: projection.degrees_of(self.where, name, corners))
        corners = place.corners
        bad = (np.abs(corners[:, 1]) > 90) | (np.abs(corners[:, 0]) > 360)
        for x, y in corners[bad][:1]:
            raise DataError(
                f"{self.where}: [{x:.6g}, {y:.6g}] is not [longitude, latitude] in degrees; swap the two?"
            )
        return place


def _with_times(
    where: str, role: str, number: int, place: Place, properties: Mapping[str, Any]
) -> tuple[str, Place, TimedPlace | None]:
    """Role, place and window; an obstacle with a window becomes a region with a new name."""
    begin, end = (None if properties.get(key) in (None, "") else properties[key] for key in ("from", "until"))
    if begin is None and end is None:
        return role, place, None
    if role == "region":
        return role, place, TimedPlace(place.name, place.name, begin, end)
    if role == "obstacle":
        own = re.sub(r"\W+", "_", place.name, flags=re.ASCII).strip("_") + f"_{number}"
        return "region", replace(place, name=own, solid=True), TimedPlace(own, own, begin, end, True)
    raise DataError(
        f"{where}: {place.what} has times, from or until; only regions and obstacles can have them"
    )


def _role(where: str, number: int, properties: Mapping[str, Any]) -> str:
    stated = properties.get("role")
    written = stated.strip().lower() if isinstance(stated, str) else ""
    role = SYNONYMS.get(written, written)
    if role not in FEATURE_ROLES:
        raise DataError(
            f"{where}: feature {number} has role {shown_text(repr(stated))}; "
            f"expected {', '.join(FEATURE_ROLES)}"
        )
    return role


def _member(where: str, number: int, feature: Any, name: str) -> Mapping[str, Any]:
    """The object ``name`` of a feature; empty if it is missing or null."""
    member = feature.get(name) if isinstance(feature, dict) else feature
    if feature is None or not isinstance(member, dict | None):
        raise DataError(
            f"{where}: feature {number}: expected an object {name!r} in an object, got {shown_json(member)}"
        )
    return member or {}


def _with_numbers(where: str, place: Place, properties: Mapping[str, Any]) -> Place:
    """``place`` with its buffer and its altitude band."""
    stated, floor, ceiling, radius = (
        _metres(where, place, key, properties.get(key)) for key in ("buffer", "floor", "ceiling", "radius")
    )
    buffer = (radius if stated is None else stated) or 0.0
    if buffer < 0:
        raise DataError(f"{where}: {place.what}: its buffer is {buffer:g} m; expected 0 or more")
    low, high = -math.inf if floor is None else floor, math.inf if ceiling is None else ceiling
    if low > high:
        raise DataError(f"{where}: {place.what}: its floor, {low:g} m, lies above its ceiling, {high:g} m")
    return replace(place, buffer=buffer, floor=low, ceiling=high)


def _metres(where: str, place: Place, key: str, value: Any) -> float | None:
    """A number of metres, given as a number or text; None if it is missing."""
    if value is None or value == "":
        return None
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) <= MOST_METRES:
        raise DataError(
            f"{where}: {place.what}: {key} is {shown_text(repr(value))}; expected a number of metres"
        )
    return number


# --- geometries ---------------------------------------------------------------------------------------


def _start_point(where: str, geometry: Mapping[str, Any]) -> FloatArray:
    kind, coordinates = shown_text(str(geometry.get("type"))), geometry.get("coordinates")
    if kind != "Point":
        raise DataError(f"{where}: the start is a {kind}; expected a Point")
    place = coordinates[:2] if isinstance(coordinates, list) else coordinates
    return read_start(where, "start", place)[None]


def _with_geometry(where: str, role: str, place: Place, geometry: Mapping[str, Any]) -> Place:
    """``place`` with its polygons, lines and points."""
    polygons: list[tuple[FloatArray, ...]] = []
    lines: list[FloatArray] = []
    for part in _parts(where, place.what, geometry):
        kind, coordinates = str(part.get("type")), part.get("coordinates")
        if kind not in LEVELS:
            raise DataError(f"{where}: {place.what} is a {shown_text(kind)}; expected a Polygon")
        if not kind.endswith("Polygon") and (role == "border" or not place.buffer):
            needs = "" if role == "border" else ", or the property buffer with a number of metres"
            raise DataError(f"{where}: {place.what} is a {kind}; expected a Polygon{needs}")
        if not coordinates or not _are_nested_lists(coordinates, LEVELS[kind]):
            raise DataError(f"{where}: the coordinates of {place.what} are no {kind} as GeoJSON writes it")
        if kind.endswith("Polygon"):
            polygons += _polygons(where, place.what, [coordinates] if kind == "Polygon" else coordinates)
        else:
            lines += _lines(where, place.what, kind, coordinates)
    if role == "border" and (len(polygons) != 1 or len(polygons[0]) != 1):
        raise DataError(
            f"{where}: the border has a hole or several parts; draw one outline, and holes as obstacles"
        )
    if not polygons and not lines:
        raise DataError(f"{where}: {place.what} has no coordinates; expected a Polygon")
    return replace(place, polygons=tuple(polygons), lines=tuple(lines))


def _parts(where: str, what: str, geometry: Mapping[str, Any], depth: int = 0) -> Iterator[Mapping[str, Any]]:
    """The geometries of a collection and of nested collections; any other geometry itself."""
    if geometry.get("type") != "GeometryCollection":
        yield geometry
        return
    inner = geometry.get("geometries")
    if not isinstance(inner, list) or depth > MOST_NESTED or not all(isinstance(g, dict) for g in inner):
        raise DataError(f"{where}: {what} is not a GeometryCollection of GeoJSON")
    for part in inner:
        yield from _parts(where, what, part, depth + 1)


def _polygons(where: str, what: str, polygons: list[Any]) -> list[tuple[FloatArray, ...]]:
    """The rings (n, 2) of each polygon."""
    if not all(polygons):
        raise DataError(f"{where}: the coordinates of {what} are no MultiPolygon as GeoJSON writes it")
    return [
        tuple(read_corners(where, what, [corner[:2] for corner in ring]) for ring in rings)
        for rings in polygons
    ]


def _lines(where: str, what: str, kind: str, coordinates: list[Any]) -> list[FloatArray]:
    """Points as (1, 2), lines as (n, 2)."""
    lines = {"Point": [[coordinates]], "MultiPoint": [[c] for c in coordinates], "LineString": [coordinates]}
    return [
        np.stack([read_start(where, f"a corner of {what}", corner[:2]) for corner in line])
        for line in lines.get(kind, coordinates)
        if line
    ]


def _are_nested_lists(value: Any, levels: int) -> bool:
    """Whether ``value`` is a list of lists of lists ..., with ``levels`` levels or more."""
    return isinstance(value, list) and (
        levels == 1 or all(_are_nested_lists(item, levels - 1) for item in value)
    )


# --- degrees ------------------------------------------------------------------------------------------


def _unwrapped(drawn: list[Drawn]) -> list[Drawn]:
    """``drawn``, with longitudes from 0 to 360 if it crosses the 180th meridian."""
    east = np.concatenate([place.corners[:, 0] for _, place in drawn])
    if np.ptp(east) <= 180:
        return drawn

    def turned(corners: FloatArray) -> FloatArray:
        return np.stack([corners[:, 0] % 360, corners[:, 1]], axis=1)

    return [(role, place.moved(turned)) for role, place in drawn]


def _is_rectangle(border: Place) -> bool:
    """Whether the sides of a border are meridians and parallels."""
    polygon = shapely.Polygon(border.polygons[0][0])
    box = shapely.envelope(polygon).area
    return bool(polygon.area >= (1 - RECTANGULAR) * box)


def _subdivided_outline(corners: FloatArray) -> FloatArray:
    """``corners`` with further points along each edge, since parallels are curved in the plane."""
    steps = np.linspace(0, 1, 33)[:-1, None]
    return np.concatenate(
        [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )


def _bounding_box(points: FloatArray, margin: float = 0.0) -> FloatArray:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.stack([low - margin * (high - low), high + margin * (high - low)])
