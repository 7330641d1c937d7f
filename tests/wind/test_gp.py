"""Gaussian processes: the tabulated formula against a dense one, scikit-learn, and data of known law."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from pareto_ltl.settings import WindConfig
from pareto_ltl.wind import gp as regression
from pareto_ltl.wind import sources
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

SIDE = 2e6  # [m]


def observed(seed=0, n=60, times=1, noise=1.0, length=400e3, amplitude=3.0):
    """Readings drawn from the law that the model assumes."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-SIDE / 2, SIDE / 2, (n, 2))
    r = np.sqrt(3) * np.linalg.norm(points[:, None] - points[None], axis=2) / length
    K = amplitude**2 * (1 + r) * np.exp(-r) + noise**2 * np.eye(n)
    winds = tuple(np.linalg.cholesky(K) @ rng.normal(size=(n, 2)) + [2.0, -1.0] for _ in range(times))
    return WindObservations(np.arange(times, dtype=float), (points,) * times, winds, "drawn")


@pytest.fixture(scope="module")
def sample():
    scene = Scene(np.array([[-5e5, -5e5], [5e5, 5e5]]), np.zeros(2), {}, (), projection.local_plane(37, -92))
    return place_readings(WindConfig(), sources.read_readings(WindConfig()), scene)


def dense(kernel, h, points, wind, at):
    """Joint Gaussian of readings and field, conditioned by inverting the whole covariance."""
    both = np.vstack([points, at])
    r = np.sqrt(((both[:, None, :] - both[None, :, :]) ** 2).sum(-1)) / h.length
    rho = (1 + np.sqrt(3) * r) * np.exp(-np.sqrt(3) * r) if kernel == "matern32" else np.exp(-(r**2) / 2)
    C, n = h.amplitude**2 * rho, len(points)
    inverse = np.linalg.inv(C[:n, :n] + h.noise**2 * np.eye(n))
    mean = h.mean + C[n:, :n] @ inverse @ (wind - h.mean)
    return mean, np.diag(C[n:, n:] - C[n:, :n] @ inverse @ C[:n, n:])


@pytest.mark.parametrize("kernel", ["matern32", "rbf"])
def test_the_posterior_is_that_of_the_dense_formula(kernel):
    seen = observed(times=2)
    posterior = regression.fit_posterior(WindConfig(kernel=kernel), seen)
    at = np.random.default_rng(1).uniform(-SIDE / 2, SIDE / 2, (40, 2))
    mean, var = posterior.at(at)
    for k in range(2):
        for c in range(2):
            expected = dense(kernel, posterior.hyper[k][c], seen.points[k], seen.winds[k][:, c], at)
            np.testing.assert_allclose(mean[k, :, c], expected[0], atol=1e-6)
            np.testing.assert_allclose(var[k, :, c], expected[1], atol=1e-6)


def test_the_posterior_is_that_of_scikit_learn_with_the_same_hyperparameters():
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    seen = observed(seed=2)
    posterior = regression.fit_posterior(WindConfig(), seen)
    at = np.random.default_rng(3).uniform(-SIDE / 2, SIDE / 2, (30, 2))
    mean, var = posterior.at(at)
    for c, h in enumerate(posterior.hyper[0]):
        kernel = ConstantKernel(h.amplitude**2) * Matern(h.length, nu=1.5) + WhiteKernel(h.noise**2)
        model = GaussianProcessRegressor(kernel, optimizer=None)
        model.fit(seen.points[0], seen.winds[0][:, c] - h.mean)
        expected, sd = model.predict(at, return_std=True)
        np.testing.assert_allclose(mean[0, :, c], expected + h.mean, atol=1e-6)
        np.testing.assert_allclose(var[0, :, c] + posterior.gust_var[0, c], sd**2, atol=1e-6)


def test_no_neighbouring_hyperparameters_are_more_likely(sample):
    """The log marginal likelihood, written out, has its maximum where the fit stopped."""

    def likelihood(h, points, wind):
        r = np.sqrt(3) * np.linalg.norm(points[:, None] - points[None], axis=2) / h.length
        K = h.amplitude**2 * (1 + r) * np.exp(-r) + h.noise**2 * np.eye(len(points))
        y = wind - h.mean
        return -0.5 * y @ np.linalg.solve(K, y) - 0.5 * np.linalg.slogdet(K)[1]

    posterior = regression.fit_posterior(WindConfig(), sample)
    for k, pair in enumerate(posterior.hyper):
        for c, h in enumerate(pair):
            best = likelihood(h, sample.points[k], sample.winds[k][:, c])
            for name in ("amplitude", "length", "noise"):
                for factor in (0.9, 1.1):
                    value = getattr(h, name) * factor
                    if name == "noise" and value < WindConfig().noise_min:
                        continue
                    other = h._replace(**{name: value})
                    assert likelihood(other, sample.points[k], sample.winds[k][:, c]) <= best + 1e-4


