"""The front against brute force, and the rules by which one path of it is flown."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence

from pareto_ltl.extend import FailureRate
from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.records import Front, Objectives, PlannedPath, objective_row
from pareto_ltl.planning.selection_rules import (
    RULES,
    SelectionRule,
    bound_warning,
    choose_path,
    safest_of_front,
    selection_rule,
    within_capacity,
)
from pareto_ltl.settings import PlannerConfig, SelectionConfig
from pareto_ltl.settings.fidelity import PAPER
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from problems import two_goals

some = settings(deadline=None, max_examples=80)
grid = st.integers(0, 4).map(float)  # small numbers make ties and repeated rows
tables = st.lists(st.tuples(grid, grid, grid), min_size=1, max_size=25).map(np.array)

METRE = np.array([0.0, 0.0, 1.0])  # no path is quite without length


def dominates(winner, loser):
    return bool(np.all(winner <= loser) and np.any(winner < loser))


def path_of(mission, collision, length, judged=None, origin=""):
    """A path that is nothing but its objectives; ``judged`` is its mission risk where it is not f_o."""
    judged = mission if judged is None else judged
    objectives = Objectives({"length": length}, mission, judged, collision, judged)
    empty = np.zeros((1, 2))
    nowhere = np.zeros(1, np.int64)
    return PlannedPath(
        np.zeros(1), empty, np.zeros((1, 2, 2)), nowhere, (frozenset(),), empty[:0], objectives, origin
    )


def front_of(*rows, **how):
    return selection.build_front([], [path_of(*row, **how) for row in rows])


# --- the front ---------------------------------------------------------------------------------------------


@some
@given(tables)
def test_every_discarded_row_is_dominated_or_repeated_and_no_kept_row_is(costs):
    keep = selection.non_dominated(costs)
    for i, row in enumerate(costs):
        beaten = any(dominates(other, row) for other in costs)
        repeated = any(np.array_equal(other, row) for other in costs[:i])
        assert keep[i] == (not beaten and not repeated)


@some
@given(tables, st.randoms(use_true_random=False))
def test_the_front_does_not_depend_on_row_order(costs, random):
    order = list(range(len(costs)))
    random.shuffle(order)
    one, other = (costs[rows][selection.non_dominated(costs[rows])] for rows in (range(len(costs)), order))
    assert sorted(map(tuple, one)) == sorted(map(tuple, other))


@some
@given(tables)
def test_paths_of_a_front_are_sorted_and_do_not_dominate_one_another(costs):
    front = selection.build_front([], [path_of(*row) for row in costs + METRE])
    rows = [objective_row(p.objectives) for p in front.paths]
    assert [tuple(row) for row in rows] == sorted(tuple(row) for row in rows)
    assert not any(dominates(a, b) or dominates(b, a) for a, b in combinations(rows, 2))
    assert len(front.raw) == len(costs)


def test_a_smoothed_path_replaces_what_it_dominates():
    raw = [path_of(0.1, 0.0, 100.0, origin="tree"), path_of(0.01, 0.0, 150.0, origin="tree")]
    smoothed = [path_of(0.1, 0.0, 90.0, origin="smoothed"), path_of(0.5, 0.1, 95.0, origin="smoothed")]
    front = selection.build_front(smoothed, raw)
    assert [(p.origin, p.objectives.length) for p in front.paths] == [("tree", 150.0), ("smoothed", 90.0)]
    assert [o.length for o in front.raw] == [100.0, 150.0]
    assert front.hypervolume > selection.build_front([], raw).hypervolume


def test_no_paths_are_no_front():
    with pytest.raises(InfeasibleError, match="no path completes the mission"):
        selection.build_front([], [])


def test_the_hypervolume_of_two_boxes_is_their_union():
    """Below the reference (2, 4, 10): boxes 1 x 3 x 5 and 1.5 x 1 x 5 share 1 x 1 x 5 of 80."""
    rows, reference = np.array([[1.0, 1.0, 5.0], [0.5, 3.0, 5.0]]), np.array([2.0, 4.0, 10.0])
    assert selection.hypervolume(rows, reference) == pytest.approx((15 + 7.5 - 5) / 80)
    assert selection.hypervolume(rows[:1], reference) == pytest.approx(15 / 80)
    assert selection.hypervolume(rows[:0], reference) == 0.0


def test_rows_beyond_the_reference_add_no_volume():
    rows, reference = np.array([[1.0, 3.0], [3.0, 0.0], [0.0, 9.0]]), np.array([2.0, 4.0])
    assert selection.hypervolume(rows, reference) == pytest.approx(1 * 1 / 8)


@some
@given(tables, tables)
def test_more_rows_never_make_the_hypervolume_smaller(costs, more):
    reference = np.array([5.0, 5.0, 5.0])
    both = np.vstack([costs, more])
    assert selection.hypervolume(both, reference) >= selection.hypervolume(costs, reference) - 1e-12
    kept = costs[selection.non_dominated(costs)]
    assert selection.hypervolume(kept, reference) == pytest.approx(selection.hypervolume(costs, reference))


@pytest.fixture(scope="module")
def planted():
    problem = two_goals()
    return problem, growth.grow_forest(PlannerConfig(trees=3, n_max=400), problem, SeedSequence(0))


def test_the_front_of_the_trees_holds_every_trade_off_between_risk_and_length(planted):
    problem, forest = planted
    rows = selection.accepted_rows(forest)
    front = selection.tree_front(problem, forest)
    found = [(p.objectives.mission_risk_paper, p.objectives.length) for p in front]
    expected = sorted({tuple(r) for r in rows if not any(dominates(s, r) for s in rows)})
    assert len(expected) > 1
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    for path in front:
        assert problem.automaton.accepting[path.q[-1]]
        _, j, _, v = path.origin.split()
        np.testing.assert_array_equal(path.x, forest.trees[int(j)].path(int(v)))
        again = evaluate_path(problem, path.x, path.origin)
        assert again.objectives == path.objectives


def test_a_forest_that_completes_nothing_has_no_front(planted):
    problem, forest = planted
    assert selection.tree_front(problem, replace(forest, accepted=np.empty((0, 2), np.int64))) == ()


def test_flights_judge_paths_of_every_order_and_length_and_not_the_safest_alone(planted):
    problem, forest = planted
    rows = selection.accepted_rows(forest)
    paths = selection.unlike_paths(problem, forest)
    lengths = np.array([path.objectives.length for path in paths])
    assert len({path.origin for path in paths}) == len(paths) <= selection.MOST
    for _, length in rows:  # whatever its risk, something of about its length is flown
        assert np.abs(np.log(lengths / length)).min() <= 0.02
    safest = {path.origin for path in selection.tree_front(problem, forest)}
    assert {path.origin for path in paths} - safest  # bounds rule these out
    nothing = replace(forest, accepted=np.empty((0, 2), np.int64))
    assert selection.unlike_paths(problem, nothing) == ()


def test_so_many_paths_are_thinned_by_length(planted, monkeypatch):
    problem, forest = planted
    monkeypatch.setattr(selection, "MOST", 5)
    paths = selection.unlike_paths(problem, forest)
    lengths = sorted(path.objectives.length for path in paths)
    every = selection.accepted_rows(forest)[:, -1]
    assert 2 <= len(paths) <= 5
    assert lengths[-1] / lengths[0] > np.sqrt(every.max() / every.min())  # short ones and long ones


# --- the rules ---------------------------------------------------------------------------------------------

CHOICE = (
    (0.001, 0.02, 300.0),
    (0.010, 0.01, 200.0),
    (0.060, 0.03, 150.0),
    (0.300, 0.00, 120.0),
)


def chosen(front: Front, **settings):
    o = choose_path(SelectionConfig(**settings), front).objectives
    return o.mission_risk_paper, o.collision_risk, o.length


fronts_flown = st.lists(st.tuples(st.floats(1.0, 9.0), st.integers(0, 200)), min_size=1, max_size=12)


@some
@given(fronts_flown, st.floats(0.0, 20.0), st.floats(0.0, 20.0))
def test_worth_takes_the_least_product_of_failure_and_a_power_of_length(rows, saving, more):
    lengths, counts = zip(*rows, strict=True)
    front = flown_front(lengths, same_flights(*counts, runs=200))
    length = chosen(front, rule="worth", saving=saving)[2]
    least = min((count / 200 + 0.001) * own**saving for own, count in rows)
    assert any(own == length and (n / 200 + 0.001) * own**saving <= least * (1 + 1e-9) for own, n in rows)
    assert chosen(front, rule="worth", saving=saving + more)[2] <= length * (1 + 1e-9)


def test_worth_does_not_fly_laps_for_a_rate_that_is_low_enough():
    """Twice the length for 0.04 instead of 0.05 failures, or for none instead of one of a thousand."""
    assert chosen(flown_front((200.0, 100.0), same_flights(40, 50)), rule="worth")[2] == 100.0
    assert chosen(flown_front((200.0, 100.0), same_flights(0, 1)), rule="worth")[2] == 100.0
    assert chosen(flown_front((110.0, 100.0), same_flights(20, 50)), rule="worth")[2] == 110.0


def test_worth_is_priority_where_bounds_judge():
    assert chosen(front_of(*CHOICE), rule="worth") == chosen(front_of(*CHOICE), rule="priority")


def test_priority_takes_the_least_mission_risk_whatever_its_length():
    assert chosen(front_of(*CHOICE), rule="priority") == CHOICE[0]


def test_priority_breaks_ties_by_collisions_then_length():
    tied = ((0.001, 0.05, 100.0), (0.001, 0.02, 300.0), (0.001, 0.03, 200.0))
    assert chosen(front_of(*tied), rule="priority") == tied[1]


def flown_front(lengths, failed):
    """A front of paths of ``lengths`` whose flights ``failed`` (P, n)."""
    failed = np.asarray(failed, bool)
    paths = tuple(path_of(0.5, 0.0, length) for length in lengths)
    rates = tuple(FailureRate.counted("coherent", int(row.sum()), failed.shape[1]) for row in failed)
    return Front(paths, (), 0.0, np.ones(2), rates, failed=failed)


def same_flights(*counts, runs=1000):
    """Failed flights (P, runs): each path fails in the worst winds, so that one's failures hold another's."""
    return np.arange(runs) < np.array(counts)[:, None]


def test_priority_takes_the_safest_path_where_flights_judge_and_it_is_safer_beyond_chance():
    for lengths in ((400.0, 300.0, 200.0), (400.0, 200.0, 300.0)):
        front = flown_front(lengths, same_flights(20, 60, 100))
        assert chosen(front, rule="priority")[2] == 400.0


def test_priority_takes_the_shortest_of_paths_that_flights_do_not_tell_apart():
    """Five more failures of a thousand, none fewer: a chance of 1/32, which is above 2.5 %. Six: 1/64."""
    front = flown_front((400.0, 300.0, 200.0, 100.0), same_flights(20, 23, 25, 26))
    assert chosen(front, rule="priority")[2] == 200.0


def test_common_winds_tell_apart_rates_whose_intervals_overlap():
    failed = same_flights(40, 52)
    rates = flown_front((2.0, 1.0), failed).rates
    assert rates[1].low < rates[0].failure < rates[1].failure < rates[0].high
    assert chosen(flown_front((2.0, 1.0), failed), rule="priority")[2] == 2.0
    elsewhere = np.vstack([failed[0], np.roll(failed[1], 500)])  # the same rates in other winds
    assert chosen(flown_front((2.0, 1.0), elsewhere), rule="priority")[2] == 1.0


@some
@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 5), st.integers(1, 5))
def test_the_sign_test_sums_the_binomial_law(worse, better, both, neither):
    one = np.repeat([True, False, True, False], [worse, better, both, neither])
    other = np.repeat([False, True, True, False], [worse, better, both, neither])
    n = worse + better
    chance = sum(math.comb(n, k) for k in range(worse, n + 1)) / 2**n
    assert selection.chance_of_failures(one, other) == pytest.approx(chance)


@some
@given(tables, st.tuples(grid, grid, grid).filter(any))
def test_weighted_takes_the_least_weighted_sum(costs, weights):
    front = front_of(*(costs + METRE) / [4, 4, 1])
    rows = np.array([objective_row(p.objectives) for p in front.paths])
    sums = rows / [1, 1, rows[:, 2].min()] @ weights
    found = np.array(chosen(front, rule="weighted", weights=list(weights)))
    assert found / [1, 1, rows[:, 2].min()] @ weights == pytest.approx(sums.min())


def test_weights_on_one_objective_find_its_best():
    front = front_of(*CHOICE)
    assert chosen(front, rule="weighted", weights=[1, 0, 0]) == CHOICE[0]
    assert chosen(front, rule="weighted", weights=[0, 1, 0]) == CHOICE[3]
    assert chosen(front, rule="weighted", weights=[0, 0, 1]) == CHOICE[3]
    assert chosen(front, rule="weighted", weights=[10, 0, 1]) == CHOICE[1]


def test_threshold_takes_the_shortest_that_is_safe_enough():
    front = front_of(*CHOICE)
    assert chosen(front, rule="threshold", alpha=0.05) == CHOICE[1]
    assert chosen(front, rule="threshold", alpha=0.1) == CHOICE[2]
    assert chosen(front, rule="threshold", alpha=0.9) == CHOICE[3]


def test_threshold_trusts_the_bound_that_judges_the_plan_and_not_the_papers():
    front = front_of((0.001, 0.0, 100.0), (0.0005, 0.0, 200.0), judged=0.2)
    with pytest.raises(InfeasibleError):
        choose_path(SelectionConfig(rule="threshold", alpha=0.1), front)


def test_a_threshold_that_nothing_keeps_says_what_could_be_kept():
    front = front_of(*CHOICE)
    with pytest.raises(InfeasibleError, match=r"f_o \+ R in independent winds .* = 0\.01;") as told:
        choose_path(SelectionConfig(rule="threshold", alpha=0.01), front)
    assert "the least risk is 2.0 %" in str(told.value)
    advised = re.search(r"set selection\.alpha=(\S+),", str(told.value))
    assert advised is not None
    choose_path(SelectionConfig(rule="threshold", alpha=float(advised[1])), front)


# --- rules over failure rates ---------------------------------------------------------------------------


def test_weighted_gives_the_failure_rate_the_weights_of_both_risks():
    front = flown_front((400.0, 200.0, 100.0), same_flights(20, 60, 400))
    assert chosen(front, rule="weighted", weights=[0.0, 0.0, 1.0])[2] == 100.0
    assert chosen(front, rule="weighted", weights=[0.5, 0.5, 0.0])[2] == 400.0
    for weights in ([9.0, 1.0, 1.0], [1.0, 9.0, 1.0]):  # 0.909 f + 0.091 length / 100
        assert chosen(front, rule="weighted", weights=weights)[2] == 200.0


def test_threshold_takes_the_shortest_whose_upper_limit_keeps_it():
    front = flown_front((400.0, 300.0, 200.0), same_flights(10, 20, 40))
    highs = [rate.high for rate in front.rates]
    for k, high in enumerate(highs):
        assert chosen(front, rule="threshold", alpha=high)[2] == 400.0 - 100.0 * k
        if k:
            assert chosen(front, rule="threshold", alpha=high - 1e-9)[2] == 500.0 - 100.0 * k
    assert front.rates[0].failure < highs[0]
    with pytest.raises(InfeasibleError, match=r"in coherent winds \(upper end of 95 %\)") as told:
        chosen(front, rule="threshold", alpha=front.rates[0].failure)
    advised = re.search(r"set selection\.alpha=(\S+),", str(told.value))
    assert advised is not None
    assert chosen(front, rule="threshold", alpha=float(advised[1]))[2] == 400.0


def knee_by_hand(rows):
    """The row farthest from the line through the safest and the shortest, on the side of the origin."""
    low, high = rows.min(axis=0), rows.max(axis=0)
    (x1, y1), (x2, y2) = (low[0], high[1]), (high[0], low[1])
    away = [((x2 - x1) * (y1 - y) - (x1 - x) * (y2 - y1)) / ((x2 - x1) * (y1 - y2)) for x, y in rows]
    return int(np.argmax(away))


@some
@given(st.lists(st.integers(0, 60), min_size=3, max_size=9, unique=True), st.randoms(use_true_random=False))
def test_the_knee_is_farthest_from_the_chord(counts, random):
    counts = sorted(counts)
    lengths = sorted(random.sample(range(100, 200), len(counts)), reverse=True)
    front = flown_front([float(m) for m in lengths], same_flights(*counts, runs=60))
    rows = np.column_stack([np.array(counts) / 60, lengths])
    found = chosen(front, rule="knee")[2]
    low, span = rows.min(axis=0), np.ptp(rows, axis=0)
    depth = {row[1]: 1 - ((row - low) / span).sum() for row in rows}
    assert depth[found] == pytest.approx(max(depth.values()))
    assert depth[float(lengths[knee_by_hand(rows)])] == pytest.approx(max(depth.values()))


def test_the_knee_of_a_curve_is_where_it_bends():
    front = flown_front((400.0, 210.0, 200.0, 199.0), same_flights(20, 25, 300, 990))
    assert chosen(front, rule="knee")[2] == 210.0
    assert chosen(front_of(*CHOICE), rule="knee") == CHOICE[2]  # by both bounds together: 0.09 at 150


def test_a_front_of_one_or_two_paths_has_no_knee_and_gives_the_safest():
    assert chosen(flown_front((4.0, 2.0), same_flights(20, 60)), rule="knee")[2] == 4.0
    assert chosen(flown_front((4.0,), same_flights(20)), rule="knee")[2] == 4.0
    assert chosen(front_of(CHOICE[0]), rule="knee") == CHOICE[0]


def test_length_takes_the_safest_that_is_short_enough():
    front = flown_front((400.0, 300.0, 200.0), same_flights(10, 20, 40))
    for limit, length in ((1e6, 400.0), (400.0, 400.0), (399.0, 300.0), (200.0, 200.0)):
        assert chosen(front, rule="length", length=limit)[2] == length
    assert chosen(front_of(*CHOICE), rule="length", length=250.0) == CHOICE[1]
    with pytest.raises(InfeasibleError, match=r"= 199.0 m; the shortest has 200.0 m") as told:
        chosen(front, rule="length", length=199.0)
    assert "set selection.length=200" in str(told.value)


def test_point_takes_the_path_of_that_number():
    front = flown_front((400.0, 300.0, 200.0), same_flights(10, 20, 40))
    assert [chosen(front, rule="point", point=k)[2] for k in range(3)] == [400.0, 300.0, 200.0]
    with pytest.raises(InfeasibleError, match=r"selection.point = 3: the front has 3 paths; expected 0 to 2"):
        chosen(front, rule="point", point=3)
    with pytest.raises(InfeasibleError, match=r"the front has 1 path; expected 0 "):
        chosen(front_of(CHOICE[0]), rule="point", point=1)


def test_a_rule_by_length_needs_a_length():
    with pytest.raises(ConfigError, match=r"selection.length is missing"):
        SelectionConfig(rule="length")


@pytest.mark.parametrize("number", [-1, 2, 0.0, None])
def test_a_rule_that_returns_no_number_of_a_path_is_refused(number, monkeypatch):
    monkeypatch.setitem(RULES, "knee", SelectionRule(lambda cfg, front: number))
    message = rf"selection\.rule=knee returned {number}, .* expected a number from 0 to 1"
    with pytest.raises(ConfigError, match=message):
        choose_path(SelectionConfig(rule="knee"), front_of((0.1, 0.0, 2.0), (0.2, 0.0, 1.0)))


def test_a_rule_may_return_a_number_of_numpy(monkeypatch):
    monkeypatch.setitem(RULES, "knee", SelectionRule(lambda cfg, front: np.int64(1)))
    front = front_of((0.1, 0.0, 2.0), (0.2, 0.0, 1.0))
    assert choose_path(SelectionConfig(rule="knee"), front) is front.paths[1]


def test_a_rule_says_which_settings_it_reads(monkeypatch):
    cfg = SelectionConfig(rule="threshold", alpha=0.02)
    assert selection_rule(cfg).settings_read(cfg) == {"alpha": 0.02}
    assert selection_rule(SelectionConfig(rule="knee")).settings_read(cfg) == {}
    monkeypatch.setitem(RULES, "knee", SelectionRule(lambda cfg, front: 0, reads=("bravery",)))
    with pytest.raises(
        ConfigError, match="reads 'bravery', no setting of selection; expected some of rule, "
    ):
        choose_path(SelectionConfig(rule="knee"), front_of((0.1, 0.0, 2.0)))


def test_options_that_no_rule_reads_are_refused():
    with pytest.raises(ConfigError, match=r"selection\.rule=knee reads none: remove hours, speed"):
        SelectionConfig(rule="knee", options={"hours": 3.0, "speed": 20})


@pytest.mark.parametrize(
    ("risk", "ordered", "warned"),
    [
        (0.0013, 0.361, True),
        (0.0, 0.0021, True),
        (0.01, 0.019, False),
        (1e-9, 1e-4, False),
        (0.3, 0.3, False),
    ],
)
def test_a_mission_risk_far_below_the_ordered_bound_is_a_warning(risk, ordered, warned):
    front = front_of((risk, 0.0, 2.0))
    path = front.paths[0]
    objectives = replace(path.objectives, mission_risk=risk, mission_risk_ordered=ordered)
    warning = bound_warning(replace(path, objectives=objectives), PAPER)
    assert (warning is not None) == warned
    if warned:
        assert "f_o of the plan" in warning
        assert "in independent winds" in warning
        assert "fidelity.mission_bound=ordered" in warning


# --- ties, further costs, and what a battery holds ------------------------------------------------


def costly_front(*rows, failed=None):
    """Paths (risk, length, energy), whose flights ``failed`` (P, n) judge them if given."""
    paths = []
    for risk, length, energy in rows:
        path = path_of(risk, 0.0, length)
        paths.append(
            replace(path, objectives=replace(path.objectives, costs={"length": length, "energy": energy}))
        )
    failed = np.zeros((0, 0), bool) if failed is None else np.asarray(failed, bool)
    rates = tuple(FailureRate.counted("coherent", int(row.sum()), failed.shape[1]) for row in failed)
    return Front(tuple(paths), (), 0.0, np.array([1.0, 1e3, 1e3]), rates, failed=failed)


def number_of(front, **how):
    path = choose_path(SelectionConfig(**how), front)
    return next(k for k, one in enumerate(front.paths) if one is path)


def test_of_equally_good_paths_the_shortest_is_taken_wherever_it_stands():
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        rows = [((0.01, 300.0, 5.0), (0.01, 200.0, 5.0), (0.01, 250.0, 5.0))[k] for k in order]
        front = costly_front(*rows)
        for how in (
            {"rule": "energy", "alpha": 0.01}, {"rule": "length", "length": 300.0},
            {"rule": "least", "least": "energy", "alpha": 0.5}, {"rule": "priority"},
        ):  # fmt: skip
            assert rows[number_of(front, **how)][1] == 200.0


def test_a_rule_keeps_to_its_limit_and_then_to_its_cost():
    front = costly_front((0.001, 300.0, 9.0), (0.02, 200.0, 4.0), (0.03, 100.0, 6.0))
    assert [number_of(front, rule="energy", alpha=a) for a in (0.001, 0.0199, 0.02, 0.9)] == [0, 0, 1, 1]
    assert [number_of(front, rule="least", least="length", alpha=a) for a in (0.02, 0.03)] == [1, 2]
    with pytest.raises(ConfigError, match=r"selection\.least=turns: the front has no such cost"):
        number_of(front, rule="least", least="turns")
    with pytest.raises(ConfigError, match="needs the power curve of the robot"):
        number_of(front_of(*CHOICE), rule="energy")


def test_the_knee_of_several_is_the_safest_of_them():
    """Paths on one line are all as far from the chord; rounding does not decide between them."""
    for lengths in ((300.0, 200.0, 100.0), (100.0, 200.0, 300.0)):
        front = flown_front(lengths, same_flights(*(10 * (4 - length / 100.0) for length in lengths)))
        assert chosen(front, rule="knee")[2] == 300.0
    front = flown_front((300.0, 250.0, 200.0, 100.0), same_flights(0, 100, 600, 1000))
    assert chosen(front, rule="knee")[2] == 250.0


def test_weights_reach_further_costs_and_one_too_many_is_refused():
    rows = ((0.1, 200.0, 20.0), (0.2, 100.0, 40.0), (0.3, 300.0, 10.0))
    front = costly_front(*rows)
    for weights, wanted in (
        ([1, 0, 0, 0], 0),
        ([0, 0, 1, 0], 1),
        ([0, 0, 0, 1], 2),
        ([0, 0, 1], 1),
        ([2, 2, 0, 1, 0], 2),
    ):
        assert number_of(front, rule="weighted", weights=[float(w) for w in weights]) == wanted
        sums = [w[0] * r[0] + w[2] * r[1] / 100 + w[3] * r[2] / 10 for r in rows for w in [[*weights, 0, 0]]]
        assert sums[wanted] == min(sums)
    with pytest.raises(ConfigError, match=r"has 5 numbers, and the front has 2 costs .* at most 4 numbers"):
        number_of(front, rule="weighted", weights=[1.0, 0.0, 0.0, 0.0, 0.1])
    flown = costly_front(*rows, failed=same_flights(100, 200, 300))
    for weights, wanted in (
        ([1, 1, 0, 0], 0),
        ([0, 0, 1, 0], 1),
        ([0, 0, 0, 1], 2),
        ([3, 2, 0.3, 0], 0),
        ([1, 0, 0.3, 0], 1),
    ):
        assert number_of(flown, rule="weighted", weights=[float(w) for w in weights]) == wanted


def test_a_cost_that_a_path_does_not_have_is_compared_as_it_is():
    front = costly_front((0.1, 200.0, 0.0), (0.1, 100.0, 0.5), (0.1, 150.0, 3.0))
    assert number_of(front, rule="weighted", weights=[0.0, 0.0, 1.0, 1.0]) == 1  # 2, 1.5, 4.5
    assert number_of(front, rule="weighted", weights=[0.0, 0.0, 1.0, 3.0]) == 0  # 2, 2.5, 10.5


@pytest.mark.parametrize(("capacity", "kept"), [(None, 3), (9.0, 3), (8.9, 2), (4.0, 1)])
def test_paths_that_need_more_than_the_battery_holds_are_left_out(capacity, kept, caplog):
    front = costly_front(
        (0.1, 3.0, 9.0), (0.2, 2.0, 6.0), (0.3, 1.0, 4.0), failed=same_flights(100, 200, 300)
    )
    problem = SimpleNamespace(energy=SimpleNamespace(capacity=capacity))
    found = within_capacity(SelectionConfig(rule="knee"), front, problem)
    assert found.paths == front.paths[3 - kept :]
    assert found.rates == front.rates[3 - kept :]
    np.testing.assert_array_equal(found.failed, front.failed[3 - kept :])
    assert within_capacity(SelectionConfig(rule="point", point=0), front, problem) is front
    told = [record.getMessage() for record in caplog.records]
    assert len(told) == (kept < 3)
    assert all(text.startswith(f"{3 - kept} of 3 paths of the front need more than") for text in told)


def test_a_battery_that_holds_no_path_is_named_and_a_robot_without_one_keeps_all(monkeypatch):
    monkeypatch.setattr("pareto_ltl.planning.shortest_mission.capacity_advice", lambda *_: "fly less")
    front = costly_front((0.1, 3.0, 7200.0), (0.2, 2.0, 3600.0))
    cfg, problem = SelectionConfig(rule="knee"), SimpleNamespace(energy=SimpleNamespace(capacity=1800.0))
    with pytest.raises(InfeasibleError, match=r"the least is 1 Wh.*: fly less"):
        within_capacity(cfg, front, problem)
    assert within_capacity(cfg, front, SimpleNamespace(energy=None)) is front
    bounds = replace(front, failed=np.zeros((0, 0), bool))
    problem.energy.capacity = 3600.0
    assert within_capacity(cfg, bounds, problem).paths == front.paths[1:]
    assert within_capacity(cfg, bounds, problem).rates == ()


def test_the_safest_of_a_front_is_of_equal_ones_the_shortest_with_its_own_hypervolume():
    rows = ((0.5, 3.0, 9.0), (0.5, 2.0, 6.0), (0.5, 1.0, 4.0))
    front = costly_front(*rows, failed=same_flights(100, 100, 300))
    safest = safest_of_front(front)
    assert safest.paths == (front.paths[1],)
    assert safest.rates == (front.rates[1],)
    shares = 1.0 - np.array([0.1, 2.0, 6.0]) / front.reference
    assert safest.hypervolume == pytest.approx(np.prod(shares))


@pytest.mark.parametrize(("risk", "advised"), [(0.3, True), (0.55, False)])
def test_a_limit_of_one_or_more_is_not_advised(risk, advised):
    """The sum of both bounds, twice ``risk``, can be more than 1."""
    front = front_of((risk, risk, 2.0))
    with pytest.raises(InfeasibleError) as told:
        choose_path(SelectionConfig(rule="threshold", alpha=0.1), front)
    assert ("set selection.alpha=" in str(told.value)) == advised


def test_a_length_below_one_has_the_shortest_path_as_its_unit():
    """Lengths of 0.5 and 0.8 are 1 and 1.6: 0.6 of weight 0.4 outweighs 0.2 of the risk."""
    front = front_of((0.3, 0.0, 0.5), (0.0, 0.0, 0.8))
    assert chosen(front, rule="weighted", weights=[0.5, 0.0, 0.5])[2] == 0.5
    assert chosen(front, rule="weighted", weights=[0.7, 0.0, 0.3])[2] == 0.8


def test_a_length_of_zero_is_no_unit():
    front = front_of((0.3, 0.0, 0.0), (0.0, 0.0, 0.4))
    assert chosen(front, rule="weighted", weights=[0.5, 0.0, 0.5])[2] == 0.0
    assert chosen(front, rule="weighted", weights=[0.6, 0.0, 0.4])[2] == 0.4
