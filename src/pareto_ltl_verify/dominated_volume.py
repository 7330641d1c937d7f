"""The volume that a front dominates, by slices."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pareto_ltl.support.arrays import FloatArray


def volume(rows: FloatArray, top: FloatArray) -> float:
    """Share of the box from 0 to ``top`` (f,) that ``rows`` (P, f) dominate, by slices of the first axis."""
    return _share(np.minimum(rows, top) / top)


def _share(inside: FloatArray) -> float:
    if inside.shape[1] == 2:
        return _area(inside)
    levels = np.append(np.unique(inside[:, 0]), 1.0)
    parts = ((high - low) * _share(inside[inside[:, 0] <= low, 1:]) for low, high in pairwise(levels))
    return float(sum(parts))


def _area(rows: FloatArray) -> float:
    """Area that ``rows`` (P, 2) dominate below (1, 1)."""
    total, height = 0.0, 1.0
    for x, y in rows[np.lexsort((rows[:, 1], rows[:, 0]))]:
        if y < height:
            total += (1.0 - x) * (height - y)
            height = y
    return total
