"""``UncertainWind.at`` and ``gradient``: the expected wind between nodes and slots."""

from __future__ import annotations

import numpy as np
import pytest

from wind_laws.records import UncertainWind

SLOPE = np.array([[2e-4, -1e-4], [5e-5, 3e-4]])  # [1/s] by component and direction
RISE = np.array([1e-3, -2e-3])  # [m/s²]
TIMES = np.array([0.0, 3600.0, 10_800.0])


@pytest.fixture(scope="module")
def plane() -> UncertainWind:
    """A wind that is linear in place and time, w = (1, -2) + SLOPE x + RISE t."""
    steps = np.stack(np.meshgrid(np.arange(5), np.arange(4), indexing="ij"), axis=-1)
    x = np.array([-1000.0, 500.0]) + 2000.0 * steps
    mean = np.array([1.0, -2.0]) + x @ SLOPE.T + (TIMES[:, None] * RISE)[:, None, None]
    return UncertainWind(
        origin=np.array([-1000.0, 500.0]), spacing=2000.0, times=TIMES, mean=mean,
        latent_var=np.ones_like(mean), gust_var=np.ones((3, 2)),
    )  # fmt: skip


def test_a_linear_wind_is_read_exactly_between_nodes_and_slots(plane: UncertainWind) -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform([-1000.0, 500.0], [7000.0, 6500.0], (50, 2))
    for t in (0.0, 900.0, 3600.0, 9999.0, 10_800.0):
        np.testing.assert_allclose(plane.at(x, t), np.array([1.0, -2.0]) + x @ SLOPE.T + t * RISE, rtol=1e-12)
        np.testing.assert_allclose(plane.gradient(x, t), np.broadcast_to(SLOPE, (50, 2, 2)), rtol=1e-9)


def test_beyond_the_lattice_and_its_times_the_wind_stays_as_it_is(plane: UncertainWind) -> None:
    edge, beyond = np.array([7000.0, 2000.0]), np.array([9e5, 2000.0])
    np.testing.assert_array_equal(plane.at(beyond, 0.0), plane.at(edge, 0.0))
    np.testing.assert_array_equal(plane.at(edge, 1e6), plane.at(edge, TIMES[-1]))
    np.testing.assert_array_equal(plane.at(edge, -5.0), plane.at(edge, 0.0))
    np.testing.assert_array_equal(plane.gradient(beyond, 0.0)[0, :, 0], 0.0)
    np.testing.assert_allclose(plane.gradient(beyond, 0.0)[0, :, 1], SLOPE[:, 1], rtol=1e-9)


def test_a_field_that_begins_later_has_the_same_wind(plane: UncertainWind) -> None:
    x = np.array([[100.0, 900.0], [6500.0, 600.0]])
    np.testing.assert_allclose(plane.later(5000.0).at(x, 1000.0), plane.at(x, 6000.0), rtol=1e-12)
