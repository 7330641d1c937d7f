"""Errors of forecasts and changes of the wind, estimated from past forecasts and analyses.

F_L(t) is a forecast of lead L that is valid at t, A(t) an analysis, and |.|² the mean square of one component
over the area and over pairs::

    D(τ)  = |A(t + τ) - A(t)|²
    e²(L) = |F_L(t) - A(t)|²                                             if some t has both, else
    e²(L) = |A(t + L) - F_L(t)|² - |F_L(t) - A(t - L)|²                  (asymmetry)

In the asymmetry both differences span a time L, the second one from the initial analysis of the forecast. It
assumes that (1) a forecast changes from its initial analysis as much as the wind does, so that the second
term is D(L), and (2) the error of the forecast and the change of the wind after its valid time are
uncorrelated, so that the first term is D(L) + e²(L). If errors grow and persist, the result is between e²(L)
and e²(2 L). Errors are relative to analyses: errors that an analysis has in common with the forecast are not
included.

For a lag that no two analyses have, a forecast and an analysis are used. An analysis at or before the start
of the forecast gives D by (1); one after its valid time gives D + e²(L), from which e²(L) is subtracted.

Lengths are the lengths of a Matern-3/2 correlation, fitted by least squares, over bins of distance, to the
mean products of the differences at two nodes. Intervals are from a block bootstrap over cycles.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.block_bootstrap import Interval, Resampling
from pareto_ltl.wind.gp import CORRELATIONS
from pareto_ltl.wind.matched_fields import MatchedFields, PairMoments, analyses, forecasts
from pareto_ltl.wind.readings import HOUR
from pareto_ltl.wind.snapshots import Snapshot

FEWEST_PAIRS = 5  # for an entry of a table
LENGTHS = np.geomspace(2e4, 4e6, 1000)  # candidates [m]

DIRECT, ASYMMETRY = "forecast and analysis of one time", "asymmetry"
ANALYSES, MIXED = "two analyses", "a forecast and an analysis"


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """Root mean squares by lead or lag.

    Attributes
    ----------
    at : (n,) float
        Leads or lags, increasing, above 0 [s].
    sd : tuple of Interval
        Root mean square of one component [m/s].
    pairs : (n,) int
        Number of pairs of fields for each value.
    ways : tuple of str
        Method by which each was estimated.
    """

    at: FloatArray
    sd: tuple[Interval, ...]
    pairs: IntArray
    ways: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LengthFit:
    """The correlation of differences by distance, and the length that fits it.

    Attributes
    ----------
    distances, observed : (B,) float
        Mean distances [m] and correlations of the bins; empty if there are none.
    length : Interval or None
        Matern-3/2 length [m]; None if it could not be estimated.
    reason : str
        Why it could not.
    """

    distances: FloatArray
    observed: FloatArray
    length: Interval | None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Persistence:
    """Correlation of the errors at valid times ``step`` [s] apart; None, with a reason, if not estimated."""

    value: Interval | None
    step: float = 0.0
    reason: str = ""


@dataclass(frozen=True, slots=True)
class ErrorEstimate:
    """Errors of forecasts and changes of the wind.

    Attributes
    ----------
    forecast : ErrorTable or None
        e(L); None if no forecast can be compared with analyses.
    forecast_length, change_length : LengthFit
        Length scales of the error and of the change.
    persistence : Persistence
        Correlation of the errors of one cycle over valid times.
    change : ErrorTable
        √D(τ).
    level : str
        Level of all winds.
    spread : float
        Standard deviation of the winds of one time over places [m/s].
    cycles, nodes : int
        Numbers of cycles and nodes.
    period : (float, float)
        First and last cycle [s since 1970].
    notes : tuple of str
        Remarks on data that was left out, and warnings.
    """

    forecast: ErrorTable | None
    forecast_length: LengthFit
    persistence: Persistence
    change: ErrorTable
    change_length: LengthFit
    level: str
    spread: float
    cycles: int
    nodes: int
    period: tuple[float, float]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Entry:
    """The pairs behind one entry of a table."""

    at: float
    way: str
    moments: PairMoments


def estimate_errors(
    snapshots: Sequence[Snapshot],
    area: Sequence[Sequence[float]] | None,
    draws: Resampling,
    max_lag: float = 48 * HOUR,
) -> ErrorEstimate:
    """Estimate errors of forecasts and changes of the wind, with intervals.

    Parameters
    ----------
    snapshots : sequence of Snapshot
        Fields of one level and one grid, with analyses (lead 0). Fields of unknown lead are left out.
    area : (C, 2) float or None
        Corners of the outline within which nodes are used [deg]; None: all nodes.
    draws : Resampling
        Settings of the bootstrap.
    max_lag : float
        Longest change of the wind [s].

    Raises
    ------
    DataError
        If there are fewer than ``FEWEST_PAIRS`` pairs of analyses at every lag, several levels or members, or
        too few common nodes.
    """
    known, notes = _usable(snapshots)
    fields = MatchedFields(known, area)
    leads, missing = _forecast_entries(fields)
    forecast = _error_table(leads, draws)
    lags, rare = _change_entries(fields, max_lag, leads)
    change = _error_table(lags, draws)
    if change is None:
        raise DataError(
            f"no lag up to {max_lag / HOUR:g} h has {FEWEST_PAIRS} pairs of analyses (lead 0); name a folder "
            "with more cycles, or raise --max-lag"
        )
    cycles = {snap.cycle for snap in known}
    blocks = len(cycles) / draws.length(len(cycles))
    if blocks < 10:
        notes.append(f"{len(cycles)} cycles make {blocks:.1f} blocks: intervals of so few are rough")
    return ErrorEstimate(
        forecast,
        _length_fit(fields, _told_apart(leads, forecast), draws, missing),
        _persistence(fields, draws),
        change,
        _length_fit(fields, lags, draws, ""),
        level=known[0].level,
        spread=fields.spread,
        cycles=len(cycles),
        nodes=len(fields.nodes),
        period=(min(cycles), max(cycles)),
        notes=tuple(notes + rare),
    )


def _usable(snapshots: Sequence[Snapshot]) -> tuple[list[Snapshot], list[str]]:
    """The snapshots with a known lead, and a note on those that were left out."""
    known = [snap for snap in snapshots if np.isfinite(snap.lead)]
    for what, found in (
        ("levels", {snap.level for snap in known}),
        ("members", {snap.member for snap in known}),
    ):
        if len(found) > 1:
            raise DataError(
                f"the wind files hold several {what} ({', '.join(sorted(found))}); name files of one of them"
            )
    if not any(snap.lead == 0 for snap in known):
        raise DataError(
            f"none of {len(snapshots)} winds is an analysis (lead 0), which forecasts are compared with; "
            "name a folder that holds the analyses of the forecasts' valid times"
        )
    left = len(snapshots) - len(known)
    return known, [f"{left} winds whose lead is not known were left out"] if left else []


# --- pairs -----------------------------------------------------------------------------------


def _forecast_entries(fields: MatchedFields) -> tuple[list[_Entry], str]:
    """Errors of each lead that has enough pairs, and the reason if there are none."""
    truth = analyses(fields.winds)
    direct: dict[float, list[tuple[float, FloatArray]]] = defaultdict(list)
    later: dict[float, list[tuple[float, FloatArray]]] = defaultdict(list)
    own: dict[float, list[tuple[float, FloatArray]]] = defaultdict(list)
    for cycle, lead, field in forecasts(fields.winds):
        time = cycle + lead
        if time in truth:
            direct[lead].append((cycle, field - truth[time]))
        elif time + lead in truth and cycle in truth:
            later[lead].append((cycle, truth[time + lead] - field))
            own[lead].append((cycle, field - truth[cycle]))
    entries = [_Entry(lead, DIRECT, fields.moments(pairs)) for lead, pairs in direct.items()]
    for lead in later.keys() - direct.keys():
        one, two = fields.moments(later[lead]), fields.moments(own[lead])
        moments = PairMoments(one.cycles, one.square - two.square, one.products - two.products)
        entries.append(_Entry(lead, ASYMMETRY, moments))
    used = sorted((e for e in entries if len(e.moments) >= FEWEST_PAIRS), key=lambda entry: entry.at)
    return used, "" if used else "no forecast can be compared with analyses"


def _change_entries(
    fields: MatchedFields, max_lag: float, leads: Sequence[_Entry]
) -> tuple[list[_Entry], list[str]]:
    """Changes over each lag that has enough pairs, and a note on the others."""
    truth = analyses(fields.winds)
    pairs: dict[float, list[tuple[float, FloatArray]]] = defaultdict(list)
    for first, one in truth.items():
        for second, two in truth.items():
            if 0 < second - first <= max_lag:
                pairs[second - first].append((first, two - one))
    entries = [_Entry(lag, ANALYSES, fields.moments(found)) for lag, found in pairs.items()]
    errors = {entry.at: entry.moments.table.mean(axis=0) for entry in leads}
    mixed: dict[float, list[PairMoments]] = defaultdict(list)
    for lag, cycle, lead, earlier, difference in _mixed_pairs(fields, max_lag):
        if lag not in pairs and (earlier or lead in errors):
            moments = fields.moments([(cycle, difference)])
            error = np.zeros(moments.table.shape[1]) if earlier or errors[lead][0] < 0 else errors[lead]
            mixed[lag].append(
                replace(moments, square=moments.square - error[0], products=moments.products - error[1:])
            )
    entries += [_Entry(lag, MIXED, _joined(found)) for lag, found in mixed.items()]
    used = [e for e in entries if len(e.moments) >= FEWEST_PAIRS and e.moments.square.mean() > 0]
    rare = [f"{at / HOUR:g}" for at in sorted({entry.at for entry in entries} - {entry.at for entry in used})]
    note = [f"lags of {', '.join(rare)} h have fewer than {FEWEST_PAIRS} pairs and were left out"]
    return sorted(used, key=lambda entry: entry.at), note if rare else []


def _mixed_pairs(
    fields: MatchedFields, max_lag: float
) -> Iterator[tuple[float, float, float, bool, FloatArray]]:
    """Lag, cycle and lead of a forecast, whether the analysis is not after the cycle, and the difference.

    Analyses between the start and the valid time of a forecast are left out, as they use newer data.
    """
    truth = analyses(fields.winds)
    for cycle, lead, field in forecasts(fields.winds):
        for time, analysis in truth.items():
            lag = abs(time - cycle - lead)
            if 0 < lag <= max_lag and not cycle < time < cycle + lead:
                yield lag, cycle, lead, time <= cycle, field - analysis


def _joined(moments: Sequence[PairMoments]) -> PairMoments:
    return PairMoments(
        np.concatenate([m.cycles for m in moments]),
        np.concatenate([m.square for m in moments]),
        np.concatenate([m.products for m in moments]),
    )


# --- estimates -------------------------------------------------------------------------------


def _error_table(entries: Sequence[_Entry], draws: Resampling) -> ErrorTable | None:
    """Root mean squares with intervals; 0 for a negative mean square."""
    if not entries:
        return None
    found = []
    for entry in entries:
        value = float(entry.moments.square.mean())
        drawn = draws.means(entry.moments.cycles, entry.moments.square[:, None])[:, 0]
        about = draws.interval(entry.moments.cycles, value, drawn, ratio=entry.way in (DIRECT, ANALYSES))
        found.append(Interval(*(float(np.sqrt(max(v, 0.0))) for v in (about.value, about.low, about.high))))
    return ErrorTable(
        np.array([entry.at for entry in entries]),
        tuple(found),
        np.array([len(entry.moments) for entry in entries]),
        tuple(entry.way for entry in entries),
    )


def _told_apart(entries: Sequence[_Entry], table: ErrorTable | None) -> list[_Entry]:
    """The entries whose interval excludes 0."""
    return [] if table is None else [e for e, sd in zip(entries, table.sd, strict=True) if sd.low > 0]


def _length_fit(
    fields: MatchedFields, entries: Sequence[_Entry], draws: Resampling, reason: str
) -> LengthFit:
    """Fit one length to all entries, each scaled to a mean square of 1."""
    if not entries:
        why = reason or "the error is not significantly above 0"
        return LengthFit(np.empty(0), np.empty(0), None, why)
    pooled = _joined([entry.moments.scaled(1 / float(entry.moments.square.mean())) for entry in entries])
    mean = pooled.table.mean(axis=0)
    observed = mean[1:] / mean[0]
    drawn = draws.means(pooled.cycles, pooled.table)
    lengths = matern_lengths(fields.distances, drawn[:, 1:] / drawn[:, :1])
    value = float(matern_lengths(fields.distances, observed[None])[0])
    if not np.isfinite(value):
        why = f"no length from {LENGTHS[0] / 1e3:g} to {LENGTHS[-1] / 1e3:g} km fits the correlations"
        return LengthFit(fields.distances, observed, None, why)
    return LengthFit(fields.distances, observed, draws.interval(pooled.cycles, value, lengths, ratio=True))


def matern_lengths(distances: FloatArray, observed: FloatArray) -> FloatArray:
    """The Matern-3/2 lengths (R,) [m] that best fit correlations (R, B) at ``distances`` (B,) [m].

    NaN if the best one is the shortest or the longest of the candidates.
    """
    model = CORRELATIONS["matern32"](distances[None] / LENGTHS[:, None])
    misfit = (model**2).sum(axis=1) - 2 * observed @ model.T
    best = misfit.argmin(axis=1)
    at_end = (best == 0) | (best == len(LENGTHS) - 1)
    return np.where(at_end, np.nan, LENGTHS[best])


def _persistence(fields: MatchedFields, draws: Resampling) -> Persistence:
    """Correlation of the errors of one cycle at its successive valid times::

    Σ e(t) e(t + s) / √(Σ e(t)² Σ e(t + s)²),  each e divided by the root mean square of its lead
    """
    truth = analyses(fields.winds)
    errors: dict[float, dict[float, FloatArray]] = defaultdict(dict)
    for cycle, lead, field in forecasts(fields.winds):
        if cycle + lead in truth:
            errors[cycle][lead] = field - truth[cycle + lead]
    if not errors:
        return Persistence(None, reason="no forecast has the valid time of an analysis")
    steps = {
        b - a for found in errors.values() for a, b in zip(sorted(found), sorted(found)[1:], strict=False)
    }
    if not steps:
        return Persistence(None, reason="no cycle has two forecasts with the valid times of analyses")
    step, squares = min(steps), defaultdict(list)
    for found in errors.values():
        for lead, error in found.items():
            squares[lead].append(fields.mean_product(error, error))
    rows = []
    for cycle, found in errors.items():
        for lead in found.keys() & {lead - step for lead in found}:
            one = found[lead] / np.sqrt(np.mean(squares[lead]))
            two = found[lead + step] / np.sqrt(np.mean(squares[lead + step]))
            products = (fields.mean_product(a, b) for a, b in ((one, two), (one, one), (two, two)))
            rows.append((cycle, *products))
    if len(rows) < FEWEST_PAIRS:
        return Persistence(None, reason=f"only {len(rows)} pairs of errors of one cycle")
    table = np.array(rows)
    return Persistence(_correlation(table[:, 0], table[:, 1:], draws), step)


def _correlation(cycles: FloatArray, products: FloatArray, draws: Resampling) -> Interval:
    """Correlation, with interval, from mean products (P, 3) of (1, 2), (1, 1), (2, 2); limited to [0, 1]."""
    drawn = draws.means(cycles, products)
    mean = products.mean(axis=0)
    value = float(mean[0] / np.sqrt(mean[1] * mean[2]))
    about = draws.interval(cycles, value, drawn[:, 0] / np.sqrt(drawn[:, 1] * drawn[:, 2]), ratio=False)
    return Interval(*(float(np.clip(v, 0.0, 1.0)) for v in (about.value, about.low, about.high)))
