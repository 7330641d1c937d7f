"""Places of readings: distances, those that are far from each other, and times that have the same ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wind_laws.types import FloatArray, IntArray


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
