"""Chance constraints of segments, by a sweep of directions: supporting lines of obstacles, and walls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_verify.geometry import Convex

DIRECTIONS, FINER = 1440, 41  # of the first sweep, and of the second about its best one
LEAST = 0.1  # [m²] that the planner adds to every variance
MOST = 40.0  # standard deviations that count as certainty
NEAR = 6.0  # standard deviations up to which the lines of a segment are faces of the bound R
BEHIND = 1e-3  # [m] by which a polygon may reach over a line and still be behind it


def best_lines(part: Convex, x: FloatArray, cov: FloatArray) -> FloatArray:
    """For each segment of ``x`` (T+1, 2): z, the normal and the offset of the best line, (T, 4).

    ``cov`` (T+1, 2, 2) [m²]; z = min over the ends of (c'x - h) / √(c'Σc), h the largest c'v of the corners.
    """
    if not len(part.corners):  # a wall: the half plane beyond a side of the map
        normal, offset = part.normals[0], part.offsets[0]
        return np.column_stack([
            _deviations(normal[None], offset[None], x, cov)[:, 0],
            np.tile([*normal, offset], (len(x) - 1, 1)),
        ])  # fmt: skip
    angles = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    normals = _units(angles)
    best = angles[_deviations(normals, (part.corners @ normals.T).max(axis=0), x, cov).argmax(axis=1)]
    return np.array(
        [_refined(part, float(angle), x[k : k + 2], cov[k : k + 2]) for k, angle in enumerate(best)]
    )


def _refined(part: Convex, angle: float, x: FloatArray, cov: FloatArray) -> list[float]:
    """z, the normal and the offset of the best line of one segment, with a normal about ``angle``."""
    half, row = 4.0 * np.pi / DIRECTIONS, [0.0]
    for _ in range(3):
        angles = angle + np.linspace(-half, half, FINER)
        normals = _units(angles)
        reach = (part.corners @ normals.T).max(axis=0)
        z = _deviations(normals, reach, x, cov)[0]
        k = int(z.argmax())
        angle, half, row = float(angles[k]), 3.0 * half / FINER, [z[k], *normals[k], reach[k]]
    return [float(value) for value in row]


def with_lines(part: Convex, x: FloatArray, cov: FloatArray) -> Convex:
    """``part`` with the best lines of its near segments as further half planes."""
    if not len(part.corners):  # a wall has only one line
        return part
    rows = best_lines(part, x, cov)
    rows = rows[(rows[:, 0] > 0.0) & (rows[:, 0] < NEAR)]
    return Convex(part.corners, np.vstack([part.normals, rows[:, 1:3]]), np.append(part.offsets, rows[:, 3]))


def _units(angles: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _deviations(normals: FloatArray, offsets: FloatArray, x: FloatArray, cov: FloatArray) -> FloatArray:
    """z of each segment and direction, (T, D)."""
    variance = np.einsum("di,tij,dj->td", normals, cov, normals)
    z = (x @ normals.T - offsets) / np.sqrt(np.maximum(variance, 0.0) + LEAST)
    return np.asarray(np.minimum(np.minimum(z[:-1], z[1:]), MOST), float)


def segment_risks(parts: Sequence[Convex], x: FloatArray, cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """z of each segment and part (T, m), and Σ_lines Q(z) of each segment (T,).

    A part behind the line of a closer one adds nothing.
    """
    lines = np.stack([best_lines(part, x, cov) for part in parts], axis=1)
    risks = np.zeros(len(lines))
    for t, rows in enumerate(lines):
        left = list(np.argsort(rows[:, 0], kind="stable"))
        while left:
            z, normal, offset = rows[left[0], 0], rows[left[0], 1:3], rows[left[0], 3]
            risks[t] += ndtr(-z)
            left = [k for k in left[1:] if not _behind(parts[k], normal, offset)]
    return lines[:, :, 0], risks


def _behind(part: Convex, normal: FloatArray, offset: float) -> bool:
    """Whether a polygon reaches no farther along ``normal`` than ``offset`` [m]; a wall has no end."""
    return bool(len(part.corners)) and bool((part.corners @ normal).max() <= offset + BEHIND)


def outline_gap(corners: FloatArray, point: FloatArray) -> float:
    """Distance of ``point`` from a polygon, not necessarily convex, [m]; 0 inside, by crossings of a ray."""
    a, b = corners - point, np.roll(corners, -1, axis=0) - point
    up = (a[:, 1] > 0.0) != (b[:, 1] > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        east = a[:, 0] - a[:, 1] * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    if (up & (east > 0.0)).sum() % 2:
        return 0.0
    along = b - a
    share = -np.einsum("ij,ij->i", a, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    nearest = a + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.hypot(*nearest.T).min())
