"""What all polishes of a front share: flights, time budget, length caps, polishes of lines within a cap."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from careful_io.machine import made_once, on_all_cores
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.effort import Effort, Polish
from pareto_ltl.planning.refine.sampled import (
    Candidate,
    CommonFlights,
    ConstrainedRefiner,
    Refiner,
    fewest_steps,
    steps_needed,
)
from pareto_ltl.planning.refine.starts import (
    Start,
    flipped_starts,
    retimed_means,
    returning_starts,
    unlike_starts,
)
from pareto_ltl.planning.routes.path_classes import PathClass, path_class
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.budget import UNLIMITED, Budget

Item = TypeVar("Item")
Progress = Callable[..., None]
Draw = Callable[[int], CommonFlights]  # the first of the common flights

SCOUT_STEPS = 2  # that are reported of each scout


class Hope(NamedTuple):
    """What the smoothed ``failure`` of a path is below, and the ``total`` with its breach of epsilon."""

    failure: float = 1.0
    total: float = 1.0

    def holds(self, k: Candidate) -> bool:
        """Whether ``k`` is searched on."""
        return k.failure < self.failure and k.smoothed < self.total


SOME = Hope()  # not to fail in all flights


@dataclass(frozen=True, slots=True)
class Sweep:
    """What all polishes of a front share.

    The common flights, the time ``budget``, what paths have to reach (``hope``), and the ``spread`` of
    flights about a path, their typical standard deviation [m].

    ``progress`` is called with the steps of the search, the ``before`` steps of other scouts counted.

    The last polish is made by ``closing``, within the chance constraints.

    Sweeps use ``few`` flights, the last polish ``flights``, and paths that rarely fail ``many()``, which are
    drawn when they are first used: the first of the same flights, in the linearised law until the last solve
    (``closed``).
    """

    effort: Effort
    problem: Problem
    refiner: Refiner
    closing: ConstrainedRefiner
    few: CommonFlights
    flights: CommonFlights
    many: Callable[[], CommonFlights]
    budget: Budget = UNLIMITED
    progress: Progress | None = None
    before: int = 0
    hope: Hope = SOME
    spread: float = math.inf

    @property
    def over(self) -> bool:
        """Whether so much of the budget is spent that only the last polish is left to do."""
        return self.budget.over(self.effort.sweep_share)

    @property
    def all_steps(self) -> int:
        """The steps that are reported: some of each scout, and the last polish."""
        return SCOUT_STEPS * self.effort.scouts + 1

    @property
    def map_size(self) -> float:
        """Mean of the map's extents [m]."""
        return float(np.ptp(self.problem.scene.bounds, axis=0).mean())

    @property
    def share(self) -> float:
        """Share of the usual widths: less than 1 where flights spread little."""
        return min(1.0, max(self.spread / (self.effort.spread * self.map_size), self.effort.narrowest))

    def polish_of(self, how: Polish) -> Polish:
        """A polish of the effort, with widths [m] for this map and the spread of flights.

        Widths beyond the spread smooth the failure of all paths alike: the search would lengthen a path far
        beyond the place where flights cease to fail.
        """
        share, widths = self.share, [self.map_size * width for width in how.widths]
        if how.far and share < 1.0:
            narrowest = share * widths[-1]
            while widths[-1] > self.effort.fall * narrowest:
                widths.append(widths[-1] / self.effort.fall)
            return replace(how, widths=(*widths, narrowest))
        return replace(how, widths=tuple(share * width for width in widths))

    def timed_means(self, x: FloatArray, spare: int) -> FloatArray:
        """The line of ``x`` in the fewest steps and ``spare`` more; more where windows open later."""
        problem, needed = self.problem, steps_needed(self.problem, x)
        return retimed_means(problem, x, min(max(fewest_steps(needed) + spare, 2), problem.horizon), needed)

    def held_within(
        self, lines: Iterable[tuple[FloatArray, int, str]], passes: Polish, cap: float
    ) -> list[Candidate]:
        """Lines (means, steps beyond the fewest, origin) polished at a length cap; returns those within."""
        how, longest = self.polish_of(passes), self.effort.within * cap

        def one(line: tuple[FloatArray, int, str]) -> Candidate:
            x, more, origin = line
            return self.refiner.polish(self.timed_means(x, more), self.few, how, cap, origin)

        return [k for k in self.in_time(one, lines) if k.length <= longest and self.hope.holds(k)]

    def in_time(
        self, make: Callable[[Item], Candidate], items: Iterable[Item], share: float | None = None
    ) -> list[Candidate]:
        """What ``make`` makes of ``items``, but for those whose turn comes after ``share`` of the time."""
        share = self.effort.sweep_share if share is None else share
        made = on_all_cores(lambda item: None if self.budget.over(share) else make(item), items)
        return [k for k in made if k is not None]

    def reassessed(self, k: Candidate, flights: CommonFlights) -> Candidate:
        """A path of another search, with its failures in ``flights``."""
        how = self.polish_of(self.effort.sweep)
        return self.refiner.assessed(k.flight, flights, how.widths[-1], how.half, k.origin)

    def compared(self, found: Iterable[Candidate]) -> list[Candidate]:
        """The paths ``found`` by another scout, with their failures in the few flights of this one."""
        few = partial(self.reassessed, flights=self.few)
        return sorted(on_all_cores(few, found), key=smoothed)

    def class_of(self, k: Candidate) -> PathClass:
        """The class of ``k``."""
        return path_class(self.problem, k.flight.x) if k.kind is None else k.kind

    def best_of_classes(
        self, found: Iterable[Candidate], more: int = 0, rival: float | None = None
    ) -> list[Candidate]:
        """The best candidate of each class, least failure first, of ``effort.classes`` and ``more`` at most.

        Classes that fail more than ``rival``, by default ``effort.rival``, times as often as the best one are
        left out.
        """
        best, rival = dict[PathClass, Candidate](), self.effort.rival if rival is None else rival
        for k in sorted(found, key=smoothed):
            if best and k.smoothed > rival * next(iter(best.values())).smoothed:
                break
            best.setdefault(self.class_of(k), k)
        return list(best.values())[: self.effort.classes + more]

    def pays(self, k: Candidate, shorter: Candidate, flights: CommonFlights) -> bool:
        """Whether ``k`` fails so much less than a ``shorter`` path in ``flights`` that its length pays."""
        unseen = self.effort.unseen / len(flights)
        return k.smoothed + unseen < self.effort.pays * (shorter.smoothed + unseen)

    def hope_of(self, seen: Iterable[Candidate]) -> Hope:
        """What paths have to reach beside the best one ``seen``: not succeed far more rarely.

        While that one breaks epsilon, others may break it a little more.
        """
        best = min(seen, key=smoothed, default=None)
        if best is None:
            return SOME
        failure = 1.0 - self.effort.hopeless * (1.0 - best.failure)
        return Hope(failure, failure if best.breach == 0.0 else 1.0 + 0.5 * best.smoothed)

    def returning_lines(self, k: Candidate, cap: float) -> list[tuple[FloatArray, int, str]]:
        """Lines of ``k`` that pass one place twice; none far longer than ``cap`` [m]."""
        starts = returning_starts(self.problem, k.flight, k.origin)
        within = (s for s in starts if length_of(s.x) <= self.effort.shorten * cap)
        return [(s.x, self.effort.spare_steps[-1], s.origin) for s in within]

    def on_other_sides(self, found: Iterable[Candidate], known: Container[PathClass]) -> list[Start]:
        """``found`` bent past every near obstacle on its other side; one start of each class not known."""
        others = [f for k in found for f in flipped_starts(self.problem, k.flight.x, k.origin)]
        starts = unlike_starts(self.problem, others)
        return [start for (kind, _), start in starts.items() if kind not in known]


