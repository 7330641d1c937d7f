"""What is left of a time budget: points of a front varied, and polished again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count

import numpy as np

from pareto_ltl.planning.refine.first_looks import FLIPPED
from pareto_ltl.planning.refine.length_caps import front_of
from pareto_ltl.planning.refine.sampled import Candidate
from pareto_ltl.planning.refine.starts import flipped_starts
from pareto_ltl.planning.refine.sweep import WIDE, Sweep, held_within
from pareto_ltl.support.arrays import FloatArray

ROUND = 4  # points of a front that are varied between two reports
MORE = (0, 1, 2, 3, 5, 8)  # numbers of steps beyond the fewest
BUMP = 0.03  # standard deviation of a random bend, as a share of the map's size


def improved_fronts(
    sweep: Sweep, pool: ThreadPoolExecutor, front: Sequence[Candidate]
) -> Iterator[list[Candidate]]:
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
        for at in rng.permutation(len(kept))[:ROUND].tolist():
            kept = front_of([*kept, *_varied(sweep, pool, kept, min(at, len(kept) - 1), rng)])
        yield kept


def _varied(
    sweep: Sweep, pool: ThreadPoolExecutor, front: Sequence[Candidate], at: int, rng: np.random.Generator
) -> list[Candidate]:
    """Random variations of one point, polished at the same length."""
    k, problem = front[at], sweep.problem
    near = [front[i] for i in (at - 1, at + 1) if 0 <= i < len(front)]
    lines = [(n.flight.x, 0, n.origin) for n in near]
    lines += [(k.flight.x, more, k.origin) for more in rng.choice(MORE, 2, replace=False).tolist()]
    lines += [(start.x, 1, start.origin) for start in flipped_starts(problem, k.flight.x, k.origin)[:FLIPPED]]
    lines += [(_bent(sweep, k.flight.x, rng), 1, k.origin)]
    return held_within(sweep, pool, lines, sweep.polish_of(WIDE, 3), k.length)


def _bent(sweep: Sweep, x: FloatArray, rng: np.random.Generator) -> FloatArray:
    """``x`` with a bump of random place and size; its start does not move, and it stays on the map."""
    low, high = sweep.problem.scene.bounds
    t = np.linspace(0.0, 1.0, len(x))
    bump = np.exp(-0.5 * ((t - rng.random()) / rng.uniform(0.03, 0.15)) ** 2) * np.minimum(t / 0.05, 1.0)
    aside = rng.normal(0.0, BUMP * (high - low).mean(), 2)
    return np.clip(x + bump[:, None] * aside, low, high)
