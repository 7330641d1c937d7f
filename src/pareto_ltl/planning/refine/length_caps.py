"""The front of polished candidates, and the length caps at which its points are polished once more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pareto_ltl.planning.refine.sampled import Candidate

SPACING = 1.03  # ratio of neighbouring length caps
PLATEAU = 1.5  # a gap of more levels than this between two paths of a front is a plateau
KEPT = 1.002  # a path may exceed its cap by this factor


def front_of(found: Iterable[Candidate]) -> list[Candidate]:
    """The candidates that are non-dominated in length and smoothed failure, shortest first."""
    kept: list[Candidate] = []
    for k in sorted(found, key=lambda k: (k.length, k.smoothed)):
        if not kept or k.smoothed < kept[-1].smoothed:
            kept.append(k)
    return kept


def spread_points(front: Sequence[Candidate], most: int) -> list[tuple[Candidate, float]]:
    """At most ``most`` length caps along the front, each with the path to begin with.

    They are at even ratios. A gap between neighbours that is wider than ``PLATEAU`` levels of the sweep is a
    plateau, where longer paths do not fail less: no cap lies in it, and one on each side. The path to begin
    with has the lowest failure of those at most one level of the sweep longer than the cap.
    """
    if not front:
        return []
    lengths = np.log([k.length for k in front])
    rise = np.diff(lengths)
    wide = rise > PLATEAU * np.log(SPACING)
    rims = np.flatnonzero(np.append(wide, False) | np.insert(wide, 0, False))
    rims = rims[np.linspace(0, len(rims) - 1, min(len(rims), most // 2 - 1)).round().astype(int)]
    even = most - len(rims)
    way = np.concatenate([[0.0], np.cumsum(np.where(wide, 0.0, rise))])
    along = way[-1] / max(even - 1, 1) * np.arange(even)
    at = np.searchsorted(way, along * (1.0 - 1e-12), side="right") - 1
    caps = np.exp(lengths[at] + along - way[at])
    caps[-1], caps[0] = front[-1].length, front[0].length
    kept = [float(caps[0])]
    for cap in sorted([*caps[1:].tolist(), *(front[i].length for i in rims)]):
        if cap > KEPT * kept[-1]:
            kept.append(cap)
    return [
        (min((k for k in front if k.length <= SPACING * cap), key=lambda k: k.smoothed), cap) for cap in kept
    ]
