"""Growth of one search tree: Algorithm 1 of the paper."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from pareto_ltl.kernels.motion import airspeed, least_airspeed
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
    appraise,
    choose_parent,
    distance,
    file_vertex,
    in_time,
    keeps_distance,
    look_ahead,
    note_swap,
    passed,
    propose,
    steer,
    vertex_point,
)
from pareto_ltl.support.arrays import FloatArray, IntArray
from plane_kernels.collision_risk import step_is_clear
from plane_kernels.geometry import locate_cell
from plane_kernels.neighbours import kd_nearest
from plane_kernels.types import Gaussian, Point
from plane_logic.dijkstra import Product, find_lead
from plane_logic.letters import epoch_at, next_state, too_late
from plane_logic.mission_risk import visit_risk
from plane_logic.types import Logic
from typed_kernels.jit import entry, inlined, kernel


class Fans(NamedTuple):
    """Cells as fans of triangles, for sampling.

    Cell k has the triangles ``ptr[k]`` to ``ptr[k + 1]`` of ``corner`` (T, 3, 2) [m]; ``share`` (T,) is the
    cumulative share of their areas in the cell, which ends at 1.
    """

    ptr: IntArray
    corner: FloatArray  # (T, 3, 2)
    share: FloatArray


@kernel
def sample_cell(fans: Fans, cell: int, rng: Generator) -> Point:
    """Draw a point uniformly from a cell."""
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
def extend(s: Search, v: int, target: Point, until: int, limit: int, rng: Generator) -> int:
    """Add vertices from ``v`` towards ``target``, until a step is infeasible (Section IV-C).

    Returns the last vertex. Before step ``until`` the robot hovers, if it can. A vertex that waits keeps its
    parent, since a shorter path to the same position would arrive too early again.
    """
    world, tree, tally, best = s.world, s.tree, s.state.tally, int(np.int64(BEST))
    cells, logic = world.mission.cells, world.mission.logic
    while tally[VERTICES] < limit:
        start, free = vertex_point(tree, v), Point(tree.free[v, 0], tree.free[v, 1])
        there, moved = steer(world.law.motion, start, free, tree.speed[v], target)
        step = int(tree.step[v]) + 1
        waits = step < until
        if waits and stands_still(s, v):
            there, moved = start, True
        if not moved:
            tally[WINDBOUND] += 1
            return v
        cell = locate_cell(cells, there)
        if cell < 0:
            tally[BLOCKED] += 1
            return v
        q = next_state(cells, logic, step, tree.q[v], start, tree.cell[v], there, cell)
        if too_late(logic, step, q):
            tally[TRAPPED] += 1
            return v
        if not in_time(s, step, q):
            tally[BEYOND] += 1
            return v
        new = propose(s, v, there, cell, q, best)
        if not keeps_distance(s, new):
            tally[BLOCKED] += 1
            return v
        appraise(s, new)
        length = tree.length[v] + distance(start, there)
        parent = v
        if s.settings.reselect and not waits:
            parent, q_new, length_new = choose_parent(s, new, length, rng)
            if parent != v:
                note_swap(s, q, length, q_new, length_new)
                q, length = q_new, length_new
        v = add_vertex(s, there, cell, q, parent, length, rng)
        if logic.distance[q] == 0.0 or (not waits and there.x == target.x and there.y == target.y):
            return v
        if until > 0 and not waits:
            return v
        if world.law.motion.u_min > 0.0 and passed(start, there, target):
            return v
    return v


# --- waiting for a time window ----------------------------------------------------------------


class Wait(NamedTuple):
    """The next target, and the step ``until`` which to wait (0: do not wait); -1: the extension ends."""

    target: Point
    until: int


@inlined
def stands_still(s: Search, v: int) -> bool:
    """Whether the robot can hold the position of vertex ``v`` in the wind."""
    tree, motion = s.tree, s.world.law.motion
    flown = airspeed(motion, tree.x[v, 0] - tree.free[v, 0], tree.x[v, 1] - tree.free[v, 1])
    return bool(least_airspeed(motion, tree.speed[v]) <= flown <= tree.speed[v])


@kernel
def look_for_window(s: Search, fans: Fans, v: int, last: Wait, goal: Point, rng: Generator) -> Wait:
    """Decide whether to wait at ``v``, where an extension towards ``goal`` has ended; ``last`` is its wait.

    The robot waits in a cell that is to be visited later and, with probability 1/2, before a cell that may
    not be entered yet. A robot that cannot hover flies between random points of its cell.
    """
    tree, logic = s.tree, s.world.mission.logic
    q, step, cell, here = tree.q[v], int(tree.step[v]) + 1, tree.cell[v], vertex_point(tree, v)
    if logic.distance[q] == 0.0 or s.state.tally[VERTICES] >= len(tree.x):
        return Wait(goal, -1)
    if last.until > 0:  # it has waited
        if step < last.until:
            return Wait(sample_cell(fans, cell, rng), last.until if rng.random() < 0.9 else -1)
        return Wait(goal, 0)
    if here.x == goal.x and here.y == goal.y:
        return Wait(sample_cell(fans, cell, rng), next_visit(logic, q, cell, step))
    free = Point(tree.free[v, 0], tree.free[v, 1])
    there, moved = steer(s.world.law.motion, here, free, tree.speed[v], goal)
    ahead = locate_cell(s.world.mission.cells, there)
    if not moved or ahead < 0 or rng.random() < 0.5:
        return Wait(goal, -1)
    then = next_state(s.world.mission.cells, logic, step, q, here, cell, there, ahead)
    if not too_late(logic, step, then):
        return Wait(goal, -1)
    return Wait(sample_cell(fans, cell, rng), opening(logic, q, ahead, step))


@kernel
def opening(logic: Logic, q: int, cell: int, step: int) -> int:
    """The first step after ``step`` at which a cell may be entered in state q; -1 if there is none."""
    for t in range(step + 1, len(logic.epoch)):
        e = epoch_at(logic.epoch, t)
        if logic.ahead[e, logic.delta[e, q, cell]] < math.inf and not logic.harm[e, q, cell]:
            return t
    return -1


@kernel
def next_visit(logic: Logic, q: int, cell: int, step: int) -> int:
    """One more than the first step, from ``step`` on, at which a cell's label brings q closer to acceptance.

    -1 if there is none.
    """
    for t in range(step, len(logic.epoch)):
        if logic.distance[logic.delta[epoch_at(logic.epoch, t), q, cell]] < logic.distance[q]:
            return t + 1
    return -1


@inlined
def pick_state(s: Search, rng: Generator) -> int:
    """Index in the lead of the state to expand; -1 if the tree has no vertex in any of them.

    Candidates are the states with vertices, taken backwards from the end of the lead; after each, the search
    for candidates stops with probability 1/2. One of them is drawn with probability proportional to its
    weight (weighted reservoir sampling).
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
    """Draw a target from the cell of the next state on the lead.

    With probability ``explore`` it is drawn from a later state of the lead or, equally likely, from the map.
    """
    c, state = s.world.mission.cells, s.state
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
    """Make the root of the tree. Returns False if the start breaks the chance constraint."""
    world, tree, state = s.world, s.tree, s.state
    root = int(np.int64(0))  # a literal 0 has another type, for which all helpers would compile again
    cell = locate_cell(world.mission.cells, here.mean)
    q = world.mission.logic.delta[world.mission.logic.epoch[0], world.mission.logic.initial, cell]
    tree.x[0, 0], tree.x[0, 1] = here.mean
    tree.parent[0], tree.step[0], tree.q[0], tree.cell[0] = -1, 0, q, cell
    tree.length[0] = 0.0
    tree.child[0, 0], tree.child[0, 1] = -1, -1
    tree.spread[-1, 0], tree.spread[-1, 1], tree.spread[-1, 2] = here.cov
    if not step_is_clear(world.collision, here, here):
        return False
    for atom in range(tree.risk.shape[1]):
        tree.risk[0, atom] = visit_risk(world.mission, world.mission.logic.epoch[0], atom, cell, here, -1.0)
    state.tally[VERTICES] = 1
    if world.mission.logic.distance[q] == 0.0:
        state.tally[ACCEPTED] = 1
    if len(world.law.wind.slot) > 0:
        look_ahead(s, root, here.cov)
    file_vertex(s, root, rng)
    return True


@entry
def grow(
    s: Search, product: Product, fans: Fans, root: Gaussian, limit: int, iterations: int, rng: Generator
) -> None:  # fmt: skip
    """Grow the tree to ``limit`` vertices or ``iterations`` extensions in total; a further call continues.

    If the tree is empty, the root is made first; the tree stays empty if the start breaks the chance
    constraint. Another thread can end growth by ``state.tally[ENDED]``. This is the only entry for trees,
    since each is compiled with code that unpacks the many arrays from Python.
    """
    tree, state = s.tree, s.state
    tally = state.tally
    if tally[VERTICES] == 0 and not plant(s, root, rng):
        return
    cells = len(s.world.mission.cells.faces.ptr) - 1
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
        wait = Wait(target, 0)
        while wait.until >= 0:
            v = extend(s, v, wait.target, wait.until, limit, rng)
            if len(s.world.mission.logic.delta) == 1:
                break
            wait = look_for_window(s, fans, v, wait, target, rng)
        if tally[VERTICES] == before:
            # The wind or Eq. (9) blocks this edge: count its target as selected too, so that leads avoid it.
            state.selected[state.lead[position + 1]] += 1
        if s.settings.stop_at_first and tally[ACCEPTED] > 0:
            return
