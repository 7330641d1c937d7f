"""Claims about the front: its paths, their costs and failure rates, and the rule that picked the plan."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from scipy.stats import binom

from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl_verify import laws
from pareto_ltl_verify.claims.plan import LEAST_RISK, OBJECTIVES, RISK
from pareto_ltl_verify.claims.search import tree_names, vertex_path
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, likely, no_fault, number
from pareto_ltl_verify.dominated_volume import volume
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE, clopper_pearson, same_counts, same_rate

MOST_PATHS = 6  # paths of the front whose bounds are computed again
FLOWN_PATHS = 3  # paths of the front that are simulated again
SHARED_PATHS = 10  # paths of the front that are simulated again in the same winds
NEW_RUNS = 2000  # new flights of each of these paths
SMALL = 1e-3  # rule worth: failure rate below which a lower one is worth little length
WORSE = 0.025  # rule priority: a path is less safe than the safest if the p value of its failures is below


def _turned_angle(x: FloatArray, _dt: float) -> float:
    """Sum of the changes of course [deg]."""
    steps = np.diff(x, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > STILL]
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    along = (steps[:-1] * steps[1:]).sum(axis=1)
    return math.degrees(math.fsum(abs(math.atan2(c, a)) for c, a in zip(cross, along, strict=True)))


FURTHER_COSTS: dict[str, tuple[str, Callable[[FloatArray, float], float]]] = {
    "duration": ("arrival_s", lambda x, dt: (len(x) - 1) * dt),
    "turns": ("turns_deg", _turned_angle),
}  # column, and function from positions (T+1, 2) [m] and the time step [s] to the cost
STILL = 1e-9  # [m] shorter steps have no course


def flights_judge(result: Evidence) -> bool:
    """Whether simulated flights judge the paths of the front, not bounds."""
    return str(result.settings["fidelity"]["judge"]) == "flights"


def _rows(result: Evidence) -> FloatArray:
    """(mission risk, collision risk, length and further costs) of the front."""
    keys = ("mission_risk", "collision_risk")
    rows = [[*(float(row[key]) for key in keys), *_costs(result, row)] for row in result.front]
    return np.array(rows).reshape(len(rows), -1)


def _judged_rows(result: Evidence) -> FloatArray:
    """Objectives of dominance: (failure rate, costs) where flights judge, otherwise all of them."""
    if not flights_judge(result):
        return _rows(result)
    rows = [[float(row["failure"]), *_costs(result, row)] for row in result.front]
    return np.array(rows).reshape(len(rows), -1)


def _costs(result: Evidence, row: Mapping[str, str]) -> list[float]:
    """Length [m], with a power curve energy [J], and the costs that ``selection.costs`` adds."""
    return [float(row[name]) for name in _cost_columns(result)]


def _cost_columns(result: Evidence) -> list[str]:
    """The columns of costs: length, and all after the last column that every front has."""
    names = list(result.front[0])
    return ["length_m", *names[names.index("origin") + 1 :]]


def _dominated(rows: FloatArray) -> BoolArray:
    no_worse = (rows[:, None] <= rows[None]).all(axis=2)
    better = (rows[:, None] < rows[None]).any(axis=2)
    return np.asarray((no_worse & better).any(axis=0), bool)


def front_rows(result: Evidence) -> Verdict:
    """No path of the front is dominated; they are numbered and sorted by failure rate or mission risk."""
    rows = _judged_rows(result)
    faults = [f"path {k} is dominated" for k in np.flatnonzero(_dominated(rows))]
    faults += ["numbers"] * ([int(row["path"]) for row in result.front] != list(range(len(rows))))
    faults += ["order"] * (sorted(map(tuple, rows)) != list(map(tuple, rows)))
    faults += ["two rows are equal"] * (len({tuple(row) for row in rows}) != len(rows))
    return no_fault(f"{len(rows)} paths", faults)


def front_numbers(result: Evidence) -> Verdict:
    """Size, shortest length and least risk of the front agree with the metrics."""
    rows, metrics = _rows(result), result.metrics
    pairs = {"front_size": len(rows), "shortest_m": rows[:, 2].min(), "safest": rows[:, 0].min()}
    if flights_judge(result):
        pairs |= {"least_failure": min(float(row["failure"]) for row in result.front)}
        pairs |= {"front_runs": int(result.front[0]["runs"])}
    faults = [
        f"{name} {metrics[name]} is {value:g}"
        for name, value in pairs.items()
        if name in metrics and not close(metrics[name], float(value), 1e-12)
    ]
    return no_fault(f"{int(metrics['front_size'])} paths", faults)


def hypervolume(result: Evidence) -> Verdict:
    """Hypervolume of the front in the box that the metrics name."""
    rows = _judged_rows(result)
    top = np.ones(rows.shape[1])
    sides = _cost_columns(result)
    for k, name in enumerate(sides, len(top) - len(sides)):
        top[k] = result.metrics[f"hypervolume_{name}"]
        if top[k] < 2 * rows[:, k].max() * (1 - 1e-9):
            return Verdict("a box twice as large as the front", f"{name} {top[k]:.6g}", False)
    return number(result.metrics["hypervolume"], volume(rows, top), rel=1e-9)


def front_risks(result: Evidence) -> Verdict:
    """The mission risk is the bound that the settings name, and the duration is steps times dt."""
    column = {"theorem2": "mission_risk_paper", "ordered": "mission_risk_ordered"}[
        result.settings["fidelity"]["mission_bound"]
    ]
    plain = column == "mission_risk_ordered" or result.planned_law == "independent"
    faults = [f"path {row['path']}" for row in result.front if plain and row["mission_risk"] != row[column]]
    faults += [
        f"path {row['path']}: duration"
        for row in result.front
        if not close(float(row["duration_s"]), int(row["steps"]) * result.robot.dt)
    ]
    return no_fault(f"mission_risk is {column}", faults)


# --- its paths --------------------------------------------------------------------------------


def front_paths(result: Evidence) -> Verdict:
    """Every row agrees with its path in front.npz: start, length, energy, steps and mission order.

    A path whose origin is a vertex of a tree is the path to that vertex.
    """
    faults = [
        f"path {k}: {fault}"
        for k, row in enumerate(result.front)
        for fault in _path_faults(result, row, result.front_x(k))
    ]
    if result.robot.power is not None:
        energies = [result.energy_of(result.front_u(k)) for k in range(len(result.front))]
        faults += [
            f"path {k}: energy {row['energy_j']} is {energies[k]:.9g}"
            for k, row in enumerate(result.front)
            if not close(float(row["energy_j"]), energies[k], 1e-9)
        ]
    for name in result.settings["selection"].get("costs", ()):
        if name in FURTHER_COSTS:
            column, recomputed = FURTHER_COSTS[name]
            faults += [
                f"path {k}: {name} {row[column]}"
                for k, row in enumerate(result.front)
                if not close(float(row[column]), recomputed(result.front_x(k), result.robot.dt), 1e-9)
            ]
    faults += ["other paths"] * (result.front_size != len(result.front))
    return no_fault(f"{len(result.front)} paths", faults)


def _path_faults(result: Evidence, row: Mapping[str, str], x: FloatArray) -> Iterator[str]:
    computed = float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
    if not close(float(row["length_m"]), computed, 1e-9):
        yield f"length {row['length_m']} is {computed:.9g}"
    if len(x) - 1 != int(row["steps"]):
        yield f"{row['steps']} steps are {len(x) - 1}"
    if np.abs(x[0] - result.start).max() > result.grain:
        yield "it does not begin at the start"
    if result.robot.power is None and "energy_j" in row:
        yield "an energy without a power curve"
    if row["order"] not in result.orders(x):
        yield f"order {row['order']} is {result.orders(x)[0]}"
    tree = re.fullmatch(r"tree (\d+) vertex (\d+)", row["origin"])
    if tree and result.has("trees.npz"):
        grown = vertex_path(result, int(tree[1]), int(tree[2]))
        if grown.shape != x.shape or (grown != x).any():
            yield f"it is not the path of {row['origin']}"


def front_costs(result: Evidence) -> Verdict:
    """V and R of paths of the front, from their positions."""
    chosen = _spread(len(result.front), MOST_PATHS)
    faults = [fault for k in chosen for fault in _cost_faults(result, result.front[k], result.front_x(k))]
    return no_fault(f"{len(chosen)} of {len(result.front)} paths", faults)


def _spread(size: int, limit: int) -> list[int]:
    """At most ``limit`` numbers from 0 to ``size`` - 1, both ends among them."""
    return [int(k) for k in np.unique(np.linspace(0, size - 1, min(size, limit)).round())]


def _cost_faults(result: Evidence, row: Mapping[str, str], x: FloatArray) -> Iterator[str]:
    law = result.law(result.planned_law, len(x) - 1)
    course = laws.fly_means(law, x)
    low, high = result.collision_bounds(law, course)
    computed = {
        "mission_risk_ordered": result.mission_bound(course),
        "collision_risk": min(max(float(row["collision_risk"]), low), high),
    }
    gap = np.abs(course.u - result.front_u(int(row["path"]))).max(initial=0.0)
    if gap > 1e-4 * result.robot.u_max:
        yield f"path {row['path']}: its controls do not fly it"
    for name, value in computed.items():
        if not close(float(row[name]), value, RISK, LEAST_RISK):
            yield f"path {row['path']}: {name} {row[name]} is {value:.6g}"


def tree_front(result: Evidence) -> Verdict | None:
    """If bounds judge, no accepted vertex is better than all paths of the front in every objective.

    Vertices have mission risk, length and, in some runs, collision risk, but no energy.
    """
    if not len(result.trees["accepted"]) or flights_judge(result):
        return None
    names = tree_names(result)
    extra = int(np.asarray(result.trees.get("collision_columns", 0)).item())
    costs = []
    for j, v in result.trees["accepted"].tolist():
        risk = result.trees[f"{names[j]}/risk"][v]
        columns = len(risk) - extra
        collision = float(risk[columns]) if extra else math.inf
        costs.append(
            (min(float(risk[:columns].sum()), 1.0), collision, float(result.trees[f"{names[j]}/length"][v]))
        )
    rows, front = np.array(costs), _rows(result)
    slack = np.array([1 + RISK, 1 + RISK, 1 + 1e-9])
    better = (rows[:, None] * slack < front[None, :, :3]).all(axis=2).all(axis=1)
    return no_fault(
        f"{len(rows)} accepted vertices",
        [f"tree {result.trees['accepted'][k]} beats all" for k in np.flatnonzero(better)],
    )


# --- its failure rates ------------------------------------------------------------------------

RATE_COLUMNS = ("failure", "failure_low", "failure_high", "law", "runs")


def front_rates(result: Evidence) -> Verdict:
    """Rates and intervals follow from the flights in front.npz; wind law and number agree with settings."""
    if not flights_judge(result):
        rated = [row["path"] for row in result.front if any(row[name] for name in RATE_COLUMNS)]
        return no_fault("no rates", [f"path {name} has a rate" for name in rated])
    failed = result.front_arrays["failed"]
    law, runs = result.planned_law, int(result.settings["selection"]["draws"])
    faults = [] if failed.shape == (len(result.front), runs) else [f"flights of shape {failed.shape}"]
    for row, flights in zip(result.front, failed, strict=False):
        count = int(flights.sum())
        wanted = (count / runs, *clopper_pearson(count, runs))
        stated = tuple(float(row[name]) for name in RATE_COLUMNS[:3])
        near = all(close(a, b, 1e-9, 1e-12) for a, b in zip(stated, wanted, strict=True))
        if not near or (row["law"], row["runs"]) != (law, str(runs)):
            faults.append(f"path {row['path']}: {count} of {runs} flights fail")
    return no_fault(f"{runs} flights each, {law} winds", faults)


def new_front_rates(result: Evidence) -> Verdict | None:
    """Failure rates of paths of the front agree with new flights with other random numbers."""
    if not flights_judge(result):
        return None
    chosen, faults = _spread(len(result.front), FLOWN_PATHS), []
    for k in chosen:
        x = result.front_simulator(k).fly(NEW_RUNS, np.random.default_rng([20181009, 100 + k]))
        again, runs = int(result.ground.failed(x).sum()), int(result.front[k]["runs"])
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
    flown = np.zeros(NEW_RUNS, int)
    for k in chosen:
        x = result.front_simulator(k).fly(NEW_RUNS, np.random.default_rng(20181012))
        flown += result.ground.failed(x)
    chance = same_counts(failed[chosen].sum(axis=0), flown)
    return likely(f"{len(chosen)} of {len(result.front)} paths", chance, RARE)


# --- the choice -------------------------------------------------------------------------------


def plan_on_front(result: Evidence) -> Verdict:
    """The plan is one path of the front: costs, origin, positions."""
    costs, x = result.plan["objectives"], result.x
    rows = [
        row for k, row in enumerate(result.front)
        if row["origin"] == result.plan["origin"]
        and all(float(row[name]) == costs[key] for name, key in OBJECTIVES.items())
        and np.array_equal(result.front_x(k), x)
    ]  # fmt: skip
    return Verdict(result.plan["origin"][:44], f"{len(rows)} such path", len(rows) == 1)


def added_rule(result: Evidence) -> str | None:
    """The selection rule, if another package adds it: its choice cannot be derived again."""
    rule: str = result.settings["selection"]["rule"]
    return None if rule in RANKINGS else rule


def choice(result: Evidence) -> Verdict | None:
    """The plan is the first path in the selection rule's order; with judge=flights one of the first."""
    settings = result.settings["selection"]
    if added_rule(result) is not None:
        return None
    tried = settings["examined"] if flights_judge(result) else 1
    left, place = _affordable(result, settings["rule"]), -1
    for k in range(min(tried, len(left))):
        ranked = RANKINGS[settings["rule"]](result, settings, left)
        if not ranked:
            break
        if np.array_equal(result.front_x(ranked[0]), result.x):
            place = k
            break
        left.remove(ranked[0])
    return Verdict(f"rule {settings['rule']}", f"choice {place + 1} of the rule", place >= 0)