def new_sweep(
    effort: Effort, problem: Problem, draw: Draw, budget: Budget = UNLIMITED,
    progress: Progress | None = None,
) -> Sweep:  # fmt: skip
    """A sweep with the first of the common flights; ``effort`` says how many."""
    some, many = draw(effort.flights).linear(), made_once(lambda: draw(effort.all_flights).linear())
    few, model = first_of(some)(effort.sweep_flights), margin_model(problem)
    before = SCOUT_STEPS * effort.scouts
    refiner, closing = Refiner(problem, model), ConstrainedRefiner(problem, model)
    return Sweep(effort, problem, refiner, closing, few, some, many, budget, progress, before)


def first_of(flights: CommonFlights) -> Draw:
    """What gives the first of ``flights``, or all of them if there are fewer."""
    return lambda runs: flights.only(np.arange(min(runs, len(flights))))


def smoothed(k: Candidate) -> float:
    """The smoothed failure, to sort by."""
    return k.smoothed


# --- the front and its length caps ---------------------------------------------------------------


def front_of(found: Iterable[Candidate]) -> list[Candidate]:
    """The candidates that are non-dominated in length and smoothed failure, shortest first."""
    kept: list[Candidate] = []
    for k in sorted(found, key=lambda k: (k.length, k.smoothed)):
        if not kept or k.smoothed < kept[-1].smoothed:
            kept.append(k)
    return kept


def spread_points(effort: Effort, front: Sequence[Candidate], limit: int) -> list[tuple[Candidate, float]]:
    """At most ``limit`` length caps along the front, each with the path to begin with.

    They are at even ratios. A gap between neighbours wider than ``effort.plateau`` levels of the sweep is
    a plateau, where longer paths do not fail less: no cap lies in it, and one on each side. The path to begin
    with has the lowest failure of those at most one level of the sweep longer than the cap.
    """
    if not front:
        return []
    lengths = np.log([k.length for k in front])
    rise = np.diff(lengths)
    wide = rise > effort.plateau * np.log(effort.spacing)
    rims = np.flatnonzero(np.append(wide, False) | np.insert(wide, 0, False))
    rims = rims[np.linspace(0, len(rims) - 1, min(len(rims), limit // 2 - 1)).round().astype(int)]
    even = limit - len(rims)
    way = np.concatenate([[0.0], np.cumsum(np.where(wide, 0.0, rise))])
    along = way[-1] / max(even - 1, 1) * np.arange(even)
    at = np.searchsorted(way, along * (1.0 - 1e-12), side="right") - 1
    caps = np.exp(lengths[at] + along - way[at])
    caps[-1], caps[0] = front[-1].length, front[0].length
    kept = [float(caps[0])]
    for cap in sorted([*caps[1:].tolist(), *(front[i].length for i in rims)]):
        if cap > effort.within * kept[-1]:
            kept.append(cap)
    return [(min((k for k in front if k.length <= effort.spacing * cap), key=smoothed), cap) for cap in kept]
