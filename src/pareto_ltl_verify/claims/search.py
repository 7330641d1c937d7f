"""Claims about the search trees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl_verify.arrays import FloatArray, IntArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, same, true_of
from pareto_ltl_verify.claims.plan import FAST, LEAST_RISK, RISK
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import Legs
from pareto_ltl_verify.geometry import Convex, convex

MAX_VERTICES = 20  # accepted vertices whose risks are computed again


def tree_names(result: Evidence) -> list[str]:
    """Names of the trees in ``trees.npz``."""
    return sorted({name.partition("/")[0] for name in result.trees if "/" in name})


def _arrays(result: Evidence, tree: str, *keys: str) -> Iterator[NDArray[Any]]:
    return (result.trees[f"{tree}/{key}"] for key in keys)


def vertices(result: Evidence) -> Verdict:
    """The numbers of trees, vertices and accepted vertices agree with the metrics."""
    names, settings = tree_names(result), result.settings["planner"]
    sizes = [len(result.trees[f"{name}/parent"]) for name in names]
    computed = [len(names), sum(sizes), len(result.trees["accepted"])]
    stated = [int(result.metrics[name]) for name in ("trees", "nodes", "accepted_nodes")]
    if stated != computed:
        return same(stated, computed)
    faults = {
        "planner.trees": len(names) != settings["trees"],
        "planner.n_max": any(size > settings["n_max"] for size in sizes),
    }
    return no_fault(f"{computed[0]} trees, {computed[1]} vertices", faults)


def links(result: Evidence) -> Verdict:
    """Step, length, cell and automaton state of every vertex follow from its parent, an earlier vertex."""
    cells = [convex(cell) for cell in result.cells["cells"]]
    letters = cache(partial(result.letter_numbers, result.cells["labels"]))
    faults = (
        f"{name}: {fault}"
        for name in tree_names(result)
        for fault in _link_faults(result, name, cells, letters)
    )
    return no_fault("parents, steps, lengths, cells, states", faults)


def _link_faults(
    result: Evidence, name: str, cells: list[Convex], letters: Callable[[frozenset[str]], IntArray]
) -> Iterator[str]:
    x, parent, step, q, cell, length = _arrays(result, name, "x", "parent", "step", "q", "cell", "length")
    delta, own, before = np.array(result.dfa.delta), np.arange(1, len(parent)), parent[1:]
    if parent[0] != -1 or not ((before >= 0) & (before < own)).all():
        yield "a parent is not an earlier vertex"
        return
    if not ((cell >= 0) & (cell < len(cells))).all():
        yield "a vertex is in no cell"
        return
    table, after = result.timetable, np.empty(len(own), int)
    for t in np.unique(step[1:]).tolist():
        new = np.flatnonzero(step[1:] == t)
        source, target = before[new], own[new]
        first, last = letters(table.now(t - 1)), letters(table.now(t))
        legs = Legs(x[source], x[target], first[cell[source]], last[cell[target]])
        after[new] = result.ground.after_step(q[source], legs, holding=table.way(t))
    root = delta[result.dfa.initial, letters(table.now(0))[cell[0]]]
    gap = np.abs(length[1:] - length[before] - np.linalg.norm(x[1:] - x[before], axis=1))
    faults = {
        "the root is not the start": np.abs(x[0] - result.start).max() > result.grain or step[0] or length[0],
        "a step does not follow the step of its parent": (step[1:] != step[before] + 1).any(),
        "a length is not the length of its path": gap.max(initial=0.0) > 1e-9 * max(length.max(), 1.0),
        "a state does not follow from the label": q[0] != root or (q[1:] != after).any(),
    }
    yield from true_of(faults)
    for k, polygon in enumerate(cells):
        if (polygon.depth(x[cell == k]) < -result.grain).any():
            yield f"a vertex is not in its cell {k}"


def _can_fly_trees(result: Evidence) -> bool:
    """Whether motion and wind law of the trees are known: without a plan an open step is not."""
    return result.grown_as_published and (not result.step_is_open or result.has("plan.json"))


def airspeeds(result: Evidence) -> Verdict | None:
    """Every edge can be flown with u_min to u_max in the expected wind."""
    if not _can_fly_trees(result):
        return None
    robot, worst, least = result.robot, 0.0, math.inf
    trees = [tuple(_arrays(result, name, "x", "parent", "step")) for name in tree_names(result)]
    law = result.law("independent", max(int(step.max()) for _, _, step in trees))
    for x, parent, step in trees:
        for t in range(int(step.max())):
            new = np.flatnonzero(step == t + 1)
            here = x[parent[new]]
            left = (x[new] - here @ robot.a.T) / robot.dt - law.wind_at(t, here)[0]
            speed = np.linalg.norm(np.linalg.solve(robot.b, left.T), axis=0)
            worst = max(worst, float(speed.max(initial=0.0)))
            least = min(least, float(speed.min(initial=math.inf)))
    return Verdict(
        f"{robot.u_min:g} to {robot.u_max:g} m/s",
        f"{least:.6g} to {worst:.6g} m/s",
        worst <= robot.u_max * (1 + FAST) and least >= robot.u_min * (1 - FAST),
    )


def accepted(result: Evidence) -> Verdict:
    """The accepted vertices are exactly those in an accepting state of the automaton."""
    done, names = np.array(result.dfa.accepting), tree_names(result)
    computed = {
        (j, v) for j, name in enumerate(names)
        for v in np.flatnonzero(done[result.trees[f"{name}/q"]]).tolist()
    }  # fmt: skip
    stated = set(map(tuple, result.trees["accepted"].tolist()))
    return Verdict(f"{len(stated)} vertices", f"{len(computed)} vertices", stated == computed)


def vertex_path(result: Evidence, j: int, v: int) -> FloatArray:
    """Positions (n, 2) [m] from the root to vertex v of tree j."""
    (x, parent), rows = _arrays(result, tree_names(result)[j], "x", "parent"), [v]
    while parent[rows[-1]] >= 0:
        rows.append(int(parent[rows[-1]]))
    return np.asarray(x[rows[::-1]], float)


def vertex_risk(result: Evidence, j: int, v: int) -> float:
    """Mission risk of vertex v of tree j, at most 1."""
    return min(float(result.trees[f"{tree_names(result)[j]}/risk"][v].sum()), 1.0)


def vertex_risks(result: Evidence) -> Verdict | None:
    """The mission risk of some accepted vertices is f_o of Theorem 2."""
    chosen = result.trees["accepted"]
    if not len(chosen) or not _can_fly_trees(result):
        return None
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(MAX_VERTICES, len(chosen))).astype(int)]
    faults = []
    for j, v in chosen.tolist():
        x = vertex_path(result, j, v)
        stated = vertex_risk(result, j, v)
        computed = result.paper_bound(result.grown_course(x), result.ground.labels(x))
        if not close(stated, computed, RISK, LEAST_RISK):
            faults.append(f"tree {j} vertex {v}: {stated:.4g} is {computed:.4g}")
    return no_fault(f"{len(chosen)} accepted vertices", faults)


TREES = ("trees.npz", "cells.json", "automaton.json", "scene.json")
WORLD = (*TREES, "wind.nc")
CLAIMS: tuple[Claim, ...] = (
    Claim("trees: numbers of vertices", ("trees.npz",), vertices),
    Claim("trees: vertices follow their parents", TREES, links),
    Claim("trees: airspeed of edges", WORLD, airspeeds),
    Claim("trees: accepted vertices", TREES, accepted),
    Claim("trees: risks of vertices", WORLD, vertex_risks),
)
