"""Points, segments and convex polygons."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.kernels.data import Cells, Faces
from pareto_ltl.kernels.gaussian import variance_along
from pareto_ltl.kernels.jit import allocating, kernel
from pareto_ltl.support.arrays import FloatArray, IntArray

SLACK = 1e-6  # [m] a point this far outside an edge still lies on it


@kernel
def slack(faces: Faces, part: int, x: float, y: float) -> float:
    """Distance to the nearest face, positive inside the polygon."""
    least = math.inf
    normal, offset = faces.normal, faces.offset
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        least = min(least, offset[j] - normal[j, 0] * x - normal[j, 1] * y)
    return least


@kernel
def locate(cells: Cells, x: float, y: float) -> int:
    """The first cell that holds the point; beside every cell by rounding, the nearest candidate.

    -1 outside the bounds or more than a metre inside an obstacle.
    """
    if not (cells.west <= x <= cells.east and cells.south <= y <= cells.north):
        return -1
    n = cells.buckets
    column = min(n - 1, int((x - cells.west) / (cells.east - cells.west) * n))
    row = min(n - 1, int((y - cells.south) / (cells.north - cells.south) * n))
    best, best_slack = -1, -1.0
    for k in range(cells.ptr[column * n + row], cells.ptr[column * n + row + 1]):
        cell = int(cells.candidates[k])
        room = slack(cells.faces, cell, x, y)
        if room >= -SLACK:
            return cell
        if room > best_slack:
            best, best_slack = cell, room
    return best


@kernel
def clear_faces(
    faces: Faces, z: float, x: float, y: float, cxx: float, cxy: float, cyy: float, masks: IntArray, r: int
) -> bool:
    """Bit k of ``masks[r, j]``: face k of obstacle j is cleared, c' x - d >= z √(c' Σ c), Eq. (10).

    False as soon as an obstacle has no cleared face: then the position violates Eq. (9).
    """
    ptr, normal, offset = faces.ptr, faces.normal, faces.offset
    for j in range(len(ptr) - 1):
        mask = 0
        for k in range(ptr[j], ptr[j + 1]):
            nx, ny = normal[k, 0], normal[k, 1]
            gap = nx * x + ny * y - offset[k]
            if (gap >= 0.0 or z < 0.0) and gap >= z * math.sqrt(variance_along(nx, ny, cxx, cxy, cyy)):
                mask |= 1 << (k - ptr[j])
        if mask == 0:
            return False
        masks[r, j] = mask
    return True


@kernel
def hits(faces: Faces, part: int, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether the segment meets the interior of the polygon (Cyrus and Beck's clipping)."""
    enter, leave = 0.0, 1.0
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = faces.normal[j, 0], faces.normal[j, 1]
        gap = faces.offset[j] - SLACK - nx * x0 - ny * y0
        rate = nx * (x1 - x0) + ny * (y1 - y0)
        if rate == 0.0:
            if gap <= 0.0:
                return False
        elif rate > 0.0:
            leave = min(leave, gap / rate)
        else:
            enter = max(enter, gap / rate)
        if enter >= leave:
            return False
    return True


@allocating
def locate_many(cells: Cells, points: FloatArray) -> IntArray:
    """:func:`locate` for every row of ``points`` (P, 2)."""
    found = np.empty(len(points), np.int64)
    for i in range(len(points)):
        found[i] = locate(cells, points[i, 0], points[i, 1])
    return found
