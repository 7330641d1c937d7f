"""Margins of flights: the kernel against its definition, and their sign against the simulator's verdict."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence

from oracle.margin import flight_margin, segment_distance
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.margin_model import claim_lists, margin_model, margin_scratch
from pareto_ltl.planning.pack import pack_corners, pack_faces
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.world.scene import Scene
from plane_kernels.boxes import SegmentBox, least_gaps
from plane_kernels.clearance import beyond_reach
from plane_kernels.types import Point
from plane_logic import margin as kernel
from plane_logic.margin_events import SATURATED
from problems import KM, box, make_problem, make_scene, steady_wind
from strategies import NAMES, SIDE, convex_polygons, formulas, scenes

WIDE = 1e9  # [m] no margin on a map lies below the floor of so wide a sigmoid
HOPELESS = 1e6  # [m] beyond every map
ON_AN_EDGE = 1e-3  # [m] verdicts of flights that pass an edge so closely are left to rounding

FORMULAS = (
    "F a",
    "F(a & F b)",
    "X X F a",
    "F(a & X F b)",
    "F a | F(b & F c)",
    "a M (b | !c)",
    "!b U a",
    "F a & (!b U c)",
    "(!b U a) | F(b & F c)",
    "(!b & !c) U (a & X(!b U c))",
)
REGIONS = {"a": box(14, 8, 18, 12), "b": box(8, 8, 9, 19), "c": box(1, 12, 19, 14)}
MAP = make_scene(REGIONS, [box(11, 1, 13, 5), box(4, 4, 6, 7)], start=(2, 10))


@cache
def task(formula: str, border: str = "open") -> Problem:
    wind = steady_wind(MAP, gust=(9.0, 9.0))
    return make_problem(formula, replace(MAP, border=border), wind, fidelity="full")


def margins_and_slope(
    problem: Problem, x: FloatArray, width: float, mean: FloatArray | None = None, claims: Any = None
) -> tuple[FloatArray, kernel.Slope, float]:
    """Margins (n,) of the flights ``x`` (n, T+1, 2), derivatives and value of their smoothed failure."""
    model, shape = margin_model(problem), x.shape[1:]
    scratch = margin_scratch(model, len(x), shape[0])
    if claims is not None:
        scratch = scratch._replace(claims=claims)
    slope = kernel.Slope(np.zeros(shape), np.zeros((shape[0], 3)))
    mean = np.zeros(shape) if mean is None else mean
    value = kernel.smoothed_failure(
        model, mean, np.ascontiguousarray(np.moveaxis(x - mean, 0, 2)), width, slope, scratch
    )
    return scratch.margins, slope, value


def margins_one_by_one(problem: Problem, x: FloatArray, width: float) -> FloatArray:
    """Margins (n,) by the algorithm for large automata."""
    claims = claim_lists(margin_model(problem), x.shape[1])
    return margins_and_slope(problem, x, width, claims=claims)[0]


def margins(problem: Problem, x: FloatArray, width: float = WIDE) -> FloatArray:
    return margins_and_slope(problem, x, width)[0]


def flown(problem: Problem, way: FloatArray, runs: int, seed: int) -> tuple[FloatArray, BoolArray]:
    """Flights (n, T+1, 2) along ``way`` in strong gusts, and which of them the simulator lets pass."""
    u = np.diff(way, axis=0) / problem.motion.dt
    flights = simulate_flights(problem, u, runs, "independent", SeedSequence(seed), way)
    return flights.x, ~flights.failed


def walk(stops: FloatArray, per_leg: int) -> FloatArray:
    """A way (T+1, 2) from stop to stop."""
    share = np.arange(per_leg)[:, None] / per_leg
    return np.vstack([*(p + share * (q - p) for p, q in pairwise(stops)), stops[-1:]])


def random_stops(problem: Problem, rng: np.random.Generator, legs: int) -> FloatArray:
    """The start, then middles of regions and, now and then, any place of the map."""
    (west, south), (east, north) = problem.scene.bounds
    middles = [polygon.mean(axis=0) for polygon in problem.scene.region_outlines]
    stops = [problem.scene.start]
    for _ in range(legs):
        anywhere = rng.uniform([west, south], [east, north])
        stops.append(middles[rng.integers(len(middles))] if rng.random() < 0.7 else anywhere)
    return np.array(stops)


class Flights(NamedTuple):
    """Flights ``x`` (n, T+1, 2) along a ``way`` (T+1, 2), and which ``passed``."""

    way: FloatArray
    x: FloatArray
    passed: BoolArray


@cache
def mixed_flights(formula: str, border: str = "open") -> tuple[Flights, ...]:
    """Four ways, each with flights that pass and flights that fail."""
    problem, rng, found = task(formula, border), np.random.default_rng(11), []
    places = KM * np.array([[16, 10], [8.5, 13], [8.5, 5.5], [10, 13]])  # a, b, south of b, c
    for seed in range(400):
        way = walk(np.vstack([problem.scene.start, places[rng.integers(4, size=3)]]), 3)
        flights = Flights(way, *flown(problem, way, 6, seed))
        if 0 < flights.passed.sum() < 6:
            found.append(flights)
        if len(found) == 4:
            break
    assert len(found) == 4
    return tuple(found)


seeds = st.integers(0, 2**32 - 1)
borders = st.sampled_from(["open", "wall"])


@st.composite
def problems(draw) -> Problem:
    """Any mission on any map of 1 km, with steps of 100 m and gusts of 40 m."""
    scene: Scene = draw(scenes(obstacles=2, regions=3))
    formula = draw(formulas(NAMES[: len(scene.regions)]))
    scene = replace(scene, border=draw(borders))
    wind = steady_wind(scene, gust=(16.0, 16.0))
    return make_problem(formula, scene, wind, RobotConfig(dt=10.0, u_max=10.0), fidelity="full")


# --- the margin is what it is defined to be, and says what the simulator says --------------------


@pytest.mark.parametrize("width", [WIDE, 50.0])
@pytest.mark.parametrize("formula", FORMULAS)
def test_flights_in_blocks_have_the_margins_of_flights_one_by_one(formula: str, width: float) -> None:
    problem = task(formula)
    for flights in mixed_flights(formula):
        x = np.concatenate([flights.x] * 50)  # more than a block
        one_by_one = margins_one_by_one(problem, x, width)
        blocks, floor = margins(problem, x, width), -SATURATED * width  # lower ones are of no interest
        np.testing.assert_array_equal(np.maximum(blocks, floor), np.maximum(one_by_one, floor))


def compare_roads(problem: Problem, x: FloatArray, passed: BoolArray) -> None:
    """Kernel, definition and simulator."""
    found = margins(problem, x)
    expected = [flight_margin(problem, flight) for flight in x]
    assert np.isfinite(found).all()
    np.testing.assert_allclose(
        np.clip(found, -HOPELESS, HOPELESS), np.clip(expected, -HOPELESS, HOPELESS), rtol=0, atol=1e-6
    )
    clear = np.abs(found) > ON_AN_EDGE
    np.testing.assert_array_equal((found > 0.0)[clear], passed[clear])


@settings(deadline=None, max_examples=60)
@given(problems(), seeds)
def test_any_mission_on_any_map_has_the_margin_of_its_definition_and_the_sign_of_its_verdict(
    problem: Problem, seed: int
) -> None:
    way = walk(random_stops(problem, np.random.default_rng(seed), 3), 3)
    compare_roads(problem, *flown(problem, way, 4, seed))


@pytest.mark.parametrize("border", ["open", "wall"])
@pytest.mark.parametrize("formula", FORMULAS)
def test_flights_that_pass_and_flights_that_fail_have_margins_of_these_signs(
    formula: str, border: str
) -> None:
    for _, x, passed in mixed_flights(formula, border):
        compare_roads(task(formula, border), x, passed)


def test_the_margin_to_a_forbidden_strip_is_that_of_segments() -> None:
    problem = task("!b U a")
    over = np.array([[2, 10], [6, 10], [11, 10], [16, 10]]) * KM
    assert margins(problem, over[None])[0] == pytest.approx(-2000.0)  # its end is 2 km to the south
    north = np.array([[2, 10], [6, 19.4], [10, 19.4], [16, 10]]) * KM
    assert margins(problem, north[None])[0] == pytest.approx(400.0)
    first, last = problem.locate(north[1:3])
    assert first == last  # even where the segment does not leave its convex cell


@pytest.mark.parametrize("width", [WIDE, 1000.0, 10.0])
def test_a_formula_that_counts_steps_counts_those_where_no_letter_is_near(width: float) -> None:
    problem = task("X X F a")
    x = np.array([[2, 10], [6, 10], [11, 10], [15, 10], [19, 10]]) * KM
    assert margins(problem, x[None], width)[0] == pytest.approx(1000.0)
    assert margins(problem, x[None, 2:], width)[0] < 0.0


def test_any_visit_counts_and_the_best_one_binds() -> None:
    problem = task("F(a & F b)")
    x = np.array([[16.5, 10], [8.2, 9], [14.1, 10], [8.4, 10], [8.3, 15]]) * KM
    assert margins(problem, x[None])[0] == pytest.approx(400.0)  # a at first, b at last but one
    assert margins(problem, x[None, ::-1])[0] == pytest.approx(100.0)  # then b is before the better visit


@settings(deadline=None, max_examples=25)
@given(scenes(obstacles=5, regions=1), borders, seeds)
def test_a_mission_that_is_done_at_once_has_the_margin_of_its_clearance(
    scene: Scene, border: str, seed: int
) -> None:
    wind = steady_wind(scene, gust=(16.0, 16.0))
    robot = RobotConfig(dt=10.0, u_max=10.0)
    problem = make_problem("true", replace(scene, border=border), wind, robot, fidelity="full")
    way = walk(random_stops(problem, np.random.default_rng(seed), 2), 3)
    compare_roads(problem, *flown(problem, way, 4, seed))


@pytest.mark.parametrize(
    ("last", "margin"), [((9.2, 11.5), 200.0), ((9.7, 11.8), 200.0), ((9.6, 11.4), 600.0)]
)
def test_of_letters_to_be_spared_the_nearest_binds(last: tuple[float, float], margin: float) -> None:
    """After a, neither b (to the west) nor c (to the north)."""
    problem = task("F(a & X(!b & !c))")
    x = np.array([[2, 10], [16, 10], last]) * KM
    assert margins(problem, x[None])[0] == pytest.approx(margin)


def test_a_hazard_that_must_be_met_binds_by_the_depth_to_which_it_is() -> None:
    """b on the way ends !b U a and begins F c: a flight that passes south of it has missed it."""
    problem = task("(!b U a) | F(b & F c)")
    x = np.array([[2, 10], [6, 8.3], [11, 8.3], [11, 13]]) * KM
    (margin,), slope, f = margins_and_slope(problem, x[None], 200.0)
    assert margin == pytest.approx(300.0)
    assert slope.gradient[[0, 3]].tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert slope.gradient[1:3, 1].sum() == pytest.approx(-f * (1.0 - f) / 200.0)  # to the north
    assert margins(problem, x[None] - [0.0, 400.0])[0] < 0.0


# --- the floor ------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=20)
@given(st.sampled_from(FORMULAS), borders, seeds, st.floats(10.0, 3000.0))
def test_margins_beyond_twelve_widths_are_certain(formula: str, border: str, seed: int, width: float) -> None:
    """Below -12 widths a margin counts as certain failure, whose value is not looked for; above, as success.

    σ(12) differs from 1 by 6e-6. Within the 12 widths margins are exact.
    """
    problem = task(formula, border)
    x = np.vstack([flights.x for flights in mixed_flights(formula, border)])
    limit = SATURATED * width
    exact, found = margins(problem, x), margins(problem, x, width)
    np.testing.assert_array_equal(np.clip(found, -limit, limit), np.clip(exact, -limit, limit))
    smoothed = margins_and_slope(problem, x, width)[2]
    sigmoid = 1.0 / (1.0 + np.exp(np.clip(exact / width, -500, 500)))
    assert smoothed == pytest.approx(sigmoid.mean(), abs=1e-5)


# --- distances ------------------------------------------------------------------------------------

coordinate = st.floats(-200, SIDE + 200).map(lambda x: round(x, 6))  # shapely fails at 1e-190 m
places = st.tuples(coordinate, coordinate)


def clearance(polygon: FloatArray, p: FloatArray, q: FloatArray, enough: float = 1e18) -> kernel.Event:
    faces, corners = pack_faces([polygon]), pack_corners([0], [polygon])
    return kernel.segment_clearance(faces, corners, 0, 0, Point(*p), Point(*q), enough)


@settings(deadline=None, max_examples=100)
@given(convex_polygons(), places, places, st.booleans())
def test_three_roads_agree_on_the_distance_of_a_segment_from_a_polygon(
    polygon: FloatArray, p: tuple[float, float], q: tuple[float, float], still: bool
) -> None:
    start, end = np.array(p), np.array(p if still else q)
    event = clearance(polygon, start, end)
    assert event.margin == pytest.approx(segment_distance(polygon, start, end), abs=1e-7)
    line = shapely.Point(p) if still else shapely.LineString([p, q])
    apart = shapely.distance(shapely.Polygon(polygon), line)
    if apart > 0.0:
        assert event.margin == pytest.approx(apart, abs=1e-7)
        assert clearance(polygon, start, end, 0.5 * apart).margin >= 0.5 * apart
        return
    assert event.margin <= 1e-9
    angle = np.linspace(0, 2 * np.pi, 361)
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    ends = np.stack([start, end])
    depth = ((polygon @ out.T).max(axis=0) - (ends @ out.T).min(axis=0)).min()
    assert -event.margin <= depth + 1e-9  # no direction leads out sooner
    moved = ends - (event.margin - 1e-6) * np.array([event.nx, event.ny])
    assert clearance(polygon, *moved).margin > 0.0


@settings(deadline=None, max_examples=100)
@given(convex_polygons(), places, places, st.floats(0.0, 1.2))
def test_what_is_called_out_of_reach_is_farther(
    polygon: FloatArray, p: tuple[float, float], q: tuple[float, float], share: float
) -> None:
    corners, apart = pack_corners([0], [polygon]), segment_distance(polygon, np.array(p), np.array(q))
    if beyond_reach(corners, 0, Point(*p), Point(*q), share * apart):
        assert apart > max(share * apart, 0.0)


def test_a_box_is_in_reach_of_a_point_beyond_its_corner() -> None:
    corners, there = pack_corners([0], [box(4, 4, 6, 6)]), Point(7 * KM, 7 * KM)
    apart = np.sqrt(2.0) * KM
    assert beyond_reach(corners, 0, there, there, 0.999 * apart)
    assert not beyond_reach(corners, 0, there, there, 1.001 * apart)


# --- derivatives ----------------------------------------------------------------------------------


@pytest.mark.parametrize("border", ["open", "wall"])
@pytest.mark.parametrize("formula", FORMULAS)
def test_the_gradient_is_that_of_central_differences(formula: str, border: str) -> None:
    """Coordinates where the differences to both sides disagree lie at a kink and are left out; few do."""
    problem, width, h = task(formula, border), 800.0, 1e-2
    kinks = compared = 0
    for way, flights, _ in mixed_flights(formula, border)[:2]:
        x = flights[:4]
        _, slope, value = margins_and_slope(problem, x, width, way)
        for t in range(len(way)):
            for c in (0, 1):
                d = np.zeros_like(way)
                d[t, c] = h
                ahead, back = (margins_and_slope(problem, x + s * d, width)[2] for s in (1, -1))
                right, left = (ahead - value) / h, (value - back) / h
                if abs(right - left) > 1e-8:
                    kinks += 1
                    continue
                compared += abs(right) > 1e-7
                assert slope.gradient[t, c] == pytest.approx(0.5 * (right + left), abs=2e-9)
    assert compared > 5
    assert kinks < 5


@pytest.mark.parametrize("border", ["open", "wall"])
@pytest.mark.parametrize("formula", FORMULAS)
def test_the_hessian_is_the_convex_part_along_the_binding_normal(formula: str, border: str) -> None:
    """f = σ(-m / τ) has f'' = f (1 - f) (1 - 2 f) / τ², of which what is negative is left out.

    A flight moved along the normal of its binding event changes its margin by as much.
    """
    problem, width, compared = task(formula, border), 500.0, 0
    for x in np.vstack([flights.x for flights in mixed_flights(formula, border)])[:, None]:
        (margin,), slope, f = margins_and_slope(problem, x, width)
        xx, xy, yy = slope.hessian.T
        assert (xx >= 0.0).all()
        assert (yy >= 0.0).all()
        assert (xx * yy - xy * xy >= -1e-12 * (xx + yy) ** 2).all()
        if abs(margin) > 8.0 * width:
            continue
        total = slope.gradient.sum(axis=0)
        assert np.linalg.norm(total) == pytest.approx(f * (1.0 - f) / width, rel=1e-9)
        normal, h = -total / np.linalg.norm(total), 0.5
        ahead, back = (margins_and_slope(problem, x + s * h * normal, width)[2] for s in (1, -1))
        found = (xx * normal[0] ** 2 + 2.0 * xy * normal[0] * normal[1] + yy * normal[1] ** 2).sum()
        if ahead + back - 2.0 * f == pytest.approx(h * h * f * (1 - f) * (1 - 2 * f) / width**2, rel=1e-2):
            compared += 1
            assert found == pytest.approx(max(ahead + back - 2.0 * f, 0.0) / h**2, rel=1e-2)
    assert compared > 10


def test_blocks_of_both_ends_lie_above_the_hessian_of_a_point_between() -> None:
    """Beside a corner, between steps: w0 n n' and w1 n n' stand for the square of (w0 n, w1 n)."""
    problem, width = task("F a"), 1000.0
    x = np.array([[2, 10], [7.4, 6.5], [16, 10]])[None] * KM
    (margin,), slope, f = margins_and_slope(problem, x, width)
    assert 0.0 < margin < width
    assert (np.linalg.norm(slope.gradient, axis=1) > 0.0).sum() == 2
    for d in np.random.default_rng(0).standard_normal((50, 3, 2)):
        first = (slope.gradient * d).sum()
        whole = first**2 * (1.0 - 2.0 * f) / (f * (1.0 - f))
        blocks = (slope.hessian[:, 0] * d[:, 0] ** 2 + slope.hessian[:, 2] * d[:, 1] ** 2).sum()
        blocks += 2.0 * (slope.hessian[:, 1] * d[:, 0] * d[:, 1]).sum()
        assert whole <= blocks * (1.0 + 1e-9)


PLAIN = [formula for formula in FORMULAS if not len(task(formula).logic.hazards.cell)]


@settings(deadline=None, max_examples=25)
@given(st.sampled_from(PLAIN), borders, seeds, st.floats(1.0, 3000.0))
def test_a_margin_changes_by_no_more_than_the_positions_move(
    formula: str, border: str, seed: int, far: float
) -> None:
    problem, rng = task(formula, border), np.random.default_rng(seed)
    x = np.vstack([flights.x for flights in mixed_flights(formula, border)])
    d = rng.standard_normal(x.shape)
    d *= far * rng.uniform(0.0, 1.0, (*x.shape[:2], 1)) / np.linalg.norm(d, axis=2, keepdims=True)
    moved = np.linalg.norm(d, axis=2).max(axis=1)
    before, after = (np.clip(margins(problem, y), -HOPELESS, HOPELESS) for y in (x, x + d))
    assert (np.abs(after - before) <= moved + 1e-6).all()


def test_missions_without_hazards_are_among_those_tested() -> None:
    assert {"F a", "F(a & F b)", "X X F a", "F a | F(b & F c)"} <= set(PLAIN)


# --- large automata ----------------------------------------------------------------------------


@pytest.mark.parametrize("formula", ["F a & F b & F c", "F(a & F b) & F c", "(!c U a) & F b & F c"])
def test_claims_that_are_dropped_in_large_automata_change_no_margin(formula, monkeypatch):
    regions = {"a": box(3, 3, 6, 6), "b": box(12, 3, 16, 6), "c": box(8, 12, 12, 16)}
    problem = make_problem(formula, make_scene(regions, start=(1.0, 1.0)))
    rng = np.random.default_rng(4)
    through = np.array([[1, 1], [4.5, 4.5], [14, 4.5], [10, 14], [4.5, 4.5]]) * KM
    line = np.concatenate([np.linspace(p, q, 6)[:-1] for p, q in pairwise(through)])
    x = line + rng.normal(0.0, 1500.0, (60, *line.shape))
    x[:, 0] = line[0]
    whole = margins(problem, x, 200.0)
    monkeypatch.setattr("pareto_ltl.planning.margin_model.LIVE", 1)
    model = margin_model(problem)
    assert np.any(model.guards.needs != 0)
    np.testing.assert_array_equal(margins(problem, x, 200.0), whole)


@settings(deadline=None, max_examples=100)
@given(convex_polygons(), places, places, places)
def test_no_segment_is_closer_than_its_largest_distance_from_a_face(
    polygon: FloatArray, p: tuple[float, float], q: tuple[float, float], other: tuple[float, float]
) -> None:
    corners = np.array([p, q, other])
    middle, half = corners.min(axis=0) / 2 + corners.max(axis=0) / 2, np.ptp(corners, axis=0) / 2
    gap, faces = np.empty(1), pack_faces([polygon])
    least_gaps(faces, 0, SegmentBox(*middle, *half), np.array([*p, *q])[:, None], gap)
    ends = faces.normal @ np.column_stack([p, q]) - faces.offset[:, None]
    assert gap[0] == pytest.approx(ends.min(axis=1).max(), abs=1e-9)
    assert gap[0] <= clearance(polygon, np.array(p), np.array(q)).margin + 1e-9
