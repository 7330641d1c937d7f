"""Chances of counts. ``scipy.stats`` has them too, and half a second of its import is felt in every run."""

from __future__ import annotations

from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray


def binomial_tail(least: IntArray | int, runs: IntArray | int, chance: float) -> FloatArray:
    """P(X ≥ ``least``) of X out of ``runs`` with ``chance`` each: I_p(k, n - k + 1), 1 for k ≤ 0.

    Arguments of one shape, which is that of the result.
    """
    from scipy.special import betainc

    k, n = np.asarray(least), np.asarray(runs)
    tail = betainc(np.clip(k, 1, None), np.clip(n - k + 1, 1, None), chance)
    return np.asarray(np.where(k <= 0, 1.0, np.where(k > n, 0.0, tail)), float)


def hypergeometric_tail(least: int, total: int, marked: int, drawn: int) -> float:
    """P(X ≥ ``least``) where ``drawn`` of ``total`` are drawn and ``marked`` of them are marked."""
    from scipy.special import gammaln

    def log_choices(n: int, k: Any) -> Any:
        return gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)

    low, high = max(0, drawn + marked - total), min(drawn, marked)
    if least <= low:
        return 1.0
    k = np.arange(least, high + 1)
    terms = log_choices(marked, k) + log_choices(total - marked, drawn - k) - log_choices(total, drawn)
    return float(min(np.exp(terms).sum(), 1.0))
