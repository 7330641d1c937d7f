"""Intervals for means over forecast cycles, by a block bootstrap.

Errors of successive cycles are alike, so that whole blocks of cycles are drawn with replacement, the cycles
laid out in a circle (Politis and Romano 1992). Blocks have n^(1/3) of n cycles (Hall, Horowitz, Jing 1995).
A bootstrap of few blocks gives intervals that are too narrow: its quantiles are moved away from the estimate
by the ratio of Student's quantile, with one degree of freedom less than there are blocks, to the normal one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.support.arrays import FloatArray

REPLICATES = 1000
LEVEL = 0.95
NORMAL_QUANTILE = 1.959963984540054  # of LEVEL


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Resampling:
    """What draws blocks of cycles.

    Attributes
    ----------
    seed : int
        The same seed gives the same intervals.
    block : int or None
        Cycles of a block; None: n^(1/3) of n cycles.
    """

    seed: int = 0
    block: int | None = None

    def length(self, cycles: int) -> int:
        """Cycles of a block, of ``cycles`` in all."""
        wanted = int(np.ceil(cycles ** (1 / 3))) if self.block is None else self.block
        return max(1, min(wanted, cycles))

    def means(self, cycles: FloatArray, values: FloatArray) -> FloatArray:
        """Means of ``values`` (P, V), each of a cycle in ``cycles`` (P,), over drawn cycles: (R, V)."""
        _, place = np.unique(cycles, return_inverse=True)
        n = int(place.max()) + 1
        length = self.length(n)
        rng = np.random.default_rng(SeedSequence(self.seed))
        first = rng.integers(n, size=(REPLICATES, -(-n // length)))
        drawn = ((first[:, :, None] + np.arange(length)) % n).reshape(REPLICATES, -1)[:, :n]
        counts = np.zeros((REPLICATES, n))
        np.add.at(counts, (np.arange(REPLICATES)[:, None], drawn), 1.0)
        weights = counts[:, place]
        return np.asarray(weights @ values / weights.sum(axis=1, keepdims=True), float)

    def interval(self, cycles: FloatArray, value: float, drawn: FloatArray, *, ratio: bool) -> Interval:
        """The interval about ``value`` from its replicates ``drawn`` (R,), without those that are not finite.

        ``ratio``: the quantity is positive, and its logarithm is what is spread about the estimate.
        """
        from scipy.stats import t

        n = len(np.unique(cycles))
        freedom = max(1.0, n / self.length(n) - 1.0)
        stretch = float(t.ppf((1 + LEVEL) / 2, freedom)) / NORMAL_QUANTILE
        kept = drawn[np.isfinite(drawn) & ((drawn > 0) | (not ratio))]
        if not len(kept) or not np.isfinite(value) or (ratio and value <= 0):
            return Interval(value, np.nan, np.nan)
        low, high = np.quantile(kept, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        low, high = min(float(low), value), max(float(high), value)
        if ratio:
            return Interval(value, value * (low / value) ** stretch, value * (high / value) ** stretch)
        return Interval(value, value - stretch * (value - low), value + stretch * (high - value))


__all__ = ["Interval", "Resampling"]
