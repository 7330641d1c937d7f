"""Values, statistics and cells of the tables of studies and sweeps: rates with exact intervals, quartiles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from careful_io.texts import interval_text, probability_text
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.counts import clopper_pearson

Columns = dict[str, Any]  # columns of a table by name, or one of its rows

# --- values in files -------------------------------------------------------------------------


def flags_to_text(values: BoolArray) -> str:
    """Flags (N,) as a text of N digits 0 and 1: small, and readable in a file."""
    return "".join("1" if value else "0" for value in values)


def text_to_flags(text: str) -> BoolArray:
    """Flags (N,) from what :func:`flags_to_text` wrote."""
    return np.asarray(np.frombuffer(text.encode(), np.uint8) == ord("1"))


def number_or_nan(value: float | None) -> float:
    """A number out of a file, where NaN is null."""
    return math.nan if value is None else float(value)


# --- statistics ------------------------------------------------------------------------------


def rate_interval(events: int, runs: int) -> tuple[float, float, float]:
    """Share of ``events`` among ``runs``, and its exact interval (Clopper and Pearson); NaN without runs."""
    return (events / runs, *clopper_pearson(events, runs)) if runs else (math.nan,) * 3


def interval_columns(name: str, value: float, low: float, high: float) -> Columns:
    """``name``, ``name_low`` and ``name_high``: a number and its interval."""
    return {name: value, f"{name}_low": low, f"{name}_high": high}


def rate_columns(name: str, hits: BoolArray) -> Columns:
    """The share of ``hits`` (N,) and its exact interval; NaN if N = 0."""
    return interval_columns(name, *rate_interval(int(hits.sum()), len(hits)))


def exceeds(hits: BoolArray, promised: float) -> bool:
    """Whether the share of ``hits`` (N,) is significantly larger than ``promised`` (95 %)."""
    return rate_interval(int(hits.sum()), len(hits))[1] > promised


def mean_chance_columns(name: str, total: float, n: int) -> Columns:
    """The mean of ``n`` probabilities that sum to ``total``, with a conservative 95 % interval.

    Outcomes ~ Bernoulli(p_i) vary more than the probabilities p_i, so the Clopper-Pearson intervals of the
    neighbouring integer counts cover the mean. NaN if n = 0.
    """
    if n == 0:
        return interval_columns(name, math.nan, math.nan, math.nan)
    low, _ = clopper_pearson(math.floor(total + 1e-9), n)
    _, high = clopper_pearson(math.ceil(total - 1e-9), n)
    return interval_columns(name, total / n, low, high)


def quartiles_of(values: Sequence[float] | FloatArray) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile of the finite ``values``; NaN if there are none."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    if not len(known):
        return math.nan, math.nan, math.nan
    low, middle, high = np.quantile(known, [0.25, 0.5, 0.75])
    return float(low), float(middle), float(high)


def quartile_columns(name: str, values: Sequence[float] | FloatArray) -> Columns:
    """``name``, ``name_q25`` and ``name_q75``: median and quartiles of the finite ``values``."""
    low, middle, high = quartiles_of(values)
    return {name: middle, f"{name}_q25": low, f"{name}_q75": high}


def mcnemar_test(first_only: int, second_only: int) -> float:
    """Two-sided exact p value of McNemar's test: pairs that differ are Binomial(n, 1/2)."""
    from scipy.stats import binomtest

    n = first_only + second_only
    return 1.0 if n == 0 else float(binomtest(first_only, n, 0.5).pvalue)


def mean_interval(values: FloatArray) -> tuple[float, float]:
    """95 % interval of a mean over seeds (Student's t); NaN for fewer than two ``values`` (N,)."""
    from scipy.special import stdtrit

    if len(values) < 2:
        return math.nan, math.nan
    middle, half = values.mean(), values.std(ddof=1) / math.sqrt(len(values))
    half *= float(stdtrit(len(values) - 1, 0.975))
    return float(middle - half), float(middle + half)


# --- values on a page ------------------------------------------------------------------------


def rate_cell(row: Mapping[str, Any], name: str, ends: tuple[str, str] = ("low", "high")) -> str:
    """A rate of ``row`` with its interval: ``1.2 % (0.9 to 1.5 %)``."""
    if not math.isfinite(row[name]):
        return "-"
    low, high = (row[f"{name}_{end}"] for end in ends)
    return f"{probability_text(row[name])} ({interval_text(low, high)})"


def quartiles_cell(row: Mapping[str, Any], name: str) -> str:
    """A median of ``row`` with its quartiles: ``1.2 % (0.9 to 1.5 %)``."""
    return rate_cell(row, name, ("q25", "q75"))


def length_cell(row: Mapping[str, Any]) -> str:
    """The length of ``row`` in whole kilometres; a dash where it is not known."""
    return f"{row['length_m'] / 1e3:.0f}" if math.isfinite(row["length_m"]) else "-"


def markdown_table(title: str, columns: Mapping[str, str | Callable[[Any], str]], rows: Iterable[Any]) -> str:
    """A table in Markdown below its title.

    ``columns`` maps the head of a column to a function that makes its cell of a row, or to the key of a row
    that is shown as it is.
    """
    lines = [f"**{title}**", "", f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    for row in rows:
        cells = (str(row[cell]) if isinstance(cell, str) else cell(row) for cell in columns.values())
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])
