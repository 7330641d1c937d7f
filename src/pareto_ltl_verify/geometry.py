"""Points, segments and polygons in the plane, and the same points on the Earth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from careful_io.projections import refuse_files
from pareto_ltl_verify.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Convex:
    """A convex polygon as half planes ``normals @ x <= offsets``; ``corners`` (n, 2) [m] turn left."""

    corners: FloatArray
    normals: FloatArray
    offsets: FloatArray

    def moved(self, by: float) -> Convex:
        """The polygon with all faces moved outwards by ``by`` [m]: its corners are where they meet."""
        before = np.roll(self.normals, 1, axis=0)
        turn = np.maximum(1.0 + (before * self.normals).sum(axis=1, keepdims=True), 1e-9)
        corners = self.corners + by * (before + self.normals) / turn if len(self.corners) else self.corners
        return Convex(corners, self.normals, self.offsets + by)

    def depth(self, points: FloatArray) -> FloatArray:
        """Distance from ``points`` (P, 2) to the nearest face line [m], positive inside."""
        return np.asarray((self.offsets - points @ self.normals.T).min(axis=1), float)

    def pieces(
        self, start: FloatArray, end: FloatArray, margin: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shares in [0, 1] at which segments enter and leave the polygon reduced by ``margin`` [m].

        Segments are cut at every face line. There is a piece inside if the first is at most the second and
        the third, the least distance [m] to the faces that a segment is parallel to, is not negative
        (infinite without such a face).
        """
        gap = (self.offsets - margin) - start @ self.normals.T
        rate = (end - start) @ self.normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = gap / rate
        leave = np.where(rate > 0, cut, np.inf).min(axis=1)
        enter = np.where(rate < 0, cut, -np.inf).max(axis=1)
        along = np.where(rate == 0, gap, np.inf).min(axis=1)
        return np.maximum(enter, 0.0), np.minimum(leave, 1.0), along


def convex(corners: Iterable[Iterable[float]]) -> Convex:
    """The half planes of a convex polygon whose corners are counter-clockwise."""
    points = np.array([list(corner) for corner in corners], float)
    along = np.roll(points, -1, axis=0) - points
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    return Convex(points, normals, np.einsum("ij,ij->i", normals, points))


def beyond_bounds(bounds: FloatArray) -> tuple[Convex, ...]:
    """The half planes beyond each side of a rectangle (2, 2), each as a polygon with one face."""
    (west, south), (east, north) = bounds.tolist()
    sides = (((1.0, 0.0), west), ((-1.0, 0.0), -east), ((0.0, 1.0), south), ((0.0, -1.0), -north))
    nowhere = np.empty((0, 2))
    return tuple(Convex(nowhere, np.array([normal]), np.array([offset])) for normal, offset in sides)


def deepest(parts: Sequence[Convex], points: FloatArray) -> FloatArray:
    """Largest depth of ``points`` (P, 2) in any of ``parts`` [m]; -inf without parts."""
    outside = np.full(len(points), -np.inf)
    return np.asarray(np.max([outside, *(part.depth(points) for part in parts)], axis=0), float)


def met_by_any(parts: Sequence[Convex], start: FloatArray, end: FloatArray, margin: float) -> BoolArray:
    """Which segments (P,) have a piece deeper than ``margin`` [m] in any of ``parts``."""
    met = np.zeros(len(start), bool)
    least, limit = np.minimum(start, end), np.maximum(start, end)
    for part in parts:
        rows = np.arange(len(start))
        if len(part.corners):  # most segments do not come near
            around = part.moved(max(-margin, 0.0)).corners
            near = (limit >= around.min(axis=0)) & (least <= around.max(axis=0))
            rows = np.flatnonzero(near[:, 0] & near[:, 1] & ~met)
        enter, leave, along = part.pieces(start[rows], end[rows], margin)
        met[rows] |= (along > 0) & (enter < leave)
    return met


def signed_area(corners: FloatArray) -> float:
    """Area of a simple polygon [m²], positive where its corners are counter-clockwise."""
    x, y = (corners - corners[0]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def within(corners: FloatArray, points: FloatArray) -> BoolArray:
    """Which ``points`` (P, 2) lie in a simple polygon.

    A ray to the east from such a point crosses the outline an odd number of times.
    """
    ahead = np.roll(corners, -1, axis=0)
    odd = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(corners, ahead, strict=True):
        between = (y0 > points[:, 1]) != (y1 > points[:, 1])
        if y0 != y1:
            odd ^= between & (points[:, 0] < x0 + (points[:, 1] - y0) * (x1 - x0) / (y1 - y0))
    return odd


def outline_distance(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Distance of ``points`` (P, 2) from the outline of a polygon [m]."""
    along = np.roll(corners, -1, axis=0) - corners
    offset = points[:, None] - corners
    share = np.einsum("pij,ij->pi", offset, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    nearest = np.clip(share, 0.0, 1.0)[..., None] * along
    return np.asarray(np.linalg.norm(offset - nearest, axis=2).min(axis=1), float)


# --- on the Earth -----------------------------------------------------------------------------

AHEAD = 1.0  # [m] distance from a position to the second point that gives the direction there
WGS84 = "EPSG:4326"


@cache
def _transformer(source: str, target: str) -> Any:
    from pyproj import Transformer

    refuse_files(source)
    return Transformer.from_crs(source, target, always_xy=True)


def on_earth(crs: str, x: FloatArray) -> FloatArray:
    """Longitudes and latitudes (2, N) [deg] of positions ``x`` (N, 2) [m]."""
    return np.array(_transformer(crs, WGS84).transform(*x.T))


def in_plane(crs: str, lonlat: FloatArray) -> FloatArray:
    """Positions (N, 2) [m] of longitudes and latitudes (N, 2) [deg]."""
    return np.column_stack(_transformer(WGS84, crs).transform(*lonlat.T))


def azimuths(crs: str, x: FloatArray, toward: FloatArray) -> FloatArray:
    """True directions (T,) [deg], clockwise from north, at ``x`` (T, 2) [m] of plane vectors (T, 2)."""
    from pyproj import Geod

    ahead = x + AHEAD * toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    return np.asarray(Geod(ellps="WGS84").inv(*on_earth(crs, x), *on_earth(crs, ahead))[0], float)
