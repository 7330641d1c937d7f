"""Outlines of many corners get simpler on the careful side, and plans stay possible."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from large_maps import rough_disc
from pareto_ltl.settings import SceneConfig
from pareto_ltl.world.cells import decompose
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl.world.scene_sketch import MissionUse

BOUNDS = [[0.0, 0.0], [20e3, 20e3]]
some = settings(max_examples=15, deadline=None)


def scene_of(regions, obstacles=(), use=("a", ""), start=(500.0, 500.0), **keys):
    cfg = SceneConfig(
        bounds=BOUNDS, start=list(start), regions={name: p.tolist() for name, p in regions.items()},
        obstacles=[p.tolist() for p in obstacles], **keys,
    )  # fmt: skip
    told = None if use is None else MissionUse(*map(frozenset, use))
    return scene_from_settings(cfg, use=lambda: told)


def whole(outlines):
    return shapely.union_all([shapely.Polygon(outline) for outline in outlines])


def corner_total(outlines):
    return sum(map(len, outlines))


@some
@given(st.integers(0, 1000), st.sampled_from([0.0, 0.02, 0.05]))
def test_obstacles_grow_and_visited_regions_shrink_within_the_tolerance(seed, roughness):
    coast, goal = rough_disc(800, 13, 13, 3, roughness, seed), rough_disc(500, 4, 15, 2, roughness, seed + 1)
    scene = scene_of({"a": goal}, [coast])
    land, sea = shapely.Polygon(coast), shapely.Polygon(goal)
    grown, shrunk = whole(scene.obstacles), whole(scene.regions["a"])
    assert grown.covers(land)
    assert sea.covers(shrunk)
    assert 0 < scene.simplified <= 40.0  # 1/500 of the side
    assert shapely.buffer(land, 1.001 * scene.simplified).covers(grown)
    assert corner_total(scene.obstacles) < 300
    assert decompose(scene).cells


@some
@given(st.integers(0, 1000))
def test_regions_that_are_only_kept_out_of_grow_and_those_of_both_kinds_stay(seed):
    shape = rough_disc(300, 10, 10, 3, 0.02, seed)
    grown = scene_of({"a": shape}, use=("", "a"))
    assert whole(grown.regions["a"]).covers(shapely.Polygon(shape))
    for use in (("a", "a"), None):
        kept = scene_of({"a": shape}, use=use)
        assert kept.regions["a"][0].tobytes() == shape.tobytes()
        assert kept.simplified == 0.0


def test_few_corners_and_simplify_0_change_nothing():
    coast, goal = rough_disc(40, 13, 13), rough_disc(40, 4, 15, 2)
    scene = scene_of({"a": goal}, [coast])
    assert scene.obstacles[0].tobytes() == coast.tobytes()
    assert scene.regions["a"][0].tobytes() == goal.tobytes()
    coast = rough_disc(400, 13, 13)
    assert scene_of({"a": goal}, [coast], simplify=0).obstacles[0].tobytes() == coast.tobytes()


def test_the_log_says_what_was_simplified(caplog):
    with caplog.at_level(logging.INFO):
        scene_of({"a": rough_disc(50, 4, 15, 2)}, [rough_disc(2431, 13, 13)], use=("a", "a"))
    assert "obstacle 1: 2,431 corners simplified to " in caplog.text
    assert ", at most 40.0 m outwards (scene.simplify)" in caplog.text
    assert "region 'a' keeps its 50 corners: the mission both visits and avoids it" in caplog.text


@pytest.mark.parametrize("gap", [400.0, 40.0, 0.5])
def test_a_strait_between_two_coasts_stays_open(gap):
    west, east = rough_disc(600, 5, 10, 4, 0.0), rough_disc(600, 15, 10, 4, 0.0)
    west[:, 0] += 9e3 - gap / 2 - west[:, 0].max() + 1e3
    east[:, 0] += 1e4 + gap / 2 - east[:, 0].min()
    scene = scene_of({"a": np.array([[1e3, 18e3], [2e3, 18e3], [2e3, 19e3]])}, [west, east], simplify=200.0)
    first, second = map(shapely.Polygon, scene.obstacles)
    assert corner_total(scene.obstacles) < 1200 or gap < 1.0
    assert first.distance(second) >= 0.4 * gap


def test_a_strip_along_a_coast_and_the_start_are_not_swallowed():
    coast = rough_disc(1000, 12, 12, 4, 0.02)
    land = shapely.Polygon(coast)
    strip = land.buffer(30.0).difference(land)
    outer = shapely.get_coordinates(shapely.intersection(strip, shapely.box(12e3, 12e3, 2e4, 2e4)))[:-1]
    scene = scene_of({"a": outer}, [coast], simplify=500.0)
    assert whole(scene.regions["a"]).area > 0.6 * shapely.Polygon(outer).area
    beside = shapely.get_coordinates(land.exterior.interpolate(100.0))[0]
    beside += (beside - [12e3, 12e3]) * 1e-3
    close = scene_of({"a": rough_disc(30, 3, 16, 1)}, [coast], start=tuple(beside), simplify=500.0)
    assert not whole(close.obstacles).contains(shapely.Point(beside))


def test_what_gets_larger_is_cut_out_of_what_is_visited():
    coast = rough_disc(1000, 12, 12, 4, 0.0)
    land = shapely.Polygon(coast)
    port = shapely.get_coordinates(shapely.box(14e3, 8e3, 19e3, 16e3).difference(land))[:-1]
    scene = scene_of({"a": port}, [coast], simplify=100.0)
    assert whole(scene.regions["a"]).intersection(whole(scene.obstacles)).area < 1.0
    assert whole(scene.regions["a"]).area > 0.9 * shapely.Polygon(port).area


def test_an_obstacle_at_the_border_stays_inside_of_it():
    land = shapely.Polygon(rough_disc(900, 19, 12, 4, 0.02)).intersection(shapely.box(0, 0, 20e3, 20e3))
    coast = shapely.get_coordinates(land)[:-1]
    scene = scene_of({"a": rough_disc(30, 3, 16, 1)}, [coast])
    for outline in scene.obstacles:
        assert outline.min() >= 0.0
        assert outline.max() <= 20e3
    assert whole(scene.obstacles).area >= shapely.Polygon(coast).area
