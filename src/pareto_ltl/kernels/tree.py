"""Growth of one search tree: Algorithms 1 and 2 of the paper."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from pareto_ltl.kernels.collision_risk import pass_by
from pareto_ltl.kernels.data import Motion, Tables
from pareto_ltl.kernels.dijkstra import Heap, Product, find_lead, weigh
from pareto_ltl.kernels.gaussian import missed
from pareto_ltl.kernels.geometry import clear_faces, locate
from pareto_ltl.kernels.interpolation import airspeed, allowed, drift, spread
from pareto_ltl.kernels.jit import entry, kernel
from pareto_ltl.kernels.mission_risk import add, after, begin, read_label
from pareto_ltl.kernels.neighbours import kd_insert, kd_nearest, remember
from pareto_ltl.kernels.track import Track, advance, missing, reset
from pareto_ltl.support.arrays import Float32Array, FloatArray, Int32Array, IntArray

UInt32Array = NDArray[np.uint32]

ROUNDING = 1.0 + 1e-9  # a full step may exceed u_max by this factor and no more

# What ``Growing.tally`` counts.
VERTICES, ITERATIONS, AGE, LEAD, ACCEPTED, SWAPS = range(6)
BLOCKED, WINDBOUND, BEYOND, TRAPPED, STALLED = range(6, 11)
TALLIES = 11


class Vertices(NamedTuple):
    """One row a vertex. ``drift`` and ``spread`` (xx, xy, yy) are mean and covariance one step later with
    the motors off: they do not depend on the control, so a child costs no wind look-up. ``speed`` is the
    airspeed left for the control, ``child`` the two sons in the vertex's k-d tree. ``risk`` holds f_o^i of
    every proposition (paper), or V of the vertex's own state and R (full).

    Paper fidelity keeps in ``masks`` the faces of each obstacle that the vertex clears. Full fidelity keeps
    its own covariance ``cov``, V of every state in ``bound`` (N, Q), the separating faces of the step to it
    in ``face`` (N, m) and the runs of such steps in ``run`` (N, m, 3), and in ``track`` what the coherent
    law of its children starts from. What a fidelity does not use has no rows.
    """

    x: FloatArray
    drift: FloatArray
    spread: FloatArray
    length: FloatArray
    risk: FloatArray
    parent: Int32Array
    step: Int32Array
    q: Int32Array
    cell: Int32Array
    child: Int32Array
    masks: UInt32Array
    speed: FloatArray
    cov: FloatArray
    bound: FloatArray
    face: Int32Array
    run: Float32Array
    track: Track


class Growing(NamedTuple):
    """What changes while a tree grows, besides its vertices."""

    root: IntArray  # (Z,) top of each state's k-d tree
    members: IntArray  # (Z,) vertices in Γ_z
    selected: IntArray  # (Z,) times z was expanded
    weight: FloatArray  # (Z,)
    lead: IntArray  # (Z,)
    heap: Heap
    kept: IntArray  # (squares * Q, capacity) possible parents
    pool: IntArray  # (near,) scratch: the ones tried
    seen: IntArray  # (squares * Q,)
    swaps: FloatArray  # (S, 2, 2 + P) record of re-selections, S may be 0
    tally: IntArray  # (TALLIES,)
    stack: FloatArray  # (depth, 4)
    masks: IntArray  # (2, m) scratch: the proposal's and the best one's
    risks: FloatArray  # (3, P) scratch: the proposal's, the best one's, the original parent's
    bounds: FloatArray  # (2, Q) scratch: V of the proposal and of the best one
    faces: Int32Array  # (2, m) scratch: their separating faces
    runs: Float32Array  # (2, m, 3) scratch: what the runs of steps with these faces cost
    labels: FloatArray  # (L + 1,) scratch: P(label)


class Habits(NamedTuple):
    """How a tree grows: grid of squares for parents, slack of Eq. (11), targets, when to stop."""

    west: float
    south: float
    per_metre: float
    columns: int
    rows: int
    beta_length: float
    beta_risk: float
    tchebycheff: bool
    per_length: float  # one over the length scale of the Tchebycheff sum [1/m]
    weight: FloatArray  # (3,) of log V, log R and length in it
    reselect: bool
    explore: float
    refresh: int
    max_steps: int
    stop_at_first: bool


class Fans(NamedTuple):
    """Cells as fans of triangles: ``share`` is the running sum of areas within a cell, ending at 1."""

    ptr: IntArray
    corner: FloatArray  # (T, 3, 2)
    share: FloatArray


@kernel
def sample_cell(fans: Fans, cell: int, rng: Generator) -> tuple[float, float]:
    """A uniform point of a cell."""
    pick = rng.random()
    k = fans.ptr[cell]
    while k + 1 < fans.ptr[cell + 1] and fans.share[k] < pick:
        k += 1
    a, b = rng.random(), rng.random()
    if a + b > 1.0:
        a, b = 1.0 - a, 1.0 - b
    c = fans.corner
    return (
        c[k, 0, 0] + a * (c[k, 1, 0] - c[k, 0, 0]) + b * (c[k, 2, 0] - c[k, 0, 0]),
        c[k, 0, 1] + a * (c[k, 1, 1] - c[k, 0, 1]) + b * (c[k, 2, 1] - c[k, 0, 1]),
    )


@kernel
def steer(
    motion: Motion, x: FloatArray, free: FloatArray, v: int, u_max: float, px: float, py: float
) -> tuple[float, float, bool]:
    """The farthest point from x[v] towards (px, py) that one step reaches, and whether the wind allows any.

    On the line x + s e the control is linear in s; |u(s)| = u_max is a quadratic in s.
    """
    x0, y0 = x[v, 0], x[v, 1]
    dx, dy = px - x0, py - y0
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        return px, py, False
    ex, ey = dx / distance, dy / distance
    b, dt = motion.b_inv, motion.dt
    rx, ry = x0 - free[v, 0], y0 - free[v, 1]
    cx, cy = (b[0, 0] * rx + b[0, 1] * ry) / dt, (b[1, 0] * rx + b[1, 1] * ry) / dt
    gx, gy = (b[0, 0] * ex + b[0, 1] * ey) / dt, (b[1, 0] * ex + b[1, 1] * ey) / dt
    aa, bb, cc = gx * gx + gy * gy, gx * cx + gy * cy, cx * cx + cy * cy - u_max * u_max
    disc = bb * bb - aa * cc
    if disc < 0.0:
        return px, py, False
    root = math.sqrt(disc)
    if root - bb <= 0.0:
        return px, py, False
    s = max(min(distance, (root - bb) / aa), (-root - bb) / aa)
    return x0 + s * ex, y0 + s * ey, True


@kernel
def square_of(habits: Habits, x: float, y: float) -> tuple[int, int]:
    """Column and row of a point in the grid of possible parents."""
    i = min(max(int((x - habits.west) * habits.per_metre), 0), habits.columns - 1)
    j = min(max(int((y - habits.south) * habits.per_metre), 0), habits.rows - 1)
    return i, j


@kernel
def price(
    tables: Tables, tree: Vertices, parent: int, cell: int, x: float, y: float, risks: FloatArray, r: int
) -> None:
    """Fill row r of ``risks`` with f_o^i (Theorem 1) at a child of ``parent``: the least over all visits."""
    atoms, spread = tables.cells.atoms, tree.spread
    for atom in range(risks.shape[1]):
        risk = tree.risk[parent, atom]  # -1: not visited yet, T_i is empty
        if atoms[cell, atom]:
            now = missed(tables.regions, atom, x, y, spread[parent, 0], spread[parent, 1], spread[parent, 2])
            risk = now if risk < 0.0 else min(risk, now)
        risks[r, atom] = risk


@kernel
def passes(tables: Tables, tree: Vertices, parent: int, x: float, y: float, masks: IntArray, r: int) -> bool:
    """Eq. (9) at the child and one face of every obstacle that serves both ends of the step.

    Fills row r of ``masks``."""
    xx, xy, yy = tree.spread[parent, 0], tree.spread[parent, 1], tree.spread[parent, 2]
    if not clear_faces(tables.obstacles, tables.z, x, y, xx, xy, yy, masks, r):
        return False
    cleared = tree.masks
    for j in range(masks.shape[1]):  # noqa: SIM110 (numba has no generator expressions)
        if masks[r, j] & np.int64(cleared[parent, j]) == 0:
            return False
    return True


@kernel
def appraise(
    tables: Tables, tree: Vertices, growing: Growing, parent: int, q: int, x: float, y: float, r: int,
    most: float,
) -> bool:  # fmt: skip
    """Full fidelity in place of :func:`passes` and :func:`price`: whether the step keeps to epsilon and
    delta.

    Fills row r of ``faces``, ``bounds`` and ``risks`` (V of the state ``q``, R)."""
    own, ahead = tree.cov, tree.spread
    xx, xy, yy = ahead[parent, 0], ahead[parent, 1], ahead[parent, 2]
    step, more = pass_by(
        tables.obstacles, tree.x[parent, 0], tree.x[parent, 1], own[parent, 0], own[parent, 1], own[parent,
        2], x, y, xx, xy, yy, tree.face, tree.run, parent, growing.faces, growing.runs, r,
    )  # fmt: skip
    R = tree.risk[parent, 1] + more
    if step > tables.epsilon or tables.delta < R:
        return False
    read_label(tables, x, y, xx, xy, yy, growing.labels)
    after(tables, tree.bound, parent, growing.labels, growing.bounds, r)
    add(growing.bounds, r, missing(tables, tree.track, parent, x, y, xx, xy, yy))
    growing.risks[r, 0], growing.risks[r, 1] = growing.bounds[r, q], R
    return True


@kernel
def add_vertex(
    tables: Tables, tree: Vertices, growing: Growing, habits: Habits, x: float, y: float, cell: int, q: int,
    parent: int, length: float, rng: Generator,
) -> int:  # fmt: skip
    """Store a vertex and everything its children will ask for; return its number.

    Rows 1 of ``growing.masks`` and ``growing.risks`` are its own.
    """
    v = int(growing.tally[VERTICES])
    growing.tally[VERTICES] += 1
    step = tree.step[parent] + 1
    tree.x[v, 0], tree.x[v, 1] = x, y
    tree.parent[v], tree.step[v], tree.q[v], tree.cell[v] = parent, step, q, cell
    tree.length[v] = length
    for atom in range(tree.risk.shape[1]):
        tree.risk[v, atom] = growing.risks[1, atom]
    for j in range(tree.masks.shape[1]):
        tree.masks[v, j] = growing.masks[1, j]
    tree.child[v, 0], tree.child[v, 1] = -1, -1
    if tables.full:
        for p in range(tree.bound.shape[1]):
            tree.bound[v, p] = growing.bounds[1, p]
        for j in range(tree.face.shape[1]):
            tree.face[v, j] = growing.faces[1, j]
            for i in range(3):
                tree.run[v, j, i] = growing.runs[1, j, i]
    if tables.logic.distance[q] == 0.0:
        growing.tally[ACCEPTED] += 1
        return v
    look_ahead(
        tables, tree, v, parent, tree.spread[parent, 0], tree.spread[parent, 1], tree.spread[parent, 2]
    )
    file_vertex(tree, growing, habits, v, len(tables.cells.faces.ptr) - 1, len(tables.logic.distance), rng)
    return v


@kernel
def look_ahead(
    tables: Tables, tree: Vertices, v: int, parent: int, cxx: float, cxy: float, cyy: float
) -> None:
    """Mean and covariance one step after ``v``, whose own covariance is given."""
    x, y, step = (
        tree.x[v, 0],
        tree.x[v, 1],
        int(np.int64(tree.step[v])),
    )  # one type, or every helper compiles twice
    if tables.full:
        tree.cov[v, 0], tree.cov[v, 1], tree.cov[v, 2] = cxx, cxy, cyy
        fx, fy, xx, xy, yy, speed = advance(tables, tree.track, step, x, y, cxx, cxy, cyy, parent, v)
    else:
        share = tables.motion.gain * tables.motion.gain
        speed = allowed(tables.motion, share * cxx, share * cxy, share * cyy)
        fx, fy = drift(tables.wind, tables.motion, step, x, y)
        xx, xy, yy = spread(tables.wind, tables.motion, step, x, y, cxx, cxy, cyy)
    tree.drift[v, 0], tree.drift[v, 1], tree.speed[v] = fx, fy, speed
    tree.spread[v, 0], tree.spread[v, 1], tree.spread[v, 2] = xx, xy, yy


@kernel
def file_vertex(
    tree: Vertices, growing: Growing, habits: Habits, v: int, cells: int, states: int, rng: Generator
) -> None:
    """Make ``v`` known to both indexes."""
    z = tree.q[v] * cells + tree.cell[v]
    growing.members[z] += 1
    kd_insert(tree.x, tree.child, growing.root, z, v)
    i, j = square_of(habits, tree.x[v, 0], tree.x[v, 1])
    remember(growing.kept, growing.seen, (i * habits.rows + j) * states + tree.q[v], v, rng)


@kernel
def improves(
    distance: FloatArray, habits: Habits, risks: FloatArray, q: int, length: float,
    q0: int, length0: float, rival: int, strict_only: bool,
) -> bool:  # fmt: skip
    """Eqs. (11) and (12) of the proposal (row 0 of ``risks``) against the row ``rival``; with
    ``strict_only`` Eq. (12) alone."""
    better = distance[q] < distance[q0] or length < length0
    for i in range(risks.shape[1]):
        new, old = max(risks[0, i], 0.0), max(risks[rival, i], 0.0)
        better = better or new < old
        if not strict_only and new > old + habits.beta_risk:
            return False
    return better and (strict_only or length <= length0 + habits.beta_length)


FLOOR = 1e-6  # risks below it count as equal where their logarithms are compared


@kernel
def improves_full(
    distance: FloatArray, habits: Habits, risks: FloatArray, q: int, length: float,
    q0: int, length0: float, rival: int, strict_only: bool,
) -> bool:  # fmt: skip
    """The same in (d_A hard, log V, log R, length): slack is a factor on risks, or one Tchebycheff score
    rules.
    """
    if distance[q] != distance[q0]:
        return bool(distance[q] < distance[q0])
    if habits.tchebycheff:
        return score(habits, risks, 0, length) < score(habits, risks, rival, length0) - 1e-9
    better = length < length0 * (1.0 - 1e-9)
    for i in range(2):
        new, old = risks[0, i] + FLOOR, risks[rival, i] + FLOOR
        better = better or new < old * (1.0 - 1e-6)
        if not strict_only and new > old * (1.0 + habits.beta_risk) * (1.0 + 1e-9):
            return False
    return better and (strict_only or length <= length0 + habits.beta_length)


@kernel
def score(habits: Habits, risks: FloatArray, r: int, length: float) -> float:
    """max_i λ_i z_i + 0.05 Σ_i λ_i z_i (augmented Tchebycheff), z the scaled log V, log R and length."""
    w = habits.weight
    v = w[0] * (math.log10(risks[r, 0] + FLOOR) + 6.0) / 6.0
    c = w[1] * (math.log10(risks[r, 1] + FLOOR) + 6.0) / 6.0
    d = w[2] * length * habits.per_length
    return float(max(v, c, d) + 0.05 * (v + c + d))


@kernel
def gather(
    tables: Tables, growing: Growing, habits: Habits, x: float, y: float, cell: int, q0: int, rng: Generator
) -> int:
    """Fill ``growing.pool`` with possible parents of a vertex at (x, y); return how many.

    They come from the squares around it and from automaton states that would read the cell's label as well
    as ``q0`` or better. Where there are more than the pool holds, every (total / pool)-th is taken, from a
    random first one on: a vertex costs the same in a tree of a million as in one of ten thousand.
    """
    delta, covers, pool = tables.logic.delta, tables.logic.covers, growing.pool
    kept, arrivals = growing.kept, growing.seen
    states, capacity = len(tables.logic.distance), kept.shape[1]
    ci, cj = square_of(habits, x, y)
    west, east = max(ci - 2, 0), min(ci + 3, habits.columns)
    south, north = max(cj - 2, 0), min(cj + 3, habits.rows)
    total = 0
    for i in range(west, east):
        for j in range(south, north):
            for q in range(states):
                seen = arrivals[(i * habits.rows + j) * states + q]
                if seen > 0 and covers[delta[q, cell], q0]:
                    total += min(seen, capacity)
    stride, pick = 1.0, 0.0
    if total > len(pool):
        stride = total / len(pool)
        pick = rng.random() * stride
    passed, found = 0, 0
    for i in range(west, east):
        for j in range(south, north):
            for q in range(states):
                group = (i * habits.rows + j) * states + q
                if arrivals[group] > 0 and covers[delta[q, cell], q0]:
                    here = min(arrivals[group], capacity)
                    while pick < passed + here and found < len(pool):
                        pool[found] = kept[group, int(pick) - passed]
                        found += 1
                        pick += stride
                    passed += here
    return found


@kernel
def choose_parent(
    tables: Tables, tree: Vertices, growing: Growing, habits: Habits, x: float, y: float, cell: int,
    parent: int, q0: int, length0: float, rng: Generator,
) -> tuple[int, int, float]:  # fmt: skip
    """The lines 5 to 13 of Algorithm 2: parent, automaton state and length of the new vertex.

    A candidate must satisfy (11) and (12) against the original parent and (12) against the best so far:
    swaps judged only against the last one can end dominated. Rows 1 of ``growing.masks`` and
    ``growing.risks`` hold the original on entry and the chosen one on return.
    """
    distance, delta, motion = tables.logic.distance, tables.logic.delta, tables.motion
    risks, masks, pool = growing.risks, growing.masks, growing.pool
    full, most, proposal = tables.full, tables.delta, int(np.int64(0))
    if full and not habits.tchebycheff:
        most = min(most, (risks[1, 1] + FLOOR) * (1.0 + habits.beta_risk))
    for atom in range(risks.shape[1]):
        risks[2, atom] = risks[1, atom]
    best, best_q, best_length = parent, q0, length0
    for k in range(gather(tables, growing, habits, x, y, cell, q0, rng)):
        near = pool[k]
        if near == parent:
            continue
        dx, dy = x - tree.x[near, 0], y - tree.x[near, 1]
        length = tree.length[near] + math.sqrt(dx * dx + dy * dy)
        if length > length0 + habits.beta_length:
            continue
        ux, uy = x - tree.drift[near, 0], y - tree.drift[near, 1]
        if airspeed(motion, ux, uy) > tree.speed[near] * ROUNDING:
            continue
        q = delta[tree.q[near], cell]
        if not in_time(tables, habits, tree.step[near] + 1, q):
            continue
        if full:
            if tree.risk[near, 1] > most:  # R never falls along an edge
                continue
            if not appraise(tables, tree, growing, near, q, x, y, proposal, most):
                continue
            if not improves_full(distance, habits, risks, q, length, q0, length0, 2, False):
                continue
            if best == parent or improves_full(
                distance, habits, risks, q, length, best_q, best_length, 1, True
            ):
                best, best_q, best_length = near, q, length
                adopt(growing)
            continue
        price(tables, tree, near, cell, x, y, risks, proposal)
        if not improves(distance, habits, risks, q, length, q0, length0, 2, False):
            continue
        if best != parent and not improves(distance, habits, risks, q, length, best_q, best_length, 1, True):
            continue
        if passes(tables, tree, near, x, y, masks, proposal):
            best, best_q, best_length = near, q, length
            for atom in range(risks.shape[1]):
                risks[1, atom] = risks[0, atom]
            for o in range(masks.shape[1]):
                masks[1, o] = masks[0, o]
    return best, best_q, best_length


@kernel
def adopt(growing: Growing) -> None:
    """Full fidelity: the proposal becomes the best one."""
    for i in range(growing.risks.shape[1]):
        growing.risks[1, i] = growing.risks[0, i]
    for p in range(growing.bounds.shape[1]):
        growing.bounds[1, p] = growing.bounds[0, p]
    for j in range(growing.faces.shape[1]):
        growing.faces[1, j] = growing.faces[0, j]
        for i in range(3):
            growing.runs[1, j, i] = growing.runs[0, j, i]


@kernel
def in_time(tables: Tables, habits: Habits, step: int, q: int) -> bool:
    """Whether a vertex at ``step`` is of use: the wind is known there, or nothing follows it."""
    last = min(len(tables.wind.slot), habits.max_steps)
    return step < last or (step == last and tables.logic.distance[q] == 0.0)


@kernel
def note_swap(tables: Tables, growing: Growing, q0: int, length0: float, q: int, length: float) -> None:
    """Record a re-selection for the check of Theorems 4 and 5."""
    risks = growing.risks
    row = growing.tally[SWAPS]
    growing.tally[SWAPS] += 1
    if row < len(growing.swaps):
        growing.swaps[row, 0, 0], growing.swaps[row, 1, 0] = (
            tables.logic.distance[q0],
            tables.logic.distance[q],
        )
        growing.swaps[row, 0, 1], growing.swaps[row, 1, 1] = length0, length
        for i in range(risks.shape[1]):
            growing.swaps[row, 0, 2 + i] = max(risks[2, i], 0.0)
            growing.swaps[row, 1, 2 + i] = max(risks[1, i], 0.0)


@kernel
def extend(
    tables: Tables, tree: Vertices, growing: Growing, habits: Habits, v: int, px: float, py: float,
    limit: int, rng: Generator,
) -> None:  # fmt: skip
    """Walk from ``v`` towards a point; stop at the first step that is infeasible (Section IV-C)."""
    tally = growing.tally
    while tally[VERTICES] < limit:
        x, y, moved = steer(tables.motion, tree.x, tree.drift, v, tree.speed[v], px, py)
        if not moved:
            tally[WINDBOUND] += 1
            return
        cell = locate(tables.cells, x, y)
        if cell < 0:
            tally[BLOCKED] += 1
            return
        q = tables.logic.delta[tree.q[v], cell]
        if tables.logic.distance[q] == math.inf:
            tally[TRAPPED] += 1
            return
        if not in_time(tables, habits, tree.step[v] + 1, q):
            tally[BEYOND] += 1
            return
        if tables.full:
            clear = appraise(tables, tree, growing, v, q, x, y, int(np.int64(1)), tables.delta)
        else:
            clear = passes(tables, tree, v, x, y, growing.masks, int(np.int64(1)))
        if not clear:
            tally[BLOCKED] += 1
            return
        dx, dy = x - tree.x[v, 0], y - tree.x[v, 1]
        length = tree.length[v] + math.sqrt(dx * dx + dy * dy)
        if not tables.full:
            price(tables, tree, v, cell, x, y, growing.risks, int(np.int64(1)))
        parent = v
        if habits.reselect:
            parent, q_new, length_new = choose_parent(
                tables, tree, growing, habits, x, y, cell, v, q, length, rng
            )
            if parent != v:
                note_swap(tables, growing, q, length, q_new, length_new)
                q, length = q_new, length_new
        v = add_vertex(tables, tree, growing, habits, x, y, cell, q, parent, length, rng)
        if tables.logic.distance[q] == 0.0 or (x == px and y == py):
            return


@kernel
def pick_state(growing: Growing, rng: Generator) -> int:
    """Position on the lead of the state to expand, -1 where the tree has none of them.

    Candidates are the occupied states taken backwards from the end of the lead, with probability 1/2 of
    stopping after each; one is drawn with probability proportional to its weight (reservoir of one).
    """
    total, chosen = 0.0, -1
    for i in range(growing.tally[LEAD] - 2, -1, -1):
        z = growing.lead[i]
        if growing.members[z] == 0:
            continue
        total += growing.weight[z]
        if rng.random() * total < growing.weight[z]:
            chosen = i
        if rng.random() < 0.5:
            break
    return chosen


@kernel
def pick_point(
    tables: Tables, growing: Growing, habits: Habits, fans: Fans, position: int, rng: Generator
) -> tuple[float, float]:
    """A target in the successor on the lead; sometimes in a later state, sometimes anywhere."""
    cells = len(tables.cells.faces.ptr) - 1
    target = position + 1
    if rng.random() < habits.explore:
        if rng.random() < 0.5:
            c = tables.cells
            return c.west + rng.random() * (c.east - c.west), c.south + rng.random() * (c.north - c.south)
        target += int(rng.random() * (growing.tally[LEAD] - target))
    return sample_cell(fans, growing.lead[target] % cells, rng)


@entry
def grow(
    tables: Tables, product: Product, fans: Fans, habits: Habits, tree: Vertices, growing: Growing,
    limit: int, iterations: int, rng: Generator,
) -> None:  # fmt: skip
    """Grow until ``limit`` vertices or ``iterations`` extensions in all; can be called again to go on."""
    tally = growing.tally
    cells = len(tables.cells.faces.ptr) - 1
    start = tree.q[0] * cells + tree.cell[0]
    while tally[VERTICES] < limit and tally[ITERATIONS] < iterations:
        if tally[AGE] % habits.refresh == 0:
            weigh(product, growing.members, growing.selected, growing.weight)
            tally[LEAD] = find_lead(product, growing.weight, start, growing.heap, growing.lead)
        tally[AGE] += 1
        tally[ITERATIONS] += 1
        position = pick_state(growing, rng)
        if position < 0:
            tally[STALLED] += 1
            return
        z = growing.lead[position]
        growing.selected[z] += 1
        px, py = pick_point(tables, growing, habits, fans, position, rng)
        before = tally[VERTICES]
        v = kd_nearest(tree.x, tree.child, growing.root, z, px, py, growing.stack)
        extend(tables, tree, growing, habits, v, px, py, limit, rng)
        if tally[VERTICES] == before:
            # A door that the wind or Eq. (9) keeps shut: charge the far side too, so that leads go round.
            growing.selected[growing.lead[position + 1]] += 1
        if habits.stop_at_first and tally[ACCEPTED] > 0:
            return


@kernel
def plant_full(
    tables: Tables, tree: Vertices, growing: Growing, q: int, x: float, y: float, variance: float
) -> bool:
    """What the root has of full fidelity; False where it keeps not to epsilon."""
    root = int(np.int64(0))
    reset(tree.track)
    for j in range(tree.face.shape[1]):
        tree.face[0, j] = -1
        for i in range(3):
            tree.run[0, j, i] = 0.0
    step, R = pass_by(
        tables.obstacles, x, y, variance, 0.0, variance, x, y, variance, 0.0, variance, tree.face,
        tree.run, root, tree.face, tree.run, root,
    )  # fmt: skip
    begin(tables, growing.bounds, root)
    read_label(tables, x, y, variance, 0.0, variance, growing.labels)
    after(tables, growing.bounds, root, growing.labels, tree.bound, root)
    tree.risk[0, 0], tree.risk[0, 1] = tree.bound[0, q], R
    return step <= tables.epsilon


@entry
def plant(
    tables: Tables,
    habits: Habits,
    tree: Vertices,
    growing: Growing,
    x: float,
    y: float,
    variance: float,
    rng: Generator,
) -> bool:
    """Make the root. False where the start itself violates Eq. (9)."""
    root = int(np.int64(0))  # a literal 0 would be a type of its own, and all below compiled for it
    cell = locate(tables.cells, x, y)
    if not tables.full and not clear_faces(
        tables.obstacles, tables.z, x, y, variance, 0.0, variance, growing.masks, 1
    ):
        return False
    q = tables.logic.delta[tables.logic.initial, cell]
    tree.x[0, 0], tree.x[0, 1] = x, y
    tree.parent[0], tree.step[0], tree.q[0], tree.cell[0] = -1, 0, q, cell
    tree.length[0] = 0.0
    for j in range(tree.masks.shape[1]):
        tree.masks[0, j] = growing.masks[1, j]
    if tables.full:
        if not plant_full(tables, tree, growing, q, x, y, variance):
            return False
    else:
        for atom in range(tree.risk.shape[1]):
            tree.risk[0, atom] = -1.0
            if tables.cells.atoms[cell, atom]:
                tree.risk[0, atom] = missed(tables.regions, atom, x, y, variance, 0.0, variance)
    tree.child[0, 0], tree.child[0, 1] = -1, -1
    growing.tally[VERTICES] = 1
    if tables.logic.distance[q] == 0.0:
        growing.tally[ACCEPTED] = 1
    if len(tables.wind.slot) > 0:
        look_ahead(tables, tree, root, root, variance, 0.0, variance)
    file_vertex(tree, growing, habits, root, len(tables.cells.faces.ptr) - 1, len(tables.logic.distance), rng)
    return True
