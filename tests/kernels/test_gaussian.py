"""Tails and polygon bounds: kernels against scipy and against the reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from oracle import path_risk as risk
from pareto_ltl.planning.pack import pack_faces
from pareto_ltl.world.cells import half_planes
from pareto_ltl_verify.gaussians import in_polygon, left_out
from pareto_ltl_verify.geometry import convex
from plane_kernels import gaussian
from plane_kernels.types import Cov, Gaussian, Point
from problems import box, make_problem, make_scene, random_covariances
from strategies import convex_polygons

some = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


def round_at(x, y, variance):
    """A Gaussian with the same variance in all directions."""
    return Gaussian(Point(x, y), Cov(variance, 0.0, variance))


@some
@given(st.floats(-37, 37), st.floats(1e-3, 1e6))
def test_the_tail_is_that_of_the_normal_distribution(sigmas, sd):
    # erfc near 1e-300 loses a few of its digits to the rounding of its argument
    np.testing.assert_allclose(gaussian.tail(sigmas * sd, sd * sd), norm.sf(sigmas), rtol=1e-9)


def test_a_certain_position_has_a_step_for_a_tail():
    assert gaussian.tail(1.0, 0.0) == 0.0
    assert gaussian.tail(0.0, 0.0) == 0.0  # regions are closed
    assert gaussian.tail(-1e-9, 0.0) == 1.0


@some
@given(seeds)
def test_variance_along_a_direction_is_a_quadratic_form(seed):
    rng = np.random.default_rng(seed)
    (cov,), n = random_covariances(rng, 1, 10.0), rng.standard_normal(2)
    found = gaussian.variance_along(*n, Cov(cov[0, 0], cov[0, 1], cov[1, 1]))
    np.testing.assert_allclose(found, n @ cov @ n, rtol=1e-9, atol=1e-9)


@some
@given(convex_polygons(), seeds)
def test_both_bounds_are_those_of_the_reference_and_hold(polygon, seed):
    rng = np.random.default_rng(seed)
    ring, (normals, offsets) = pack_faces([polygon]), half_planes(polygon)
    for cov in random_covariances(rng, 5, 200.0):
        mean = polygon.mean(axis=0) + rng.uniform(-300, 300, 2)
        here = Gaussian(Point(*mean), Cov(cov[0, 0], cov[0, 1], cov[1, 1]))
        out, in_ = gaussian.outside(ring, 0, here), gaussian.inside(ring, 0, here)
        np.testing.assert_allclose(out, left_out(convex(polygon), mean, cov), rtol=1e-9)
        np.testing.assert_allclose(in_, risk.inside_bound(normals, offsets, mean, cov), rtol=1e-9)
        exact = in_polygon(convex(polygon), mean, cov)
        assert out >= 1 - exact - 1e-9
        assert in_ >= exact - 1e-9


def test_only_the_asked_polygon_of_several_counts():
    ring = pack_faces([box(0, 0, 1, 1), box(5, 5, 9, 6), box(-3, -3, -2, -1)])
    for part, (x, y) in enumerate([(500.0, 500.0), (7000.0, 5500.0), (-2500.0, -2000.0)]):
        assert gaussian.outside(ring, part, round_at(x, y, 1.0)) < 1e-12
        for other in {0, 1, 2} - {part}:
            assert gaussian.inside(ring, other, round_at(x, y, 1.0)) < 1e-12


def test_a_region_of_several_parts_is_missed_by_its_best_part():
    ell = np.array([[2, 2], [8, 2], [8, 4], [4, 4], [4, 8], [2, 8]]) * 1000.0
    problem = make_problem("F a & F b", make_scene({"a": ell, "b": box(12, 12, 13, 13)}))
    bound = problem.theorem2
    parts = np.flatnonzero(bound.atom == 0)
    assert len(parts) == 2

    def missed(atom, here):
        return gaussian.region_missed(bound.faces, bound.atom, atom, here)

    for x, y in ((7000.0, 3000.0), (3000.0, 7000.0), (3000.0, 3000.0)):
        here = round_at(x, y, 9e4)
        bounds = [gaussian.outside(bound.faces, k, here) for k in parts]
        assert missed(0, here) == pytest.approx(min(1.0, *bounds))
    assert missed(0, round_at(12_500.0, 12_500.0, 9e4)) == 1.0  # several faces missed: not 2
    assert missed(1, round_at(12_500.0, 12_500.0, 1.0)) < 1e-12
