"""Karhunen-Loeve modes of the posterior and the persistence of its errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import SeedSequence

from wind_laws import gp as regression
from wind_laws import modes
from wind_laws.gp import CORRELATIONS, FitOptions, Hyper, WindPosterior, leave_one_out
from wind_laws.places import pairwise_distances
from wind_laws.records import ENSEMBLE, FORECAST, FORECAST_PARTS, SPACE, TIME, PlacedReadings, WindModes

LOCAL = FORECAST_PARTS["local"]
KM = 1000.0
HYPER = Hyper(3.0, 300 * KM, 1.0)
MEAN = 2.0


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
    winds = tuple(MEAN + f + HYPER.noise * n for f, n in zip(field, noise, strict=True))
    times = 3600.0 * np.arange(slots)
    means = np.full((slots, 2), MEAN)
    points = (places,) * slots
    own = leave_one_out(kernel, points, winds, HYPER, means)
    return WindPosterior(times, points, winds, kernel, HYPER, means, {}, own, places, np.ones(stations))


def nodes(n=12):
    side = np.linspace(0, 1000 * KM, n)
    return np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)


def modes_of(post, energy=0.999999, most=144, forecast=0.0, local=0.0, between=0.0, members=None):
    """Variances of forecasts and of interpolation in time are the same in all slots."""
    slots = len(post.times)
    parts = [
        modes.UniformPart(FORECAST, np.full(slots, forecast), 400 * KM),
        modes.UniformPart(LOCAL, np.full(slots, local), 100 * KM),
        modes.UniformPart(TIME, np.full(slots, between), 250 * KM),
    ]
    none = np.zeros((slots, 144, 2, 0))
    return modes.error_modes(
        post, parts, none if members is None else members, (12, 12), nodes(), energy, most
    )


def of_part(found, part, k=0, c=0):
    psi = found.psi[k, :, c, found.part == part].astype(float).T
    return psi @ psi.T


@pytest.mark.parametrize("kernel", ["matern12", "matern32", "rbf"])
def test_all_modes_together_are_the_posterior_covariance(kernel):
    post, where = posterior(kernel=kernel), nodes()
    found = modes_of(post)
    C = modes.posterior_covariance(post, 0, where, pairwise_distances(where, where))
    for c in (0, 1):
        np.testing.assert_allclose(of_part(found, SPACE, c=c), C, atol=2e-4 * C.max())
    np.testing.assert_allclose(found.energy, 1.0, atol=1e-5)
    _, variance = post.at(where)
    np.testing.assert_allclose((found.psi**2).sum(axis=-1), variance, atol=2e-3)


def test_the_variance_factor_scales_rows_and_columns_of_the_covariance():
    post, where = posterior(), nodes()
    rough = replace(post, squares=np.where(post.anchors[:, 0] > 500 * KM, 4.0, 1.0))
    C = modes.posterior_covariance(rough, 0, where, pairwise_distances(where, where))
    np.testing.assert_allclose(np.diag(C), rough.at(where)[1][0, :, 0], rtol=1e-6, atol=1e-9)
    plain = modes.posterior_covariance(post, 0, where, pairwise_distances(where, where))
    sd, was = np.sqrt(np.diag(C)), np.sqrt(np.diag(plain))
    np.testing.assert_allclose(C / np.outer(sd, sd), plain / np.outer(was, was), atol=1e-9)


def test_the_parts_of_the_error_have_their_own_covariances():
    found = modes_of(posterior(), forecast=0.5, local=0.2, between=0.3, most=576)
    apart = pairwise_distances(nodes(), nodes())
    matern = CORRELATIONS["matern32"]
    np.testing.assert_allclose(of_part(found, FORECAST), 0.5 * matern(apart / (400 * KM)), atol=1e-3)
    np.testing.assert_allclose(
        of_part(found, TIME), matern(apart / (250 * KM)), atol=2e-3
    )  # of unit variance
    np.testing.assert_allclose(of_part(found, LOCAL), 0.2 * matern(apart / (100 * KM)), atol=1e-3)
    assert set(found.part) <= {-1, SPACE, FORECAST, LOCAL, TIME}
    assert (found.psi[..., found.part == -1] == 0.0).all()


def test_members_of_an_ensemble_keep_their_covariance_over_space_and_time():
    rng = np.random.default_rng(3)
    members = rng.standard_normal((2, 144, 2, 5))
    found = modes_of(posterior(), members=members, most=432)
    own = found.part == ENSEMBLE
    assert own.sum() == 5
    for c in (0, 1):
        psi = found.psi[:, :, c, own].astype(float).reshape(288, 5)
        flat = members[:, :, c].reshape(288, 5)
        np.testing.assert_allclose(psi @ psi.T, flat @ flat.T, atol=1e-4)


def test_the_energy_asked_for_is_kept_and_the_rest_is_named():
    post = posterior()
    most, few = modes_of(post, energy=0.9), modes_of(post, energy=0.99, most=8)
    assert most.energy.mean() >= 0.9
    assert most.psi.shape[-1] % modes.MODE_LANES == 0
    assert few.psi.shape[-1] == 8
    assert np.all(few.energy < 0.99)
    _, variance = post.at(nodes())
    kept = (few.psi**2).sum(axis=(1, 3)) / variance.sum(axis=1)
    np.testing.assert_allclose(kept, few.energy, atol=1e-4)
    assert 0.0 < few.rest_length < 300 * KM


@pytest.mark.parametrize("most", [8, 24])
def test_modes_and_remainder_carry_a_straight_flight_as_far_as_the_whole_covariance(most):
    """The sd of the mean error along a line: exact, and by modes and a white remainder of its length."""
    post = posterior(stations=30, kernel="matern12")
    side = np.linspace(0, 1000 * KM, 26)
    fine = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    found = modes.error_modes(post, (), np.zeros((2, 676, 2, 0)), (26, 26), fine, 0.999, most)
    C = modes.posterior_covariance(post, 0, fine, pairwise_distances(fine, fine))
    rest = C - of_part(found, SPACE)
    ratios = []
    for row in range(26):  # lines to the north: a row of nodes, 1000 km
        own = slice(26 * row, 26 * row + 26)
        carried = (C - rest)[own, own].mean() + np.diag(rest)[own].mean() * 2 * found.rest_length / 1e6
        ratios.append(np.sqrt(carried / C[own, own].mean()))
    assert 0.93 < np.mean(ratios) < 1.07


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
    two = replace(
        one, times=np.array([0.0, 3600.0]), points=one.points * 2, winds=one.winds * 2,
        means=np.repeat(one.means, 2, axis=0),
    )  # fmt: skip
    found = modes_of(two, most=60)
    np.testing.assert_allclose(found.psi[1], found.psi[0], atol=1e-3)


@pytest.mark.statistical
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_persistence_of_errors_is_found(rho):
    found = [modes.error_persistence(posterior(slots=12, stations=60, rho=rho, seed=s)) for s in range(8)]
    assert np.mean(found) == pytest.approx(rho, abs=0.1)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=9))
def test_persistence_has_the_sum_of_the_correlations(correlations):
    rho = modes.persistence_of(correlations)
    assert 0.0 <= rho <= 1.0
    total = sum(rho**j for j in range(1, len(correlations) + 1))
    assert total == pytest.approx(sum(correlations), abs=1e-6)


def test_errors_that_stay_raise_the_persistence():
    """Half of the variance never changes: after one slot the correlation is 0.6, but it does not fall on."""
    assert modes.persistence_of([0.6, 0.52, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]) > 0.75


def test_without_stations_in_common_the_field_counts_as_frozen(caplog):
    one, other = posterior(slots=1, seed=0), posterior(slots=1, seed=1)
    moving = replace(
        one, times=np.array([0.0, 3600.0]), points=one.points + other.points, winds=one.winds + other.winds,
        means=np.repeat(one.means, 2, axis=0),
    )  # fmt: skip
    assert modes.error_persistence(moving, " (state it)") == 1.0
    assert "for ever (state it)" in caplog.text


def test_one_time_needs_no_persistence(caplog):
    assert modes.error_persistence(posterior(slots=1)) == 1.0
    assert not caplog.text


def test_a_singular_covariance_is_no_trouble():
    """Two stations at one place, and nodes on top of them."""
    places = np.array([[0.0, 0.0], [0.0, 0.0], [500 * KM, 0.0]])
    sharp = HYPER._replace(noise=1e-3)
    points, winds, means = (places,), (np.ones((3, 2)),), np.full((1, 2), MEAN)
    own = leave_one_out("rbf", points, winds, sharp, means)
    post = WindPosterior(np.zeros(1), points, winds, "rbf", sharp, means, {}, own, places, np.ones(3))
    nobody = np.zeros((1, 6, 2, 0))
    found = modes.error_modes(post, (), nobody, (2, 3), np.vstack([places, places]), 0.99, 6)
    assert np.isfinite(found.psi).all()
    assert np.all(found.energy <= 1.0 + 1e-9)
    assert np.isfinite(modes.error_persistence(post))


def test_readings_without_wind_give_modes_without_a_fault():
    rng = np.random.default_rng(int(SeedSequence(0).generate_state(1)[0]))
    places = rng.uniform(0, 1000 * KM, (20, 2))
    seen = PlacedReadings(np.zeros(1), (places,), (np.zeros((20, 2)),), "nothing stirs")
    post = regression.fit_posterior(FitOptions(), seen)
    assert np.isfinite(modes_of(post, most=30).psi).all()


@pytest.mark.parametrize("rho", [-0.1, 1.1])
def test_a_persistence_outside_zero_to_one_is_refused(rho):
    psi, ones = np.zeros((1, 2, 2, 2, 8), np.float32), np.ones((1, 2))
    with pytest.raises(ValueError, match="rho"):
        WindModes(np.zeros(2), 1.0, psi, np.zeros(8, int), rho, 1.0, ones, ones)
