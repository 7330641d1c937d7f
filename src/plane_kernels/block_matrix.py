"""Symmetric positive definite block-tridiagonal matrices with blocks of 2 x 2.

Diagonal block t is row t (xx, xy, yy) of ``pivot`` (T+1, 3); the block below it is ``below[t]`` (2, 2).
"""

from __future__ import annotations

from plane_kernels.types import FloatArray
from typed_kernels.jit import kernel


@kernel
def add_block(pivot: FloatArray, t: int, left: FloatArray, m: tuple[float, float, float]) -> None:
    """Add left' M left to diagonal block ``t``; M is symmetric, ``m`` = (xx, xy, yy), ``left`` (2, 2)."""
    for k in range(3):
        i, j = (0, 0) if k == 0 else ((0, 1) if k == 1 else (1, 1))
        mx = m[0] * left[0, j] + m[1] * left[1, j]
        my = m[1] * left[0, j] + m[2] * left[1, j]
        pivot[t, k] += left[0, i] * mx + left[1, i] * my


@kernel
def eliminate(pivot: FloatArray, below: FloatArray) -> bool:
    """Block Cholesky: replace the diagonal blocks by the inverses of the pivots.

    Returns False if a pivot is not positive definite.
    """
    for t in range(len(pivot)):
        xx, xy, yy = pivot[t, 0], pivot[t, 1], pivot[t, 2]
        if t > 0:
            B, a, b, c = below[t - 1], pivot[t - 1, 0], pivot[t - 1, 1], pivot[t - 1, 2]
            p, q = B[0, 0] * a + B[0, 1] * b, B[0, 0] * b + B[0, 1] * c
            u, v = B[1, 0] * a + B[1, 1] * b, B[1, 0] * b + B[1, 1] * c
            xx -= p * B[0, 0] + q * B[0, 1]
            xy -= p * B[1, 0] + q * B[1, 1]
            yy -= u * B[1, 0] + v * B[1, 1]
        det = xx * yy - xy * xy
        if not (det > 0.0 and xx > 0.0):
            return False
        pivot[t, 0], pivot[t, 1], pivot[t, 2] = yy / det, -xy / det, xx / det
    return True


@kernel
def substitute(pivot: FloatArray, below: FloatArray, b: FloatArray) -> None:
    """Solve in place for the first two columns of ``b`` (T+1, 3), after :func:`eliminate`."""
    last = len(b) - 1
    for t in range(last):
        B, x, y = below[t], b[t, 0], b[t, 1]
        u, v = pivot[t, 0] * x + pivot[t, 1] * y, pivot[t, 1] * x + pivot[t, 2] * y
        b[t + 1, 0] -= B[0, 0] * u + B[0, 1] * v
        b[t + 1, 1] -= B[1, 0] * u + B[1, 1] * v
    for t in range(last, -1, -1):
        x, y = b[t, 0], b[t, 1]
        if t < last:
            B = below[t]
            x -= B[0, 0] * b[t + 1, 0] + B[1, 0] * b[t + 1, 1]
            y -= B[0, 1] * b[t + 1, 0] + B[1, 1] * b[t + 1, 1]
        b[t, 0], b[t, 1] = pivot[t, 0] * x + pivot[t, 1] * y, pivot[t, 1] * x + pivot[t, 2] * y
