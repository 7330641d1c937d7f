"""Claims about the choice: the plan is a path of the front, the one that the selection rule picks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom

from pareto_ltl_verify.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify.claims import Claim, Verdict
from pareto_ltl_verify.claims.front import (
    BOUNDS,
    COLUMNS,
    FILES,
    FURTHER_COSTS,
    columns,
    cost_columns,
    flights_judge,
)
from pareto_ltl_verify.claims.plan import OBJECTIVES
from pareto_ltl_verify.evidence import Evidence

SMALL = 1e-3  # rule worth: failure rate below which a lower one is worth little length
WORSE = 0.025  # rule priority: a path is less safe than the safest if the p value of its failures is below
CHOICE = "front: the rule picks the plan"  # not judged for a rule that another package adds


# --- the choice -------------------------------------------------------------------------------


def plan_on_front(result: Evidence) -> Verdict:
    """The plan is one path of the front: costs, origin, positions; its further costs are in the metrics."""
    plan, x, requested = result.plan, result.x, result.settings["selection"].get("costs", ())
    wanted = {name: plan["objectives"][key] for name, key in OBJECTIVES.items()}
    further = {
        column: plan["objectives"][key] for key, (column, _) in FURTHER_COSTS.items() if key in requested
    }
    wanted |= further
    rows = [
        row for k, row in enumerate(result.front)
        if row["origin"] == plan["origin"]
        and row["order"] == plan["order"]
        and {name: float(row[name]) for name in wanted} == wanted
        and np.array_equal(result.front_x(k), x)
    ]  # fmt: skip
    alike = further.items() <= result.metrics.items()
    if (tree := plan.get("branches")) is not None and tree.get("bent") is not None:  # of no row
        stated, point = plan["origin"], tree["point"]
        origin = result.front[point]["origin"] if point < len(result.front) else ""
        named = stated == f"{origin}, bent for its branches"
        return Verdict(stated[:44], "a bent path of the front" if named else "no path", named and alike)
    return Verdict(plan["origin"][:44], f"{len(rows)} such path", len(rows) == 1 and alike)


def added_rule(result: Evidence) -> str | None:
    """The selection rule, if another package adds it: its choice cannot be derived again."""
    rule: str = result.settings["selection"]["rule"]
    return None if rule in RANKINGS else rule


class Paths(NamedTuple):
    """Paths of the front that a rule may choose.

    Attributes
    ----------
    number : (P,) int
    bounds : (P, 2) float
        Mission risk and collision risk.
    costs : (P, c) float
        Length [m] and further costs.
    risk, high : (P,) float
        Failure rate and the upper end of its interval; where bounds judge, both are their sum.
    failed : (P, F) bool
        Flights that fail; F = 0 where bounds judge.
    least : (P,) float
        The cost that rule "least" minimises.
    """

    number: IntArray
    bounds: FloatArray
    costs: FloatArray
    risk: FloatArray
    high: FloatArray
    failed: BoolArray
    least: FloatArray

    @property
    def length(self) -> FloatArray:
        """Lengths (P,) [m]."""
        return self.costs[:, 0]

    @property
    def flown(self) -> bool:
        """Whether flights judge."""
        return bool(self.failed.shape[1])


def choice(result: Evidence) -> Verdict | None:
    """The plan is the first path in the selection rule's order; with judge=flights one of the first.

    Paths that need more energy than the robot has are left out, except under rule "point".
    """
    settings = result.settings["selection"]
    if added_rule(result) is not None:
        return None
    if (tree := result.plan.get("branches")) is not None:  # the best trunk need not be the best path
        point = tree["point"]
        if tree.get("bent") is not None:  # for its branches; it has the steps of the path that was bent
            whole = point < len(result.front) and len(result.front_x(point)) == len(result.x)
            return Verdict(f"path {point}, bent for its branches", "its steps" if whole else "others", whole)
        known = point < len(result.front) and np.array_equal(result.front_x(point), result.x)
        return Verdict(f"path {point} with branches", "the plan" if known else "another path", known)
    rule, capacity = settings["rule"], result.robot.capacity
    paths, place = _all_paths(result, settings), -1
    if capacity is not None and rule != "point":
        paths = _only(paths, columns(result, "energy_j")[:, 0] <= capacity)
    for k in range(min(settings["examined"] if paths.flown else 1, len(paths.number))):
        ranked = RANKINGS[rule](paths, settings)
        if not len(ranked):
            break
        if np.array_equal(result.front_x(paths.number[ranked[0]]), result.x):
            place = k
            break
        paths = _only(paths, np.arange(len(paths.number)) != ranked[0])
    return Verdict(f"rule {rule}", f"choice {place + 1} of the rule", place >= 0)


def _all_paths(result: Evidence, settings: Mapping[str, Any]) -> Paths:
    bounds, numbers = columns(result, *BOUNDS), np.arange(len(result.front))
    risk = high = bounds.sum(axis=1)
    failed = np.zeros((len(bounds), 0), bool)
    if flights_judge(result):
        risk, high = columns(result, "failure", "failure_high").T
        failed = result.front_arrays["failed"]
    minimised = settings["rule"] in ("energy", "least")
    least = columns(result, COLUMNS[settings["least"]])[:, 0] if minimised else risk
    return Paths(numbers, bounds, columns(result, *cost_columns(result)), risk, high, failed, least)


def _only(paths: Paths, chosen: BoolArray) -> Paths:
    return Paths._make(values[chosen] for values in paths)


def _by_priority(paths: Paths, _settings: Mapping[str, Any]) -> IntArray:
    if not paths.flown:
        return np.lexsort((paths.length, *paths.bounds.T[::-1]))
    safest = paths.failed[np.lexsort((paths.length, paths.failed.sum(axis=1)))[0]]
    more, fewer = ((paths.failed & ~safest).sum(axis=1), (~paths.failed & safest).sum(axis=1))
    return _sorted(np.flatnonzero(binom.sf(more - 1, more + fewer, 0.5) >= WORSE), paths.length)


def _by_worth(paths: Paths, settings: Mapping[str, Any]) -> IntArray:
    """By (failure rate + 0.001) times length to the power of the setting, the least first."""
    if not paths.flown:
        return _by_priority(paths, settings)
    score = np.log((paths.risk + SMALL) * (paths.length / paths.length.min()) ** settings["saving"])
    return np.lexsort((paths.length, score.round(9)))


def _by_weights(paths: Paths, settings: Mapping[str, Any]) -> IntArray:
    weights = np.array(settings["weights"], float)
    score = paths.risk * weights[:2].sum() if paths.flown else paths.bounds @ weights[:2]
    for weight, cost in zip(weights[2:], paths.costs.T, strict=False):
        score = score + weight * cost / (cost.min() or 1.0)
    return np.argsort((score / weights.sum()).round(12), kind="stable")


def _by_threshold(paths: Paths, settings: Mapping[str, Any]) -> IntArray:
    return _sorted(np.flatnonzero(paths.high <= settings["alpha"]), paths.length)


def _by_knee(paths: Paths, _settings: Mapping[str, Any]) -> IntArray:
    """By the distance from the line through the safest and the shortest path, the farthest first."""
    risk, length = paths.risk, paths.length
    across, up = np.ptp(risk) or 1.0, np.ptp(length) or 1.0
    area = across * up - (risk - risk.min()) * up - (length - length.min()) * across
    return np.lexsort((length, risk, -(area / (across * up)).round(12)))


def _by_length(paths: Paths, settings: Mapping[str, Any]) -> IntArray:
    short = np.flatnonzero(paths.length <= settings["length"])
    return _sorted(short, paths.risk, paths.length)


def _by_least(paths: Paths, settings: Mapping[str, Any]) -> IntArray:
    return _sorted(_by_threshold(paths, settings), paths.least)


def _sorted(chosen: IntArray, *keys: FloatArray) -> IntArray:
    """The indices ``chosen``, in the order of the first of ``keys`` (P,), then of the next."""
    return chosen[np.lexsort([key[chosen] for key in keys[::-1]])]


RANKINGS: dict[str, Callable[[Paths, Mapping[str, Any]], IntArray]] = {
    "worth": _by_worth,
    "priority": _by_priority,
    "weighted": _by_weights,
    "threshold": _by_threshold,
    "energy": _by_least,
    "least": _by_least,
    "knee": _by_knee,
    "length": _by_length,
    "point": lambda paths, settings: np.flatnonzero(paths.number == settings["point"]),
}  # fmt: skip - for each rule of this package: the remaining paths in order of preference

CLAIMS: tuple[Claim, ...] = (
    Claim("front: the plan is on it", (*FILES, "plan.json"), plan_on_front),
    Claim(CHOICE, (*FILES, "plan.json"), choice),
)
