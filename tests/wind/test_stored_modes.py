"""Modes in the file of a field, and the setting of their persistence."""

from __future__ import annotations

import numpy as np
import pytest

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.wind.netcdf import read_netcdf, write_netcdf
from problems import QUICK_ERROR, box, make_scene, smooth_wind


@pytest.mark.parametrize("rho", [-0.1, 1.1])
def test_rho_outside_zero_to_one_is_refused(rho):
    with pytest.raises(ConfigError, match=r"wind\.rho must lie in \[0, 1\]"):
        WindConfig(rho=rho)


def test_a_stored_field_keeps_its_modes(tmp_path):
    scene = make_scene({"a": box(2, 2, 4, 4)})
    wind = smooth_wind(scene, rho=0.4, error=QUICK_ERROR)
    again = read_netcdf(write_netcdf(wind, tmp_path / "wind.nc", scene))
    assert wind.modes is not None
    assert again.modes is not None
    np.testing.assert_array_equal(again.modes.psi, wind.modes.psi)
    np.testing.assert_allclose(again.modes.origin, wind.modes.origin)
    np.testing.assert_array_equal(again.modes.part, wind.modes.part)
    assert (again.modes.rho, again.modes.gap) == (0.4, wind.modes.gap)
    assert again.modes.rest_length == wind.modes.rest_length
    assert again.modes.spacing == pytest.approx(wind.modes.spacing)
    assert again.gust_time == wind.gust_time
