"""Sampled refinement as a whole: where it begins, what it brings on flights that it has not seen."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import fisher_exact

from careful_io.machine import GIVEN
from coherent import RARE
from landmarks import LANDMARK_WAY, landmark_problem
from pareto_ltl.extend import draw_flights, simulate_flights
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine import (
    Effort,
    front_sweep,
    last_polish,
    levels,
    sampled_paths,
    sweep,
)
from pareto_ltl.planning.refine.effort import COARSE, USUAL
from pareto_ltl.planning.refine.sampled import Candidate, resampled_means, steps_needed
from pareto_ltl.planning.refine.starts import (
    Start,
    first_starts,
    flipped_starts,
    led_starts,
    line_starts,
    returning_starts,
    tree_starts,
)
from pareto_ltl.planning.refine.sweep import first_of
from pareto_ltl.planning.routes.path_classes import path_class
from pareto_ltl.planning.routes.search_map import sights
from pareto_ltl.planning.selection import hypervolume
from pareto_ltl.planning.separation import separation
from pareto_ltl.settings import PlannerConfig, RefineConfig, RobotConfig, preset
from pareto_ltl.settings.planner import COARSE_EFFORT
from pareto_ltl.simulation.common_flights import is_certain
from pareto_ltl.simulation.judging import judge_front
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.budget import UNLIMITED, Budget
from pareto_ltl.support.errors import InfeasibleError
from problems import box, make_problem, make_scene, smooth_wind, steady_wind

PLANNER = PlannerConfig(trees=3, n_max=600, epsilon=0.5)
REFINE = RefineConfig(flights=400, sweep_flights=120, classes=2, points=6)
EFFORT = Effort.of(REFINE)
FRESH = 4000


def task(law: str = "coherent", border: str = "open", formula: str = "F(a & F b)") -> Problem:
    """Two regions with two obstacles between them, in winds that make the mission fail sometimes."""
    scene = make_scene(
        {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)},
        [box(7, 1, 9, 6), box(10, 9, 13, 12)],
        start=(2.0, 3.0),
    )
    scene = replace(scene, border=border)
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=100.0)
    wind = smooth_wind(scene, speed=1.5, sd=0.9, gust=0.5)
    models = replace(preset("full"), law=law, border=border)
    return make_problem(formula, scene, wind, robot, PLANNER, fidelity=models)


@cache
def grown_in(law: str = "coherent", border: str = "open"):
    problem = task(law, border)
    return problem, grow_forest(PLANNER, problem, SeedSequence(3))


@pytest.fixture(scope="module")
def grown():
    return grown_in()


def searched(problem, starts, flights, *limits):
    """What one search finds; ``limits``: a budget, and who hears of its progress."""
    begun = front_sweep.new_sweep(EFFORT, problem, first_of(flights), *limits)
    found = front_sweep.swept(begun, levels.looks(begun, starts))
    return front_sweep.finished(begun, [begun.reassessed(k, begun.flights) for k in found])


def refined(problem, forest, seed=5):
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(seed))
    return sampled_paths(EFFORT, problem, forest, first_of(flights))


@cache
def refined_in(law: str = "coherent", border: str = "open"):
    return refined(*grown_in(law, border))


def test_a_search_is_no_worse_than_a_coarse_one_at_the_same_length(grown):
    problem, forest = grown
    cfg = RefineConfig(flights=600, sweep_flights=120, classes=3, points=20)
    flights = draw_flights(problem, problem.fidelity.law, Effort.of(cfg).all_flights, SeedSequence(5))
    coarse, full = (
        sampled_paths(Effort.of(c), problem, forest, first_of(flights)) for c in (cfg.coarse(), cfg)
    )
    usual = flights.only(np.arange(cfg.flights))

    def row(path):
        flown = usual.failed(usual.flown(path.u, path.x))
        return path.objectives.length, flown.mean()

    best = np.array([row(path) for path in full])
    rows = [row(path) for path in coarse]
    assert best[:, 0].min() <= EFFORT.last_spacing * min(length for length, _ in rows)
    for length, failed in rows:
        near = best[best[:, 0] <= length * 1.01, 1]  # points of the two searches have different lengths
        assert near.min(initial=failed) <= 1.1 * failed + 3.0 / len(usual)


def test_a_coarse_search_is_limited_and_its_own_coarse_search():
    limited = RefineConfig().coarse()
    assert {name: getattr(limited, name) for name in COARSE_EFFORT} == COARSE_EFFORT
    assert limited.coarse() == limited
    assert RefineConfig(points=3).coarse().points == 3


def test_the_effort_of_a_search_comes_from_the_settings_and_is_less_with_coarse_ones():
    cfg = RefineConfig(flights=700, sweep_flights=90, classes=3, points=17)
    effort = Effort.of(cfg)
    assert (effort.flights, effort.sweep_flights, effort.classes, effort.points) == (700, 90, 3, 17)
    coarse = Effort.of(cfg.coarse())
    for name, value in COARSE.items():
        usual = getattr(effort, name)
        assert getattr(coarse, name) == value
        assert value > usual if "spacing" in name else value < usual
    limited = {"flights": 700, "classes": 3, "points": 17}
    assert replace(coarse, **limited, **{name: getattr(effort, name) for name in COARSE}) == effort
    widths = [list(how.widths) for how in (effort.first, effort.sweep, effort.wide, effort.last)]
    assert all(own == sorted(own, reverse=True) for own in widths)


def test_scouts_have_different_flights(grown):
    problem, forest = grown
    cfg = RefineConfig(flights=1000, sweep_flights=100)
    drawn = draw_flights(problem, problem.fidelity.law, Effort.of(cfg).all_flights, SeedSequence(5))
    found = list(front_sweep.scouts(front_sweep.new_sweep(Effort.of(cfg), problem, first_of(drawn))))
    assert [(len(s.few), len(s.flights)) for s in found] == [(100, 1000)] * 2
    flight = propagate(problem, next(iter(first_starts(problem, forest).values())).x)
    ends = [s.few.positions(flight)[:, -1] for s in found]
    assert len(np.unique(np.concatenate(ends), axis=0)) == sum(map(len, ends))


def test_scouts_share_the_flights_where_there_are_few_and_a_coarse_search_has_one(grown):
    problem, _ = grown
    cfg = RefineConfig(flights=60, sweep_flights=40)
    drawn = draw_flights(problem, problem.fidelity.law, cfg.flights, SeedSequence(5))
    for settings, number in ((cfg, 2), (cfg.coarse(), 1)):
        found = list(front_sweep.scouts(front_sweep.new_sweep(Effort.of(settings), problem, first_of(drawn))))
        assert [(len(s.few), len(s.flights)) for s in found] == [(40, 60)] * number


# --- starts -----------------------------------------------------------------------------------


def test_starts_complete_the_mission_and_are_of_one_class_each(grown):
    problem, forest = grown
    starts = first_starts(problem, forest)
    assert len(starts) >= 3
    for (kind, _), start in starts.items():
        assert path_class(problem, start.x) == kind
        assert problem.logic.distance[kind.state] == 0.0


def test_trees_supply_more_than_one_class(grown):
    problem, forest = grown
    classes = {path_class(problem, start.x) for start in tree_starts(problem, forest)}
    assert len(tree_starts(problem, forest)) >= len(classes) >= 2


def test_lines_are_drawn_for_every_order_of_the_mission():
    problem = task(formula="F a & F b")
    orders = {path_class(problem, start.x).order for start in line_starts(problem)}
    assert len({tuple(tuple(sorted(label)) for _, label in order) for order in orders}) == 2


def test_lines_after_the_first_orders_have_one_distance_from_obstacles():
    """Of six orders three have lines at all distances, the others one, at the largest that there is."""
    regions = {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17), "c": box(14, 14, 18, 18)}
    scene = make_scene(regions, [box(9, 8, 12, 11)], start=(2.0, 3.0))
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=100.0)
    wind = smooth_wind(scene, speed=1.5, sd=0.9, gust=0.5)
    problem = make_problem("F a & F b & F c", scene, wind, robot, PLANNER, fidelity="full")
    drawn: dict[object, list[str]] = {}
    for start in line_starts(problem):
        drawn.setdefault(path_class(problem, start.x).order, []).append(start.origin)
    numbers = sorted(map(len, drawn.values()))
    assert numbers[:3] == [1, 1, 1]
    assert len(numbers) == 6
    assert numbers[3] > 1


def test_lines_lead_less_far_into_regions_where_the_wind_ends_too_soon(grown):
    problem, _ = grown
    middle = line_starts(problem)
    fewest = min(len(start.x) - 1 for start in middle)
    found = line_starts(replace(problem, max_steps=fewest - 1))
    assert found
    assert max(length_of(start.x) for start in found) < min(length_of(start.x) for start in middle)
    for start in found:
        assert len(start.x) <= fewest
        assert problem.logic.distance[path_class(problem, start.x).state] == 0.0


def test_a_flipped_path_passes_the_obstacle_on_its_other_side(grown):
    problem, forest = grown
    best = tree_starts(problem, forest)[0]
    own = path_class(problem, best.x).words
    flipped = {path_class(problem, start.x).words for start in flipped_starts(problem, best.x, "")}
    assert flipped - {own}


def test_returning_paths_pass_each_place_a_second_time_and_avoid_obstacles(grown):
    """One for a and one for b; each is longer by about the way out and back, and completes the mission."""
    problem, forest = grown
    best = tree_starts(problem, forest)[0]
    flight = propagate(problem, best.x)
    starts = returning_starts(problem, flight, "tree")
    assert 1 <= len(starts) <= 2
    regions = [shapely.Polygon(problem.scene.regions[name][0]) for name in "ab"]
    before = [visits(region, best.x) for region in regions]
    for start in starts:
        assert problem.logic.distance[problem.states(start.x)[-1]] == 0.0
        assert length_of(start.x) > length_of(best.x)
        assert not shapely.LineString(start.x).intersects(
            shapely.MultiPolygon([shapely.Polygon(corners) for corners in problem.scene.obstacles])
        )
        assert sum(visits(region, start.x) for region in regions) >= sum(before)


def test_led_paths_meet_a_landmark_that_the_path_has_missed_and_come_back():
    """Of three landmarks the path meets one, and an obstacle stands before another."""
    marks, wall = (box(2, 12, 5, 15), box(9, 9, 10, 10), box(12, 2, 14, 4)), box(10, 0.5, 11, 8)
    scene = make_scene({"a": box(13, 13, 19, 19)}, [wall], start=(2.0, 2.0))
    problem = landmark_problem(replace(scene, landmarks=marks))
    (start,) = led_starts(problem, propagate(problem, LANDMARK_WAY), "way")
    assert sights(problem, LANDMARK_WAY).any(axis=0).tolist() == [False, True, False]
    assert sights(problem, start.x)[:, 0].any()
    assert problem.logic.distance[problem.states(start.x)[-1]] == 0.0
    np.testing.assert_array_equal(start.x[[0, -1]], LANDMARK_WAY[[0, -1]])
    assert not shapely.LineString(start.x).intersects(shapely.Polygon(wall))


def visits(region: shapely.Polygon, x: FloatArray) -> float:
    """The length of ``x`` in ``region`` [m]."""
    return float(sum(shapely.LineString(x[t : t + 2]).intersection(region).length for t in range(len(x) - 1)))


# --- lengths and steps ------------------------------------------------------------------------


@cache
def taut_line() -> tuple[Problem, FloatArray]:
    problem = task()
    return problem, line_starts(problem)[0].x


@given(st.integers(2, 40))
def test_resampling_keeps_the_ends_and_never_lengthens_the_line(steps):
    problem, x = taut_line()
    y = resampled_means(problem, x, steps)
    assert len(y) == steps + 1
    np.testing.assert_allclose(y[[0, -1]], x[[0, -1]])
    assert length_of(y) <= length_of(x) * (1 + 1e-9)


candidates = st.lists(st.tuples(st.floats(1.0, 10.0), st.floats(0.0, 1.0)), min_size=1, max_size=30)


@given(candidates)
def test_the_front_is_what_no_other_candidate_beats(rows):
    found = [Candidate(None, length, failure, failure) for length, failure in rows]  # type: ignore[arg-type]
    kept = sweep.front_of(found)
    assert [k.length for k in kept] == sorted({k.length for k in kept})
    for k in found:
        assert any(other.length <= k.length and other.smoothed <= k.smoothed for other in kept)
    for one, other in pairwise(kept):
        assert other.smoothed < one.smoothed


@given(candidates, st.integers(2, 20))
def test_points_are_spread_from_the_shortest_to_the_longest(rows, most):
    kept = sweep.front_of(
        Candidate(None, length, failure, failure)
        for length, failure in rows  # type: ignore[arg-type]
    )
    jobs = sweep.spread_points(EFFORT, kept, most)
    caps = [cap for _, cap in jobs]
    assert caps[0] == pytest.approx(kept[0].length)
    assert caps[-1] == pytest.approx(kept[-1].length, rel=EFFORT.within - 1.0)
    assert len(caps) <= most
    assert all(other > EFFORT.within * cap for cap, other in pairwise(caps))
    beside = [k.length for k in kept]  # no cap is far from a path that was found
    assert all(min(abs(np.log(cap / length)) for length in beside) < 0.05 for cap in caps)
    assert all(k.length <= EFFORT.spacing * cap * (1 + 1e-9) for k, cap in jobs)


def test_a_path_between_two_plateaus_has_a_point():
    lengths = [1.0, 1.02, 1.04, 1.2, 1.5, 1.51, 1.53]
    kept = [Candidate(None, length, 1.0 / length, 0.0) for length in lengths]
    caps = [cap for _, cap in sweep.spread_points(EFFORT, kept, 12)]
    assert any(cap == pytest.approx(1.2) for cap in caps)
    assert any(cap == pytest.approx(1.5) for cap in caps)
    assert not any(1.05 < cap < 1.19 or 1.21 < cap < 1.49 for cap in caps)


# --- what it brings ---------------------------------------------------------------------------


@pytest.mark.no_cover  # coverage slows the compiler down, and other tests run the same lines
@pytest.mark.parametrize(
    ("law", "border"), [("coherent", "open"), ("coherent", "wall"), ("independent", "open")]
)
def test_refined_paths_fail_less_on_fresh_flights_than_those_of_the_trees(law, border):
    problem, forest = grown_in(law, border)
    paths = refined_in(law, border)

    def failures(x):
        flown = simulate_flights(problem, propagate(problem, x).u, FRESH, law, SeedSequence(77), x)
        return int(flown.failed.sum())

    tree = min(failures(start.x) for start in tree_starts(problem, forest))
    best = min(failures(path.x) for path in paths)
    table = [[best, FRESH - best], [tree, FRESH - tree]]
    assert fisher_exact(table, alternative="less").pvalue < RARE


def test_lengths_fall_along_the_front_and_every_path_can_be_flown():
    problem, _ = grown_in()
    paths = refined_in()
    lengths = [path.objectives.length for path in paths]
    assert len(paths) >= 3
    assert lengths == sorted(lengths)
    for path in paths:
        assert np.linalg.norm(path.u, axis=1).max() <= problem.motion.u_max * (1 + 1e-6)
        assert problem.automaton.distance[path.q[-1]] == 0.0


def test_the_same_seed_gives_the_same_paths_on_one_core_and_on_two(grown, monkeypatch):
    problem, forest = grown
    first = refined(problem, forest)
    monkeypatch.setenv(GIVEN[0], "1")
    again = refined(problem, forest)
    assert [path.x.tobytes() for path in first] == [path.x.tobytes() for path in again]


# --- where nothing can be flown ---------------------------------------------------------------


def windy(mean: float, sd: float) -> Problem:
    """One region to the west of the start, in a wind from the west."""
    scene = make_scene({"a": box(2, 8, 5, 12)}, start=(15.0, 10.0))
    scene = replace(scene, border="wall")
    wind = steady_wind(scene, mean=(mean, 0.0), latent=(0.5, 0.5), gust=(sd, sd), hours=1.0)
    robot = RobotConfig(dt=100.0, u_max=16.0, start_sd=100.0)
    return make_problem("F a", scene, wind, robot, PLANNER, fidelity="full")


def test_where_no_start_can_be_flown_a_warning_names_the_best_and_its_fault(caplog):
    problem = windy(mean=15.0, sd=0.5)
    forest = grow_forest(PLANNER, problem, SeedSequence(3))
    assert len(forest.accepted) == 0
    line = np.linspace(problem.scene.start, [3500.0, 10000.0], 12)
    starts = {(path_class(problem, line), 0): Start(line, "a line")}
    flights = draw_flights(problem, "coherent", 100, SeedSequence(1))
    found = searched(problem, starts, flights)
    assert last_polish.planned_paths(problem, found) == ()
    best = r"refined paths cannot be flown; the best of them \(a line, \S+ km, \d+ steps, fails 1"
    assert re.search(best, caplog.text)


def test_a_path_that_cannot_be_flown_is_repaired_or_named(caplog):
    """A path that ends before the region: with more steps it gets there; without repair it is named."""
    problem, line = taut_line()
    x = resampled_means(problem, line, len(line) + 8)
    short = Candidate(propagate(problem, x[:-4]), length_of(x[:-4]), 0.2, 0.125, "too short")
    good = Candidate(propagate(problem, x), length_of(x), 0.1, 0.1, "a line")
    paths = last_polish.planned_paths(problem, [good, short])
    assert [path.origin for path in paths] == ["a line, refined"]
    assert "1 of 2 refined paths cannot be flown; the best of them (too short" in caplog.text
    assert "fails 12 %): the expected path does not complete the mission" in caplog.text
    caplog.clear()
    assert len(last_polish.planned_paths(problem, [good, short], lambda _: [short, good])) == 2
    assert not caplog.text


def test_where_every_flight_fails_it_is_said_how(caplog):
    problem = windy(mean=0.0, sd=300.0)
    path = evaluate_path(problem, np.linspace(problem.scene.start, [3500.0, 10000.0], 14), "a line")
    with pytest.raises(InfeasibleError, match="every path fails in all 200 flights in coherent") as told:
        judge_front(problem, [path], [], 200, SeedSequence(2))
    front = judge_front(problem, [path], [], 200, SeedSequence(2), strict=False)
    assert [rate.failure for rate in front.rates] == [1.0]
    assert str(told.value) in caplog.text
    said = r"\(a, (\S+) km\), (\d+) % miss the mission, 0 % touch an obstacle, (\d+) % leave the map"
    share = re.search(said, str(told.value))
    assert share is not None
    assert float(share[1]) == pytest.approx(path.objectives.length / 1e3, abs=0.06)
    assert 80 <= int(share[2]) <= 99  # some pass the region and leave the map
    assert int(share[3]) == 100


def test_a_wind_without_doubt_is_known_as_one():
    scene = make_scene({"a": box(13, 2, 17, 6)}, [box(7, 1, 9, 6)], start=(2.0, 3.0))
    calm = make_problem("F a", scene, steady_wind(scene, mean=(1.0, 0.0), gust=(0.0, 0.0)), fidelity="full")
    assert is_certain(calm)
    assert not is_certain(task())


# --- budgets ----------------------------------------------------------------------------------


class CountedBudget(Budget):
    """A budget that is spent after so many looks at it, whatever the clock says."""

    def __init__(self, looks):
        super().__init__(1.0)
        self.looks = looks

    def left(self, share=1.0):
        self.looks -= 1
        return 1.0 if self.looks > 0 else 0.0


def front_within(grown, budget, progress=None):
    problem, forest = grown
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(5))
    starts = first_starts(problem, forest)
    return searched(problem, starts, flights, budget, progress)


def test_without_time_one_start_is_looked_at_and_makes_the_front(grown):
    budget = Budget(1.0)
    budget.end()
    assert len(front_within(grown, budget)) in (1, 2)


@pytest.mark.parametrize("looks", [5, 20, 60])
def test_a_budget_that_is_spent_early_leaves_a_front(grown, looks):
    front = front_within(grown, CountedBudget(looks))
    assert front
    assert all(a.length < b.length and a.smoothed > b.smoothed for a, b in pairwise(front))


def test_what_is_left_of_a_budget_betters_the_front(grown):
    """On the flights of the sweep no front is worse than the one before, and the last is better."""
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(5))
    sweep = front_sweep.new_sweep(EFFORT, problem, first_of(flights), CountedBudget(150))
    begun = front_within(grown, UNLIMITED)[::3]
    fronts = [begun, *front_sweep.improved_fronts(sweep, begun)]
    reference = np.array([1.0, 2.0 * begun[-1].length])
    volumes = [hypervolume(np.array([[k.smoothed, k.length] for k in f]), reference) for f in fronts]
    assert volumes == sorted(volumes)
    assert volumes[-1] > volumes[0]


def test_without_a_budget_nothing_is_varied(grown):
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, 20, SeedSequence(5))
    sweep = front_sweep.new_sweep(EFFORT, problem, first_of(flights))
    assert list(front_sweep.improved_fronts(sweep, front_within(grown, CountedBudget(5)))) == []


def test_widths_are_narrower_where_flights_spread_little(grown):
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, 20, SeedSequence(5))
    usual = front_sweep.new_sweep(EFFORT, problem, first_of(flights))
    narrow = replace(usual, spread=0.3 * EFFORT.spread * usual.map_size)
    for how in (EFFORT.first, EFFORT.sweep, EFFORT.wide, EFFORT.last, EFFORT.closing):
        wide, fine = usual.polish_of(how).widths, narrow.polish_of(how).widths
        np.testing.assert_allclose(wide, np.array(how.widths) * usual.map_size)
        assert fine[-1] == pytest.approx(0.3 * wide[-1])
        if how.far:  # it begins as usual, and narrows in small ratios
            assert fine[: len(wide)] == wide
            assert max(a / b for a, b in pairwise(fine[len(wide) - 1 :])) <= EFFORT.fall * (1.0 + 1e-9)
    still = replace(usual, spread=0.0)
    assert still.share == EFFORT.narrowest


def test_a_path_is_no_longer_than_flights_that_spread_little_need():
    """With widths for flights that spread more, every path seems to fail, and is lengthened."""
    problem = task()
    wind = smooth_wind(problem.scene, speed=1.5, sd=0.005, gust=0.01)
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=1.0)
    problem = make_problem("F(a & F b)", problem.scene, wind, robot, PLANNER, fidelity=problem.fidelity)
    forest, shortest = grow_forest(PLANNER, problem, SeedSequence(3)), []
    flights = draw_flights(problem, "coherent", REFINE.flights, SeedSequence(5))
    fresh = draw_flights(problem, "coherent", FRESH, SeedSequence(6))
    usual = replace(EFFORT, **{name: getattr(USUAL, name) for name in COARSE})  # coarse levels are 10 % apart
    for effort in (usual, replace(usual, spread=1e-9)):
        paths = sampled_paths(effort, problem, forest, first_of(flights))
        safe = [path for path in paths if fresh.failed(fresh.flown(path.u, path.x)).mean() < 0.001]
        shortest.append(min(path.objectives.length for path in safe))
    assert shortest[0] < 0.99 * shortest[1]


def test_progress_tells_how_many_paths_there_are_and_how_the_safest_fails(grown):
    problem, forest = grown
    told = []
    cfg = replace(REFINE, classes=3)
    flights = draw_flights(problem, problem.fidelity.law, cfg.flights, SeedSequence(5))
    paths = sampled_paths(Effort.of(cfg), problem, forest, first_of(flights), lambda *news: told.append(news))
    steps = [done for done, *_ in told]
    assert steps == list(range(1, 6))  # two of each scout, and the last polish
    assert {total for _, total, *_ in told} == {5}
    assert len(told[-1][3]) == len(paths)
    form = r"\d+ paths of at least \d+\.\d km; the safest fails \S+ % at \d+\.\d km"
    assert all(re.fullmatch(form, state) for *_, state, _ in told)


# --- classes, steps and epsilon ----------------------------------------------------------------


@pytest.fixture(scope="module")
def looked(grown):
    """A sweep and what its first looks make of the starts, with all of its flights."""
    problem, forest = grown
    flights = draw_flights(problem, "coherent", EFFORT.all_flights, SeedSequence(5))
    begun = sweep.new_sweep(EFFORT, problem, first_of(flights))
    return begun, levels.looks(begun, first_starts(problem, forest))


def test_a_second_scout_goes_on_from_the_looks_of_the_first(looked):
    """It flies the same paths with its own flights, and sorts them by these."""
    begun, seen = looked
    begun = replace(begun, effort=replace(EFFORT, scouts=2))
    first, second = front_sweep.scouts(begun)
    own = second.compared(seen)
    assert [k.smoothed for k in own] == sorted(k.smoothed for k in own)
    assert {k.flight.x.tobytes() for k in own} == {k.flight.x.tobytes() for k in seen}
    width = begun.polish_of(EFFORT.sweep).widths[-1]
    for k in own[:3]:
        there = second.refiner.assessed(k.flight, second.few, width, 1.0)
        assert k.smoothed == there.smoothed
        assert k.smoothed != first.refiner.assessed(k.flight, first.few, width, 1.0).smoothed


def test_a_path_is_polished_in_the_fewest_steps_and_its_own_and_in_more_where_it_may_be_slower(looked):
    begun, seen = looked
    k = seen[0]
    x = resampled_means(begun.problem, k.flight.x, 2 * k.steps)
    slow = replace(k, flight=propagate(begun.problem, x))
    fewest = sweep.fewest_steps(steps_needed(begun.problem, slow.flight.x))
    own = slow.steps - fewest
    assert own > EFFORT.spare_steps[-1]
    more = own + max(2, round(EFFORT.slower * fewest))
    for slower, steps in ((False, [0, 1, own]), (True, [0, 1, own, more])):
        lines = levels.timed_lines(begun, slow, EFFORT.spare_steps, slower=slower)
        assert [line[1] for line in lines] == steps
    coarse = replace(begun, effort=replace(EFFORT, apart=1.5 / fewest))  # one step more makes no difference
    assert [line[1] for line in levels.timed_lines(coarse, slow, (0, 1), slower=True)] == [0, own, more]


def test_the_widest_gaps_of_a_front_are_divided(grown):
    """Points come between its ends, and the hypervolume rises."""
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(5))
    begun = front_sweep.new_sweep(Effort.of(replace(REFINE, points=12)), problem, first_of(flights))
    front = front_within(grown, UNLIMITED)
    few = [front[0], front[-1]]
    more = last_polish.divided_gaps(begun, few)
    assert 2 < len(more) <= 2 + begun.effort.points
    assert all(a.length < b.length and a.smoothed > b.smoothed for a, b in pairwise(more))
    corner = np.array([1.0, 2.0 * front[-1].length])
    before, after = (
        hypervolume(np.array([[k.smoothed, k.length] for k in part]), corner) for part in (few, more)
    )
    assert after > 1.02 * before
    assert all(few[0].length <= k.length <= few[1].length * EFFORT.within for k in more)


def test_the_middle_of_a_gap_between_two_classes_is_polished_from_both(grown, monkeypatch):
    """In a gap between two paths of one class from the longer one alone."""
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(5))
    begun = front_sweep.new_sweep(Effort.of(replace(REFINE, points=3)), problem, first_of(flights))
    front = front_within(grown, UNLIMITED)
    ends = [front[0], front[-1]]
    begins = list[Candidate]()
    monkeypatch.setattr(last_polish, "finished_point", lambda _sweep, k, _cap: begins.append(k) or k)
    other = replace(path_class(problem, ends[0].flight.x), words=((1,), (2,)))
    for kinds, wanted in (((None, None), ends[1:]), ((other, None), ends[::-1])):
        begins.clear()
        last_polish.divided_gaps(begun, [replace(k, kind=kind) for k, kind in zip(ends, kinds, strict=True)])
        if kinds[0] is None and len({path_class(problem, k.flight.x) for k in ends}) > 1:
            continue
        assert {k.flight.x.tobytes() for k in begins} == {k.flight.x.tobytes() for k in wanted}


def test_the_safest_point_is_lengthened_by_a_return_if_that_saves_most(grown, monkeypatch):
    """Lines that pass a place twice are among those that are polished, at a cap that they may have."""
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(5))
    begun = front_sweep.new_sweep(EFFORT, problem, first_of(flights))
    best = front_within(grown, UNLIMITED)[-1]
    polished = list[str]()
    finished = last_polish.finished_point
    monkeypatch.setattr(
        last_polish, "finished_point", lambda s, k, cap: polished.append(k.origin) or finished(s, k, cap)
    )
    made = last_polish.lengthened_points(begun, [replace(best, failed=0.5)])
    assert any(origin.endswith("returning") for origin in polished)
    assert len(made) == len(polished) >= 2
    assert min(k.length for k in made) > best.length
    assert not last_polish.lengthened_points(begun, [replace(best, failed=0.0)])


@pytest.mark.parametrize(("shorter", "longer", "pays"), [
    (0.2, 0.18, True), (0.2, 0.195, False), (0.002, 0.001, True), (2e-5, 1e-5, False),
])  # fmt: skip
def test_a_longer_path_pays_if_it_fails_less_and_flights_can_tell(grown, shorter, longer, pays):
    problem, _ = grown
    flights = draw_flights(problem, problem.fidelity.law, REFINE.flights, SeedSequence(5))
    begun = front_sweep.new_sweep(EFFORT, problem, first_of(flights))
    flight = propagate(problem, line_starts(problem)[0].x)
    one, other = (Candidate(flight, 1.0, smoothed, smoothed) for smoothed in (shorter, longer))
    assert begun.pays(other, one, begun.flights) == pays


def test_where_the_best_order_breaks_epsilon_another_one_is_searched():
    """a lies close by, behind a gap too narrow for epsilon = 2 %; b is in the open, farther and smaller."""
    gap = [box(8, 0, 9, 9.5), box(8, 10.5, 9, 20)]
    scene = make_scene({"a": box(10, 6, 17, 14), "b": box(1, 1.5, 2.5, 3)}, gap, start=(6.0, 10.0))
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=100.0)
    wind = smooth_wind(scene, speed=1.5, sd=0.9, gust=0.5)

    def order_and_risk(epsilon: float) -> set[tuple[str, bool]]:
        planner = replace(PLANNER, epsilon=epsilon)
        problem = make_problem("F a | F b", scene, wind, robot, planner, fidelity="full")
        flights = draw_flights(problem, "coherent", REFINE.flights, SeedSequence(5))
        found = sampled_paths(
            EFFORT, problem, grow_forest(planner, problem, SeedSequence(3)), first_of(flights)
        )
        rows = ((path_class(problem, p.x), separation(problem, propagate(problem, p.x)).risk) for p in found)
        return {("".join(sorted(kind.order[-1][1])), bool(risk.max() <= 0.02)) for kind, risk in rows}

    assert order_and_risk(0.5) == {("a", False)}
    assert order_and_risk(0.02) == {("b", True)}


def test_every_path_of_a_search_keeps_epsilon():
    """The shortest way leads through a gap that breaks epsilon = 2 %; around it there is room."""
    gap = [box(8, 6, 9, 9.5), box(8, 10.5, 9, 14)]
    scene = make_scene({"a": box(12, 5, 18, 15)}, gap, start=(4.0, 10.0))
    robot = RobotConfig(dt=100.0, u_max=12.0, start_sd=100.0)
    wind = smooth_wind(scene, speed=1.5, sd=0.9, gust=0.5)

    def risks(epsilon: float) -> list[float]:
        planner = replace(PLANNER, epsilon=epsilon)
        problem = make_problem("F a", scene, wind, robot, planner, fidelity="full")
        flights = draw_flights(problem, "coherent", REFINE.flights, SeedSequence(5))
        forest = grow_forest(planner, problem, SeedSequence(3))
        found = sampled_paths(EFFORT, problem, forest, first_of(flights))
        return [float(separation(problem, propagate(problem, p.x)).risk.max()) for p in found]

    assert max(risks(0.5)) > 0.02
    kept = risks(0.02)
    assert len(kept) > 1
    assert max(kept) <= 0.02 * (1.0 + 1e-6)
