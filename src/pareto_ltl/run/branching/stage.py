"""The branches of a plan: where it can branch, which trunk is best with branches, and whether they pay."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.planning.branching.records import BranchFix, TreeRow
from pareto_ltl.planning.costs.duration import hours_text
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import Front, Plan, PlannedPath
from pareto_ltl.planning.refine.separation import allowed_risk
from pareto_ltl.run.branching.rest_problem import World
from pareto_ltl.run.branching.tree_search import Grower, Tree, branching_of, mixed_risk
from pareto_ltl.settings import BranchConfig, RobotConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import length_of
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.display import rate_text
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.seeds import named_child
from pareto_ltl.world.cells import inside_depth

LOG = logging.getLogger(__name__)
STREAM, PROMISED = "branches", "promised branches"
TRUNKS = 2  # paths of the front that trees are grown on, the plan among them
SAVED = 0.5  # of the failures after the fix: what branches are taken to save when trunks are compared


def branched_plan(
    world: World, front: Front, plan: Plan, seeds: SeedSequence, at_point: Callable[[int], Plan]
) -> Plan:
    """``plan`` with branches, or another path of ``front`` with branches; ``plan`` itself if none pay.

    ``at_point`` makes the plan of a path of the front.

    Raises
    ------
    ConfigError
        If the plan cannot branch where ``branch.at`` says, or nowhere.
    """
    cfg = world.settings.branch
    problem, own = world.problem, next(k for k, path in enumerate(front.paths) if path is plan.path)
    fixes = possible_fixes(cfg, world.settings.robot, problem, plan.path)
    grower = Grower.of(world, named_child(seeds, STREAM))
    shoots = []
    for point in promising_trunks(grower, front, own, fixes):
        path = front.paths[point]
        allowed = fixes if point == own else fixes_on(cfg, world.settings.robot, problem, path)
        shoots += [replace(grower.begun(path, fix), point=point) for fix in allowed]
    tree = grower.grown(min(shoots, key=grower.best_score))
    number = worthwhile_leaves(tree)
    rows = tuple(
        TreeRow(
            k, FailureRate.counted(problem.fidelity.law, int(one.failed.sum()), len(one.failed)), one.length
        )
        for k, one in enumerate(tree.divisions, 1)
    )
    if number == 1:
        LOG.warning("branches do not pay: %s; the plan has none", _row_text(rows))
        return plan
    made, pays = branching_of(
        problem, tree, number, world.settings.selection.runs, named_child(seeds, PROMISED), rows
    )
    if not pays or not keeps_epsilon(problem, tree, number):
        why = "a segment would break planner.epsilon" if pays else "fresh flights show no gain"
        LOG.warning("branches do not pay: %s (%s); the plan has none", why, _row_text(rows))
        return plan
    LOG.info(
        "branches %s after departure: %s", hours_text(tree.fix.step * problem.motion.dt), _row_text(rows)
    )
    base = plan if tree.point == own else at_point(tree.point)
    return replace(base, branching=made)


def _row_text(rows: Sequence[TreeRow]) -> str:
    """What each number of branches gives: ``no branch 8 %, 2 branches 6.9 %``."""
    names = ("no branch", *(f"{row.leaves} branches" for row in rows[1:]))
    return ", ".join(
        f"{name} {rate_text(row.rate.failure, row.rate.low, row.rate.high)}"
        for name, row in zip(names, rows, strict=True)
    )


def keeps_epsilon(problem: Problem, tree: Tree, number: int) -> bool:
    """Whether the flights of all branches together keep ``planner.epsilon`` in every segment."""
    return bool((mixed_risk(problem, tree, number) <= allowed_risk(problem) * (1.0 + 1e-6)).all())


# --- where -----------------------------------------------------------------------------------------


def possible_fixes(
    cfg: BranchConfig, robot: RobotConfig, problem: Problem, path: PlannedPath
) -> list[BranchFix]:
    """The fixes of :func:`fixes_on`; ConfigError if there is none, or a time is not within the plan."""
    dt, steps = problem.motion.dt, len(path.u)
    for hours in cfg.at:
        step = round(3600.0 * hours / dt)
        if not 1 <= step < steps:
            raise ConfigError(
                f"branch.at = {hours:g} h is not within the plan, whose steps of {dt:g} s end "
                f"{steps * dt / 3600.0:.4g} h after departure: give times after its first and before its "
                "last step"
            )
    found = fixes_on(cfg, robot, problem, path)
    if not found:
        what = "the plan meets none of scene.landmarks"
        what = what if problem.scene.landmarks else "the map has no landmarks"
        raise ConfigError(
            f"branch.leaves = {cfg.leaves} needs a position fix: branch.at is empty and {what}; give the "
            "times at which a position can be measured, e.g. branch.at=[6.0] in hours after departure"
        )
    return found


def fixes_on(cfg: BranchConfig, robot: RobotConfig, problem: Problem, path: PlannedPath) -> list[BranchFix]:
    """The fixes that a flight of ``path`` can take: at ``branch.at``, or in landmarks that it passes."""
    dt, steps, x = problem.motion.dt, len(path.u), path.x

    def fix(step: int, sd: float, landmark: int | None = None) -> BranchFix:
        ahead = x[step] - x[step - 1]
        size = math.hypot(*ahead)
        if size < 1e-6:
            ahead, size = x[-1] - x[0] + np.array([0.0, 1e-6]), math.hypot(*(x[-1] - x[0] + [0.0, 1e-6]))
        outline = None if landmark is None else problem.scene.landmarks[landmark]
        return BranchFix(step, x[step], ahead / size, sd, cfg.available, outline)

    if cfg.at:
        wanted = sorted({round(3600.0 * hours / dt) for hours in cfg.at})
        return [fix(step, cfg.fix_sd) for step in wanted if 1 <= step < steps]
    found = []
    for number, outline in enumerate(problem.scene.landmarks):
        inside = np.flatnonzero(inside_depth(outline, x[1:-1]) >= 0.0) + 1
        if len(inside):
            middle = outline.mean(axis=0)
            step = int(inside[np.argmin(np.linalg.norm(x[inside] - middle, axis=1))])
            found.append(fix(step, robot.fix_sd, number))
    return found


# --- which -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Outlook:
    """What a path promises as a trunk: a score, low if much of its failure can still be saved at a fix."""

    point: int
    score: float


def promising_trunks(grower: Grower, front: Front, own: int, fixes: Sequence[BranchFix]) -> list[int]:
    """The plan, and with ``selection.rule=worth`` the path of the front that is likely to be the best trunk.

    Other rules take their path for other reasons.
    A path is taken to fail as often as its flights are lost at the fix, and :data:`SAVED` of the others that
    fail without one.
    """
    if grower.world.settings.selection.rule != "worth":
        return [own]
    step = fixes[0].step
    outlooks = []
    for point, path in enumerate(front.paths):
        if len(path.u) <= step:
            continue
        failure = outlook(grower, path, min(step, len(path.u) - 1))
        outlooks.append(Outlook(point, grower.score(failure, length_of(path.x))))
    outlooks.sort(key=lambda one: one.score)
    others = [one.point for one in outlooks if one.point != own]
    return [own, *others[: TRUNKS - 1]]


def outlook(grower: Grower, path: PlannedPath, step: int) -> float:
    """Failure to expect of ``path`` with branches at ``step``."""
    problem, winds = grower.problem, grower.fitted
    x = winds.flown(path.u)
    failed = winds.flights.failed(x)
    begun = Deployment.judged(problem, problem.fidelity.law, np.ascontiguousarray(x[:, : step + 1]))
    lost = begun.collided | (begun.off_map if problem.scene.walled else False)
    rows = np.flatnonzero(failed & ~lost)
    trapped = [np.isinf(problem.logic.distance[problem.states(x[i, : step + 1])[-1]]) for i in rows]
    lost[rows] = np.array(trapped, bool)
    return float(lost.mean() + (1.0 - SAVED) * (failed & ~lost).mean())


def worthwhile_leaves(tree: Tree) -> int:
    """The fewest branches of ``tree`` beyond which more do not reduce the failures significantly.

    The first ones must also fail less than one rest for all flights: else the search has found a better
    trunk, and the fix says nothing.
    """
    number, least = 1, [tree.divisions[0].failed, tree.single.failed]
    for more, division in enumerate(tree.divisions[1:], 2):
        if all(paired_difference(failed, division.failed)[2] < 0.0 for failed in least):
            number, least = more, [division.failed]
    return number
