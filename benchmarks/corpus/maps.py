"""Random maps: a start, regions, obstacles of many kinds and landmarks; written as GeoJSON or KML."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from corpus.drawing import BORDERS, Feature, Place, Spots, closed, coast, outline, rectangle, turned
from pareto_ltl.support.arrays import FloatArray

GAP = 0.015  # between outlines, as a share of half the side


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a map contains.

    Attributes
    ----------
    half : float
        Half the side of the map [m].
    border : str
        A key of ``drawing.BORDERS``.
    regions, obstacles, landmarks : int
        Numbers of features; an obstacle for which there is no room is left out.
    clusters : float
        Share of the obstacles that are two or three outlines which overlap or touch.
    at_border : int
        Obstacles that reach across the border.
    corners : int
        If not 0, a third of the obstacles are islands with so many corners.
    """

    place: Place
    half: float
    border: str
    regions: int
    obstacles: int
    landmarks: int
    clusters: float = 0.15
    at_border: int = 0
    corners: int = 0


@dataclass(frozen=True, slots=True)
class Goals:
    """Start and regions of a map; ``middles`` (n + 1, 2) [m] in the order of their names."""

    features: list[Feature]
    middles: FloatArray
    spots: Spots

    @property
    def tour(self) -> float:
        """Length [m] of the straight legs from the start through all regions."""
        return float(np.linalg.norm(np.diff(self.middles, axis=0), axis=1).sum())


def draw_goals(rng: np.random.Generator, recipe: Recipe) -> Goals | None:
    """Start and regions; None if there is no room."""
    half, spots = recipe.half, Spots(rng, recipe.half)
    radii = half * np.array([0.03, *rng.uniform(0.08, 0.18, recipe.regions)])
    middles = [spots.place(radius, 0.05) for radius in radii]
    placed = [middle for middle in middles if middle is not None]
    if len(placed) < len(middles):
        return None
    features = [Feature("start", "Point", recipe.place.degrees(placed[0][None]))]
    for name, middle, radius in zip("abcde", placed[1:], radii[1:], strict=False):
        features.append(_area("region", recipe.place, outline(rng, middle, radius), name=name))
    return Goals(features, np.array(placed), spots)


def draw_map(rng: np.random.Generator, recipe: Recipe, goals: Goals) -> list[Feature]:
    """``goals``, obstacles and landmarks as far as there is room, and the border."""
    features = goals.features + _obstacles(rng, recipe, goals.spots)
    for radius in recipe.half * rng.uniform(0.06, 0.12, recipe.landmarks):
        if (middle := goals.spots.place(radius, 0.0)) is not None:
            square = turned(rectangle(1.4 * radius, 1.4 * radius), rng.uniform(0.0, math.pi))
            features.append(_area("landmark", recipe.place, square + middle))
    draw_border = BORDERS[recipe.border]
    if draw_border is not None:
        features.append(Feature("border", "Polygon", closed(draw_border(recipe.place, recipe.half))))
    return features


def _area(role: str, place: Place, points: FloatArray, **properties: object) -> Feature:
    return Feature(role, "Polygon", place.degrees(closed(points)), properties)


def _obstacles(rng: np.random.Generator, recipe: Recipe, spots: Spots) -> list[Feature]:
    """Areas, lines with buffers, clusters and islands; half of them have names."""
    found = []
    for _ in range(recipe.at_border):
        found += _across_border(rng, recipe, spots)
    for number in range(recipe.obstacles):
        radius = recipe.half * rng.uniform(0.05, 0.18)
        middle = spots.place(radius, GAP)
        if middle is None:
            continue
        named = {"name": f"zone {number}"} if rng.random() < 0.5 else {}
        if recipe.corners and number % 3 == 0:
            points = [coast(rng, middle, radius, recipe.corners)]
        elif rng.random() < recipe.clusters:
            points = _cluster(rng, middle, radius)
        elif rng.random() < 0.12:
            found.append(_line(rng, recipe.place, middle, radius, number))
            continue
        else:
            points = [outline(rng, middle, radius)]
        found += [_area("obstacle", recipe.place, part, **named) for part in points]
    return found


