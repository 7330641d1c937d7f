"""Sweeps of the length cap: the best classes of paths at falling and at rising caps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, pairwise

from pareto_ltl.planning.refine.sampled import Candidate, steps_needed
from pareto_ltl.planning.refine.sweep import (
    KEPT,
    SPACING,
    WARM,
    WIDE,
    Sweep,
    best_of_classes,
    class_of,
    fewest_steps,
    front_of,
    held_within,
    on_other_sides,
    smoothed,
)
from pareto_ltl.support.arrays import FloatArray

SPARE = (0, 1, 3)  # numbers of steps tried, beyond the fewest, besides the number of the path itself
SLOWER = 0.1  # of the fewest steps: a longer path is also tried in so many more
FLIP_EVERY = 3  # levels of the falling sweep between trials of other sides
LONGER = 1.08  # ratio of the length caps beyond the longest that pays
SHORTEN = 1.3  # paths up to this many times as long as the cap are shortened to it
PAYS = 0.95  # a longer path is worth it if its failure is below this share of a shorter one's
WORTH = 0.95  # a sweep ends after two consecutive levels above this share of the failure before
RISING = 2  # classes of a level that the rising sweep continues


def swept_down(sweep: Sweep, pool: ThreadPoolExecutor, seen: Sequence[Candidate]) -> list[list[Candidate]]:
    """The best classes at falling caps, from the longest length that pays."""
    seen = [k for k in seen if k.smoothed < sweep.hopeless]
    if not seen:
        return []
    cap, levels = _longer_levels(sweep, pool, seen, _longest_worth(seen))
    cap, beam, number = KEPT * cap, list[Candidate](), 0
    known, shortest = [*seen, *chain(*levels)], min(k.length for k in seen)
    while (beam or cap >= shortest) and not sweep.over:
        entering = [k for k in known if cap / SPACING < k.length <= cap]
        made = _polished_at(sweep, pool, [*beam, *entering], cap, SPARE[:2])
        if number % FLIP_EVERY == 0:
            made += _other_sides(sweep, pool, made, cap)
        beam = best_of_classes(sweep.problem, made, sweep.cfg.classes)
        levels.append(beam)
        cap, number = cap / SPACING, number + 1
    return levels


def _longer_levels(
    sweep: Sweep, pool: ThreadPoolExecutor, seen: Sequence[Candidate], longest: float
) -> tuple[float, list[list[Candidate]]]:
    """Levels above ``longest`` [m], the longest first, until two in a row fail no less.

    Returns with them the longest length that pays [m].
    """
    levels, vain, cap, known = list[list[Candidate]](), 0, longest, list(seen)
    least = min(k.smoothed for k in known if k.length <= KEPT * longest)
    while vain < 2 and not sweep.over:
        cap *= LONGER
        shorter = [k for k in known if k.length <= cap]
        longer = [k for k in known if cap < k.length <= SHORTEN * cap]
        groups = (best_of_classes(sweep.problem, some, sweep.cfg.classes) for some in (shorter, longer))
        lines = [line for k in chain(*groups) for line in timed_lines(sweep, k, SPARE[1:2])]
        made = held_within(sweep, pool, lines, sweep.polish_of(WIDE, 3), cap)
        known += made
        levels.insert(0, best_of_classes(sweep.problem, made, sweep.cfg.classes))
        best = min((*made, *seen[:1]), key=smoothed)
        vain = 0 if best.smoothed < WORTH * least else vain + 1
        if vain == 0:
            longest, least = best.length, best.smoothed
    return longest, levels


def _longest_worth(seen: Iterable[Candidate]) -> float:
    """The longest length [m] of the front that reduces the failure by a factor ``PAYS`` or better."""
    front = front_of(seen)
    longest = front[0]
    for k in front[1:]:
        if k.smoothed < PAYS * longest.smoothed:
            longest = k
    return longest.length


def swept_up(
    sweep: Sweep, pool: ThreadPoolExecutor, below: Sequence[Sequence[Candidate]]
) -> list[list[Candidate]]:
    """The best classes at rising caps: the levels ``below``, then until longer paths do not fail less."""
    kept = sorted((list(level) for level in below if level), key=_longest)
    if not kept:
        return []
    levels, beam, vain, k = list[list[Candidate]](), kept[0], 0, 1
    cap = _longest(beam)
    while (k < len(kept) or vain < 2) and not sweep.over:
        known = kept[k] if k < len(kept) else []
        cap = _longest(known) if known else cap * SPACING
        made = _polished_at(sweep, pool, beam[:RISING], cap, SPARE[1:], SLOWER)
        least = beam[0].smoothed
        beam = best_of_classes(sweep.problem, [*made, *known, *beam], sweep.cfg.classes)
        vain = 0 if beam[0].smoothed < WORTH * least else vain + 1
        levels.append(beam)
        k += 1
    return levels


def _longest(level: Sequence[Candidate]) -> float:
    return max(k.length for k in level)


def filled_gaps(
    sweep: Sweep, pool: ThreadPoolExecutor, levels: Sequence[Sequence[Candidate]]
) -> list[list[Candidate]]:
    """Levels in the gaps of the front: the path above a gap at falling caps, while it is better.

    A class that only the rising sweep has found is not known at shorter lengths.
    """
    made, front = list[list[Candidate]](), front_of(chain(*levels))
    for below, above in pairwise(front):
        best = [above]
        while best and not sweep.over and best[0].length > SPACING**2 * below.length:
            best = _polished_at(sweep, pool, best[:1], best[0].length / SPACING, SPARE[:2])
            best = sorted((k for k in best if k.smoothed < below.smoothed), key=smoothed)
            made.append(best)
    return made


def _polished_at(
    sweep: Sweep, pool: ThreadPoolExecutor, begun: Sequence[Candidate], cap: float, spare: Sequence[int],
    slower: float | None = None,
) -> list[Candidate]:  # fmt: skip
    """``begun`` polished at a length cap in several numbers of steps; those within the cap are returned."""
    lines = [line for k in begun for line in timed_lines(sweep, k, spare, slower)]
    return held_within(sweep, pool, lines, sweep.polish_of(WARM, 3), cap)


def timed_lines(
    sweep: Sweep, k: Candidate, spare: Sequence[int], slower: float | None = None
) -> list[tuple[FloatArray, int, str]]:
    """The means of ``k`` with several numbers of steps beyond the fewest: ``spare``, its own, and more.

    A robot with position fixes or feedback that takes longer for the same length meets a region in more
    steps: on a map of 7 km, 3 % of failures over 9.9 km became 0.7 % over 6.7 km.
    """
    fewest = fewest_steps(steps_needed(sweep.problem, k.flight.x))
    own = max(k.steps - fewest, 0)
    more = [] if slower is None else [own + max(2, round(slower * fewest))]
    return [(k.flight.x, steps, k.origin) for steps in dict.fromkeys([*spare, own, *more])]


def _other_sides(
    sweep: Sweep, pool: ThreadPoolExecutor, made: Sequence[Candidate], cap: float
) -> list[Candidate]:
    """The best of ``made`` bent to the other side of every near obstacle, in classes not among ``made``."""
    best = sorted(made, key=smoothed)[:1]
    new = on_other_sides(sweep.problem, best, {class_of(sweep.problem, k) for k in made})
    lines = [(start.x, 1, start.origin) for start in new]
    return held_within(sweep, pool, lines, sweep.polish_of(WIDE, 3), cap)
