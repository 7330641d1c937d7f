"""Growth of one search tree: Algorithm 1 of the paper."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from pareto_ltl.kernels.data import Gaussian, Logic, Point
from pareto_ltl.kernels.dijkstra import Product, find_lead
from pareto_ltl.kernels.geometry import locate_cell
from pareto_ltl.kernels.jit import entry, inlined, kernel
from pareto_ltl.kernels.letters import epoch_at, next_state, reading_at
from pareto_ltl.kernels.neighbours import kd_nearest
from pareto_ltl.kernels.propagation import airspeed, forget, least_airspeed
from pareto_ltl.kernels.tree import (
    ACCEPTED,
    AGE,
    BEST,
    BEYOND,
    BLOCKED,
    ENDED,
    ITERATIONS,
    LEAD,
    STALLED,
    TRAPPED,
    VERTICES,
    WINDBOUND,
    Search,
    add_vertex,
    choose_parent,
    distance,
    file_vertex,
    in_time,
    look_ahead,
    note_swap,
    passed,
    propose,
    steer,
    vertex_point,
)
from pareto_ltl.kernels.tree_models import (
    appraise_collision,
    appraise_mission,
    plant_collision,
    plant_mission,
)
from pareto_ltl.support.arrays import FloatArray, IntArray


class Fans(NamedTuple):
    """Cells as fans of triangles: ``share`` is the running sum of areas within a cell, ending at 1."""

    ptr: IntArray
    corner: FloatArray  # (T, 3, 2)
    share: FloatArray


@kernel
def sample_cell(fans: Fans, cell: int, rng: Generator) -> Point:
    """A uniform point of a cell."""
    pick = rng.random()
    k = fans.ptr[cell]
    while k + 1 < fans.ptr[cell + 1] and fans.share[k] < pick:
        k += 1
    a, b = rng.random(), rng.random()
    if a + b > 1.0:
        a, b = 1.0 - a, 1.0 - b
    c = fans.corner
    return Point(
        c[k, 0, 0] + a * (c[k, 1, 0] - c[k, 0, 0]) + b * (c[k, 2, 0] - c[k, 0, 0]),
        c[k, 0, 1] + a * (c[k, 1, 1] - c[k, 0, 1]) + b * (c[k, 2, 1] - c[k, 0, 1]),
    )


@kernel
def extend(s: Search, fans: Fans, v: int, target: Point, limit: int, rng: Generator) -> None:
    """Walk from ``v`` towards a point; stop at the first step that is infeasible (Section IV-C).

    Where a place may be entered later than now, the robot waits: in front of one that is closed, half of the
    times, and within one that is to be visited.
    """
    world, tree, state = s.world, s.tree, s.state
    tally = state.tally
    while tally[VERTICES] < limit:
        start, free = vertex_point(tree, v), Point(tree.free[v, 0], tree.free[v, 1])
        there, moved = steer(world.law.motion, start, free, tree.speed[v], target)
        if not moved:
            tally[WINDBOUND] += 1
            return
        cell = locate_cell(world.cells, there)
        if cell < 0:
            tally[BLOCKED] += 1
            return
        read = reading_at(world.logic, int(tree.step[v]) + 1)
        q = next_state(world.cells, read, tree.q[v], start, tree.cell[v], there, cell)
        if read.distance[q] == math.inf:
            tally[TRAPPED] += 1
            last = len(world.logic.epoch) - 1 if rng_waits(world.logic, rng) else 0
            until = next_opening(world.logic, tree.q[v], cell, tree.step[v] + 1, last)
            v = wait(s, fans, v, until, limit, rng)
            if until < 0 or tree.step[v] + 1 < until:
                return
            continue
        grown = step_on(s, v, there, cell, q, s.settings.reselect, rng)
        if grown < 0:
            return
        v = grown
        if world.logic.distance[tree.q[v]] == 0.0:
            return
        if there.x == target.x and there.y == target.y:
            until = next_visit(world.logic, tree.q[v], cell, tree.step[v] + 1)
            wait(s, fans, v, until + 1, limit, rng)
            return
        if world.law.motion.u_min > 0.0 and passed(start, there, target):
            return


@kernel
def step_on(s: Search, v: int, there: Point, cell: int, q: int, reselect: bool, rng: Generator) -> int:
    """Add a vertex one step after ``v``, or after a better parent; its number, -1 where there can be none."""
    world, tree, state, best = s.world, s.tree, s.state, int(np.int64(BEST))
    if not in_time(s, tree.step[v] + 1, q):
        state.tally[BEYOND] += 1
        return -1
    new = propose(s, v, there, cell, q, best)
    if not appraise_collision(world.collision, tree, state, new):
        state.tally[BLOCKED] += 1
        return -1
    appraise_mission(world.mission, tree, state, new)
    length = tree.length[v] + distance(vertex_point(tree, v), there)
    parent = int(np.int64(v))
    if reselect:
        parent, q_new, length_new = choose_parent(s, new, length, rng)
        if parent != v:
            note_swap(s, q, length, q_new, length_new)
            q, length = q_new, length_new
    return add_vertex(s, there, cell, q, parent, length, rng)


# --- waiting for a time window ----------------------------------------------------------------


@inlined
def rng_waits(logic: Logic, rng: Generator) -> bool:
    """Half of the times where there are time windows."""
    return len(logic.delta) > 1 and rng.random() < 0.5


@kernel
def next_opening(logic: Logic, q: int, cell: int, step: int, last: int) -> int:
    """The first step from ``step`` to ``last`` on at which a cell may be entered in state q; -1: never."""
    for t in range(step, last + 1):
        e = epoch_at(logic.epoch, t)
        if logic.ahead[e, logic.delta[e, q, cell]] < math.inf and not logic.harm[e, q, cell]:
            return t
    return -1


@kernel
def next_visit(logic: Logic, q: int, cell: int, step: int) -> int:
    """The first step from ``step`` on at which the label of a cell brings state q nearer to acceptance;
    -1: never. Only time windows make it change its mind."""
    if len(logic.delta) > 1:
        for t in range(step, len(logic.epoch)):
            if logic.distance[logic.delta[epoch_at(logic.epoch, t), q, cell]] < logic.distance[q]:
                return t
    return -1


@kernel
def wait(s: Search, fans: Fans, v: int, until: int, limit: int, rng: Generator) -> int:
    """Stay about where ``v`` is until the step before ``until``; the last vertex.

    A robot that cannot stand still flies to and fro in the cell. Waiting vertices keep their parents: a
    shorter way to the same place would arrive too early again.
    """
    world, tree, tally = s.world, s.tree, s.state.tally
    while tree.step[v] + 1 < until and tally[VERTICES] < limit:
        here, free, cell = vertex_point(tree, v), Point(tree.free[v, 0], tree.free[v, 1]), tree.cell[v]
        flown = airspeed(world.law.motion, here.x - free.x, here.y - free.y)
        there = here
        if flown > tree.speed[v] or flown < least_airspeed(world.law.motion, tree.speed[v]):
            target = sample_cell(fans, cell, rng)
            there, moved = steer(world.law.motion, here, free, tree.speed[v], target)
            if not moved or locate_cell(world.cells, there) != cell:
                return v
        read = reading_at(world.logic, int(tree.step[v]) + 1)
        q = next_state(world.cells, read, tree.q[v], here, cell, there, cell)
        grown = -1 if read.distance[q] == math.inf else step_on(s, v, there, cell, q, False, rng)
        if grown < 0:
            return v
        v = grown
    return v


@inlined
def pick_state(s: Search, rng: Generator) -> int:
    """Position on the lead of the state to expand, -1 where the tree has none of them.

    Candidates are the occupied states taken backwards from the end of the lead, with probability 1/2 of
    stopping after each; one is drawn with probability proportional to its weight (reservoir of one).
    """
    state = s.state
    total, chosen = 0.0, -1
    for i in range(state.tally[LEAD] - 2, -1, -1):
        z = state.lead[i]
        if state.members[z] == 0:
            continue
        total += state.weight[i]
        if rng.random() * total < state.weight[i]:
            chosen = i
        if rng.random() < 0.5:
            break
    return chosen


@inlined
def pick_target(s: Search, fans: Fans, position: int, rng: Generator) -> Point:
    """A target in the successor on the lead; sometimes in a later state, sometimes anywhere."""
    c, state = s.world.cells, s.state
    cells = len(c.faces.ptr) - 1
    after = position + 1
    if rng.random() < s.settings.explore:
        if rng.random() < 0.5:
            x = c.west + rng.random() * (c.east - c.west)
            return Point(x, c.south + rng.random() * (c.north - c.south))
        after += int(rng.random() * (state.tally[LEAD] - after))
    return sample_cell(fans, state.lead[after] % cells, rng)


@kernel
def plant(s: Search, here: Gaussian, rng: Generator) -> bool:
    """Make the root. Returns False where the start itself breaks the chance constraint."""
    world, tree, state = s.world, s.tree, s.state
    root = int(np.int64(0))  # a literal 0 would be a type of its own, and all below compiled for it
    cell = locate_cell(world.cells, here.mean)
    q = reading_at(world.logic, root).delta[world.logic.initial, cell]
    tree.x[0, 0], tree.x[0, 1] = here.mean
    tree.parent[0], tree.step[0], tree.q[0], tree.cell[0] = -1, 0, q, cell
    tree.length[0] = 0.0
    tree.child[0, 0], tree.child[0, 1] = -1, -1
    tree.spread[-1, 0], tree.spread[-1, 1], tree.spread[-1, 2] = here.cov
    forget(world.law, tree.memory)
    if not plant_collision(world.collision, tree, here):
        return False
    plant_mission(world.mission, tree, state, here)
    state.tally[VERTICES] = 1
    if world.logic.distance[q] == 0.0:
        state.tally[ACCEPTED] = 1
    if len(world.law.wind.slot) > 0:
        look_ahead(s, root, root, here.cov)
    file_vertex(s, root, rng)
    return True


@entry
def grow(
    s: Search, product: Product, fans: Fans, root: Gaussian, limit: int, iterations: int, rng: Generator
) -> None:  # fmt: skip
    """Grow until ``limit`` vertices or ``iterations`` extensions in all; can be called again to go on.

    A tree without vertices is planted first, and stays without where the start breaks the chance constraint.
    Another thread ends growth by ``state.tally[ENDED]``. It is one entry, since every entry of a tree costs
    6 s of compilation, most of it for reading the many arrays from Python.
    """
    tree, state = s.tree, s.state
    tally = state.tally
    if tally[VERTICES] == 0 and not plant(s, root, rng):
        return
    cells = len(s.world.cells.faces.ptr) - 1
    start = tree.q[0] * cells + tree.cell[0]
    while tally[VERTICES] < limit and tally[ITERATIONS] < iterations and tally[ENDED] == 0:
        if tally[AGE] % s.settings.refresh == 0:
            tally[LEAD] = find_lead(
                product, state.members, state.selected, start, state.heap, state.lead, state.weight
            )
        tally[AGE] += 1
        tally[ITERATIONS] += 1
        position = pick_state(s, rng)
        if position < 0:
            tally[STALLED] += 1
            return
        z = state.lead[position]
        state.selected[z] += 1
        target = pick_target(s, fans, position, rng)
        before = tally[VERTICES]
        v = kd_nearest(tree.x, tree.child, state.root, z, target, state.stack)
        extend(s, fans, v, target, limit, rng)
        if tally[VERTICES] == before:
            # A door that the wind or Eq. (9) keeps shut: charge the far side too, so that leads go round.
            state.selected[state.lead[position + 1]] += 1
        if s.settings.stop_at_first and tally[ACCEPTED] > 0:
            return
