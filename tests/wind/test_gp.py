"""Gaussian processes: the tabulated formula against a dense one, scikit-learn, and data of known law."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.wind import gp as regression
from pareto_ltl.wind import sources
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.records import WindObservations
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
    scene = Scene(np.array([[-5e5, -5e5], [5e5, 5e5]]), np.zeros(2), {}, (), frames.local_plane(37, -92))
    return place_readings(WindConfig(), sources.read_readings(WindConfig()), scene)


def dense(kernel, h, prior, points, wind, at):
    """Joint Gaussian of readings and field, conditioned by inverting the whole covariance."""
    both = np.vstack([points, at])
    r = np.sqrt(((both[:, None, :] - both[None, :, :]) ** 2).sum(-1)) / h.length
    rho = {
        "matern12": np.exp(-r),
        "matern32": (1 + np.sqrt(3) * r) * np.exp(-np.sqrt(3) * r),
        "rbf": np.exp(-(r**2) / 2),
    }[kernel]
    C, n = h.amplitude**2 * rho, len(points)
    inverse = np.linalg.inv(C[:n, :n] + h.noise**2 * np.eye(n))
    mean = prior + C[n:, :n] @ inverse @ (wind - prior)
    return mean, np.diag(C[n:, n:] - C[n:, :n] @ inverse @ C[:n, n:])


def factor_by_hand(kernel, posterior, at):
    """Leave-one-out residuals by leaving readings out one by one, averaged with Gaussian weights."""
    places, n, h = posterior.points[0], len(posterior.points[0]), posterior.hyper
    z2 = np.zeros(n)
    for i in range(n):
        rest = np.arange(n) != i
        for k, winds in enumerate(posterior.winds):
            for c, prior in enumerate(posterior.means[k]):
                mean, var = dense(kernel, h, prior, places[rest], winds[rest, c], places[i : i + 1])
                z2[i] += (winds[i, c] - mean[0]) ** 2 / (var[0] + h.noise**2)
    z2 /= 2 * len(posterior.winds)
    g = np.exp(-0.5 * (np.linalg.norm(at[:, None] - places[None], axis=2) / 250e3) ** 2)
    return (g @ z2 + 0.5 * z2.mean()) / (g.sum(axis=1) + 0.5)


@pytest.mark.parametrize("kernel", ["matern12", "matern32", "rbf"])
def test_the_posterior_is_that_of_the_dense_formula(kernel):
    seen = observed(times=2)
    posterior = regression.fit_posterior(WindConfig(kernel=kernel), seen)
    at = np.random.default_rng(1).uniform(-SIDE / 2, SIDE / 2, (40, 2))
    mean, var = posterior.at(at)
    factor = factor_by_hand(kernel, posterior, at)
    assert factor.std() > 0.01
    for k in range(2):
        for c in range(2):
            h = posterior.hyper
            expected, v = dense(kernel, h, posterior.means[k, c], seen.points[k], seen.winds[k][:, c], at)
            np.testing.assert_allclose(mean[k, :, c], expected, atol=1e-6)
            np.testing.assert_allclose(
                var[k, :, c], np.maximum((v + h.noise**2) * factor - h.noise**2, 0.0), atol=1e-5
            )


def test_the_posterior_is_that_of_scikit_learn_with_the_same_hyperparameters():
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    seen = observed(seed=2)
    posterior = regression.fit_posterior(WindConfig(), seen)
    at = np.random.default_rng(3).uniform(-SIDE / 2, SIDE / 2, (30, 2))
    mean, var = posterior.at(at)
    h = posterior.hyper
    for c, prior in enumerate(posterior.means[0]):
        kernel = ConstantKernel(h.amplitude**2) * Matern(h.length, nu=0.5) + WhiteKernel(h.noise**2)
        model = GaussianProcessRegressor(kernel, optimizer=None)
        model.fit(seen.points[0], seen.winds[0][:, c] - prior)
        expected, sd = model.predict(at, return_std=True)
        np.testing.assert_allclose(mean[0, :, c], expected + prior, atol=1e-6)
        total = posterior.variance_factor(at) * sd**2
        np.testing.assert_allclose(
            var[0, :, c] + posterior.gust_var[0, c], np.maximum(total, h.noise**2), atol=1e-6
        )


def test_no_neighbouring_hyperparameters_are_more_likely(sample):
    """The log marginal likelihood, written out, has its maximum where the fit stopped."""

    def likelihood(amplitude, length, noise):
        total = 0.0
        for points, winds in zip(sample.points, sample.winds, strict=True):
            r = np.linalg.norm(points[:, None] - points[None], axis=2) / length
            K = amplitude**2 * np.exp(-r) + noise**2 * np.eye(len(points))
            y = winds - winds.mean(axis=0)
            total -= 0.5 * np.sum(y * np.linalg.solve(K, y)) + np.linalg.slogdet(K)[1]
        return total

    posterior = regression.fit_posterior(WindConfig(), sample)
    h = posterior.hyper
    best = likelihood(*h)
    for name in ("amplitude", "length", "noise"):
        for factor in (0.9, 1.1):
            other = h._replace(**{name: getattr(h, name) * factor})
            if other.noise >= WindConfig().noise_min * (1 - 1e-9):
                assert likelihood(*other) <= best + 1e-3


def test_the_hold_out_score_of_the_sample_is_honest(sample):
    score = regression.fit_posterior(WindConfig(), sample).score
    assert 0.8 <= score["gp_z_sd"] <= 1.3
    assert 0.84 <= score["gp_coverage_90"] <= 0.95


@pytest.mark.statistical
def test_readings_from_the_assumed_law_are_scored_as_such():
    """1600 z-scores of 8 fields: sd and coverage within what six standard errors and the fit allow."""
    cfg = WindConfig(holdout=0.5, kernel="matern32")
    score = regression.fit_posterior(cfg, observed(seed=4, n=200, times=8)).score
    assert abs(score["gp_z_sd"] - 1) < 0.15
    assert abs(score["gp_coverage_90"] - 0.9) < 0.06


@pytest.mark.statistical
def test_noise_and_length_are_found_again():
    posterior = regression.fit_posterior(WindConfig(kernel="matern32"), observed(seed=5, n=300, times=3))
    noise = np.sqrt(posterior.gust_var)
    assert abs(noise.mean() - 1.0) < 0.15
    assert 0.6 < posterior.hyper.length / 400e3 < 1.6


def test_what_is_held_out_does_not_touch_the_score_of_the_rest():
    """A wild reading among those held out spoils its own z-score only."""
    seen = observed(seed=6, n=50)
    plain = regression.fit_posterior(WindConfig(), seen).score["gp_z_sd"]
    out = np.unique(seen.points[0], axis=0)[np.random.default_rng(0).permutation(50)[0]]  # held out first
    first = int(np.flatnonzero((seen.points[0] == out).all(axis=1))[0])
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


def test_the_last_bits_of_the_readings_do_not_change_the_hyperparameters():
    """Else processors that round differently would plan with different winds."""
    seen = observed(noise=1.0, length=4e5)
    other = replace(seen, winds=tuple(w * (1 + 1e-11) for w in seen.winds))
    one, two = (regression.fit_posterior(WindConfig(), readings).hyper for readings in (seen, other))
    assert one == two


@pytest.mark.parametrize("noise_min", [0.3, 2.0, 6.0])
def test_noise_never_falls_below_its_bound(noise_min):
    posterior = regression.fit_posterior(WindConfig(noise_min=noise_min), observed(noise=0.01, length=1e6))
    assert (np.sqrt(posterior.gust_var) >= noise_min * (1 - 1e-9)).all()


def test_the_fit_does_not_depend_on_the_unit_of_length():
    """A laboratory of 2 m is a continent in small: everything scales, nothing else changes."""
    seen = observed(seed=9)
    small = WindObservations(seen.times, tuple(p * 1e-6 for p in seen.points), seen.winds, "small")
    a, b = (regression.fit_posterior(WindConfig(), s).hyper for s in (seen, small))
    np.testing.assert_allclose(b.length * 1e6, a.length, rtol=1e-3)
    np.testing.assert_allclose([b.amplitude, b.noise], [a.amplitude, a.noise], rtol=1e-3)


def test_far_from_all_readings_the_prior_returns():
    seen = observed(seed=10)
    posterior = regression.fit_posterior(WindConfig(), seen)
    mean, var = posterior.at(np.array([[5e7, 5e7]]))
    h = posterior.hyper
    for c in (0, 1):
        np.testing.assert_allclose(mean[0, 0, c], seen.winds[0][:, c].mean(), atol=1e-9)
        total = posterior.squares.mean() * (h.amplitude**2 + h.noise**2)
        np.testing.assert_allclose(var[0, 0, c], total - h.noise**2, rtol=1e-9)


def test_the_same_readings_give_the_same_posterior(sample):
    one, two = (regression.fit_posterior(WindConfig(), sample) for _ in range(2))
    np.testing.assert_allclose(one.hyper, two.hyper, rtol=1e-9)
    np.testing.assert_allclose(one.means, two.means, rtol=1e-9)
    assert one.score == pytest.approx(two.score, rel=1e-9)


def test_the_variance_factor_finds_where_readings_are_worse_than_the_kernel_says():
    """Readings of the east have three times the noise of the others."""
    seen = observed(seed=11, n=200, times=4)
    east = seen.points[0][:, 0] > 0
    rng = np.random.default_rng(12)
    winds = tuple(w + np.where(east[:, None], rng.normal(0, 3, w.shape), 0.0) for w in seen.winds)
    posterior = regression.fit_posterior(WindConfig(), WindObservations(seen.times, seen.points, winds, ""))
    west, there = posterior.variance_factor(np.array([[-6e5, 0.0], [6e5, 0.0]]))
    assert there > 2.0 * west
    assert west < 1.0 < there


@pytest.mark.statistical
def test_fewer_readings_promise_no_less_doubt():
    """With half of the readings the mean variance grows, and the score stays honest: the length scale and
    the noise do not take the place of what was left out."""
    full = observed(seed=13, n=240, times=8)
    half = WindObservations(
        full.times, tuple(p[:120] for p in full.points), tuple(w[:120] for w in full.winds), ""
    )
    at = np.random.default_rng(1).uniform(-SIDE / 2, SIDE / 2, (300, 2))
    many, few = (regression.fit_posterior(WindConfig(kernel="matern32"), seen) for seen in (full, half))
    assert few.at(at)[1].mean() > 1.1 * many.at(at)[1].mean()
    for posterior in (many, few):
        assert 0.85 < posterior.score["gp_coverage_90"] < 0.95


def test_an_ensemble_is_interpolated_with_the_weights_of_the_mean():
    seen = observed(seed=14, times=2)
    posterior = regression.fit_posterior(WindConfig(), seen)
    at = np.random.default_rng(2).uniform(-SIDE / 2, SIDE / 2, (10, 2))
    own = tuple((w - prior)[:, :, None] for w, prior in zip(seen.winds, posterior.means, strict=True))
    spread = posterior.spread_out(own, at)[..., 0]
    np.testing.assert_allclose(spread + posterior.means[:, None], posterior.at(at)[0], atol=1e-9)
    assert posterior.spread_out((), at).shape == (2, 10, 2, 0)


def test_many_readings_are_conditioned_on_in_pieces(monkeypatch):
    """Places in blocks, and matrices of more than ``MANY`` rows by their Cholesky factor: the same field."""
    seen = observed(seed=8, n=40, times=2)
    whole = regression.fit_posterior(WindConfig(), seen)
    places = np.random.default_rng(0).uniform(-SIDE / 2, SIDE / 2, (400, 2))
    expected = whole.at(places)
    monkeypatch.setattr(regression, "MANY", 10)
    monkeypatch.setattr(regression, "MAX_PAIRS", 100)
    pieces = regression.fit_posterior(WindConfig(), seen)
    for one, other in zip(pieces.residuals, whole.residuals, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    for one, other in zip(pieces.at(places), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_hyperparameters_of_very_many_times_are_those_of_some_of_them(monkeypatch):
    several = [observed(seed=s, n=30) for s in range(5)]
    points, winds = [one.points[0] for one in several], [one.winds[0] for one in several]
    monkeypatch.setattr(regression, "MAX_TIMES", 2)
    found = regression.maximise_likelihood(WindConfig(), points, winds)
    monkeypatch.setattr(regression, "MAX_TIMES", 30)
    ends = regression.maximise_likelihood(WindConfig(), points[::4], winds[::4])
    assert found == ends
    assert found != regression.maximise_likelihood(WindConfig(), points, winds)
