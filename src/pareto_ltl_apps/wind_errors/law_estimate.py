"""The law of parts of a table of point forecasts: fit, intervals, and coverage of situations left out.

Each situation in turn is left out, with its two neighbours in time, the law is fitted to the others, and the
errors of the situation are divided by its standard deviations. Intervals of numbers of the law and of
coverages are from a bootstrap over situations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from careful_io.times import HOUR
from pareto_ltl.extend import LawOfParts, LawPart
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.wind_errors.error_moments import error_moments
from pareto_ltl_apps.wind_errors.law_check import CheckRow, check_rows
from pareto_ltl_apps.wind_errors.law_fit import Fit, fit_parts
from pareto_ltl_apps.wind_errors.law_tails import TailCounts
from pareto_ltl_apps.wind_errors.point_forecasts import PointForecasts, Verified, truth_series, verified
from wind_laws.error_law import TailScale

LONGEST_LEAD = 120 * HOUR  # [s] of the leads that are fitted
LAGS = HOUR * np.array([1.0, 3, 6, 9, 12, 15, 18, 21, 24, 30])  # of D(τ) [s]
FEWEST_SITUATIONS = 3  # for an estimate
FEW_SITUATIONS = 10  # below, a warning
FEWEST_CHANGES = 30  # behind a value of D(τ)
CHANGE_LENGTH = 400e3  # [m] of D(τ), as in the packaged law gfs
LASTING_SD = 0.35  # [m/s]
LASTING_LENGTH = 1000e3  # [m]
LASTING_ORIGIN = (
    "the lasting part, 0.35 m/s and 1,000 km, cannot be seen where newer runs verify; it is from one "
    "situation, forecasts of MEPS against 823 stations on 17 February 2019, which allow 0.3 to 0.4 m/s"
)
DRAWS = 60  # of the bootstrap of numbers of the law, each a fit
COVERAGE_DRAWS = 1000  # of the bootstrap of coverages


class LeftOut(NamedTuple):
    """Coverage of the situations left out, for one lead or one displacement.

    Attributes
    ----------
    row : CheckRow
        Values of all situations, each divided by the standard deviation of the law without it.
    covered : tuple of float
        Shares within the intervals of ``LEVELS``.
    low, high : tuple of float
        Their 95 % intervals, by a bootstrap over situations.
    """

    row: CheckRow
    covered: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class LawEstimate:
    """A law and how well it is known.

    Attributes
    ----------
    law : LawOfParts
        The law.
    table : PointForecasts
        The data.
    found : Verified
        Its errors.
    rows : sequence of CheckRow
        The errors against the law itself.
    left_out : sequence of LeftOut
        The errors of situations against the law of the others; empty if it was not wanted.
    notes : tuple of str
        Remarks.
    """

    law: LawOfParts
    table: PointForecasts
    found: Verified
    rows: Sequence[CheckRow]
    left_out: Sequence[LeftOut]
    notes: tuple[str, ...]


def estimate_law(
    table: PointForecasts, name: str, level: str = "10m", seed: int = 0, leave_out: bool = True
) -> LawEstimate:
    """The law of parts of the errors in a table of winds of one ``level``.

    Raises
    ------
    DataError
        If nothing verifies the forecasts, or they are from fewer than ``FEWEST_SITUATIONS`` situations.
    """
    found = verified(table)
    n = found.situations()
    if n < FEWEST_SITUATIONS:
        raise DataError(_too_few(table, n))
    moments = error_moments(table, found, LONGEST_LEAD)
    fit = fit_parts(moments)
    law = replace(_law(table, found, name, fit.parts), level=level)
    rows = check_rows(found, law)
    counts = TailCounts.of(rows, moments.groups)
    law = replace(law, scale=counts.tails(np.ones(moments.situations)))
    rows = [row.with_tail(law) for row in rows]
    left = _left_out(found, law, fit, counts) if leave_out else []
    law = replace(law, intervals=_intervals(law, fit, counts, seed))
    return LawEstimate(law, table, found, rows, left, (*table.notes, *_notes(table, found)))


def _too_few(table: PointForecasts, n: int) -> str:
    if len(table.runs) == 1 and table.truth != LawOfParts.OBSERVED:
        return (
            f"{table.name}: holds one run only, and nothing verifies it; add later runs of the model, or "
            "observations"
        )
    return (
        f"{table.name}: the errors are from {n} situations (dates at least two days apart); a law needs "
        f"{FEWEST_SITUATIONS}: add runs of other dates"
    )


def _notes(table: PointForecasts, found: Verified) -> Iterator[str]:
    n = found.situations()
    if n < FEW_SITUATIONS:
        yield (
            f"WARNING: {n} situations only: the law is rough, and no rate below 1/{n + 1} can be claimed; "
            f"{FEW_SITUATIONS} or more are wanted"
        )
    share = float(np.mean(np.isfinite(table.winds).all(axis=-1)))
    if share < 0.9:
        yield f"{100 * (1 - share):.0f} % of the winds of the table are missing; they are left out"
    if table.places is None:
        yield "the table has no positions: the lengths of the parts are assumed (150, 300 and 35 km)"
    if found.truth != LawOfParts.OBSERVED:
        yield LASTING_ORIGIN


def _law(table: PointForecasts, found: Verified, name: str, parts: tuple[LawPart, ...]) -> LawOfParts:
    zero = np.zeros(1)
    lags, change = change_table(table)
    lasting = LawPart(LawPart.LASTING, zero, np.array([LASTING_SD]), np.array([np.inf]), LASTING_LENGTH)
    both = parts if found.truth == LawOfParts.OBSERVED else (lasting, *parts)
    first, last = (np.datetime64(int(t), "s").astype("datetime64[D]") for t in table.runs[[0, -1]])
    by = "observations" if found.truth == LawOfParts.OBSERVED else f"newer runs. T{LASTING_ORIGIN[1:]}"
    origin = (
        f"{table.name}: {len(table.runs)} runs from {first} to {last}, {table.winds.shape[1]} places; "
        f"verified by {by}"
    )
    return LawOfParts(
        name, "10m", table.spread, both, TailScale(0.0, zero, zero, HOUR), found.situations(), found.truth,
        origin, lags, change, CHANGE_LENGTH,
    )  # fmt: skip


def change_table(table: PointForecasts) -> tuple[FloatArray, FloatArray]:
    """Times [s] and root mean square changes [m/s] of the wind that verifies a table."""
    times, wind = truth_series(table)
    lags, found = [], []
    for lag in LAGS:
        later = np.searchsorted(times, times + lag)
        here = np.flatnonzero(later < len(times))
        here = here[np.isclose(times[later[here]], times[here] + lag)]
        square = (wind[later[here]] - wind[here]) ** 2
        if np.isfinite(square).sum() >= FEWEST_CHANGES:
            lags.append(lag)
            found.append(float(np.sqrt(np.nanmean(square))))
    if not lags:
        raise DataError(
            f"{table.name}: no two verifying winds are {LAGS[0] / HOUR:g} to {LAGS[-1] / HOUR:g} h apart; "
            "add runs that follow each other"
        )
    return np.array(lags), np.array(found)


# --- situations left out ----------------------------------------------------------------------


def _left_out(found: Verified, law: LawOfParts, fit: Fit, counts: TailCounts) -> list[LeftOut]:
    """Coverage of each situation by the law of the situations that are not its neighbours."""
    values: dict[tuple[str, float], list[CheckRow]] = {}
    groups, spans = fit.moments.groups, [row.span for row in counts.rows]
    for group in groups.tolist():
        weights = (np.abs(groups - group) > 1).astype(float)
        scale = counts.tails(weights)
        other = replace(law, parts=_with(law, fit.with_weights(weights)), scale=scale)
        for row in check_rows(found.of_situation(group), other, spans, fewest=1):
            values.setdefault((row.kind, row.hours), []).append(row)
    return [_joined(each) for each in values.values()]


def _with(law: LawOfParts, parts: tuple[LawPart, ...]) -> tuple[LawPart, ...]:
    """``parts``, and the parts of the law that they do not replace."""
    names = {part.name for part in parts}
    return (*(part for part in law.parts if part.name not in names), *parts)


def _joined(rows: Sequence[CheckRow]) -> LeftOut:
    """The values of all situations, and a bootstrap over the situations."""
    inside = np.array([np.multiply(row.covered, len(row.z)) for row in rows])
    counts = np.array([len(row.z) for row in rows], float)
    draws = np.random.default_rng(0).multinomial(len(rows), np.full(len(rows), 1 / len(rows)), COVERAGE_DRAWS)
    shares = (draws @ inside) / np.maximum(draws @ counts, 1.0)[:, None]
    low, high = np.quantile(shares, [0.025, 0.975], axis=0)
    together = replace(
        rows[0],
        z=np.concatenate([row.z for row in rows]),
        situation=np.concatenate([row.situation for row in rows]),
        rms=float(np.sqrt(np.average([row.rms**2 for row in rows], weights=counts))),
    )
    covered = inside.sum(axis=0) / counts.sum()
    return LeftOut(together, *(tuple(each.tolist()) for each in (covered, low, high)))


# --- intervals --------------------------------------------------------------------------------


def law_numbers(law: LawOfParts) -> Mapping[str, float]:
    """Numbers of a law that reports state, of the parts that newer runs show: by name with the unit."""
    hours = np.array([6.0, 24.0, 48.0])
    sd = np.sqrt(law.variance(HOUR * hours, "own"))
    steps = np.linspace(0.0, 24 * HOUR, 97)
    w = np.full(len(steps), steps[1])
    w[[0, -1]] /= 2
    seen = replace(law, parts=law.seen_by("own"))
    moved = float(np.sqrt(w @ seen.covariance(steps) @ w)) / 1e3
    named = {f"sd at {hour:g} h [m/s]": float(value) for hour, value in zip(hours, sd, strict=True)}
    return named | {"displacement in 24 h [km]": moved, "s of a lead of 24 h": law.scale.spread(24 * HOUR)}


def _intervals(law: LawOfParts, fit: Fit, counts: TailCounts, seed: int) -> dict[str, tuple[float, float]]:
    rng, n, drawn = np.random.default_rng(seed), fit.moments.situations, []
    for _ in range(DRAWS):
        weights = rng.multinomial(n, np.full(n, 1.0 / n)).astype(float)
        scale = counts.tails(weights)
        other = replace(law, parts=_with(law, fit.with_weights(weights)), scale=scale)
        drawn.append(law_numbers(other))
    intervals = {}
    for name, value in law_numbers(law).items():
        sd = float(np.std([each[name] for each in drawn]))
        intervals[name] = (max(value - 1.96 * sd, 0.0), value + 1.96 * sd)
    return intervals
