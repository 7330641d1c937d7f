"""The Gaussian process of a wind field from its readings, and the persistence of its errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from careful_io.errors import DataError
from pareto_ltl_verify.arrays import FloatArray

NEIGHBOURS = 250e3  # [m] standard deviation of the weights that average squared residuals
PRIOR_WEIGHT = 0.5  # weight of the mean squared residual in that average
SAME_PLACE = 1e3  # [m] readings that are closer stand at the same place
FEWEST_PAIRS = 10  # fewest pairs of residuals; with fewer ρ = 1
DAY = 86_400.0  # [s]


@dataclass(frozen=True, eq=False)
class Fit:
    """The readings and hyperparameters of a wind field.

    Attributes
    ----------
    points, winds : list of K (n, 2) float
        Readings of each slot [m], [m/s].
    hyper : (K, 2, 4) float
        Prior mean, prior standard deviation [m/s], length scale [m], noise [m/s].
    """

    points: list[FloatArray]
    winds: list[FloatArray]
    hyper: FloatArray
    kernel: str

    @cached_property
    def groups(self) -> list[list[int]]:
        """Lists of slots whose readings stand at the same places."""
        found: dict[bytes, list[int]] = {}
        for k, places in enumerate(self.points):
            found.setdefault(places.tobytes(), []).append(k)
        return list(found.values())

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """Standardised leave-one-out residuals of each slot, (n, 2)."""
        return [np.column_stack([_residuals(self, k, c) for c in (0, 1)]) for k in range(len(self.points))]

    def factor(self, nodes: FloatArray) -> FloatArray:
        """s² (N,): mean squared residual about each of ``nodes`` (N, 2), weighted by a Gaussian."""
        places = np.concatenate([self.points[group[0]] for group in self.groups])
        groups = ([self.residuals[k] ** 2 for k in group] for group in self.groups)
        squares = np.concatenate([np.mean(group, axis=(0, 2)) for group in groups])
        near = np.exp(-((separation(nodes, places) / NEIGHBOURS) ** 2) / 2)
        weighted = near @ squares + PRIOR_WEIGHT * squares.mean()
        return np.asarray(weighted / (near.sum(axis=1) + PRIOR_WEIGHT), float)


def correlation(kernel: str, r: FloatArray) -> FloatArray:
    """Matérn 1/2, Matérn 3/2 or squared-exponential correlation at distance ``r`` in length scales."""
    if kernel == "rbf":
        return np.asarray(np.exp(-0.5 * r * r), float)
    if kernel == "matern12":
        return np.asarray(np.exp(-r), float)
    if kernel == "matern32":
        return np.asarray((1 + np.sqrt(3.0) * r) * np.exp(-np.sqrt(3.0) * r), float)
    raise DataError(f"wind.nc names the kernel {kernel!r}; expected matern12, matern32 or rbf")


def separation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (n, m) [m] between points ``a`` (n, 2) and ``b`` (m, 2) [m]."""
    return np.asarray(np.hypot(a[:, None, 0] - b[:, 0], a[:, None, 1] - b[:, 1]), float)


def posterior(fit: Fit, k: int, c: int, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (N,) of component c in slot k at ``nodes`` (N, 2), and V (n, N) = L⁻¹ k(X, nodes), L L' = K + σ²I.

    The posterior covariance of two nodes x, y is k(x, y) - V_x' V_y.
    """
    m, amplitude, length, _ = fit.hyper[k, c]
    cross = amplitude**2 * correlation(fit.kernel, separation(fit.points[k], nodes) / length)
    root = np.linalg.inv(np.linalg.cholesky(_covariance(fit, k, c)))
    V = root @ cross
    return m + V.T @ (root @ (fit.winds[k][:, c] - m)), V


def scaled(latent: FloatArray, noise: float, factor: FloatArray) -> FloatArray:
    """Latent variance (N,) scaled so that its sum with the noise's variance is multiplied by ``factor``.

    At least 0.
    """
    return np.asarray(np.maximum((latent + noise**2) * factor - noise**2, 0.0), float)


def posterior_covariance(fit: Fit, k: int, nodes: FloatArray) -> FloatArray:
    """Covariance (N, N) [m²/s²] of the error of interpolation in space in slot k, with the factor."""
    _, amplitude, length, noise = fit.hyper[k, 0]
    _, V = posterior(fit, k, 0, nodes)
    C = amplitude**2 * correlation(fit.kernel, separation(nodes, nodes) / length) - V.T @ V
    plain = np.maximum(np.diag(C), 0.0)
    wanted = scaled(plain, noise, fit.factor(nodes))
    stretch = np.sqrt(np.divide(wanted, plain, out=np.zeros_like(plain), where=plain > 0))
    return np.asarray(stretch[:, None] * C * stretch, float)


# --- correlation of errors in time ------------------------------------------------------------


def persistence(fit: Fit, times: FloatArray) -> float:
    """ρ in [0, 1] whose powers have the same sum as the correlations of residuals 1, 2, ... slots apart.

    Up to slots that are a day apart.
    """
    found: list[float] = []
    for apart in range(1, len(times)):
        if found and np.median(times[apart:] - times[:-apart]) > DAY:
            break
        pairs = _pairs(fit, apart)
        size = float((pairs[0] ** 2).sum() * (pairs[1] ** 2).sum())
        if pairs[0].size < FEWEST_PAIRS or size <= 0.0:
            break
        found.append(float((pairs[0] * pairs[1]).sum()) / math.sqrt(size))
    total, powers = min(max(sum(found), 0.0), len(found)), np.arange(1, len(found) + 1)
    return float(brentq(lambda rho: (rho**powers).sum() - total, 0.0, 1.0)) if found else 1.0


def _pairs(fit: Fit, apart: int) -> FloatArray:
    """Residuals of readings at one place, ``apart`` slots apart, (2, pairs, 2)."""
    pairs = []
    for k in range(len(fit.points) - apart):
        gap = separation(fit.points[k], fit.points[k + apart])
        i = np.flatnonzero(gap.min(axis=1) < SAME_PLACE)
        pairs.append(np.stack([fit.residuals[k][i], fit.residuals[k + apart][gap[i].argmin(axis=1)]]))
    return np.concatenate(pairs, axis=1)


def _residuals(fit: Fit, k: int, c: int) -> FloatArray:
    inverse = np.linalg.inv(_covariance(fit, k, c))
    return np.asarray(inverse @ (fit.winds[k][:, c] - fit.hyper[k, c, 0]) / np.sqrt(np.diag(inverse)), float)


def _covariance(fit: Fit, k: int, c: int) -> FloatArray:
    """Prior covariance K + σ²I (n, n) of component c of the readings of slot k."""
    _, amplitude, length, noise = fit.hyper[k, c]
    apart = separation(fit.points[k], fit.points[k])
    return np.asarray(amplitude**2 * correlation(fit.kernel, apart / length) + noise**2 * np.eye(len(apart)))
