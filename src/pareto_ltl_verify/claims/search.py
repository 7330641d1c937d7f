"""Claims about the search trees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl_verify import laws
from pareto_ltl_verify.claims.plan import LEAST_RISK, RISK
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault, same
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import Legs
from pareto_ltl_verify.gaussians import theorem2
from pareto_ltl_verify.geometry import Convex, convex
from pareto_ltl_verify.wind_tables import at_step, square_of

MOST_VERTICES = 20  # accepted vertices whose risks are computed again


# --- trees ------------------------------------------------------------------------------------


def tree_names(result: Evidence) -> list[str]:
    """Names of the trees in ``trees.npz``."""
    return sorted({name.partition("/")[0] for name in result.trees if "/" in name})


def vertices(result: Evidence) -> Verdict:
    """The numbers of trees, vertices and accepted vertices agree with the metrics."""
    names = tree_names(result)
    computed = [
        len(names),
        sum(len(result.trees[f"{name}/parent"]) for name in names),
        len(result.trees["accepted"]),
    ]
    stated = [int(result.metrics[name]) for name in ("trees", "nodes", "accepted_nodes")]
    faults = ["planner.trees"] * (len(names) != result.settings["planner"]["trees"])
    faults += ["planner.n_max"] * any(
        len(result.trees[f"{n}/parent"]) > result.settings["planner"]["n_max"] for n in names
    )
    if stated != computed:
        return same(stated, computed)
    return no_fault(f"{computed[0]} trees, {computed[1]} vertices", faults)


def links(result: Evidence) -> Verdict:
    """Step, length, cell and automaton state of every vertex follow from its parent, an earlier vertex."""
    cells = [convex(cell) for cell in result.cells["cells"]]

    @cache
    def letters(holding: frozenset[str]) -> IntArray:
        place = {letter: i for i, letter in enumerate(result.dfa.letters)}
        labels = [frozenset(label) for label in result.cells["labels"]]
        return np.array([place[result.ground.letter(label, holding)] for label in labels])

    faults = [
        f"{name}: {fault}"
        for name in tree_names(result)
        for fault in _link_faults(result, name, cells, letters)
    ]
    return no_fault("parents, steps, lengths, cells, states", faults)


def _link_faults(
    result: Evidence, name: str, cells: list[Convex], letters: Callable[[frozenset[str]], IntArray]
) -> Iterator[str]:
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
        yield "a step does not follow the step of its parent"
    gap = np.abs(length[1:] - length[before] - np.linalg.norm(x[1:] - x[before], axis=1))
    if gap.max(initial=0.0) > 1e-6 * max(float(length.max()), 1.0):
        yield "a length is not the length of its path"
    table, after = result.timetable, np.empty(len(own), int)
    for t in np.unique(step[1:]).tolist():
        new = np.flatnonzero(step[1:] == t)
        source, target = before[new], own[new]
        first, last = letters(table.now(t - 1)), letters(table.now(t))
        legs = Legs(x[source], x[target], first[cell[source]], last[cell[target]])
        after[new] = result.ground.after_step(q[source], legs, holding=table.way(t))
    if q[0] != delta[result.dfa.initial, letters(table.now(0))[cell[0]]] or (q[1:] != after).any():
        yield "a state does not follow from the label"
    for number_, polygon in enumerate(cells):
        if (polygon.depth(x[cell == number_]) < -result.grain).any():
            yield f"a vertex is not in its cell {number_}"


def airspeeds(result: Evidence) -> Verdict | None:
    """Every edge can be flown with u_min to u_max in the expected wind.

    Judged under the independent law only: the coherent law shifts the expected wind.
    """
    if result.planned_law != "independent" or (result.step_is_open and not result.has("plan.json")):
        return None
    robot, worst, least = result.robot, 0.0, math.inf
    times = result.law(
        "independent", max(int(result.trees[f"{n}/step"].max()) for n in tree_names(result))
    ).times
    for name in tree_names(result):
        x, parent, step = (result.trees[f"{name}/{key}"] for key in ("x", "parent", "step"))
        for t in range(int(step.max())):
            new = np.flatnonzero(step == t + 1)
            here = x[parent[new]]
            wind = square_of(result.wind.x, result.wind.y, here).value(at_step(result.wind.mean, times, t))
            left = (x[new] - here @ robot.a.T) / robot.dt - wind
            speed = np.linalg.norm(np.linalg.solve(robot.b, left.T), axis=0)
            worst = max(worst, float(speed.max(initial=0.0)))
            least = min(least, float(speed.min(initial=math.inf)))
    return Verdict(
        f"{robot.u_min:g} to {robot.u_max:g} m/s",
        f"{least:.6g} to {worst:.6g} m/s",
        worst <= robot.u_max * (1 + 2e-6) and least >= robot.u_min * (1 - 2e-6),
    )


def accepted(result: Evidence) -> Verdict:
    """The accepted vertices are exactly those in an accepting state of the automaton."""
    done = np.flatnonzero(result.dfa.accepting)
    computed = {
        (j, int(v))
        for j, name in enumerate(tree_names(result))
        for v in np.flatnonzero(np.isin(result.trees[f"{name}/q"], done))
    }
    stated = {(int(j), int(v)) for j, v in result.trees["accepted"]}
    return Verdict(f"{len(stated)} vertices", f"{len(computed)} vertices", stated == computed)


def vertex_path(result: Evidence, j: int, v: int) -> FloatArray:
    """Positions (n, 2) [m] from the root to vertex v of tree j."""
    name, rows = tree_names(result)[j], [v]
    while result.trees[f"{name}/parent"][rows[-1]] >= 0:
        rows.append(int(result.trees[f"{name}/parent"][rows[-1]]))
    return np.asarray(result.trees[f"{name}/x"][rows[::-1]], float)


def vertex_risks(result: Evidence) -> Verdict | None:
    """The mission risk of some accepted vertices: f_o of Theorem 2, or V."""
    fidelity = result.settings["fidelity"]
    chosen = result.trees["accepted"]
    if not len(chosen):
        return None
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(MOST_VERTICES, len(chosen))).astype(int)]
    faults = []
    for j, v in chosen.tolist():
        x = vertex_path(result, j, v)
        risk = result.trees[f"{tree_names(result)[j]}/risk"][v]
        columns = len(risk) - int(np.asarray(result.trees.get("collision_columns", 0)).item())
        course = laws.fly_means(result.law(result.planned_law, len(x) - 1), x)
        computed = (
            result.mission_bound(course)
            if fidelity["mission_bound"] == "ordered"
            else theorem2(result.visited, x, course.cov, result.letters_along(result.ground.labels(x)))
        )
        stated = min(float(risk[:columns].sum()), 1.0)
        if not close(stated, computed, RISK, LEAST_RISK):
            faults.append(f"tree {j} vertex {v}: {risk[:columns].sum():.4g} is {computed:.4g}")
    return no_fault(f"{len(chosen)} accepted vertices", faults)


TREES = ("trees.npz", "cells.json", "automaton.json", "scene.json")
WORLD = (*TREES, "wind.nc")
CLAIMS = (
    Claim("trees: numbers of vertices", ("trees.npz",), vertices),
    Claim("trees: vertices follow their parents", TREES, links),
    Claim("trees: airspeed of edges", WORLD, airspeeds),
    Claim("trees: accepted vertices", TREES, accepted),
    Claim("trees: risks of vertices", WORLD, vertex_risks),
)
