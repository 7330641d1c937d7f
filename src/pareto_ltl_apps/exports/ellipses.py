"""Ellipses and circles that hold a Gaussian position with a given probability."""

from __future__ import annotations

import math

import numpy as np

from pareto_ltl.support.arrays import FloatArray

ANGLES = 64  # directions of the quadrature: error below 1e-9 if the axes differ by a factor below 10
HALVINGS = 60  # bisections of the interval of a radius


def axes_of(cov: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations along the major and minor axes of ``cov`` (N, 2, 2), and the major one's direction.

    The direction is clockwise from +y in [0, π), 0 for a circle; each array has shape (N,).
    """
    xx, xy, yy = cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    direction = 0.5 * np.arctan2(2.0 * xy, yy - xx) % np.pi
    return np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0)), direction


def ellipse_scale(share: float) -> float:
    """Standard deviations of the ellipse that holds ``share`` of a Gaussian of two components."""
    return math.sqrt(-2.0 * math.log1p(-share))


def circle_radius(major: FloatArray, minor: FloatArray, share: float) -> FloatArray:
    """Radius r (N,) of the circle around the mean that holds ``share`` of a Gaussian of these axes (N,)::

    P(|e| > r) = 1/(2π) ∫ exp(-r² / 2 (a² cos²θ + b² sin²θ)) dθ = 1 - share
    """
    angle = (np.arange(ANGLES) + 0.5) * (2.0 * np.pi / ANGLES)
    variance = (major[:, None] * np.cos(angle)) ** 2 + (minor[:, None] * np.sin(angle)) ** 2
    variance = np.maximum(variance, np.finfo(float).tiny)
    low, high = np.zeros_like(major), major * ellipse_scale(share)
    for _ in range(HALVINGS):
        r = 0.5 * (low + high)
        outside = np.exp(-0.5 * r[:, None] ** 2 / variance).mean(axis=1) > 1.0 - share
        low, high = np.where(outside, r, low), np.where(outside, high, r)
    return np.asarray(high, float)


def ellipse_outlines(mean: FloatArray, cov: FloatArray, scale: FloatArray, corners: int) -> FloatArray:
    """Polygons (..., corners, 2) [m], counter-clockwise, that circumscribe ellipses around ``mean`` (..., 2).

    The ellipses lie at ``scale`` (...) standard deviations of ``cov`` (..., 2, 2).
    """
    angle = np.arange(corners) * (2.0 * np.pi / corners)
    circle = np.stack([np.cos(angle), np.sin(angle)]) / np.cos(np.pi / corners)  # around the unit circle
    root = np.linalg.cholesky(cov)
    ring = np.swapaxes(root @ circle, -1, -2)
    return np.asarray(mean[..., None, :] + scale[..., None, None] * ring, float)
