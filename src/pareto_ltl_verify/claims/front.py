"""Claims about the front: its paths, their costs and failure rates, and the rule that picked the plan."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom

from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify import laws
from pareto_ltl_verify.claims import Claim, Verdict, close, far_apart, likely, no_fault, number, true_of
from pareto_ltl_verify.claims.plan import LEAST_RISK, OBJECTIVES, RISK
from pareto_ltl_verify.claims.search import tree_names, vertex_path, vertex_risk
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE, rate_of, same_counts, same_rate

MOST_PATHS = 6  # paths of the front whose bounds are computed again
FLOWN_PATHS = 3  # paths of the front that are simulated again
SHARED_PATHS = 10  # paths of the front that are simulated again in the same winds
NEW_RUNS = 2000  # new flights of each of these paths
SMALL = 1e-3  # rule worth: failure rate below which a lower one is worth little length
WORSE = 0.025  # rule priority: a path is less safe than the safest if the p value of its failures is below
STILL = 1e-9  # [m] shorter steps have no course
BOUNDS = ("mission_risk", "collision_risk")
INTERVAL = ("failure", "failure_low", "failure_high")


def _turned_angle(_result: Evidence, x: FloatArray) -> float:
    """Sum of the changes of course [deg]."""
    steps = np.diff(x, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > STILL]
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    along = (steps[:-1] * steps[1:]).sum(axis=1)
    return math.degrees(math.fsum(abs(math.atan2(c, a)) for c, a in zip(cross, along, strict=True)))


FURTHER_COSTS: dict[str, tuple[str, Callable[[Evidence, FloatArray], float]]] = {
    "duration": ("arrival_s", lambda result, x: (len(x) - 1) * result.robot.dt),
    "turns": ("turns_deg", _turned_angle),
}  # column, and function from the result and positions (T+1, 2) [m] to the cost
COLUMNS = {"length": "length_m", "energy": "energy_j"} | {k: v[0] for k, v in FURTHER_COSTS.items()}


# --- its rows ---------------------------------------------------------------------------------


def flights_judge(result: Evidence) -> bool:
    """Whether simulated flights judge the paths of the front, not bounds."""
    return str(result.settings["fidelity"]["judge"]) == "flights"


def columns(result: Evidence, *names: str) -> FloatArray:
    """Numbers of front.csv, (P, n) for n columns."""
    rows = [[float(row[name]) for name in names] for row in result.front]
    return np.array(rows).reshape(len(rows), len(names))


def cost_columns(result: Evidence) -> list[str]:
    """The columns of costs: length, and all after the last column that every front has.

    These are energy, with a power curve, and the costs that ``selection.costs`` adds.
    """
    names = list(result.front[0])
    return ["length_m", *names[names.index("origin") + 1 :]]


def judged_rows(result: Evidence) -> FloatArray:
    """Objectives of dominance: (failure rate, costs) where flights judge, otherwise all of them."""
    judged = ("failure",) if flights_judge(result) else BOUNDS
    return columns(result, *judged, *cost_columns(result))


def front_rows(result: Evidence) -> Verdict:
    """No path of the front is dominated; they are numbered and sorted by failure rate or mission risk."""
    rows = judged_rows(result)
    no_worse, better = rows[:, None] <= rows, rows[:, None] < rows
    dominated = (no_worse.all(axis=2) & better.any(axis=2)).any(axis=0)
    listed = list(map(tuple, rows))
    faults = {
        "numbers": [int(row["path"]) for row in result.front] != list(range(len(rows))),
        "order": sorted(listed) != listed,
        "two rows are equal": len(set(listed)) != len(rows),
    }
    gone = [f"path {k} is dominated" for k in np.flatnonzero(dominated)]
    return no_fault(f"{len(rows)} paths", gone, faults)


def front_numbers(result: Evidence) -> Verdict:
    """Size, shortest length and least risk of the front agree with the metrics."""
    metrics, (safest, shortest) = result.metrics, columns(result, "mission_risk", "length_m").min(axis=0)
    wanted = {"front_size": len(result.front), "shortest_m": shortest, "safest": safest}
    if flights_judge(result):
        runs = int(result.front[0]["runs"])
        wanted |= {"least_failure": columns(result, "failure").min(), "front_runs": runs}
    wanted = {name: value for name, value in wanted.items() if name in metrics}
    return no_fault(f"{int(metrics['front_size'])} paths", far_apart(metrics, wanted, 1e-12))


def volume(rows: FloatArray) -> float:
    """Share of the box from 0 to 1 that ``rows`` (P, f) dominate, by slices of the first axis."""
    if rows.shape[1] == 2:
        x, y = rows[np.argsort(rows[:, 0])].T
        return float(np.diff(x, append=1.0) @ (1.0 - np.minimum.accumulate(y)))
    levels: list[float] = np.append(np.unique(rows[:, 0]), 1.0).tolist()
    return sum((high - low) * volume(rows[rows[:, 0] <= low, 1:]) for low, high in pairwise(levels))


def hypervolume(result: Evidence) -> Verdict:
    """Hypervolume of the front in the box that the metrics name."""
    rows, sides = judged_rows(result), cost_columns(result)
    top = np.ones(rows.shape[1])
    top[-len(sides) :] = [result.metrics[f"hypervolume_{name}"] for name in sides]
    for side, wide, most in zip(sides, top[-len(sides) :], rows[:, -len(sides) :].max(axis=0), strict=True):
        if wide < 2 * most * (1 - 1e-9):
            return Verdict("a box twice as large as the front", f"{side} {wide:.6g}", False)
    return number(result.metrics["hypervolume"], volume(np.minimum(rows / top, 1.0)), rel=1e-9)


def front_risks(result: Evidence) -> Verdict:
    """The mission risk is the bound that the settings name, and the duration is steps times dt."""
    fidelity, dt = result.settings["fidelity"], result.robot.dt
    column = {"theorem2": "mission_risk_paper", "ordered": "mission_risk_ordered"}[fidelity["mission_bound"]]
    plain = column == "mission_risk_ordered" or result.planned_law == "independent"
    faults = [f"path {row['path']}" for row in result.front if plain and row["mission_risk"] != row[column]]
    late = (row for row in result.front if not close(float(row["duration_s"]), int(row["steps"]) * dt))
    risks = columns(result, *BOUNDS, "mission_risk_ordered")
    wrong = np.flatnonzero((risks < 0.0).any(axis=1) | (risks[:, -1] > 1.0 + 1e-9))
    faults += [f"path {k}: a risk beyond 0 and 1" for k in wrong]
    return no_fault(f"mission_risk is {column}", faults, (f"path {row['path']}: duration" for row in late))


# --- its paths --------------------------------------------------------------------------------


def front_paths(result: Evidence) -> Verdict:
    """Every row agrees with its path in front.npz: start, costs, steps and mission order.

    A path whose origin is a vertex of a tree is the path to that vertex.
    """
    rows, stored = result.front, sum(key.endswith("/x") for key in result.front_arrays)
    faults = (f"path {k}: {fault}" for k, row in enumerate(rows) for fault in _path_faults(result, row, k))
    return no_fault(f"{len(rows)} paths", faults, {"other paths": stored != len(rows)})


def _path_faults(result: Evidence, row: Mapping[str, str], k: int) -> Iterator[str]:
    x, robot = result.front_x(k), result.robot
    costs = {"length_m": float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())}
    if robot.power is not None:
        costs["energy_j"] = math.fsum(robot.spent(result.front_u(k)))
    asked = result.settings["selection"].get("costs", ())
    costs |= {column: of(result, x) for name, (column, of) in FURTHER_COSTS.items() if name in asked}
    yield from far_apart(row, costs, 1e-9)
    orders = result.orders(x)
    faults = {
        f"{row['steps']} steps are {len(x) - 1}": len(x) - 1 != int(row["steps"]),
        "it does not begin at the start": np.abs(x[0] - result.start).max() > result.grain,
        "an energy without a power curve": robot.power is None and "energy_j" in row,
        f"order {row['order']} is {orders[0]}": row["order"] not in orders,
    }
    yield from true_of(faults)
    tree = re.fullmatch(r"tree (\d+) vertex (\d+)", row["origin"])
    grown = vertex_path(result, int(tree[1]), int(tree[2])) if tree and result.has("trees.npz") else x
    if not np.array_equal(grown, x):
        yield f"it is not the path of {row['origin']}"


def front_costs(result: Evidence) -> Verdict:
    """V and R of paths of the front, from their positions."""
    chosen = _spread(len(result.front), MOST_PATHS)
    faults = (f"path {k}: {fault}" for k in chosen for fault in _bound_faults(result, result.front[k], k))
    return no_fault(f"{len(chosen)} of {len(result.front)} paths", faults)


def _spread(size: int, limit: int) -> list[int]:
    """At most ``limit`` numbers from 0 to ``size`` - 1, both ends among them."""
    return [int(k) for k in np.unique(np.linspace(0, size - 1, min(size, limit)).round())]


def _bound_faults(result: Evidence, row: Mapping[str, str], k: int) -> Iterator[str]:
    x = result.front_x(k)
    law = result.law(result.planned_law, len(x) - 1)
    course = laws.fly_means(law, x)
    if np.abs(course.u - result.front_u(k)).max(initial=0.0) > 1e-4 * result.robot.u_max:
        yield "its controls do not fly it"
    computed = {
        "mission_risk_ordered": result.mission_bound(course),
        "collision_risk": float(np.clip(float(row["collision_risk"]), *result.collision_bounds(law, course))),
    }
    yield from far_apart(row, computed, RISK, LEAST_RISK)


def tree_front(result: Evidence) -> Verdict | None:
    """If bounds judge, no accepted vertex is better than all paths of the front in every objective.

    Vertices have mission risk, length and, in some runs, collision risk, but no energy.
    """
    accepted = result.trees["accepted"].tolist()
    if not accepted or flights_judge(result):
        return None
    lengths = [result.trees[f"{name}/length"] for name in tree_names(result)]
    rows = np.array([[*vertex_risk(result, j, v), lengths[j][v]] for j, v in accepted])
    slack = np.array([1 + RISK, 1 + RISK, 1 + 1e-9])
    better = (rows[:, None] * slack < columns(result, *BOUNDS, "length_m")).all(axis=2).all(axis=1)
    faults = [f"tree {accepted[k]} beats all" for k in np.flatnonzero(better)]
    return no_fault(f"{len(rows)} accepted vertices", faults)


# --- its failure rates ------------------------------------------------------------------------


def front_rates(result: Evidence) -> Verdict:
    """Rates and intervals follow from the flights in front.npz; wind law and number agree with settings."""
    if not flights_judge(result):
        rated = [row["path"] for row in result.front if any(row[key] for key in (*INTERVAL, "law", "runs"))]
        return no_fault("no rates", [f"path {name} has a rate" for name in rated])
    failed, law = result.front_arrays["failed"], result.planned_law
    runs = int(result.settings["selection"]["draws"])
    faults = [] if failed.shape == (len(result.front), runs) else [f"flights of shape {failed.shape}"]
    for row, flights in zip(result.front, failed, strict=False):
        count = int(flights.sum())
        wanted = dict(zip(INTERVAL, rate_of(count, runs).values(), strict=True))
        if far_apart(row, wanted, 1e-9) or (row["law"], row["runs"]) != (law, str(runs)):
            faults.append(f"path {row['path']}: {count} of {runs} flights fail")
    return no_fault(f"{runs} flights each, {law} winds", faults)


def _failed_again(result: Evidence, k: int, *seed: int) -> BoolArray:
    """Which of ``NEW_RUNS`` new flights of path k fail."""
    x = result.fly(result.planned_law, result.front_x(k), result.front_u(k), NEW_RUNS, *seed)
    return result.ground.failed(x)


def new_front_rates(result: Evidence) -> Verdict | None:
    """Failure rates of paths of the front agree with new flights with other random numbers."""
    if not flights_judge(result):
        return None
    chosen, faults = _spread(len(result.front), FLOWN_PATHS), []
    for k in chosen:
        again, runs = int(_failed_again(result, k, 20181009, 100 + k).sum()), int(result.front[k]["runs"])
        chance = same_rate(round(float(result.front[k]["failure"]) * runs), runs, again, NEW_RUNS)
        faults += [f"path {k}: {again} of {NEW_RUNS}, chance {chance:.1g}"] * (chance < RARE / len(chosen))
    return no_fault(f"{len(chosen)} of {len(result.front)} paths", faults)


def shared_failures(result: Evidence) -> Verdict | None:
    """Paths of the front fail in the same winds: the number of them that fail in a flight, as in new flights.

    The flights of each path alone are judged by the claims above. χ² test of homogeneity.
    """
    if not flights_judge(result):
        return None
    failed = result.front_arrays["failed"]
    uncertain = np.argsort(-failed.var(axis=1), kind="stable")  # certain ones say little
    chosen = uncertain[:SHARED_PATHS].tolist()
    flown = np.sum([_failed_again(result, k, 20181012) for k in chosen], axis=0)
    chance = same_counts(failed[chosen].sum(axis=0), flown)
    return likely(f"{len(chosen)} of {len(result.front)} paths", chance, RARE)


# --- the choice -------------------------------------------------------------------------------


def plan_on_front(result: Evidence) -> Verdict:
    """The plan is one path of the front: costs, origin, positions; its further costs are in the metrics."""
    plan, x, asked = result.plan, result.x, result.settings["selection"].get("costs", ())
    wanted = {name: plan["objectives"][key] for name, key in OBJECTIVES.items()}
    further = {column: plan["objectives"][key] for key, (column, _) in FURTHER_COSTS.items() if key in asked}
    wanted |= further
    rows = [
        row for k, row in enumerate(result.front)
        if row["origin"] == plan["origin"]
        and {name: float(row[name]) for name in wanted} == wanted
        and np.array_equal(result.front_x(k), x)
    ]  # fmt: skip
    alike = further.items() <= result.metrics.items()
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

CHOICE = "front: the rule picks the plan"  # not judged for a rule that another package adds
FILES = ("front.csv", "front.npz")
WORLD = (*FILES, "cells.json", "automaton.json", "scene.json", "wind.nc")
CLAIMS = (
    Claim("front: no path is dominated", ("front.csv",), front_rows),
    Claim("front: numbers", ("front.csv",), front_numbers),
    Claim("front: hypervolume", ("front.csv",), hypervolume),
    Claim("front: mission risk of the settings", ("front.csv",), front_risks),
    Claim("front: paths", WORLD, front_paths),
    Claim("front: V and R of its paths", WORLD, front_costs),
    Claim("front: failure rates and intervals", FILES, front_rates),
    Claim("front: failure rates of new flights", WORLD, new_front_rates),
    Claim("front: flights that fail together", WORLD, shared_failures),
    Claim("front: no vertex beats it", ("front.csv", "trees.npz"), tree_front),
    Claim("front: the plan is on it", (*FILES, "plan.json"), plan_on_front),
    Claim(CHOICE, (*FILES, "plan.json"), choice),
)
