"""Moments of a Gaussian within a cell of measured positions.

With (a, l) ~ N(m, S) the distances along and left, the moments in a box come from a Gaussian truncated in one
direction where only that one is limited, and the other follows by linear regression. In a box that is
limited in both, a is integrated over by Gauss-Legendre quadrature, and l given a is the truncated
N(m_l + b (a - m_a), S_ll - b S_al), b = S_al / S_aa.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.extend import Cell
from pareto_ltl.support.arrays import FloatArray

Ends = tuple[float, float]
EVERYWHERE: Ends = (-math.inf, math.inf)
FARTHEST = 9.0  # standard deviations beyond which a Gaussian has no probability that counts
NODES = 200  # of the quadrature


class Moments(NamedTuple):
    """Probability of a cell, and mean (2,) and covariance (2, 2) of the distances in it."""

    share: float
    mean: FloatArray
    cov: FloatArray


def cell_moments(cell: Cell, mean: FloatArray, cov: FloatArray) -> Moments:
    """The moments of N(``mean`` (2,), ``cov`` (2, 2)) in ``cell``; ValueError if it has no probability.

    Eq. (M79) of docs/mathematics_methods.md.
    """
    limited = [ends != EVERYWHERE for ends in (cell.along, cell.left)]
    if all(limited):
        return _box_moments(cell, mean, cov)
    i = int(limited[1])  # the distance that is limited; none: the other one is not either
    share, m, v = truncated(mean[i], math.sqrt(cov[i, i]), (cell.along, cell.left)[i])
    if share <= 0.0:
        raise ValueError(f"no position lies {cell.words}")
    slope = cov[:, i] / cov[i, i]
    return Moments(share, mean + slope * (m - mean[i]), cov - np.outer(slope, slope) * (cov[i, i] - v))


def _box_moments(cell: Cell, mean: FloatArray, cov: FloatArray) -> Moments:
    sd = math.sqrt(cov[0, 0])
    low, high = (float(np.clip(end, mean[0] - FARTHEST * sd, mean[0] + FARTHEST * sd)) for end in cell.along)
    node, weight = np.polynomial.legendre.leggauss(NODES)
    a = 0.5 * (low + high) + 0.5 * (high - low) * node
    density = (
        0.5 * (high - low) * weight * np.exp(-0.5 * ((a - mean[0]) / sd) ** 2) / sd / math.sqrt(2 * math.pi)
    )
    slope = cov[0, 1] / cov[0, 0]
    rest = math.sqrt(max(cov[1, 1] - slope * cov[0, 1], 0.0))
    rows = [truncated(mean[1] + slope * (here - mean[0]), rest, cell.left) for here in a.tolist()]
    p, m, v = (np.array(column) for column in zip(*rows, strict=True))
    w = density * p
    share = float(w.sum())
    if share <= 0.0:
        raise ValueError(f"no position lies {cell.words}")
    w = w / share
    middle = np.array([w @ a, w @ m])
    da, dm = a - middle[0], m - middle[1]
    both = float(w @ (da * dm))
    inside = np.array([[w @ da**2, both], [both, w @ (v + dm**2)]])
    return Moments(share, middle, inside)


def truncated(mean: float, sd: float, ends: Ends) -> tuple[float, float, float]:
    """Probability that N(``mean``, ``sd``²) lies between ``ends``, and its mean and variance there.

    With α, β the ends in standard deviations and Z = Φ(β) - Φ(α),

        E = mean + sd (φ(α) - φ(β)) / Z,    Var = sd² (1 + (α φ(α) - β φ(β)) / Z - ((φ(α) - φ(β)) / Z)²).

    Both tails are computed on the side where Φ is small, so that Z keeps its digits.
    """
    from scipy.special import ndtr

    if sd <= 0.0:
        return (1.0, mean, 0.0) if ends[0] <= mean < ends[1] else (0.0, mean, 0.0)
    a, b = ((end - mean) / sd for end in ends)
    share = float(ndtr(-a) - ndtr(-b)) if a > 0.0 else float(ndtr(b) - ndtr(a))
    if share < 1e-300:
        return 0.0, min(max(mean, ends[0]), ends[1]), 0.0
    fa, fb = (math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) if math.isfinite(z) else 0.0 for z in (a, b))
    za, zb = (z * f if math.isfinite(z) else 0.0 for z, f in ((a, fa), (b, fb)))
    shift = (fa - fb) / share
    return share, mean + sd * shift, sd * sd * max(1.0 + (za - zb) / share - shift * shift, 0.0)
