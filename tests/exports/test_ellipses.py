"""Ellipses and circles of Gaussians, against eigenvectors, quantiles and draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, norm

from pareto_ltl_apps.exports.ellipses import axes_of, circle_radius, ellipse_outlines

RNG = np.random.default_rng(3)


def covariances(n: int) -> np.ndarray:
    roots = RNG.normal(size=(n, 2, 2)) * RNG.uniform(0.1, 30.0, (n, 1, 1))
    return roots @ roots.transpose(0, 2, 1)


def test_the_axes_are_those_of_the_eigenvectors() -> None:
    cov = covariances(200)
    major, minor, direction = axes_of(cov)
    values, vectors = np.linalg.eigh(cov)
    np.testing.assert_allclose(major, np.sqrt(values[:, 1]), rtol=1e-9)
    np.testing.assert_allclose(minor, np.sqrt(np.maximum(values[:, 0], 0)), rtol=1e-5, atol=1e-9)
    along = np.stack([np.sin(direction), np.cos(direction)], axis=1)  # clockwise from +y
    np.testing.assert_allclose(np.abs((along * vectors[:, :, 1]).sum(axis=1)), 1.0, rtol=1e-9)
    assert (direction >= 0).all()
    assert (direction < np.pi).all()


@pytest.mark.parametrize("share", [0.5, 0.95, 0.99])
def test_the_radius_of_a_round_spread_and_of_a_line_are_quantiles(share: float) -> None:
    one, none = np.array([3.0]), np.array([0.0])
    assert circle_radius(one, one, share) == pytest.approx(3.0 * np.sqrt(chi2.ppf(share, 2)), rel=1e-9)
    assert circle_radius(one, none, share) == pytest.approx(3.0 * norm.ppf(0.5 + share / 2), rel=0.02)
    assert circle_radius(none, none, share) == 0.0


@pytest.mark.statistical
def test_the_circle_holds_its_share_of_draws() -> None:
    cov = covariances(5)
    major, minor, _ = axes_of(cov)
    radius = circle_radius(major, minor, 0.95)
    n = 200_000
    for matrix, r in zip(cov, radius, strict=True):
        drawn = RNG.multivariate_normal(np.zeros(2), matrix, n)
        inside = (np.hypot(*drawn.T) <= r).mean()
        assert abs(inside - 0.95) < 5.4 * np.sqrt(0.95 * 0.05 / n) + 1e-3


def test_the_outline_just_holds_the_ellipse() -> None:
    cov, mean, scale = covariances(20), RNG.normal(size=(20, 2)), RNG.uniform(0.5, 4.0, 20)
    outlines = ellipse_outlines(mean, cov, scale, 36)
    inverse = np.linalg.inv(cov)

    def sizes(points: np.ndarray) -> np.ndarray:
        gap = points - mean[:, None]
        return np.sqrt(np.einsum("nci,nij,ncj->nc", gap, inverse, gap)) / scale[:, None]

    middles = 0.5 * (outlines + np.roll(outlines, -1, axis=1))
    np.testing.assert_allclose(sizes(middles), 1.0, rtol=1e-6)  # the edges touch it
    np.testing.assert_allclose(sizes(outlines), 1 / np.cos(np.pi / 36), rtol=1e-6)
    x, y = (outlines - mean[:, None]).transpose(2, 0, 1)
    assert (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1) > 0).all()  # counter-clockwise
