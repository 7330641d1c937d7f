"""Smoothing as a whole: where to begin, iterations of bending, which results are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from pareto_ltl.kernels.data import PathBound, StepBound
from pareto_ltl.planning.evaluate import completes_mission, evaluate_path, propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath, objective_row
from pareto_ltl.planning.refine.convex import Programme, bend_path, smoothing_programme
from pareto_ltl.planning.refine.obligations import path_obligations, planned_states
from pareto_ltl.planning.refine.taut_lines import (
    MissionOrder,
    mission_order,
    possible_orders,
    pull_taut,
    taut_line,
    walk_line,
)
from pareto_ltl.settings import SmoothingConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError

SPARE = 2  # steps added to a tree path, whose steps are at full speed and cannot bend otherwise
DISTANCES = (2.6, 2.0, 1.4, 1.1, 0.8)  # standard deviations that taut lines try to keep from obstacles
STARTS = 2  # times the candidates: each is bent at one weight only
STRIDES = (-6, -3, -1, 1)  # changes of the number of steps that are tried, each as long as it pays
RETIMED = 2  # starts that are bent with other numbers of steps as well
EACH = 2  # tree paths of one mission order that are bent
DESCENTS = 12  # solves of one descent at most
DESCENT_GAIN = 1e-3  # of the merit: less ends a descent
WIDER, NARROWER, NARROWEST, MENDING = 1.5, 0.4, 0.05, 0.8  # how the trust region follows success and failure
GAIN = 1e-4  # of the merit: less ends the iterations
LONG = 1.25  # lines of this many times the fewest steps are not worth the solver's time
ALIKE = 1e-3  # objectives that differ by less are the same

OptionalProgress: TypeAlias = Callable[[int, int], None] | None


@dataclass(frozen=True, slots=True)
class Start:
    """Means to begin with, the mission order they follow and the tree path they come from."""

    x: FloatArray
    plan: MissionOrder | None
    origin: str


@dataclass(frozen=True, slots=True)
class SmoothingTask:
    """What all iterations of one smoothing share; ``shortest`` [m] is the unit of the length."""

    cfg: SmoothingConfig
    model: Programme
    problem: Problem
    shortest: float

    def merit(self, path: PlannedPath, weight: float) -> float:
        """length / shortest + λ (mission risk + collision risk)."""
        o = path.objectives
        return o.length / self.shortest + weight * (o.mission_risk + o.collision_risk)

    def bend(self, x: FloatArray, weight: float, trust: float) -> FloatArray | None:
        """One convex solve about ``x`` (T+1, 2)."""
        cov = propagate(self.problem, x).cov
        return bend_path(self.model, self.problem, x, cov, weight, trust, self.shortest)


def smooth_paths(
    cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath], progress: OptionalProgress = None
) -> tuple[PlannedPath, ...]:
    """Smoothed versions of ``paths``, every one flown and accepted, none dominated by another.

    Parameters
    ----------
    cfg : SmoothingConfig
        ``candidates`` lines are smoothed at most, each once for every one of ``weights``: λ in
        ``length / shortest + λ (mission risk + collision risk)``.
    paths : sequence of PlannedPath
        Accepted, by mission risk.
    progress : callable
        Called with (lines done, lines in all).
    """
    strategy = STRATEGIES[type(problem.world.collision)]
    wanted = len(paths) > 0 and len(problem.theorem2.atom) > 0
    begun = strategy.starts(cfg, problem, paths) if wanted else []
    if not begun:
        return ()
    certain = not any(path.cov.any() for path in paths)
    weights = [0.0] if certain else sorted(cfg.weights, reverse=True)
    shortest = min(p.objectives.length for p in paths)
    task = SmoothingTask(cfg, fitting_programme(problem, begun), problem, shortest)
    return worthwhile(problem, strategy.bend_all(task, begun, weights, progress), paths)


NEEDLESS: dict[str, Callable[[FloatArray, FloatArray], bool]] = {
    "bound": lambda other, row: bool((other <= row * (1 + ALIKE)).all()),
    "flights": lambda other, row: bool((np.abs(other - row) <= ALIKE * row).all()),
}  # by judge: whether a path with the objectives ``other`` makes one with ``row`` needless


def worthwhile(
    problem: Problem, found: Sequence[PlannedPath], paths: Sequence[PlannedPath]
) -> tuple[PlannedPath, ...]:
    """Those of ``found`` that bring something, with their final collision risk.

    Where bounds judge, nothing else is as good to a thousandth in every objective. Where flights judge,
    bounds tell little about which path is better, and only repetitions are left out.
    """
    makes_needless = NEEDLESS[problem.fidelity.judge]
    rows = [objective_row(p.objectives) for p in paths]
    kept = []
    for path in sorted(found, key=lambda p: tuple(objective_row(p.objectives))):
        row = objective_row(path.objectives)
        if not any(makes_needless(other, row) for other in rows):
            rows.append(row)
            kept.append(path)
    finished = []
    for path in kept:
        with suppress(InfeasibleError):  # R above planner.delta
            finished.append(evaluate_path(problem, path.x, path.origin))
    return tuple(finished)


def fitting_programme(problem: Problem, begun: Sequence[Start]) -> Programme:
    """A programme that all starts fit into, in sizes rounded up so that they seldom change."""
    steps = max(len(start.x) for start in begun) - 1
    asked = (path_obligations(problem, start.x, propagate(problem, start.x).cov) for start in begun)
    witnesses = max(len(obligations.witness) for obligations in asked)
    faces = int(np.diff(problem.theorem2.faces.ptr).max())
    return smoothing_programme(problem, -(-steps // 8) * 8, witnesses + 1, faces)


def completes(problem: Problem, x: FloatArray) -> bool:
    """Whether the labels along ``x`` complete the mission, flyable or not."""
    logic = problem.world.logic
    return bool(logic.distance[planned_states(problem, x)[-1]] == 0.0)


def flown_path(problem: Problem, x: FloatArray) -> PlannedPath | None:
    """The path along ``x`` if it is feasible and completes the mission."""
    try:
        path = evaluate_path(problem, x, "", tight=False)
    except InfeasibleError:
        return None
    return path if completes_mission(problem, path) else None


def _alike(problem: Problem, one: Start, other: Start) -> bool:
    """Whether two lines are never more than half a step apart."""
    if one.plan != other.plan:
        return False
    gap = np.linalg.norm(one.x[:, None] - other.x[None], axis=2)
    return bool(max(gap.min(axis=0).max(), gap.min(axis=1).max()) < problem.reach / 2)


# --- equal shares of epsilon: the paper's chance constraint ------------------------------------


def taut_starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath]) -> list[Start]:
    """A taut line for every mission order, then the paths themselves, pulled and flown in the fewest steps.

    Under uncertainty a taut line visits the middle of each region, since steps can be taken from a path
    more easily than added.
    """
    depth = 1.0 if any(path.cov.any() for path in paths) else 0.0
    found: list[Start] = []
    firsts: dict[MissionOrder, PlannedPath] = {}
    for path in paths:
        plan = mission_order(problem, path)
        if plan is not None:
            firsts.setdefault(plan, path)
    for plan, path in firsts.items():
        line = taut_line(problem, plan, path, depth, _kept_deviations(problem))
        x = None if line is None else walk_line(problem, line)
        if x is not None and completes(problem, x):
            found.append(Start(x, plan, f"{path.origin}, drawn taut"))
    for k in np.unique(np.linspace(0, len(paths) - 1, min(cfg.candidates, len(paths))).astype(int)):
        x = shortened_path(problem, paths[k].x)
        start = Start(paths[k].x if x is None else x, mission_order(problem, paths[k]), paths[k].origin)
        if not any(_alike(problem, start, other) for other in found):
            found.append(start)
    fewest = min((len(start.x) for start in found), default=0)
    return [start for start in found if 1 < len(start.x) <= LONG * fewest][: cfg.candidates]


def _kept_deviations(problem: Problem) -> float:
    bound = problem.world.collision
    assert isinstance(bound, StepBound)
    return bound.z


def shortened_path(problem: Problem, x: FloatArray) -> FloatArray | None:
    """``x`` pulled taut between its witnesses and flown in the fewest steps; None where the mission fails."""
    cov = propagate(problem, x).cov
    witnesses = [t for t, _ in path_obligations(problem, x, cov).witness]
    y = walk_line(problem, pull_taut(problem, x, cov, witnesses, _kept_deviations(problem)))
    return y if y is not None and completes(problem, y) else None


def bend_each(
    task: SmoothingTask, begun: Sequence[Start], weights: Sequence[float], progress: OptionalProgress
) -> list[PlannedPath]:
    """Every start at every weight."""
    found: list[PlannedPath] = []
    for k, start in enumerate(begun):
        x = start.x
        for weight in weights:  # the safest first: it needs the most steps, and its line the least change
            path = improve(task, x, weight)
            if path is not None:
                found.append(replace(path, origin=f"{start.origin}, smoothed at risk weight {weight:g}"))
                x = path.x
        if progress is not None:
            progress(k + 1, len(begun))
    return found


def improve(task: SmoothingTask, x: FloatArray, weight: float) -> PlannedPath | None:
    """Bend, then once more with the steps that this set free taken out; None where nothing flew."""
    best = iterate(task, x, weight)
    if best is None:
        return None
    y = shortened_path(task.problem, best.x)
    if y is None or len(y) >= len(best.x):
        return best
    other = iterate(task, y, weight)
    return best if other is None else min(best, other, key=lambda path: task.merit(path, weight))


def iterate(task: SmoothingTask, x: FloatArray, weight: float) -> PlannedPath | None:
    """Bend and fly by turns until there is nothing to gain; the best that flew."""
    best, value = None, math.inf
    for _ in range(task.cfg.rounds):
        y = task.bend(x, weight, task.cfg.trust)
        if y is None:
            break
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
    """The longest of a few steps from what flew towards what did not."""
    for s in (0.5, 0.25, 0.125):
        path = flown_path(problem, old + s * (new - old))
        if path is not None:
            return path
    return None


# --- allocated risk: the path bound -----------------------------------------------------------


def spaced_starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath]) -> list[Start]:
    """Taut lines for every order that the automaton allows, then the trees' safest paths.

    Lines that keep other numbers of standard deviations may pass obstacles on other sides, and all that are
    unlike are kept. Each is walked with a few steps to spare, which :func:`retimed_path` takes out again.
    Tree paths fill what is left, the safest of each order first.
    """
    plans = dict.fromkeys(possible_orders(problem, cfg.candidates))
    plans |= dict.fromkeys(p for p in (mission_order(problem, path) for path in paths) if p is not None)
    found: list[Start] = []
    for plan in plans:
        for z in DISTANCES:
            line = taut_line(problem, plan, paths[0], 1.0, z)
            x = None if line is None else walk_line(problem, line)
            if x is not None and completes(problem, x) and len(x) - 1 + SPARE <= problem.horizon:
                longer = resampled_path(x, len(x) - 1 + SPARE)
                start = Start(longer, plan, f"drawn taut, {z:g} deviations from obstacles")
                if not any(_alike(problem, start, other) for other in found):
                    found.append(start)
    ranked = sorted(paths, key=lambda p: p.objectives.mission_risk + p.objectives.collision_risk)
    taken: dict[MissionOrder | None, int] = {}
    for path in ranked:
        own = mission_order(problem, path)
        start = Start(resampled_path(path.x, min(len(path.u) + SPARE, problem.horizon)), own, path.origin)
        if taken.get(own, 0) < EACH and not any(_alike(problem, start, other) for other in found):
            taken[own] = taken.get(own, 0) + 1
            found.append(start)
    return found[: STARTS * cfg.candidates]


def bend_best(
    task: SmoothingTask, begun: Sequence[Start], weights: Sequence[float], progress: OptionalProgress
) -> list[PlannedPath]:
    """Every start at the safest weight, then the best of them with other numbers of steps, and what comes of
    these at the other weights."""
    safest = weights[0]
    first: list[tuple[float, str, PlannedPath]] = []
    jobs = len(begun) + min(RETIMED, len(begun))
    for k, start in enumerate(begun):
        path = descend(task, start.x, safest)
        if path is not None:
            first.append((task.merit(path, safest), start.origin, path))
        if progress is not None:
            progress(k + 1, jobs)
    first.sort(key=lambda job: job[0])
    found = [replace(path, origin=f"{name}, smoothed at risk weight {safest:g}") for _, name, path in first]
    for k, (_, name, path) in enumerate(first[:RETIMED]):
        best = retimed_path(task, path, safest)
        for weight in weights:
            if weight != safest:
                best = descend(task, best.x, weight) if best is not None else None
            if best is not None:
                found.append(replace(best, origin=f"{name}, smoothed at risk weight {weight:g}"))
        if progress is not None:
            progress(len(begun) + k + 1, jobs)
    return found


def descend(task: SmoothingTask, x: FloatArray, weight: float) -> PlannedPath | None:
    """Bend and fly by turns with a trust region that follows success; the best that flew.

    Under the coherent law the covariance depends on the path, so a step that promised a gain may not keep
    it: it is then tried again from the best path, not so far.
    """
    cfg, best = task.cfg, flown_path(task.problem, x)
    value = math.inf if best is None else task.merit(best, weight)
    trust = cfg.trust
    for _ in range(DESCENTS):
        y = task.bend(x if best is None else best.x, weight, trust)
        if y is None:
            break
        path = flown_path(task.problem, y)
        if path is None and best is None:
            x, trust = y, max(trust * MENDING, cfg.trust * NARROWEST)
            continue
        now = math.inf if path is None else task.merit(path, weight)
        gain = (value - now) / now if now < math.inf else -1.0
        if path is not None and gain > 0.0:
            best, value, trust = path, now, min(cfg.trust, WIDER * trust)
        else:
            trust *= NARROWER
        if trust < cfg.trust * NARROWEST or 0.0 <= gain < DESCENT_GAIN:
            break
    return best


def retimed_path(task: SmoothingTask, path: PlannedPath, weight: float) -> PlannedPath | None:
    """``path`` or what comes of it with fewer or more steps: time costs covariance, haste costs detours."""
    best: PlannedPath | None = path
    for change in STRIDES:
        while best is not None:
            steps = len(best.u) + change
            if not 2 <= steps <= min(task.model.steps, task.problem.horizon):
                break
            other = descend(task, resampled_path(best.x, steps), weight)
            worth = task.merit(best, weight) * (1.0 - DESCENT_GAIN)
            if other is None or task.merit(other, weight) >= worth:
                break
            best = other
    return best


def resampled_path(x: FloatArray, steps: int) -> FloatArray:
    """``x`` (T+1, 2) walked in ``steps`` steps, each the same share of the old time."""
    old, new = np.linspace(0.0, 1.0, len(x)), np.linspace(0.0, 1.0, steps + 1)
    return np.column_stack([np.interp(new, old, x[:, i]) for i in (0, 1)])


# --- which of the two -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SmoothingStrategy:
    """Where smoothing begins and how it goes on, for one collision bound."""

    starts: Callable[[SmoothingConfig, Problem, Sequence[PlannedPath]], list[Start]]
    bend_all: Callable[[SmoothingTask, Sequence[Start], Sequence[float], OptionalProgress], list[PlannedPath]]


STRATEGIES = {
    StepBound: SmoothingStrategy(taut_starts, bend_each),
    PathBound: SmoothingStrategy(spaced_starts, bend_best),
}
