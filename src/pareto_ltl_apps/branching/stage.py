"""The branches of a plan: where it can branch, which trunk is best with branches, and whether they pay."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import rate_text
from pareto_ltl import Run
from pareto_ltl.extend import (
    BranchFix,
    FailureRate,
    Front,
    Plan,
    PlannedPath,
    Problem,
    RobotConfig,
    TreeRow,
    cost_named,
    evaluate,
    evaluate_path,
    fresh_promise,
    which_fail,
)
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.seeds import named_child
from pareto_ltl_apps.branching.bending import bent_tree, within_airspeeds
from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.branching.tree_flights import fly_tree, whole_controls
from pareto_ltl_apps.branching.tree_plan import (
    Grown,
    drafted,
    keeps_epsilon,
    paying,
    rated,
    tree_rows,
    with_second_fixes,
)
from pareto_ltl_apps.branching.tree_search import (
    LEAST_FLIGHTS,
    QUADRANTS,
    REJOINED,
    Grower,
    Stem,
    Tree,
    worthwhile_leaves,
)

LOG = logging.getLogger("pareto_ltl.branching.stage")
STREAM, PROMISED = "branches", "promised branches"  # random streams of the search, of the promise,
CONFIRMED, BENT = "confirmed branches", "bent trunk"  # of what is retained, of the promise without a fix
RETURNS = (0.1, 0.5)  # shares of the rest within which flights return to the path, when trunks are compared


def branched_plan(run: Run, plan: Plan) -> Plan:
    """``plan`` of ``run`` with branches, or another path of its front with them; itself if none pay.

    Raises
    ------
    ConfigError
        If the plan cannot branch where ``branch.at`` says, or nowhere.
    """
    settings, problem, front, seeds = run.settings, run.problem, run.front, run.seeds("plan")
    cfg, robot = settings[BranchConfig], settings.robot
    own = next(k for k, path in enumerate(front.paths) if path is plan.path)
    fixes = possible_fixes(cfg, robot, problem, plan.path)
    worst = 0.0 if plan.epsilon_kept or plan.worst is None else plan.worst.probability
    grower = Grower.of(run, named_child(seeds, STREAM), worst)
    places = [(own, fix) for fix in fixes]
    for point in promising_trunks(grower, front, own)[1:]:
        path = front.paths[point]
        places += [(point, fix) for fix in fixes_on(cfg, robot, problem, path)]
    law, runs = problem.fidelity.law, settings.selection.runs
    straight, number = best_tree(grower, front, places, cfg.fixes)
    if number == 0:
        LOG.warning(
            "branches do not pay: %s; the plan has none",
            _row_text(tree_rows(law, straight, Grown(straight, 1))),
        )
        return plan
    confirmed = named_child(seeds, CONFIRMED)
    trunk = front.paths[straight.point]
    path, tree = bent_if_better(grower, trunk, straight, number, runs, confirmed)
    grown = Grown(tree, number)
    if cfg.fixes > 1:
        grown = with_second_fixes(grower, tree, number, lambda stem: later_fixes(cfg, robot, problem, stem))
        grown = paying(grown, fly_tree(problem, path, drafted(problem, grown), runs, confirmed))
    rows = tree_rows(law, straight, grown)
    promised = named_child(seeds, PROMISED)
    flown = fly_tree(problem, path, drafted(problem, grown), runs, promised)
    made = replace(rated(law, drafted(problem, grown), flown, path.x), front=rows)
    if made.difference[2] >= 0.0 or not keeps_epsilon(problem, grown, grower.allowed):
        why = (
            "a segment would break planner.epsilon"
            if made.difference[2] < 0.0
            else "fresh flights show no gain"
        )
        LOG.warning("branches do not pay: %s (%s); the plan has none", _row_text(rows), why)
        return plan
    after = cost_named("duration").text(tree.fix.step * problem.motion.dt)
    LOG.info("branches %s after departure: %s", after, _row_text(rows))
    base = plan if tree.point == own else plan_at(run, plan, tree.point)
    if path is not trunk:
        unbent = fly_tree(problem, trunk, drafted(problem, Grown(straight, number)), runs, promised)
        made = replace(made, bent=paired_difference(unbent.failed, flown.before[:, 1]))
        base = bent_plan(run, base, path, named_child(seeds, BENT), confirmed)
    return replace(base, branching=made)


def best_tree(
    grower: Grower, front: Front, places: Sequence[tuple[int, BranchFix]], fixes: int
) -> tuple[Tree, int]:
    """The best tree on a path of ``front`` with a fix, ``places``, and the number of its branches that pay.

    For a plan with two ``fixes`` the first one is before another one, if trees with it pay.
    """

    def begun(chosen: Sequence[tuple[int, BranchFix]]) -> list[Tree]:
        return [
            replace(grower.begun(Stem.trunk(front.paths[point]), fix), point=point) for point, fix in chosen
        ]

    last = max(fix.step for _, fix in places) if fixes > 1 else 0
    shoots = begun([place for place in places if place[1].step < last])
    if shoots:
        tree = grower.grown(grower.best_of(shoots))
        if (number := worthwhile_leaves(tree)) > 0:
            return tree, number
    shoots += begun([place for place in places if place[1].step >= last])
    tree = grower.grown(grower.best_of(shoots))
    return tree, worthwhile_leaves(tree)


def bent_if_better(
    grower: Grower, trunk: PlannedPath, tree: Tree, number: int, runs: int, seeds: SeedSequence
) -> tuple[PlannedPath, Tree]:
    """The trunk bent for its branches, if fresh flights fail significantly less with it; else as it is."""
    problem = grower.problem
    found = bent_tree(grower, trunk, tree, number) if grower.run.settings[BranchConfig].fit_trunk else None
    if found is None:
        return trunk, tree
    path, better = found
    pair = [(trunk, tree), (path, better)]
    flown = [fly_tree(problem, one, drafted(problem, Grown(own, number)), runs, seeds) for one, own in pair]
    difference = paired_difference(*(one.failed for one in flown))
    if difference[2] >= 0.0 or not keeps_epsilon(problem, Grown(better, number), grower.allowed):
        LOG.info("the bent trunk is not taken: difference %.2f points", 100.0 * difference[0])
        return trunk, tree
    return path, better


def plan_at(run: Run, plan: Plan, point: int) -> Plan:
    """The plan of another path of the front of ``run``, with its promise and the rule of ``plan``."""
    selection = replace(run.settings.selection, rule="point", point=point)
    unbranched = replace(run.settings[BranchConfig], leaves=1, fixes=1)
    other = run.with_settings(run.settings.with_sections(selection, unbranched)).unpriced_plan()
    return replace(other, rule=plan.rule, weights=plan.weights, rule_settings=plan.rule_settings)


def bent_plan(run: Run, base: Plan, path: PlannedPath, seeds: SeedSequence, claim: SeedSequence) -> Plan:
    """``base`` with the bent trunk ``path`` in the place of its path, and with the promise of it.

    While it is bent, R of a path is in its looser form; the plan has the tighter one.
    """
    problem, runs = run.problem, run.settings.selection.runs
    path = replace(path, objectives=evaluate_path(problem, path.x, path.origin).objectives)
    failures = int(which_fail(problem, [path], runs, claim).sum())
    claimed = FailureRate.counted(problem.fidelity.law, failures, runs)
    return replace(
        base, path=path, navigation=problem.scene.frame.navigation(path.t, path.x, path.u),
        promise=fresh_promise(problem, run.wind, path, claimed, runs, seeds),
        worst=problem.worst_segment(path), epsilon_kept=problem.keeps_epsilon(path),
    )  # fmt: skip


def _row_text(rows: Sequence[TreeRow]) -> str:
    """What each number of branches gives: ``no branch 8 %, 2 branches 6.9 %``."""
    names = ("no branch", *(f"{row.leaves} branch{'es' * (row.leaves > 1)}" for row in rows[1:]))
    return ", ".join(
        f"{name} {rate_text(row.rate.failure, row.rate.low, row.rate.high)}"
        for name, row in zip(names, rows, strict=True)
    )


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
    if cfg.at and cfg.fixes > 1 and len({round(3600.0 * hours / dt) for hours in cfg.at}) < 2:
        raise ConfigError(
            f"branch.fixes = {cfg.fixes} needs two different times in branch.at, got {cfg.at}: give the "
            "times of both fixes, e.g. branch.at=[5.0, 9.0], or branch.fixes=1"
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


def later_fixes(cfg: BranchConfig, robot: RobotConfig, problem: Problem, stem: Stem) -> list[BranchFix]:
    """The fixes that a flight of ``stem`` can take after those that it has passed."""
    last = stem.passed[-1].fix.step
    return [fix for fix in fixes_along(cfg, robot, problem, stem.x) if fix.step > last]


def fixes_on(cfg: BranchConfig, robot: RobotConfig, problem: Problem, path: PlannedPath) -> list[BranchFix]:
    """The fixes that a flight of ``path`` can take."""
    return fixes_along(cfg, robot, problem, path.x)


def fixes_along(cfg: BranchConfig, robot: RobotConfig, problem: Problem, x: FloatArray) -> list[BranchFix]:
    """The fixes of a flight along ``x`` (T+1, 2) [m]: at ``branch.at``, or in landmarks that it passes."""
    dt, steps = problem.motion.dt, len(x) - 1

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
        inside = np.flatnonzero(fix(1, robot.fix_sd, number).inside(x[1:-1])) + 1
        if len(inside):
            middle = outline.mean(axis=0)
            step = int(inside[np.argmin(np.linalg.norm(x[inside] - middle, axis=1))])
            found.append(fix(step, robot.fix_sd, number))
    return found


# --- which -----------------------------------------------------------------------------------------


def promising_trunks(grower: Grower, front: Front, own: int) -> list[int]:
    """The plan, and with ``selection.rule=worth`` paths of the front that are likely to be better trunks.

    The one with the best outlook, and the next safer one, which fails less before the fix. Other rules take
    their path for other reasons, and ``branch.fit_trunk=false`` takes the plan.
    """
    settings = grower.run.settings
    cfg = settings[BranchConfig]
    if settings.selection.rule != "worth" or not cfg.fit_trunk:
        return [own]
    scores = {}
    for point, path in enumerate(front.paths):
        fixes = fixes_on(cfg, settings.robot, grower.problem, path)
        if point != own and fixes:
            failure = min(outlook(grower, path, fix) for fix in fixes)
            scores[point] = grower.score(failure, length_of(path.x))
    best = sorted(scores, key=lambda point: scores[point])[:1]
    return list(dict.fromkeys([own, *best, max(own - 1, 0)]))


def outlook(grower: Grower, path: PlannedPath, fix: BranchFix) -> float:
    """Failure to expect of ``path`` with branches at ``fix``: with rests that return to it.

    Each flight flies its deviation off, or all go on, whichever fails less. Where the setting does not have
    that, the mean of the flights in each quadrant is steered back to the path, within the :data:`RETURNS` of
    the rest, or not at all, whichever fails least.
    """
    problem, winds, k = grower.problem, grower.fitted, fix.step
    if grower.run.settings[BranchConfig].rejoin:
        y, taken = winds.measured_along(path.u, fix)
        off = replace(fix, rejoin=max(round(REJOINED[1] * (len(path.u) - k)), 1))
        ways = (winds, winds.after(off, y, taken))
        return min(float(way.failed(path.u).mean()) for way in ways)
    x = winds.flown(path.u)
    failed = winds.flights.failed(x)
    y, taken = winds.measured(fix, x[:, k])
    since = np.arange(len(path.x)) - k
    for cell in QUADRANTS:
        rows = np.flatnonzero(taken & cell.holds(fix.distances(y)))
        if len(rows) < LEAST_FLIGHTS:
            continue
        own, off, tried = winds.only(rows), x[rows].mean(axis=0) - path.x, [failed[rows]]
        for share in RETURNS:
            back = np.clip(since / max(share * since[-1], 1.0), 0.0, 1.0)
            steered = evaluate(problem, x=path.x - back[:, None] * off).u
            u = whole_controls(path.u, k, within_airspeeds(grower, steered)[k:])
            tried.append(own.failed(u))
        failed[rows] = min(tried, key=lambda one: int(one.sum()))
    return float(failed.mean())
