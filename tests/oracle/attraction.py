"""The attraction of landmarks and its slope in plain NumPy, eq. (M75)."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

NEAREST, SHARES = 3, (0.5, 1.0)


def attraction(marks, x, off, width, worth):
    """Value, gradient (T+1, 2) and Hessian blocks xx, xy, yy (T+1, 3) for ``x`` + ``off`` (T+1, 2, n)."""
    value, gradient, hessian = 0.0, np.zeros((len(x), 2)), np.zeros((len(x), 3))
    n, flights = off.shape[2], np.arange(off.shape[2])
    for corners in marks:
        along = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        offsets = (normals * corners).sum(axis=1)
        ends = np.linalg.norm(x - corners.mean(axis=0), axis=1)
        near = np.argsort(ends[:-1] + ends[1:], kind="stable")[:NEAREST]
        legs, shares = np.repeat(near, len(SHARES)), np.tile(SHARES, len(near))
        s = shares[:, None, None]
        at = (1.0 - s) * (x[legs, :, None] + off[legs]) + s * (x[legs + 1, :, None] + off[legs + 1])
        gap = offsets[None, :, None] - normals @ at
        deep = gap.min(axis=1)
        best = deep.argmax(axis=0)
        normal = normals[gap[best, :, flights].argmin(axis=1)]
        missed = expit(-deep[best, flights] / width)
        value += worth * missed.mean()
        slope = worth / n * missed * (1.0 - missed) / width
        bend = slope * np.maximum(1.0 - 2.0 * missed, 0.0) / width
        nx, ny = normal.T
        curve = bend[:, None] * np.column_stack([nx * nx, nx * ny, ny * ny])
        for t, weight in ((legs[best], 1.0 - shares[best]), (legs[best] + 1, shares[best])):
            np.add.at(gradient, t, (weight * slope)[:, None] * normal)
            np.add.at(hessian, t, weight[:, None] * curve)
    return value, gradient, hessian
