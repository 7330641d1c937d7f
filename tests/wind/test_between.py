"""Winds known at nodes and times only: flights in them draw what lies between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl.wind.records import WindField
from problems import QUICK_ERROR, box, make_scene, smooth_wind
from wind_laws.between import with_interpolation_errors
from wind_laws.records import FORECAST_PARTS, SPACE, TIME

SCENE = make_scene({"a": box(13, 13, 19, 19)}, [])
HOUR = 3600.0


def believed() -> WindField:
    """A field whose modes are of space, of a forecast and of time, with leads."""
    field = smooth_wind(SCENE, sd=0.5, gust=0.1, error=QUICK_ERROR)
    assert field.modes is not None
    part = np.arange(len(field.modes.part)) % 3
    numbers = np.array([SPACE, FORECAST_PARTS["slow"], TIME])
    law = law_of_parts_named("gfs")
    leads = 6 * HOUR + field.times
    variance = field.latent_var + law.forecast_variance(leads)[:, None, None, None]
    modes = replace(field.modes, part=numbers[part])
    return replace(field, modes=modes, error=law, leads=leads, latent_var=variance)


def real(field: WindField, times: np.ndarray) -> WindField:
    """Known winds at other times, on a finer lattice."""
    shape = 2 * field.mean.shape[1] - 1, 2 * field.mean.shape[2] - 1
    mean = np.random.default_rng(0).normal(size=(len(times), *shape, 2))
    return WindField(
        field.origin, field.spacing / 2, times, mean, np.zeros_like(mean), np.full((len(times), 2), 0.3)
    )  # fmt: skip


def test_space_and_time_are_drawn_and_forecasts_are_not() -> None:
    field = believed()
    known = real(field, np.array([0.0, 3.0 * HOUR]))
    found = with_interpolation_errors(known, field)
    assert found.modes is not None
    assert field.modes is not None
    assert set(found.modes.part.tolist()) == {SPACE, TIME, -1}
    np.testing.assert_array_equal(found.modes.psi[..., found.modes.part == -1], 0.0)
    same = found.modes.part != -1
    slot = [int(np.argmin(np.abs(field.times - t))) for t in known.times]
    np.testing.assert_array_equal(found.modes.psi[..., same], field.modes.psi[slot][..., same])
    np.testing.assert_array_equal(found.mean, known.mean)
    np.testing.assert_array_equal(found.gust_var, known.gust_var)
    assert found.error is not None
    assert found.error.parts == ()
    halfway = found.time_variance(np.array([0.0, 1.5 * HOUR, 3.0 * HOUR]))
    assert halfway[1] > 0.1
    np.testing.assert_allclose(halfway[[0, 2]], 0.0, atol=1e-9)


def test_the_variance_at_shared_nodes_is_that_of_interpolation_in_space() -> None:
    field = believed()
    found = with_interpolation_errors(real(field, field.times[:2]), field)
    forecasts = field.error.forecast_variance(field.leads[:2]) if field.error is not None else 0.0
    spatial = field.latent_var[:2] - np.asarray(forecasts)[:, None, None, None]
    np.testing.assert_allclose(found.latent_var[:, ::2, ::2], spatial, atol=1e-9)


def test_a_field_without_modes_or_law_leaves_the_winds_as_they_are() -> None:
    field = believed()
    known = real(field, field.times[:2])
    assert with_interpolation_errors(known, replace(field, modes=None)) is known
    assert with_interpolation_errors(known, replace(field, error=None)) is known
