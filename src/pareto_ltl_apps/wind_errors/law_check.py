"""How often errors of forecasts stay within the intervals of a law: errors at leads, and displacements.

For each value x with the standard deviation σ of the law, z = x / σ. ``cover`` at q is the share of the
values with ``|z|`` at most the quantile of the law for q, ``rms_z`` the root mean square of z. Both
components, all places and all runs count; ``n`` is the number of situations that they are from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from careful_io.times import HOUR
from pareto_ltl.extend import LawOfParts
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.wind_errors.point_forecasts import (
    PointForecasts,
    Verified,
    Window,
    displacements,
    first_window,
    verified,
)
from pareto_ltl_apps.wind_errors.scale_mixture import quantiles

LEVELS = (0.5, 0.9, 0.99, 0.999)
LEVEL_NAMES = ("cover50", "cover90", "cover99", "cover999")
ERROR_HOURS = (6, 12, 18, 24, 36, 48, 60, 72)
DISPLACEMENT_HOURS = (6, 12, 24, 48)
ERROR, DISPLACEMENT = "error", "displacement"
FEWEST_VALUES = 20  # of a row
UNLIKELY_SPREAD = 1.7  # ratio of the spreads of the winds of a table and of a law


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One lead, or one time of a displacement.

    Attributes
    ----------
    hours : float
        Lead, or time of the displacement [h].
    kind : str
        ``error`` or ``displacement``.
    start : float
        Lead at which a displacement begins [h]; the lead of an error.
    z : (V,) float
        Values divided by the standard deviation of the law.
    situation : (V,) int
        The situation of each value.
    tail : float
        s of the law for these values.
    rms : float
        Root mean square of the values, [m/s] or [m].
    span : Window or None
        The span of a displacement; None for an error.
    """

    hours: float
    kind: str
    start: float
    z: FloatArray
    situation: IntArray
    tail: float
    rms: float
    span: Window | None = None

    def with_tail(self, law: LawOfParts) -> CheckRow:
        """The row with the tails of ``law``."""
        time = 0.0 if self.span is None else self.span.time
        return replace(self, tail=law.scale.spread(HOUR * self.start, time))

    @property
    def covered(self) -> tuple[float, ...]:
        """Share of the values within the intervals of ``LEVELS``."""
        limits = quantiles(np.array(LEVELS), self.tail)
        return tuple(float(np.mean(np.abs(self.z) <= limit)) for limit in limits)

    def document(self) -> dict[str, Any]:
        """The row of the answer."""
        head = {"hours": self.hours, "kind": self.kind}
        cover = dict(zip(LEVEL_NAMES, self.covered, strict=True))
        tail = {
            "rms_z": float(np.sqrt(np.mean(self.z**2))),
            "n": len(np.unique(self.situation)),
            "values": len(self.z),
            "start_hours": self.start,
            "rms": self.rms,
        }
        return head | cover | tail


def check_law(table: PointForecasts, law: LawOfParts) -> tuple[Verified, list[CheckRow]]:
    """Compare the errors of a table with a law.

    Raises
    ------
    DataError
        If no lead and no displacement has ``FEWEST_VALUES`` errors.
    """
    found = verified(table)
    rows = check_rows(found, law)
    if not rows:
        raise DataError(
            f"{table.name}: no lead of {', '.join(map(str, ERROR_HOURS))} h has {FEWEST_VALUES} forecasts "
            "that a newer run or an observation verifies; name a table with more runs of one model"
        )
    return found, rows


def check_rows(
    found: Verified,
    law: LawOfParts,
    spans: Sequence[Window | None] | None = None,
    fewest: int = FEWEST_VALUES,
) -> list[CheckRow]:
    """The rows of all leads and displacements with ``fewest`` values; ``spans`` instead of the first ones."""
    rows = [_error_row(found, law, hours, fewest) for hours in ERROR_HOURS]
    if spans is None:
        spans = [first_window(found, HOUR * hours) for hours in DISPLACEMENT_HOURS]
    rows += [_displacement_row(found, law, span, fewest) for span in spans if span is not None]
    return [row for row in rows if row is not None]


