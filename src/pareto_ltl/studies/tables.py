"""Rates with intervals, paired differences, and tables as people read them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pareto_ltl.simulation.flights import clopper_pearson
from pareto_ltl.support.arrays import BoolArray, FloatArray

Row = dict[str, Any]


def bits(flags: BoolArray) -> str:
    """Flags as a text of 0 and 1: small, and readable in a file."""
    return "".join("1" if flag else "0" for flag in flags)


def flags(text: str) -> BoolArray:
    return np.asarray(np.frombuffer(text.encode(), np.uint8) == ord("1"))


def rate(name: str, hits: BoolArray) -> Row:
    """A rate and its 95 % Clopper-Pearson interval; NaN of nothing."""
    if not len(hits):
        return {name: math.nan, f"{name}_low": math.nan, f"{name}_high": math.nan}
    low, high = clopper_pearson(int(hits.sum()), len(hits))
    return {name: float(hits.mean()), f"{name}_low": low, f"{name}_high": high}


def share(name: str, total: float, n: int) -> Row:
    """The mean of ``n`` chances that sum to ``total``, with an interval that is not too narrow.

    Each chance p_i is known, its outcome is not: outcomes ~ Bernoulli(p_i) vary more than the p_i do, so the
    Clopper-Pearson interval of the neighbouring whole counts covers the mean.
    """
    if n == 0:
        return {name: math.nan, f"{name}_low": math.nan, f"{name}_high": math.nan}
    low, _ = clopper_pearson(math.floor(total + 1e-9), n)
    _, high = clopper_pearson(math.ceil(total - 1e-9), n)
    return {name: total / n, f"{name}_low": low, f"{name}_high": high}


def mcnemar(first_only: int, second_only: int) -> float:
    """Two-sided exact p-value of McNemar's test: of the pairs that differ, each side has half (Binomial)."""
    from scipy.stats import binomtest

    n = first_only + second_only
    return 1.0 if n == 0 else float(binomtest(first_only, n, 0.5).pvalue)


def mean_interval(values: FloatArray) -> tuple[float, float]:
    """95 % interval of a mean over seeds (Student's t); NaN of fewer than two."""
    from scipy.special import stdtrit

    if len(values) < 2:
        return math.nan, math.nan
    middle, half = values.mean(), values.std(ddof=1) / math.sqrt(len(values))
    half *= float(stdtrit(len(values) - 1, 0.975))
    return float(middle - half), float(middle + half)


def quartiles(name: str, values: Sequence[float] | FloatArray) -> Row:
    """Median and quartiles of what is known; NaN of nothing."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    low, middle, high = np.quantile(known, [0.25, 0.5, 0.75]) if len(known) else (math.nan,) * 3
    return {name: float(middle), f"{name}_q25": float(low), f"{name}_q75": float(high)}


def number(value: float | None) -> float:
    """A number out of a file, where NaN is null."""
    return math.nan if value is None else float(value)


def percent(value: float) -> str:
    """As many digits as tell something: 0.12 %, 4.5 %, 45.7 %, 99.98 %."""
    if not math.isfinite(value):
        return "-"
    if 0 < value < 1e-7:
        return "< 1e-5 %"
    value *= 100
    if value in (0, 100):
        return f"{value:.0f} %"
    if value > 99:
        return f"{min(value, 99.99):.2f} %"
    return f"{value:.2g} %" if value < 10 else f"{value:.1f} %"


def with_interval(row: Mapping[str, Any], name: str) -> str:
    """``1.2 % (0.9 to 1.5)``."""
    if not math.isfinite(row[name]):
        return "-"
    low, high = (percent(row[f"{name}_{end}"]).removesuffix(" %") for end in ("low", "high"))
    return f"{percent(row[name])} ({low} to {high})"


def spread(row: Mapping[str, Any], name: str) -> str:
    """Median and quartiles: ``1.2 % (0.9 to 1.5)``."""
    if not math.isfinite(row[name]):
        return "-"
    low, high = (percent(row[f"{name}_{end}"]).removesuffix(" %") for end in ("q25", "q75"))
    return f"{percent(row[name])} ({low} to {high})"


def kilometres(metres: float) -> str:
    return f"{metres / 1e3:.0f}" if math.isfinite(metres) else "-"


def markdown(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table under a line that says what it is."""
    lines = [f"**{title}**", "", f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows), ""])
