"""Differences of wind fields, and of fields and stations: their moments, and intervals for means over cycles.

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

from careful_io.times import iso
from flight_quantities.sphere import on_sphere
from pareto_ltl import Readings
from pareto_ltl.extend import Snapshot
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from wind_laws.places import node_rows, shared_nodes

EARTH_RADIUS = 6_371_000.0  # [m]
FEWEST_NODES = 12
CORRELATED_NODES = 400  # largest number of nodes for correlations, drawn once
BINS = 15  # of distance, for correlations
FARTHEST = 1_500_000.0  # distance of the last bin [m]
REPLICATES = 1000
LEVEL = 0.95
NORMAL_QUANTILE = 1.959963984540054  # of LEVEL
NEAR = 60_000.0  # [m] between near stations, half the spacing of a one-degree grid
FEWEST_TIMES = 5  # of stations and analyses
FEWEST_PAIRS = 20  # of near stations, at each time
SAME_TIME = 1.0  # [s]


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
        import shapely

        shared = shared_nodes([snap.points for snap in snapshots])
        self.nodes = shared[shapely.contains_xy(shapely.Polygon(area), shared)] if area else shared
        if len(self.nodes) < FEWEST_NODES:
            found = f"{len(self.nodes)} of {len(shared)} nodes that all times share"
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
        compared = (which < BINS) & (apart > 0)
        bins = np.full_like(which, -1)
        used, bins[compared] = np.unique(which[compared], return_inverse=True)
        return chosen, bins, np.array([apart[bins == row].mean() for row in range(len(used))])

    def _products(self, difference: FloatArray) -> FloatArray:
        chosen, bins, distances = self._bins
        field = difference[chosen]
        pairs = field @ field.T / 2
        inside = bins >= 0
        sums = np.bincount(bins[inside], weights=pairs[inside], minlength=len(distances))
        return np.asarray(sums / np.bincount(bins[inside], minlength=len(distances)), float)


# --- the error of analyses -------------------------------------------------------------------


def analysis_error(
    snapshots: Sequence[Snapshot], stations: Readings, draws: Resampling
) -> dict[str, float] | str:
    """The error of the analyses among ``snapshots``, as it is written to a file; if unknown, a text why.

    The difference d = report - analysis at a station has two parts: the error of the analysis at the scales
    of its grid, which near stations have in common, and the noise of the station (instrument, surroundings,
    gusts)::

        e²(0) = mean of d_i d_j over pairs of stations nearer than NEAR
        station noise² = mean of d_i² - e²(0)

    Both are for one component, as means over the two. If near stations have a common error for another
    reason, for example a valley, it is counted as error of the analysis.

    ``sd``, ``sd_low``, ``sd_high``: e(0) of one component and its interval [m/s]; ``station_noise``: standard
    deviation of the noise of a station [m/s]; ``times``, ``reports``, ``pairs``: numbers of times, of reports
    and of pairs of near stations that were used.
    """
    analyses = sorted((snap for snap in snapshots if snap.lead == 0), key=lambda snap: snap.time)
    rows = []
    for snap in analyses:
        k = int(np.argmin(np.abs(stations.times - snap.time)))
        if abs(stations.times[k] - snap.time) <= SAME_TIME:
            rows.append((snap.time, *_station_moments(snap, stations.points[k], stations.winds[k])))
    if not rows:
        return (
            f"the data do not suffice: station reports ({_period(stations.times)}) and analyses "
            f"({_period(np.array([snap.time for snap in analyses]))}) have no time in common"
        )
    table = np.array([row for row in rows if row[4] >= FEWEST_PAIRS])
    if len(table) < FEWEST_TIMES:
        return (
            f"the data do not suffice: {len(table)} times have {FEWEST_PAIRS} pairs of stations within "
            f"{NEAR / 1e3:g} km in the area, expected at least {FEWEST_TIMES}"
        )
    times, square, product, reports, pairs = table.T
    error = draws.estimate(times, product, ratio=False).root
    noise = float(np.sqrt(max(square.mean() - product.mean(), 0.0)))
    sd = {"sd": error.value, "sd_low": error.low, "sd_high": error.high}
    counts = {"times": len(table), "reports": int(reports.sum()), "pairs": int(pairs.sum())}
    return sd | {"station_noise": noise} | counts


def _station_moments(snap: Snapshot, places: FloatArray, winds: FloatArray) -> tuple[float, float, int, int]:
    """Mean square of the differences [m²/s²], mean product of near ones [m²/s²], and the number of each."""
    from scipy.interpolate import LinearNDInterpolator

    here = np.asarray(LinearNDInterpolator(snap.points, snap.winds)(places), float)
    inside = np.isfinite(here).all(axis=1)
    difference = winds[inside] - here[inside]
    sphere = on_sphere(places[inside])
    near = sphere @ sphere.T >= np.cos(NEAR / EARTH_RADIUS)
    first, second = np.nonzero(np.triu(near, 1))
    if not len(first):
        return 0.0, 0.0, len(difference), 0
    products = (difference[first] * difference[second]).sum(axis=1) / 2
    square = (difference**2).sum(axis=1) / 2
    return float(square.mean()), float(products.mean()), len(difference), len(first)


def _period(times: FloatArray) -> str:
    return f"{iso(float(times.min()))} to {iso(float(times.max()))}"
