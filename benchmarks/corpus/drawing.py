"""Outlines in a plane around the middle of a map [m], borders of five kinds, and their degrees."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import pyproj

from pareto_ltl.support.arrays import BoolArray, FloatArray

ROOM = 0.92  # share of half a map's side that the drawing uses; the rest is between it and the border
TRIES = 400  # random places for one outline
DIGITS = 6  # of degrees in files: 10 cm


@dataclass(frozen=True, slots=True)
class Place:
    """The middle of a map [deg], and the plane that touches the Earth there (azimuthal equidistant)."""

    lat: float
    lon: float

    def degrees(self, points: FloatArray) -> FloatArray:
        """Longitudes and latitudes of ``points`` (P, 2) [m]; longitudes within 180 degrees of ``lon``."""
        return self.near(_to_degrees(f"+proj=aeqd +lat_0={self.lat} +lon_0={self.lon} +datum=WGS84"), points)

    def near(self, inverse: pyproj.Transformer, points: FloatArray) -> FloatArray:
        """``inverse`` applied to ``points`` (P, 2), without a jump at the 180th meridian."""
        lon, lat = inverse.transform(*np.asarray(points, float).T)
        lon = self.lon + (np.asarray(lon) - self.lon + 180.0) % 360.0 - 180.0
        return np.round(np.column_stack([lon, lat]), DIGITS)


@lru_cache
def _to_degrees(plane: str) -> pyproj.Transformer:
    """From a plane to longitude and latitude; making one takes 25 ms."""
    return pyproj.Transformer.from_crs(plane, "EPSG:4326", always_xy=True)


@dataclass(frozen=True, slots=True)
class Feature:
    """One feature of a map file; ``points`` (P, 2) [deg], of a Polygon with the first corner again."""

    role: str
    geometry: str
    points: FloatArray
    properties: dict[str, Any] = field(default_factory=dict)


@dataclass(slots=True)
class Spots:
    """Discs of a map that are taken: their gaps are wide enough to fly through."""

    rng: np.random.Generator
    half: float  # of the side of the map [m]
    taken: list[tuple[FloatArray, float]] = field(default_factory=list)

    def place(self, radius: float, gap: float) -> FloatArray | None:
        """A middle (2,) [m] for a disc ``gap`` * ``half`` from the others; None if there is no room."""
        reach = ROOM * self.half - radius
        places = self.rng.uniform(-reach, reach, (TRIES, 2))
        free = np.flatnonzero(self._free(places, radius, gap))
        if not len(free):
            return None
        self.taken.append((places[free[0]], radius))
        return np.asarray(places[free[0]])

    def take(self, middle: FloatArray, radius: float, gap: float) -> bool:
        """Take the disc if it is free; whether it was."""
        free = bool(self._free(middle[None], radius, gap)[0])
        if free:
            self.taken.append((middle, radius))
        return free

    def _free(self, places: FloatArray, radius: float, gap: float) -> BoolArray:
        free = np.ones(len(places), bool)
        for other, size in self.taken:
            free &= np.linalg.norm(places - other, axis=1) > radius + size + gap * self.half
        return free


def _regular(corners: int, notch: float = 1.0) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    reach = np.where(np.arange(corners) % 2, notch, 1.0)
    return np.column_stack([np.cos(angle), np.sin(angle)]) * reach[:, None]


def rectangle(width: float, height: float) -> FloatArray:
    """Corners of a rectangle about the origin."""
    return np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * [width / 2, height / 2]


SHAPES = {  # corners in the unit disc
    "hexagon": _regular(6),
    "triangle": _regular(3),
    "strip": rectangle(1.9, 0.6),
    "star": _regular(10, 0.55),  # not convex
}


def turned(points: FloatArray, angle: float) -> FloatArray:
    """``points`` (P, 2), anticlockwise by ``angle`` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def outline(rng: np.random.Generator, middle: FloatArray, radius: float) -> FloatArray:
    """A random shape in the disc, turned at random."""
    corners = SHAPES[str(rng.choice(list(SHAPES)))]
    return turned(radius * corners, rng.uniform(0.0, 2.0 * math.pi)) + middle


def coast(rng: np.random.Generator, middle: FloatArray, radius: float, corners: int) -> FloatArray:
    """An island of ``corners`` corners in the disc, with bays of many sizes."""
    angle = np.linspace(0.0, 2.0 * math.pi, corners, endpoint=False)
    waves = np.arange(2, 120)
    height, phase = rng.normal(0.0, 1.0, len(waves)) / waves**1.1, rng.uniform(0, 2 * math.pi, len(waves))
    rim = np.cos(np.outer(angle, waves) + phase) @ height
    reach = radius * (0.75 + 0.25 * rim / np.abs(rim).max())
    return np.asarray(middle + reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def closed(points: FloatArray) -> FloatArray:
    """The corners with the first one again."""
    return np.vstack([points, points[:1]])


def _degrees_border(place: Place, half: float) -> FloatArray:
    """A rectangle of meridians and parallels."""
    (west, south), (east, north) = (
        f(place.degrees(rectangle(2 * half, 2 * half)), axis=0) for f in (np.min, np.max)
    )
    return np.array([[west, south], [east, south], [east, north], [west, north]])


def _plane_border(place: Place, half: float) -> FloatArray:
    """A square of the plane, which is nearly a rectangle in other planes."""
    return place.degrees(rectangle(2 * half, 2 * half))


def _utm_border(place: Place, half: float) -> FloatArray:
    """A square of the UTM zone."""
    zone = int((place.lon + 180.0) % 360.0 // 6) + 1
    utm = _to_degrees(f"+proj=utm +zone={zone} +datum=WGS84")
    middle = np.array(utm.transform(place.lon, place.lat, direction="INVERSE"))
    return place.near(utm, rectangle(2 * half, 2 * half) + middle)


def _turned_border(place: Place, half: float) -> FloatArray:
    """A quadrilateral that is turned by 7 degrees, one corner farther out."""
    corners = turned(rectangle(2 * half, 2 * half), 0.12)
    corners[1] *= 1.03
    return place.degrees(corners)


Border = Callable[[Place, float], FloatArray]
BORDERS: dict[str, Border | None] = {
    "degrees": _degrees_border,
    "plane": _plane_border,
    "utm": _utm_border,
    "turned": _turned_border,
    "none": None,
}
