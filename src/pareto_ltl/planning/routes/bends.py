"""Places where a taut line may bend: corners of obstacles, and gaps too narrow for these corners."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.kernels.visibility import BESIDE, clear_crossings
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.support.arrays import FloatArray, IntArray

SHARES = (0.4, 0.7, 1.0)  # of the largest distance to keep, for which a gap is tried
NEEDLE = 1e-12  # least 1 + cos of the angle between two normals at a corner
PAIRS_AT_ONCE = 100_000  # pairs of faces: their crossings take 20 MB


def bend_places(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Corners (n, 2) and vectors v (n, 2) such that corner + r v clears both its faces by r.

    Corners whose two faces are parallel are left out: those with an angle of 180 degrees, and the ends of
    needles, whose v is longer than any map.
    """
    corners, pair, _ = _corner_faces(polygons)
    sharp = np.abs(np.linalg.det(pair)) > 1e-6
    out = np.linalg.solve(pair[sharp], np.ones((int(sharp.sum()), 2, 1)))[..., 0]
    return corners[sharp], out


def _corner_faces(polygons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, IntArray]:
    """All corners (n, 2), normals before and after each (n, 2, 2), first corner of each polygon."""
    corners, faces = np.vstack([np.empty((0, 2)), *polygons]), pack_faces(polygons)
    before = np.arange(len(corners)) - 1
    before[faces.ptr[:-1]] = faces.ptr[1:] - 1
    return corners, np.stack([faces.normal[before], faces.normal], axis=1), faces.ptr[:-1]


def gap_places(
    polygons: Sequence[FloatArray], faces: kd.Faces, widest: float
) -> tuple[FloatArray, FloatArray]:
    """Bend points p + r v of taut lines in gaps narrower than the clearance r; returns p and v.

    With the distance r to keep, the gap between two obstacles is the intersection of half planes
    ``c' x ≥ d + r``, and a taut line bends where two of their rims cross: at p + r v for one pair of faces.
    Returned are the crossings beside both obstacles and clear of all, for some r up to ``widest`` [m].
    ``faces`` are first the faces of ``polygons``, then single half planes.
    """
    at, grow = [np.empty((0, 2))], [np.empty((0, 2))]
    distances = widest * np.array(SHARES)
    for beside in _face_pairs(faces.ptr, _near_pairs(polygons, len(faces.ptr) - 1, widest)):
        pair = np.stack([faces.normal[beside[0]], faces.normal[beside[1]]], axis=1)
        cross = np.abs(np.linalg.det(pair)) > 0.1
        k, m, first, second = (row[cross] for row in beside)
        pair = pair[cross]
        p = np.linalg.solve(pair, np.stack([faces.offset[k], faces.offset[m]], axis=1)[..., None])[..., 0]
        v = np.linalg.solve(pair, np.ones((len(pair), 2, 1)))[..., 0]
        clear = clear_crossings(faces, first, second, p, v, distances)
        at.append(p[clear])
        grow.append(v[clear])
    return np.vstack(at), np.vstack(grow)


def _near_pairs(polygons: Sequence[FloatArray], count: int, widest: float) -> IntArray:
    """Pairs (n, 2) of polygons close enough for a place beside both, and pairs of a polygon and a half plane.

    A place beside a polygon lies in the outline that has moved outwards by ``BESIDE`` * ``widest``; a pair is
    near if the boxes around these outlines meet.
    """
    import shapely

    pairs = [(i, j) for j in range(len(polygons), count) for i in range(j)]
    if polygons:
        at, pair, first = _corner_faces(polygons)
        # v = (a + b) / (1 + a' b) of bend_places, also at flat corners; at the end of a needle it is limited.
        grow = pair.sum(axis=1) / np.maximum(1.0 + pair.prod(axis=1).sum(axis=1), NEEDLE)[:, None]
        moved = at + BESIDE * widest * grow
        low, high = np.minimum.reduceat(moved, first), np.maximum.reduceat(moved, first)
        boxes = np.asarray(shapely.box(*low.T, *high.T))
        near = shapely.STRtree(boxes).query(boxes, predicate="intersects").T
        pairs += [(i, j) for i, j in near.tolist() if i < j]
    return np.array(sorted(pairs), np.int64).reshape(-1, 2)


def _face_pairs(ptr: IntArray, pairs: IntArray) -> Iterator[tuple[IntArray, IntArray, IntArray, IntArray]]:
    """Pairs of faces of near polygons, about ``PAIRS_AT_ONCE`` at once, and their polygons."""
    counts = np.diff(ptr)[pairs].prod(axis=1)
    chunk = np.cumsum(counts) // PAIRS_AT_ONCE
    for number in np.unique(chunk):
        rows = pairs[chunk == number]
        sizes = np.diff(ptr)[rows]
        total = sizes.prod(axis=1)
        owner = np.repeat(np.arange(len(rows)), total)
        inner = np.arange(len(owner)) - np.repeat(np.cumsum(total) - total, total)
        first, second = rows[owner].T
        k, m = ptr[first] + inner // sizes[owner, 1], ptr[second] + inner % sizes[owner, 1]
        yield k, m, first, second
