"""Intervals for means over forecast cycles, by a circular block bootstrap.

Errors of successive cycles are correlated, so blocks of successive cycles are drawn with replacement; the
last cycle is followed by the first one (Politis and Romano 1992). Blocks have n^(1/3) of n cycles (Hall,
Horowitz, Jing 1995). With few blocks, bootstrap intervals are too narrow. So the distances of the quantiles
from the estimate are multiplied by the ratio of Student's quantile, with one degree of freedom less than the
number of blocks, to the normal quantile.
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
    """Settings of the bootstrap.

    Attributes
    ----------
    seed : int
        Seed of the random blocks; the same seed gives the same intervals.
    block : int or None
        Number of cycles in a block; None: n^(1/3) of n cycles.
    """

    seed: int = 0
    block: int | None = None

    def length(self, cycles: int) -> int:
        """Number of cycles in a block if there are ``cycles`` in total."""
        wanted = int(np.ceil(cycles ** (1 / 3))) if self.block is None else self.block
        return max(1, min(wanted, cycles))

    def means(self, cycles: FloatArray, values: FloatArray) -> FloatArray:
        """Bootstrap replicates (R, V) of the means of ``values`` (P, V); row p belongs to ``cycles[p]``."""
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
        """The interval around ``value`` from its replicates ``drawn`` (R,), of which finite ones are used.

        With ``ratio``, the quantity is positive and the interval is computed for its logarithm. NaN ends if
        there is no interval.
        """
        from scipy.stats import t

        n = len(np.unique(cycles))
        freedom = max(1.0, n / self.length(n) - 1.0)
        stretch = float(t.ppf((1 + LEVEL) / 2, freedom)) / NORMAL_QUANTILE
        finite = drawn[np.isfinite(drawn) & ((drawn > 0) | (not ratio))]
        if not len(finite) or not np.isfinite(value) or (ratio and value <= 0):
            return Interval(value, np.nan, np.nan)
        low, high = np.quantile(finite, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        low, high = min(float(low), value), max(float(high), value)
        if ratio:
            return Interval(value, value * (low / value) ** stretch, value * (high / value) ** stretch)
        return Interval(value, value - stretch * (value - low), value + stretch * (high - value))
