"""The exact probability that a Gaussian position lies in a polygon."""

from __future__ import annotations

import math

import numpy as np

from plane_kernels.types import Corners, Cov, FloatArray, Gaussian, Point
from typed_kernels.jit import allocating, inlined, kernel, vector

DEEP = 8.3  # exp(-x²/2) is below 1e-15 from here on
TURN = 2.0 * math.pi
BESIDE = 1e-9  # standard deviations by which a mean is moved off a corner

# Gauss-Legendre on [0, 1]. Twelve nodes give Owen's T to 1e-16 for |a| ≤ 1, since the interval is cut where
# the integrand is negligible.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS

PER_LN2, LN2_HIGH, LN2_LOW = 1.0 / math.log(2.0), 0.6931471803691238, 1.9082149292705877e-10
INVERSE_FACTORIALS = tuple(1.0 / math.factorial(i) for i in range(13, -1, -1))


@kernel
def owens_t(h: float, a: float, q: float) -> float:
    """Owen's T for h ≥ 0 and q = Q(h) (Owen, Ann. Math. Statist. 27, 1956, doi:10.1214/aoms/1177728074),

        T(h, a) = 1/2π ∫_0^a exp(-h² (1 + t²) / 2) / (1 + t²) dt.

    T is odd in a; beyond |a| = 1 it is T(h, a) = ½ (Q(h) + Q(a h)) - Q(h) Q(a h) - T(a h, 1/a), Q = 1 - Φ.

    Eq. (M35) of docs/mathematics.md.
    """
    b = abs(a)
    if h > DEEP:
        return 0.0
    if b <= 1.0:
        t = _owens_integral(h, b)
    elif b == math.inf:
        t = 0.5 * q
    else:
        r = _upper_tail(b * h)
        t = 0.5 * (q + r) - q * r - _owens_integral(b * h, 1.0 / b)
    return t if a >= 0.0 else -t


@vector
def _owens_integral(h: float, a: float) -> float:
    """1/2π ∫_0^a exp(-h² (1 + t²) / 2) / (1 + t²) dt, for 0 ≤ a ≤ 1.

    The loop is vectorised, which a call of the library's exp would prevent: 11 instead of 51 ns.
    """
    if h > DEEP:
        return 0.0
    b = a if a * h <= DEEP else DEEP / h
    total, half = 0.0, -0.5 * h * h
    for i in range(len(NODES)):
        t = b * NODES[i]
        s = 1.0 + t * t
        total += WEIGHTS[i] * _decay(half * s) / s
    return total * b / TURN


@inlined
def _decay(x: float) -> float:
    """exp(x) for -700 < x ≤ 0 to 2 units in the last place, without a branch or a call.

    2^k times a polynomial in x - k ln 2, where k is the nearest whole number to x / ln 2.
    """
    k = math.floor(x * PER_LN2 + 0.5)
    r = x - k * LN2_HIGH - k * LN2_LOW
    p = INVERSE_FACTORIALS[0]
    for c in INVERSE_FACTORIALS[1:]:
        p = p * r + c
    return p * np.int64((np.int64(k) + 1023) << 52).view(np.float64)


@kernel
def _upper_tail(h: float) -> float:
    return 0.5 * math.erfc(h / math.sqrt(2.0))


@kernel
def polygon_probability(polygons: Corners, part: int, here: Gaussian) -> float:
    """P(position in a convex polygon), exact.

    In coordinates where the position is standard normal, the origin and an edge at distance h, with ends v1
    and v2 along it, form a triangle of probability angle / 2π - T(h, v2 / h) + T(h, v1 / h), which is
    subtracted if the origin is outside the edge. The angles of all edges sum to 2π inside the polygon, else
    to 0.

    Eq. (M35) of docs/mathematics.md.
    """
    found = _probability(polygons, part, here)
    if found >= 0.0:
        return found
    (x, y), cov = here
    aside = BESIDE * math.sqrt(cov.xx + cov.yy)
    return max(_probability(polygons, part, Gaussian(Point(x + aside, y + 0.7 * aside), cov)), 0.0)


@kernel
def _probability(polygons: Corners, part: int, here: Gaussian) -> float:
    """The probability; -1 if the mean is a corner, where the angles of two edges are not defined."""
    corner, first, last = polygons.corner, polygons.ptr[part], polygons.ptr[part + 1]
    x, y = here.mean
    cxx, cxy, cyy = here.cov
    a = math.sqrt(cxx)
    b = cxy / a
    c = math.sqrt(max(cyy - b * b, 1e-12 * cyy))
    total, within = 0.0, 1.0
    dx, dy = corner[last - 1, 0] - x, corner[last - 1, 1] - y
    px, py = dx / a, (dy - b * dx / a) / c
    for k in range(first, last):
        dx, dy = corner[k, 0] - x, corner[k, 1] - y
        if dx == 0.0 and dy == 0.0:
            return -1.0
        qx, qy = dx / a, (dy - b * dx / a) / c
        ex, ey = qx - px, qy - py
        size = math.sqrt(ex * ex + ey * ey)
        if size > 0.0:
            ex, ey = ex / size, ey / size
            h = px * ey - py * ex
            v = px * ex + py * ey
            if h <= 0.0:
                within = 0.0
            g = max(abs(h), 1e-300)
            if g <= DEEP:
                q = _upper_tail(g)
                share = owens_t(g, (v + size) / g, q) - owens_t(g, v / g, q)
                total += share if h > 0.0 else -share
        px, py = qx, qy
    return min(max(within - total, 0.0), 1.0)


@allocating
def polygon_probabilities(polygons: Corners, x: FloatArray, cov: FloatArray) -> FloatArray:
    """:func:`polygon_probability` of the first polygon, (n,), for rows of ``x`` (n, 2) and ``cov`` (n, 3)."""
    found = np.empty(len(x))
    for i in range(len(x)):
        here = Gaussian(Point(x[i, 0], x[i, 1]), Cov(cov[i, 0], cov[i, 1], cov[i, 2]))
        found[i] = polygon_probability(polygons, 0, here)
    return found


@allocating
def owens_ts(h: FloatArray, a: FloatArray) -> FloatArray:
    """:func:`owens_t` for every pair of ``h`` and ``a`` (n,): (n,)."""
    found = np.empty(len(h))
    for i in range(len(h)):
        found[i] = owens_t(h[i], a[i], _upper_tail(h[i]))
    return found
