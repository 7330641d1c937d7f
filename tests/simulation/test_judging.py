"""The front by flights, and what fresh flights promise of the path that is picked from it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.stats import fisher_exact

from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.rates import WEIGHTED, FailureRate
from pareto_ltl.planning.records import Objectives, PlannedPath
from pareto_ltl.planning.smoothing import smooth_paths
from pareto_ltl.settings import PlannerConfig, RobotConfig, SelectionConfig, SmoothingConfig, preset
from pareto_ltl.simulation import judging
from pareto_ltl.simulation import promise as promises
from pareto_ltl.simulation.flights import block_rows
from pareto_ltl.simulation.judging import (
    Flown,
    certainly_beaten,
    fly_race,
    judge_front,
    looks,
    outermost,
    unbeaten,
)
from pareto_ltl.simulation.promise import DOUBT, LINEAR, claim_stands, promise_path
from problems import KM, box, make_problem, make_scene, smooth_wind

PLANNER = PlannerConfig(trees=4, n_max=600)
SCENE = make_scene(
    {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)},
    [box(7, 0.5, 9, 6), box(10, 10, 14, 13)],
    start=(2.0, 3.0),
)
DRAWS = 1500
COSTS = Objectives({"length": 1.0}, 0.5, 0.5, 0.5, 0.5)


@pytest.fixture(scope="module")
def wind():
    return smooth_wind(SCENE, speed=2.0, sd=0.25, gust=0.3)


@pytest.fixture(scope="module")
def task(wind):
    robot = RobotConfig(dt=100.0, u_max=10.0)
    return make_problem("F(a & F b)", SCENE, wind, robot, PLANNER, fidelity="full")


@pytest.fixture(scope="module")
def given_paths(task):
    """Paths of the trees, and smoothed ones."""
    forest = growth.grow_forest(PLANNER, task, SeedSequence(1))
    raw = selection.unlike_paths(task, forest)
    return raw, smooth_paths(SmoothingConfig(candidates=2), task, raw)


@pytest.fixture(scope="module")
def front(task, given_paths):
    raw, refined = given_paths
    return judge_front(task, refined, raw, DRAWS, SeedSequence(3))


def rate_and_length(front):
    return [(r.failure, p.objectives.length) for r, p in zip(front.rates, front.paths, strict=True)]


# --- the front --------------------------------------------------------------------------------


def test_the_front_is_what_flights_of_all_paths_one_by_one_leave(task, given_paths, front):
    """No bound plays a part, and the race drops no path of the front."""
    raw, refined = given_paths
    rows = {}
    for path in (*refined, *raw):
        flown = simulate_flights(task, path.u, DRAWS, "coherent", SeedSequence(3), path.x)
        rows[path.origin] = (float(flown.failed.mean()), path.objectives.length)
    best = {
        name for name, (failure, length) in rows.items()
        if not any(f <= failure and m <= length and (f, m) != (failure, length) for f, m in rows.values())
    }  # fmt: skip
    assert {path.origin for path in front.paths} == best
    assert rate_and_length(front) == [rows[path.origin] for path in front.paths]
    assert rate_and_length(front) == sorted(rate_and_length(front))
    assert len(front.paths) > 1
    assert front.models.judge == "flights"


def test_a_path_that_alone_keeps_epsilon_is_the_front_though_others_beat_it(monkeypatch, task, given_paths):
    """The race of the trees may have dropped it."""
    raw, _ = given_paths
    left = {id(flown.path) for flown in fly_race(task, raw, 600, SeedSequence(3), judging.CROWD)}
    beaten = next(path for path in raw if id(path) not in left)
    monkeypatch.setattr(judging, "keeps_epsilon", lambda _, path: path is beaten)
    front = judge_front(task, (), raw, DRAWS, SeedSequence(3))
    assert [path.origin for path in front.paths] == [beaten.origin]


def test_rates_are_counts_of_the_flights_that_the_front_keeps(front):
    for rate, failed in zip(front.rates, front.failed, strict=True):
        assert (rate.failures, rate.runs, rate.law, rate.method) == (
            failed.sum(),
            DRAWS,
            "coherent",
            "flights",
        )
        assert rate == FailureRate.counted("coherent", int(failed.sum()), DRAWS)


def test_a_path_that_a_bound_rules_out_may_be_on_the_front(task, given_paths, wind):
    """With a delta that allows no collision at all, bounds leave no path, and flights the same front."""
    raw, refined = given_paths
    strict = replace(task, world=replace_delta(task.world, 1e-12))
    assert any(path.objectives.collision_risk > 1e-12 for path in raw)
    front = judge_front(strict, refined, raw, 500, SeedSequence(3))
    free = judge_front(task, refined, raw, 500, SeedSequence(3))
    assert rate_and_length(front) == rate_and_length(free)


def replace_delta(world, delta):
    return world._replace(collision=world.collision._replace(delta=delta))


def test_the_reference_of_the_hypervolume_has_two_sides(given_paths, front):
    raw, refined = given_paths
    longest = max(path.objectives.length for path in (*raw, *refined))
    np.testing.assert_array_equal(front.reference, [1.0, 2.0 * longest])
    area, height = 0.0, 1.0
    for failure, length in sorted(rate_and_length(front)):  # steps from the safest to the shortest
        area += (1.0 - failure) * (height - length / front.reference[1])
        height = length / front.reference[1]
    assert front.hypervolume == pytest.approx(area)


def test_the_front_of_the_trees_is_kept_beside(task, given_paths, front):
    raw, _ = given_paths
    free = replace(task, epsilon=1.0)
    alone = judge_front(free, (), raw, judging.RAW_DRAWS, SeedSequence(3))
    assert len(alone.paths) > 1
    assert front.raw == tuple(path.objectives for path in alone.paths)
    assert front.raw_rates == alone.rates


def test_paths_of_trees_come_with_their_final_bound(task, front, given_paths):
    for path in judge_front(task, (), given_paths[0], 250, SeedSequence(3)).paths:
        assert path.objectives == evaluate_path(task, path.x, path.origin).objectives


def test_the_law_is_that_of_the_planner(wind):
    robot = RobotConfig(dt=100.0, u_max=10.0)
    task = make_problem(
        "F(a & F b)", SCENE, wind, robot, PLANNER, fidelity=replace(preset("paper"), judge="flights")
    )
    forest = growth.grow_forest(PLANNER, task, SeedSequence(1))
    front = judge_front(task, (), selection.unlike_paths(task, forest), 300, SeedSequence(3))
    for path, failed in zip(front.paths, front.failed, strict=True):
        flown = simulate_flights(task, path.u, 300, "independent", SeedSequence(3), path.x)
        np.testing.assert_array_equal(flown.failed, failed)
    assert {rate.law for rate in front.rates} == {"independent"}


def test_the_flights_of_a_block_do_not_depend_on_which_paths_are_flown(task, given_paths):
    raw, _ = given_paths
    among = fly_race(task, raw, 600, SeedSequence(8), judging.CROWD)
    assert 1 < len(among) < len(raw)  # the race has dropped some
    for flown in among[:3]:
        (alone,) = fly_race(task, [flown.path], 600, SeedSequence(8))
        np.testing.assert_array_equal(alone.failed, flown.failed)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=12))
def test_the_unbeaten_are_those_that_no_other_path_beats(table):
    some_path = PlannedPath(*[np.zeros(1)] * 4, (frozenset(),), np.zeros((0, 2)), COSTS, "")
    flown = [
        Flown(
            replace(some_path, objectives=replace(COSTS, costs={"length": float(length)})),
            np.arange(5) < count,
        )
        for count, length in table
    ]
    kept = [one.row for one in unbeaten(flown)]
    rows = {one.row for one in flown}
    best = {r for r in rows if not any(o[0] <= r[0] and o[1] <= r[1] and o != r for o in rows)}
    assert kept == sorted(best)  # of equal ones, one


# --- the race ---------------------------------------------------------------------------------


def test_flights_double_from_look_to_look():
    assert looks(1) == [range(1)]
    assert looks(6) == [range(1), range(1, 2), range(2, 4), range(4, 6)]
    assert list(itertools.chain(*looks(16))) == list(range(16))


def test_a_path_is_dropped_where_a_shorter_one_is_safer_beyond_chance():
    """13 more failures and none fewer: a chance of 2^-13 = 1.2e-4. 14: 0.6e-4, below 1e-4."""
    failed = np.arange(500) < np.array([20, 33, 34, 400])[:, None]
    assert certainly_beaten(failed, np.array([[1.0], [2.0], [3.0], [0.5]])).tolist() == [
        False,
        False,
        True,
        False,
    ]


def slowly_safer(_problem, paths, runs, _seed):
    """A race of many paths: path k is k + 1 long, and its flights fail with probability 0.02 / (k + 1)."""
    blocks = block_rows(runs)
    failed = np.random.default_rng(4).random((runs, 1)) < 0.02 / (1.0 + np.arange(len(paths)))
    return blocks, lambda number, running: failed[blocks[number]][:, running].T


def test_refined_paths_that_rarely_fail_stay_among_many(monkeypatch, task, given_paths):
    """After 250 flights most have no failure, and the shortest of those seems to beat all that are longer."""
    paths = [
        replace(given_paths[1][0], objectives=replace(COSTS, costs={"length": 1.0 + k}))
        for k in range(4 * judging.CROWD)
    ]
    monkeypatch.setattr(judging, "race_of", slowly_safer)
    flown = fly_race(task, paths, 20_000, SeedSequence(8))
    assert [one.path.objectives.length for one in flown] == [1.0 + k for k in range(len(paths))]
    assert len(fly_race(task, paths, 20_000, SeedSequence(8), judging.CROWD)) < len(paths)


def test_a_race_ends_when_every_path_that_is_left_has_failed_often_enough(monkeypatch, task, given_paths):
    """Its flights are the first of a race without such an end; rare failures need all of them."""
    often = (0.4, 0.3, 0.25)

    def failing(rates):
        def made(_problem, paths, runs, _seed):
            blocks = block_rows(runs)
            failed = np.random.default_rng(4).random((runs, 1)) < np.array(rates)
            return blocks, lambda number, running: failed[blocks[number]][:, running].T

        return made

    paths = [
        replace(given_paths[1][0], objectives=replace(COSTS, costs={"length": 1.0 + k})) for k in range(3)
    ]
    for rates, ended in ((often, 1000), ((0.4, 0.3, 0.06), 4000), ((0.4, 0.3, 1e-4), 16_000)):
        monkeypatch.setattr(judging, "race_of", failing(rates))
        race = judging.race_among(task, paths, 16_000, SeedSequence(8), enough=judging.ENOUGH)
        whole = judging.race_among(task, paths, 16_000, SeedSequence(8))
        assert [len(one.failed) for one in race.flown] == [ended] * 3
        assert race.rows[:, 0].tolist() == [ended] * 3
        for one, all_of in zip(race.flown, whole.flown, strict=True):
            np.testing.assert_array_equal(one.failed, all_of.failed[:ended])
        if ended < 16_000:
            assert min(one.failed.sum() for one in race.flown) >= judging.ENOUGH


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), min_size=1, max_size=90))
def test_of_a_crowd_the_front_stays_and_nothing_that_is_behind_what_goes(table):
    rows = np.array(table, float)
    stays = outermost(rows[:, 0], rows[:, 1:], judging.CROWD)
    beaten = [any((o <= r).all() and (o < r).any() for o in rows) for r in rows]
    assert all(stays[k] for k in range(len(rows)) if not beaten[k])
    assert stays.sum() <= max(judging.CROWD, len(rows) - sum(beaten))
    assert stays.all() or len(rows) > judging.CROWD
    for gone in rows[~stays]:  # whoever beats a path that stays, stays
        assert not any((gone <= r).all() and (gone < r).any() for r in rows[stays])


@pytest.mark.statistical
def test_equally_safe_paths_seldom_drop_each_other():
    """Of 2,000 races of two paths that fail alike, with a chance of 1e-4 at each of 4 looks, hardly any."""
    rng = np.random.default_rng(0)
    dropped = 0
    for _ in range(2000):
        failed = rng.random((2, 2000)) < 0.1
        dropped += any(
            certainly_beaten(failed[:, :n], np.array([[1.0], [2.0]])).any() for n in (250, 500, 1000, 2000)
        )
    assert dropped <= 8  # expected at most 0.8: more than 8 by chance in less than one of 1e6


def test_nothing_to_judge_is_said(task):
    with pytest.raises(judging.InfeasibleError, match="no path completes the mission"):
        judge_front(task, (), (), 100, SeedSequence(0))


# --- the promise ------------------------------------------------------------------------------


@pytest.mark.statistical
def test_a_promise_is_the_rate_of_fresh_flights(task, wind, front):
    cfg = SelectionConfig(runs=4000)
    path, promise = promise_path(cfg, task, wind, front, SeedSequence(5))
    k = next(k for k, other in enumerate(front.paths) if other is path)
    assert promise.claimed == front.rates[k]
    flown = simulate_flights(task, path.u, 4000, "coherent", SeedSequence(5), path.x)
    assert promise.rate == FailureRate.counted("coherent", int(flown.failed.sum()), 4000)
    assert promise.passed
    assert promise.bound == min(1.0, path.objectives.mission_risk + path.objectives.collision_risk)
    assert 0.0 < promise.linearity < LINEAR


def test_a_path_whose_claim_is_too_good_is_passed_over(task, wind, front, caplog):
    """The safest path of the front gets a claim that no flight fails, and the controls of a wreck."""
    wreck = replace(front.paths[0], u=np.zeros_like(front.paths[0].u))
    failed = front.failed.copy()
    failed[0] = False
    liar = replace(
        front, paths=(wreck, *front.paths[1:]), failed=failed,
        rates=(FailureRate.counted("coherent", 0, DRAWS), *front.rates[1:]),
    )  # fmt: skip
    path, promise = promise_path(SelectionConfig(runs=500), task, wind, liar, SeedSequence(5))
    assert path is not wreck
    assert promise.passed
    assert (
        "100 % (95 %: 99.26 to 100 %) of 500 flights in coherent winds fail, more than the 0 %" in caplog.text
    )
    assert "of 1,500 flights that judged the front; the rule's next choice is tried" in caplog.text


def test_where_every_claim_falls_the_plan_says_so(task, wind, front):
    claims = tuple(FailureRate.counted("coherent", 0, 10**6) for _ in front.rates)
    liar = replace(front, rates=claims, failed=np.zeros_like(front.failed))
    path, promise = promise_path(SelectionConfig(runs=2000), task, wind, liar, SeedSequence(5))
    assert not promise.passed
    rates = {
        id(p): simulate_flights(task, p.u, 2000, "coherent", SeedSequence(5), p.x).failed.mean()
        for p in front.paths
    }
    assert rates[id(path)] == min(rates.values())


def test_a_path_that_the_user_names_is_flown_even_if_its_claim_falls(task, wind, front, caplog):
    claims = tuple(FailureRate.counted("coherent", 0, 10**6) for _ in front.rates)
    liar = replace(front, rates=claims, failed=np.zeros_like(front.failed))
    cfg = SelectionConfig(rule="point", point=len(front.paths) - 1, runs=500)
    path, promise = promise_path(cfg, task, wind, liar, SeedSequence(5))
    assert path is front.paths[-1]
    assert not promise.passed
    assert "the plan keeps it" in caplog.text


def test_a_threshold_holds_for_the_promise_and_not_for_the_claim_alone(
    task, wind, front, caplog, monkeypatch
):
    """An honest claim of 1,500 flights; of as few as 100, the upper end is above it, however few fail."""
    monkeypatch.setattr(promises, "RARE", 0.0)  # weighted flights would have a narrower interval
    alpha = front.rates[0].high
    cfg = SelectionConfig(rule="threshold", alpha=alpha, runs=100)
    path, promise = promise_path(cfg, task, wind, front, SeedSequence(5))
    assert path is front.paths[0]
    assert promise.passed
    assert promise.rate.high > alpha
    assert f"is above selection.alpha = {alpha:g}; the rule's next choice is tried" in caplog.text
    many = replace(cfg, alpha=1.05 * alpha, runs=20_000)
    assert promise_path(many, task, wind, front, SeedSequence(5))[1].rate.high <= many.alpha


@pytest.mark.statistical
def test_a_rare_failure_is_promised_from_weighted_flights(task, wind, front, monkeypatch):
    """With every failure called rare: the rate agrees with plain flights to 5.3 standard errors."""
    monkeypatch.setattr(promises, "RARE", 1.0)
    path, promise = promise_path(SelectionConfig(runs=4000), task, wind, front, SeedSequence(5))
    assert promise.rate.method == WEIGHTED
    assert promise.rate.sample == "4,000 weighted flights"
    assert promise.passed
    runs = 40_000
    plain = simulate_flights(task, path.u, runs, "coherent", SeedSequence(11), path.x).failed.mean()
    error = (promise.rate.high - promise.rate.low) / 3.92
    assert abs(promise.rate.failure - plain) < 5.3 * np.hypot(error, np.sqrt(plain * (1 - plain) / runs))


def test_weighted_flights_overturn_a_claim_that_they_make_impossible():
    """No failure among 4,000: a chance of exp(-6.9) = 1e-3 at a rate of 0.00173."""
    claim = FailureRate.counted("coherent", 0, 4000)
    assert claim_stands(FailureRate("coherent", 0.002, 0.0017, 0.0023, 100, WEIGHTED), claim)
    assert not claim_stands(FailureRate("coherent", 0.002, 0.0018, 0.0022, 100, WEIGHTED), claim)


def test_an_unreliable_linearisation_is_said(task, front, caplog):
    wind = smooth_wind(SCENE, length=1.0 * KM)
    promise_path(SelectionConfig(runs=50), task, wind, front, SeedSequence(5))
    assert "length scale" in caplog.text


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 60), st.integers(0, 60), st.integers(60, 400), st.integers(60, 400))
def test_claims_fall_by_fishers_exact_test(fresh, claimed, runs, draws):
    table = [[fresh, runs - fresh], [claimed, draws - claimed]]
    chance = float(fisher_exact(table, alternative="greater").pvalue)
    stands = claim_stands(
        FailureRate.counted("coherent", fresh, runs), FailureRate.counted("coherent", claimed, draws)
    )
    assert stands == (chance >= DOUBT) or chance == pytest.approx(DOUBT, rel=1e-9)


def test_the_test_of_a_claim_has_power():
    """A path that fails four times as often as it claims, 4 % and not 1 %, falls in every case."""
    rng = np.random.default_rng(1)
    claims = rng.binomial(4000, 0.01, 200)
    fresh = rng.binomial(20_000, 0.04, 200)
    honest = rng.binomial(20_000, 0.01, 200)
    assert not any(
        claim_stands(
            FailureRate.counted("coherent", int(f), 20_000), FailureRate.counted("coherent", int(c), 4000)
        )
        for f, c in zip(fresh, claims, strict=True)
    )
    fallen = [
        not claim_stands(
            FailureRate.counted("coherent", int(f), 20_000), FailureRate.counted("coherent", int(c), 4000)
        )
        for f, c in zip(honest, claims, strict=True)
    ]
    assert sum(fallen) <= 4  # 0.2 expected
