"""The tails of a law of parts, fitted to errors divided by their standard deviations.

For each lead and each displacement, s is the one of greatest likelihood of a lognormal scale
(:mod:`pareto_ltl_apps.wind_errors.scale_mixture`); s_f, s_m(L) and the memory are fitted to these. Values are
counted in bins of the logarithm of ``|z|``, separately for each situation, so that a fit to other weights of
the situations counts nothing again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from careful_io.times import HOUR
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl_apps.wind_errors.law_check import CheckRow
from pareto_ltl_apps.wind_errors.scale_mixture import log_density
from wind_laws.error_law import TailScale

TAIL_LEADS = HOUR * np.array([0.0, 36, 48])  # of s_m [s]
MEMORIES = HOUR * np.array([3.0, 6.0, 12.0, 24.0, 48.0])  # candidates of the memory of the scale [s]
SPREADS = np.linspace(0.0, 1.0, 101)  # candidates of s
BIN = 0.01  # width in the logarithm of |z|
SMALLEST, LARGEST = -6.0, 6.0  # logarithms of |z|
BINS = round((LARGEST - SMALLEST) / BIN)
MIDDLES = SMALLEST + BIN * (np.arange(BINS) + 0.5)


@cache
def _densities() -> FloatArray:
    """Logarithm of the density at the middles of the bins for each candidate of s, (bins, 101)."""
    return log_density(np.exp(MIDDLES)[:, None], SPREADS)


class TailTarget(NamedTuple):
    """s of the errors at ``lead`` [s], or of their mean over ``time`` [s] from there."""

    lead: float
    time: float
    spread: float


@dataclass(frozen=True, slots=True)
class TailCounts:
    """Counts of standardised errors.

    Attributes
    ----------
    rows : sequence of CheckRow
        The errors.
    counts : tuple of (G, bins) float
        For each row, the numbers of values of each situation in bins of the logarithm of ``|z|``.
    squares : tuple of (G,) float
        Their sums of squares.
    """

    rows: Sequence[CheckRow]
    counts: tuple[FloatArray, ...]
    squares: tuple[FloatArray, ...]

    @classmethod
    def of(cls, rows: Sequence[CheckRow], groups: IntArray) -> TailCounts:
        """The counts of ``rows``, of the situations ``groups`` (G,)."""
        counts, squares = [], []
        for row in rows:
            owner = np.searchsorted(groups, row.situation)
            logs = np.log(np.maximum(np.abs(row.z), 1e-300))
            bins = np.clip(((logs - SMALLEST) / BIN).astype(np.int64), 0, BINS - 1)
            table = np.zeros((len(groups), BINS))
            np.add.at(table, (owner, bins), 1.0)
            counts.append(table)
            squares.append(np.bincount(owner, row.z**2, len(groups)).astype(float))
        return cls(rows, tuple(counts), tuple(squares))

    def spreads(self, weights: FloatArray) -> FloatArray:
        """The likeliest s of each row, with weights (G,) of the situations.

        The values are divided by their root mean square, which the law need not meet.
        """
        found = []
        for table, square in zip(self.counts, self.squares, strict=True):
            total = weights @ table
            rms = np.sqrt(max(float(weights @ square), 1e-300) / max(float(total.sum()), 1e-300))
            moved = np.interp(np.arange(BINS) + np.log(rms) / BIN, np.arange(BINS), total)
            found.append(SPREADS[np.argmax(moved @ _densities())])
        return np.array(found)

    def tails(self, weights: FloatArray) -> TailScale:
        """The tails of all rows, with weights (G,) of the situations."""
        spreads = self.spreads(weights)
        goal = [
            TailTarget(HOUR * row.start, 0.0 if row.span is None else row.span.time, float(spread))
            for row, spread in zip(self.rows, spreads, strict=True)
        ]
        return fit_tails(goal)


def fit_tails(goal: Sequence[TailTarget]) -> TailScale:
    """The tails whose s² are closest to the s² of ``goal``, by least squares for each memory τ of a grid."""
    last = max(row.lead + row.time for row in goal)
    leads = TAIL_LEADS[: max(1, int((last >= TAIL_LEADS).sum()))]
    wanted = np.array([row.spread**2 for row in goal])
    best: tuple[float, FloatArray, float] | None = None
    for memory in MEMORIES:
        columns = [np.ones(len(goal))]
        for k in range(len(leads)):
            hat = np.eye(len(leads))[k]
            shares = [
                np.interp(np.linspace(row.lead, row.lead + row.time, 33), leads, hat).mean() for row in goal
            ]
            fade = [float(TailScale.averaged(row.time / memory)) for row in goal]
            columns.append(np.array(shares) * np.array(fade))
        squares, misfit = nnls(np.stack(columns, axis=-1), wanted)
        if best is None or misfit < best[0] - 1e-12:
            best = (float(misfit), squares, float(memory))
    assert best is not None
    _, squares, memory = best
    return TailScale(float(np.sqrt(squares[0])), leads, np.sqrt(squares[1:]), memory)
