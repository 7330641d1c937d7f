"""Ratios of medians with bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

DRAWS = 10_000  # bootstrap samples


class Ratio(NamedTuple):
    """A ratio of two medians and its 95 % interval."""

    value: float
    low: float
    high: float


def median_ratio(ours: Sequence[float], theirs: Sequence[float], seed: int = 0) -> Ratio:
    """Median of ``theirs`` over median of ``ours``, measured in turn, with a percentile bootstrap interval.

    A bootstrap sample draws repetitions, each with both of its figures: what slows the machine for a while
    slows both. A repetition without a result is inf. Raises ValueError if the lengths differ or are zero.
    """
    a, b = np.asarray(ours, float), np.asarray(theirs, float)
    if a.shape != b.shape or a.ndim != 1 or len(a) == 0:
        raise ValueError(f"expected as many figures of ours as of theirs, found {a.shape} and {b.shape}")
    draws = np.random.default_rng(seed).integers(len(a), size=(DRAWS, len(a)))
    low, high = np.quantile(_over(_medians(b[draws]), _medians(a[draws])), [0.025, 0.975], method="nearest")
    return Ratio(float(_over(_medians(b[None]), _medians(a[None]))[0]), float(low), float(high))


def _medians(rows: np.ndarray) -> np.ndarray:
    """Median of each row; the upper of two in the middle where one of them is inf."""
    rows = np.sort(rows, axis=1)
    n = rows.shape[1]
    return (rows[:, (n - 1) // 2] + rows[:, n // 2]) / 2


def _over(b: np.ndarray, a: np.ndarray) -> np.ndarray:
    """b / a; 1 where neither side has a result."""
    both = np.isinf(a) & np.isinf(b)
    return np.where(both, 1.0, b / np.where(both, 1.0, a))


def median(values: Sequence[float]) -> float:
    """The median; inf where most have no result."""
    return float(_medians(np.asarray(values, float)[None])[0])
