"""Importance sampling's kernels against plain NumPy."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle import importance as plain
from pareto_ltl.kernels.importance import (
    Directions,
    LinearLaw,
    Mixture,
    NormalDraws,
    mixture_density,
    push_draws,
)
from pareto_ltl.simulation.failure_modes import linear_deviations

some = settings(deadline=None, max_examples=30)
seeds = st.integers(0, 2**32 - 1)
N, STEPS, EPOCHS, MODES, EVENTS, ERRORS = 7, 5, 3, 4, 6, 3


def linear_law(rng: np.random.Generator, modes: int = MODES) -> LinearLaw:
    kept = np.zeros((EPOCHS, modes), np.float32)
    kept[1:] = rng.uniform(0, 1, (EPOCHS - 1, modes))
    return LinearLaw(
        np.eye(2) + 0.2 * rng.standard_normal((STEPS, 2, 2)),
        rng.standard_normal((STEPS, 2, modes)).astype(np.float32), rng.uniform(0, 1, (STEPS, 2)),
        np.array([0, 0, 1, 2, 2]), kept, 100.0, 30.0,
        rng.standard_normal((STEPS, 2, ERRORS)), 20.0 * rng.standard_normal((2, ERRORS)),
    )  # fmt: skip


def normal_draws(rng: np.random.Generator, modes: int = MODES) -> NormalDraws:
    return NormalDraws(
        rng.standard_normal((N, 2)),
        rng.standard_normal((STEPS, N, 2)),
        rng.standard_normal((EPOCHS, N, 2, modes)).astype(np.float32),
        rng.standard_normal((N, ERRORS)),
    )


def linked(law: LinearLaw, draws: NormalDraws):
    """θ of the innovations, epoch by epoch."""
    theta = draws.field.copy()
    for k in range(1, EPOCHS):
        theta[k] = law.kept[k] * theta[k - 1] + np.sqrt(1 - law.kept[k] ** 2) * theta[k]
    return theta


@some
@given(seeds, st.sampled_from([0, 1, MODES]))
def test_deviations_are_a_matrix_times_the_draws(seed, modes):
    rng = np.random.default_rng(seed)
    law, draws = linear_law(rng, modes), normal_draws(rng, modes)
    e = linear_deviations(law, draws, linked(law, draws))
    expected = np.einsum("tid,nd->nti", plain.deviation_map(law), plain.joined(draws))
    np.testing.assert_allclose(e, expected, atol=1e-3)


@some
@given(seeds)
def test_a_push_changes_the_draws_along_one_direction_only(seed):
    rng = np.random.default_rng(seed)
    draws = normal_draws(rng)
    before = plain.joined(draws)
    omega = rng.standard_normal((EVENTS, before.shape[1]))
    omega /= np.linalg.norm(omega, axis=1, keepdims=True)
    white, field = omega[:, 2 : 2 + 2 * STEPS], omega[:, 2 + 2 * STEPS : -ERRORS]
    directions = Directions(
        omega[:, :2].copy(),
        white.reshape(EVENTS, STEPS, 2).copy(),
        field.reshape(EVENTS, EPOCHS, 2, MODES).copy(),
        omega[:, -ERRORS:].copy(),
    )
    event, size = rng.integers(-1, EVENTS, N), rng.uniform(0, 6, N)
    push_draws(directions, event, size, draws)
    after = plain.joined(draws)
    for i in range(N):
        own = omega[event[i]] if event[i] >= 0 else np.zeros(before.shape[1])
        expected = before[i] + (size[i] - own @ before[i]) * own
        np.testing.assert_allclose(after[i], expected, atol=1e-5)


@some
@given(seeds)
def test_the_density_is_the_sum_over_components(seed):
    rng = np.random.default_rng(seed)
    e = rng.standard_normal((40, STEPS + 1, 2))
    weight = rng.standard_normal((EVENTS, STEPS + 1, 2)) * (rng.random((EVENTS, STEPS + 1, 1)) < 0.5)
    weight[:, 0, 0] += 1.0
    threshold, level = rng.uniform(0.1, 4, EVENTS), np.array([1.0, 0.9, 0.6])
    share, left = np.array([0.4, 0.3, 0.2]), 0.1
    bounds = np.array([sum(0.5 * math.erfc(s * t / math.sqrt(2)) for t in threshold) for s in level])
    event, step = np.nonzero(weight.any(axis=2))
    ptr = np.searchsorted(event, np.arange(EVENTS + 1))
    scale, shares = np.ones(40), np.tile(share / bounds, (40, 1))
    mixture = Mixture(ptr, step, weight[event, step], threshold, level, scale, shares, left)
    density = np.empty(40)
    mixture_density(mixture, e, density)
    reached = np.einsum("jti,nti->nj", weight, e)
    expected = plain.proposal_density(reached, threshold, level, share, left)
    np.testing.assert_allclose(density, expected, rtol=1e-9)
    # at a scale c, deviations of half the size reach as far
    doubled = np.empty(40)
    mixture_density(mixture._replace(scale=np.full(40, 2.0)), 0.5 * e, doubled)
    np.testing.assert_allclose(doubled, density, rtol=1e-12)
