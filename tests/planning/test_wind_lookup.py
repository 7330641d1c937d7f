"""The wind between nodes and slots: by hand from its formula, its slope by differences."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.planning.wind_lookup import interpolate, interpolate_time, wind_and_gradient

seeds = st.integers(0, 2**32 - 1)


def wind_of(rng: np.random.Generator) -> Any:
    """A wind in 4 slots on 5 x 4 nodes, 500 m apart, that is known for 6 steps."""
    return SimpleNamespace(
        west=-300.0, south=100.0, per_metre=1 / 500.0, mean=rng.normal(size=(4, 5, 4, 2)),
        slot=np.array([0, 0, 1, 2, 2, 3]), weight=np.array([0.0, 0.4, 0.9, 0.25, 0.5, 0.0]),
    )  # fmt: skip


def by_hand(wind: Any, step: int, x: np.ndarray) -> np.ndarray:
    """Σ over slots and nodes of the weight of each, a product of hats, beyond the lattice of its edge."""
    k, w = wind.slot[step], wind.weight[step]
    table = (1 - w) * wind.mean[k] + (w * wind.mean[k + 1] if w else 0.0)
    place = (x - np.array([wind.west, wind.south])) * wind.per_metre
    place = np.clip(place, 0.0, [4.0, 3.0])
    east, north = (
        np.maximum(1.0 - np.abs(np.arange(n) - g), 0.0) for n, g in zip((5, 4), place, strict=True)
    )
    return np.asarray(np.einsum("i,j,ijc->c", east, north, table))


@given(seeds)
def test_the_wind_is_the_sum_of_hats(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wind = wind_of(rng)
    x = rng.uniform([-500.0, 0.0], [1900.0, 1800.0], (8, 2))  # the last two are after the last known step
    mean, _ = wind_and_gradient(wind, x)
    for t, point in enumerate(x):
        step = min(t, 5)
        expected = by_hand(wind, step, point)
        np.testing.assert_allclose(mean[t], expected, atol=1e-12)
        np.testing.assert_allclose(interpolate(wind, wind.mean, step, point), expected, atol=1e-12)
        w = wind.weight[step]
        slots = [wind.mean[wind.slot[step]], wind.mean[min(wind.slot[step] + 1, 3)]]
        np.testing.assert_allclose(interpolate_time(wind, wind.mean, step), (1 - w) * slots[0] + w * slots[1])


@given(seeds)
def test_the_slope_is_that_of_differences_and_zero_beyond_the_lattice(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wind = wind_of(rng)
    square = rng.integers([0, 0], [4, 3], (6, 2)) + rng.uniform(0.05, 0.95, (6, 2))
    x = square * 500.0 + [wind.west, wind.south]
    _, slope = wind_and_gradient(wind, x)
    for axis in (0, 1):
        step = np.eye(2)[axis]
        ahead, behind = (
            np.array([by_hand(wind, t, point + way * step) for t, point in enumerate(x)])
            for way in (1.0, -1.0)
        )
        np.testing.assert_allclose(slope[:, :, axis], (ahead - behind) / 2.0, atol=1e-9)
    for beyond, axis in (
        ([-400.0, 700.0], 0),
        ([1800.0, 700.0], 0),
        ([700.0, 50.0], 1),
        ([700.0, 1700.0], 1),
    ):
        _, slope = wind_and_gradient(wind, np.array([beyond]))
        assert (slope[0][:, axis] == 0.0).all()
        assert (slope[0][:, 1 - axis] != 0.0).all()


@pytest.mark.parametrize("corner", [(-300.0, 100.0), (1700.0, 1600.0)])
def test_the_edge_of_the_lattice_is_on_it(corner: tuple[float, float]) -> None:
    _, slope = wind_and_gradient(wind_of(np.random.default_rng(1)), np.array([corner]))
    assert (slope != 0.0).all()
