"""A trunk that is bent for its branches: what bumps move, what is retained, and by which flights."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

from coherent import STEPS, coherent_problem
from pareto_ltl import Run, Settings
from pareto_ltl.extend import BranchFix, Cell, Problem, RobotConfig, evaluate_path
from pareto_ltl.support.arrays import length_of
from pareto_ltl_apps.branching import stage
from pareto_ltl_apps.branching.bending import bent_tree, bumps, within_airspeeds
from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.branching.tree_flights import TreeFlights, whole_controls
from pareto_ltl_apps.branching.tree_search import SLOWER, Grower, Stem, Tree, expected_means

STEP, INF = 15, float("inf")
ROBOT = RobotConfig(dt=100.0, u_min=2.0, u_max=20.0, start_sd=50.0)
HALVES = (Cell(left=(0.0, INF)), Cell(left=(-INF, 0.0)))


@pytest.fixture(scope="module")
def detour() -> tuple[Grower, Any, Tree]:
    """A trunk with a detour of 1.5 km before its fix, and the tree on it whose branches go on as planned."""
    problem = coherent_problem(robot=ROBOT)
    t = np.arange(len(STEPS))
    aside = 1500.0 * np.clip(1.0 - np.abs(t - 8) / 7.0, 0.0, None)
    x = STEPS + aside[:, None] * np.array([-0.7, 0.7])
    path = evaluate_path(problem, x, "path 3", tight=False)
    ahead = x[STEP] - x[STEP - 1]
    fix = BranchFix(STEP, path.x[STEP], ahead / np.hypot(*ahead), 100.0)
    settings = Settings(robot=ROBOT).with_sections(BranchConfig(leaves=2, at=[0.4]))
    flights = (TreeFlights.drawn(problem, 600, SeedSequence(seed)) for seed in (1, 2))
    grower = Grower(Run(settings, {"problem": problem}), *flights, 2)
    stem, rests = Stem.trunk(path), [path.u[STEP:]]
    table = grower.table(stem, fix, rests)
    divisions = (grower.of_cells(table, (Cell(),)), grower.of_cells(table, HALVES))
    return grower, path, Tree(stem, fix, tuple(rests), divisions, table, divisions[0], divisions[0])


def test_bumps_move_neither_the_departure_nor_the_end(detour: Any) -> None:
    _, path, _ = detour
    found = list(bumps(path, STEP, 0.5))
    assert len(found) == 8
    for off in found:
        assert (off[0] == 0.0).all()
        assert np.hypot(*off[-1]) == pytest.approx(0.0, abs=1e-9)
        assert len(off) < len(path.x)
        assert np.abs(off).max() > 1.0
    largest = [int(np.hypot(*off.T).argmax()) for off in found]
    assert max(largest) == STEP
    for off, k, way in zip(found, np.repeat([4, 8, 11, 15], 2), "lalalala", strict=True):
        ahead = path.x[k] - path.x[k - 1]
        ahead = ahead / np.hypot(*ahead)
        way_of = np.array([-ahead[1], ahead[0]]) if way == "l" else ahead  # left of the track, or along it
        peak = off[np.hypot(*off.T).argmax()]
        np.testing.assert_allclose(peak / np.hypot(*peak), way_of, atol=1e-9)
    reach = 0.5 * np.sqrt(np.linalg.eigvalsh(path.cov[STEP])[-1])
    assert np.hypot(*found[-1][STEP]) == pytest.approx(reach)


def test_airspeeds_are_within_their_limits_and_keep_their_directions(detour: Any) -> None:
    grower, _, _ = detour
    u = np.array([[30.0, 40.0], [0.3, -0.4], [6.0, 8.0]])
    found = within_airspeeds(grower, u)
    assert np.hypot(*found.T) == pytest.approx([20.0, 2.0, 10.0])
    assert np.arctan2(*found.T) == pytest.approx(np.arctan2(*u.T))


def test_bending_takes_a_detour_out_of_a_trunk(detour: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tree is shorter and fails no more in flights that the bend was not fitted to."""
    grower, path, tree = detour
    monkeypatch.setattr(Grower, "grown", lambda self, tree, rounds: tree)  # no search of other rests
    cells = {1: (Cell(),), 2: HALVES}
    monkeypatch.setattr(Grower, "divided", lambda self, table, number: self.of_cells(table, cells[number]))
    found = bent_tree(grower, path, tree, 2)
    assert found is not None
    bent, better = found
    assert bent.origin == "path 3, bent for its branches"
    assert length_of(bent.x) < length_of(path.x) - 100.0
    assert better.divisions[1].length < tree.divisions[1].length
    assert grower.score(better.divisions[1].failure, better.divisions[1].length) < grower.score(
        tree.divisions[1].failure, tree.divisions[1].length
    )
    assert (better.fix.place == bent.x[STEP]).all()  # the cells have moved with the planned position
    assert np.hypot(*bent.u.T).max() <= ROBOT.u_max * (1 + 1e-6)


