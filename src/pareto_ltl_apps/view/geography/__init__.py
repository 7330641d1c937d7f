"""Coasts, lakes, borders and cities of the Earth, for orientation: Natural Earth 1:10m, public domain.

``world.npz`` is written by ``release/geography.py``, which says how coarse it is. Longitudes may exceed 180
degrees, so that what a map shows has no cut.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
import shapely

from pareto_ltl import Scene
from pareto_ltl.support.arrays import FloatArray, IntArray

UNIT = 500.0  # of a degree
AREAS, LINES = ("land", "lakes", "islands"), ("borders", "states")
CITY_LIMIT = 300  # of a map, the largest ones
ANSWER_LIMIT = 8  # places that a search answers
FINEST, SHARE = 0.004, 1 / 1200  # detail of a map: [deg], and as a share of its side
BESIDE = 1.0  # of what a page shows around its map, in sides of the map
COARSE = 0.05  # [deg] detail of the outlines of views of half the Earth
STATES_BELOW = 30.0  # [deg] of a map that shows lines between states
POLE = 89.0  # [deg]
DIGITS = 3  # of degrees in JSON: finer than the table
SPELT = str.maketrans({"ø": "o", "Ø": "O", "ł": "l", "Ł": "L", "đ": "d", "ß": "ss", "æ": "ae", "’": "'"})

Box = tuple[float, float, float, float]  # west, south, east, north [deg]; west < east


@dataclass(frozen=True, slots=True)
class Geography:
    """What lies in a box.

    Attributes
    ----------
    box : 4 float
        West, south, east and north edge [deg].
    land, lakes, islands, borders, states : lists of (n, 2) float
        Outlines and lines, longitude and latitude [deg]; islands lie in lakes.
    cities : list of (name, longitude, latitude)
        The largest ones first.
    """

    box: Box
    land: list[FloatArray]
    lakes: list[FloatArray]
    islands: list[FloatArray]
    borders: list[FloatArray]
    states: list[FloatArray]
    cities: list[tuple[str, float, float]]

    def as_dict(self) -> dict[str, Any]:
        """For JSON, with rounded degrees."""
        digits = DIGITS
        shapes = {
            name: [np.round(line, digits).tolist() for line in getattr(self, name)]
            for name in (*AREAS, *LINES)
        }
        cities = [[name, round(lon, digits), round(lat, digits)] for name, lon, lat in self.cities]
        return {"box": list(self.box), **shapes, "cities": cities}


def geography_of(box: Box, detail: float) -> Geography:
    """What lies in ``box``, with deviations of outlines of up to ``detail`` [deg]."""
    box = _rounded(box)
    west, _, east, _ = box
    shapes: dict[str, list[FloatArray]] = {}
    for layer in (*AREAS, *LINES):
        if layer == "states" and east - west > STATES_BELOW:
            shapes[layer] = []
            continue
        parts = [part for turn in _turns(west, east) for part in _cut(layer, box, turn, detail)]
        if layer == "land" and len(_turns(west, east)) > 1:
            parts = list(shapely.get_parts(shapely.union_all(parts)))  # no seam at 180 degrees
        shapes[layer] = [_outline(part) for part in parts]
    return Geography(box, **shapes, cities=list(_cities(box)))


def _rounded(box: Box) -> Box:
    """``box`` with rounded sides; where these are equal, it is one unit wider on each side."""
    sides = [round(side, DIGITS) for side in box]
    for low, high in ((0, 2), (1, 3)):
        if sides[low] >= sides[high]:
            unit = 10.0**-DIGITS
            sides[low], sides[high] = round(sides[low] - unit, DIGITS), round(sides[high] + unit, DIGITS)
    return sides[0], sides[1], sides[2], sides[3]


def geography_around(scene: Scene, beside: float = BESIDE) -> Geography | None:
    """What lies on the map of ``scene`` and up to ``beside`` of its sides next to it.

    None for a map without a place on Earth, or around a pole.
    """
    if scene.crs is None:
        return None
    (west, south), (east, north) = scene.bounds
    x, y = np.linspace(west, east, 9), np.linspace(south, north, 9)
    lon, lat = scene.frame.to_geographic(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    middle = float(scene.frame.to_geographic((scene.bounds[0] + scene.bounds[1]) / 2)[0][0])
    lon = middle + (lon - middle + 180.0) % 360.0 - 180.0
    if np.abs(lat).max() > POLE or np.ptp(lon) > 180.0:
        return None
    dx, dy = beside * np.ptp(lon), beside * np.ptp(lat)
    detail = max(FINEST, SHARE * float(max(np.ptp(lon), np.ptp(lat))))
    sides = (max(lat.min() - dy, -POLE), min(lat.max() + dy, POLE))
    reach = min(dx, (360.0 - np.ptp(lon)) / 2)
    return geography_of(
        (float(lon.min() - reach), float(sides[0]), float(lon.max() + reach), float(sides[1])), detail
    )


def places_named(text: str) -> list[tuple[str, float, float]]:
    """Cities whose name begins with ``text`` or has it, large ones first; accents and case do not count."""
    wanted, names = folded(text), _folded_names()
    if not wanted:
        return []
    begin = [k for k, name in enumerate(names) if name.startswith(wanted)]
    inside = [k for k, name in enumerate(names) if wanted in name and not name.startswith(wanted)]
    exact = [k for k in begin if names[k] == wanted]
    order = dict.fromkeys([*exact, *begin, *inside])
    return [_city(k) for k in list(order)[:ANSWER_LIMIT]]


def folded(text: str) -> str:
    """``text`` without accents and in lower case."""
    plain = unicodedata.normalize("NFKD", text.translate(SPELT))
    return "".join(letter for letter in plain if not unicodedata.combining(letter)).casefold().strip()


# --- the table ------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _world() -> dict[str, Any]:
    """Geometries of each layer, names and places of cities."""
    with files(__package__).joinpath("world.npz").open("rb") as file, np.load(file) as table:
        world: dict[str, Any] = {}
        for layer in (*AREAS, *LINES):
            points, owners = _points(table[f"{layer}_begins"], table[f"{layer}_steps"])
            shapes: Any = shapely.linestrings(points, indices=owners)
            if layer in AREAS:
                shapes = shapely.polygons(shapely.linearrings(points, indices=owners))
            world[layer] = shapes
        world["names"] = table["city_names"].tobytes().decode().split("\n")
        world["places"] = table["city_places"].T / UNIT
    return world


@lru_cache(maxsize=len(AREAS) + len(LINES))
def _coarse(layer: str) -> Any:
    """A layer for views of half the Earth, in a tenth of a second instead of a half."""
    return shapely.simplify(_world()[layer], COARSE)


def _points(begins: IntArray, steps: IntArray) -> tuple[FloatArray, IntArray]:
    """Places (P, 2) [deg] and the number of the line of each (P,)."""
    size, moves = begins[:, 0], steps.transpose(1, 2, 0).copy().view("<i2")[..., 0].T.astype(np.int64)
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    run = np.cumsum(moves, axis=0)
    return (run + np.repeat(begins[:, 1:] - run[first], size, axis=0)) / UNIT, np.repeat(
        np.arange(len(size)), size
    )


def _turns(west: float, east: float) -> range:
    """Whole turns of the table that may lie between two longitudes."""
    return range(int(np.floor((west + 180.0) / 360.0)), int(np.floor((east + 180.0) / 360.0)) + 1)


def _cut(layer: str, box: Box, turn: int, detail: float) -> Iterator[Any]:
    """The simplified parts of a layer in ``box``, after so many turns."""
    west, south, east, north = box
    shift, shapes = 360.0 * turn, _coarse(layer) if detail >= 2.0 * COARSE else _world()[layer]
    bounds = shapely.bounds(shapes)
    near = (bounds[:, 2] >= west - shift) & (bounds[:, 0] <= east - shift)
    near &= (bounds[:, 3] >= south) & (bounds[:, 1] <= north)
    if layer in AREAS:  # an island below the detail is no more than a point
        near &= np.maximum(bounds[:, 2] - bounds[:, 0], bounds[:, 3] - bounds[:, 1]) >= 2.0 * detail
    cut = shapely.clip_by_rect(shapes[near], west - shift, south, east - shift, north)
    kind = shapely.GeometryType.POLYGON if layer in AREAS else shapely.GeometryType.LINESTRING
    for part in shapely.get_parts(shapely.simplify(cut, detail)):
        if shapely.get_type_id(part) == kind and not part.is_empty:
            yield shapely.transform(part, lambda xy: xy + np.array([shift, 0.0])) if shift else part


def _outline(part: Any) -> FloatArray:
    line = part.exterior if part.geom_type == "Polygon" else part
    return np.asarray(line.coords, float)


@lru_cache(maxsize=1)
def _folded_names() -> list[str]:
    return [folded(name) for name in _world()["names"]]


def _city(k: int) -> tuple[str, float, float]:
    lon, lat = _world()["places"][k]
    return _world()["names"][k], float(lon), float(lat)


def _cities(box: Box) -> Iterator[tuple[str, float, float]]:
    west, south, east, north = box
    lon, lat = _world()["places"].T
    turned = west + (lon - west) % 360.0
    for k in np.flatnonzero((turned <= east) & (lat >= south) & (lat <= north))[:CITY_LIMIT]:
        yield _world()["names"][k], float(turned[k]), float(lat[k])
