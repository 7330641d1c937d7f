"""Pairs of wind fields: moments of their differences, and intervals for means over forecast cycles.

Intervals are from a circular block bootstrap. Errors of successive cycles are correlated, so blocks of
successive cycles are drawn with replacement; the last cycle is followed by the first one (Politis and Romano
1992). Blocks have n^(1/3) of n cycles (Hall, Horowitz, Jing 1995). With few blocks, bootstrap intervals are
too narrow. So the distances of the quantiles from the estimate are multiplied by the ratio of Student's
quantile, with one degree of freedom less than the number of blocks, to the normal quantile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import iso, node_rows, on_sphere, shared_nodes
from pareto_ltl.wind.snapshots import Snapshot

EARTH_RADIUS = 6_371_000.0  # [m]
FEWEST_NODES = 12
CORRELATED_NODES = 400  # largest number of nodes for correlations, drawn once
BINS = 15  # of distance, for correlations
FARTHEST = 1_500_000.0  # distance of the last bin [m]
REPLICATES = 1000
LEVEL = 0.95
NORMAL_QUANTILE = 1.959963984540054  # of LEVEL


# --- intervals -------------------------------------------------------------------------------


class Interval(NamedTuple):
    """An estimate with the ends of its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def root(self) -> Interval:
        """The interval of the square root; 0 for a negative number."""
        return Interval(*(float(np.sqrt(max(v, 0.0))) for v in self))


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

    def estimate(
        self,
        cycles: FloatArray,
        values: FloatArray,
        statistic: Callable[[FloatArray], FloatArray] = lambda means: means[:, 0],
        *,
        ratio: bool,
    ) -> Interval:
        """``statistic`` of the means of ``values``, with its interval.

        Parameters
        ----------
        cycles : (P,) float
            The cycle of each row of ``values``.
        values : (P,) or (P, V) float
        statistic : callable
            From means (R, V) to estimates (R,).
        ratio : bool
            Whether the quantity is positive and the interval is computed for its logarithm.

        Finite replicates are used; the ends are NaN if there is no interval.
        """
        value = float(statistic(np.atleast_1d(values.mean(axis=0))[None])[0])
        drawn = statistic(self.means(cycles, values.reshape(len(values), -1)))
        finite = drawn[np.isfinite(drawn) & ((drawn > 0) | (not ratio))]
        if not len(finite) or not np.isfinite(value) or (ratio and value <= 0):
            return Interval(value, np.nan, np.nan)
        low, high = np.quantile(finite, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        low, high, stretch = min(float(low), value), max(float(high), value), self._stretch(cycles)
        if ratio:
            return Interval(value, value * (low / value) ** stretch, value * (high / value) ** stretch)
        return Interval(value, value - stretch * (value - low), value + stretch * (high - value))

    def means(self, cycles: FloatArray, values: FloatArray) -> FloatArray:
        """Bootstrap replicates (R, V) of the means of ``values`` (P, V)."""
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

    def _stretch(self, cycles: FloatArray) -> float:
        from scipy.stats import t

        n = len(np.unique(cycles))
        return float(t.ppf((1 + LEVEL) / 2, max(1.0, n / self.length(n) - 1.0))) / NORMAL_QUANTILE


# --- moments ---------------------------------------------------------------------------------


class PairMoments(NamedTuple):
    """Second moments of difference fields, one row for each pair of fields.

    Attributes
    ----------
    cycles : (P,) float
        Cycle of each pair, the unit of the bootstrap [s since 1970].
    table : (P, 1 + B) float
        Mean square of a component over the area, and mean products of the differences at two nodes, in bins
        of their distance [m²/s²].
    """

    cycles: FloatArray
    table: FloatArray

    @property
    def square(self) -> FloatArray:
        """Mean square of a component over the area, (P,) [m²/s²]."""
        return self.table[:, 0].copy()


class MatchedFields:
    """Winds by valid time and lead [s], at common nodes inside an outline, weighted by area.

    Attributes
    ----------
    nodes : (n, 2) float
        Longitude and latitude [deg].
    weights : (n,) float
        Proportional to cos(latitude), with sum 1.
    winds : mapping
        (time, lead) to (n, 2) winds [m/s].
    """

    def __init__(self, snapshots: Sequence[Snapshot], area: Sequence[Sequence[float]] | None) -> None:
        points = [snap.points for snap in snapshots]
        self.nodes = shared_nodes(points, area)
        if len(self.nodes) < FEWEST_NODES:
            found = f"{len(self.nodes)} of {len(shared_nodes(points))} nodes that all times share"
            raise DataError(
                f"{found} lie in the area, expected at least {FEWEST_NODES}; name another --area, or files "
                "of one grid that cover it"
            )
        cosine = np.cos(np.deg2rad(self.nodes[:, 1]))
        self.weights = cosine / cosine.sum()
        self.winds: dict[tuple[float, float], FloatArray] = {}
        known, rows = self.nodes, np.arange(len(self.nodes))
        for snap in snapshots:
            key = (snap.time, snap.lead)
            if key in self.winds:
                moment = f"{iso(snap.time)} with a lead of {snap.lead / 3600:g} h"
                raise DataError(
                    f"{', '.join(file.name for file in snap.files)}: the wind at {moment} occurs twice; "
                    "keep one member"
                )
            if not np.array_equal(known, snap.points):
                known, rows = snap.points, node_rows(snap.points, self.nodes)
            self.winds[key] = snap.winds[rows]

    @property
    def spread(self) -> float:
        """Standard deviation of a component over the nodes of one time, root mean square over times [m/s]."""
        about = [winds - self.weights @ winds for winds in self.winds.values()]
        return float(np.sqrt(np.mean([self.mean_product(field, field) for field in about])))

    def mean_product(self, one: FloatArray, two: FloatArray) -> float:
        """Mean over nodes and components of the product of two fields (n, 2)."""
        return float(self.weights @ (one * two).sum(axis=1)) / 2

    def moments(self, differences: Iterable[tuple[float, FloatArray]]) -> PairMoments:
        """Second moments of difference fields, each given with its cycle."""
        rows = [(cycle, np.append(self.mean_product(d, d), self._products(d))) for cycle, d in differences]
        return PairMoments(np.array([cycle for cycle, _ in rows]), np.stack([row for _, row in rows]))

    @property
    def analyses(self) -> dict[float, FloatArray]:
        """The analyses (lead 0), by time."""
        return {time: field for (time, lead), field in sorted(self.winds.items()) if lead == 0}

    @property
    def forecasts(self) -> Iterator[tuple[float, float, FloatArray]]:
        """Cycle, lead and wind of the forecasts, in the order of their valid times."""
        return ((time - lead, lead, field) for (time, lead), field in sorted(self.winds.items()) if lead > 0)

    @property
    def distances(self) -> FloatArray:
        """Mean distance of the node pairs in each bin, (B,) [m]."""
        return self._bins[2]

    @cached_property
    def _bins(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Indices of the nodes that are compared, the bin of each pair (-1: none), and mean distances [m]."""
        rng = np.random.default_rng(0)
        count = min(CORRELATED_NODES, len(self.nodes))
        chosen = np.sort(rng.choice(len(self.nodes), count, replace=False))
        sphere = on_sphere(self.nodes[chosen])
        chord = np.linalg.norm(sphere[:, None] - sphere[None], axis=-1)
        apart = 2 * EARTH_RADIUS * np.arcsin(np.clip(chord / 2, 0, 1))
        farthest = min(FARTHEST, apart.max() / 2)
        which = np.ceil(apart * BINS / farthest).astype(int) - 1
        which[(which >= BINS) | (apart == 0)] = -1
        used = [k for k in range(BINS) if (which == k).any()]
        bins = np.full_like(which, -1)
        for row, k in enumerate(used):
            bins[which == k] = row
        return chosen, bins, np.array([apart[bins == row].mean() for row in range(len(used))])

    def _products(self, difference: FloatArray) -> FloatArray:
        chosen, bins, distances = self._bins
        field = difference[chosen]
        pairs = field @ field.T / 2
        inside = bins >= 0
        sums = np.bincount(bins[inside], weights=pairs[inside], minlength=len(distances))
        return np.asarray(sums / np.bincount(bins[inside], minlength=len(distances)), float)
