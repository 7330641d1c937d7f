"""The normal distribution and the paper's probabilities, Eqs. (6) and (10)."""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import Faces, Regions
from pareto_ltl.kernels.jit import kernel

SQRT_HALF = math.sqrt(0.5)


@kernel
def tail(distance: float, variance: float) -> float:
    """P(N(0, variance) > distance) = 1 - Φ(distance / σ); a step function where variance is 0."""
    if variance <= 0.0:
        return 0.0 if distance >= 0.0 else 1.0
    return 0.5 * math.erfc(SQRT_HALF * distance / math.sqrt(variance))


@kernel
def variance_along(nx: float, ny: float, cxx: float, cxy: float, cyy: float) -> float:
    """n' Σ n."""
    return nx * nx * cxx + 2.0 * nx * ny * cxy + ny * ny * cyy


@kernel
def outside(faces: Faces, part: int, x: float, y: float, cxx: float, cxy: float, cyy: float) -> float:
    """Bound on P(position not in the polygon): Σ_j (1 - Φ((b_j - a_j' x) / σ_j)), Eq. (6)."""
    total = 0.0
    normal, offset = faces.normal, faces.offset
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = normal[j, 0], normal[j, 1]
        total += tail(offset[j] - nx * x - ny * y, variance_along(nx, ny, cxx, cxy, cyy))
    return total


@kernel
def missed(regions: Regions, atom: int, x: float, y: float, cxx: float, cxy: float, cyy: float) -> float:
    """The same for a region of several convex parts: its best part, at most 1."""
    best = 1.0
    for part in range(len(regions.atom)):
        if regions.atom[part] == atom:
            best = min(best, outside(regions.faces, part, x, y, cxx, cxy, cyy))
    return best


@kernel
def inside(faces: Faces, part: int, x: float, y: float, cxx: float, cxy: float, cyy: float) -> float:
    """Bound on P(position in the polygon): min_k Φ((d_k - c_k' x) / σ_k), Eq. (10)."""
    best = 1.0
    for k in range(faces.ptr[part], faces.ptr[part + 1]):
        nx, ny = faces.normal[k, 0], faces.normal[k, 1]
        best = min(best, tail(nx * x + ny * y - faces.offset[k], variance_along(nx, ny, cxx, cxy, cyy)))
    return best
