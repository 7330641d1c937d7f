"""Karhunen-Loeve modes of the posterior and the persistence of its errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.wind import gp as regression
from pareto_ltl.wind import modes
from pareto_ltl.wind.gp import CORRELATIONS, Hyper, WindPosterior, pairwise_distances
from pareto_ltl.wind.netcdf import read_netcdf, write_netcdf
from pareto_ltl.wind.records import WindModes, WindObservations
from problems import box, make_scene, smooth_wind

KM = 1000.0
HYPER = Hyper(2.0, 3.0, 300 * KM, 1.0)


def posterior(slots=2, stations=40, rho=0.7, seed=0, kernel="matern32"):
    """Readings of an AR(1) field of known covariance, with the hyperparameters that made them."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 1000 * KM, (stations, 2))
    K = HYPER.amplitude**2 * CORRELATIONS[kernel](pairwise_distances(places, places) / HYPER.length)
    root = np.linalg.cholesky(K + 1e-9 * np.eye(stations))
    field = [root @ rng.standard_normal((stations, 2))]
    noise = [rng.standard_normal((stations, 2))]
    for _ in range(slots - 1):
        step = np.sqrt(1 - rho**2)
        field.append(rho * field[-1] + step * root @ rng.standard_normal((stations, 2)))
        noise.append(rho * noise[-1] + step * rng.standard_normal((stations, 2)))
    winds = tuple(HYPER.mean + f + HYPER.noise * n for f, n in zip(field, noise, strict=True))
    times = 3600.0 * np.arange(slots)
    return WindPosterior(times, (places,) * slots, winds, kernel, ((HYPER, HYPER),) * slots, {})


def nodes(n=12):
    side = np.linspace(0, 1000 * KM, n)
    return np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("kernel", ["matern32", "rbf"])
def test_all_modes_together_are_the_posterior_covariance(kernel):
    post, where = posterior(kernel=kernel), nodes()
    psi, share = modes.posterior_modes(post, where, 0.999999, len(where))
    C = modes.posterior_covariance(kernel, HYPER, post.points[0], where, pairwise_distances(where, where))
    for c in (0, 1):
        np.testing.assert_allclose(psi[0, :, c] @ psi[0, :, c].T, C, atol=2e-4 * C.max())
    np.testing.assert_allclose(share, 1.0, atol=1e-5)
    _, variance = post.at(where)
    np.testing.assert_allclose((psi**2).sum(axis=-1), variance, atol=2e-3)


def test_the_energy_asked_for_is_kept_and_the_rest_is_named():
    where = nodes()
    post = posterior()
    psi, share = modes.posterior_modes(post, where, 0.9, len(where))
    few, least = modes.posterior_modes(post, where, 0.99, 8)
    assert np.all(share >= 0.9)
    assert psi.shape[-1] % modes.MODE_LANES == 0
    assert few.shape[-1] == 8
    assert np.all(least < 0.99)
    _, variance = post.at(where)
    kept = (few**2).sum(axis=(1, 3)) / variance.sum(axis=1)
    np.testing.assert_allclose(kept, least, atol=1e-4)


def test_alignment_rotates_but_keeps_the_covariance():
    rng = np.random.default_rng(0)
    psi, turn = rng.standard_normal((30, 8)), np.linalg.qr(rng.standard_normal((8, 8)))[0]
    back = modes.align_modes(psi @ turn, psi)
    np.testing.assert_allclose(back, psi, atol=1e-10)
    other = modes.align_modes(rng.standard_normal((30, 8)), psi)
    assert np.trace(other.T @ psi) > 0.0


def test_neighbouring_slots_look_alike_so_that_rho_ties_the_same_winds():
    """With equal readings and hyperparameters the modes of both slots agree, signs and order included."""
    one = posterior(slots=1)
    two = WindPosterior(np.array([0.0, 3600.0]), one.points * 2, one.winds * 2, one.kernel, one.hyper * 2, {})
    psi, _ = modes.posterior_modes(two, nodes(), 0.99, 60)
    np.testing.assert_allclose(psi[1], psi[0], atol=1e-3)


@pytest.mark.statistical
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_persistence_of_errors_is_found(rho):
    found = [modes.error_persistence(posterior(slots=12, stations=60, rho=rho, seed=s)) for s in range(8)]
    assert np.mean(found) == pytest.approx(rho, abs=0.08)


def test_without_stations_in_common_the_field_counts_as_frozen(caplog):
    one, other = posterior(slots=1, seed=0), posterior(slots=1, seed=1)
    moving = WindPosterior(
        np.array([0.0, 3600.0]), one.points + other.points, one.winds + other.winds, one.kernel,
        one.hyper * 2, {},
    )  # fmt: skip
    assert modes.error_persistence(moving) == 1.0
    assert "wind.rho" in caplog.text


def test_one_time_needs_no_persistence(caplog):
    assert modes.error_persistence(posterior(slots=1)) == 1.0
    assert not caplog.text


def test_a_singular_covariance_is_no_trouble():
    """Two stations at one place, and nodes on top of them."""
    places = np.array([[0.0, 0.0], [0.0, 0.0], [500 * KM, 0.0]])
    sharp = HYPER._replace(noise=1e-3)
    post = WindPosterior(np.zeros(1), (places,), (np.ones((3, 2)),), "rbf", ((sharp, sharp),), {})
    psi, share = modes.posterior_modes(post, np.vstack([places, places]), 0.99, 6)
    assert np.isfinite(psi).all()
    assert np.all(share <= 1.0 + 1e-9)
    assert np.isfinite(modes.error_persistence(post))


def test_readings_without_wind_give_modes_without_a_fault():
    rng = np.random.default_rng(int(SeedSequence(0).generate_state(1)[0]))
    places = rng.uniform(0, 1000 * KM, (20, 2))
    seen = WindObservations(np.zeros(1), (places,), (np.zeros((20, 2)),), "nothing stirs")
    post = regression.fit_posterior(WindConfig(), seen)
    psi, _ = modes.posterior_modes(post, nodes(6), 0.99, 30)
    assert np.isfinite(psi).all()


@pytest.mark.parametrize("rho", [-0.1, 1.1])
def test_rho_outside_zero_to_one_is_refused(rho):
    with pytest.raises(ConfigError, match=r"wind\.rho must lie in \[0, 1\]"):
        WindConfig(rho=rho)
    with pytest.raises(ValueError, match="rho"):
        WindModes(
            np.zeros(2),
            1.0,
            np.zeros((1, 2, 2, 2, 8), np.float32),
            rho,
            1.0,
            np.ones((1, 2)),
            np.ones((1, 2)),
        )


def test_a_stored_field_keeps_its_modes(tmp_path):
    scene = make_scene({"a": box(2, 2, 4, 4)})
    wind = smooth_wind(scene, rho=0.4)
    again = read_netcdf(write_netcdf(wind, tmp_path / "wind.nc", scene))
    assert wind.modes is not None
    assert again.modes is not None
    np.testing.assert_array_equal(again.modes.psi, wind.modes.psi)
    np.testing.assert_allclose(again.modes.origin, wind.modes.origin)
    assert (again.modes.rho, again.modes.gap) == (0.4, wind.modes.gap)
    assert again.modes.spacing == pytest.approx(wind.modes.spacing)
    assert again.gust_time == wind.gust_time
