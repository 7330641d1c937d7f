"""A box of longitudes and latitudes: the part of a large wind file that a scene needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.projection import Frame

DEGREE = 111_195.0  # [m] of latitude
POLAR = 85.0  # [deg] a box that extends beyond this latitude contains all longitudes
MARGIN = 1e6  # [m] around a scene, twice the distance up to which readings are used
NEAR = 150e3  # [m] around a scene, where most nodes of a fine grid are used
MOST_NODES = 40_000  # of one grid; the fit uses some hundreds of them
SAMPLES = 21  # positions along each side of a scene that are converted to degrees


@dataclass(frozen=True, slots=True)
class GeoBox:
    """Longitudes from ``west`` eastwards for ``width``, latitudes from ``south`` to ``north``, all [deg].

    ``margin`` [m] is the distance by which the box was widened around the scene.
    """

    west: float
    south: float
    width: float
    north: float
    margin: float = 0.0

    @classmethod
    def around(cls, lonlat: FloatArray) -> GeoBox:
        """The smallest box around points (N, 2) [deg]: outside is the widest arc without points."""
        south, north = lonlat[:, 1].min(), lonlat[:, 1].max()
        lon = np.unique(lonlat[:, 0] % 360.0)
        gaps = np.diff(np.append(lon, lon[0] + 360.0))
        widest = int(np.argmax(gaps))
        west = float(lon[(widest + 1) % len(lon)])
        return cls(west, float(south), float(360.0 - gaps[widest]), float(north))

    def contains(self, lonlat: FloatArray) -> NDArray[np.bool_]:
        """Which of the points (N, 2) [deg] are inside, (N,)."""
        east_of = (lonlat[:, 0] - self.west) % 360.0
        return np.asarray(
            (east_of <= self.width) & (lonlat[:, 1] >= self.south) & (lonlat[:, 1] <= self.north)
        )

    @property
    def text(self) -> str:
        """The box as text for messages: ``latitude 30..44, longitude -100..-84``."""
        if self.width >= 360.0:
            return f"latitude {self.south:.4g}..{self.north:.4g}, all longitudes"
        west = (self.west + 180.0) % 360.0 - 180.0
        east = (self.west + self.width + 180.0) % 360.0 - 180.0
        return f"latitude {self.south:.4g}..{self.north:.4g}, longitude {west:.4g}..{east:.4g}"

    @property
    def middle(self) -> FloatArray:
        """Longitude and latitude (1, 2) of the centre [deg]."""
        return np.array([[self.west + self.width / 2, (self.south + self.north) / 2]])

    def widened(self, margin: float) -> GeoBox:
        """The box with ``margin`` [m] more on each side."""
        south = max(-90.0, self.south - margin / DEGREE)
        north = min(90.0, self.north + margin / DEGREE)
        highest = max(abs(south), abs(north))
        if highest > POLAR:
            return GeoBox(-180.0, south, 360.0, north, margin)
        more = margin / DEGREE / np.cos(np.deg2rad(highest))
        width = min(360.0, self.width + 2 * more)
        return GeoBox(-180.0 if width == 360.0 else self.west - more, south, width, north, margin)

    def pick(self, lonlat: FloatArray) -> IntArray:
        """Indices of the points (N, 2) [deg] inside; if more than :data:`MOST_NODES`, an even selection.

        Half of the selection is for the scene and :data:`NEAR` around it.
        """
        inside = np.flatnonzero(self.contains(lonlat))
        if len(inside) <= MOST_NODES:
            return inside
        near = self._narrowed(self.margin - NEAR).contains(lonlat[inside])
        parts = [_one_a_cell(lonlat, rows, MOST_NODES // 2) for rows in (inside[near], inside[~near])]
        return np.sort(np.concatenate(parts))

    def refuse_empty_crop(self, where: str, lonlat: FloatArray) -> NoReturn:
        """Raise a DataError for a file without a node in the box; it states what ``lonlat`` (N, 2) covers."""
        finite = lonlat[np.isfinite(lonlat).all(axis=1)]
        covers = GeoBox.around(finite).text if len(finite) else "no place on Earth"
        raise DataError(
            f"{where} covers {covers}; the scene needs {self.text}: "
            f"{swap_question(finite, self.middle) or 'is the scene where the wind data is?'}"
        )

    def _narrowed(self, margin: float) -> GeoBox:
        if margin <= 0:
            return self
        less = margin / DEGREE
        lower = less / np.cos(np.deg2rad(min(POLAR, max(abs(self.south), abs(self.north)))))
        round_earth = self.width >= 360.0 or self.width <= 2 * lower
        west, width = (self.west, self.width) if round_earth else (self.west + lower, self.width - 2 * lower)
        return GeoBox(west, self.south + less, width, self.north - less)


@dataclass(frozen=True, slots=True)
class Wanted:
    """The part of the wind that a run needs; a source may leave out the rest.

    Attributes
    ----------
    area : GeoBox or None
        The area; None: everywhere.
    start : str or None
        Departure, ISO 8601; None: the first wind time.
    """

    area: GeoBox | None = None
    start: str | None = None


ALL_WIND = Wanted()


def _one_a_cell(lonlat: FloatArray, rows: IntArray, limit: int) -> IntArray:
    """The first of ``rows`` in each cell of a lattice of about ``limit`` cells; all if they are not more."""
    if len(rows) <= limit:
        return rows
    lon, lat = lonlat[rows].T
    cells = np.stack([(lon - lon.min()) * np.cos(np.deg2rad(lat.mean())), lat - lat.min()], axis=1)
    side = float(np.sqrt(max(np.prod(np.ptp(cells, axis=0)), 1e-12) / limit))
    across, up = np.floor(cells / side).astype(np.int64).T
    return rows[np.unique(up * (int(across.max()) + 1) + across, return_index=True)[1]]


def neighbourhood(scene: SceneConfig, padding: float = 0.0) -> GeoBox | None:
    """The box of all wind data that can matter for ``scene``; None for a scene without position on Earth.

    ``padding`` [m] is the distance by which the lattice of the wind extends beyond the map.
    """
    from pareto_ltl.world.scene_settings import scene_sketch

    if not scene.file and (scene.centre is None or not scene.bounds):
        return None
    sketch = scene_sketch(scene)
    if sketch.crs is None:
        return None
    sides = np.linspace(sketch.bounds[0], sketch.bounds[1], SAMPLES)
    places = np.stack(np.meshgrid(*sides.T), axis=-1).reshape(-1, 2)
    lonlat = np.stack(Frame(sketch.crs).to_geographic(places), axis=1)
    return GeoBox.around(lonlat).widened(max(MARGIN, 2 * padding))


def swap_question(lonlat: FloatArray, middle: FloatArray) -> str:
    """A question for messages if the map may have longitude and latitude swapped, else "".

    It may if the wind data ``lonlat`` (N, 2) [deg] are near the centre ``middle`` (1, 2) [deg] of the map
    after its longitude and latitude are exchanged.
    """
    lon, lat = (middle[0] + 180.0) % 360.0 - 180.0
    if not len(lonlat) or abs(lon) > 90.0:
        return ""
    swapped = GeoBox.around(lonlat).widened(NEAR).contains(np.array([[lat, lon]]))[0]
    return "did the map swap longitude and latitude? GeoJSON has longitude first" if swapped else ""
