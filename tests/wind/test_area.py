"""The box around a scene: what of a large file can matter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight_quantities import frames
from flight_quantities.sphere import on_sphere
from pareto_ltl.extend import Frame
from pareto_ltl.settings import SceneConfig
from pareto_ltl.wind import area
from pareto_ltl.wind.area import GeoBox, neighbourhood

SQUARE = {"unit": 1e5, "bounds": [[0, 0], [10, 10]], "start": [1, 1]}
places = st.tuples(st.floats(-180, 180), st.floats(-89, 89))


@given(st.lists(places, min_size=1, max_size=8))
def test_the_box_of_points_holds_them_whichever_way_round_the_earth_they_lie(found):
    lonlat = np.array(found)
    box = GeoBox.around(lonlat).widened(1.0)
    assert box.contains(lonlat).all()
    assert box.contains(lonlat + np.array([360.0, 0.0])).all()


def test_a_box_across_the_180th_meridian_is_narrow():
    box = GeoBox.around(np.array([[179.0, 0.0], [-178.0, 2.0]]))
    assert box.width == pytest.approx(3.0)
    assert box.text == "latitude 0..2, longitude 179..-178"
    assert list(box.contains(np.array([[180.0, 1.0], [0.0, 1.0]]))) == [True, False]


@given(places, places)
def test_a_widened_box_holds_all_that_is_within_the_margin(centre, other):
    margin = 1e6
    box = GeoBox(centre[0], centre[1], 0.0, centre[1]).widened(margin * 1.01)
    near = np.linalg.norm(np.diff(on_sphere(np.array([centre, other])), axis=0)) * 6.371e6 <= margin
    assert box.contains(np.array([other]))[0] or not near


@given(st.floats(-89, 89), st.floats(-180, 180))
def test_the_neighbourhood_of_a_scene_holds_500_km_around_it(lat, lon):
    box = neighbourhood(SceneConfig(centre=[lat, lon], **SQUARE))
    crs = frames.local_plane(lat, lon)
    around = np.linspace(0, 2 * np.pi, 40)
    ring = 5e5 * np.sqrt(2) * np.stack([np.cos(around), np.sin(around)], axis=1)
    ring = ring * (1 + 5e5 / 7.1e5)
    lonlat = np.stack(Frame(crs).to_geographic(ring), axis=1)
    assert box is not None
    assert box.contains(lonlat).all()


def test_a_scene_that_lies_nowhere_has_no_neighbourhood():
    assert neighbourhood(SceneConfig(**SQUARE)) is None
    assert neighbourhood(SceneConfig()) is None


def test_of_a_fine_grid_an_even_selection_is_picked_densest_near_the_scene(monkeypatch):
    lon, lat = np.meshgrid(np.arange(-110, -80, 0.05), np.arange(25, 50, 0.05))
    lonlat = np.stack([lon, lat], axis=-1).reshape(-1, 2)
    box = neighbourhood(SceneConfig(centre=[37, -92], unit=1000, bounds=[[0, 0], [2, 2]], start=[1, 1]))
    assert box is not None
    monkeypatch.setattr(area, "MOST_NODES", 10_000)
    picked = lonlat[box.pick(lonlat)]
    assert box.contains(picked).all()
    assert 5_000 < len(picked) < 11_000
    near = np.abs(picked - [-92.0, 37.0]).max(axis=1) < 1.0
    assert near.sum() == (np.abs(lonlat - [-92.0, 37.0]).max(axis=1) < 1.0).sum()
    far = picked[np.abs(picked - [-92.0, 37.0]).max(axis=1) > 3.0]
    taken = {tuple(cell) for cell in np.floor(far).astype(int)}
    inside = lonlat[box.contains(lonlat)]
    beyond = inside[np.abs(inside - [-92.0, 37.0]).max(axis=1) > 3.0]
    cells, counts = np.unique(np.floor(beyond + 1e-6).astype(int), axis=0, return_counts=True)
    assert {tuple(cell) for cell in cells[counts == 400]} <= taken  # no degree square is empty
    few = lonlat[::400]
    assert len(box.pick(few)) == box.contains(few).sum()


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 30))
def test_of_too_many_places_the_first_in_each_square_stays(seed, count, limit):
    rng = np.random.default_rng(seed)
    lonlat = rng.integers(0, 7, (count + 5, 2)) * [0.5, 1.0] + [10.0, -3.0]
    rows = rng.permutation(count + 5)[:count]
    found = area._one_a_cell(lonlat, rows, limit)  # noqa: SLF001
    if count <= limit:
        assert found is rows
        return
    east = (lonlat[rows, 0] - lonlat[rows, 0].min()) * np.cos(np.radians(lonlat[rows, 1].mean()))
    north = lonlat[rows, 1] - lonlat[rows, 1].min()
    side = np.sqrt(max(np.ptp(east) * np.ptp(north), 1e-12) / limit)
    first = {}
    for row, x, y in zip(rows.tolist(), east, north, strict=True):
        first.setdefault((int(x // side), int(y // side)), row)
    assert sorted(found.tolist()) == sorted(first.values())
