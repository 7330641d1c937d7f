"""Smoothing as a whole: where to begin, rounds of bending, what is worth keeping."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from pareto_ltl.planning.problem import Problem, accepted, evaluate
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.refine.convex import Programme, bend, programme
from pareto_ltl.planning.refine.obligations import _states, duties, propagate
from pareto_ltl.planning.refine.taut_lines import Order, order, possible_orders, pull, taut, walk
from pareto_ltl.settings import SmoothingConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError

SPARE = 2  # steps added to a tree path, whose steps are at full speed and leave no room for change
DISTANCES = (2.6, 2.0, 1.4, 0.8)  # standard deviations that taut lines try to keep from obstacles
STRIDES = (-6, -3, -1, 1)  # changes of the number of steps that are tried, each as long as it pays
RETIMED = 2  # starts that are bent with other numbers of steps as well
EACH = 2  # tree paths of one mission order that are bent
ROUNDS_FULL = 12  # of bending, at most, of full fidelity
GAIN_FULL = 1e-3  # of the merit: less ends them
WIDER, NARROWER, NARROWEST, MENDING = 1.5, 0.4, 0.05, 0.8  # how the trust region follows success and failure
GAIN = 1e-4  # of the merit: less ends the rounds
LONG = 1.25  # lines of this many times the fewest steps are not worth the solver's time
ALIKE = 1e-3  # objectives that differ by less are the same


@dataclass(frozen=True, slots=True)
class Start:
    """Means to begin with, the mission order they follow and the tree path they come from."""

    x: FloatArray
    plan: Order | None
    origin: str


def smooth(
    cfg: SmoothingConfig,
    problem: Problem,
    paths: Sequence[PlannedPath],
    progress: Callable[[int, int], None] | None = None,
) -> tuple[PlannedPath, ...]:
    """Smoothed versions of ``paths``, every one flown and accepted, none dominated by another.

    Parameters
    ----------
    cfg : SmoothingConfig
        ``candidates`` lines are smoothed at most, each once for every one of ``weights``: λ in
        ``length / shortest + λ (mission risk + collision risk)``.
    paths : sequence of Path
        Accepted, by mission risk.
    progress : callable
        Called with (lines done, lines in all).
    """
    wanted = len(paths) > 0 and len(problem.tables.regions.atom) > 0
    begun = starts(cfg, problem, paths) if wanted else []
    if not begun:
        return ()
    certain = not any(path.cov.any() for path in paths)
    weights = [0.0] if certain else sorted(cfg.weights, reverse=True)
    model = fitting(problem, begun)
    shortest = min(p.objectives.length for p in paths)
    if problem.tables.full:
        return worthwhile(problem, bent(cfg, model, problem, begun, weights, shortest, progress), paths)
    found: list[PlannedPath] = []
    for k, start in enumerate(begun):
        x = start.x
        for weight in weights:  # the safest first: it needs the most steps, and its line the least change
            path = improve(cfg, model, problem, x, weight, shortest)
            if path is not None:
                found.append(replace(path, origin=f"{start.origin}, smoothed at risk weight {weight:g}"))
                x = path.x
        if progress is not None:
            progress(k + 1, len(begun))
    return worthwhile(problem, found, paths)


def bent(
    cfg: SmoothingConfig, model: Programme, problem: Problem, begun: Sequence[Start], weights:
    Sequence[float], shortest: float, progress: Callable[[int, int], None] | None,
) -> list[PlannedPath]:  # fmt: skip
    """Of full fidelity: every start at the safest weight, then the best of them with other numbers of
    steps, and what comes
    of these at the other weights."""
    safest = weights[0]
    first: list[tuple[float, str, PlannedPath]] = []
    jobs = len(begun) + min(RETIMED, len(begun))
    for k, start in enumerate(begun):
        path = descend(cfg, model, problem, start.x, safest, shortest)
        if path is not None:
            first.append((merit(path, safest, shortest, full=True), start.origin, path))
        if progress is not None:
            progress(k + 1, jobs)
    first.sort(key=lambda job: job[0])
    found = [replace(path, origin=f"{name}, smoothed at risk weight {safest:g}") for _, name, path in first]
    for k, (_, name, path) in enumerate(first[:RETIMED]):
        best = retimed(cfg, model, problem, path, safest, shortest)
        for weight in weights:
            if weight != safest:
                best = descend(cfg, model, problem, best.x, weight, shortest) if best is not None else None
            if best is not None:
                found.append(replace(best, origin=f"{name}, smoothed at risk weight {weight:g}"))
        if progress is not None:
            progress(len(begun) + k + 1, jobs)
    return found


def worthwhile(
    problem: Problem, found: Sequence[PlannedPath], paths: Sequence[PlannedPath]
) -> tuple[PlannedPath, ...]:
    """Those of ``found`` that nothing else equals to a thousandth, with their ordered bound."""
    full = problem.tables.full
    rows = [_row(p, full) for p in paths]
    kept = []
    for path in sorted(found, key=lambda p: tuple(_row(p, full))):
        row = _row(path, full)
        if not any((other <= row * (1 + ALIKE)).all() for other in rows):
            rows.append(row)
            kept.append(path)
    finished = []
    for path in kept:
        with suppress(InfeasibleError):  # R above planner.delta
            finished.append(evaluate(problem, path.x, path.origin))
    return tuple(finished)


def _row(path: PlannedPath, full: bool) -> FloatArray:
    o = path.objectives
    return np.array([o.mission_risk if full else o.mission_risk_paper, o.collision_risk, o.length])


def starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath]) -> list[Start]:
    """A taut line for every mission order, then the paths themselves, pulled and flown in the fewest steps.

    Under uncertainty a taut line visits the middle of each region, since steps can be taken from a path
    more easily than added.
    """
    if problem.tables.full:
        return safe_starts(cfg, problem, paths)
    depth = 1.0 if any(path.cov.any() for path in paths) else 0.0
    found: list[Start] = []
    firsts: dict[Order, PlannedPath] = {}
    for path in paths:
        plan = order(problem, path)
        if plan is not None:
            firsts.setdefault(plan, path)
    for plan, path in firsts.items():
        line = taut(problem, plan, path, depth)
        x = None if line is None else walk(problem, line)
        if x is not None and completes(problem, x):
            found.append(Start(x, plan, f"{path.origin}, drawn taut"))
    for k in np.unique(np.linspace(0, len(paths) - 1, min(cfg.candidates, len(paths))).astype(int)):
        x = shortened(problem, paths[k].x)
        start = Start(paths[k].x if x is None else x, order(problem, paths[k]), paths[k].origin)
        if not any(_alike(problem, start, other) for other in found):
            found.append(start)
    fewest = min((len(start.x) for start in found), default=0)
    return [start for start in found if 1 < len(start.x) <= LONG * fewest][: cfg.candidates]


def safe_starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[PlannedPath]) -> list[Start]:
    """Of full fidelity: taut lines for every order that the automaton allows, then the trees' safest paths.

    A line keeps as many standard deviations as lets it through, and is walked with a few steps to spare,
    which :func:`retimed` takes out again. Tree paths fill what is left, the safest of each order first.
    """
    plans = dict.fromkeys(possible_orders(problem, cfg.candidates))
    plans |= dict.fromkeys(plan for plan in (order(problem, path) for path in paths) if plan is not None)
    found: list[Start] = []
    for plan in plans:
        for z in DISTANCES:
            apart = replace(problem, tables=problem.tables._replace(z=z))
            line = taut(apart, plan, paths[0], 1.0)
            x = None if line is None else walk(apart, line)
            if x is not None and completes(problem, x) and len(x) - 1 + SPARE <= problem.horizon:
                longer = resampled(x, len(x) - 1 + SPARE)
                found.append(Start(longer, plan, f"drawn taut, {z:g} deviations from obstacles"))
                break
    ranked = sorted(paths, key=lambda p: p.objectives.mission_risk + p.objectives.collision_risk)
    taken: dict[Order | None, int] = {}
    for path in ranked:
        own = order(problem, path)
        start = Start(resampled(path.x, min(len(path.u) + SPARE, problem.horizon)), own, path.origin)
        if taken.get(own, 0) < EACH and not any(_alike(problem, start, other) for other in found):
            taken[own] = taken.get(own, 0) + 1
            found.append(start)
    return found[: cfg.candidates]


def _alike(problem: Problem, one: Start, other: Start) -> bool:
    """Whether two lines are never more than half a step apart."""
    if one.plan != other.plan:
        return False
    gap = np.linalg.norm(one.x[:, None] - other.x[None], axis=2)
    return bool(max(gap.min(axis=0).max(), gap.min(axis=1).max()) < problem.reach / 2)


def shortened(problem: Problem, x: FloatArray) -> FloatArray | None:
    """``x`` pulled taut between its witnesses and flown in the fewest steps; None where the mission fails."""
    cov = propagate(problem, x)
    y = walk(problem, pull(problem, x, cov, [t for t, _ in duties(problem, x, cov).witness]))
    return y if y is not None and completes(problem, y) else None


def completes(problem: Problem, x: FloatArray) -> bool:
    """Whether the labels along ``x`` complete the mission, flyable or not."""
    logic = problem.tables.logic
    return bool(logic.distance[_states(logic, problem.locate(x))[-1]] == 0.0)


def fitting(problem: Problem, begun: Sequence[Start]) -> Programme:
    """A programme that all starts fit into, in sizes rounded up so that they seldom change."""
    steps = max(len(start.x) for start in begun) - 1
    witnesses = max(len(duties(problem, start.x, propagate(problem, start.x)).witness) for start in begun)
    faces = int(np.diff(problem.tables.regions.faces.ptr).max())
    return programme(problem, -(-steps // 8) * 8, witnesses + 1, faces)


def improve(
    cfg: SmoothingConfig, model: Programme, problem: Problem, x: FloatArray, weight: float, shortest: float
) -> PlannedPath | None:
    """Bend, then once more with the steps that this set free taken out; None where nothing flew."""
    best = rounds(cfg, model, problem, x, weight, shortest)
    if best is None:
        return None
    y = shortened(problem, best.x)
    if y is None or len(y) >= len(best.x):
        return best
    other = rounds(cfg, model, problem, y, weight, shortest)
    if other is None:
        return best
    return min(best, other, key=lambda path: merit(path, weight, shortest, problem.tables.full))


def descend(
    cfg: SmoothingConfig, model: Programme, problem: Problem, x: FloatArray, weight: float, shortest: float
) -> PlannedPath | None:
    """Bend and fly by turns with a trust region that follows success; the best that flew.

    Of full fidelity the covariance depends on the path, so a step that promised a gain may not keep it: it
    is then tried again from the best path, not so far.
    """
    best = fly(problem, x)
    value = math.inf if best is None else merit(best, weight, shortest, full=True)
    trust = cfg.trust
    for _ in range(ROUNDS_FULL):
        base = x if best is None else best.x
        y = bend(model, problem, base, propagate(problem, base), weight, trust, shortest)
        if y is None:
            break
        path = fly(problem, y)
        if path is None and best is None:
            x, trust = y, max(trust * MENDING, cfg.trust * NARROWEST)
            continue
        now = math.inf if path is None else merit(path, weight, shortest, full=True)
        gain = (value - now) / now if now < math.inf else -1.0
        if path is not None and gain > 0.0:
            best, value, trust = path, now, min(cfg.trust, WIDER * trust)
        else:
            trust *= NARROWER
        if trust < cfg.trust * NARROWEST or 0.0 <= gain < GAIN_FULL:
            break
    return best


def retimed(
    cfg: SmoothingConfig,
    model: Programme,
    problem: Problem,
    best: PlannedPath | None,
    weight: float,
    shortest: float,
) -> PlannedPath | None:
    """``best`` or what comes of it with fewer or more steps: time costs covariance, haste costs detours."""
    for change in STRIDES:
        while best is not None:
            steps = len(best.u) + change
            if not 2 <= steps <= min(model.steps, problem.horizon):
                break
            other = descend(cfg, model, problem, resampled(best.x, steps), weight, shortest)
            worth = merit(best, weight, shortest, full=True) * (1.0 - GAIN_FULL)
            if other is None or merit(other, weight, shortest, full=True) >= worth:
                break
            best = other
    return best


def resampled(x: FloatArray, steps: int) -> FloatArray:
    """``x`` (T+1, 2) walked in ``steps`` steps, each the same share of the old time."""
    old, new = np.linspace(0.0, 1.0, len(x)), np.linspace(0.0, 1.0, steps + 1)
    return np.column_stack([np.interp(new, old, x[:, i]) for i in (0, 1)])


def rounds(
    cfg: SmoothingConfig, model: Programme, problem: Problem, x: FloatArray, weight: float, shortest: float
) -> PlannedPath | None:
    """Bend and fly by turns until there is nothing to gain; the best that flew."""
    best, value = None, math.inf
    for _ in range(cfg.rounds):
        y = bend(model, problem, x, propagate(problem, x), weight, cfg.trust, shortest)
        if y is None:
            break
        path = fly(problem, y)
        if path is None and best is not None:
            path = damped(problem, best.x, y)
        x = y
        if path is None:
            continue
        now = merit(path, weight, shortest, problem.tables.full)
        gain = (value - now) / now
        if gain > 0.0:
            best, value = path, now
        if gain < GAIN:
            break
    return best


def merit(path: PlannedPath, weight: float, shortest: float, full: bool = False) -> float:
    """length / shortest + λ (mission risk + R), the former f_o or V."""
    o = path.objectives
    return o.length / shortest + weight * (
        (o.mission_risk if full else o.mission_risk_paper) + o.collision_risk
    )


def fly(problem: Problem, x: FloatArray) -> PlannedPath | None:
    """The path along ``x`` if it is feasible and completes the mission."""
    try:
        path = evaluate(problem, x, "", tight=False)
    except InfeasibleError:
        return None
    return path if accepted(problem, path) else None


def damped(problem: Problem, old: FloatArray, new: FloatArray) -> PlannedPath | None:
    """The longest of a few steps from what flew towards what did not."""
    for s in (0.5, 0.25, 0.125):
        path = fly(problem, old + s * (new - old))
        if path is not None:
            return path
    return None
