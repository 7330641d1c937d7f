"""``plan.geojson`` and ``corridor.geojson`` (RFC 7946), and ``operational_intent.json``.

The last one has volumes in time as ASTM F3548-21 has them in OperationalIntentDetails. Each leg is a
Volume4D: the hull of the ellipses at both ends, of the size that 95 % of whole flights stay in, and all
places within :data:`LATERAL_FLOOR` of the leg.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from careful_io.files import plain_data
from pareto_ltl import Scene
from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.exports.branches import dividing_lines, reach_of
from pareto_ltl_apps.exports.corridor import Corridor
from pareto_ltl_apps.exports.degrees import line_parts, polygon_parts, united_rings
from pareto_ltl_apps.exports.exported import ExportedPlan

Feature = dict[str, Any]


def plan_geojson(exported: ExportedPlan) -> bytes:
    """The route, each leg, each expected position, and the map with the roles that ``scene.file`` reads."""
    log, path = exported.log, exported.plan.path
    route = {"role": "route", "name": exported.name, "formula": exported.plan.formula, "order": path.order}
    features = [_line(exported.crs, log.x, route | {"length_m": path.objectives.length})]
    features += [_line(exported.crs, log.x[k : k + 2], _leg(exported, k)) for k in range(len(log.airspeed))]
    features += [_position(exported, k) for k in range(len(log.t))]
    features += _branch_features(exported)
    return _collection(features + _map_features(exported), exported)


def corridor_geojson(exported: ExportedPlan) -> bytes:
    """For each share: one ellipse for each step (``meaning`` at_time), then one area for whole flights."""
    corridor, crs = exported.corridor, exported.crs
    tubes = [
        _polygon(tube_rings(crs, corridor, size), _about(corridor, "whole_flight", share, size))
        for share, size in zip(corridor.shares, corridor.whole, strict=True)
    ]
    return _collection([*_ellipses(exported, corridor), *tubes], exported)


# --- features ---------------------------------------------------------------------------------


def _leg(exported: ExportedPlan, k: int) -> dict[str, Any]:
    log = exported.log
    about = {"role": "leg", "leg": k, "time_utc": log.time_utc(k), "t_s": log.t[k], "duration_s": None}
    return about | log.leg(k) | {"wind_law": log.law}


def _position(exported: ExportedPlan, k: int) -> Feature:
    log = exported.log
    about = {"role": "position", "step": k, "time_utc": log.time_utc(k), "t_s": log.t[k], **log.spread(k)}
    about |= {"regions": exported.plan.path.label[k], "fix": k in log.fixes, "wind_law": log.law}
    return feature("Point", Frame(exported.crs).lonlat(log.x[k]), about)


def _branch_features(exported: ExportedPlan) -> list[Feature]:
    """The route of each branch, and the lines between the cells of each fix."""
    crs, found = exported.crs, []
    for one in exported.branches:
        about = {
            "role": "branch", "name": one.name, "where": one.branch.cell.words, "share": one.branch.share,
            "order": one.branch.path.order, "t_s": one.log.t[0], "time_utc": one.log.time_utc(0),
        }  # fmt: skip
        found.append(_line(crs, one.log.x, about))
    for tree, plan in exported.questions():
        for what, ends in dividing_lines(tree, reach_of(tree, plan)):
            found.append(_line(crs, ends, {"role": "branch line", "name": what}))
    return found


def _map_features(exported: ExportedPlan) -> list[Feature]:
    scene, crs = exported.scene, exported.crs
    fixes = {f"landmark {n}": true_fix(scene, n) for n in range(1, len(scene.landmark_fixes) + 1)}
    drawn = [
        _area(
            crs, outlines, {"role": role, "name": name} | (fixes.get(name, {}) if role == "landmark" else {})
        )
        for role, name, outlines in named_outlines(scene)
    ]
    return [*drawn, feature("Point", Frame(crs).lonlat(scene.start), {"role": "start", "name": "start"})]


def named_outlines(scene: Scene) -> list[tuple[str, str, Sequence[FloatArray]]]:
    """Role, title and outlines, each (n, 2) [m], of all areas of the map; its border is ``bounds``."""
    return [
        *(("region", name, outlines) for name, outlines in scene.regions.items()),
        *((role, title, (corners,)) for role, title, corners in titled_outlines(scene)),
    ]


def true_fix(scene: Scene, number: int) -> dict[str, Any]:
    """The property ``fix`` of a landmark, with its bearing from true north; none with robot.fix_sd."""
    fix = scene.landmark_fixes[number - 1]
    if fix is None or math.isnan(fix.bearing):
        return {} if fix is None else {"fix": fix.document}
    middle = scene.landmarks[number - 1].mean(axis=0)
    turn = math.degrees(float(scene.frame.north(middle)[0]))
    return {"fix": fix._replace(bearing=(fix.bearing + turn) % 360.0).document}


def titled_outlines(scene: Scene) -> list[tuple[str, str, FloatArray]]:
    """Role, title and corners (n, 2) [m] of obstacles, landmarks and the border (role ``bounds``)."""
    return [
        *(("obstacle", scene.obstacle_title(n), corners) for n, corners in enumerate(scene.obstacles, 1)),
        *(("landmark", f"landmark {n}", corners) for n, corners in enumerate(scene.landmarks, 1)),
        ("bounds", f"border ({scene.border})", border_corners(scene.bounds)),
    ]


def border_corners(bounds: FloatArray) -> FloatArray:
    """Corners (4, 2) [m] of the map, counter-clockwise."""
    (west, south), (east, north) = bounds
    return np.array([[west, south], [east, south], [east, north], [west, north]])


def _ellipses(exported: ExportedPlan, corridor: Corridor) -> Iterable[Feature]:
    log, outlines = exported.log, Frame(exported.crs).lonlat(corridor.outlines(corridor.at_time))
    for level, share in enumerate(corridor.shares):
        for k, outline in enumerate(outlines[level]):
            about = _about(corridor, "at_time", share, corridor.at_time[level, k])
            about |= {"step": k, "time_utc": log.time_utc(k), "t_s": log.t[k]}
            yield _polygon([np.concatenate([outline, outline[:1]])], about)


def tube_rings(crs: str, corridor: Corridor, size: float) -> list[FloatArray]:
    """The area of all ellipses of ``size`` and of the legs between them: outline, then holes [deg]."""
    import shapely

    outlines = corridor.outlines(np.full(len(corridor.mean), size))
    tube: Any = shapely.orient_polygons(shapely.union_all(leg_hulls(outlines)))  # one part: legs are a chain
    return [
        Frame(crs).outline_degrees(shapely.get_coordinates(ring)[:-1])
        for ring in (tube.exterior, *tube.interiors)
    ]


def leg_hulls(outlines: FloatArray) -> Any:
    """Convex hulls, shapely polygons (T,), of the ``outlines`` (T+1, n, 2) at both ends of each leg."""
    import shapely

    ends = np.concatenate([outlines[:-1], outlines[1:]], axis=1) if len(outlines) > 1 else outlines
    return shapely.convex_hull(shapely.linestrings(ends))  # a line through their corners is made at once


def _about(corridor: Corridor, meaning: str, share: float, size: float) -> dict[str, Any]:
    return {
        "role": "corridor", "meaning": meaning, "probability": share, "wind_law": corridor.law,
        "flights": corridor.runs, "standard_deviations": size,
    }  # fmt: skip


# --- GeoJSON ----------------------------------------------------------------------------------


def _line(crs: str, points: FloatArray, about: Mapping[str, Any]) -> Feature:
    return _one_or_several("LineString", line_parts(Frame(crs).line_degrees(points)), about)


def _polygon(rings: Sequence[FloatArray], about: Mapping[str, Any]) -> Feature:
    return _one_or_several("Polygon", polygon_parts(rings), about)


def _area(crs: str, outlines: Sequence[FloatArray], about: Mapping[str, Any]) -> Feature:
    """The area of ``outlines``, each (n, 2) [m], which may touch."""
    polygons = [[Frame(crs).outline_degrees(ring) for ring in rings] for rings in united_rings(outlines)]
    return _one_or_several("Polygon", [part for rings in polygons for part in polygon_parts(rings)], about)


def _one_or_several(kind: str, parts: Sequence[Any], about: Mapping[str, Any]) -> Feature:
    return feature(kind, parts[0], about) if len(parts) == 1 else feature(f"Multi{kind}", parts, about)


def feature(kind: str, coordinates: Any, about: Mapping[str, Any]) -> Feature:
    """A feature of a ``kind``; ``coordinates``: arrays (..., 2) [deg], in lists where there are several."""
    return {
        "type": "Feature",
        "properties": plain_data(about),
        "geometry": {"type": kind, "coordinates": _plain_coordinates(coordinates)},
    }


def _plain_coordinates(nested: Any) -> Any:
    """Arrays as lists; all numbers are finite and are not checked."""
    return [_plain_coordinates(part) for part in nested] if isinstance(nested, list) else nested.tolist()


def _collection(features: list[Feature], exported: ExportedPlan) -> bytes:
    """The collection of ``features``; its description states the failure rates of the plan."""
    head = {"type": "FeatureCollection", "name": exported.name, "description": " ".join(exported.sentences())}
    return listed_json(head, "features", features)


def listed_json(head: Mapping[str, Any], key: str, entries: Iterable[Any]) -> bytes:
    """An object of the keys of ``head``, one on each line, and of the list ``entries`` as ``key``."""
    pairs = ((json.dumps(name), json.dumps(value, allow_nan=False)) for name, value in head.items())
    reported = "".join(f" {name}: {value},\n" for name, value in pairs)
    lines = ",\n".join(f"  {json.dumps(entry, allow_nan=False)}" for entry in entries)
    return f"{{\n{reported} {json.dumps(key)}: [\n{lines}\n ]\n}}\n".encode()


# --- operational intent -------------------------------------------------------------------------

LATERAL_FLOOR = 10.0  # [m] least distance from the expected path to the edge: navigation errors in calm air
SHARE = 0.95  # of whole flights that stay in the volumes


def operational_intent(exported: ExportedPlan) -> bytes:
    """The file; raises ConfigError if the heights are not set."""
    import shapely

    if exported.band is None:
        raise ConfigError(
            "f3548 needs heights above the WGS 84 ellipsoid; set exports.altitude_lower and "
            "exports.altitude_upper"
        )
    corridor, log = exported.corridor, exported.log
    assert log.utc is not None
    size = corridor.whole[corridor.level(SHARE)]
    hulls = leg_hulls(corridor.outlines(np.full(len(corridor.mean), size)))
    lower, upper = ({"value": h, "reference": "W84", "units": "M"} for h in exported.band)
    volumes = []  # a plan without a step has a hull and no leg
    for hull, ends, times in zip(hulls, pairwise(corridor.mean), pairwise(log.utc), strict=False):
        area = hull.union(shapely.LineString(ends).buffer(LATERAL_FLOOR)).convex_hull
        corners = Frame(exported.crs).lonlat(shapely.get_coordinates(area)[:-1]).tolist()
        outline = {"vertices": [{"lng": lon, "lat": lat} for lon, lat in corners]}
        start, end = ({"value": time, "format": "RFC3339"} for time in times)
        volume = {"outline_polygon": outline, "altitude_lower": lower, "altitude_upper": upper}
        volumes.append({"volume": volume, "time_start": start, "time_end": end})
    note = f"{SHARE * 100:g} % of whole flights in {exported.law_words} stay in these volumes. "
    head = {"pareto_ltl": {"note": note + " ".join(exported.sentences())}, "priority": 0}
    return listed_json(head | {"off_nominal_volumes": []}, "volumes", plain_data(volumes))
