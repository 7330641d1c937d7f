"""GeoJSON features as places in degrees: their roles, names, lengths, heights, times and geometries.

The case of property names is ignored, and numbers may be texts, as some programs write them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from careful_io.faults import Faults
from careful_io.messages import shown_text, shown_value
from careful_io.projections import refuse_files
from careful_io.reading import shown_json
from flight_quantities.lengths import HIGHEST, LOWEST, height, length_in_metres
from pareto_ltl.extend import Place, TimedPlace, Unread, called, read_corners, read_fix, read_start
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.map_airspace import with_limits
from pareto_ltl_apps.formats.map_edges import straight_in_crs
from pareto_ltl_apps.formats.map_file import MapFile
from pareto_ltl_apps.formats.map_roles import FEATURE_ROLES, LEFT_OUT, SYNONYMS, RoleRules

LEVELS = {  # of lists in the coordinates of a geometry
    "Point": 1, "MultiPoint": 2, "LineString": 2, "MultiLineString": 3, "Polygon": 3, "MultiPolygon": 4
}  # fmt: skip
MAX_NESTED = 8  # levels of geometry collections
SMALLEST_RING = 4  # corners of a closed line with an area

Drawn = tuple[str, Place, TimedPlace | None]  # role, the place in degrees, its window


@dataclass(slots=True)
class FeatureReader:
    """Reads the features of files one after another; ``seen`` has the roles and names that may occur once."""

    rules: RoleRules
    where: str = ""
    file: MapFile | None = None
    unread: Unread = field(default_factory=Unread)
    seen: set[tuple[str, str]] = field(default_factory=set)
    counts: dict[str, int] = field(default_factory=dict)
    assumed: dict[str, int] = field(default_factory=dict)  # obstacles without a role, by kind of airspace
    plain: list[dict[str, Any]] = field(default_factory=list)  # the features with their roles
    total: int = 0

    def read(self, file: MapFile, faults: Faults) -> list[Drawn]:
        """The places of ``file``; others are ``faults``."""
        self.where, self.file = file.where, file
        for text in file.faults:
            faults.add(text)
        self.unread.update(file.unread)
        read = faults.each(enumerate(file.features, 1), lambda item: self._drawn(*item))
        for kind, number in self.assumed.items():
            self.unread.passed[
                f"the roles of {number:,} features: they are airspace ({kind}), and so obstacles; "
                "scene.roles gives others"
            ] += 1
        self.assumed.clear()
        return [drawn for _, drawn in read if drawn is not None]

    def _drawn(self, number: int, feature: Any) -> Drawn | None:
        """Role, place [deg] and window of a feature; an obstacle with a window becomes a forbidden region."""
        where, self.total = self.where, self.total + 1
        what = _title(number, feature)
        _member(where, what, feature, "properties")
        feature = with_limits(where, what, feature)
        properties = {
            str(key).strip().lower(): value for key, value in (feature.get("properties") or {}).items()
        }
        role, name = self._role(what, feature, properties), properties.get("name")
        if role == LEFT_OUT:
            self.unread.passed["a feature with the role none of scene.roles"] += 1
            return None
        if role == "region" and not name:
            raise DataError(f"{where}: {what} is a region; give it the property name")
        if not isinstance(name, str | int | None):
            raise DataError(f"{where}: {what}: expected a text as name, got {shown_json(name)}")
        self.counts[role] = self.counts.get(role, 0) + 1
        many = role in ("obstacle", "landmark")
        what = called(role, str(name or self.counts[role])) if many or role == "region" else role
        self._once(role, name, what)
        place = Place(str(name) if role == "region" else what, what)
        geometry = _member(where, _title(number, feature), feature, "geometry")
        known = {key: value for key, value in properties.items() if key != "radius"} | {"role": role}
        if role == "start":
            self.plain.append({"type": "Feature", "properties": known, "geometry": dict(geometry)})
            return role, self._in_degrees(replace(place, lines=(_start_point(where, geometry),))), None
        if role == "landmark":
            place = replace(place, fix=read_fix(where, what, properties.get("fix")))
        place = self._with_geometry(role, _with_numbers(where, place, properties), geometry)
        known |= {"buffer": place.buffer} if place.buffer else {}
        self.plain.append({"type": "Feature", "properties": known, "geometry": dict(geometry)})
        return _with_times(where, role, self.total, self._in_degrees(place), properties)

    def _once(self, role: str, name: Any, what: str) -> None:
        """Refuse a second start, border, or region of one name."""
        if role in ("obstacle", "landmark"):
            return
        key = (role, str(name) if role == "region" else "")
        if key in self.seen:
            raise DataError(
                f"{self.where} has {what} twice; keep one"
                + (", or draw both areas as one MultiPolygon" * (role == "region"))
            )
        self.seen.add(key)

    def _role(self, what: str, feature: Mapping[str, Any], properties: Mapping[str, Any]) -> str:
        """The role that the feature states, or that ``scene.roles`` gives it; airspace is an obstacle."""
        file = self.file
        assert file is not None
        stated = properties.get("role")
        written = stated.strip().lower() if isinstance(stated, str) else ""
        if written:
            role = SYNONYMS.get(written, written)
            if role in FEATURE_ROLES:
                return role
        elif stated is None or stated == "":
            if role := self.rules.role(Path(file.where).name, properties):
                return role
            if kind := feature.get("airspace") or (file.kind if file.role else ""):
                self.assumed[kind] = self.assumed.get(kind, 0) + 1
                return file.role or "obstacle"
        if file.kind == "KML" and not written:
            raise DataError(f"{self.where}: {what} has no role; {file.hint}")
        raise DataError(
            f"{self.where}: {what} has role {shown_text(repr(stated))}; expected {', '.join(FEATURE_ROLES)}"
            + ("" if written else ", or a role for all features without one in scene.roles")
        )

    def _in_degrees(self, place: Place) -> Place:
        name = self.file.crs if self.file is not None else None
        if name is not None:

            def degrees(corners: FloatArray) -> FloatArray:
                return degrees_of(self.where, name, corners)

            place = replace(
                place,
                polygons=tuple(
                    tuple(straight_in_crs(ring, degrees, True) for ring in rings) for rings in place.polygons
                ),
                lines=tuple(straight_in_crs(line, degrees, False) for line in place.lines),
            )
        corners = place.corners
        bad = (np.abs(corners[:, 1]) > 90) | (np.abs(corners[:, 0]) > 360)
        if not bad.any():
            return place
        if (np.abs(corners) > 360).any():
            raise DataError(
                f"{self.where}: its coordinates are no degrees: if they are metres of a projected system, "
                'name it with the member "crs", {"type": "name", "properties": {"name": "EPSG:32632"}}, or '
                "convert the file to longitude and latitude (ogr2ogr -t_srs EPSG:4326)"
            )
        x, y = corners[bad][0]
        raise DataError(
            f"{self.where}: [{x:.6g}, {y:.6g}] is not [longitude, latitude] in degrees; swap the two?"
        )

    # --- geometries -----------------------------------------------------------------------------------

    def _with_geometry(self, role: str, place: Place, geometry: Mapping[str, Any]) -> Place:
        """``place`` with its polygons, lines and points; closed lines without a buffer are areas."""
        where, what = self.where, place.what
        polygons: list[tuple[FloatArray, ...]] = []
        lines: list[FloatArray] = []
        points: list[FloatArray] = []
        for part in _parts(where, what, geometry):
            kind, coordinates = _coordinates(where, what, part)
            if kind.endswith("Polygon"):
                polygons += _polygons(where, what, [coordinates] if kind == "Polygon" else coordinates)
            elif kind.endswith("Point"):
                points += _lines(where, what, kind, coordinates)
            elif not place.buffer and (closed := _closed_lines(kind, coordinates)):
                polygons += _polygons(where, what, [[line] for line in closed])
                self.unread.passed["that a closed line is no area: it is read as one"] += len(closed)
            else:
                lines += _lines(where, what, kind, coordinates)
        if points and not place.buffer and polygons and not lines and role != "border":
            self._note_labels(what, polygons, points)
            points = []
        lines = [*points, *lines]
        if lines and (role == "border" or not place.buffer):
            kind = "Point" if points else "LineString"
            needs = "" if role == "border" else ", or the property buffer with a number of metres"
            raise DataError(f"{where}: {what} is a {kind}; expected a Polygon{needs}")
        if role == "border" and (len(polygons) != 1 or len(polygons[0]) != 1):
            raise DataError(
                f"{where}: the border has a hole or several parts; draw one outline, and holes as obstacles"
            )
        if not polygons and not lines:
            raise DataError(f"{where}: {what} has no coordinates; expected a Polygon")
        return replace(place, polygons=tuple(polygons), lines=tuple(lines))

    def _note_labels(
        self, what: str, polygons: list[tuple[FloatArray, ...]], points: list[FloatArray]
    ) -> None:
        """Add points beside areas to what is not read: labels inside, elsewhere possible obstacles."""
        for point in points:
            inside = any(
                shapely.Polygon(rings[0]).buffer(0).covers(shapely.Point(point[0])) for rings in polygons
            )
            if inside:
                self.unread.passed[f"a label point in {what}"] += 1
            else:
                self.unread.lost[f"a point outside of {what}: a tower needs the property buffer"] += 1


def degrees_of(where: str, crs: str, points: FloatArray) -> FloatArray:
    """Longitude and latitude (N, 2) [deg] of ``points`` (N, 2) in the system ``crs``, e.g. ``EPSG:3857``.

    The order of the axes is east, north (or longitude, latitude), also if ``crs`` defines another order.

    Raises
    ------
    DataError
        If the system is unknown or a point lies outside of it; ``where`` begins the message.
    """
    import pyproj

    refuse_files(crs)
    try:
        change = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError:
        raise DataError(
            f"{where}: PROJ does not know the crs {shown_value(crs)}; convert the map to "
            "longitude and latitude and leave crs out"
        ) from None
    lonlat = np.column_stack(change.transform(points[:, 0], points[:, 1]))
    if not np.isfinite(lonlat).all():
        x, y = points[~np.isfinite(lonlat).all(axis=1)][0]
        raise DataError(
            f"{where}: ({x:.6g}, {y:.6g}) lies outside of crs {shown_value(crs)}; check the units"
        )
    return lonlat


def in_degrees(feature: Mapping[str, Any], file: MapFile) -> dict[str, Any]:
    """A checked GeoJSON feature of ``file`` with longitudes and latitudes as coordinates."""
    name = file.crs
    assert name is not None

    def moved(value: Any) -> Any:
        if isinstance(value, dict):
            return {
                key: moved(one) if key in ("coordinates", "geometries") else one for key, one in value.items()
            }
        if value and isinstance(value[0], list | dict):
            return [moved(one) for one in value]
        return degrees_of(file.where, name, np.array([value[:2]], float))[0].tolist()

    return {**feature, "geometry": moved(feature["geometry"])}


def _title(number: int, feature: Any) -> str:
    title = feature.get("title") if isinstance(feature, dict) else None
    return title if isinstance(title, str) and title.startswith("Placemark ") else f"feature {number}"


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


def _member(where: str, what: str, feature: Any, name: str) -> Mapping[str, Any]:
    """The object ``name`` of a feature; empty if it is missing or null."""
    member = feature.get(name) if isinstance(feature, dict) else feature
    if feature is None or not isinstance(member, dict | None):
        raise DataError(
            f"{where}: {what}: expected an object {name!r} in an object, got {shown_json(member)}"
        )
    return member or {}


def _with_numbers(where: str, place: Place, properties: Mapping[str, Any]) -> Place:
    """``place`` with its buffer and its heights."""
    begin = f"{where}: {place.what}"
    stated, radius = (
        length_in_metres(f"{begin}: {key}", properties.get(key)) for key in ("buffer", "radius")
    )
    buffer = (radius if stated is None else stated) or 0.0
    if buffer < 0:
        raise DataError(f"{begin}: its buffer is {buffer:g} m; expected 0 or more")
    floor = height(f"{begin}: floor", properties.get("floor")) or LOWEST
    ceiling = height(f"{begin}: ceiling", properties.get("ceiling")) or HIGHEST
    if floor == (0.0, "AGL"):
        floor = LOWEST  # the ground is the lowest place wherever it is
    if floor.metres > ceiling.metres and floor.datum == ceiling.datum:
        raise DataError(
            f"{begin}: its floor, {floor.metres:g} m, lies above its ceiling, {ceiling.metres:g} m"
        )
    return replace(place, buffer=buffer, floor=floor, ceiling=ceiling)


def _start_point(where: str, geometry: Mapping[str, Any]) -> FloatArray:
    kind, coordinates = shown_text(str(geometry.get("type"))), geometry.get("coordinates")
    if kind != "Point":
        raise DataError(f"{where}: the start is a {kind}; expected a Point")
    place = coordinates[:2] if isinstance(coordinates, list) else coordinates
    return read_start(where, "start", place)[None]


def _coordinates(where: str, what: str, part: Mapping[str, Any]) -> tuple[str, list[Any]]:
    """Kind and coordinates of a geometry; DataError if they do not belong together."""
    kind, coordinates = str(part.get("type")), part.get("coordinates")
    if kind not in LEVELS:
        raise DataError(f"{where}: {what} is a {shown_text(kind)}; expected a Polygon")
    if not coordinates or not _are_nested_lists(coordinates, LEVELS[kind]):
        raise DataError(f"{where}: the coordinates of {what} are no {kind} as GeoJSON writes it")
    assert isinstance(coordinates, list)
    return kind, coordinates


def _closed_lines(kind: str, coordinates: list[Any]) -> list[Any]:
    """The lines of a geometry if all of them return to their first corner; else none."""
    lines = [coordinates] if kind == "LineString" else coordinates
    closed = all(len(line) >= SMALLEST_RING and line[0][:2] == line[-1][:2] for line in lines)
    return lines if closed else []


def _parts(where: str, what: str, geometry: Mapping[str, Any], depth: int = 0) -> Iterator[Mapping[str, Any]]:
    """The geometries of a collection and of nested collections; any other geometry itself."""
    if geometry.get("type") != "GeometryCollection":
        yield geometry
        return
    inner = geometry.get("geometries")
    if not isinstance(inner, list) or depth > MAX_NESTED or not all(isinstance(g, dict) for g in inner):
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