def test_a_trunk_that_does_not_fail_less_is_not_taken(detour: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    grower, path, tree = detour
    other = evaluate_path(grower.problem, path.x, "path 3, bent for its branches", tight=False)
    monkeypatch.setattr(stage, "bent_tree", lambda *_: (other, tree))
    kept = stage.bent_if_better(grower, path, tree, 2, 500, SeedSequence(4))
    assert kept[0] is path
    assert kept[1] is tree


def test_trees_that_are_compared_meet_the_same_winds(detour: Any) -> None:
    """Two flights of one tree with one random stream are the same, also if the stream was used before."""
    grower, path, tree = detour
    branching, seeds = stage.drafted(grower.problem, stage.Grown(tree, 2)), SeedSequence(4)
    once, again = (stage.fly_tree(grower.problem, path, branching, 500, seeds) for _ in range(2))
    assert 0.0 < once.failed.mean() < 1.0
    np.testing.assert_array_equal(once.failed, again.failed)
    np.testing.assert_array_equal(once.branch, again.branch)


def test_the_outlook_of_a_trunk_is_lower_than_its_failure_without_a_fix(detour: Any) -> None:
    """Flights that return to the path fail less, and a fix that tells nothing lets none return better."""
    grower, path, tree = detour
    alone = float(grower.fitted.failed(path.u).mean())
    assert alone > 0.02
    told = stage.outlook(grower, path, tree.fix)
    blind = stage.outlook(grower, path, replace(tree.fix, sd=1e6))
    assert told < alone - 0.01
    assert told < blind <= alone
    assert stage.outlook(grower, path, replace(tree.fix, available=0.0)) == alone


def test_slower_rests_have_the_same_positions_and_leave_airspeed(
    detour: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    grower, path, tree = detour
    stem, rest = tree.stem, path.u[STEP:]
    found = grower.slower_rests(stem, tree.fix, Cell(), rest)
    assert [len(one) for one in found] == [math.ceil(f * len(rest)) for f in SLOWER[: len(found)]]
    assert found
    for one in found:
        x = expected_means(grower.problem, whole_controls(path.u, STEP, one))
        k = np.linspace(STEP, len(path.x) - 1, len(one) + 1)
        same = np.stack([np.interp(k, np.arange(len(path.x)), part) for part in path.x.T], axis=1)
        assert x[STEP:] == pytest.approx(same, abs=1.0)  # [m]
    fast = np.hypot(*rest.T).max()
    assert all(np.hypot(*one.T).max() < fast for one in found)
    monkeypatch.setattr(Problem, "horizon", len(path.u) + 1)
    assert grower.slower_rests(stem, tree.fix, Cell(), rest) == []


def test_the_way_to_use_a_fix_is_the_one_that_fails_least(detour: Any) -> None:
    """With and without a counter to the drift; nothing is flown off if it does not pay."""
    grower, path, tree = detour
    alone = int(grower.fitted.failed(path.u).sum())
    plain, countered = grower.rejoining(tree.stem, tree.fix)
    assert plain.counter == 0.0 < countered.counter <= 1.0 / (STEP * ROBOT.dt) * (1 + 1e-9)
    y, taken = grower.fitted.measured_along(path.u, tree.fix)
    assert plain.rejoin > 0
    assert int(grower.fitted.after(plain, y, taken).failed(path.u).sum()) < alone
    assert grower.rejoining(tree.stem, replace(tree.fix, sd=1e6))[0].rejoin == 0
    settings = grower.run.settings.with_sections(BranchConfig(leaves=2, at=[0.4], rejoin=False))
    other = replace(grower, run=grower.run.with_settings(settings))
    assert other.rejoining(tree.stem, tree.fix) == [tree.fix]


def test_a_tree_on_another_path_must_be_surely_better(detour: Any) -> None:
    grower, _, tree = detour
    few = tree.divisions[0].failed.copy()
    few[np.flatnonzero(few)[:2]] = False
    none = np.zeros_like(few)

    def on_another(failed: np.ndarray) -> Tree:
        return replace(tree, point=3, divisions=(replace(tree.divisions[0], failed=failed),))

    assert grower.best_score(on_another(few)) < grower.best_score(tree)
    assert grower.best_of([tree, on_another(few)]) is tree
    assert grower.best_of([tree, on_another(none)]).point == 3
    assert grower.gain(on_another(none), tree) > 2.0 > grower.gain(on_another(few), tree) > 0.0


def test_a_second_time_is_tried_as_the_first_fix_only_if_the_first_does_not_pay(
    detour: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    grower, path, tree = detour
    later = replace(tree.fix, step=STEP + 4)
    front: Any = SimpleNamespace(paths=(path,))
    begun: list[int] = []

    def begin(_: Grower, stem: Stem, fix: BranchFix) -> Tree:
        begun.append(fix.step)
        return replace(tree, stem=stem, fix=fix)

    monkeypatch.setattr(Grower, "begun", begin)
    monkeypatch.setattr(Grower, "grown", lambda self, tree: tree)
    for pays, steps in ((2, [STEP]), (0, [STEP, STEP + 4])):
        begun.clear()
        monkeypatch.setattr(stage, "worthwhile_leaves", lambda _, pays=pays: pays)
        found, number = stage.best_tree(grower, front, [(0, tree.fix), (0, later)], 2)
        assert (begun, number, found.fix.step) == (steps, pays, STEP)
