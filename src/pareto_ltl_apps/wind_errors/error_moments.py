"""Sample moments of errors of point forecasts, by situation, from which a law of parts is fitted.

Sums are stored for each situation, so that a fit without some situations, or with some of them drawn twice,
is a weighted sum. All runs, places and both components are pooled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from careful_io.times import HOUR
from flight_quantities.sphere import on_sphere
from pareto_ltl.extend import LawOfParts
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_apps.wind_errors.point_forecasts import (
    PointForecasts,
    Verified,
    Window,
    displacements,
    window,
)

EARTH_RADIUS = 6_371_000.0  # [m]
TARGET_LEADS = (3, 6, 9, 12, 15, 18, 24, 30, 36, 48, 60, 72, 96, 120)  # [h] of variances
CORRELATION_LEADS = (6, 12, 15, 18, 24, 30, 36, 48, 60, 72)  # [h] of the first of two errors
CORRELATION_LAGS = (3, 6, 12, 24)  # [h]
SPAN_STARTS = (3, 6, 12, 15, 24, 48)  # [h] of displacements
SPAN_HOURS = (6, 12, 24, 48)
DISTANCE_EDGES = 1e3 * np.array([1.0, 50, 100, 150, 200, 300, 450, 700, 1000])  # [m]
SPATIAL_LEADS, SPATIAL_SPANS = (6, 12, 24, 48, 72), ((6, 24), (24, 24))
FEWEST_PLACES = 5  # for correlations in space
FEWEST_VALUES = 100  # behind a moment that is fitted


@dataclass(frozen=True, slots=True)
class ErrorMoments:
    """Sums of products of errors.

    Attributes
    ----------
    groups : (G,) int
        Numbers of the situations, increasing.
    leads : (N,) float
        Leads [s].
    products, counts : (G, N, N) float
        Sums of products of the errors at two leads of one run, place and component [m²/s²], and their
        numbers, for each situation.
    newer : (L,) float
        Leads of the runs that verify [s]; empty for observations.
    shares : (N, L) float
        Share of the errors at each lead that they verify.
    spans : tuple of Window
        Integrals over time whose variance is fitted.
    fields : tuple of (N,) float
        Weights of the errors at the leads, of quantities whose correlation in space is fitted.
    distances : (B,) float
        Mean distances of pairs of places [m].
    across : (G, F, B, 3) float
        For each field and bin of distance, sums of the product and of the two squares.
    """

    groups: IntArray
    leads: FloatArray
    products: FloatArray
    counts: FloatArray
    newer: FloatArray
    shares: FloatArray
    spans: tuple[Window, ...]
    fields: tuple[FloatArray, ...]
    distances: FloatArray
    across: FloatArray

    @property
    def situations(self) -> int:
        """Number of situations."""
        return len(self.products)


def error_moments(table: PointForecasts, found: Verified, longest: float) -> ErrorMoments:
    """The moments of the errors of a table at leads up to ``longest`` [s]."""
    columns = np.flatnonzero(found.leads <= longest)
    leads = found.leads[columns]
    good = found.compared[:, :, columns]
    errors = np.where(good[..., None], found.errors[:, :, columns], np.nan)
    groups = np.unique(found.situation[good.any(axis=(1, 2))])
    products = np.zeros((len(groups), len(leads), len(leads)))
    counts = np.zeros_like(products)
    for g, group in enumerate(groups):
        rows = np.moveaxis(errors[found.situation == group], 2, 3).reshape(-1, len(leads))
        known = np.isfinite(rows)
        filled, present = np.where(known, rows, 0.0), known.astype(float)
        products[g], counts[g] = filled.T @ filled, present.T @ present
    newer, shares = _newer_shares(found.newer[:, :, columns], good)
    spans = _spans(leads, counts.sum(axis=0))
    seen = Verified(found.runs, leads, errors, found.newer[:, :, columns], found.truth)
    fields, distances, across = _across(table, seen, groups)
    own = newer if found.truth == LawOfParts.OWN else np.empty(0)
    return ErrorMoments(groups, leads, products, counts, own, shares, spans, fields, distances, across)


def _newer_shares(newer: FloatArray, good: BoolArray) -> tuple[FloatArray, FloatArray]:
    values = np.unique(newer[good])
    shares = np.stack([((newer == value) & good).sum(axis=(0, 1)) for value in values], axis=-1)
    return values, shares / np.maximum(good.sum(axis=(0, 1))[:, None], 1)


def _spans(leads: FloatArray, counts: FloatArray) -> tuple[Window, ...]:
    found = []
    for start in SPAN_STARTS:
        for hours in SPAN_HOURS:
            span = window(leads, start * HOUR, hours * HOUR)
            if span is not None and counts[np.ix_(span.columns, span.columns)].min() >= FEWEST_VALUES:
                found.append(span)
    return tuple(found)


def _across(
    table: PointForecasts, seen: Verified, groups: IntArray
) -> tuple[tuple[FloatArray, ...], FloatArray, FloatArray]:
    """Fields, mean distances of bins, and sums of products by situation, field and bin."""
    nothing = ((), np.empty(0), np.empty((len(groups), 0, 0, 3)))
    if table.places is None or len(table.places) < FEWEST_PLACES:
        return nothing
    xyz = on_sphere(table.places)
    between = EARTH_RADIUS * np.arccos(np.clip(xyz @ xyz.T, -1.0, 1.0))
    one, two = np.triu_indices(len(xyz), 1)
    bins = np.digitize(between[one, two], DISTANCE_EDGES) - 1
    used = [b for b in range(len(DISTANCE_EDGES) - 1) if (bins == b).sum() >= 3]
    fields, values = [], []
    for weights, each in _spatial_values(seen):
        fields.append(weights)
        values.append(each)
    if not fields or not used:
        return nothing
    across = np.zeros((len(groups), len(fields), len(used), 3))
    for f, value in enumerate(values):
        a, b = value[:, one], value[:, two]
        known = np.isfinite(a) & np.isfinite(b)
        a, b = np.where(known, a, 0.0), np.where(known, b, 0.0)
        for k, chosen in enumerate(used):
            pairs = bins == chosen
            sums = np.stack(
                [(x[:, pairs] * y[:, pairs]).sum(axis=(1, 2)) for x, y in ((a, b), (a, a), (b, b))], axis=-1
            )
            for g, group in enumerate(groups):
                across[g, f, k] = sums[seen.situation == group].sum(axis=0)
    distances = np.array([between[one, two][bins == each].mean() for each in used])
    return tuple(fields), distances, across


def _spatial_values(seen: Verified) -> list[tuple[FloatArray, FloatArray]]:
    """Weights (N,) of each field, and its values (R, P, 2)."""
    made = []
    for hours in SPATIAL_LEADS:
        columns = np.flatnonzero(np.isclose(seen.leads, hours * HOUR))
        if len(columns):
            weights = np.zeros(len(seen.leads))
            weights[columns[0]] = 1.0
            made.append((weights, seen.errors[:, :, columns[0]]))
    for start, hours in SPATIAL_SPANS:
        span = window(seen.leads, start * HOUR, hours * HOUR)
        if span is not None:
            weights = np.zeros(len(seen.leads))
            weights[span.columns] = span.weights
            made.append((weights, displacements(seen, span)))
    return [(weights, values) for weights, values in made if np.isfinite(values).sum() >= FEWEST_VALUES]


# --- what is fitted ---------------------------------------------------------------------------


class Targets(NamedTuple):
    """Moments that a law is to have.

    Attributes
    ----------
    at : (V,) int
        Columns of the variances.
    variance : (V,) float
        Mean squares there [m²/s²].
    pairs : (C, 2) int
        Columns of the correlations.
    correlation : (C,) float
        Correlations of the errors at two leads.
    spans : sequence of Window
        Spans of the displacements.
    displacement : (S,) float
        Their mean squares [m²].
    across : (F, B) float
        Correlations of the fields by distance.
    """

    at: IntArray
    variance: FloatArray
    pairs: IntArray
    correlation: FloatArray
    spans: Sequence[Window]
    displacement: FloatArray
    across: FloatArray


def targets(moments: ErrorMoments, weights: FloatArray | None = None) -> Targets:
    """The moments to fit, with a weight (G,) of each situation; 1 without ``weights``."""
    weights = np.ones(moments.situations) if weights is None else weights
    total, count = (np.einsum("g,gij->ij", weights, table) for table in (moments.products, moments.counts))
    known = count >= FEWEST_VALUES
    mean = np.where(known, total / np.maximum(count, 1.0), np.nan)
    hours = np.round(moments.leads / HOUR, 6)
    column = {hour: j for j, hour in enumerate(hours.tolist())}
    at = np.array([column[h] for h in TARGET_LEADS if h in column and known[column[h], column[h]]], np.int64)
    pairs = [
        (column[h], column[h + lag])
        for h in CORRELATION_LEADS
        for lag in CORRELATION_LAGS
        if h in column and h + lag in column and known[column[h], column[h + lag]]
    ]
    diagonal = np.diag(mean)
    chosen = np.array(pairs, np.int64).reshape(-1, 2)
    one, two = chosen.T
    correlation = mean[one, two] / np.sqrt(diagonal[one] * diagonal[two])
    spans = [s for s in moments.spans if np.isfinite(mean[np.ix_(s.columns, s.columns)]).all()]
    displacement = [s.weights @ mean[np.ix_(s.columns, s.columns)] @ s.weights for s in spans]
    sums = np.einsum("g,gfbk->fbk", weights, moments.across)
    across = sums[..., 0] / np.sqrt(np.maximum(sums[..., 1] * sums[..., 2], 1e-300))
    return Targets(at, diagonal[at], chosen, correlation, spans, np.maximum(displacement, 1e-6), across)
