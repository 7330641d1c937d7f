"""Places of readings: distances, selections of them, and times that have the same ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wind_laws.types import BoolArray, FloatArray, IntArray

FAR_SHARE = 0.25  # of a selection that is left to places away from its region, if there are so many


def pairwise_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (n, m) [m] between points ``a`` (n, 2) and ``b`` (m, 2) [m]."""
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(a, b), float)


def same_places(points: Sequence[FloatArray]) -> list[IntArray]:
    """Indices of times, in groups with the same places."""
    groups: dict[tuple[tuple[int, ...], bytes], list[int]] = {}
    for k, places in enumerate(points):
        groups.setdefault((places.shape, np.ascontiguousarray(places).tobytes()), []).append(k)
    return [np.array(slots, np.int64) for slots in groups.values()]


def farthest_points(points: FloatArray, count: int, first: int | IntArray) -> IntArray:
    """Indices of ``count`` of ``points`` (N, d): ``first``, then repeatedly the farthest from those chosen.

    ``first`` is one index, or several, at most ``count``. Gonzalez (1985), doi:10.1016/0304-3975(85)90224-5.
    """
    given = np.atleast_1d(first)
    chosen = np.empty(min(count, len(points)), dtype=np.int64)
    gap = np.full(len(points), np.inf)
    for i in range(len(chosen)):
        chosen[i] = given[i] if i < len(given) else np.argmax(gap)
        gap = np.minimum(gap, np.sum((points - points[chosen[i]]) ** 2, axis=1))
    return chosen


def thinned(points: FloatArray, beside: BoolArray, centre: FloatArray, limit: int) -> IntArray:
    """Indices of at most ``limit`` of ``points`` (N, 2) [m]: those ``beside`` a region, others spread.

    At least ``FAR_SHARE`` is left to the others, which determine the scales of the fit; if too many are
    beside the region, an even selection of these.
    """
    if len(points) <= limit:
        return np.arange(len(points))
    own = np.flatnonzero(beside)
    room = limit - min(len(points) - len(own), int(FAR_SHARE * limit))
    if len(own) > room:
        first = int(np.argmin(np.sum((points[own] - centre) ** 2, axis=1)))
        own = own[farthest_points(points[own], room, first)]
    return np.sort(farthest_points(points, limit, own))


def node_rows(points: FloatArray, nodes: FloatArray) -> IntArray:
    """Row in ``points`` (M, 2) of each of ``nodes`` (N, 2), which must all be in ``points``: (N,)."""
    rows = {(lon, lat): row for row, (lon, lat) in enumerate(points.tolist())}
    return np.array([rows[lon, lat] for lon, lat in nodes.tolist()], np.int64)


def shared_nodes(points: Sequence[FloatArray]) -> FloatArray:
    """The nodes (N, 2) that all of ``points`` have, in the order of the first ones."""
    nodes = points[0]
    for other in points[1:]:
        if not np.array_equal(nodes, other):
            known = set(map(tuple, other.tolist()))
            nodes = np.array([node for node in nodes.tolist() if tuple(node) in known]).reshape(-1, 2)
    return nodes