def _affordable(result: Evidence, rule: str) -> list[int]:
    """Paths that need no more energy than the robot has; all of them under rule "point"."""
    every = range(len(result.front))
    if result.robot.capacity is None or rule == "point":
        return list(every)
    return [k for k in every if float(result.front[k]["energy_j"]) <= result.robot.capacity]


def _by_priority(result: Evidence, _told: Mapping[str, Any], left: list[int]) -> list[int]:
    rows = _rows(result)[left]
    if not flights_judge(result):
        return [left[i] for i in np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    failed = result.front_arrays["failed"][left]
    safest = failed[np.lexsort((rows[:, 2], failed.sum(axis=1)))[0]]
    more, fewer = ((failed & ~safest).sum(axis=1), (~failed & safest).sum(axis=1))
    as_safe = np.flatnonzero(binom.sf(more - 1, more + fewer, 0.5) >= WORSE)
    return [left[i] for i in as_safe[np.argsort(rows[as_safe, 2], kind="stable")]]


def _by_worth(result: Evidence, settings: Mapping[str, Any], left: list[int]) -> list[int]:
    """Paths by (failure rate + 0.001) times length to the power of the setting, the least first."""
    if not flights_judge(result):
        return _by_priority(result, settings, left)
    length = _rows(result)[left, 2]
    score = np.log((_risks(result, left) + SMALL) * (length / length.min()) ** settings["saving"])
    return [left[i] for i in np.lexsort((length, score.round(9)))]


def _risks(result: Evidence, left: list[int]) -> FloatArray:
    """Failure rate of each path, or the sum of its bounds, (P,)."""
    if flights_judge(result):
        return _judged_rows(result)[left, 0]
    return np.asarray(_rows(result)[left, :2].sum(axis=1), float)


def _by_weights(result: Evidence, settings: Mapping[str, Any], left: list[int]) -> list[int]:
    weights, rows = np.array(settings["weights"], float), _rows(result)[left]
    risk = rows[:, 0] * weights[0] + rows[:, 1] * weights[1]
    if flights_judge(result):
        risk = _risks(result, left) * (weights[0] + weights[1])
    for weight, cost in zip(weights[2:], rows[:, 2:].T, strict=False):
        risk = risk + weight * cost / (cost.min() or 1.0)
    score = risk / weights.sum()
    return [left[i] for i in np.argsort(score.round(12), kind="stable")]


def _by_threshold(result: Evidence, settings: Mapping[str, Any], left: list[int]) -> list[int]:
    rows, limits = _rows(result)[left], _risks(result, left)
    if flights_judge(result):
        limits = np.array([float(result.front[k]["failure_high"]) for k in left])
    safe = np.flatnonzero(limits <= settings["alpha"])
    return [left[i] for i in safe[np.argsort(rows[safe, 2], kind="stable")]]


def _by_least(result: Evidence, settings: Mapping[str, Any], left: list[int]) -> list[int]:
    cost, columns = settings["least"], {"length": "length_m", "energy": "energy_j"}
    column = columns[cost] if cost in columns else FURTHER_COSTS[cost][0]
    costs = {k: float(result.front[k][column]) for k in left}
    return sorted(_by_threshold(result, settings, left), key=costs.__getitem__)


def _by_knee(result: Evidence, _told: Mapping[str, Any], left: list[int]) -> list[int]:
    """Paths by their distance from the line through the safest and the shortest one, the farthest first."""
    risk, length = _risks(result, left), _rows(result)[left, 2]
    across, up = np.ptp(risk) or 1.0, np.ptp(length) or 1.0
    area = across * up - (risk - risk.min()) * up - (length - length.min()) * across
    return [left[i] for i in np.lexsort((length, risk, -(area / (across * up)).round(12)))]


def _by_length(result: Evidence, settings: Mapping[str, Any], left: list[int]) -> list[int]:
    length = _rows(result)[left, 2]
    short = np.flatnonzero(length <= settings["length"])
    return [left[i] for i in short[np.lexsort((length[short], _risks(result, left)[short]))]]


def _by_number(_result: Evidence, settings: Mapping[str, Any], left: list[int]) -> list[int]:
    return [k for k in left if k == settings["point"]]


RANKINGS: dict[str, Callable[[Evidence, Mapping[str, Any], list[int]], list[int]]] = {
    "worth": _by_worth,
    "priority": _by_priority,
    "weighted": _by_weights,
    "threshold": _by_threshold,
    "energy": _by_least,
    "least": _by_least,
    "knee": _by_knee,
    "length": _by_length,
    "point": _by_number,
}  # for each rule of this package: the remaining paths in order of preference

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
