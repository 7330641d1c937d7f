"""The front of failure rate and length: sweeps of the length cap in the best classes of paths.

Scouts (:func:`scouts`) have different flights. The first one ranks all starts by one simulation and polishes
the most promising cheaply (``looks``); the others fly what it found with their flights. Each finds the
lengths that reduce the failure rate, and from the longest of these its cap falls until no path satisfies it
(``levels``). A level begins with the best classes of the level before, in several numbers of steps from the
fewest upwards.

The paths of all scouts are then compared by the same flights. Points along their front are polished on more
flights, and the safest is lengthened. More points come into the widest gaps, and all are polished at last
within the chance constraints of all segments (``last_polish``).

For a robot with a power curve, points of the front are also polished in more steps: at lower airspeeds a path
may take less energy.

With a time budget the sweeps end when most of it is spent. If some is left after them, paths of the front are
varied and polished again until it is spent.

The time of a search is proportional to the number of steps. Long paths are therefore refined in about
``Effort.legs`` runs of two and more steps with one control each, none longer than the share
``SHARE_OF_PLACE`` of the narrowest place, so that no flight passes a region between two of its positions. The
wind of a run is the wind of its middle, its gust the mean of the gusts of its steps: the flights are the
same. The paths are then polished once more, checked and judged in all steps. Steps are merged in the coherent
law only, whose gusts are averaged over time, and for missions without time windows, which are read at the
steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import chain, count

import numpy as np

from careful_io.machine import on_all_cores
from careful_io.texts import distance_text
from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.problem import Problem, with_merged_steps
from pareto_ltl.planning.records import Forest, PlannedPath
from pareto_ltl.planning.refine import last_polish
from pareto_ltl.planning.refine.effort import Effort
from pareto_ltl.planning.refine.levels import looks, swept_down
from pareto_ltl.planning.refine.sampled import Candidate, divided
from pareto_ltl.planning.refine.starts import (
    Start,
    StartKind,
    first_starts,
    flipped_starts,
    retimed_means,
    tree_starts,
    unlike_starts,
)
from pareto_ltl.planning.refine.sweep import SCOUT_STEPS, Draw, Progress, Sweep, front_of, new_sweep
from pareto_ltl.planning.separation import excess
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.budget import UNLIMITED, Budget
from pareto_ltl.world.time_step import SHARE_OF_PLACE, narrowest_place

LONG = 1e5  # [m] lengths above have no decimals in messages


def sampled_paths(
    effort: Effort, problem: Problem, forest: Forest | None, draw: Draw,
    progress: Progress | None = None, budget: Budget = UNLIMITED,
) -> tuple[PlannedPath, ...]:  # fmt: skip
    """Paths of many lengths on which few of the common flights fail, shortest first; ``draw`` makes these.

    It is empty if there is no start, or if none became a path that can be flown; a warning then says why.
    """
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(first_starts, problem, forest, effort)
        sweep = new_sweep(effort, problem, draw, budget, progress)
        starts = found.result()
    sweep = replace(sweep, spread=typical_spread(problem, starts.values()))
    times = steps_to_merge(effort, problem, starts.values())
    if times > 1:
        merged = with_merged_steps(problem, times)
        runs = starts_in_merged_steps(effort, problem, merged, forest, times)
        if runs:  # else the wind ends too soon
            long = new_sweep(effort, merged, lambda n: draw(n).merged(merged, times), budget, progress)
            long = replace(long, spread=sweep.spread)
            ended = on_all_cores(partial(in_all_steps, sweep, times), _searches(long, runs))
            return _paths_of(sweep, ended, partial(slower_runs, sweep, times))
    return _paths_of(sweep, _searches(sweep, starts), partial(last_polish.repaired, sweep))


def _searches(sweep: Sweep, starts: Mapping[StartKind, Start]) -> list[tuple[Candidate, Candidate]]:
    """What the search finds, each path before and after its last solve (``closed``).

    Where none keeps epsilon, more solves within the chance constraints bring all nearer to it, a little
    longer where that helps.
    """
    seen, known = list[Candidate](), list[Candidate]()
    for scout in scouts(sweep):
        seen = scout.compared(seen) if seen else looks(scout, starts)
        known += _compared(sweep, scout, swept(scout, seen))
    found = finished(sweep, known)
    ended = on_all_cores(partial(last_polish.closed, sweep), found)
    if all(excess(sweep.problem, end.flight).any() for end in ended):
        caps = [sweep.effort.lengthened * end.length for end in ended]
        ended = on_all_cores(partial(last_polish.nearer, sweep), ended, caps)
    return list(zip(found, ended, strict=True))


def _compared(sweep: Sweep, scout: Sweep, found: Sequence[Candidate]) -> list[Candidate]:
    """The front of what a scout has ``found``, and the best of each class, by the flights of ``sweep``."""
    chosen = {id(k): k for k in (*front_of(found), *scout.best_of_classes(found, more=sweep.effort.compared))}
    return on_all_cores(partial(sweep.reassessed, flights=sweep.flights), chosen.values())


def scouts(sweep: Sweep) -> Iterator[Sweep]:
    """Sweeps that differ in their flights, of ``sweep.flights`` if there are enough; one of a coarse search.

    What a sweep misses depends on which flights it is fitted to, more than on how many: on five missions
    four times as many flights did not make seeds agree better, and a second sweep did.
    """
    number, n = sweep.effort.scouts, len(sweep.few)
    drawn = sweep.flights if number * n <= len(sweep.flights) else sweep.many()
    for k in range(number):
        few = drawn.only(np.sort((np.arange(n) + k * n) % len(drawn)))
        budget = sweep.budget.until(sweep.effort.sweep_share * (k + 1) / number)
        yield replace(sweep, few=few, budget=budget, before=SCOUT_STEPS * k)


def _paths_of(
    sweep: Sweep, ended: Sequence[tuple[Candidate, Candidate]],
    mended: Callable[[Candidate], Iterable[Candidate]],
) -> tuple[PlannedPath, ...]:  # fmt: skip
    """The paths of candidates, each before and after its last solve; ``mended`` are variants of one."""
    begun = {id(end): k for k, end in ended}

    def repairs(k: Candidate) -> Iterator[Candidate]:
        yield begun[id(k)]  # the last solves may have left a region that hardly any flight reaches
        yield from mended(k)

    return last_polish.planned_paths(sweep.problem, [end for _, end in ended], repairs)


def swept(scout: Sweep, seen: Sequence[Candidate]) -> list[Candidate]:
    """All paths that a scout finds in its sweeps, and those ``seen``."""
    scout = replace(scout, hope=scout.hope_of(seen))
    _report(scout, 1, seen)
    levels = swept_down(scout, seen)
    found = [*seen, *chain(*levels)]
    _report(scout, 2, found)
    return found


def finished(sweep: Sweep, known: Sequence[Candidate]) -> list[Candidate]:
    """Non-dominated candidates in length and smoothed failure, shortest first, polished on all flights.

    With a power curve, slower ones that take less energy follow.
    """
    sweep = replace(sweep, hope=sweep.hope_of(known))
    front = front_of(filter(sweep.hope.holds, known)) or front_of(known)[:1]
    front = front[: 1 + sum(k.smoothed >= sweep.effort.least for k in front)]  # longer ones fail no less
    for better in improved_fronts(sweep, front):
        front = better
        _report(sweep, 0, front)
    found = front_of(last_polish.finished_points(sweep, front))
    found = front_of([*found, *last_polish.lengthened_points(sweep, found)])
    found = last_polish.divided_gaps(sweep, found)
    _report(sweep, 1, found)
    return [*found, *last_polish.slower_points(sweep, found)]


# --- what is left of a time budget ---------------------------------------------------------------


def improved_fronts(sweep: Sweep, front: Sequence[Candidate]) -> Iterator[list[Candidate]]:
    """Improved fronts, one after another, until most of the budget is spent; none without a time budget.

    An iteration takes random points of the front. Each is polished again at its length, from its neighbours,
    from a line on the other side of an obstacle, in other numbers of steps, and from itself, bent at random.
    """
    rounds = count() if sweep.budget.seconds is not None and front else iter(())
    kept = list(front)
    for number in rounds:
        if sweep.over:
            return
        rng = np.random.default_rng(number)
        for at in rng.permutation(len(kept))[: sweep.effort.varied].tolist():
            kept = front_of([*kept, *_varied(sweep, kept, min(at, len(kept) - 1), rng)])
        yield kept


def _varied(sweep: Sweep, front: Sequence[Candidate], at: int, rng: np.random.Generator) -> list[Candidate]:
    """Random variations of one point, polished at the same length."""
    effort, k, problem = sweep.effort, front[at], sweep.problem
    near = [front[i] for i in (at - 1, at + 1) if 0 <= i < len(front)]
    lines = [(n.flight.x, 0, n.origin) for n in near]
    steps = rng.choice(effort.varied_steps, 2, replace=False).tolist()
    lines += [(k.flight.x, more, k.origin) for more in steps]
    flipped = flipped_starts(problem, k.flight.x, k.origin)[: effort.flipped]
    lines += [(start.x, 1, start.origin) for start in flipped]
    lines += [(_bent(sweep, k.flight.x, rng), 1, k.origin)]
    return sweep.held_within(lines, effort.wide, k.length)


def _bent(sweep: Sweep, x: FloatArray, rng: np.random.Generator) -> FloatArray:
    """``x`` with a bump of random place and size; its start does not move, and it stays on the map."""
    low, high = sweep.problem.scene.bounds
    t = np.linspace(0.0, 1.0, len(x))
    bump = np.exp(-0.5 * ((t - rng.random()) / rng.uniform(0.03, 0.15)) ** 2) * np.minimum(t / 0.05, 1.0)
    aside = rng.normal(0.0, sweep.effort.bump * (high - low).mean(), 2)
    return np.clip(x + bump[:, None] * aside, low, high)


def _report(sweep: Sweep, done: int, found: Iterable[Candidate]) -> None:
    """Report the front of a search after its first ``done`` steps."""
    front = front_of(found)
    if sweep.progress is None or not front:
        return
    shortest, safest = (distance_text(k.length, 0 if k.length > LONG else 1) for k in (front[0], front[-1]))
    fails = f"the safest fails {100 * front[-1].failed:.2g} % at {safest}"
    state = f"{len(front)} paths of at least {shortest}; {fails}"
    total, shown = sweep.all_steps, [(k.failed, k.flight.x) for k in front]
    sweep.progress(min(sweep.before + done, total), total, state, shown)


# --- long paths -----------------------------------------------------------------------------------


def steps_to_merge(effort: Effort, problem: Problem, starts: Iterable[Start]) -> int:
    """How many steps of ``problem`` are one step of the search from ``starts``; 1 if they are not merged."""
    fewest = min((len(start.x) - 1 for start in starts), default=0)
    law = problem.world.law
    moving = bool((problem.motion.a != np.eye(2)).any())
    apart = isinstance(law, kd.IndependentLaw) or len(problem.logic.delta) > 1 or moving
    if apart:
        return 1
    marks = (
        [2.0 * float(radius) for radius in law.landmarks.disc[:, 2]]
        if isinstance(law, kd.LandmarkLaw)
        else []
    )
    width = min([narrowest_place(problem.scene).width, *marks])
    return max(1, min(round(fewest / effort.legs), int(SHARE_OF_PLACE * width / problem.reach)))


def typical_spread(problem: Problem, starts: Iterable[Start]) -> float:
    """Standard deviation [m] in one direction of flights along the first start: the median over its steps."""
    start = next(iter(starts), None)
    if start is None:
        return math.inf
    cov = propagate(problem, start.x).cov
    return math.sqrt(0.5 * float(np.median(cov[:, 0] + cov[:, 2])))


def starts_in_merged_steps(
    effort: Effort, problem: Problem, merged: Problem, forest: Forest | None, times: int
) -> dict[StartKind, Start]:
    """The starts of ``merged``: its lines, and tree paths at every ``times``-th step and at the last one."""
    grown = [
        replace(start, x=np.vstack([start.x[:-1:times], start.x[-1:]]))
        for start in ([] if forest is None else tree_starts(problem, forest, effort))
    ]
    return unlike_starts(merged, [*first_starts(merged, None, effort).values(), *grown])


def in_all_steps(sweep: Sweep, times: int, ended: tuple[Candidate, Candidate]) -> tuple[Candidate, Candidate]:
    """A path before and after its last solve in all steps: straight runs, the last one polished.

    The polish is left out if a segment then breaks epsilon.
    """
    begun, end = (_divided(sweep, times, k) for k in ended)
    how = sweep.polish_of(sweep.effort.finest)
    flight = sweep.refiner.polished(end.flight.x, sweep.flights, how, end.length)
    if not excess(sweep.problem, flight).any():
        end = end.moved(flight)
    return begun, end


def slower_runs(sweep: Sweep, times: int, k: Candidate) -> Iterator[Candidate]:
    """``k`` in all steps, polished with one run of steps more and with two; without its chance constraints.

    The convex programme of :func:`~.last_polish.closed` needs 8 GiB for 1,300 steps.
    """
    for more in (times, 2 * times):
        x = retimed_means(sweep.problem, k.flight.x, min(k.steps + more, sweep.problem.horizon))
        flight = sweep.refiner.polished(x, sweep.flights, sweep.polish_of(sweep.effort.finest), k.length)
        yield k.moved(flight)


def _divided(sweep: Sweep, times: int, k: Candidate) -> Candidate:
    return k.moved(sweep.refiner.flown(divided(k.flight.x, times)))
