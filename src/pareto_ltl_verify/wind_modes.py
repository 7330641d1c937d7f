"""The covariance of each part of a wind field's error at the nodes of its modes, and of the remainder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_verify.forecast_errors import ErrorLaw
from pareto_ltl_verify.wind_fit import Fit, correlation, posterior_covariance, separation
from pareto_ltl_verify.wind_tables import FORECAST, SPACE, TIME, Modes, WindFile

ERROR_KERNEL = "matern32"  # correlation of the parts that are not fitted to readings
INSTANTS = 400  # instants at which a variance is evaluated for its mean over time


@dataclass(frozen=True, eq=False)
class PartCovariance:
    """Covariances of the slots of one part, as multiples of a few matrices, and of its modes.

    Slot k has the covariance ``scale[k]`` times ``matrices[owner[k]]`` (N, N) [m²/s²], and modes ψ of
    ``unit[k]`` times that matrix.
    """

    matrices: list[FloatArray]
    owner: list[int]
    scale: FloatArray
    unit: FloatArray

    @cached_property
    def eigenvalues(self) -> list[FloatArray]:
        """Eigenvalues of each matrix, largest first."""
        return [np.maximum(np.linalg.eigvalsh(C)[::-1], 0.0) for C in self.matrices]

    @property
    def total(self) -> FloatArray:
        """Variance of one component summed over nodes, (K,)."""
        traces = np.array([np.trace(C) for C in self.matrices])
        return np.asarray(self.scale * traces[self.owner], float)

    def leading(self, limit: int) -> FloatArray:
        """Variance of mode 1, 2, ... up to ``limit``, summed over slots, components and nodes."""
        rows = [values[:limit] for values in self.eigenvalues]
        return np.asarray(2 * sum(s * rows[i] for s, i in zip(self.scale, self.owner, strict=True)), float)

    def over_slots(self) -> FloatArray:
        """The covariance summed over slots and both components, (N, N)."""
        weights = np.bincount(self.owner, self.scale, len(self.matrices))
        return np.asarray(2 * sum(w * C for w, C in zip(weights, self.matrices, strict=True)), float)


def part_covariances(wind: WindFile, horizon: float) -> dict[int, PartCovariance]:
    """The parts of the error that follow from wind.nc, by number; the ensemble's part does not.

    ``horizon`` [s] is the end of the longest flight.
    """
    fit, modes = wind.fit, wind.modes
    if fit is None or modes is None:
        return {}
    nodes = modes.nodes()
    parts = {SPACE: _space(fit, nodes)}
    if (law := wind.error) is not None:
        apart = separation(nodes, nodes)
        forecast, between = law.forecast_variance(wind.leads), time_variances(wind, law, horizon)
        if forecast.any():
            parts[FORECAST] = _common(forecast, forecast, apart / law.forecast_length)
        if between.any():
            parts[TIME] = _common(between, np.ones(len(between)), apart / law.change_length)
    return parts


def _space(fit: Fit, nodes: FloatArray) -> PartCovariance:
    owner = [next(i for i, group in enumerate(fit.groups) if k in group) for k in range(len(fit.points))]
    matrices = [posterior_covariance(fit, group[0], nodes) for group in fit.groups]
    ones = np.ones(len(owner))
    return PartCovariance(matrices, owner, ones, ones)


def _common(scale: FloatArray, unit: FloatArray, distance: FloatArray) -> PartCovariance:
    return PartCovariance([correlation(ERROR_KERNEL, distance)], [0] * len(scale), scale, unit)


def time_variances(wind: WindFile, law: ErrorLaw, horizon: float) -> FloatArray:
    """Mean variance of interpolation in time, (K,) [m²/s²], over the time for which a slot is the nearest."""
    shares = (np.arange(INSTANTS) + 0.5) / INSTANTS
    spent, spans = np.zeros(len(wind.times)), np.zeros(len(wind.times))
    for k, gap in enumerate(np.diff(wind.times)):
        half = np.mean([law.between_variance(0.5 * gap * share, gap) for share in shares])
        spent[k : k + 2] += 0.5 * gap * half
        spans[k : k + 2] += 0.5 * gap
    held = min(wind.until, horizon) - wind.times[-1]
    if 0 < held < math.inf:
        spent[-1] += held * np.mean([law.change_variance(held * share) for share in shares])
        spans[-1] += held
    return np.divide(spent, spans, out=np.zeros_like(spent), where=spans > 0)


def carried(modes: Modes, part: int, cov: PartCovariance) -> FloatArray:
    """Variance that the modes of a part carry, summed over nodes, (K, 2) [m²/s²]."""
    squares: FloatArray = (modes.of(part) ** 2).sum(axis=(1, 3))
    return squares * (cov.scale / np.where(cov.unit > 0, cov.unit, 1.0))[:, None]


def rest_covariance(modes: Modes, parts: Mapping[int, PartCovariance]) -> FloatArray:
    """Covariance of the error without its modes, summed over slots and components, (N, N) [m²/s²]."""
    left = np.zeros((len(modes.nodes()),) * 2)
    for part, cov in parts.items():
        psi = modes.of(part) * np.sqrt(cov.scale / np.where(cov.unit > 0, cov.unit, 1.0))[:, None, None, None]
        flat = psi.transpose(1, 0, 2, 3).reshape(len(left), -1)
        left += cov.over_slots() - flat @ flat.T
    return left


def correlation_length(modes: Modes, cov: FloatArray) -> float:
    """∫ correlation dr [m] of ``cov`` (N, N) over the distance, along rows and columns of the nodes.

    From 0 to the first distance at which it is not positive, at most half the shorter side, by trapezoids.
    """
    nx, ny = len(modes.x), len(modes.y)
    i, j = np.divmod(np.arange(nx * ny), ny)
    means = []
    for h in range(min(nx, ny) // 2 + 1):
        east, north = np.flatnonzero(i + h < nx), np.flatnonzero(j + h < ny)
        means.append((cov[east, east + h * ny].mean() + cov[north, north + h].mean()) / 2)
    if means[0] <= 0:
        return 0.0
    positive = np.cumprod(np.array(means) > 0).astype(bool)
    return float((modes.y[1] - modes.y[0]) * (np.array(means)[positive].sum() / means[0] - 0.5))


def aligned_fault(modes: Modes) -> float:
    """Relative deviation of the modes of interpolation in space from the best match of consecutive slots.

    ψ_k is rotated so that ψ_k' ψ_{k-1} has its largest trace: that matrix is then symmetric and positive.
    """
    psi, worst = modes.of(SPACE), 0.0
    for k in range(1, len(psi)):
        for c in (0, 1):
            match = psi[k, :, c].T @ psi[k - 1, :, c]
            size = max(float(np.linalg.norm(match)), 1e-12)
            skew = float(np.linalg.norm(match - match.T)) / size
            least = float(np.linalg.eigvalsh(match + match.T)[0]) / size if len(match) else 0.0
            worst = max(worst, skew, -least)
    return worst
