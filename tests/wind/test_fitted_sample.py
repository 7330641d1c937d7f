"""The fit of the packaged sample."""

from __future__ import annotations

import numpy as np
import pytest

from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.wind import sources
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.world.scene import Scene
from wind_laws import gp as regression


@pytest.fixture(scope="module")
def sample():
    scene = Scene(np.array([[-5e5, -5e5], [5e5, 5e5]]), np.zeros(2), {}, (), frames.local_plane(37, -92))
    return place_readings(WindConfig(), sources.read_readings(WindConfig()), scene)


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


def test_the_same_readings_give_the_same_posterior(sample):
    one, two = (regression.fit_posterior(WindConfig(), sample) for _ in range(2))
    np.testing.assert_allclose(one.hyper, two.hyper, rtol=1e-9)
    np.testing.assert_allclose(one.means, two.means, rtol=1e-9)
    assert one.score == pytest.approx(two.score, rel=1e-9)
