"""One search tree while it grows: its vertices, steering, and the choice of parents (Algorithm 2)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from pareto_ltl.kernels.data import IndependentLaw, Motion
from pareto_ltl.kernels.motion import airspeed, independent_step, least_airspeed
from pareto_ltl.kernels.parents import Candidate, Dominance, improves
from pareto_ltl.support.arrays import FloatArray, Int32Array, IntArray
from plane_kernels.collision_risk import step_is_clear
from plane_kernels.neighbours import Bins, bin_of, kd_insert, remember
from plane_kernels.types import Cov, Gaussian, Point, StepBound
from plane_logic.dijkstra import Heap
from plane_logic.letters import epoch_at, next_state, too_late
from plane_logic.mission_risk import visit_risk
from plane_logic.types import Logic, Theorem2
from typed_kernels.jit import inlined, kernel

ROUNDING = 1.0 + 1e-9  # a full step may exceed u_max by this factor and no more
PROPOSED, BEST, ORIGINAL = range(3)  # rows of ``TreeState.risks``

# Entries of ``TreeState.tally``.
VERTICES, ITERATIONS, AGE, LEAD, ACCEPTED, SWAPS = range(6)
BLOCKED, WINDBOUND, BEYOND, TRAPPED, STALLED = range(6, 11)
ENDED = 11  # not a count: growth ends if it is not 0
TALLIES = 12


class Vertices(NamedTuple):
    """The vertices of a tree, one row each.

    ``x`` (N, 2): mean [m]. ``free`` (N, 2) and ``spread`` (N + 1, 3) = (xx, xy, yy): mean [m] and covariance
    [m²] one step later with zero airspeed. They do not depend on the control, so a child needs no wind.
    The last row of ``spread``, of parent -1, is the covariance of the root. ``length`` (N,): of the path from
    the root [m]. ``speed`` (N,): airspeed left for the control [m/s]. ``child`` (N, 2): children in the k-d
    tree of the vertex's state. ``risk`` (N, P): f_o^i of Theorem 1, -1 before the first visit.
    """

    x: FloatArray
    free: FloatArray
    spread: FloatArray
    length: FloatArray
    risk: FloatArray
    parent: Int32Array
    step: Int32Array
    q: Int32Array
    cell: Int32Array
    child: Int32Array
    speed: FloatArray


class TreeState(NamedTuple):
    """The data besides the vertices that change while a tree grows."""

    root: Int32Array  # (Z,) root of each state's k-d tree
    members: IntArray  # (Z,) number of vertices in Γ_z
    selected: IntArray  # (Z,) how often z was expanded
    weight: FloatArray  # (Z,) of the states on the lead, in their order
    lead: IntArray  # (Z,)
    heap: Heap
    bins: Bins  # candidate parents, by square and automaton state
    pool: IntArray  # (near, 2) scratch: candidate parents, and the automaton state of the child of each
    swaps: FloatArray  # (S, 2, 2 + P) record of re-selections, S may be 0
    tally: IntArray  # (TALLIES,)
    stack: FloatArray  # (depth, 4)
    risks: FloatArray  # (3, P) scratch: with the proposed, the best and the original parent


class TreeModels(NamedTuple):
    """The models of the paper, in which all trees grow: the wind law, f_o of Theorem 2, and Eq. (10)."""

    law: IndependentLaw
    mission: Theorem2
    collision: StepBound


class GrowthSettings(NamedTuple):
    """Settings of growth: grid of candidate parents, rule of re-selection, sampling, limits."""

    west: float
    south: float
    per_metre: float
    columns: int
    rows: int
    rule: Dominance
    reselect: bool
    explore: float
    refresh: int
    max_steps: int
    stop_at_first: bool


class Search(NamedTuple):
    """One tree, with the models, its state and the settings of growth."""

    world: TreeModels
    tree: Vertices
    state: TreeState
    settings: GrowthSettings


@inlined
def vertex_point(tree: Vertices, v: int) -> Point:
    """Mean position of a vertex [m]."""
    return Point(tree.x[v, 0], tree.x[v, 1])


@inlined
def child_covariance(tree: Vertices, v: int) -> Cov:
    """Covariance of every child of a vertex [m²]."""
    return Cov(tree.spread[v, 0], tree.spread[v, 1], tree.spread[v, 2])


@inlined
def distance(start: Point, end: Point) -> float:
    """Length of a straight line [m]."""
    dx, dy = end.x - start.x, end.y - start.y
    return math.sqrt(dx * dx + dy * dy)


@kernel
def steer(motion: Motion, start: Point, free: Point, speed: float, target: Point) -> tuple[Point, bool]:
    """The farthest point from ``start`` towards ``target`` that one step reaches, and whether there is one.

    ``free`` is the mean one step later with zero airspeed [m], ``speed`` the airspeed left for the control
    [m/s]. On the line x + s e the control is linear in s, so |u(s)| = speed is a quadratic equation. If
    reaching the target needs an airspeed below the smallest one, the step ends before or beyond the target,
    whichever is nearer.

    Eq. (M43) of docs/mathematics_methods.md.
    """
    least = least_airspeed(motion, speed)
    if least > speed * ROUNDING:
        return target, False
    dx, dy = target.x - start.x, target.y - start.y
    far = math.sqrt(dx * dx + dy * dy)
    if far < 1e-9:
        return target, False
    ex, ey = dx / far, dy / far
    b, dt = motion.b_inv, motion.dt
    rx, ry = start.x - free.x, start.y - free.y
    cx, cy = (b[0, 0] * rx + b[0, 1] * ry) / dt, (b[1, 0] * rx + b[1, 1] * ry) / dt
    gx, gy = (b[0, 0] * ex + b[0, 1] * ey) / dt, (b[1, 0] * ex + b[1, 1] * ey) / dt
    aa, bb, cc = gx * gx + gy * gy, gx * cx + gy * cy, cx * cx + cy * cy
    disc = bb * bb - aa * (cc - speed * speed)
    if disc < 0.0:
        return target, False
    root = math.sqrt(disc)
    if root - bb <= 0.0:
        return target, False
    s = max(min(far, (root - bb) / aa), (-root - bb) / aa)
    slow = bb * bb - aa * (cc - least * least)
    if least > 0.0 and slow > 0.0:
        s = beside_gap(s, far, (-math.sqrt(slow) - bb) / aa, (math.sqrt(slow) - bb) / aa)
    return Point(start.x + s * ex, start.y + s * ey), True


AHEAD = 1e-6  # [m] a shorter step counts as no motion, because of rounding


@inlined
def beside_gap(s: float, far: float, low: float, high: float) -> float:
    """``s``, or if it lies in the gap (``low``, ``high``), the positive end of the gap nearer to ``far``."""
    if s <= low or s >= high:
        return s
    return low if low > AHEAD and far - low <= high - far else high


@inlined
def passed(start: Point, there: Point, target: Point) -> bool:
    """Whether a step from ``start`` to ``there`` has gone beyond ``target``."""
    dx, dy = there.x - start.x, there.y - start.y
    return dx * (there.x - target.x) + dy * (there.y - target.y) > 0.0


@inlined
def square_of(settings: GrowthSettings, at: Point) -> tuple[int, int]:
    """Column and row of a point in the grid of candidate parents."""
    i = min(max(int((at.x - settings.west) * settings.per_metre), 0), settings.columns - 1)
    j = min(max(int((at.y - settings.south) * settings.per_metre), 0), settings.rows - 1)
    return i, j


@kernel
def in_time(s: Search, step: int, q: int) -> bool:
    """Whether a vertex at ``step`` is allowed: it can have children, or is accepting at the last step."""
    last = min(len(s.world.law.wind.slot), s.settings.max_steps)
    return step < last or (step == last and s.world.mission.logic.distance[q] == 0.0)


class Proposal(NamedTuple):
    """A proposed child of ``parent`` at ``there``, in ``cell`` and automaton state ``q``; scratch ``row``."""

    parent: int
    there: Gaussian
    cell: int
    q: int
    row: int


@inlined
def propose(s: Search, parent: int, there: Point, cell: int, q: int, row: int) -> Proposal:
    """A child of ``parent`` at ``there``, whose risks will be computed in scratch row ``row``."""
    here = Gaussian(there, child_covariance(s.tree, parent))
    return Proposal(parent, here, cell, q, row)


@kernel
def keeps_distance(s: Search, new: Proposal) -> bool:
    """Whether the step to a proposed child satisfies the chance constraint, Eq. (10)."""
    tree, parent = s.tree, new.parent
    here = Gaussian(vertex_point(tree, parent), child_covariance(tree, tree.parent[parent]))
    return bool(step_is_clear(s.world.collision, here, new.there))


@kernel
def appraise(s: Search, new: Proposal) -> None:
    """Compute f_o^i of a proposed child, in row ``new.row`` of the scratch."""
    bound, risks = s.world.mission, s.state.risks
    e = epoch_at(bound.logic.epoch, int(s.tree.step[new.parent]) + 1)
    for atom in range(risks.shape[1]):
        before = s.tree.risk[new.parent, atom]  # -1: not visited yet, T_i is empty
        risks[new.row, atom] = visit_risk(bound, e, atom, new.cell, new.there, before)


# --- storing a vertex -------------------------------------------------------------------------


@kernel
def add_vertex(
    s: Search, there: Point, cell: int, q: int, parent: int, length: float, rng: Generator
) -> int:  # fmt: skip
    """Store a vertex and the data that its children need; return its number.

    Its risks are taken from the scratch row ``BEST``.
    """
    world, tree, state, best = s.world, s.tree, s.state, int(np.int64(BEST))
    v = int(state.tally[VERTICES])
    state.tally[VERTICES] += 1
    tree.x[v, 0], tree.x[v, 1] = there
    tree.parent[v], tree.step[v], tree.q[v], tree.cell[v] = parent, tree.step[parent] + 1, q, cell
    tree.length[v] = length
    for i in range(tree.risk.shape[1]):
        tree.risk[v, i] = state.risks[best, i]
    tree.child[v, 0], tree.child[v, 1] = -1, -1
    if world.mission.logic.distance[q] == 0.0:
        state.tally[ACCEPTED] += 1
        return v
    look_ahead(s, v, child_covariance(tree, parent))
    file_vertex(s, v, rng)
    return v


@inlined
def look_ahead(s: Search, v: int, cov: Cov) -> None:
    """Store mean, covariance and airspeed left one step after ``v``, whose covariance is ``cov``."""
    tree = s.tree
    step = int(np.int64(tree.step[v]))  # one type, or every helper compiles twice
    ahead = independent_step(s.world.law, step, Gaussian(vertex_point(tree, v), cov))
    tree.free[v, 0], tree.free[v, 1] = ahead.mean
    tree.speed[v] = ahead.speed
    tree.spread[v, 0], tree.spread[v, 1], tree.spread[v, 2] = ahead.cov


@inlined
def file_vertex(s: Search, v: int, rng: Generator) -> None:
    """Add ``v`` to both indexes."""
    tree, state, settings = s.tree, s.state, s.settings
    cells = len(s.world.mission.cells.faces.ptr) - 1
    z = tree.q[v] * cells + tree.cell[v]
    state.members[z] += 1
    kd_insert(tree.x, tree.child, state.root, z, v)
    i, j = square_of(settings, vertex_point(tree, v))
    b = bin_of(state.bins, i * settings.rows + j, tree.q[v])
    remember(state.bins.kept, state.bins.seen, b, v, rng)


# --- re-selection of parents, lines 5 to 13 of Algorithm 2 ------------------------------------


@inlined
def may_lead(logic: Logic, q: int, cell: int, q0: int) -> bool:
    """Whether the label of a cell leads, in some epoch, from ``q`` to a state that covers ``q0``."""
    if logic.covers[logic.delta[0, q, cell], q0]:
        return True
    for e in range(1, len(logic.delta)):  # noqa: SIM110 (kernels have no generators)
        if logic.covers[logic.delta[e, q, cell], q0]:
            return True
    return False


@kernel
def gather_parents(s: Search, there: Point, cell: int, q0: int, rng: Generator) -> int:
    """Fill column 0 of ``state.pool`` with candidate parents of a vertex; return their number.

    They lie in the squares around it, in automaton states from which the cell's label leads to a state that
    covers ``q0``. If there are more than the pool can hold, every (total / pool size)-th is taken, from a
    random first one on. So the cost of a vertex does not grow with the tree.
    """
    pool, bins = s.state.pool, s.state.bins
    rows, capacity = s.settings.rows, bins.kept.shape[1]
    ci, cj = square_of(s.settings, there)
    total, listed = 0, 0
    for i in range(max(ci - 2, 0), min(ci + 3, s.settings.columns)):
        for j in range(max(cj - 2, 0), min(cj + 3, rows)):
            b = bins.head[i * rows + j]
            while b > 0:
                if may_lead(s.world.mission.logic, bins.state[b], cell, q0):
                    bins.found[listed] = b
                    listed += 1
                    total += min(bins.seen[b], capacity)
                b = bins.after[b]
    stride, pick = 1.0, 0.0
    if total > len(pool):
        stride = total / len(pool)
        pick = rng.random() * stride
    passed, found = 0, 0
    for k in range(listed):
        b = bins.found[k]
        here = min(bins.seen[b], capacity)
        while pick < passed + here and found < len(pool):
            pool[found, 0] = bins.kept[b, int(pick) - passed]
            found += 1
            pick += stride
        passed += here
    return found


@kernel
def choose_parent(s: Search, first: Proposal, length0: float, rng: Generator) -> tuple[int, int, float]:
    """Parent, automaton state and length of the new vertex, whose original parent is the parent of ``first``.

    A candidate must satisfy (11) and (12) against the original parent and (12) against the best one so far;
    if each were compared only with the last one, the result could be dominated by the original. The scratch
    row ``BEST`` holds the original parent's risks on entry and the chosen parent's on return.

    Eq. (M44) of docs/mathematics_methods.md.
    """
    world, tree, state, rule = s.world, s.tree, s.state, s.settings.rule
    logic, there = world.mission.logic, first.there.mean
    proposed, best_row, old_row = int(np.int64(PROPOSED)), int(np.int64(BEST)), int(np.int64(ORIGINAL))
    copy_risks(state.risks, best_row, old_row)
    original = Candidate(logic.distance[first.q], length0, old_row)
    best, best_q, best_length = first.parent, first.q, length0
    for k in range(shortlist(s, first, length0, gather_parents(s, there, first.cell, first.q, rng))):
        near, q = state.pool[k, 0], state.pool[k, 1]
        length = tree.length[near] + distance(vertex_point(tree, near), there)
        new = propose(s, near, there, first.cell, q, proposed)
        appraise(s, new)
        candidate = Candidate(logic.distance[q], length, proposed)
        if not improves(rule, state.risks, candidate, original, False):
            continue
        so_far = Candidate(logic.distance[best_q], best_length, best_row)
        if best != first.parent and not improves(rule, state.risks, candidate, so_far, True):
            continue
        if keeps_distance(s, new):  # last: most candidates are rejected before
            best, best_q, best_length = near, q, length
            copy_risks(state.risks, proposed, best_row)
    return best, best_q, best_length


@kernel
def shortlist(s: Search, first: Proposal, length0: float, count: int) -> int:
    """Move the candidates among the first ``count`` that can be parents to the front of the pool.

    Returns their number. The automaton state of the new vertex is stored for each.
    """
    world, tree, state, rule = s.world, s.tree, s.state, s.settings.rule
    logic, motion, there, found = world.mission.logic, world.law.motion, first.there.mean, 0
    longest = length0 + rule.beta_length
    for k in range(count):
        near = state.pool[k, 0]
        if near == first.parent:
            continue
        at = vertex_point(tree, near)
        length = tree.length[near] + distance(at, there)
        if length > longest:
            continue
        ux, uy = there.x - tree.free[near, 0], there.y - tree.free[near, 1]
        flown, left = airspeed(motion, ux, uy), tree.speed[near]
        if flown > left * ROUNDING or flown * ROUNDING < least_airspeed(motion, left):
            continue
        step = int(tree.step[near]) + 1
        q = next_state(world.mission.cells, logic, step, tree.q[near], at, tree.cell[near], there, first.cell)
        if not logic.covers[q, first.q] or too_late(logic, step, q):  # a hazard, or too late
            continue
        if not in_time(s, step, q):
            continue
        state.pool[found, 0], state.pool[found, 1] = near, q
        found += 1
    return found


@inlined
def copy_risks(risks: FloatArray, row: int, target: int) -> None:
    """Copy one scratch row of ``risks`` to another."""
    for i in range(risks.shape[1]):
        risks[target, i] = risks[row, i]


@inlined
def note_swap(s: Search, q0: int, length0: float, q: int, length: float) -> None:
    """Record a re-selection for the check of Theorems 4 and 5."""
    state, distances = s.state, s.world.mission.logic.distance
    row = state.tally[SWAPS]
    state.tally[SWAPS] += 1
    if row < len(state.swaps):
        state.swaps[row, 0, 0], state.swaps[row, 1, 0] = distances[q0], distances[q]
        state.swaps[row, 0, 1], state.swaps[row, 1, 1] = length0, length
        for i in range(state.risks.shape[1]):
            state.swaps[row, 0, 2 + i] = max(state.risks[ORIGINAL, i], 0.0)
            state.swaps[row, 1, 2 + i] = max(state.risks[BEST, i], 0.0)
