"""The exact probability of a polygon: the kernel against scipy and against the reference."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import owens_t

from pareto_ltl_verify.gaussians import in_polygon
from pareto_ltl_verify.geometry import convex
from plane_kernels import polygon as kernel
from plane_kernels.types import Corners
from problems import three_columns

few = settings(deadline=None, max_examples=15)


@few
@given(st.integers(0, 2**32 - 1))
def test_owens_t_is_scipys(seed):
    rng = np.random.default_rng(seed)
    h = np.concatenate([rng.uniform(0, 10, 200), [0.0, 0.0, 1e-9, 9.0]])
    a = np.concatenate([rng.standard_normal(200) * 10 ** rng.uniform(-6, 6, 200), [0.0, 1.0, 1e6, -2.0]])
    np.testing.assert_allclose(kernel.owens_ts(h, a), owens_t(h, a), atol=2e-15)


@few
@given(st.integers(0, 2**32 - 1))
def test_polygon_probabilities_of_the_kernel_are_the_references(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 8)))
    polygon = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.1, 3.0)
    if np.min(np.diff(angles, append=angles[0] + 2 * np.pi)) < 1e-2:
        return
    ptr = np.array([0, len(polygon)])
    corners = Corners(np.zeros(1, np.int64), np.zeros((1, 2)), np.ones(1), ptr, polygon)
    x = rng.standard_normal((20, 2)) * 2
    half = rng.standard_normal((20, 2, 2))
    cov = half @ half.transpose(0, 2, 1) + 0.01 * np.eye(2)
    expected = [in_polygon(convex(polygon), m, c) for m, c in zip(x, cov, strict=True)]
    found = kernel.polygon_probabilities(corners, x, three_columns(cov))
    np.testing.assert_allclose(found, expected, atol=1e-13)


def test_a_mean_at_a_corner_sees_the_angle_of_the_corner():
    """There the angles of two edges are not defined."""
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    corners = Corners(np.zeros(1, np.int64), np.zeros((1, 2)), np.ones(1), np.array([0, 4]), square)
    cov = np.array([[0.04, 0.01, 0.09]])
    for corner in square:
        found = kernel.polygon_probabilities(corners, corner[None], cov)[0]
        expected = in_polygon(convex(square), corner, np.array([[0.04, 0.01], [0.01, 0.09]]))
        np.testing.assert_allclose(found, expected, atol=1e-6)
