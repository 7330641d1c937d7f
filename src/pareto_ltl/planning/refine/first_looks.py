"""First looks: which starts are promising, and what a cheap polish makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from pareto_ltl.planning.refine.sampled import Candidate, path_length
from pareto_ltl.planning.refine.starts import Start, StartKind, led_starts, returning_starts, unlike_starts
from pareto_ltl.planning.refine.sweep import (
    COARSE,
    WARM,
    Sweep,
    front_of,
    in_time,
    on_other_sides,
    smoothed,
    timed_means,
)
from pareto_ltl.support.arrays import FloatArray, IntArray

LOOSE = 1.1  # factor by which the first polish may lengthen a start
LINES, GROWN, LONGEST = 12, 16, 4  # starts that are polished: the best lines and tree paths, and the longest
FLIPPED = 2  # candidates that are tried on the other side of obstacles
LED_ROUNDS = 2  # of leading the safest candidates through one landmark more
LED, LED_LOOKS = 4, 6  # candidates that are led in a round, and copies that are polished
HOPELESS = 0.3  # share of the success of the best start below which candidates are dropped


def looks(sweep: Sweep, pool: ThreadPoolExecutor, starts: Mapping[StartKind, Start]) -> list[Candidate]:
    """What cheap polishes make of the most promising starts, the hopeful ones polished twice; best first."""
    seen = first_looks(sweep, pool, starts)
    hopeful = [k for k in seen if k.smoothed < hopeless_above(seen)]
    return sorted([*seen, *second_looks(sweep, pool, hopeful)], key=smoothed)


def second_looks(sweep: Sweep, pool: ThreadPoolExecutor, seen: Sequence[Candidate]) -> Iterable[Candidate]:
    """The paths polished again at their own lengths, to find the length cap to begin with."""
    how = sweep.polish_of(WARM, 3)

    def again(k: Candidate) -> Candidate:
        return k if sweep.over else sweep.refiner.polish(k.flight.x, sweep.few, how, k.length, k.origin)

    return pool.map(again, seen)


def first_looks(sweep: Sweep, pool: ThreadPoolExecutor, starts: Mapping[StartKind, Start]) -> list[Candidate]:
    """The most promising starts polished cheaply, the best also on the other side of obstacles.

    The first start is polished even if the time budget is spent.
    """
    chosen = _promising(sweep, pool, list(starts.values()))

    def looks(some: Iterable[Start]) -> list[Candidate]:
        return in_time(pool, lambda: sweep.over, partial(first_look, sweep), some)

    found = looks(chosen) or [first_look(sweep, start) for start in chosen[:1]]
    known, tried = {kind for kind, _ in starts}, set[StartKind]()
    best = _safest(found, FLIPPED)
    again = [start for k in best for start in returning_starts(sweep.problem, k.flight, k.origin)]
    found += looks([*on_other_sides(sweep.problem, best, known), *again])
    for _ in range(LED_ROUNDS):
        led = [start for k in _safest(found, LED) for start in led_starts(sweep.problem, k.flight, k.origin)]
        if unlike := {kind: s for kind, s in unlike_starts(sweep.problem, led).items() if kind not in tried}:
            tried |= unlike.keys()
            new = list(unlike.values())
            found += looks(new[k] for k in _by_fronts(_flown_once(sweep, pool, new))[:LED_LOOKS])
    return sorted(found, key=smoothed)


def _safest(found: Iterable[Candidate], most: int) -> list[Candidate]:
    """Non-dominated candidates, the safest first."""
    return sorted(front_of(found), key=smoothed)[:most]


def _promising(sweep: Sweep, pool: ThreadPoolExecutor, starts: Sequence[Start]) -> list[Start]:
    """The best lines and the best tree paths in one simulation, and the longest starts.

    The best are taken by whole fronts of failure and length. Lines do not compete with tree paths: every seed
    has the same ones.
    """
    if not starts:
        return []
    rows, grown = _flown_once(sweep, pool, starts), np.array([start.grown for start in starts])
    order = _by_fronts(rows)
    lines, trees = order[~grown[order]][:LINES], order[grown[order]][:GROWN]
    longest = np.argsort(-rows[:, 1], kind="stable")[:LONGEST]
    return [starts[k] for k in dict.fromkeys([*lines.tolist(), *trees.tolist(), *longest.tolist()])]


def _flown_once(sweep: Sweep, pool: ThreadPoolExecutor, starts: Sequence[Start]) -> FloatArray:
    """Smoothed failure and length [m] of each start in one simulation, (n, 2)."""
    width = sweep.polish_of(COARSE, 1).widths[0]

    def row(start: Start) -> tuple[float, float]:
        flight = sweep.refiner.flown(timed_means(sweep.problem, start.x, 1))
        k = sweep.refiner.assessed(flight, sweep.few, width)
        return k.smoothed, k.length

    return np.array(list(pool.map(row, starts)))


def _by_fronts(rows: FloatArray) -> IntArray:
    """The order of rows (failure, length) by whole fronts, the safest of a front first."""
    import moocore

    return np.lexsort((rows[:, 0], moocore.pareto_rank(rows)))


def first_look(sweep: Sweep, start: Start) -> Candidate:
    """A start polished with few flights, at about its own length."""
    x, how = timed_means(sweep.problem, start.x, 1), sweep.polish_of(COARSE, 4)
    return sweep.refiner.polish(x, sweep.few, how, LOOSE * path_length(x), start.origin)


def hopeless_above(seen: Sequence[Candidate]) -> float:
    """The smoothed failure above which paths are dropped: they succeed far more rarely than the best seen."""
    return 1.0 - HOPELESS * (1.0 - min((k.smoothed for k in seen), default=0.0))
