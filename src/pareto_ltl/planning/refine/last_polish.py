"""The last polish: points of the front on more flights, and the paths that they become."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise, product

import numpy as np

from careful_io.machine import on_all_cores
from pareto_ltl.planning.evaluate import completing_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.refine.sampled import Candidate
from pareto_ltl.planning.refine.starts import retimed_means
from pareto_ltl.planning.refine.sweep import Sweep, front_of, smoothed, spread_points
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.separation import excess
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError

LOG = logging.getLogger(__name__)


def finished_points(sweep: Sweep, front: Sequence[Candidate]) -> list[Candidate]:
    """Points along the front polished on all flights; when time is up, the rest unchanged."""
    points = spread_points(sweep.effort, front, _evenly(sweep))

    def one(point: tuple[Candidate, float]) -> Candidate:
        return point[0] if sweep.budget.over() else finished_point(sweep, *point)

    return on_all_cores(one, [*points[::2], *points[1::2]])  # with little time, every other one


def lengthened_points(sweep: Sweep, found: Sequence[Candidate]) -> list[Candidate]:
    """The safest of the finished points lengthened, until two lengths in a row do not reduce the failure.

    The sweeps end at a length where few flights show no gain; here all of them decide. At each length the
    path also returns to one of its places, to the one where this saves most.
    """
    effort = sweep.effort
    made, best = list[Candidate](), found[-1] if found else None
    while best is not None and best.failed * effort.all_flights >= effort.few and not sweep.budget.over():
        forms = list[tuple[Candidate, float]]()
        for cap in (effort.lengthened * best.length, effort.lengthened**3 * best.length):
            again = sweep.held_within(sweep.returning_lines(best, cap), effort.wide, cap)
            forms += [(k, cap) for k in (best, *sorted(again, key=smoothed)[:1])]
        longer = on_all_cores(partial(finished_point, sweep), *zip(*forms, strict=True))
        better = [k for k in longer if sweep.pays(k, best, sweep.flights)]
        best = min(better, key=lambda k: k.length, default=None)
        made += longer
    return made


def _evenly(sweep: Sweep) -> int:
    """How many points are spread along a front, before the others come into its gaps."""
    return max(sweep.effort.points // 2, 2)


def divided_gaps(sweep: Sweep, found: Sequence[Candidate]) -> list[Candidate]:
    """The front ``found`` with points in its widest gaps, each polished from the longer of its neighbours.

    It is polished from the shorter one, too, if that is of another class.

    The width of a gap is what a point in it can add to the hypervolume: the product of the differences of
    its ends in the logarithms of length and of failure, as far as flights distinguish it. In each round the
    widest gaps are divided.
    """
    effort, front, tried = sweep.effort, list(found), set[tuple[float, float]]()

    def width(gap: tuple[Candidate, Candidate]) -> float:
        below, above = gap
        failures = [max(k.smoothed, effort.least) for k in gap]
        return math.log(above.length / below.length) * math.log(failures[0] / failures[1])

    def one(gap: tuple[Candidate, Candidate]) -> Candidate:
        below, above = gap
        if sweep.budget.over():
            return above
        ends = [above] if sweep.class_of(below) == sweep.class_of(above) else [above, below]
        cap = math.sqrt(below.length * above.length)
        return min((finished_point(sweep, k, cap) for k in ends), key=smoothed)

    left = effort.points - _evenly(sweep)
    for first in range(0, left, effort.gaps):
        new = (
            gap for gap in pairwise(front) if width(gap) > 0.0 and (gap[0].length, gap[1].length) not in tried
        )
        widest = sorted(new, key=width, reverse=True)[: min(effort.gaps, left - first)]
        tried |= {(below.length, above.length) for below, above in widest}
        front = front_of([*front, *on_all_cores(one, widest)])
    return front


def finished_point(sweep: Sweep, k: Candidate, cap: float) -> Candidate:
    """``k`` polished at a length cap; on more flights if few of them fail, since those decide.

    Where its airspeeds leave half a step or more to spare, it is also polished in fewer steps.
    """
    problem, refiner = sweep.problem, sweep.refiner
    how = sweep.polish_of(sweep.effort.last)
    made = refiner.polish(_fitting(problem, k, cap), sweep.flights, how, cap, k.origin)
    if fewer := min(round(spare_steps(made)), made.steps - 1):  # a path has at least one step
        x = retimed_means(problem, made.flight.x, made.steps - fewer)
        made = min(made, refiner.polish(x, sweep.flights, how, cap, k.origin), key=smoothed)
    if not _rarely_fails(sweep, made):
        return made
    return refiner.polish(made.flight.x, sweep.many(), sweep.polish_of(sweep.effort.finest), cap, k.origin)


def _rarely_fails(sweep: Sweep, k: Candidate) -> bool:
    """Whether too few of the usual flights of ``k`` fail to polish with, though some do."""
    few, failed = sweep.effort.few / sweep.effort.all_flights, k.failed
    return few <= failed < sweep.effort.rare / len(sweep.flights)


def closed(sweep: Sweep, k: Candidate) -> Candidate:
    """``k`` after the last solve, by the convex programme; its failures are those before."""
    flights = (sweep.many() if _rarely_fails(sweep, k) else sweep.flights).exact()
    how = sweep.polish_of(sweep.effort.closing)
    end = k.moved(sweep.closing.polished(k.flight.x, flights, how, k.length))
    return nearer(sweep, end, k.length) if excess(sweep.problem, end.flight).any() else end


def nearer(sweep: Sweep, k: Candidate, longest: float) -> Candidate:
    """``k`` after more solves within the chance constraints, about ``longest`` [m] at most."""
    how = sweep.polish_of(sweep.effort.nearer)
    return k.moved(sweep.closing.polished(k.flight.x, sweep.few, how, longest))


def spare_steps(k: Candidate) -> float:
    """By how many steps ``k`` takes longer than at full airspeed along the same controls."""
    speeds = np.linalg.norm(k.flight.u, axis=1) / np.maximum(CAP * k.flight.speed, 1e-9)
    return float(np.maximum(1.0 - speeds, 0.0).sum())


def _fitting(problem: Problem, k: Candidate, cap: float) -> FloatArray:
    """The means of ``k`` in as many steps as suit the cap: fewer if ``k`` is longer than it."""
    steps = min(max(2, round(k.steps * cap / k.length)), problem.horizon)
    return k.flight.x if steps == k.steps else retimed_means(problem, k.flight.x, steps)


def slower_points(sweep: Sweep, found: Sequence[Candidate]) -> list[Candidate]:
    """Points along the front polished in more steps, if they then take less energy.

    The list is empty without a power curve.
    """
    problem, energy = sweep.problem, sweep.problem.energy
    if energy is None or not found:
        return []
    effort, how, dt = sweep.effort, sweep.polish_of(sweep.effort.last), problem.motion.dt

    def slower(pair: tuple[Candidate, float]) -> Candidate | None:
        k, times = pair
        steps = min(int(np.ceil(times * k.steps)), problem.horizon)
        if steps <= k.steps or sweep.budget.over():
            return None
        x = retimed_means(problem, k.flight.x, steps)
        made = sweep.refiner.polish(x, sweep.flights, how, k.length, f"{k.origin}, slower")
        return made if energy.of(made.flight.u, dt) < energy.of(k.flight.u, dt) else None

    chosen = found[:: -(-len(found) // effort.economic)]
    made = on_all_cores(slower, product(chosen, effort.economic_steps))
    hope = sweep.hope_of(found)
    return [k for k in made if k is not None and hope.holds(k)]


# --- paths ------------------------------------------------------------------------------------


def planned_paths(
    problem: Problem,
    found: Sequence[Candidate],
    repairs: Callable[[Candidate], Iterable[Candidate]] = lambda _: (),
) -> tuple[PlannedPath, ...]:
    """The candidates that can be flown and whose expected path completes the mission, as paths.

    ``repairs`` gives variants of one that is not; a warning names the best candidate without such a variant.
    """
    paths, faults = list[PlannedPath](), list[tuple[Candidate, str]]()
    for k in found:
        path, fault = _path_of(problem, k)
        if path is None:
            path = next(
                (p for p, _ in (_path_of(problem, other) for other in repairs(k)) if p is not None), None
            )
        if path is None:
            faults.append((k, fault))
        else:
            paths.append(path)
    if faults:
        k, fault = min(faults, key=lambda row: row[0].smoothed)
        best = f"{k.origin}, {k.length / 1e3:.1f} km, {k.steps} steps, fails {100 * k.failed:.2g} %"
        LOG.warning(
            "%d of %d refined paths cannot be flown; the best of them (%s): %s",
            len(faults), len(found), best, fault,
        )  # fmt: skip
    return tuple(paths)


def _path_of(problem: Problem, k: Candidate) -> tuple[PlannedPath | None, str]:
    """The path of a candidate; None, and why, if it cannot be flown or does not complete the mission."""
    try:
        return completing_path(problem, k.flight.x, f"{k.origin}, refined"), ""
    except InfeasibleError as error:
        return None, str(error)


def repaired(sweep: Sweep, k: Candidate) -> Iterator[Candidate]:
    """``k`` polished again, in more steps each time: slower, and closer to the places to be visited."""
    how = sweep.polish_of(sweep.effort.finest)
    for more in sweep.effort.repairs:
        x = retimed_means(sweep.problem, k.flight.x, min(k.steps + more, sweep.problem.horizon))
        made = sweep.refiner.polish(x, sweep.flights, how, k.length, k.origin)
        yield closed(sweep, made)