def check_document(
    table: PointForecasts, law: LawOfParts, found: Verified, rows: Sequence[CheckRow]
) -> dict[str, Any]:
    """The answer of ``pareto-ltl wind-error --check``."""
    n = found.situations()
    return {
        "table": table.name,
        "law": law.name,
        "truth": found.truth,
        "n": n,
        "floor": 1.0 / (n + 1),
        "law_n": law.situations,
        "law_floor": law.floor,
        "rows": [row.document() for row in rows],
    }


def spread_note(table: PointForecasts, law: LawOfParts) -> str | None:
    """A remark on winds that spread much more or less than the winds of the law; else None."""
    ratio = table.spread / law.spread
    if 1 / UNLIKELY_SPREAD <= ratio <= UNLIKELY_SPREAD or not np.isfinite(ratio):
        return None
    likely = "are they in knots, or from another height?" if ratio > 1 else "are they from another height?"
    return (
        f"the winds of {table.name} spread by {table.spread:.2f} m/s, the winds of the law {law.name} by "
        f"{law.spread:.2f}: {likely}"
    )


def _error_row(found: Verified, law: LawOfParts, hours: float, fewest: int) -> CheckRow | None:
    columns = np.flatnonzero(np.isclose(found.leads, hours * HOUR))
    if not len(columns):
        return None
    at = found.leads[columns]
    compared = found.compared[:, :, columns, None]
    x = np.where(compared, found.errors[:, :, columns], np.nan)[:, :, 0]
    if found.truth != LawOfParts.OWN:
        sd = np.full(x.shape[:2], float(np.sqrt(law.variance(at)[0])))
    else:
        sd = _by_pattern(found.newer[:, :, columns], lambda rows: np.sqrt(law.covariance(at, rows)[:, 0, 0]))
    row = _row(found, x, sd, fewest)
    if row is None:
        return None
    return CheckRow(hours, ERROR, hours, *row[:2], law.scale.spread(hours * HOUR), row[2])


def _displacement_row(found: Verified, law: LawOfParts, span: Window, fewest: int) -> CheckRow | None:
    row = _row(found, displacements(found, span), displacement_sd(found, law, span), fewest)
    if row is None:
        return None
    tail = law.scale.spread(span.start, span.time)
    return CheckRow(span.time / HOUR, DISPLACEMENT, span.start / HOUR, *row[:2], tail, row[2], span)


def displacement_sd(found: Verified, law: LawOfParts, span: Window) -> FloatArray:
    """Standard deviation (R, P) [m] of the displacements over a span by the law."""
    at, w = found.leads[span.columns], span.weights
    if found.truth != LawOfParts.OWN:
        return np.full(found.errors.shape[:2], float(np.sqrt(w @ law.covariance(at) @ w)))
    return _by_pattern(
        found.newer[:, :, span.columns],
        lambda rows: np.sqrt(np.einsum("rij,i,j->r", law.covariance(at, rows), w, w)),
    )


def _by_pattern(newer: FloatArray, sd_of: Any) -> FloatArray:
    """``sd_of`` each different row of ``newer`` (R, P, n), spread to (R, P); NaN for rows with NaN."""
    flat = newer.reshape(-1, newer.shape[-1])
    patterns, owner = np.unique(flat, axis=0, return_inverse=True)
    known = np.isfinite(patterns).all(axis=1)
    values = np.full(len(patterns), np.nan)
    for part in np.array_split(np.flatnonzero(known), max(1, known.sum() * newer.shape[-1] ** 2 // 10**7)):
        if len(part):
            values[part] = sd_of(patterns[part])
    return values[owner.reshape(-1)].reshape(newer.shape[:2])


def _row(
    found: Verified, x: FloatArray, sd: FloatArray, fewest: int
) -> tuple[FloatArray, IntArray, float] | None:
    """Standardised values, their situations and their root mean square; None if they are too few."""
    good = np.isfinite(x).all(axis=-1) & (sd > 0)
    if 2 * int(good.sum()) < fewest:
        return None
    situation = np.repeat(found.situation[:, None], x.shape[1], axis=1)[good]
    values = x[good]
    z = (values / sd[good][:, None]).ravel()
    return z, np.repeat(situation, 2), float(np.sqrt(np.mean(values**2)))