def test_the_hold_out_score_of_the_sample_is_honest(sample):
    score = regression.fit_posterior(WindConfig(), sample).score
    assert 0.8 <= score["gp_z_sd"] <= 1.3
    assert 0.84 <= score["gp_coverage_90"] <= 0.95


@pytest.mark.statistical
def test_readings_from_the_assumed_law_are_scored_as_such():
    """1600 z-scores of 8 fields: sd and coverage within what six standard errors and the fit allow."""
    score = regression.fit_posterior(WindConfig(holdout=0.5), observed(seed=4, n=200, times=8)).score
    assert abs(score["gp_z_sd"] - 1) < 0.15
    assert abs(score["gp_coverage_90"] - 0.9) < 0.06


@pytest.mark.statistical
def test_noise_and_length_are_found_again():
    posterior = regression.fit_posterior(WindConfig(), observed(seed=5, n=300, times=3))
    noise = np.sqrt(posterior.gust_var)
    length = np.array([[h.length for h in pair] for pair in posterior.hyper])
    assert abs(noise.mean() - 1.0) < 0.15
    assert 0.6 < np.exp(np.log(length / 400e3).mean()) < 1.6


def test_what_is_held_out_does_not_touch_the_score_of_the_rest():
    """A wild reading among those held out spoils its own z-score only."""
    seen = observed(seed=6, n=50)
    plain = regression.fit_posterior(WindConfig(), seen).score["gp_z_sd"]
    first = np.random.default_rng(0).permutation(50)[0]  # held out at the first time
    winds = seen.winds[0].copy()
    winds[first, 0] += 1000.0
    wild = WindObservations(seen.times, seen.points, (winds,), "spoilt")
    spoilt = regression.fit_posterior(WindConfig(), wild).score["gp_z_sd"]
    # 20 z-scores, one of which grew to about 1000 / its own unchanged standard deviation
    assert spoilt > 50 * plain
    assert 1000 / np.sqrt(20) / 4 < spoilt < 1000 / np.sqrt(20)


@pytest.mark.parametrize("kernel", ["matern32", "rbf"])
@pytest.mark.parametrize("n", [5, 30])
def test_uniform_wind_is_reproduced_without_a_warning(kernel, n):
    points = np.random.default_rng(7).uniform(-SIDE / 2, SIDE / 2, (n, 2))
    seen = WindObservations(np.zeros(1), (points,), (np.tile([4.0, -3.0], (n, 1)),), "uniform")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        posterior = regression.fit_posterior(WindConfig(kernel=kernel), seen)
    mean, var = posterior.at(np.random.default_rng(8).uniform(-SIDE, SIDE, (20, 2)))
    np.testing.assert_allclose(mean[0], np.tile([4.0, -3.0], (20, 1)), atol=1e-9)
    assert (var >= 0).all()
    assert (np.sqrt(posterior.gust_var) >= WindConfig().noise_min * (1 - 1e-9)).all()


@pytest.mark.parametrize("noise_min", [0.3, 2.0, 6.0])
def test_noise_never_falls_below_its_bound(noise_min):
    posterior = regression.fit_posterior(WindConfig(noise_min=noise_min), observed(noise=0.01, length=1e6))
    assert (np.sqrt(posterior.gust_var) >= noise_min * (1 - 1e-9)).all()


def test_the_fit_does_not_depend_on_the_unit_of_length():
    """A laboratory of 2 m is a continent in small: everything scales, nothing else changes."""
    seen = observed(seed=9)
    small = WindObservations(seen.times, tuple(p * 1e-6 for p in seen.points), seen.winds, "small")
    big, lab = (regression.fit_posterior(WindConfig(), s) for s in (seen, small))
    for a, b in zip(big.hyper[0], lab.hyper[0], strict=True):
        np.testing.assert_allclose(b.length * 1e6, a.length, rtol=1e-3)
        np.testing.assert_allclose([b.amplitude, b.noise], [a.amplitude, a.noise], rtol=1e-3)


def test_far_from_all_readings_the_prior_returns():
    seen = observed(seed=10)
    posterior = regression.fit_posterior(WindConfig(), seen)
    mean, var = posterior.at(np.array([[5e7, 5e7]]))
    for c, h in enumerate(posterior.hyper[0]):
        np.testing.assert_allclose(mean[0, 0, c], seen.winds[0][:, c].mean(), atol=1e-9)
        np.testing.assert_allclose(var[0, 0, c], h.amplitude**2, rtol=1e-9)


def test_the_same_readings_give_the_same_posterior(sample):
    one, two = (regression.fit_posterior(WindConfig(), sample) for _ in range(2))
    np.testing.assert_allclose(one.hyper, two.hyper, rtol=1e-9)
    assert one.score == pytest.approx(two.score, rel=1e-9)
