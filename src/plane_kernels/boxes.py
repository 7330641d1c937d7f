"""The polygons near the bounding box of many points or segments, and the distances of all from one.

A sequence of T + 1 clouds of n points has a segment from each point to the same point of the next cloud.
Polygons far from a whole cloud are excluded once for all its points, not once for each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from plane_kernels.types import Corners, Faces, FloatArray, IntArray
from typed_kernels.jit import kernel, vector

ROUNDING = 1e-3  # [m] largest rounding error of a bound


class SegmentBox(NamedTuple):
    """Bounding box of all segments from one cloud to the next: centre, half width and half height [m]."""

    x: float
    y: float
    wide: float
    high: float


@vector
def least_and_most(row: FloatArray) -> tuple[float, float]:
    """The smallest and the largest number of a row."""
    low, high = math.inf, -math.inf
    for x in row:
        low, high = min(low, x), max(high, x)
    return low, high


@kernel
def enclose(mean: FloatArray, off: FloatArray, box: FloatArray) -> None:
    """Fill ``box`` (T+1, 4) with bounding boxes of the clouds ``mean`` (T+1, 2) + ``off`` (T+1, 2, n) [m].

    A box is its centre (x, y), half width and half height.
    """
    for t in range(len(mean)):
        for c in range(2):
            low, high = least_and_most(off[t, c])
            box[t, c], box[t, 2 + c] = mean[t, c] + 0.5 * (low + high), 0.5 * (high - low)


@kernel
def list_entered(faces: Faces, floor: float, box: FloatArray, first: IntArray, entered: IntArray) -> None:
    """List in ``entered`` the polygons in which some point of a cloud may lie ``floor`` [m] deep or more.

    The polygons of cloud t are ``entered[first[t]:first[t + 1]]``; a negative depth is a distance outside.
    """
    count = 0
    for t in range(len(box)):
        first[t] = count
        for part in range(len(faces.ptr) - 1):
            limit = math.inf
            for j in range(faces.ptr[part], faces.ptr[part + 1]):
                nx, ny = faces.normal[j, 0], faces.normal[j, 1]
                slack = faces.offset[j] - nx * box[t, 0] - ny * box[t, 1]
                limit = min(limit, slack + abs(nx) * box[t, 2] + abs(ny) * box[t, 3])
                if limit < floor - ROUNDING:
                    break
            if limit >= floor - ROUNDING:
                entered[count] = part
                count += 1
    first[len(box)] = count


@kernel
def segment_box(box: FloatArray, t: int) -> SegmentBox:
    """The box of the segments from cloud ``t`` to the next, from the boxes of the clouds (T+1, 4)."""
    west = min(box[t, 0] - box[t, 2], box[t + 1, 0] - box[t + 1, 2])
    east = max(box[t, 0] + box[t, 2], box[t + 1, 0] + box[t + 1, 2])
    south = min(box[t, 1] - box[t, 3], box[t + 1, 1] - box[t + 1, 3])
    north = max(box[t, 1] + box[t, 3], box[t + 1, 1] + box[t + 1, 3])
    return SegmentBox(0.5 * (west + east), 0.5 * (south + north), 0.5 * (east - west), 0.5 * (north - south))


@kernel
def face_gap(faces: Faces, j: int, box: SegmentBox, sign: float) -> float:
    """Signed distance [m] of ``box`` from the line of face ``j``: largest for ``sign`` 1, least for -1."""
    nx, ny = faces.normal[j, 0], faces.normal[j, 1]
    return float(nx * box.x + ny * box.y + sign * (abs(nx) * box.wide + abs(ny) * box.high) - faces.offset[j])


@kernel
def place_end(mean: FloatArray, x: FloatArray, y: FloatArray, end: FloatArray) -> None:
    """Fill ``end`` (2, n) with the positions ``mean`` (2,) + (``x``, ``y``)."""
    east, north = mean[0], mean[1]
    for i in range(len(x)):
        end[0, i] = east + x[i]
        end[1, i] = north + y[i]


@kernel
def raise_to_face(normal: FloatArray, offset: float, ends: FloatArray, gap: FloatArray) -> None:
    """Raise ``gap`` (n,) to the distance of the closer end of each segment (4, n) from the line of a face."""
    nx, ny, x0, y0, x1, y1 = normal[0], normal[1], ends[0], ends[1], ends[2], ends[3]
    for i in range(len(gap)):
        a = nx * x0[i] + ny * y0[i] - offset
        b = nx * x1[i] + ny * y1[i] - offset
        gap[i] = max(gap[i], min(a, b))


@kernel
def least_gaps(faces: Faces, part: int, box: SegmentBox, ends: FloatArray, gap: FloatArray) -> None:
    """Fill ``gap`` (n,) with lower limits of the distances of segments (4, n) in ``box`` from a polygon [m].

    They are the largest distances from the line of a face. Faces that are farther behind another one for all
    segments are left out.
    """
    least = -math.inf
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        least = max(least, face_gap(faces, j, box, -1.0))
    gap[:] = -math.inf
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        if face_gap(faces, j, box, 1.0) >= least:
            raise_to_face(faces.normal[j], faces.offset[j], ends, gap)


@kernel
def list_met(
    faces: Faces, corners: Corners, reach: float, box: FloatArray, first: IntArray, met: IntArray
) -> None:
    """List in ``met`` the polygons to which some segment may be closer than ``reach`` [m].

    The polygons near the segments from cloud t are ``met[first[t]:first[t + 1]]``.
    """
    count = 0
    for t in range(len(box) - 1):
        first[t] = count
        around = segment_box(box, t)
        for part in range(len(faces.ptr) - 1):
            dx = max(abs(corners.middle[part, 0] - around.x) - around.wide, 0.0)
            dy = max(abs(corners.middle[part, 1] - around.y) - around.high, 0.0)
            gap = math.sqrt(dx * dx + dy * dy) - corners.radius[part]
            for j in range(faces.ptr[part], faces.ptr[part + 1]):
                if gap >= reach + ROUNDING:
                    break
                gap = max(gap, face_gap(faces, j, around, -1.0))
            if gap < reach + ROUNDING:
                met[count] = part
                count += 1
    first[len(box) - 1] = count
