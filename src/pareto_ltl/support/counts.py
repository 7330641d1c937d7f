"""Probabilities of counts. ``scipy.stats`` has them too, but its import adds half a second to every run."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray


def binomial_tail(least: IntArray | int, runs: IntArray | int, chance: float) -> FloatArray:
    """P(X ≥ k) of a binomial X, with k = ``least``, n = ``runs`` and p = ``chance``.

    It is I_p(k, n - k + 1), the regularised incomplete beta function, and 1 for k ≤ 0. ``least`` and
    ``runs`` have one shape, which is the shape of the result.
    """
    from scipy.special import betainc

    k, n = np.asarray(least), np.asarray(runs)
    tail = betainc(np.clip(k, 1, None), np.clip(n - k + 1, 1, None), chance)
    return np.asarray(np.where(k <= 0, 1.0, np.where(k > n, 0.0, tail)), float)


def clopper_pearson(failures: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Exact confidence interval of a rate (Clopper and Pearson, Biometrika 26, 1934).

    Eq. (M58) of docs/mathematics_methods.md.
    """
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    low = 0.0 if failures == 0 else float(betaincinv(failures, runs - failures + 1, tail))
    high = 1.0 if failures == runs else float(betaincinv(failures + 1, runs - failures, 1 - tail))
    return low, high


def hypergeometric_tail(least: int, total: int, marked: int, drawn: int) -> float:
    """P(X ≥ ``least``) of X marked items among ``drawn`` out of ``total``, of which ``marked`` are marked."""
    from scipy.special import gammaln

    def log_choices(n: int, k: Any) -> Any:
        return gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)

    low, high = max(0, drawn + marked - total), min(drawn, marked)
    if least <= low:
        return 1.0
    k = np.arange(least, high + 1)
    terms = log_choices(marked, k) + log_choices(total - marked, drawn - k) - log_choices(total, drawn)
    return float(min(np.exp(terms).sum(), 1.0))


def paired_difference(first: BoolArray, second: BoolArray) -> tuple[float, float, float]:
    """Failure rate of ``second`` minus rate of ``first`` (N,), with its 95 % interval (low, high).

    Entry i of both is whether flight i, with the same random draws, fails. With b flights that fail only in
    ``second`` and c only in ``first``, this is the interval of Bonett and Price
    (doi:10.3102/1076998611411915), which adds one flight of each kind::

        d = (b - c) / (N + 2),    d ± 1.96 √(((b + 1 + c + 1) / (N + 2) - d²) / (N + 2))

    It is valid whether or not the failures of the two are correlated.

    Eq. (M59) of docs/mathematics_methods.md.
    """
    n, b, c = len(first), int((second & ~first).sum()), int((first & ~second).sum())
    middle, spread = (b - c) / (n + 2), (b + c + 2) / (n + 2)
    half = 1.959964 * math.sqrt(max(spread - middle**2, 0.0) / (n + 2))
    return (b - c) / n, max(middle - half, -1.0), min(middle + half, 1.0)
