"""Classes of paths: mission order, the side on which each obstacle is passed, and the landmarks crossed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.routes.search_map import sights
from pareto_ltl.support.arrays import FloatArray

Word: TypeAlias = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class PathClass:
    """Two paths of one class can be bent into each other, leg by leg, without meeting an obstacle.

    They cross the same landmarks on the way.

    Attributes
    ----------
    order : tuple of (state, cell label)
        The automaton state at the start and after each transition, and what was read there.
    words : tuple of tuple of int
        For each leg, to the first transition and from each to the next, the rays crossed: k + 1 to the east
        and -(k + 1) to the west of obstacle k, without detours. It is the word of the leg in the free group
        of the obstacles (Bhattacharya, Likhachev and Kumar, Autonomous Robots 33, 2012,
        doi:10.1007/s10514-012-9304-1). A path that goes out and back on one side of an obstacle differs from
        one on the other side only leg by leg.
    seen : tuple of frozenset of int
        The landmarks that each leg crosses.
    """

    order: tuple[tuple[int, frozenset[str]], ...]
    words: tuple[Word, ...]
    seen: tuple[frozenset[int], ...]

    @property
    def state(self) -> int:
        """The last automaton state."""
        return self.order[-1][0]


def path_class(problem: Problem, x: FloatArray) -> PathClass:
    """The class of the means ``x`` (T+1, 2)."""
    q, cells = problem.states(x), problem.locate(x)
    before = np.concatenate([[-1], q[:-1]])
    atoms = set(problem.atoms)
    labels = [problem.labels[c] & atoms if c >= 0 else frozenset() for c in cells]
    turns = np.flatnonzero(q != before)
    order = tuple((int(q[t]), frozenset(labels[t])) for t in turns)
    accepted = problem.logic.distance[q[-1]] == 0.0
    ends = turns[turns > 0].tolist() + ([] if accepted else [len(x) - 1])
    crossed = crossed_rays(problem.decomposition.obstacles, x[:-1], x[1:])
    legs, met = list(pairwise([0, *ends])), sights(problem, x)
    words = tuple(_leg_word(crossed, begin, end) for begin, end in legs)
    seen = tuple(frozenset(np.flatnonzero(met[begin:end].any(axis=0)).tolist()) for begin, end in legs)
    return PathClass(order, words, seen)


def _leg_word(crossed: Mapping[int, Word], begin: int, end: int) -> Word:
    word: Word = ()
    for t in sorted(t for t in crossed if begin <= t < end):
        word = reduced_word(word, crossed[t])
    return word


def path_word(obstacles: Sequence[FloatArray], x: FloatArray) -> Word:
    """The reduced word of the rays that the path ``x`` (T+1, 2) crosses."""
    return _leg_word(crossed_rays(obstacles, x[:-1], x[1:]), 0, len(x))


def reduced_word(word: Word, letters: Word) -> Word:
    """``word`` followed by ``letters``, reduced: neighbours that are inverse to each other cancel."""
    for letter in letters:
        word = word[:-1] if word and word[-1] == -letter else (*word, letter)
    return word


def crossed_rays(obstacles: Sequence[FloatArray], start: FloatArray, end: FloatArray) -> dict[int, Word]:
    """Letters of the rays that each segment crosses, in order; rays go north from the obstacles' middles.

    Segment i leads from ``start[i]`` to ``end[i]``, (S, 2); segments that cross no ray are left out.
    """
    if not len(obstacles):
        return {}
    corners = [len(polygon) for polygon in obstacles]
    first = np.cumsum([0, *corners[:-1]])
    middle = np.add.reduceat(np.concatenate(obstacles), first) / np.array(corners)[:, None]
    x0, x1 = start[:, None, 0], end[:, None, 0]
    east, west = (x0 <= middle[:, 0]) & (middle[:, 0] < x1), (x1 <= middle[:, 0]) & (middle[:, 0] < x0)
    segment, k = np.nonzero(east | west)
    share = (middle[k, 0] - start[segment, 0]) / (end[segment, 0] - start[segment, 0])
    north = start[segment, 1] + share * (end[segment, 1] - start[segment, 1]) > middle[k, 1]
    segment, k = segment[north], k[north]
    sign = np.where(east[segment, k], 1, -1)
    found: dict[int, Word] = {}
    # Rays of one easting are crossed in one order to the east and in the other to the west.
    for i in np.lexsort((sign * k, sign * middle[k, 0], segment)):
        found[int(segment[i])] = (*found.get(int(segment[i]), ()), int(sign[i] * (k[i] + 1)))
    return found
