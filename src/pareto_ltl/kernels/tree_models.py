"""What a vertex keeps for each mission and collision bound, and how a proposed vertex is appraised.

A proposed vertex is written to scratch rows: row 0 the proposal, row 1 the best so far; they have the same
form as the rows of the tree.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from pareto_ltl.kernels.collision_risk import clear_faces, pass_obstacles
from pareto_ltl.kernels.data import (
    CollisionBound,
    Cov,
    Gaussian,
    MissionBound,
    Ordered,
    PathBound,
    Point,
    StepBound,
    Theorem2,
    World,
)
from pareto_ltl.kernels.jit import by_type, implements, inlined
from pareto_ltl.kernels.mission_risk import (
    add_risk,
    begin_bound,
    read_labels,
    read_letter,
    read_place,
    read_way,
    visit_risk,
)
from pareto_ltl.kernels.parents import Candidate, Dominance, Scaled, improves
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.tree import TreeState, Vertices


class Proposal(NamedTuple):
    """A child of ``parent`` at ``there``: its cell and automaton state, P(landmark missed) or -1 there, and
    the scratch row it is written to."""

    parent: int
    there: Gaussian
    cell: int
    q: int
    missed: float
    row: int


@inlined
def gaussian_at(x: FloatArray, cov: FloatArray, row: int) -> Gaussian:
    """The Gaussian of one row of ``x`` (N, 2) and ``cov`` (N, 3)."""
    return Gaussian(Point(x[row, 0], x[row, 1]), Cov(cov[row, 0], cov[row, 1], cov[row, 2]))


# --- mission bounds ---------------------------------------------------------------------------


@by_type
def plant_mission(bound: MissionBound, tree: Vertices, here: Gaussian) -> None:
    """Mission risk of the root at ``here``; its cell and state stand in the tree."""
    raise NotImplementedError


@by_type
def appraise_mission(bound: MissionBound, tree: Vertices, scratch: TreeState, new: Proposal) -> None:
    """Mission risk of a proposal into row ``new.row`` of the scratch."""
    raise NotImplementedError


@by_type
def keep_mission(bound: MissionBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    """Copy what the bound remembers from a scratch row to row ``target`` of ``memory``."""
    raise NotImplementedError


@implements(plant_mission, Theorem2)
def _plant_theorem2(bound: Theorem2, tree: Vertices, here: Gaussian) -> None:
    for atom in range(bound.holds.shape[1]):
        tree.risk[0, atom] = visit_risk(bound, atom, tree.cell[0], here, -1.0)


@implements(appraise_mission, Theorem2)
def _appraise_theorem2(bound: Theorem2, tree: Vertices, scratch: TreeState, new: Proposal) -> None:
    for atom in range(bound.holds.shape[1]):
        before = tree.risk[new.parent, atom]  # -1: not visited yet, T_i is empty
        scratch.risks[new.row, atom] = visit_risk(bound, atom, new.cell, new.there, before)


@implements(keep_mission, Theorem2)
def _keep_theorem2(bound: Theorem2, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    pass


@implements(plant_mission, Ordered)
def _plant_ordered(bound: Ordered, tree: Vertices, here: Gaussian) -> None:
    memory = tree.mission
    begin_bound(bound, memory.bound, 1)  # row 1 is free: the root is the first vertex
    read_labels(bound, here, memory.seen)
    read_place(bound, here, memory.met)
    read_letter(bound, memory.bound, 1, memory.seen, memory.met, memory.bound, 0)
    if len(memory.met) > 0:
        memory.cov[0, 0], memory.cov[0, 1], memory.cov[0, 2] = here.cov
    tree.risk[0, 0] = memory.bound[0, tree.q[0]]


@implements(appraise_mission, Ordered)
def _appraise_ordered(bound: Ordered, tree: Vertices, scratch: TreeState, new: Proposal) -> None:
    own = scratch.mission
    read_labels(bound, new.there, own.seen)
    if len(own.met) > 0:
        read_way(bound, gaussian_at(tree.x, tree.mission.cov, new.parent), new.there, own.met)
        own.cov[new.row, 0], own.cov[new.row, 1], own.cov[new.row, 2] = new.there.cov
    read_letter(bound, tree.mission.bound, new.parent, own.seen, own.met, own.bound, new.row)
    add_risk(own.bound, new.row, new.missed)
    scratch.risks[new.row, 0] = own.bound[new.row, new.q]


@implements(keep_mission, Ordered)
def _keep_ordered(bound: Ordered, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    for p in range(memory.bound.shape[1]):
        memory.bound[target, p] = scratch.mission.bound[row, p]
    if len(memory.met) > 0:
        for i in range(3):
            memory.cov[target, i] = scratch.mission.cov[row, i]


# --- collision bounds -------------------------------------------------------------------------


@by_type
def plant_collision(bound: CollisionBound, tree: Vertices, here: Gaussian) -> bool:
    """Collision risk of the root at ``here``; False where it breaks the chance constraint already."""
    raise NotImplementedError


@by_type
def appraise_collision(bound: CollisionBound, tree: Vertices, scratch: TreeState, new: Proposal) -> bool:
    """Whether a proposal satisfies the chance constraint; what the bound keeps goes to row ``new.row``."""
    raise NotImplementedError


@by_type
def keep_collision(bound: CollisionBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    """Copy what the bound remembers from a scratch row to row ``target`` of ``memory``."""
    raise NotImplementedError


@by_type
def keep_covariance(bound: CollisionBound, memory: Any, v: int, cov: Cov) -> None:
    """Store the covariance of vertex ``v`` where the bound needs it."""
    raise NotImplementedError


@by_type
def collision_column(bound: CollisionBound, risks: FloatArray, row: int) -> float:
    """Collision risk in one row of ``risks``, which never falls along an edge; 0 where none is kept."""
    raise NotImplementedError


@by_type
def largest_risk(bound: CollisionBound) -> float:
    """The largest collision risk of a path that the bound allows."""
    raise NotImplementedError


@by_type
def judge_candidate(
    bound: CollisionBound, world: World, tree: Vertices, scratch: TreeState, new: Proposal, rivals: Rivals
) -> bool:
    """Whether a candidate keeps the constraints and improves on the rivals (:class:`Rivals`)."""
    raise NotImplementedError


class Rivals(NamedTuple):
    """What a candidate must beat: the rule, the candidate itself, the original parent, the best so far."""

    rule: Dominance | Scaled
    new: Candidate
    original: Candidate
    best: Candidate
    first: bool  # the best so far is the original parent


@inlined
def beats(risks: FloatArray, rivals: Rivals) -> bool:
    """Eqs. (11) and (12) against the original parent and (12) against the best so far."""
    if not improves(rivals.rule, risks, rivals.new, rivals.original, False):
        return False
    return rivals.first or improves(rivals.rule, risks, rivals.new, rivals.best, True)


@implements(plant_collision, StepBound)
def _plant_step(bound: StepBound, tree: Vertices, here: Gaussian) -> bool:
    return clear_faces(bound.barriers, bound.z, here, tree.collision.cleared, 0)


@implements(appraise_collision, StepBound)
def _appraise_step(bound: StepBound, tree: Vertices, scratch: TreeState, new: Proposal) -> bool:
    # Eq. (9) at the child, and one face of every obstacle that serves both ends of the step.
    cleared, row = scratch.collision.cleared, new.row
    if not clear_faces(bound.barriers, bound.z, new.there, cleared, row):
        return False
    for j in range(cleared.shape[1]):  # noqa: SIM110 (numba has no generator expressions)
        if cleared[row, j] & tree.collision.cleared[new.parent, j] == 0:
            return False
    return True


@implements(keep_collision, StepBound)
def _keep_step(bound: StepBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    for j in range(memory.cleared.shape[1]):
        memory.cleared[target, j] = scratch.collision.cleared[row, j]


@implements(keep_covariance, StepBound)
def _keep_no_covariance(bound: StepBound, memory: Any, v: int, cov: Cov) -> None:
    pass


@implements(collision_column, StepBound)
def _no_collision_column(bound: StepBound, risks: FloatArray, row: int) -> float:
    return 0.0


@implements(largest_risk, StepBound)
def _no_largest_risk(bound: StepBound) -> float:
    return math.inf


@implements(judge_candidate, StepBound)
def _judge_step(
    bound: StepBound, world: World, tree: Vertices, scratch: TreeState, new: Proposal, rivals: Rivals
) -> bool:
    # This bound adds no objective, so the constraint comes last: most candidates never get there.
    appraise_mission(world.mission, tree, scratch, new)
    return beats(scratch.risks, rivals) and appraise_collision(bound, tree, scratch, new)


@implements(plant_collision, PathBound)
def _plant_path(bound: PathBound, tree: Vertices, here: Gaussian) -> bool:
    memory = tree.collision
    for j in range(memory.face.shape[1]):
        memory.face[0, j] = -1
        for i in range(3):
            memory.run[0, j, i] = 0.0
    step, risk = pass_obstacles(bound.barriers, here, here, memory, 0, memory, 0)
    tree.risk[0, tree.risk.shape[1] - 1] = risk
    return step <= bound.epsilon


@implements(appraise_collision, PathBound)
def _appraise_path(bound: PathBound, tree: Vertices, scratch: TreeState, new: Proposal) -> bool:
    own, parent, last = tree.collision, new.parent, scratch.risks.shape[1] - 1
    here = gaussian_at(tree.x, own.cov, parent)
    step, more = pass_obstacles(bound.barriers, here, new.there, own, parent, scratch.collision, new.row)
    risk = tree.risk[parent, last] + more
    scratch.risks[new.row, last] = risk
    return step <= bound.epsilon and risk <= bound.delta


@implements(keep_collision, PathBound)
def _keep_path(bound: PathBound, scratch: TreeState, row: int, memory: Any, target: int) -> None:
    own = scratch.collision
    for j in range(memory.face.shape[1]):
        memory.face[target, j] = own.face[row, j]
        for i in range(3):
            memory.run[target, j, i] = own.run[row, j, i]


@implements(keep_covariance, PathBound)
def _keep_covariance(bound: PathBound, memory: Any, v: int, cov: Cov) -> None:
    memory.cov[v, 0], memory.cov[v, 1], memory.cov[v, 2] = cov


@implements(collision_column, PathBound)
def _collision_column(bound: PathBound, risks: FloatArray, row: int) -> float:
    return float(risks[row, risks.shape[1] - 1])


@implements(largest_risk, PathBound)
def _largest_risk(bound: PathBound) -> float:
    return bound.delta


@implements(judge_candidate, PathBound)
def _judge_path(
    bound: PathBound, world: World, tree: Vertices, scratch: TreeState, new: Proposal, rivals: Rivals
) -> bool:
    # The collision risk is an objective, and cheaper than the mission risk.
    if not appraise_collision(bound, tree, scratch, new):
        return False
    appraise_mission(world.mission, tree, scratch, new)
    return beats(scratch.risks, rivals)
