"""The plane of a map, and directions in it."""

from __future__ import annotations

import numpy as np
import pytest

from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import rotate_vectors
from pareto_ltl.support.errors import DataError


def test_turning_a_quarter_makes_east_north():
    np.testing.assert_allclose(
        rotate_vectors(np.array([[2.0, 0.0]]), np.array([np.pi / 2])), [[0.0, 2.0]], atol=1e-15
    )


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ("EPSG:4326", "scene.crs 'EPSG:4326' is in degrees"),
        ("somewhere", "PROJ does not know scene.crs"),
        (None, "the map has no place on Earth: give scene.centre"),
    ],
)
def test_errors_of_a_plane_name_the_settings_of_the_map(crs, words):
    with pytest.raises(DataError, match=words):
        Frame(crs).to_plane(0.0, 0.0)
