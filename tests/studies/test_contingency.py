"""The part of the gain of new plans that branches have."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pareto_ltl import Settings
from pareto_ltl.extend import Branch, BranchFix, Branching, Cell
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import Objectives, PlannedPath
from pareto_ltl_apps.studies.replanning import Way, branch_controls, contingency


def flights(*failed: int) -> list[np.ndarray]:
    """For each number, 400 flights of which so many fail, the first ones."""
    return [np.arange(400) < number for number in failed]


def test_branches_that_are_new_plans_have_the_whole_gain() -> None:
    alone, told = flights(80, 20)
    assert contingency(alone, told, told) == pytest.approx((1.0, 1.0, 1.0))


def test_branches_that_save_nothing_have_no_part() -> None:
    alone, replanned = flights(80, 20)
    assert contingency(alone, alone, replanned) == pytest.approx((0.0, 0.0, 0.0))


def test_the_interval_is_that_of_the_share_of_saved_flights() -> None:
    """Of 60 saved flights branches save 45: a binomial share of 3/4, within 15 % of its normal interval."""
    alone, branched, replanned = flights(80, 35, 20)
    middle, low, high = contingency(alone, branched, replanned)
    assert middle == pytest.approx(0.75)
    half = 1.96 * math.sqrt(0.75 * 0.25 / 60)
    assert middle - low == pytest.approx(half, rel=0.15)
    assert high - middle == pytest.approx(half, rel=0.15)


def test_without_a_gain_there_is_no_part() -> None:
    alone, branched, worse = flights(20, 10, 40)
    assert all(math.isnan(part) for part in contingency(alone, branched, worse))


def rest(steps: int, begin: int, heading: float) -> PlannedPath:
    """``steps`` steps of 10 m/s from step ``begin`` on."""
    u = np.tile([10.0 * math.cos(heading), 10.0 * math.sin(heading)], (steps, 1))
    x = np.vstack([np.zeros(2), np.cumsum(u, axis=0)])
    n, nan = len(x), math.nan
    costs = Objectives({"length": 10.0 * steps}, nan, nan, nan, nan)
    return PlannedPath(
        np.arange(begin, begin + n, dtype=float), x, np.zeros((n, 2, 2)), np.zeros(n, np.int64),
        (frozenset(),) * n, u, costs, "", order="",
    )  # fmt: skip


def tree_of(step: int, steps: int, first: str, then: Branching | None = None) -> Branching:
    """Left and right of the origin; branch ``first``1 goes on with ``then``."""
    rate, inf = FailureRate("coherent", 0.1, 0.0, 0.2, 10), math.inf
    log: Any = None
    cells = Cell(left=(0.0, inf)), Cell(left=(-inf, 0.0))
    branches = tuple(
        Branch(f"{first}{k}", cell, 0.5, rest(steps - step, step, k), rate, log, then if k == 1 else None)
        for k, cell in enumerate(cells, 1)
    )
    fix = BranchFix(step, np.zeros(2), np.array([1.0, 0.0]), 1e-6)
    return Branching(fix, branches, rate, rate, (0.0, 0.0, 0.0), 0.0)


@pytest.mark.parametrize(("first", "second", "taken"), [(5.0, -5.0, 2), (5.0, 5.0, 2), (-5.0, 5.0, 1)])
def test_a_flight_takes_a_branch_at_each_fix(first: float, second: float, taken: int) -> None:
    """Its measured position is ``first`` m left at the first fix, ``second`` m at the other one."""
    tree = tree_of(2, 6, "A", tree_of(4, 6, "A1"))

    def pilot(_: Any, u: np.ndarray, x: np.ndarray) -> np.ndarray:
        there = np.zeros((1, len(u) + 1, 2))
        there[0, 2, 1], there[0, 4, 1] = first, second
        return there

    context: Any = SimpleNamespace(run=SimpleNamespace(settings=Settings()))
    way = Way("both", rest(6, 0, 0.0), pilot, branching=tree)
    u, x, plans = branch_controls(context, way, tree, None, 3)  # type: ignore[arg-type]
    heading = np.arctan2(u[:, 1], u[:, 0])
    wanted = [0.0, 0.0, *[1.0 if first > 0 else 2.0] * 2]
    last = 2.0 if first < 0 or second < 0 else 1.0
    assert heading == pytest.approx([*wanted, last, last])
    assert (len(u), len(x), plans) == (6, 7, taken)