def _line(rng: np.random.Generator, place: Place, middle: FloatArray, radius: float, number: int) -> Feature:
    """A bent line with a buffer [m]."""
    bent = np.array([[-0.85, -0.2], [0.1, 0.25], [0.85, 0.0]]) * radius
    points = turned(bent, rng.uniform(0.0, 2.0 * math.pi)) + middle
    return Feature(
        "obstacle",
        "LineString",
        place.degrees(points),
        {"name": f"line {number}", "buffer": round(0.1 * radius, 1)},
    )


def _cluster(rng: np.random.Generator, middle: FloatArray, radius: float) -> list[FloatArray]:
    """Outlines in one disc that overlap, have a common side, or have a common corner."""
    angle, kind = rng.uniform(0.0, 2.0 * math.pi), int(rng.integers(3))
    if kind == 0:
        offsets = turned(np.array([[0.35, 0.0], [-0.25, 0.25], [-0.25, -0.25]]), angle) * radius
        return [outline(rng, middle + offset, 0.6 * radius) for offset in offsets[: int(rng.integers(2, 4))]]
    side = 0.62 * radius
    step = [side, 0.0] if kind == 1 else [side, side]
    squares = [rectangle(side, side) - np.array(step) / 2, rectangle(side, side) + np.array(step) / 2]
    return [turned(square, angle) + middle for square in squares]


def _across_border(rng: np.random.Generator, recipe: Recipe, spots: Spots) -> list[Feature]:
    """A strip from outside the border into the map; none if that place is taken."""
    half = recipe.half
    middle = turned(np.array([[half, rng.uniform(-0.6, 0.6) * half]]), 0.5 * math.pi * int(rng.integers(4)))[
        0
    ]
    if not spots.take(middle, 0.2 * half, GAP):
        return []
    angle = math.atan2(middle[1], middle[0]) + rng.uniform(-0.2, 0.2)
    strip = turned(rectangle(0.38 * half, 0.08 * half), angle) + middle
    return [_area("obstacle", recipe.place, strip, name="pier")]


def wrapped(points: FloatArray) -> FloatArray:
    """Longitudes from -180 to 180: an outline across the 180th meridian jumps there."""
    return np.column_stack([(points[:, 0] + 180.0) % 360.0 - 180.0, points[:, 1]])


def write_geojson(features: Sequence[Feature], path: Path) -> None:
    """A FeatureCollection."""
    written = []
    for feature in features:
        points = wrapped(feature.points).round(7).tolist()
        coordinates = {"Point": points[0], "LineString": points, "Polygon": [points]}[feature.geometry]
        written.append(
            {
                "type": "Feature",
                "properties": {"role": feature.role, **feature.properties},
                "geometry": {"type": feature.geometry, "coordinates": coordinates},
            }
        )
    path.write_text(json.dumps({"type": "FeatureCollection", "features": written}) + "\n")


def write_kml(features: Sequence[Feature], path: Path) -> None:
    """Placemarks in folders by role, other properties as ExtendedData."""
    folders = []
    for role in dict.fromkeys(feature.role for feature in features):
        marks = "\n".join(_placemark(feature) for feature in features if feature.role == role)
        folders.append(f"<Folder><name>{role.title()}s</name>\n{marks}\n</Folder>")
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
    path.write_text("\n".join([head, *folders, "</Document></kml>", ""]))


def _placemark(feature: Feature) -> str:
    data = dict(feature.properties)
    name = escape(str(data.pop("name", "")))
    more = "".join(
        f'<Data name="{key}"><value>{escape(str(value))}</value></Data>' for key, value in data.items()
    )
    corners = " ".join(f"{lon:.7f},{lat:.7f},0" for lon, lat in wrapped(feature.points))
    shape = f"<coordinates>{corners}</coordinates>"
    if feature.geometry == "Polygon":
        shape = f"<outerBoundaryIs><LinearRing>{shape}</LinearRing></outerBoundaryIs>"
    extended = f"<ExtendedData>{more}</ExtendedData>" if more else ""
    shape = f"<{feature.geometry}>{shape}</{feature.geometry}>"
    return f"<Placemark><name>{name}</name>{extended}{shape}</Placemark>"


WRITERS = {"geojson": write_geojson, "kml": write_kml}
