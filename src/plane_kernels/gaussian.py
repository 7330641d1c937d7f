"""The normal distribution in the plane, its update by a measurement, and bounds for convex polygons."""

from __future__ import annotations

import math
from typing import NamedTuple

from plane_kernels.types import Cov, Faces, Gaussian, IntArray, Linear
from typed_kernels.jit import inlined, kernel

SQRT_HALF = math.sqrt(0.5)


class FixWeights(NamedTuple):
    """How a measured position with the error R updates a position with the covariance Σ: L L' = Σ + R, and K.

    ``gain`` is K = Σ (Σ + R)⁻¹; L is lower triangular [m].
    """

    l00: float
    l10: float
    l11: float
    gain: Linear


@kernel
def fix_weights(cov: Cov, error: Cov) -> FixWeights:
    """The weights of a measurement with the error ``error`` = R [m²] for a position with ``cov`` = Σ [m²].

    Eq. (M26) of docs/mathematics.md.
    """
    xx, xy, yy = cov
    a, b, c = xx + error.xx, xy + error.xy, yy + error.yy
    l00 = math.sqrt(a)
    l10 = b / l00
    l11 = math.sqrt(max(c - l10 * l10, 1e-9 * c))
    det = a * c - b * b
    gain = Linear(
        (xx * c - xy * b) / det, (xy * a - xx * b) / det, (xy * c - yy * b) / det, (yy * a - xy * b) / det
    )
    return FixWeights(l00, l10, l11, gain)


@kernel
def tail(distance: float, variance: float) -> float:
    """P(N(0, variance) > distance) = 1 - Φ(distance / σ); for variance 0, 0 if distance >= 0, else 1."""
    if variance <= 0.0:
        return 0.0 if distance >= 0.0 else 1.0
    return 0.5 * math.erfc(SQRT_HALF * distance / math.sqrt(variance))


@inlined
def variance_along(nx: float, ny: float, cov: Cov) -> float:
    """n' Σ n, the variance along the unit vector n."""
    return nx * nx * cov.xx + 2.0 * nx * ny * cov.xy + ny * ny * cov.yy


@kernel
def outside(faces: Faces, part: int, here: Gaussian) -> float:
    """Upper bound on P(position not in the polygon): Σ_j (1 - Φ((b_j - a_j' x) / σ_j)), Eq. (6).

    Eq. (M34) of docs/mathematics.md.
    """
    total = 0.0
    normal, offset = faces.normal, faces.offset
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = normal[j, 0], normal[j, 1]
        gap = offset[j] - nx * here.mean.x - ny * here.mean.y
        total += tail(gap, variance_along(nx, ny, here.cov))
    return total


@kernel
def region_missed(faces: Faces, owner: IntArray, atom: int, here: Gaussian) -> float:
    """Upper bound on P(position not in the region), at most 1: the least over its convex parts.

    These are the parts of ``faces`` with ``owner`` equal to ``atom``.
    """
    best = 1.0
    for part in range(len(owner)):
        if owner[part] == atom:
            best = min(best, outside(faces, part, here))
    return best


@kernel
def inside(faces: Faces, part: int, here: Gaussian) -> float:
    """Upper bound on P(position in the polygon): min_k Φ((d_k - c_k' x) / σ_k), Eq. (10).

    Eq. (M34) of docs/mathematics.md.
    """
    best = 1.0
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = faces.normal[k, 0], faces.normal[k, 1]
        gap = nx * here.mean.x + ny * here.mean.y - faces.offset[k]
        best = min(best, tail(gap, variance_along(nx, ny, here.cov)))
    return best
