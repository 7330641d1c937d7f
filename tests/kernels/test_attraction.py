"""The attraction of landmarks: the kernel against its plain definition."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from oracle.attraction import attraction
from pareto_ltl.kernels.attraction import add_attraction
from pareto_ltl.planning.pack import pack_landmarks
from pareto_ltl.settings import RobotConfig
from plane_logic.margin import Slope


@given(
    seed=st.integers(0, 10**6),
    steps=st.integers(1, 9),
    flights=st.integers(1, 30),
    width=st.floats(0.01, 10.0),
)
def test_value_and_slope_are_those_of_the_definition(seed, steps, flights, width):
    rng = np.random.default_rng(seed)
    marks = []
    for _ in range(3):
        points = rng.normal(size=(8, 2)) * rng.uniform(0.3, 3.0) + rng.uniform(-6.0, 6.0, 2)
        marks.append(points[ConvexHull(points).vertices])
    x = np.cumsum(rng.normal(size=(steps + 1, 2)) * 2.0, axis=0)
    off = np.cumsum(rng.normal(size=(steps + 1, 2, flights)), axis=0)
    slope = Slope(np.ones((steps + 1, 2)), np.ones((steps + 1, 3)))
    value = add_attraction(pack_landmarks(RobotConfig(dt=1.0), marks), x, off, width, 0.7, slope)
    expected, gradient, hessian = attraction(marks, x, off, width, 0.7)
    assert np.isclose(value, expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(slope.gradient - 1.0, gradient, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(slope.hessian - 1.0, hessian, rtol=1e-9, atol=1e-11)
