"""The data of a vertex for each mission and collision bound, and the risks of a proposed vertex.

A proposed vertex is written to scratch rows, which have the same form as the rows of the tree: row 0 is the
proposal, row 1 the best one so far.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pareto_ltl.kernels.bounds import (
    CollisionBound,
    MissionBound,
    Ordered,
    PathBound,
    StepBound,
    Theorem2,
    World,
)
from pareto_ltl.kernels.collision_risk import (
    FAR_DEVIATIONS,
    leg_between,
    leg_of_start,
    pass_obstacles,
    step_is_clear,
)
from pareto_ltl.kernels.data import Cov, Gaussian, Point
from pareto_ltl.kernels.jit import by_type, implements, inlined
from pareto_ltl.kernels.letters import epoch_at
from pareto_ltl.kernels.mission_risk import read_labels, read_place, read_way, visit_risk
from pareto_ltl.kernels.ordered_bound import (
    begin_bound,
    copy_entries,
    live_value,
    note_letters,
    read_letter,
    stays,
)
from pareto_ltl.kernels.parents import Candidate, Dominance, Scaled, improves
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.tree import TreeState, Vertices


class Proposal(NamedTuple):
    """A proposed child of ``parent`` at ``there``, in ``cell`` and automaton state ``q``; scratch ``row``."""

    parent: int
    there: Gaussian
    cell: int
    q: int
    row: int


@inlined
def vertex_gaussian(tree: Vertices, v: int) -> Gaussian:
    """Mean and covariance of a vertex; all children of a parent have the same covariance."""
    spread, parent = tree.spread, tree.parent[v]
    cov = Cov(spread[parent, 0], spread[parent, 1], spread[parent, 2])
    return Gaussian(Point(tree.x[v, 0], tree.x[v, 1]), cov)


# --- mission bounds ---------------------------------------------------------------------------


@by_type
def plant_mission(bound: MissionBound, tree: Vertices, scratch: TreeState, here: Gaussian) -> None:
    """Compute the mission risk of the root at ``here``; its cell and state are already in the tree."""
    raise NotImplementedError


@by_type
def appraise_mission(bound: MissionBound, tree: Vertices, scratch: TreeState, new: Proposal) -> None:
    """Compute the mission risk of a proposal, in row ``new.row`` of the scratch."""
    raise NotImplementedError


@by_type
def keep_mission(bound: MissionBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    """Copy the memory of the bound from a scratch row to row ``target`` of ``memory``."""
    raise NotImplementedError


@implements(plant_mission, Theorem2)
def _plant_theorem2(bound: Theorem2, tree: Vertices, _scratch: TreeState, here: Gaussian) -> None:
    for atom in range(bound.holds.shape[2]):
        tree.risk[0, atom] = visit_risk(bound, bound.logic.epoch[0], atom, tree.cell[0], here, -1.0)


@implements(appraise_mission, Theorem2)
def _appraise_theorem2(bound: Theorem2, tree: Vertices, scratch: TreeState, new: Proposal) -> None:
    e = epoch_at(bound.logic.epoch, int(tree.step[new.parent]) + 1)
    for atom in range(bound.holds.shape[2]):
        before = tree.risk[new.parent, atom]  # -1: not visited yet, T_i is empty
        scratch.risks[new.row, atom] = visit_risk(bound, e, atom, new.cell, new.there, before)


@implements(keep_mission, Theorem2)
def _keep_theorem2(bound: Theorem2, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    pass


@implements(plant_mission, Ordered)
def _plant_ordered(bound: Ordered, tree: Vertices, scratch: TreeState, here: Gaussian) -> None:
    own, letters, row, q = scratch.mission, scratch.mission.letters, int(np.int64(0)), int(tree.q[0])
    letters.epoch[0] = bound.logic.epoch[0]
    begin_bound(bound, own.rows, 1)
    read_labels(bound, here, letters.seen)
    read_place(bound, here, letters.met)
    note_letters(bound, letters)
    read_letter(bound, letters, own.rows, 1, own.rows, row, q)
    own.same[row] = -1
    tree.risk[0, 0] = live_value(bound, own.rows, row, q)
    keep_mission(bound, scratch, row, tree.mission, row)


@implements(appraise_mission, Ordered)
def _appraise_ordered(bound: Ordered, tree: Vertices, scratch: TreeState, new: Proposal) -> None:
    own, before, letters = scratch.mission, tree.mission.rows, scratch.mission.letters
    letters.epoch[0] = epoch_at(bound.logic.epoch, int(tree.step[new.parent]) + 1)
    read_labels(bound, new.there, letters.seen)
    if len(letters.met) > 0:
        read_way(bound, vertex_gaussian(tree, new.parent), new.there, letters.met)
    if note_letters(bound, letters) or not stays(bound, letters, before, new.parent):
        own.same[new.row] = -1
        read_letter(bound, letters, before, new.parent, own.rows, new.row, new.q)
        scratch.risks[new.row, 0] = live_value(bound, own.rows, new.row, new.q)
    else:  # most steps: the empty letter is certain and leaves V as it is
        own.same[new.row] = new.parent
        scratch.risks[new.row, 0] = live_value(bound, before, new.parent, new.q)


@implements(keep_mission, Ordered)
def _keep_ordered(_bound: Ordered, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    own, rows = scratch.mission, memory.rows
    same = own.same[row]
    if len(memory.same) > 0:  # another scratch row
        memory.same[target] = same
        if same < 0:
            copy_entries(own.rows, row, rows, target)
    elif same >= 0:
        rows.first[target], rows.size[target] = rows.first[same], rows.size[same]
    else:
        rows.first[target] = rows.used[0]
        copy_entries(own.rows, row, rows, target)
        rows.used[0] += rows.size[target]


# --- collision bounds -------------------------------------------------------------------------


@by_type
def plant_collision(bound: CollisionBound, tree: Vertices, here: Gaussian) -> bool:
    """Compute the collision risk of the root at ``here``; False if it breaks the chance constraint."""
    raise NotImplementedError


@by_type
def appraise_collision(bound: CollisionBound, tree: Vertices, scratch: TreeState, new: Proposal) -> bool:
    """Whether a proposal satisfies the chance constraint; risk and memory are written to row ``new.row``."""
    raise NotImplementedError


@by_type
def keep_collision(bound: CollisionBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    """Copy the memory of the bound from a scratch row to row ``target`` of ``memory``."""
    raise NotImplementedError


@by_type
def collision_column(bound: CollisionBound, risks: FloatArray, row: int) -> float:
    """Collision risk in one row of ``risks``, which never decreases along an edge; 0 if there is none."""
    raise NotImplementedError


@by_type
def largest_risk(bound: CollisionBound) -> float:
    """The largest collision risk of a path that the bound allows."""
    raise NotImplementedError


@by_type
def judge_candidate(
    bound: CollisionBound, world: World, tree: Vertices, scratch: TreeState, new: Proposal, rivals: Rivals
) -> bool:
    """Whether a candidate satisfies the constraints and improves on the rivals (:class:`Rivals`)."""
    raise NotImplementedError


class Rivals(NamedTuple):
    """A comparison of parents: the rule, the candidate, the original parent, the best parent so far."""

    rule: Dominance | Scaled
    new: Candidate
    original: Candidate
    best: Candidate
    first: bool  # the best so far is the original parent


@inlined
def beats(risks: FloatArray, rivals: Rivals) -> bool:
    """Eqs. (11) and (12) against the original parent and (12) against the best so far.

    Eq. (M44) of docs/mathematics_methods.md.
    """
    if not improves(rivals.rule, risks, rivals.new, rivals.original, False):
        return False
    return rivals.first or improves(rivals.rule, risks, rivals.new, rivals.best, True)


@implements(plant_collision, StepBound)
def _plant_step(bound: StepBound, _tree: Vertices, here: Gaussian) -> bool:
    return step_is_clear(bound, here, here)


@implements(appraise_collision, StepBound)
def _appraise_step(bound: StepBound, tree: Vertices, _scratch: TreeState, new: Proposal) -> bool:
    # Eq. (9) at the child, and one face of every obstacle that separates it from both ends of the step.
    return step_is_clear(bound, vertex_gaussian(tree, new.parent), new.there)


@implements(keep_collision, StepBound)
def _keep_step(bound: StepBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    pass


@implements(collision_column, StepBound)
def _no_collision_column(_bound: StepBound, _risks: FloatArray, _row: int) -> float:
    return 0.0


@implements(largest_risk, StepBound)
def _no_largest_risk(_bound: StepBound) -> float:
    return math.inf


@implements(judge_candidate, StepBound)
def _judge_step(
    bound: StepBound, world: World, tree: Vertices, scratch: TreeState, new: Proposal, rivals: Rivals
) -> bool:
    # This bound adds no objective, so the constraint comes last: most candidates are rejected before.
    appraise_mission(world.mission, tree, scratch, new)
    return beats(scratch.risks, rivals) and appraise_collision(bound, tree, scratch, new)


@implements(plant_collision, PathBound)
def _plant_path(bound: PathBound, tree: Vertices, here: Gaussian) -> bool:
    row, memory = int(np.int64(0)), tree.collision
    memory.face[row, :1] = -1
    step, risk = pass_obstacles(bound, leg_of_start(here, FAR_DEVIATIONS), memory, row, memory, row)
    tree.risk[row, tree.risk.shape[1] - 1] = risk
    return step <= bound.epsilon


@implements(appraise_collision, PathBound)
def _appraise_path(bound: PathBound, tree: Vertices, scratch: TreeState, new: Proposal) -> bool:
    own, parent, last = tree.collision, new.parent, scratch.risks.shape[1] - 1
    leg = leg_between(vertex_gaussian(tree, parent), new.there, FAR_DEVIATIONS)
    step, more = pass_obstacles(bound, leg, own, parent, scratch.collision, new.row)
    risk = tree.risk[parent, last] + more
    scratch.risks[new.row, last] = risk
    return step <= bound.epsilon and risk <= bound.delta


@implements(keep_collision, PathBound)
def _keep_path(_bound: PathBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    own = scratch.collision
    for i in range(memory.face.shape[1]):
        memory.face[target, i] = own.face[row, i]
        if own.face[row, i] < 0:
            break
        for k in range(3):
            memory.run[target, i, k] = own.run[row, i, k]


@implements(collision_column, PathBound)
def _collision_column(_bound: PathBound, risks: FloatArray, row: int) -> float:
    return float(risks[row, risks.shape[1] - 1])


@implements(largest_risk, PathBound)
def _largest_risk(bound: PathBound) -> float:
    return bound.delta


@implements(judge_candidate, PathBound)
def _judge_path(
    bound: PathBound, world: World, tree: Vertices, scratch: TreeState, new: Proposal, rivals: Rivals
) -> bool:
    # The collision risk is an objective, and cheaper to compute than the mission risk.
    if not appraise_collision(bound, tree, scratch, new):
        return False
    appraise_mission(world.mission, tree, scratch, new)
    return beats(scratch.risks, rivals)
