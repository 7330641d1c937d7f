"""Cells of measured positions beside the planned track, and moments of a Gaussian within a cell.

A person applies two distances: along the track from the planned position, ahead of it positive, and to the
left of the track. A cell is a box of the two; it is a half-plane where one of its four ends is finite.

With (a, l) ~ N(m, S) the two distances, the moments in a box come from a Gaussian truncated in one
direction where only that one is limited, and the other follows by linear regression. In a box that is
limited in both, a is integrated over by Gauss-Legendre quadrature, and l given a is the truncated
N(m_l + b (a - m_a), S_ll - b S_al), b = S_al / S_aa.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from careful_io.texts import distance_text
from pareto_ltl.support.arrays import BoolArray, FloatArray

Ends = tuple[float, float]
EVERYWHERE: Ends = (-math.inf, math.inf)
FARTHEST = 9.0  # standard deviations beyond which a Gaussian has no probability that counts
NODES = 200  # of the quadrature


@dataclass(frozen=True, slots=True)
class Cell:
    """Measured positions whose distances ``along`` and ``left`` of the planned track [m] lie in a box.

    A position at the lower end of an interval belongs to it, one at the upper end does not.
    """

    along: Ends = EVERYWHERE
    left: Ends = EVERYWHERE

    def __post_init__(self) -> None:
        for name, (low, high) in (("along", self.along), ("left", self.left)):
            if not low < high:
                raise ValueError(f"a cell needs low < high, got {name} = {low:g} to {high:g}")

    def holds(self, y: FloatArray) -> BoolArray:
        """Which of the distances ``y`` (n, 2) [m], along and left, lie in the cell."""
        return np.asarray(
            (y[:, 0] >= self.along[0]) & (y[:, 0] < self.along[1])
            & (y[:, 1] >= self.left[0]) & (y[:, 1] < self.left[1]), bool
        )  # fmt: skip

    @property
    def words(self) -> str:
        """Where the cell lies, for people: the question to which a position in it is the answer yes."""
        parts = [
            _side(self.left, ("left of", "right of"), "the planned track"),
            _side(self.along, ("ahead of", "behind"), "the planned position (along the track)"),
        ]
        return ", and ".join(filter(None, parts)) or "anywhere"


def _side(ends: Ends, sides: tuple[str, str], what: str) -> str:
    """``more than 3.2 km left of the planned track``; empty without a limit.

    ``sides`` are the words for positive distances and for negative ones.
    """
    low, high = ends
    if high == math.inf:
        return "" if low == -math.inf else _beyond(low, sides, what)
    if low == -math.inf:
        return _beyond(-high, sides[::-1], what)
    if low >= 0.0 or high <= 0.0:
        near, far = sorted((abs(low), abs(high)))
        side = sides[0] if low >= 0.0 else sides[1]
        if near == 0.0:
            return f"{side} {what} by less than {distance_text(far)}"
        return f"between {distance_text(near)} and {distance_text(far)} {side} {what}"
    return f"less than {distance_text(-low)} {sides[1]}, or {distance_text(high)} {sides[0]}, {what}"


def _beyond(low: float, sides: tuple[str, str], what: str) -> str:
    """On the first of ``sides`` of a line that lies ``low`` [m] on that side."""
    if low == 0.0:
        return f"{sides[0]} {what}"
    if low > 0.0:
        return f"more than {distance_text(low)} {sides[0]} {what}"
    return f"{sides[0]} {what}, or less than {distance_text(-low)} {sides[1]} it"


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
