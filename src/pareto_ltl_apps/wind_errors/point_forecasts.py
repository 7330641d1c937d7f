"""Forecasts of the wind at points, by run, place and lead, and the errors that newer winds show.

A table of forecasts that runs of one model made for some places is verified by observations, if it has them,
else by the newest run of the same model at each time: a forecast of lead l <= 12 h stands for the wind. An
error is then the difference of two forecasts, and what both runs have wrong is not in it.

A situation is a span of two days in which some run begins: errors of days further apart hardly correlate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from careful_io.times import HOUR
from pareto_ltl.extend import LawOfParts
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray, require_shape

NEWEST = 12 * HOUR  # longest lead of a run that stands for the wind [s]
SITUATION = 48 * HOUR  # [s]
WIDEST_STEP = 6 * HOUR  # between leads, for an integral over time [s]
COMMON_SHARE = 0.5  # of the errors of the lead that has most; leads with fewer begin no displacement


@dataclass(frozen=True, slots=True)
class PointForecasts:
    """Forecasts of R runs for P places at N leads.

    Attributes
    ----------
    name : str
        Name of the file, for messages.
    runs : (R,) float
        Starts of the runs, increasing [s since 1970].
    leads : (N,) float
        Leads, increasing, not negative [s].
    winds : (R, P, N, 2) float
        Winds towards east and north [m/s]; NaN where there is none.
    places : (P, 2) float or None
        Longitude and latitude [deg]; None if they are not known.
    observed_times : (H,) float
        Times of observations, increasing [s since 1970]; empty if there are none.
    observed : (H, P, 2) float
        Observed winds [m/s]; NaN where there is none.
    notes : tuple of str
        Remarks of the reader.
    """

    name: str
    runs: FloatArray
    leads: FloatArray
    winds: FloatArray
    places: FloatArray | None
    observed_times: FloatArray
    observed: FloatArray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_shape("winds", self.winds, len(self.runs), None, len(self.leads), 2)
        require_shape("observed", self.observed, len(self.observed_times), self.winds.shape[1], 2)
        if self.places is not None:
            require_shape("places", self.places, self.winds.shape[1], 2)
        if np.any(np.diff(self.runs) <= 0) or np.any(np.diff(self.leads) <= 0) or self.leads[0] < 0:
            raise ValueError("runs and leads must increase, and leads must not be negative")

    @property
    def truth(self) -> str:
        """What verifies the forecasts: ``observed`` or ``own``."""
        return LawOfParts.OBSERVED if len(self.observed_times) else LawOfParts.OWN

    @property
    def spread(self) -> float:
        """Standard deviation of a component over places and times [m/s]."""
        return float(np.sqrt(np.mean(np.nanvar(self.winds.reshape(-1, 2), axis=0))))


class Verified(NamedTuple):
    """The errors of forecasts.

    Attributes
    ----------
    runs : (R,) float
        Starts of the runs [s since 1970].
    leads : (N,) float
        Leads [s].
    errors : (R, P, N, 2) float
        Forecast minus truth [m/s]; NaN where nothing verifies it, 0 where a run verifies itself.
    newer : (R, P, N) float
        Leads of the runs that stand for the wind [s]; equal to the lead where a run verifies itself.
    truth : str
        ``own`` or ``observed``.
    """

    runs: FloatArray
    leads: FloatArray
    errors: FloatArray
    newer: FloatArray
    truth: str

    @property
    def situation(self) -> IntArray:
        """Number of the situation of each run, (R,)."""
        return np.floor(self.runs / SITUATION).astype(np.int64)

    @property
    def compared(self) -> BoolArray:
        """Errors against something other than the run itself, (R, P, N)."""
        other = (
            np.full(self.newer.shape, True) if self.truth == LawOfParts.OBSERVED else self.newer < self.leads
        )
        return np.asarray(np.isfinite(self.errors).all(axis=-1) & other, bool)

    def of_situation(self, number: int) -> Verified:
        """The errors of the runs of one situation."""
        rows = self.situation == number
        return self._replace(runs=self.runs[rows], errors=self.errors[rows], newer=self.newer[rows])

    def situations(self) -> int:
        """Number of situations that have an error."""
        return len(np.unique(self.situation[self.compared.any(axis=(1, 2))]))


def verified(table: PointForecasts) -> Verified:
    """The errors of the forecasts of a table."""
    times, index = _valid_times(table)
    if table.truth == LawOfParts.OBSERVED:
        wind = np.full((len(times), *table.observed.shape[1:]), np.nan)
        at = np.round(table.observed_times / HOUR, 6)
        rows = np.flatnonzero(np.isin(at, times))
        wind[np.searchsorted(times, at[rows])] = table.observed[rows]
        newer = np.zeros((len(table.runs), wind.shape[1], len(table.leads)))
    else:
        wind, lead = _newest(table, index, len(times))
        newer = lead[index].transpose(0, 2, 1)
    errors = table.winds - wind[index].transpose(0, 2, 1, 3)
    return Verified(table.runs, table.leads, errors, newer, table.truth)


def truth_series(table: PointForecasts) -> tuple[FloatArray, FloatArray]:
    """Times (T,) [s since 1970] and winds (T, P, 2) [m/s] that verify a table; NaN where there is none."""
    if table.truth == LawOfParts.OBSERVED:
        return table.observed_times, table.observed
    times, index = _valid_times(table)
    return times * HOUR, _newest(table, index, len(times))[0]


def _valid_times(table: PointForecasts) -> tuple[FloatArray, IntArray]:
    """All valid times (T,) [h since 1970], and the index (R, N) of the time of each forecast."""
    valid = np.round((table.runs[:, None] + table.leads) / HOUR, 6)
    times = np.unique(valid)
    return times, np.searchsorted(times, valid)


def _newest(table: PointForecasts, index: IntArray, times: int) -> tuple[FloatArray, FloatArray]:
    """Winds (T, P, 2) of the newest runs at each time, and their leads (T, P); NaN if there is none."""
    places = table.winds.shape[1]
    wind, lead = np.full((times, places, 2), np.nan), np.full((times, places), np.nan)
    for j in np.flatnonzero(table.leads <= NEWEST)[::-1]:  # the shortest lead is written last
        known = np.isfinite(table.winds[:, :, j]).all(axis=-1)
        run, place = np.nonzero(known)
        wind[index[run, j], place] = table.winds[run, place, j]
        lead[index[run, j], place] = table.leads[j]
    return wind, lead


# --- displacements ----------------------------------------------------------------------------


class Window(NamedTuple):
    """The integral over a span of time by the trapezoidal rule.

    Attributes
    ----------
    start, time : float
        Lead at which it begins, and its length [s].
    columns : (n,) int
        Indices of the leads.
    weights : (n,) float
        Their weights [s].
    """

    start: float
    time: float
    columns: IntArray
    weights: FloatArray


def window(leads: FloatArray, start: float, time: float) -> Window | None:
    """The integral over ``time`` [s] from the lead ``start``; None if the leads do not cover it.

    It may begin at lead 0 if that is not among the leads: the error is 0 there, since a run that begins is
    the newest one.
    """
    columns = np.flatnonzero((leads >= start) & (leads <= start + time))
    at = leads[columns]
    if start == 0 < leads[0]:
        at = np.concatenate([[0.0], at])
    if len(at) < 2 or at[0] != start or at[-1] != start + time:
        return None
    steps = np.diff(at)
    if steps.max() > WIDEST_STEP:
        return None
    weights = np.zeros(len(at))
    weights[:-1] += steps / 2
    weights[1:] += steps / 2
    return Window(start, time, columns, weights[-len(columns) :])


def first_window(found: Verified, time: float) -> Window | None:
    """The integral over ``time`` [s] from the first lead at which many forecasts are compared.

    If the leads do not reach far enough, it begins as late as they allow; then a run verifies itself for
    some hours. None if no such span is covered.
    """
    counts = found.compared.sum(axis=(0, 1))
    if not counts.any():
        return None
    first = float(found.leads[np.flatnonzero(counts >= COMMON_SHARE * counts.max())[0]])
    starts = found.leads if found.truth == LawOfParts.OBSERVED else np.union1d(0.0, found.leads)
    spans = {float(start): window(found.leads, float(start), time) for start in starts}
    begun = [start for start, span in spans.items() if span is not None]
    if not begun:
        return None
    return spans[min((start for start in begun if start >= first), default=begun[-1])]


def displacements(found: Verified, span: Window) -> FloatArray:
    """Integrals of the errors over a span, (R, P, 2) [m]; NaN where an error of the span is not known."""
    return np.asarray(np.einsum("rpnc,n->rpc", found.errors[:, :, span.columns], span.weights), float)
