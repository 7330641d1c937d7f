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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from careful_io.fingerprints import file_fingerprint
from careful_io.times import HOUR, iso
from pareto_ltl.extend import Snapshot
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.wind_errors.matched_fields import Interval, MatchedFields, PairMoments, Resampling
from wind_laws.forecast_error import ForecastError
from wind_laws.gp import CORRELATIONS

FEWEST_PAIRS = 5  # for an entry of a table
LENGTHS = np.geomspace(2e4, 4e6, 1000)  # candidates [m]
DIRECT, ASYMMETRY = "forecast and analysis of one time", "asymmetry"
ANALYSES, MIXED = "two analyses", "a forecast and an analysis"
Differences = dict[float, list[tuple[float, FloatArray]]]  # by lead or lag: cycles and differences


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

    @property
    def values(self) -> FloatArray:
        """The root mean squares without their intervals, (n,) [m/s]."""
        return np.array([sd.value for sd in self.sd])


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


class _Entry(NamedTuple):
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
    clear = [e for e, sd in zip(leads, forecast.sd if forecast else (), strict=True) if sd.low > 0]
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
        _length_fit(fields, clear, draws, missing),
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
    for what in ("level", "member"):
        found = {getattr(snap, what) for snap in known}
        if len(found) > 1:
            raise DataError(
                f"the wind files hold several {what}s ({', '.join(sorted(found))}); name files of one of them"
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
    truth = fields.analyses
    direct: Differences = defaultdict(list)
    later: Differences = defaultdict(list)
    own: Differences = defaultdict(list)
    for cycle, lead, field in fields.forecasts:
        time = cycle + lead
        if time in truth:
            direct[lead].append((cycle, field - truth[time]))
        elif time + lead in truth and cycle in truth:
            later[lead].append((cycle, truth[time + lead] - field))
            own[lead].append((cycle, field - truth[cycle]))
    entries = [_Entry(lead, DIRECT, fields.moments(pairs)) for lead, pairs in direct.items()]
    for lead in later.keys() - direct.keys():
        one, two = fields.moments(later[lead]), fields.moments(own[lead])
        entries.append(_Entry(lead, ASYMMETRY, PairMoments(one.cycles, one.table - two.table)))
    used = sorted((e for e in entries if len(e.moments.cycles) >= FEWEST_PAIRS), key=lambda entry: entry.at)
    return used, "" if used else "no forecast can be compared with analyses"


def _change_entries(
    fields: MatchedFields, max_lag: float, leads: Sequence[_Entry]
) -> tuple[list[_Entry], list[str]]:
    """Changes over each lag that has enough pairs, and a note on the others."""
    truth = fields.analyses
    pairs: Differences = defaultdict(list)
    for (first, one), (second, two) in permutations(truth.items(), 2):
        if 0 < second - first <= max_lag:
            pairs[second - first].append((first, two - one))
    entries = [_Entry(lag, ANALYSES, fields.moments(found)) for lag, found in pairs.items()]
    errors = {entry.at: entry.moments.table.mean(axis=0) for entry in leads}
    mixed: dict[float, list[PairMoments]] = defaultdict(list)
    for cycle, lead, field in fields.forecasts:
        for time, analysis in truth.items():
            lag, earlier = abs(time - cycle - lead), time <= cycle
            newer = cycle < time < cycle + lead  # such an analysis uses data after the start
            if newer or not 0 < lag <= max_lag or lag in pairs or not (earlier or lead in errors):
                continue
            found = fields.moments([(cycle, field - analysis)])
            if not earlier and errors[lead][0] >= 0:
                found = PairMoments(found.cycles, found.table - errors[lead])
            mixed[lag].append(found)
    entries += [_Entry(lag, MIXED, _joined(found)) for lag, found in mixed.items()]
    used = [e for e in entries if len(e.moments.cycles) >= FEWEST_PAIRS and e.moments.square.mean() > 0]
    rare = [f"{at / HOUR:g}" for at in sorted({entry.at for entry in entries} - {entry.at for entry in used})]
    note = [f"lags of {', '.join(rare)} h have fewer than {FEWEST_PAIRS} pairs and were left out"]
    return sorted(used, key=lambda entry: entry.at), note if rare else []


def _joined(moments: Sequence[PairMoments]) -> PairMoments:
    cycles, tables = zip(*moments, strict=True)
    return PairMoments(np.concatenate(cycles), np.concatenate(tables))


# --- estimates -------------------------------------------------------------------------------


def _error_table(entries: Sequence[_Entry], draws: Resampling) -> ErrorTable | None:
    """Root mean squares with intervals; 0 for a negative mean square."""
    if not entries:
        return None
    at, ways, moments = zip(*entries, strict=True)
    found = [
        draws.estimate(m.cycles, m.square, ratio=way in (DIRECT, ANALYSES)).root
        for way, m in zip(ways, moments, strict=True)
    ]
    return ErrorTable(np.array(at), tuple(found), np.array([len(m.cycles) for m in moments]), ways)


def _length_fit(
    fields: MatchedFields, entries: Sequence[_Entry], draws: Resampling, reason: str
) -> LengthFit:
    """Fit one length to all entries, each scaled to a mean square of 1."""
    if not entries:
        why = reason or "the error is not significantly above 0"
        return LengthFit(np.empty(0), np.empty(0), None, why)
    pooled = _joined([PairMoments(m.cycles, 1 / float(m.square.mean()) * m.table) for _, _, m in entries])
    mean, distances = pooled.table.mean(axis=0), fields.distances
    length = draws.estimate(
        pooled.cycles, pooled.table, lambda m: matern_lengths(distances, m[:, 1:] / m[:, :1]), ratio=True
    )
    if np.isfinite(length.value):
        return LengthFit(distances, mean[1:] / mean[0], length)
    why = f"no length from {LENGTHS[0] / 1e3:g} to {LENGTHS[-1] / 1e3:g} km fits the correlations"
    return LengthFit(distances, mean[1:] / mean[0], None, why)


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
    """Correlation of the errors of one cycle at its successive valid times, limited to [0, 1]::

    Σ e(t) e(t + s) / √(Σ e(t)² Σ e(t + s)²),  each e divided by the root mean square of its lead
    """
    truth = fields.analyses
    errors: dict[float, dict[float, FloatArray]] = defaultdict(dict)
    squares: dict[float, list[float]] = defaultdict(list)
    for cycle, lead, field in fields.forecasts:
        if cycle + lead in truth:
            errors[cycle][lead] = field - truth[cycle + lead]
    if not errors:
        return Persistence(None, reason="no forecast has the valid time of an analysis")
    steps = {b - a for found in errors.values() for a, b in pairwise(sorted(found))}
    if not steps:
        return Persistence(None, reason="no cycle has two forecasts with the valid times of analyses")
    step = min(steps)
    for found in errors.values():
        for lead, error in found.items():
            squares[lead].append(fields.mean_product(error, error))
    rows = []
    for cycle, found in errors.items():
        for lead in found.keys() & {lead - step for lead in found}:
            one, two = (found[at] / np.sqrt(np.mean(squares[at])) for at in (lead, lead + step))
            products = (fields.mean_product(a, b) for a, b in ((one, two), (one, one), (two, two)))
            rows.append((cycle, *products))
    if len(rows) < FEWEST_PAIRS:
        return Persistence(None, reason=f"only {len(rows)} pairs of errors of one cycle")
    table = np.array(rows)
    value = draws.estimate(
        table[:, 0], table[:, 1:], lambda m: m[:, 0] / np.sqrt(m[:, 1] * m[:, 2]), ratio=False
    )
    return Persistence(Interval(*(float(np.clip(v, 0.0, 1.0)) for v in value)), step)


# --- the file of `pareto-ltl wind-error` -------------------------------------------------------


def estimated_law(estimate: ErrorEstimate, name: str, usual: ForecastError) -> ForecastError:
    """The estimated law; missing values are taken from ``usual``.

    ``usual`` is scaled to the spread of the winds if its level differs.
    """
    law = replace(usual.for_winds(estimate.level, estimate.spread), name=name, spread=estimate.spread)
    found: dict[str, Any] = {"lags": estimate.change.at, "change_sd": estimate.change.values}
    if (table := estimate.forecast) is not None:
        found |= {"leads": np.append(0.0, table.at), "forecast_sd": np.append(0.0, table.values)}
    if (length := estimate.forecast_length.length) is not None:
        found["forecast_length"] = length.value
    if (length := estimate.change_length.length) is not None:
        found["change_length"] = length.value
    if (value := estimate.persistence.value) is not None:
        found |= {"persistence": value.value, "persistence_time": estimate.persistence.step}
    return replace(law, **found)


def error_document(
    estimate: ErrorEstimate,
    law: ForecastError,
    usual: str,
    files: Sequence[Path],
    analysis_error: Mapping[str, Any] | str,
) -> dict[str, Any]:
    """The content of the file: the law, intervals, numbers of pairs, origin of each number, source files.

    Parameters
    ----------
    usual : str
        Name of the law whose values are used where the data do not suffice.
    """
    document = law.document()
    forecast, change = document["forecast"], document["change"]
    if estimate.forecast is not None:
        columns = _columns(estimate.forecast)
        by_definition = (0.0, 0.0, None, "by definition")  # of lead 0
        forecast |= {
            name: [first, *columns[name]] for name, first in zip(columns, by_definition, strict=True)
        }
    forecast |= _ends("length", estimate.forecast_length.length)
    forecast |= _ends("persistence", estimate.persistence.value)
    change |= _columns(estimate.change) | _ends("length", estimate.change_length.length)
    head = {key: document[key] for key in ("schema", "name")} | {"origin": origin_text(estimate, usual)}
    tail = {"analysis_error": analysis_error, "files": {file.name: file_fingerprint(file) for file in files}}
    return head | document | tail


def origin_text(estimate: ErrorEstimate, usual: str) -> str:
    """Text on the origin of the numbers, and on the numbers that are not from the data."""
    first, last = (iso(moment) for moment in estimate.period)
    sentences = [
        f"{estimate.cycles} cycles from {first} to {last}, {estimate.nodes} nodes; errors are differences "
        "from analyses; 95 % intervals by a block bootstrap over cycles"
    ]
    if (table := estimate.forecast) is not None:
        ways = "; ".join(f"e({at / HOUR:g} h) by {way}" for at, way in zip(table.at, table.ways, strict=True))
        sentences.append(ways)
    assumed = [f"{what} taken from {usual}, since {why}" for what, why in unknown_parts(estimate).items()]
    return ". ".join([*sentences, *assumed, *estimate.notes])


def unknown_parts(estimate: ErrorEstimate) -> dict[str, str]:
    """The values that could not be estimated, each with the reason."""
    error, change, persistence = estimate.forecast_length, estimate.change_length, estimate.persistence
    parts = {
        "error of forecasts": (estimate.forecast, error.reason),
        "length of the error": (error.length, error.reason),
        "length of the change": (change.length, change.reason),
        "persistence": (persistence.value, persistence.reason),
    }
    return {name: reason for name, (found, reason) in parts.items() if found is None}


def _columns(table: ErrorTable) -> dict[str, list[Any]]:
    low, high = ([getattr(sd, end) for sd in table.sd] for end in ("low", "high"))
    return {"sd_low": low, "sd_high": high, "pairs": table.pairs.tolist(), "ways": list(table.ways)}


def _ends(name: str, found: Interval | None) -> dict[str, float | None]:
    low, high = (None, None) if found is None else (found.low, found.high)
    return {f"{name}_low": low, f"{name}_high": high}
