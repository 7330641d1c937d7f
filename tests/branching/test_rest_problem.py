"""The rest of a flight from a cell: its own errors and its wind, whitened anew."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.problem import errors_with
from pareto_ltl.wind.records import WindField
from pareto_ltl_apps.branching.rest_problem import Rest
from wind_laws import conditioned


@given(st.integers(0, 2**32 - 1))
def test_own_errors_have_the_covariances_that_were_learnt(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mean, root, apart = rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    cov, shared = root @ root.T, apart @ root.T
    errors = errors_with(mean, cov, shared)
    np.testing.assert_array_equal(errors.mean, mean)
    np.testing.assert_allclose(errors.root @ errors.root.T, cov, atol=1e-9)
    np.testing.assert_allclose(errors.start @ errors.root.T, shared, atol=1e-6)
    np.testing.assert_allclose(errors.root, np.tril(errors.root), atol=1e-12)
    assert (np.diag(errors.root) > 0.0).all()


def test_a_robot_without_errors_has_none_in_a_cell() -> None:
    assert errors_with(np.zeros(0), np.zeros((0, 0)), np.zeros((2, 0))) is kd.EXACT


@pytest.mark.parametrize("rows", [1, 3])
def test_the_wind_of_flights_in_a_cell_is_standard_normal_again(
    rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """θ of 40,000 flights, drawn as N(ρ m, I - ρ² B' B), is N(0, I) in the modes of the rest.

    The rest begins at step 2 of epochs 0, 0, 1, 1, 2: its steps are of the epochs 1, 1, 2 of the whole, and
    0, 0, 1 of itself.
    """
    flights, size, share = 40_000, 3, 0.8
    rng = np.random.default_rng(3)
    told = rng.normal(size=(rows, 2, size))
    told *= 0.9 / max(float(np.linalg.norm(told)), 1.0)
    mean = rng.normal(size=(2, size))
    drawn = np.zeros((3, flights, 2, size))
    for c in (0, 1):
        cov = np.eye(size) - share**2 * told[:, c].T @ told[:, c]
        drawn[1, :, c] = rng.multivariate_normal(share * mean[c], cov, flights)
    drawn[2] = rng.normal(size=(flights, 2, size)) * 2.0
    monkeypatch.setattr(
        conditioned, "persistence", lambda field, since: np.full((5, size), share * (since == 30.0))
    )
    modes = SimpleNamespace(epoch=np.array([0, 0, 1, 1, 1]), slot=np.array([3, 3, 4, 4, 4]))
    problem: Any = SimpleNamespace(modes=modes, horizon=3)
    whole = SimpleNamespace(modes=SimpleNamespace(epoch=np.array([0, 0, 1, 1, 2])))
    field: Any = SimpleNamespace(times=np.array([-50.0, -40.0, -35.0, 30.0, 60.0]))
    field.coefficients_given = partial(WindField.coefficients_given, field)
    monkeypatch.setattr(conditioned, "with_held_slots", lambda field: field)
    learnt: Any = SimpleNamespace(told=told, theta=mean)
    winds: Any = SimpleNamespace(problem=whole, draws=SimpleNamespace(theta=drawn))
    found = Rest(problem, field, learnt, 2)._whitened(winds)  # noqa: SLF001
    assert found.shape == (2, flights, 2, size)
    for c in (0, 1):
        np.testing.assert_allclose(found[0, :, c].mean(axis=0), 0.0, atol=0.03)
        np.testing.assert_allclose(np.cov(found[0, :, c].T), np.eye(size), atol=0.04)
