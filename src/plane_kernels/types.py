"""Points, covariances and convex polygons in the plane as named tuples, so that loops read ``here.cov``."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Point(NamedTuple):
    """A point in the plane: x east, y north [m]."""

    x: float
    y: float


class Cov(NamedTuple):
    """A symmetric 2 x 2 matrix, mostly the covariance of a position [m²]."""

    xx: float
    xy: float
    yy: float


class Gaussian(NamedTuple):
    """A position: mean [m] and covariance [m²]."""

    mean: Point
    cov: Cov


class Linear(NamedTuple):
    """A 2 x 2 matrix, row by row."""

    xx: float
    xy: float
    yx: float
    yy: float


class Faces(NamedTuple):
    """Convex polygons as half planes ``normal' x <= offset``; a polygon with one face is a half plane.

    Polygon j has the rows ``ptr[j]`` to ``ptr[j + 1]``; ``normal`` (F, 2) has unit length and points
    outwards, ``offset`` (F,) is in [m].
    """

    ptr: IntArray
    normal: FloatArray
    offset: FloatArray


class Nearby(NamedTuple):
    """The polygons of :class:`Faces` by their distance from each square of a grid over the plane.

    Row i * rows + j belongs to square (i, j) of side ``side`` [m]. ``order`` (B, m) lists the m polygons by
    their ``gap`` (B, m), ascending: the largest signed distance of the square's centre from a face of the
    polygon [m], rounded down. ``owner`` (F,) is the polygon of each face.
    """

    west: float
    south: float
    side: float
    columns: int
    rows: int
    order: Int32Array
    gap: Float32Array
    owner: Int32Array


class Corners(NamedTuple):
    """Polygons as corners ``corner[ptr[k]:ptr[k + 1]]`` [m], counter-clockwise.

    Polygon k lies within ``radius[k]`` [m] of ``middle[k]`` (L, 2); ``cell[k]`` is the number of its cell.
    """

    cell: IntArray
    middle: FloatArray
    radius: FloatArray
    ptr: IntArray
    corner: FloatArray


class Cells(NamedTuple):
    """Convex cells, and a grid of ``buckets`` x ``buckets`` over their bounds to find them.

    The candidate cells of bucket k are ``candidates[ptr[k]:ptr[k + 1]]``; ~c is cell c, if it comes first and
    contains the whole bucket.
    """

    west: float
    south: float
    east: float
    north: float
    buckets: int
    ptr: IntArray
    candidates: IntArray
    faces: Faces


class StepBound(NamedTuple):
    """A limit epsilon on the probability of a collision in a step, divided equally among the m barriers.

    Barriers are polygons and half planes; ``z`` is the quantile of 1 - epsilon / m.
    """

    barriers: Faces
    nearby: Nearby
    z: float


class PathBound(NamedTuple):
    """Limits on the probability to collide with any barrier: ``epsilon`` in a step, ``delta`` on a path."""

    barriers: Faces
    nearby: Nearby
    epsilon: float
    delta: float


CollisionBound: TypeAlias = StepBound | PathBound
