"""Claims about the search: trees, front, and the rule that picked the plan."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.verify import laws
from pareto_ltl.verify.claims.plan import LEAST_RISK, OBJECTIVES, RISK
from pareto_ltl.verify.claims.verdict import Claim, Verdict, close, no_fault, number, same
from pareto_ltl.verify.evidence import Evidence
from pareto_ltl.verify.flights import Legs
from pareto_ltl.verify.gaussians import theorem2
from pareto_ltl.verify.geometry import Convex, convex
from pareto_ltl.verify.wind_tables import at_step, square_of

MOST_VERTICES = 20  # accepted vertices whose risks are worked out again


# --- trees ------------------------------------------------------------------------------------


def _tree_names(result: Evidence) -> list[str]:
    return sorted({name.partition("/")[0] for name in result.trees if "/" in name})


def vertices(result: Evidence) -> Verdict:
    """The numbers of trees, vertices and accepted vertices are those of the metrics."""
    names = _tree_names(result)
    found = [
        len(names),
        sum(len(result.trees[f"{name}/parent"]) for name in names),
        len(result.trees["accepted"]),
    ]
    said = [int(result.metrics[name]) for name in ("trees", "nodes", "accepted_nodes")]
    faults = ["planner.trees"] * (len(names) != result.settings["planner"]["trees"])
    faults += ["planner.n_max"] * any(
        len(result.trees[f"{n}/parent"]) > result.settings["planner"]["n_max"] for n in names
    )
    return no_fault(f"{found[0]} trees, {found[1]} vertices", faults) if said == found else same(said, found)


def links(result: Evidence) -> Verdict:
    """Every vertex follows an earlier one: its step, its length, its cell and its automaton state."""
    cells = [convex(cell) for cell in result.cells["cells"]]
    column = np.array(
        [
            result.dfa.letters.index(frozenset(label) & frozenset(result.dfa.atoms))
            for label in result.cells["labels"]
        ]
    )
    faults = [
        f"{name}: {fault}"
        for name in _tree_names(result)
        for fault in _link_faults(result, name, cells, column)
    ]
    return no_fault("parents, steps, lengths, cells, states", faults)


def _link_faults(result: Evidence, name: str, cells: list[Convex], column: IntArray) -> Iterator[str]:
    x, parent, step, q, cell, length = (
        result.trees[f"{name}/{key}"] for key in ("x", "parent", "step", "q", "cell", "length")
    )
    delta, own = np.array(result.dfa.delta), np.arange(1, len(parent))
    before = parent[1:]
    if parent[0] != -1 or not ((before >= 0) & (before < own)).all():
        yield "a parent is not an earlier vertex"
        return
    if np.abs(x[0] - result.start).max() > result.grain or step[0] or length[0]:
        yield "the root is not the start"
    if (step[1:] != step[before] + 1).any():
        yield "a step does not follow that of its parent"
    gap = np.abs(length[1:] - length[before] - np.linalg.norm(x[1:] - x[before], axis=1))
    if gap.max(initial=0.0) > 1e-6 * max(float(length.max()), 1.0):
        yield "a length is not that of its path"
    legs = Legs(x[before], x[1:], column[cell[before]], column[cell[1:]])
    after = result.ground.after_step(q[before], legs)
    if q[0] != delta[result.dfa.initial, column[cell[0]]] or (q[1:] != after).any():
        yield "a state does not follow from the label"
    for number_, polygon in enumerate(cells):
        if (polygon.depth(x[cell == number_]) < -result.grain).any():
            yield f"a vertex is not in its cell {number_}"


def airspeeds(result: Evidence) -> Verdict | None:
    """No edge needs more than u_max in the expected wind; only for laws that do not shift it."""
    if result.planned_law != "independent" or (result.step_is_open and not result.has("plan.json")):
        return None
    robot, worst = result.robot, 0.0
    times = result.law(
        "independent", max(int(result.trees[f"{n}/step"].max()) for n in _tree_names(result))
    ).times
    for name in _tree_names(result):
        x, parent, step = (result.trees[f"{name}/{key}"] for key in ("x", "parent", "step"))
        for t in range(int(step.max())):
            new = np.flatnonzero(step == t + 1)
            here = x[parent[new]]
            wind = square_of(result.wind.x, result.wind.y, here).value(at_step(result.wind.mean, times, t))
            left = (x[new] - here @ robot.a.T) / robot.dt - wind
            worst = max(
                worst, float(np.linalg.norm(np.linalg.solve(robot.b, left.T), axis=0).max(initial=0.0))
            )
    return Verdict(f"at most {robot.u_max:g} m/s", f"{worst:.6g} m/s", worst <= robot.u_max * (1 + 2e-6))


def accepted(result: Evidence) -> Verdict:
    """Accepted are the vertices in an accepting state, all of them."""
    done = np.flatnonzero(result.dfa.accepting)
    found = {
        (j, int(v))
        for j, name in enumerate(_tree_names(result))
        for v in np.flatnonzero(np.isin(result.trees[f"{name}/q"], done))
    }
    said = {(int(j), int(v)) for j, v in result.trees["accepted"]}
    return Verdict(f"{len(said)} vertices", f"{len(found)} vertices", said == found)


def vertex_path(result: Evidence, j: int, v: int) -> FloatArray:
    """Positions from the root to vertex v of tree j."""
    name, rows = _tree_names(result)[j], [v]
    while result.trees[f"{name}/parent"][rows[-1]] >= 0:
        rows.append(int(result.trees[f"{name}/parent"][rows[-1]]))
    return np.asarray(result.trees[f"{name}/x"][rows[::-1]], float)


def vertex_risks(result: Evidence) -> Verdict | None:
    """Risks of some accepted vertices: f_o of each proposition, or V (and R from above)."""
    fidelity = result.settings["fidelity"]
    chosen = result.trees["accepted"]
    if not len(chosen):
        return None
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(MOST_VERTICES, len(chosen))).astype(int)]
    faults = []
    for j, v in chosen.tolist():
        x = vertex_path(result, j, v)
        risk = result.trees[f"{_tree_names(result)[j]}/risk"][v]
        columns = len(risk) - int(np.asarray(result.trees.get("collision_columns", 0)).item())
        course = laws.fly_means(result.law(result.planned_law, len(x) - 1), x)
        found = (
            result.mission_bound(course)
            if fidelity["mission_bound"] == "ordered"
            else theorem2(
                [(name, result.regions[name]) for name in result.dfa.atoms],
                x,
                course.cov,
                result.ground.labels(x),
            )
        )
        more = (
            result.robot.fix_risk if course.gains else 0.0
        )  # a fix at the vertex itself, which may be missed
        said = min(float(risk[:columns].sum()), 1.0)
        if not close(said, min(max(said, found), found + more), RISK, LEAST_RISK):
            faults.append(f"tree {j} vertex {v}: {risk[:columns].sum():.4g} is {found:.4g}")
    return no_fault(f"{len(chosen)} accepted vertices", faults)


# --- front ------------------------------------------------------------------------------------


def _rows(result: Evidence) -> FloatArray:
    """(mission risk, collision risk, length) of the front, (P, 3)."""
    keys = ("mission_risk", "collision_risk", "length_m")
    return np.array([[float(row[key]) for key in keys] for row in result.front]).reshape(-1, 3)


def _dominated(rows: FloatArray) -> BoolArray:
    no_worse = (rows[:, None] <= rows[None]).all(axis=2)
    better = (rows[:, None] < rows[None]).any(axis=2)
    return np.asarray((no_worse & better).any(axis=0), bool)


def front_rows(result: Evidence) -> Verdict:
    """No path of the front is dominated; they are numbered and sorted by mission risk."""
    rows, dominated = _rows(result), _dominated(_rows(result))
    faults = [f"path {k} is dominated" for k in np.flatnonzero(dominated)]
    faults += ["numbers"] * ([int(row["path"]) for row in result.front] != list(range(len(rows))))
    faults += ["order"] * (sorted(map(tuple, rows)) != list(map(tuple, rows)))
    faults += ["two rows are equal"] * (len({tuple(row) for row in rows}) != len(rows))
    return no_fault(f"{len(rows)} paths", faults)


def front_numbers(result: Evidence) -> Verdict:
    """Size, shortest and safest path of the front, as the metrics say."""
    rows, told = _rows(result), result.metrics
    pairs = {"front_size": len(rows), "shortest_m": rows[:, 2].min(), "safest": rows[:, 0].min()}
    faults = [
        f"{name} {told[name]} is {value:g}"
        for name, value in pairs.items()
        if name in told and not close(told[name], float(value), 1e-12)
    ]
    return no_fault(f"{int(told['front_size'])} paths", faults)


def volume(rows: FloatArray, top: FloatArray) -> float:
    """Share of the box below ``top`` that ``rows`` (P, 3) dominate, summed over slices of the first axis."""
    inside = np.minimum(rows, top) / top
    levels = np.append(np.unique(inside[:, 0]), 1.0)
    return float(sum((high - low) * _area(inside[inside[:, 0] <= low, 1:]) for low, high in pairwise(levels)))


def _area(rows: FloatArray) -> float:
    """Area that ``rows`` (P, 2) dominate below (1, 1)."""
    total, height = 0.0, 1.0
    for x, y in rows[np.lexsort((rows[:, 1], rows[:, 0]))]:
        if y < height:
            total += (1.0 - x) * (height - y)
            height = y
    return total


def hypervolume(result: Evidence) -> Verdict:
    """Hypervolume of the front in the box that the metrics name."""
    top = np.array([1.0, 1.0, result.metrics["hypervolume_length_m"]])
    if top[2] < 2 * _rows(result)[:, 2].max() * (1 - 1e-9):
        return Verdict("a box twice as long as the front", f"{top[2]:.6g} m", False)
    return number(result.metrics["hypervolume"], volume(_rows(result), top), rel=1e-9)


def front_risks(result: Evidence) -> Verdict:
    """The risk that the front is ranked by is the one that the settings name; V, f_o in [0, 1]."""
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


def front_trees(result: Evidence) -> Verdict | None:
    """Paths of the front that are vertices of a tree cost what their positions say."""
    faults: list[str] = []
    count = 0
    for row in result.front:
        origin = re.fullmatch(r"tree (\d+) vertex (\d+)", row["origin"])
        if origin:
            count += 1
            faults += _path_faults(result, row, vertex_path(result, int(origin[1]), int(origin[2])))
    return no_fault(f"{count} paths of trees", faults) if count else None


def _path_faults(result: Evidence, row: dict[str, str], x: FloatArray) -> Iterator[str]:
    law = result.law(result.planned_law, len(x) - 1)
    course = laws.fly_means(law, x)
    low, high = result.collision_bounds(law, course)
    found = {
        "length_m": float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
        "mission_risk_ordered": result.mission_bound(course),
        "collision_risk": min(max(float(row["collision_risk"]), low), high),
    }
    for name, value in found.items():
        if not close(float(row[name]), value, RISK, LEAST_RISK):
            yield f"path {row['path']}: {name} {row[name]} is {value:.6g}"


def tree_front(result: Evidence) -> Verdict | None:
    """No accepted vertex of a tree is better than the whole front, in the objectives that vertices know."""
    if not len(result.trees["accepted"]):
        return None
    names = _tree_names(result)
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
    better = (rows[:, None] * slack < front[None]).all(axis=2).all(axis=1)
    return no_fault(
        f"{len(rows)} accepted vertices",
        [f"tree {result.trees['accepted'][k]} beats all" for k in np.flatnonzero(better)],
    )


# --- the choice -------------------------------------------------------------------------------


def plan_on_front(result: Evidence) -> Verdict:
    """The plan is one path of the front, with the same costs and origin."""
    costs = result.plan["objectives"]
    rows = [
        row for row in result.front
        if row["origin"] == result.plan["origin"]
        and all(float(row[name]) == costs[key] for name, key in OBJECTIVES.items())
        and int(row["steps"]) == len(result.plan["u"])
    ]  # fmt: skip
    return Verdict(result.plan["origin"][:44], f"{len(rows)} such path", len(rows) == 1)


def choice(result: Evidence) -> Verdict | None:
    """The selection rule picks the plan; with judge=flights, one of its first choices."""
    told, rows = result.settings["selection"], _rows(result)
    order = _ranking(result, told, rows)
    if order is None:
        return None
    costs = result.plan["objectives"]
    place = next(
        (
            k
            for k, i in enumerate(order)
            if tuple(rows[i]) == (costs["mission_risk"], costs["collision_risk"], costs["length"])
        ),
        -1,
    )
    tried = told["examined"] if result.settings["fidelity"]["judge"] == "flights" else 1
    passed = result.plan["acceptance"] is None or result.plan["acceptance"]["passed"]
    fits = 0 <= place < tried and (place == 0 or passed or len(order) <= tried)
    return Verdict(f"rule {told['rule']}", f"choice {place + 1} of the rule", fits)


def _ranking(result: Evidence, told: Mapping[str, Any], rows: FloatArray) -> list[int] | None:
    """Paths of the front from the best on, by the rule; None for a rule of another package."""
    estimates = [row["failure_estimate"] for row in result.front]
    total = rows[:, :2].sum(axis=1)
    if told["rule"] == "priority":
        keys = (rows[:, 2], rows[:, 1], rows[:, 0])
        if all(estimates):
            keys = (rows[:, 2], total, np.array(estimates, float))
        return [int(i) for i in np.lexsort(keys)]
    if told["rule"] == "weighted":
        weights = np.array(told["weights"], float)
        score = rows / [1.0, 1.0, rows[:, 2].min() or 1.0] @ (weights / weights.sum())
        return [int(i) for i in np.argsort(score, kind="stable")]
    if told["rule"] == "threshold":
        safe = np.flatnonzero(total <= told["alpha"])
        return [int(i) for i in safe[np.argsort(rows[safe, 2], kind="stable")]]
    return None


TREES = ("trees.npz", "cells.json", "automaton.json", "scene.json")
WORLD = (*TREES, "wind.nc")
CLAIMS = (
    Claim("trees: numbers of vertices", ("trees.npz",), vertices),
    Claim("trees: vertices follow their parents", TREES, links),
    Claim("trees: airspeed of edges", WORLD, airspeeds),
    Claim("trees: accepted vertices", TREES, accepted),
    Claim("trees: risks of vertices", WORLD, vertex_risks),
    Claim("front: no path is dominated", ("front.csv",), front_rows),
    Claim("front: numbers", ("front.csv",), front_numbers),
    Claim("front: hypervolume", ("front.csv",), hypervolume),
    Claim("front: risk it is ranked by", ("front.csv",), front_risks),
    Claim("front: paths of trees", ("front.csv", *WORLD), front_trees),
    Claim("front: no vertex beats it", ("front.csv", "trees.npz"), tree_front),
    Claim("front: the plan is on it", ("front.csv", "plan.json"), plan_on_front),
    Claim("front: the rule picks the plan", ("front.csv", "plan.json"), choice),
)
