"""First looks at the starts, and the sweep of the length cap.

The looks tell which starts are promising, and what a cheap polish makes of them. The sweep polishes the best
classes of paths at falling caps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import chain

import numpy as np

from careful_io.machine import on_all_cores
from pareto_ltl.planning.refine.sampled import Candidate, fewest_steps, steps_needed
from pareto_ltl.planning.refine.starts import Start, StartKind, led_starts, returning_starts, unlike_starts
from pareto_ltl.planning.refine.sweep import Sweep, front_of, smoothed
from pareto_ltl.support.arrays import FloatArray, IntArray, length_of

# --- first looks ------------------------------------------------------------------------------------


def looks(sweep: Sweep, starts: Mapping[StartKind, Start]) -> list[Candidate]:
    """What cheap polishes make of the most promising starts; best first.

    Hopeful paths are polished again at their own lengths, to find the length cap to begin with.
    """
    seen, how = first_looks(sweep, starts), sweep.polish_of(sweep.effort.sweep)

    def again(k: Candidate) -> Candidate:
        return k if sweep.over else sweep.refiner.polish(k.flight.x, sweep.few, how, k.length, k.origin)

    hopeful = filter(sweep.hope_of(seen).holds, seen)
    return sorted([*seen, *on_all_cores(again, hopeful)], key=smoothed)


def first_looks(sweep: Sweep, starts: Mapping[StartKind, Start]) -> list[Candidate]:
    """The most promising starts polished cheaply, the best also on the other side of obstacles.

    The first start is polished even if the time budget is spent.
    """
    effort, look = sweep.effort, partial(first_look, sweep)
    chosen = _promising(sweep, list(starts.values()))
    found = sweep.in_time(look, chosen) or [look(start) for start in chosen[:1]]
    known, tried = {kind for kind, _ in starts}, set[StartKind]()
    best = _safest(found, effort.flipped)
    again = [start for k in best for start in returning_starts(sweep.problem, k.flight, k.origin)]
    found += sweep.in_time(look, [*sweep.on_other_sides(best, known), *again])
    for _ in range(effort.led_rounds):
        safest = _safest(found, effort.led)
        led = [start for k in safest for start in led_starts(sweep.problem, k.flight, k.origin)]
        if unlike := {kind: s for kind, s in unlike_starts(sweep.problem, led).items() if kind not in tried}:
            tried |= unlike.keys()
            new = list(unlike.values())
            order = _by_fronts(_flown_once(sweep, new))[: effort.led_looks]
            found += sweep.in_time(look, (new[k] for k in order))
    return sorted(found, key=smoothed)


def _safest(found: Iterable[Candidate], limit: int) -> list[Candidate]:
    """Non-dominated candidates, the safest first."""
    return sorted(front_of(found), key=smoothed)[:limit]


def _promising(sweep: Sweep, starts: Sequence[Start]) -> list[Start]:
    """The best lines and the best tree paths in one simulation, and the longest starts.

    The best are taken by whole fronts of failure and length. Lines do not compete with tree paths: every
    search has the same ones.
    """
    if not starts:
        return []
    effort = sweep.effort
    rows, grown = _flown_once(sweep, starts), np.array([start.grown for start in starts])
    order = _by_fronts(rows)
    lines, trees = order[~grown[order]][: effort.looked_lines], order[grown[order]][: effort.looked_grown]
    longest = np.argsort(-rows[:, 1], kind="stable")[: effort.looked_longest]
    return [starts[k] for k in dict.fromkeys([*lines.tolist(), *trees.tolist(), *longest.tolist()])]


def _flown_once(sweep: Sweep, starts: Sequence[Start]) -> FloatArray:
    """Smoothed failure and length [m] of each start in one simulation, (n, 2)."""
    how = sweep.polish_of(sweep.effort.first)

    def row(start: Start) -> tuple[float, float]:
        flight = sweep.refiner.flown(sweep.timed_means(start.x, 1))
        k = sweep.refiner.assessed(flight, sweep.few, how.widths[0], how.half)
        return k.smoothed, k.length

    return np.array(on_all_cores(row, starts))


def _by_fronts(rows: FloatArray) -> IntArray:
    """The order of rows (failure, length) by whole fronts, the safest of a front first."""
    import moocore

    return np.lexsort((rows[:, 0], moocore.pareto_rank(rows)))


def first_look(sweep: Sweep, start: Start) -> Candidate:
    """A start polished with few flights, at about its own length."""
    x, how = sweep.timed_means(start.x, 1), sweep.polish_of(sweep.effort.first)
    return sweep.refiner.polish(x, sweep.few, how, sweep.effort.loose * length_of(x), start.origin)


# --- length caps ------------------------------------------------------------------------------------


def swept_down(sweep: Sweep, seen: Sequence[Candidate]) -> list[list[Candidate]]:
    """The best classes at falling caps, from the longest length that pays.

    From the last cap that paths satisfy, they fall again, more slowly: a coarse search finds the shortest
    paths as well.
    """
    seen = [k for k in seen if sweep.hope.holds(k)]
    if not seen:
        return []
    effort, spacing = sweep.effort, sweep.effort.spacing
    cap, levels = _longer_levels(sweep, seen, _longest_worth(sweep, seen))
    cap, beam = effort.within * cap, list[Candidate]()
    known, shortest = [*seen, *chain(*levels)], min(k.length for k in seen)
    while (beam or cap >= shortest) and not sweep.over:
        entering = [k for k in known if cap / spacing < k.length <= cap]
        begun = [*beam, *sweep.best_of_classes(entering, rival=math.inf)]  # they are not polished as often
        spare = effort.spare_steps
        lines = [line for k in begun for line in timed_lines(sweep, k, spare, slower=k is begun[0])]
        held = sweep.best_of_classes(sweep.held_within(lines, effort.sweep, cap))
        levels.append(held)
        if beam and not held and spacing > effort.last_spacing**sweep.share:
            cap, spacing = cap * spacing, math.sqrt(spacing)
        else:
            beam = held
        cap /= spacing
    return levels


def _longer_levels(
    sweep: Sweep, seen: Sequence[Candidate], longest: float
) -> tuple[float, list[list[Candidate]]]:
    """Levels above ``longest`` [m], the longest first, until two in a row fail no less.

    Returns with them the longest length that pays [m].
    """
    effort = sweep.effort
    levels, vain, cap, known = list[list[Candidate]](), 0, longest, list(seen)
    safest = min((k for k in known if k.length <= effort.within * longest), key=smoothed)
    while vain < 2 and not sweep.over:
        cap *= effort.longer
        shorter = [k for k in known if k.length <= cap]
        longer = [k for k in known if cap < k.length <= effort.shorten * cap]
        groups = (sweep.best_of_classes(some) for some in (shorter, longer))
        lines = [line for k in chain(*groups) for line in timed_lines(sweep, k, effort.spare_steps[1:2])]
        lines += [line for k in _safest(shorter, effort.flipped) for line in sweep.returning_lines(k, cap)]
        made = sweep.held_within(lines, effort.wide, cap)
        known += made
        levels.insert(0, sweep.best_of_classes(made))
        best = min((*made, *seen[:1]), key=smoothed)
        vain = 0 if sweep.pays(best, safest, sweep.few) else vain + 1
        if vain == 0:
            longest, safest = best.length, best
    return longest, levels


def _longest_worth(sweep: Sweep, seen: Iterable[Candidate]) -> float:
    """The longest length [m] of the front that pays."""
    front = front_of(seen)
    longest = front[0]
    for k in front[1:]:
        if sweep.pays(k, longest, sweep.few):
            longest = k
    return longest.length


def timed_lines(
    sweep: Sweep, k: Candidate, spare: Sequence[int], *, slower: bool = False
) -> list[tuple[FloatArray, int, str]]:
    """The means of ``k`` with several numbers of steps beyond the fewest: ``spare``, its own, and more.

    A robot with position fixes or feedback that takes longer for the same length meets a region in more
    steps: on a map of 7 km, 3 % of failures over 9.9 km became 0.7 % over 6.7 km. Of 100 steps and more, one
    step more makes no difference.
    """
    fewest = fewest_steps(steps_needed(sweep.problem, k.flight.x))
    own = max(k.steps - fewest, 0)
    more = [own + max(2, round(sweep.effort.slower * fewest))] if slower else []
    apart, kept = 1 + int(sweep.effort.apart * fewest), list[int]()
    for steps in (*spare, own, *more):
        if all(abs(steps - other) >= apart for other in kept):
            kept.append(steps)
    return [(k.flight.x, steps, k.origin) for steps in kept]
