"""Winds of many snapshots at their common nodes, and moments of their differences."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import iso, node_rows, on_sphere
from pareto_ltl.wind.snapshots import Snapshot

EARTH_RADIUS = 6_371_000.0  # [m]
FEWEST_NODES = 12
CORRELATED_NODES = 400  # largest number of nodes for correlations, drawn once
BINS = 15  # of distance, for correlations
FARTHEST = 1_500_000.0  # distance of the last bin [m]


@dataclass(frozen=True, slots=True)
class PairMoments:
    """Second moments of difference fields, one row for each pair of fields.

    Attributes
    ----------
    cycles : (P,) float
        Cycle of each pair, the unit of the bootstrap [s since 1970].
    square : (P,) float
        Mean square of a component over the area [m²/s²].
    products : (P, B) float
        Mean product of the differences at two nodes, in bins of their distance [m²/s²].
    """

    cycles: FloatArray
    square: FloatArray
    products: FloatArray

    def __len__(self) -> int:
        return len(self.cycles)

    @property
    def table(self) -> FloatArray:
        """Columns of ``square`` and ``products``, (P, 1 + B)."""
        return np.column_stack([self.square, self.products])

    def scaled(self, factor: float) -> PairMoments:
        """The moments multiplied by ``factor``."""
        return PairMoments(self.cycles, factor * self.square, factor * self.products)


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
        self.nodes = _common_nodes(snapshots, area)
        cosine = np.cos(np.deg2rad(self.nodes[:, 1]))
        self.weights = cosine / cosine.sum()
        self.winds: dict[tuple[float, float], FloatArray] = {}
        points, rows = self.nodes, np.arange(len(self.nodes))
        for snap in snapshots:
            key = (snap.time, snap.lead)
            if key in self.winds:
                moment = f"{iso(snap.time)} with a lead of {snap.lead / 3600:g} h"
                raise DataError(
                    f"{', '.join(file.name for file in snap.files)}: the wind at {moment} occurs twice; "
                    "keep one member"
                )
            if not np.array_equal(points, snap.points):
                points, rows = snap.points, node_rows(snap.points, self.nodes)
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
        rows = [(cycle, self.mean_product(d, d), self._products(d)) for cycle, d in differences]
        cycles, square, products = zip(*rows, strict=True) if rows else ((), (), ())
        return PairMoments(np.array(cycles), np.array(square), np.array(products).reshape(len(rows), -1))

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


def analyses(winds: Mapping[tuple[float, float], FloatArray]) -> dict[float, FloatArray]:
    """The analyses (lead 0) among ``winds``, by time."""
    return {time: field for (time, lead), field in sorted(winds.items()) if lead == 0}


def forecasts(
    winds: Mapping[tuple[float, float], FloatArray],
) -> Iterator[tuple[float, float, FloatArray]]:
    """Cycle, lead and wind of the forecasts among ``winds``, in the order of their valid times."""
    for (time, lead), field in sorted(winds.items()):
        if lead > 0:
            yield time - lead, lead, field


def _common_nodes(snapshots: Sequence[Snapshot], area: Sequence[Sequence[float]] | None) -> FloatArray:
    nodes = snapshots[0].points
    for snap in snapshots[1:]:
        if not np.array_equal(nodes, snap.points):
            known = set(map(tuple, snap.points.tolist()))
            nodes = np.array([node for node in nodes.tolist() if tuple(node) in known]).reshape(-1, 2)
    common = len(nodes)
    if area is not None:
        import shapely

        nodes = nodes[shapely.contains_xy(shapely.Polygon(area), nodes)]
    if len(nodes) < FEWEST_NODES:
        raise DataError(
            f"{len(nodes)} of {common} nodes that all times share lie in the area, expected at least "
            f"{FEWEST_NODES}; name another --area, or files of one grid that cover it"
        )
    return nodes
