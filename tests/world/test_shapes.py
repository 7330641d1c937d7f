"""Polygons with holes and of several parts are tiled by simple polygons, and put together again."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto_ltl.world.polygons import outlines_of
from pareto_ltl_apps.exports.degrees import united_rings
from strategies import star_polygons

some = settings(max_examples=60, deadline=None)
stars = star_polygons(corners=20).map(shapely.Polygon).filter(lambda polygon: polygon.is_valid)
discs = st.builds(
    lambda x, y, r: shapely.Point(x, y).buffer(r, quad_segs=3),
    st.floats(0, 1000), st.floats(0, 1000), st.floats(5, 80),
)  # fmt: skip


@st.composite
def holed_shapes(draw):
    """Stars with discs cut out: holes, bays and several parts."""
    shape = shapely.union_all(draw(st.lists(stars, min_size=1, max_size=3)))
    shape = shapely.difference(shape, shapely.union_all(draw(st.lists(discs, max_size=6))))
    return shapely.set_precision(shape, 1e-3)


@some
@given(holed_shapes())
def test_outlines_tile_the_shape_without_new_corners(shape):
    outlines = outlines_of(shape)
    polygons = [shapely.Polygon(outline) for outline in outlines]
    assert all(polygon.is_valid and polygon.exterior.is_ccw for polygon in polygons)
    assert sum(polygon.area for polygon in polygons) == pytest.approx(shape.area, rel=1e-9, abs=1e-9)
    assert shapely.symmetric_difference(shapely.union_all(polygons), shape).area <= 1e-9 * max(1, shape.area)
    corners = {tuple(corner) for outline in outlines for corner in outline.tolist()}
    assert corners <= {tuple(corner) for corner in shapely.get_coordinates(shape).tolist()}


@some
@given(holed_shapes())
def test_outlines_are_put_together_again(shape):
    rings = united_rings(outlines_of(shape))
    again = shapely.union_all([shapely.Polygon(outer, holes) for outer, *holes in rings])
    assert shapely.symmetric_difference(again, shape).area <= 1e-6 * max(1, shape.area)


def test_a_ring_is_cut_into_two_parts_and_an_outline_is_kept_as_it_is():
    outer = shapely.Point(0, 0).buffer(10)
    assert len(outlines_of(outer - shapely.Point(1, 1).buffer(3))) == 2
    corners = np.array([[2.0, 0.0], [1.0, 3.0], [0.0, 1.0]])
    assert outlines_of(shapely.Polygon(corners))[0].tobytes() == corners.tobytes()
    assert outlines_of(shapely.union_all([])) == ()
    assert united_rings(()) == []
