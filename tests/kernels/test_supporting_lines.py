"""Supporting lines of segments: against a sweep of directions, and their risks against sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.stats import binom, norm

from pareto_ltl.planning.pack_logic import pack_corners
from plane_kernels.supporting_lines import SURE, SegmentLines, segment_lines

RARE = 1e-7
ANGLES = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


def hull(rng, middle, size):
    points = rng.normal(size=(7, 2)) * size + middle
    return points[ConvexHull(points).vertices]


def scene(seed, polygons=6):
    """Polygons around a segment, and the covariances of its ends."""
    rng = np.random.default_rng(seed)
    shapes = [hull(rng, rng.uniform(-15, 15, 2), rng.uniform(0.5, 3.0)) for _ in range(polygons)]
    x = rng.uniform(-15, 15, (1, 2)) + np.array([[0.0, 0.0], rng.normal(size=2) * 3.0])
    root = rng.normal(size=(2, 2, 2)) * rng.uniform(0.2, 2.0)
    return shapes, x, np.einsum("tij,tkj->tik", root, root)


def lines(shapes, x, cov, slots=3):
    """Lines (slots, 4), owners (slots,) and risk of one segment."""
    found = SegmentLines(np.empty((1, slots, 4)), np.empty((1, slots), np.int64), np.empty(1))
    asked = np.ones((1, len(shapes)), bool)
    polygons = pack_corners(range(len(shapes)), shapes)
    segment_lines(polygons, asked, x, cov[:, [0, 0, 1], [0, 1, 1]], 1e-12, 0.0, found)
    return found.line[0], found.owner[0], found.risk[0]


def swept(shape, x, cov):
    """The z of the best of 3,600 directions."""
    reach = (shape @ DIRECTIONS.T).max(axis=0)
    sd = np.sqrt(np.einsum("ki,tij,kj->tk", DIRECTIONS, cov, DIRECTIONS))
    return ((x @ DIRECTIONS.T - reach) / sd).min(axis=0).max()


@given(st.integers(0, 2**32 - 1))
def test_no_direction_is_better_than_the_line(seed):
    (shape,), x, cov = scene(seed, polygons=1)
    line, owner, risk = lines([shape], x, cov)
    best = swept(shape, x, cov)
    if owner[0] < 0:
        assert best > 5.9
        assert risk == 0.0
        return
    east, north, offset, z = line[0]
    assert offset == pytest.approx((shape @ [east, north]).max(), abs=1e-9)
    assert np.hypot(east, north) == pytest.approx(1.0)
    sd = np.sqrt(np.einsum("i,tij,j->t", [east, north], cov, [east, north]))
    assert z == pytest.approx(min(((x @ [east, north] - offset) / sd).min(), SURE), abs=1e-6)
    if best > 0.05:  # below, a segment that touches the polygon has an edge instead
        assert z >= min(best, SURE) - 1e-3
    assert risk == pytest.approx(norm.cdf(-z), abs=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_lines_are_sorted_and_each_polygon_is_behind_one_of_them(seed):
    shapes, x, cov = scene(seed)
    line, owner, risk = lines(shapes, x, cov, slots=len(shapes))
    used = line[owner >= 0]
    assert (np.diff(used[:, 3]) >= 0.0).all()
    assert risk == pytest.approx(norm.cdf(-used[:, 3]).sum(), abs=1e-9)
    assert risk <= sum(norm.cdf(-swept(shape, x, cov)) for shape in shapes) * 1.1 + 0.5 * len(shapes) * (
        risk > 0.4
    )
    for shape in shapes:
        behind = [((shape @ row[:2]).max() <= row[2] + 1e-5) for row in used]
        assert any(behind) or swept(shape, x, cov) > 5.9


def test_a_polygon_behind_another_adds_no_risk():
    near, south, north = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]]), [0.0, -1.5], [0.0, 5.0]
    x, cov = np.array([[1.0, 3.0], [3.0, 3.0]]), np.tile(np.eye(2), (2, 1, 1))
    alone = lines([near], x, cov)[2]
    assert lines([near, near + np.array(south)], x, cov)[2] == alone
    assert lines([near, near + np.array(north)], x, cov)[2] == pytest.approx(2.0 * alone)


@pytest.mark.parametrize("seed", range(6))
def test_collisions_are_at_most_twice_the_risk(seed):
    """Both ends count: a segment that meets a polygon has an end on its side of the line."""
    import shapely

    shapes, x, cov = scene(seed + 40)
    risk = lines(shapes, x, cov)[2]
    rng, flights = np.random.default_rng(seed), 4000
    ends = np.stack([rng.multivariate_normal(x[e], cov[e], flights) for e in (0, 1)], axis=1)
    outline = shapely.union_all([shapely.Polygon(shape) for shape in shapes])
    met = int(shapely.intersects(shapely.linestrings(ends), outline).sum())
    assert binom.sf(met - 1, flights, min(2.0 * risk, 1.0)) > RARE
