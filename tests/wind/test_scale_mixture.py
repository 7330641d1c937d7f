"""The distribution of errors whose scale is lognormal."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kurtosis, norm

from pareto_ltl_apps.wind_errors.scale_mixture import coverage, log_density, quantiles


@pytest.mark.parametrize("spread", [0.0, 0.3, 0.55, 0.8])
def test_the_scale_mixture_agrees_with_draws(spread: float) -> None:
    rng = np.random.default_rng(5)
    n = 400_000
    x = np.exp(spread * rng.standard_normal(n) - spread**2) * rng.standard_normal(n)
    shares = np.array([0.5, 0.9, 0.99, 0.999])
    inside = [np.mean(np.abs(x) <= limit) for limit in quantiles(shares, spread)]
    assert np.all(np.abs(inside - shares) < 5 * np.sqrt(shares * (1 - shares) / n) + 1e-5)
    if spread <= 0.3:
        assert kurtosis(x, fisher=False) == pytest.approx(3 * np.exp(4 * spread**2), rel=0.1)


def test_without_spread_the_mixture_is_the_normal_distribution() -> None:
    z = np.linspace(0.0, 5.0, 11)
    np.testing.assert_allclose(coverage(z, 0.0), 2 * norm.cdf(z) - 1, atol=1e-12)
    np.testing.assert_allclose(log_density(z, np.array(0.0)), norm.logpdf(z), atol=1e-12)


def test_a_density_is_the_slope_of_the_coverage() -> None:
    z = np.linspace(0.1, 5.0, 50)
    slope = (coverage(z + 1e-5, 0.5) - coverage(z - 1e-5, 0.5)) / 2e-5
    np.testing.assert_allclose(2 * np.exp(log_density(z, np.array(0.5))), slope, rtol=1e-5)
