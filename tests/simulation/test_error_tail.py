"""Heavy tails of forecast errors in flights: scales, their weights, and rare failures, each on two roads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.integrate import quad
from scipy.special import polygamma
from scipy.stats import norm

from careful_io.times import HOUR
from coherent import coherent_problem
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import PlannerConfig, RobotConfig, preset
from pareto_ltl.simulation.flights import draw_coherent
from pareto_ltl.simulation.importance import weighted_rate
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl.wind.records import WindField
from point_forecasts_made import made_law
from problems import QUICK_ERROR, along, box, make_problem, make_scene, smooth_wind
from wind_laws.error_law import TailScale
from wind_laws.records import FORECAST, FORECAST_PARTS, TIME
from wind_laws.tails import ErrorTail, draw_scales, error_tail, scaled_fields, weighted_scales

TAIL = ErrorTail(
    0.3, np.array([0.4, 0.5, 0.2]), np.array([0.0, 0.6, 0.9]), np.array([True, False, False]), 0.35,
    np.array([False, True, False]),
)  # fmt: skip
N = 400_000
GROWING = FORECAST_PARTS["growing"]


def test_scales_keep_the_mean_square_and_their_correlation() -> None:
    c, change = draw_scales(TAIL, 3, N, np.random.default_rng(1))
    s2 = TAIL.flight**2 + TAIL.moment**2
    spread = np.sqrt(np.exp(4 * s2) - 1.0)  # of c², with mean 1
    assert (np.abs((c**2).mean(axis=1) - 1.0) < 6.0 * spread / np.sqrt(N)).all()
    log = np.log(c) + s2[:, None]
    covariance = np.cov(log)
    expected = TAIL.flight**2 + 0.6 * TAIL.moment[0] * TAIL.moment[1]
    assert covariance[0, 1] == pytest.approx(expected, abs=0.004)
    np.testing.assert_allclose(np.diag(covariance), s2, atol=0.004)
    assert np.log(change).std() == pytest.approx(0.35, abs=0.002)
    assert np.mean(change**2) == pytest.approx(1.0, abs=6.0 * np.sqrt((np.exp(0.49) - 1.0) / N))
    assert abs(np.corrcoef(np.log(change), log[0])[0, 1]) < 6.0 / np.sqrt(N)


def test_a_longer_flight_has_the_scales_of_a_shorter_one_first() -> None:
    two, three = (draw_scales(TAIL, n, 50, np.random.default_rng(2)) for n in (2, 3))
    np.testing.assert_array_equal(two.forecasts, three.forecasts[:2])
    np.testing.assert_array_equal(two.change, three.change)


def test_weighted_scales_give_the_law_back() -> None:
    (c, change), weight = weighted_scales(TAIL, 3, N, np.random.default_rng(3))
    assert weight.max() <= 4.0
    assert weight.mean() == pytest.approx(1.0, abs=6.0 * weight.std() / np.sqrt(N))
    s = np.sqrt(TAIL.flight**2 + TAIL.moment**2)
    for k in range(3):
        exact = norm.sf((np.log(3.0) + s[k] ** 2) / s[k])
        assert np.mean(weight * (c[k] > 3.0)) == pytest.approx(exact, rel=0.06)
    assert np.mean(weight * (change > 2.0)) == pytest.approx(norm.sf(np.log(2.0) / 0.35 + 0.35), rel=0.06)
    plain = draw_scales(TAIL, 1, N, np.random.default_rng(3)).forecasts[0] > 3.0
    assert np.sum(c[0] > 3.0) > 10 * plain.sum()  # what the weights are for


def tailed(field: WindField, spread: float = 0.5) -> WindField:
    """``field`` with its forecast errors as the growing part of a law whose tails last for a flight."""
    assert field.modes is not None
    part = np.where(field.modes.part == FORECAST, GROWING, field.modes.part)
    made = made_law(spread)
    law = replace(made, parts=tuple(each for each in made.parts if each.name == "growing"))
    return replace(field, error=law, modes=replace(field.modes, part=part))


def tailed_problem(spread: float = 0.5) -> Problem:
    """Half of the variance of the wind is of the forecast."""
    scene = make_scene({"a": box(13, 13, 19, 19)}, [box(8, 1, 12, 5.5), box(9, 15, 11, 20)], start=(2, 3))
    wind = tailed(smooth_wind(scene, sd=0.5, gust=0.1, error=QUICK_ERROR), spread)
    robot = RobotConfig(dt=100.0, u_max=25.0, start_sd=10.0)
    return make_problem(
        "F a", scene, wind, robot, PlannerConfig(epsilon=0.999, delta=0.999), fidelity=preset("full")
    )


def test_a_field_without_tails_or_forecasts_has_none() -> None:
    p = coherent_problem(error=QUICK_ERROR)
    assert p.tail is None
    found = tailed_problem().tail
    assert found is not None
    assert found.scaled.sum() == 24
    assert found.kept[0] == 0.0


def test_moments_follow_the_lead_of_the_slot_and_their_memory() -> None:
    scale = TailScale(0.1, HOUR * np.array([0.0, 10.0]), np.array([0.2, 0.7]), 2 * HOUR)
    scene = make_scene({"a": box(13, 13, 19, 19)}, [])
    wind = tailed(smooth_wind(scene, sd=0.5, error=QUICK_ERROR))
    assert wind.error is not None
    wind = replace(wind, error=replace(wind.error, scale=scale), leads=HOUR * (4.0 + wind.times / HOUR))
    robot = RobotConfig(dt=100.0, u_max=25.0)
    p = make_problem("F a", scene, wind, robot, fidelity=preset("full"))
    found = error_tail(wind, p.modes.slot, p.modes.epoch)
    assert found is not None
    first = [int(np.flatnonzero(p.modes.epoch == k)[0]) for k in range(len(found.moment))]
    slot = p.modes.slot[first]
    np.testing.assert_allclose(found.moment, 0.2 + 0.05 * (4.0 + wind.times[slot] / HOUR))
    np.testing.assert_allclose(found.kept[1:], np.exp(-np.diff(wind.times[slot]) / (2 * HOUR)))


def test_only_the_forecast_is_scaled_and_every_other_draw_is_the_same() -> None:
    p = tailed_problem()
    plain = draw_coherent(replace(p, tail=None), 20, 30, np.random.default_rng(4))
    drawn = draw_coherent(p, 20, 30, np.random.default_rng(4))
    own = p.modes.part == GROWING
    np.testing.assert_array_equal(drawn.white, plain.white)
    np.testing.assert_array_equal(drawn.theta[..., ~own], plain.theta[..., ~own])
    ratio = drawn.theta[..., own] / plain.theta[..., own]
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[..., :1, :1], ratio.shape), rtol=1e-5)
    assert ratio.std() > 0.2


def test_changes_in_time_have_one_scale_for_the_flight() -> None:
    scales = draw_scales(TAIL, 3, 50, np.random.default_rng(2))
    found = scaled_fields(TAIL, np.ones((3, 50, 2, 3), np.float32), scales)
    np.testing.assert_allclose(found[..., 0], np.repeat(scales.forecasts[..., None], 2, 2), rtol=1e-6)
    np.testing.assert_allclose(found[..., 1], np.tile(scales.change[:, None], (3, 1, 2)), rtol=1e-6)
    np.testing.assert_array_equal(found[..., 2], 1.0)


def test_a_law_whose_change_depends_on_the_winds_gives_changes_tails() -> None:
    """Without errors of forecasts too; a law of the first version has none."""
    scene = make_scene({"a": box(13, 13, 19, 19)}, [])
    wind = smooth_wind(scene, sd=0.5, error=QUICK_ERROR)
    assert wind.modes is not None
    wind = replace(wind, modes=replace(wind.modes, part=np.full(len(wind.modes.part), TIME)))
    p = make_problem("F a", scene, wind, RobotConfig(dt=100.0, u_max=25.0), fidelity=preset("full"))
    assert error_tail(wind, p.modes.slot, p.modes.epoch) is None
    law = law_of_parts_named("gfs").shared(0.0)
    found = error_tail(replace(wind, error=law), p.modes.slot, p.modes.epoch)
    assert found is not None
    assert found.changed.all()
    assert not found.scaled.any()
    assert found.change == law.change_tail == pytest.approx(0.5 * np.sqrt(polygamma(1, 2.39)), abs=0.01)
    np.testing.assert_array_equal(found.gradient, [0.0, 0.0, found.change])


@pytest.mark.statistical
def test_flights_have_the_foreseen_variance_and_heavier_tails() -> None:
    p = tailed_problem(0.6)
    path = evaluate_path(p, along((2, 3), (6, 8), (11, 12), (16, 16), step=0.8), "by hand")
    flights = simulate_flights(p, path.u, 40_000, "coherent", SeedSequence(1), path.x)
    off = flights.x[:, -1] - flights.x[:, -1].mean(axis=0)
    # E|e| / σ, sqrt(2 / π) for a Gaussian; the kurtosis of so many flights is 4.4 to 7.2, by seed.
    # At most half of the variance is scaled, since gusts and the start are not.
    peaked = np.abs(off).mean(axis=0) / off.std(axis=0)
    least = (
        np.sqrt(2.0 / np.pi)
        * quad(lambda z: norm.pdf(z) * np.sqrt(0.5 + 0.5 * np.exp(2.0 * (0.6 * z - 0.36))), -9.0, 9.0)[0]
    )
    assert (peaked > least - 0.01).all()
    assert (peaked < np.sqrt(2.0 / np.pi) - 0.01).all()
    np.testing.assert_allclose(off.std(axis=0), np.sqrt(np.diag(path.cov[-1])), rtol=0.06)


@pytest.mark.statistical
def test_weighted_flights_agree_with_plain_ones() -> None:
    p = tailed_problem(0.5)
    path = evaluate_path(p, along((2, 3), (6, 8), (11, 12), (16, 16), step=0.8), "by hand")
    failed = simulate_flights(p, path.u, 200_000, "coherent", SeedSequence(5), path.x).failed
    low, high = clopper_pearson(int(failed.sum()), len(failed), 1 - 1e-6)
    rate = weighted_rate(p, path, 20_000, SeedSequence(6))
    assert rate is not None
    assert 10 < failed.sum() < 20_000
    assert rate.low <= high
    assert rate.high >= low
    gaussian = simulate_flights(replace(p, tail=None), path.u, 200_000, "coherent", SeedSequence(5), path.x)
    assert failed.sum() != gaussian.failed.sum()


@pytest.mark.parametrize(
    ("flight", "leads", "moment", "memory", "message"),
    [
        (0.1, [0.0, 1.0], [0.2], 1.0, "moment"),
        (0.1, [], [], 1.0, "increase from 0"),
        (0.1, [1.0, 2.0], [0.2, 0.2], 1.0, "increase from 0"),
        (0.1, [0.0, 0.0], [0.2, 0.2], 1.0, "increase from 0"),
        (-0.1, [0.0, 1.0], [0.2, 0.2], 1.0, "must not be negative"),
        (0.1, [0.0, 1.0], [0.2, -0.2], 1.0, "must not be negative"),
        (0.1, [0.0, 1.0], [0.2, 0.2], 0.0, "must not be negative"),
        (1.25, [0.0, 1.0], [0.2, 0.2], 1.0, "spreads by more"),
        (0.0, [0.0, 1.0], [0.2, 1.25], 1.0, "spreads by more"),
        (0.9, [0.0, 1.0], [0.2, 0.9], 1.0, "spreads by more"),
    ],
)
def test_a_scale_that_cannot_be_is_refused(
    flight: float, leads: list[float], moment: list[float], memory: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        TailScale(flight, np.array(leads), np.array(moment), memory)


def test_the_largest_scales_are_allowed() -> None:
    assert TailScale(1.2, np.zeros(1), np.zeros(1), 1.0).spread(0.0) == 1.2
    assert TailScale(0.0, np.zeros(1), np.array([1.2]), 1.0).spread(0.0) == pytest.approx(1.2)


@pytest.mark.parametrize("x", [1e-5, 2e-4, 0.1, 1.0, 7.0])
def test_a_mean_over_a_time_varies_as_its_double_integral_says(x: float) -> None:
    """Var = 2 / x² times the integral of (x - r) exp(-r) over r from 0 to x."""
    found, _ = quad(lambda r: 2.0 * (1.0 - r) * np.exp(-r * x), 0.0, 1.0)
    assert float(TailScale.averaged(x)) == pytest.approx(found, rel=1e-6)
