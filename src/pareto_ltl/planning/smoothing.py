"""Convex smoothing, ``fidelity.refine=convex``, and steering.

Smoothing has three operations. *Pull* (``planning.routes``) draws a taut line through the points where a tree
path visits its regions, around the corners of obstacles. *Walk* divides a line into as few steps as the wind
allows, since every step adds covariance. *Bend* (``planning.convex``) solves one convex programme about the
last iterate, propagates exactly, and repeats. ``planning.evaluate.evaluate_path`` checks every result like
any other path.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from pareto_ltl.kernels.descent import SLOWEST
from pareto_ltl.planning.convex.programme import Programme, programme
from pareto_ltl.planning.evaluate import completing_path, evaluate_path, propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath, objective_row
from pareto_ltl.planning.refine.starts import Start, first_starts, paced_line
from pareto_ltl.planning.routes.obligations import MissionOrder, completes, mission_order, path_obligations
from pareto_ltl.planning.routes.search_map import search_map
from pareto_ltl.planning.routes.taut_lines import CAP, pull_taut, taut_line, walk_line
from pareto_ltl.planning.separation import breach_text, kept_deviations, within_limits
from pareto_ltl.settings import SmoothingConfig
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.errors import InfeasibleError

LOG = logging.getLogger(__name__)

GAIN = 1e-4  # relative gain of the merit below which the iterations end
LONG = 1.25  # lines with more than this many times the fewest steps are not smoothed
WAYS = 4  # lines past different sides of obstacles that are bent in steering, the shortest
ALIKE = 1e-3  # relative difference below which objectives count as equal

OptionalProgress: TypeAlias = Callable[[int, int], None] | None


@dataclass(frozen=True, slots=True)
class SmoothingTask:
    """What all iterations of one smoothing share; ``shortest`` [m] is the unit of the length."""

    cfg: SmoothingConfig
    model: Programme
    problem: Problem
    shortest: float

    def merit(self, path: PlannedPath, weight: float) -> float:
        """length / shortest + λ (mission risk + collision risk).

        Eq. (M52) of docs/mathematics_methods.md.
        """
        o = path.objectives
        return o.length / self.shortest + weight * (o.mission_risk + o.collision_risk)


def smooth_paths(
    cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath], progress: OptionalProgress = None
) -> tuple[PlannedPath, ...]:
    """Smoothed versions of ``paths``: feasible, accepted, and none dominated by another.

    Parameters
    ----------
    cfg : SmoothingConfig
        At most ``candidates`` lines are smoothed, each once with every λ of ``weights`` in
        ``length / shortest + λ (mission risk + collision risk)``.
    paths : sequence of PlannedPath
        Accepted paths, sorted by mission risk.
    progress : callable
        Called with (lines done, lines in all).
    """
    wanted = len(paths) > 0 and len(problem.theorem2.atom) > 0 and _has_airspeeds(problem)
    begun = taut_starts(cfg, problem, paths) if wanted else []
    if not begun:
        return ()
    certain = not any(path.cov.any() for path in paths)
    weights = [0.0] if certain else sorted(cfg.weights, reverse=True)
    shortest = min(p.objectives.length for p in paths)
    task = SmoothingTask(cfg, fitting_programme(problem, begun), problem, shortest)
    return worthwhile(problem, bend_each(task, begun, weights, progress), paths)


def _has_airspeeds(problem: Problem) -> bool:
    """Whether the convex limits of smoothing allow the least airspeed; warns if not."""
    motion = problem.motion
    if motion.u_min <= SLOWEST * CAP**2 * motion.u_max:
        return True
    LOG.warning(
        "robot.u_min = %g m/s is too close to robot.u_max = %g m/s for convex smoothing: paths of trees are "
        "not smoothed; fidelity.refine=sampled can refine them",
        motion.u_min,
        motion.u_max,
    )
    return False


def worthwhile(
    problem: Problem, found: Sequence[PlannedPath], paths: Sequence[PlannedPath]
) -> tuple[PlannedPath, ...]:
    """The paths of ``found`` that are not redundant, with their final collision risk.

    With ``judge=bound``, a path is redundant if another is as good in every objective, within a thousandth.
    With ``judge=flights``, bounds do not rank paths well, and only paths with equal objectives are left out.
    """
    rows, finished = [objective_row(p.objectives) for p in paths], list[PlannedPath]()
    for path in sorted(found, key=lambda p: tuple(objective_row(p.objectives))):
        row = objective_row(path.objectives)
        others = np.reshape(rows, (-1, len(row)))
        bounded = problem.fidelity.judge == "bound"
        alike = others <= row * (1 + ALIKE) if bounded else np.abs(others - row) <= ALIKE * row
        if not alike.all(axis=1).any():
            rows.append(row)
            with suppress(InfeasibleError):  # R above planner.delta
                finished.append(evaluate_path(problem, path.x, path.origin))
    return tuple(finished)


def fitting_programme(problem: Problem, begun: Sequence[Start]) -> Programme:
    """A programme large enough for all starts; its sizes are rounded up, so that they seldom change."""
    steps = max(len(start.x) for start in begun) - 1
    requested = (path_obligations(problem, start.x, propagate(problem, start.x).cov) for start in begun)
    witnesses = max(len(obligations.witness) for obligations in requested)
    faces = int(np.diff(search_map(problem).witness.ptr).max())
    return programme(problem, -(-steps // 8) * 8, witnesses + 1, faces)


def flown_path(problem: Problem, x: FloatArray) -> PlannedPath | None:
    """The path along ``x`` (T+1, 2) if it is feasible and completes the mission; else None."""
    try:
        return completing_path(problem, x, "", tight=False)
    except InfeasibleError:
        return None


def _alike(problem: Problem, one: FloatArray, other: FloatArray) -> bool:
    """Whether two lines (T+1, 2) are never more than half a step apart."""
    gap = np.linalg.norm(one[:, None] - other[None], axis=2)
    return bool(max(gap.min(axis=0).max(), gap.min(axis=1).max()) < problem.reach / 2)


# --- starts -----------------------------------------------------------------------------------


def taut_starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath]) -> list[Start]:
    """A taut line for every mission order, then the paths themselves, pulled and flown in the fewest steps.

    Under uncertainty a taut line visits the middle of each region, since smoothing can remove steps from a
    path more easily than add them.
    """
    depth = 1.0 if any(path.cov.any() for path in paths) else 0.0
    found: list[tuple[MissionOrder | None, Start]] = []
    firsts: dict[MissionOrder, PlannedPath] = {}
    for path in paths:
        plan = mission_order(problem, path)
        if plan is not None:
            firsts.setdefault(plan, path)
    for plan, path in firsts.items():
        line = taut_line(problem, plan, path.x, path.cov, depth, kept_deviations(problem))
        x = None if line is None else _walked(problem, line)
        if x is not None:
            found.append((plan, Start(x, f"{path.origin}, drawn taut")))
    for k in np.unique(np.linspace(0, len(paths) - 1, min(cfg.candidates, len(paths))).astype(int)):
        x = shortened_path(problem, paths[k].x)
        start, own = Start(paths[k].x if x is None else x, paths[k].origin), mission_order(problem, paths[k])
        if not any(plan == own and _alike(problem, start.x, other.x) for plan, other in found):
            found.append((own, start))
    fewest = min((len(start.x) for _, start in found), default=0)
    return [start for _, start in found if 1 < len(start.x) <= LONG * fewest][: cfg.candidates]


def shortened_path(problem: Problem, x: FloatArray) -> FloatArray | None:
    """``x`` pulled taut between its witnesses and flown in the fewest steps; None where the mission fails."""
    cov = propagate(problem, x).cov
    witnesses = [t for t, _ in path_obligations(problem, x, cov).witness]
    return _walked(problem, pull_taut(problem, x, cov, witnesses, kept_deviations(problem)))


def _walked(problem: Problem, line: FloatArray) -> FloatArray | None:
    """``line`` (n, 2) [m] in the fewest steps; None where the mission fails."""
    x = walk_line(problem, line)
    x = None if x is None else paced_line(problem, x)
    return x if x is not None and completes(problem, x) else None


def bend_each(
    task: SmoothingTask, begun: Sequence[Start], weights: Sequence[float], progress: OptionalProgress
) -> list[PlannedPath]:
    """Every start at every weight."""
    found: list[PlannedPath] = []
    for k, start in enumerate(begun):
        x = start.x
        for weight in weights:  # the safest first: it needs the most steps, and changes the line least
            path = improve(task, x, weight)
            if path is not None:
                found.append(replace(path, origin=f"{start.origin}, smoothed at risk weight {weight:g}"))
                x = path.x
        if progress is not None:
            progress(k + 1, len(begun))
    return found


def improve(task: SmoothingTask, x: FloatArray, weight: float) -> PlannedPath | None:
    """Bend, then once more in the fewest steps of the result; None if no path was feasible."""
    best = iterate(task, x, weight)
    if best is None:
        return None
    y = shortened_path(task.problem, best.x)
    if y is None or len(y) >= len(best.x):
        return best
    other = iterate(task, y, weight)
    return best if other is None else min(best, other, key=lambda path: task.merit(path, weight))


def iterate(task: SmoothingTask, x: FloatArray, weight: float) -> PlannedPath | None:
    """Bend and evaluate in turn until the merit does not improve; the best feasible path, else None."""
    best, value = None, math.inf
    for _ in range(task.cfg.rounds):
        solution = task.model.bend(x, weight, task.cfg.trust, task.shortest)
        if solution is None:
            break
        y = solution.x
        path = flown_path(task.problem, y)
        if path is None and best is not None:
            path = damped_path(task.problem, best.x, y)
        x = y
        if path is None:
            continue
        now = task.merit(path, weight)
        gain = (value - now) / now
        if gain > 0.0:
            best, value = path, now
        if gain < GAIN:
            break
    return best


def damped_path(problem: Problem, old: FloatArray, new: FloatArray) -> PlannedPath | None:
    """The first feasible path at 1/2, 1/4, 1/8 of the way from feasible to infeasible means; else None."""
    for s in (0.5, 0.25, 0.125):
        path = flown_path(problem, old + s * (new - old))
        if path is not None:
            return path
    return None


# --- steering: the convex programme from the start to the goal, without search trees -----------------


def steered_path(problem: Problem, cfg: SmoothingConfig, weight: float) -> PlannedPath:
    """The path of the least length / shortest + ``weight`` (mission risk + collision risk).

    It begins with lines of the roadmap, and each segment keeps ``planner.epsilon``.

    Raises
    ------
    InfeasibleError
        If there is no line to the goal, the programme has no solution, or a segment breaks epsilon.
    """
    begun = sorted(first_starts(problem).values(), key=lambda start: length_of(start.x))[:WAYS]
    if not begun:
        raise InfeasibleError("no line leads from the start to the goal between the obstacles")
    model, shortest = fitting_programme(problem, begun), length_of(begun[0].x)
    task = SmoothingTask(cfg, model, problem, shortest)
    weights = [*(w for w in sorted(cfg.weights, reverse=True) if w > weight), weight]
    found = bend_each(task, begun, weights, None)
    if not found:
        raise InfeasibleError(
            "no path leads from the start to the goal within the limits of airspeed and planner.epsilon"
        )
    paths = [evaluate_path(problem, path.x, "steered") for path in found]
    kept = within_limits(problem, paths)
    if not kept:
        raise InfeasibleError(breach_text(problem, paths))
    return min(kept, key=lambda path: task.merit(path, weight))
