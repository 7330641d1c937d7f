"""The bundle of arrays: each says what the records it was made from say."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import shapely
from scipy.stats import norm

from pareto_ltl.planning.pack import pack_faces, pack_wind
from pareto_ltl.planning.wind_lookup import interpolate
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.world import cells as workspace
from problems import KM, box, make_problem, make_scene, rough_wind, steady_wind, two_goals

ROBOT = RobotConfig(dt=100.0, u_max=10.0)


@pytest.fixture(scope="module")
def problem():
    return two_goals()


def test_polygons_keep_their_own_faces():
    polygons = [box(0, 0, 1, 1), np.array([[5.0, 5.0], [9.0, 5.0], [7.0, 8.0]]), box(2, 2, 3, 4)]
    faces = pack_faces(polygons)
    assert faces.ptr.tolist() == [0, 4, 7, 11]
    for j, polygon in enumerate(polygons):
        rows = slice(faces.ptr[j], faces.ptr[j + 1])
        np.testing.assert_allclose(faces.offset[rows], workspace.half_planes(polygon)[1])
    assert pack_faces([]).ptr.tolist() == [0]


def test_every_bucket_lists_the_cells_that_reach_into_it(problem):
    cells, shapes = problem.cells, [shapely.Polygon(c) for c in problem.decomposition.cells]
    n, width = cells.buckets, (cells.east - cells.west) / cells.buckets
    rng = np.random.default_rng(0)
    for column, row in rng.integers(0, n, (200, 2)):
        square = shapely.box(column * width, row * width, (column + 1) * width, (row + 1) * width)
        k = column * n + row
        listed = cells.candidates[cells.ptr[k] : cells.ptr[k + 1]].copy()
        if len(listed) and listed[0] < 0:  # the square lies in the first cell
            listed[0] = ~listed[0]
            assert shapes[listed[0]].covers(square)
        assert list(listed) == sorted(listed)
        assert {j for j, shape in enumerate(shapes) if shape.intersects(square)} <= set(listed.tolist())
        near = {j for j, shape in enumerate(shapes) if shape.distance(square) < width}
        assert set(listed.tolist()) <= near


def test_propositions_hold_in_the_cells_of_their_regions():
    scene = make_scene({"a": box(2, 2, 10, 10), "b": box(6, 6, 14, 14), "unused": box(15, 15, 17, 17)})
    problem = make_problem("F a & F b", scene)
    assert problem.atoms == ("a", "b")
    for cell, label in enumerate(problem.labels):
        assert problem.theorem2.holds[0, cell].tolist() == ["a" in label, "b" in label]
    both = problem.locate(np.array([[8, 8]]) * KM)[0]
    assert problem.theorem2.holds[0, both].tolist() == [True, True]
    assert set(problem.theorem2.atom) == {0, 1}


# --- logic ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "formula",
    ["F(a & F b & F c)", "F(a & F(b & F c)) | F(a & F(d & F c))", "!b U a", "(!b U a) & F c", "F a", "X X a"],
)
def test_a_state_covers_another_iff_it_accepts_all_words_that_one_accepts(formula):
    """The order of growth's exchanges, by trying all words of up to five letters from every state."""
    regions = {name: box(4 * i + 1, 8, 4 * i + 3, 10) for i, name in enumerate("abcd")}
    problem = make_problem(formula, make_scene(regions))
    logic = problem.reading(0)
    columns = list({label: k for k, label in enumerate(problem.labels)}.values())
    states = len(logic.distance)
    accepted = [set() for _ in range(states)]
    for length in range(6):
        for word in product(columns, repeat=length):
            for q in range(states):
                end = q
                for letter in word:
                    end = logic.delta[end, letter]
                if logic.distance[end] == 0:
                    accepted[q].add(word)
    expected = np.array([[accepted[p] <= accepted[q] for p in range(states)] for q in range(states)])
    np.testing.assert_array_equal(logic.covers, expected)
    np.testing.assert_array_equal(problem.automaton.preorder, expected)


def test_the_automaton_reads_cells_as_it_reads_their_labels(problem):
    automaton, logic = problem.automaton, problem.reading(0)
    for q in range(automaton.n_states):
        for cell, label in enumerate(problem.labels):
            assert logic.delta[q, cell] == automaton.step(q, label)
        assert logic.delta[q, -1] == automaton.step(q, frozenset())  # what lies in no cell shows nothing
    assert logic.initial == automaton.initial


# --- wind -------------------------------------------------------------------------------------------------


def test_steps_lie_between_their_slots():
    scene = make_scene({"a": box(10, 10, 12, 12)})
    field = replace(rough_wind(scene, slots=3), times=np.array([-700.0, 450.0, 1000.0]))
    wind = pack_wind(field, 100.0, 200)
    assert len(wind.slot) == 11  # 0 s to 1000 s
    np.testing.assert_allclose(
        field.times[wind.slot] + wind.weight * np.diff(field.times)[wind.slot], 100.0 * np.arange(11)
    )
    assert np.all((wind.weight >= 0) & (wind.weight <= 1))
    assert wind.slot.max() + 1 < len(field.times)


def test_the_horizon_is_where_the_data_or_max_steps_end():
    scene = make_scene({"a": box(10, 10, 12, 12)})
    field = rough_wind(scene, slots=2, hours=1.0)
    for hold, most, horizon in ((False, 200, 37), (False, 20, 20), (True, 200, 200)):
        wind = replace(field, until=np.inf if hold else None)
        assert make_problem("F a", scene, wind, planner=PlannerConfig(max_steps=most)).horizon == horizon


def test_a_single_field_serves_departure_alone_unless_held():
    scene = make_scene({"a": box(10, 10, 12, 12)})
    field = rough_wind(scene, slots=1)
    assert make_problem("F a", scene, field).horizon == 1
    held = make_problem("F a", scene, replace(field, until=np.inf))
    assert held.horizon == 200
    here, later = (interpolate(held.wind, field.mean, t, np.array([4e3, 5e3])) for t in (0, 150))
    np.testing.assert_allclose(later, here)


@pytest.mark.parametrize("times", [[600.0, 4200.0], [-7200.0, -3600.0]])
def test_wind_that_is_not_known_at_departure_is_refused(times):
    scene = make_scene({"a": box(10, 10, 12, 12)})
    field = replace(rough_wind(scene, slots=2), times=np.array(times))
    with pytest.raises(DataError, match=r"from -?\d+ s to -?\d+ s after departure.*mission\.start_time"):
        make_problem("F a", scene, field)


def test_a_robot_slower_than_the_wind_everywhere_is_refused():
    scene = make_scene({"a": box(10, 10, 12, 12)})
    with pytest.raises(DataError, match=r"robot\.u_max = 10 m/s .*at least 13\.0 m/s.*raise robot\.u_max"):
        make_problem("F a", scene, steady_wind(scene, mean=(12.0, 5.0)))
    assert make_problem("F a", scene, steady_wind(scene, mean=(8.0, 5.0))).horizon > 0


# --- Eq. (9)  ------------------------------------------------------------------------------------


def test_the_share_of_an_obstacle_sets_the_quantile():
    for count in (1, 2, 5):
        walls = [box(3 * i + 2, 15, 3 * i + 3, 16) for i in range(count)]
        scene = make_scene({"a": box(10, 10, 12, 12)}, walls)
        problem = make_problem("F a", scene, planner=PlannerConfig(epsilon=0.02))
        assert norm.sf(problem.world.collision.z) == pytest.approx(0.02 / count)


def test_reach_is_a_full_step_in_still_air(problem):
    assert problem.reach == pytest.approx(1000.0)
