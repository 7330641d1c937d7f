"""Claims about every drawn line and area: exported maps, routes and corridors agree with map and plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from careful_io.names import joined_names
from pareto_ltl_verify.areas import TOLERANCE, drawn_fault, line_fault, ring_fault, rings_of
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, unlike
from pareto_ltl_verify.claims.exports import KML, PLAN, TABLE, Rows, column, lonlat, xml_root
from pareto_ltl_verify.evidence import Evidence, all_branches, all_trees
from pareto_ltl_verify.geometry import azimuths, in_plane

SAG = 0.5  # [m] by which drawn lines may leave straight lines of the plane
CORNERS = 36  # of the polygon around an ellipse
FINEST = 1.0  # [m] standard deviation whose square corridors add to each variance of the position
TUBE = 0.95  # share of whole flights in the area of plan.kml
BEARING = 0.01  # [deg] largest allowed difference of two bearings
TAGS = frozenset({
    "kml", "Document", "name", "description", "Style", "LineStyle", "PolyStyle", "color", "width",
    "Placemark",
    "styleUrl", "LineString", "altitudeMode", "coordinates", "Folder", "TimeStamp", "when", "ExtendedData",
    "Data", "value", "Point", "Polygon", "MultiGeometry", "tessellate", "outerBoundaryIs", "innerBoundaryIs",
    "LinearRing",
})  # fmt: skip


class Area(NamedTuple):
    """An area of the map: its role, its title and its outlines, each (n, 2) [m]."""

    role: str
    title: str
    outlines: list[FloatArray]


def outlines_of(listed: Any) -> list[FloatArray]:
    """The outlines of a region of scene.json; a single outline is written as its corners."""
    several = bool(listed) and isinstance(listed[0][0], list | tuple)
    return [np.array(part, float) for part in (listed if several else [listed] if listed else [])]


def map_areas(result: Evidence) -> list[Area]:
    """The areas of scene.json in the order in which files draw them: the border is the last."""
    scene = result.scene
    names = scene.get("obstacle_names") or [""] * len(scene["obstacles"])
    (west, south), (east, north) = scene["bounds"]
    around = np.array([(west, south), (east, south), (east, north), (west, north)], float)
    return [
        *(Area("region", name, outlines_of(listed)) for name, listed in scene["regions"].items()),
        *(
            Area("obstacle", f"obstacle {k}" + (f" ({name})" if name else ""), [np.array(corners, float)])
            for k, (corners, name) in enumerate(zip(scene["obstacles"], names, strict=True), 1)
        ),
        *(
            Area("landmark", f"landmark {k}", [np.array(corners, float)])
            for k, corners in enumerate(scene.get("landmarks") or [], 1)
        ),
        Area("bounds", f"border ({scene['border']})", [around]),
    ]


def flown_places(result: Evidence) -> FloatArray:
    """Places (T+1, 2) [m] of the steps in exported files: turns of an aircraft that banks move them."""
    if result.robot.bank > 0.0 and result.has(TABLE):
        return in_plane(result.scene["crs"], lonlat(result.table(TABLE)))
    return result.x


# --- plan.geojson ---------------------------------------------------------------------------------


def geojson(result: Evidence) -> Verdict:
    """Route, legs, positions and areas of the map: their number, order, names, places and numbers."""
    features, strange = _features(result, "plan.geojson")
    legs, areas = len(result.u), map_areas(result)
    roles = ["route", *["leg"] * legs, *["position"] * (legs + 1), *(area.role for area in areas), "start"]
    own = [one for one in features if one["properties"]["role"] in BRANCH_ROLES]
    others = [one for one in features if one["properties"]["role"] not in BRANCH_ROLES]
    if [feature["properties"]["role"] for feature in others] != roles:
        return no_fault(f"{len(features)} shapes", [f"{len(roles)} shapes are expected"])
    route, *rest = others
    drawn, start = rest[2 * legs + 1 : -1], rest[-1]
    return no_fault(
        f"{len(features)} shapes",
        strange,
        _route_faults(result, route),
        _branch_faults(
            result,
            [
                (one["properties"]["role"], one["properties"], _line(result.scene["crs"], one["geometry"]))
                for one in own
            ],
        ),
        _leg_faults(result, rest[:legs]),
        _position_faults(result, rest[legs : 2 * legs + 1]),
        (
            fault
            for area, shape in zip(areas, drawn, strict=True)
            for fault in _area_faults(result, area, shape)
        ),
        _point_fault(result, "start", start, result.start),
    )


def _features(result: Evidence, name: str) -> tuple[list[dict[str, Any]], list[str]]:
    """The features of a GeoJSON file, and faults of its types and its name."""
    content = result.document(name)
    faults = unlike(content, {"type": "FeatureCollection", "name": result.settings["name"]})
    strange = [k for k, one in enumerate(content["features"]) if one["type"] != "Feature"]
    return content["features"], faults + [f"feature {k} is none" for k in strange]


def _line(crs: str, geometry: Mapping[str, Any]) -> FloatArray:
    """The places [m] of a line, or of its pieces one after another."""
    parts = {"LineString": [geometry["coordinates"]], "MultiLineString": geometry["coordinates"]}
    return in_plane(crs, np.concatenate([np.array(part, float)[:, :2] for part in parts[geometry["type"]]]))


def _route_faults(result: Evidence, route: Mapping[str, Any]) -> list[str]:
    about, x = route["properties"], flown_places(result)
    fault = line_fault(_line(result.scene["crs"], route["geometry"]), x)
    wanted = {"formula": result.plan["formula"], "name": result.settings["name"]}
    faults = unlike(about, wanted) + [f"route: {fault}"] * bool(fault)
    faults += [f"order {about['order']}"] * (about["order"] not in result.orders(result.x))
    length = result.plan["objectives"]["length"]
    return faults + [f"length {about['length_m']}"] * (not close(about["length_m"], length, 1e-9))


BRANCH_ROLES = ("branch", "branch line")
ON_LINE = 1e-3  # share of the length of a line between cells by which its ends may lie beside it


def _branch_faults(
    result: Evidence, drawn: Sequence[tuple[str, Mapping[str, Any], FloatArray]]
) -> Iterator[str]:
    """Faults of the routes of branches, and of the lines between cells, each with role and numbers."""
    tree = result.plan.get("branches")
    if tree is None:
        yield from (f"a {role} of a plan without branches" for role, _, _ in drawn)
        return
    rows = list(all_branches(tree))
    routes = [one for one in drawn if one[0] == "branch"]
    lines = [x for role, _, x in drawn if role == "branch line"]
    divided = any(len(one["branches"]) > 1 for one in all_trees(tree))
    if len(routes) != len(rows) or divided != bool(lines):
        yield f"{len(routes)} branches and {len(lines)} lines between cells"
        return
    for row, (_, about, x) in zip(rows, routes, strict=True):
        table = f"branch_{row['name']}.csv"
        turned = result.robot.bank > 0.0 and result.has(table)
        flown = in_plane(result.scene["crs"], lonlat(result.table(table))) if turned else np.array(row["x"])
        fault = line_fault(x, flown)
        yield from [f"branch {row['name']}: {fault}"] * bool(fault)
        wanted = {"name": row["name"], "where": row["where"]}
        yield from (f"branch {row['name']}: {one}" for one in unlike(about, wanted))
    for x in lines:
        on = any(_divides(one, x) for one in all_trees(tree))
        yield from ["a line that divides no cells"] * (not on)


def _divides(tree: Mapping[str, Any], x: FloatArray) -> bool:
    """Whether the line with the ends ``x`` (2, 2) [m] lies between cells of a fix."""
    (east, north), place = tree["fix"]["ahead"], np.array(tree["fix"]["place"])
    y = (x - place) @ np.array([[east, north], [-north, east]]).T
    slack = ON_LINE * float(np.ptp(y, axis=0).max()) + 1.0
    rows = tree["branches"]
    ends = [[end for row in rows for end in row[key] if end is not None] for key in ("along", "left")]
    return any(np.abs(y[:, i] - end).max() <= slack for i in (0, 1) for end in ends[i])


def _leg_faults(result: Evidence, legs: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    x, rows = flown_places(result), _rows(result)
    for k, leg in enumerate(legs):
        fault = line_fault(_line(result.scene["crs"], leg["geometry"]), x[k : k + 2])
        if fault:
            yield f"leg {k}: {fault}"
        wanted: dict[str, Any] = {"leg": k, "wind_law": result.planned_law}
        yield from (f"leg {k}: {one}" for one in unlike(leg["properties"], wanted))
        yield from (f"leg {k}: {key}" for key in _unlike_row(leg["properties"], rows[k] if rows else {}))


def _position_faults(result: Evidence, positions: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    x, rows, plan = flown_places(result), _rows(result), result.plan
    for k, one in enumerate(positions):
        about = one["properties"]
        wanted = {"step": k, "wind_law": result.planned_law, "fix": k in plan["fixes"]}
        yield from (f"step {k}: {fault}" for fault in unlike(about, wanted))
        if set(about["regions"]) != set(plan["label"][k]):
            yield f"step {k}: regions {about['regions']}"
        yield from _point_fault(result, f"step {k}", one, x[k])
        row = rows[k] if rows else {}
        yield from (
            f"step {k}: {key}" for key in _unlike_row(about, {key: row[key] for key in row if key != "fix"})
        )


def _rows(result: Evidence) -> Rows:
    return result.table(TABLE) if result.has(TABLE) else []


def _unlike_row(about: Mapping[str, Any], row: Mapping[str, str]) -> Iterator[str]:
    """The properties that differ from the column of the same name of the table of dead reckoning."""
    for key in row.keys() & about.keys() - {"leg", "wind_law", "fix"}:
        stated, text = about[key], row[key]
        if key == "time_utc" or stated is None or not text:
            same = (stated or "") == text
        else:
            same = close(float(stated), float(text), 1e-9, 1e-9)
        if not same:
            yield f"{key} {stated}"


def _point_fault(result: Evidence, name: str, shape: Mapping[str, Any], place: FloatArray) -> list[str]:
    if shape["geometry"]["type"] != "Point":
        return [f"{name} is no point"]
    drawn = in_plane(result.scene["crs"], np.array([shape["geometry"]["coordinates"][:2]], float))[0]
    off = math.dist(drawn, place)
    return [f"{name}: {off:.3g} m off"] * (not off <= TOLERANCE)


def _area_faults(result: Evidence, area: Area, shape: Mapping[str, Any]) -> Iterator[str]:
    about, crs = shape["properties"], result.scene["crs"]
    if about["name"] != area.title:
        yield f"{area.title} is called {about['name']}"
    fault = drawn_fault(crs, rings_of(shape["geometry"]), area.outlines, SAG)
    if fault:
        yield f"{area.title}: {fault}"
    if area.role == "landmark":
        yield from _fix_faults(result, area, about.get("fix"))


def _fix_faults(result: Evidence, area: Area, stated: Mapping[str, float] | None) -> list[str]:
    """The error of the fixes of a landmark, whose bearing is a true one in files."""
    fixes = result.scene.get("landmark_fixes") or []
    number = int(area.title.rpartition(" ")[2]) - 1
    true = fixes[number] if number < len(fixes) else None
    if stated is None or true is None or stated.keys() != true.keys():
        return [] if stated is None and true is None else [f"{area.title}: fix {stated}"]
    wanted = dict(true)
    if "bearing" in wanted:
        angle = math.radians(wanted["bearing"])
        toward = np.array([[math.sin(angle), math.cos(angle)]])
        middle = area.outlines[0].mean(axis=0)[None]
        wanted["bearing"] = float(azimuths(result.scene["crs"], middle, toward)[0])
    turn = (stated.get("bearing", 0.0) - wanted.get("bearing", 0.0) + 90.0) % 180.0 - 90.0
    off = [key for key in wanted if key != "bearing" and not close(stated[key], wanted[key])]
    return [f"{area.title}: {key} of its fixes" for key in off + ["bearing"] * (abs(turn) > BEARING)]


# --- plan.kml -------------------------------------------------------------------------------------


def kml(result: Evidence) -> Verdict:
    """Every placemark: the route, the positions, the areas of the map and the tube; there are no others."""
    root = xml_root(result, "plan.kml")
    marks, areas = root.findall(".//Placemark", KML), map_areas(result)
    names = [mark.findtext("name", "", KML) for mark in marks]
    steps = [f"{k} {joined_names(label)}".strip() for k, label in enumerate(result.plan["label"])]
    tube = [f"{TUBE * 100:g} % of whole flights, {result.planned_law} {flow}" for flow in result.flows]
    tree = result.plan.get("branches")
    branches = [] if tree is None else all_branches(tree)
    letters = [f"branch {row['name']}: {row['where']}" for row in branches]
    own = [mark for mark, name in zip(marks, names, strict=True) if name in (*letters, *KML_LINES)]
    marks = [mark for mark in marks if mark not in own]
    names = [name for name in names if name not in (*letters, *KML_LINES)]
    wanted = ["route", *steps, *(area.title for area in areas)]
    if names[:-1] != wanted or names[-1] not in tube:
        other = [name for name in names if name not in [*wanted, *tube]]
        return no_fault(f"{len(names)} placemarks", [f"{len(wanted) + 1} are expected", *other])
    strange = {one.tag.rpartition("}")[2] for one in root.iter()} - TAGS
    faults = [f"an element {tag}" for tag in sorted(strange)]
    line = marks[0].findtext("LineString/coordinates", None, KML)
    fault = line_fault(in_plane(result.scene["crs"], _coordinates(line)), flown_places(result))
    faults += [f"route: {fault}"] * bool(fault)
    faults += _branch_faults(result, [_kml_branch(result, mark) for mark in own])
    for area, mark in zip(areas, marks[len(steps) + 1 : -1], strict=True):
        fault = drawn_fault(result.scene["crs"], _kml_rings(mark), area.outlines, SAG)
        style = "border" if area.role == "bounds" else area.role
        faults += [f"{area.title}: {fault}"] * bool(fault)
        faults += [f"{area.title}: style"] * (mark.findtext("styleUrl", None, KML) != f"#{style}")
    rings = _kml_rings(marks[-1])
    size = whole_size(result, TUBE)
    size = tube_size(result, in_plane(result.scene["crs"], rings[0])) if size is None else size
    fault = drawn_fault(result.scene["crs"], rings, tube_pieces(result, size), SAG)
    faults += [f"{names[-1]}: {fault}"] * bool(fault)
    rows = _rows(result)
    for k, mark in enumerate(marks[1 : len(steps) + 1]):
        faults += [f"step {k}: {key}" for key in _unlike_data(mark, rows[k] if rows else {}, result)]
    return no_fault(f"{len(names)} placemarks", faults)


KML_LINES = ("line along the track", "line across the track")


def _kml_branch(result: Evidence, mark: ElementTree.Element) -> tuple[str, dict[str, Any], FloatArray]:
    """Role, name with the words of the cell, and places [m] of a line of the branches."""
    name = mark.findtext("name", "", KML)
    line = mark.findtext("LineString/coordinates", None, KML)
    letter, _, where = name.removeprefix("branch ").partition(": ")
    role = BRANCH_ROLES[name in KML_LINES]
    return role, {"name": letter, "where": where}, in_plane(result.scene["crs"], _coordinates(line))


def _coordinates(text: str | None) -> FloatArray:
    """Longitudes and latitudes (N, 2) [deg] of a text of KML."""
    return np.array([place.split(",")[:2] for place in str(text).split()], float)


def _kml_rings(mark: ElementTree.Element) -> list[FloatArray]:
    texts = [ring.findtext("coordinates", "", KML) for ring in mark.findall(".//LinearRing", KML)]
    return [_coordinates(text) for text in texts]


def _unlike_data(mark: ElementTree.Element, row: Mapping[str, str], result: Evidence) -> Iterator[str]:
    """The numbers of a position in plan.kml that differ from the table of dead reckoning."""
    for data in mark.findall("ExtendedData/Data", KML):
        key, text = str(data.get("name")), data.findtext("value", "", KML)
        if key == "wind_law":
            wrong = text != result.planned_law
        else:
            wrong = bool(row) and not close(float(text), float(row[key] or math.nan), 0.0, 6e-4)
        if wrong:
            yield f"{key} {text}"


# --- corridors ------------------------------------------------------------------------------------


def corridor_cov(result: Evidence) -> FloatArray:
    """Covariances (T+1, 2, 2) [m²] of the ellipses of corridors."""
    return np.asarray(np.array(result.plan["cov"], float) + FINEST**2 * np.eye(2), float)


def ellipse_polygons(result: Evidence, size: float) -> FloatArray:
    """Polygons (T+1, 36, 2) [m] around the ellipses of ``size`` standard deviations."""
    angle = np.arange(CORNERS) * (2.0 * np.pi / CORNERS)
    circle = np.stack([np.cos(angle), np.sin(angle)]) / np.cos(np.pi / CORNERS)
    around = size * np.swapaxes(np.linalg.cholesky(corridor_cov(result)) @ circle, -1, -2)
    return np.asarray(result.x[:, None, :] + around, float)


def tube_pieces(result: Evidence, size: float) -> list[FloatArray]:
    """The convex hulls [m] of the polygons at both ends of each leg: the tube is their union."""
    from scipy.spatial import ConvexHull

    rings = ellipse_polygons(result, size)
    ends = [np.concatenate(pair) for pair in pairwise(rings)] or [rings[0]]
    return [points[ConvexHull(points).vertices] for points in ends]


def tube_size(result: Evidence, ring: FloatArray) -> float:
    """The size of the ellipses of the tube that reaches as far to the east as ``ring`` (N, 2) [m]."""
    reach = ellipse_polygons(result, 1.0)[..., 0].max(axis=1) - result.x[:, 0]
    return float(((ring[:, 0].max() - result.x[:, 0]) / reach).min())


def whole_size(result: Evidence, share: float) -> float | None:
    """The size of the tube of a share of whole flights by corridor.geojson, which another claim judges."""
    if not result.has("corridor.geojson"):
        return None
    features = (feature["properties"] for feature in result.document("corridor.geojson")["features"])
    sizes = [f["standard_deviations"] for f in features
             if f["meaning"] == "whole_flight" and f["probability"] == share]  # fmt: skip
    return float(sizes[0]) if sizes else None


def corridors(result: Evidence) -> Verdict:
    """Every area of corridor.geojson is the polygon of its size: around an ellipse, or a tube."""
    crs, (features, faults) = result.scene["crs"], _features(result, "corridor.geojson")
    for number, feature in enumerate(features):
        about, rings = feature["properties"], rings_of(feature["geometry"])
        size, whole = float(about["standard_deviations"]), about["meaning"] == "whole_flight"
        if whole:
            fault = drawn_fault(crs, rings, tube_pieces(result, size), SAG)
        else:
            corners = ellipse_polygons(result, size)[about["step"]]
            closed = in_plane(crs, rings[0])
            plain = len(rings) == 1 and (rings[0][0] == rings[0][-1]).all()
            fault = ring_fault(closed[:-1], corners) if plain else drawn_fault(crs, rings, [corners], np.inf)
            fault = fault or _time_fault(result, about)
        faults += [f"area {number}: {fault}"] * bool(fault)
    return no_fault(f"{len(features)} areas", faults)


def _time_fault(result: Evidence, about: Mapping[str, Any]) -> str:
    """The fault of the time of an ellipse; the table has the times of an aircraft that banks."""
    step, rows = about["step"], _rows(result)
    if not rows and result.robot.bank > 0.0:
        return ""
    t = column(rows, "t_s") if rows else np.array(result.plan["t"], float)
    utc = [row["time_utc"] or None for row in rows] if rows else result.plan["time_utc"]
    late = not close(about["t_s"], t[step], 1e-9, 1e-6) or (utc or [None] * len(t))[step] != about["time_utc"]
    return "another time" if late else ""


WORLD = (*PLAN, "cells.json", "automaton.json")
CLAIMS: tuple[Claim, ...] = (
    Claim("exports: shapes of plan.geojson", ("plan.geojson", *WORLD), geojson),
    Claim("exports: shapes of plan.kml", ("plan.kml", *WORLD), kml),
    Claim("exports: areas of corridors", ("corridor.geojson", *PLAN), corridors),
)
