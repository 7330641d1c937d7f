"""Smoothing as a whole: where to begin, rounds of bending, what is worth keeping."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pareto_ltl.arrays import FloatArray
from pareto_ltl.config import SmoothingConfig
from pareto_ltl.errors import InfeasibleError
from pareto_ltl.problem import Problem, accepted, evaluate
from pareto_ltl.records import Path
from pareto_ltl.smoothing.duties import _states, duties, propagate
from pareto_ltl.smoothing.lines import Order, order, pull, taut, walk
from pareto_ltl.smoothing.programme import Programme, bend, programme

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
    paths: Sequence[Path],
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Path, ...]:
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
    wanted = cfg.enabled and len(paths) > 0 and len(problem.tables.regions.atom) > 0
    begun = starts(cfg, problem, paths) if wanted else []
    if not begun:
        return ()
    certain = not any(path.cov.any() for path in paths)
    weights = [0.0] if certain else sorted(cfg.weights, reverse=True)
    model = fitting(problem, begun)
    shortest = min(p.objectives.length for p in paths)
    found: list[Path] = []
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


def worthwhile(problem: Problem, found: Sequence[Path], paths: Sequence[Path]) -> tuple[Path, ...]:
    """Those of ``found`` that nothing else equals to a thousandth, with their ordered bound."""
    rows = [_row(p) for p in paths]
    kept = []
    for path in sorted(found, key=lambda p: tuple(_row(p))):
        row = _row(path)
        if not any((other <= row * (1 + ALIKE)).all() for other in rows):
            rows.append(row)
            kept.append(path)
    return tuple(evaluate(problem, p.x, p.origin) for p in kept)


def _row(path: Path) -> FloatArray:
    o = path.objectives
    return np.array([o.mission_risk_paper, o.collision_risk, o.length])


def starts(cfg: SmoothingConfig, problem: Problem, paths: Sequence[Path]) -> list[Start]:
    """A taut line for every mission order, then the paths themselves, pulled and flown in the fewest steps.

    Under uncertainty a taut line visits the middle of each region, since steps can be taken from a path
    more easily than added.
    """
    depth = 1.0 if any(path.cov.any() for path in paths) else 0.0
    found: list[Start] = []
    firsts: dict[Order, Path] = {}
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
) -> Path | None:
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
    return min(best, other, key=lambda path: merit(path, weight, shortest))


def rounds(
    cfg: SmoothingConfig, model: Programme, problem: Problem, x: FloatArray, weight: float, shortest: float
) -> Path | None:
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
        now = merit(path, weight, shortest)
        gain = (value - now) / now
        if gain > 0.0:
            best, value = path, now
        if gain < GAIN:
            break
    return best


def merit(path: Path, weight: float, shortest: float) -> float:
    """length / shortest + λ (f_o + R)."""
    o = path.objectives
    return o.length / shortest + weight * (o.mission_risk_paper + o.collision_risk)


def fly(problem: Problem, x: FloatArray) -> Path | None:
    """The path along ``x`` if it is feasible and completes the mission."""
    try:
        path = evaluate(problem, x, "", ordered=False)
    except InfeasibleError:
        return None
    return path if accepted(problem, path) else None


def damped(problem: Problem, old: FloatArray, new: FloatArray) -> Path | None:
    """The longest of a few steps from what flew towards what did not."""
    for s in (0.5, 0.25, 0.125):
        path = fly(problem, old + s * (new - old))
        if path is not None:
            return path
    return None
