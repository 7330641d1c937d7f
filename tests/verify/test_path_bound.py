"""The checker's bound R of one obstacle: runs of steps, each beyond one face, against its definition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from pareto_ltl_verify.gaussians import ON_EDGE, _cheapest_runs


def run_cost(gap: np.ndarray, sd: np.ndarray, grows: np.ndarray, first: int, last: int) -> float:
    """Of the steps ``first`` to ``last`` beyond one face: Σ p, or 2 Φ(-least gap / largest σ)."""
    steps = range(first, last + 1)
    if any(gap[t] < -ON_EDGE for t in steps):
        return math.inf
    union = sum(float(norm.sf(gap[t] / sd[t])) for t in steps if sd[t] > 0)
    if all(grows[r, t] for t in steps for r in range(first, t)) and max(sd[t] for t in steps) > 0:
        once = 2.0 * float(norm.sf(min(gap[t] for t in steps) / max(sd[t] for t in steps)))
        return min(union, once)
    return union


def cheapest(gap: np.ndarray, sd: np.ndarray, grows: np.ndarray) -> float:
    """Of all divisions of the path into runs that share their ends, each beyond any face, the least sum."""
    n, faces = gap.shape
    if n == 1:
        return min(run_cost(gap[:, k], sd[:, k], grows[k], 0, 0) for k in range(faces))
    least = [0.0] + [math.inf] * (n - 1)
    for last in range(1, n):
        for first in range(last):
            for k in range(faces):
                cost = least[first] + run_cost(gap[:, k], sd[:, k], grows[k], first, last)
                least[last] = min(least[last], cost)
    return least[-1]


@pytest.mark.parametrize("growing", [0.0, 0.5, 0.95, 1.0])
@pytest.mark.parametrize("seed", range(15))
def test_the_cheapest_runs_are_those_of_all_divisions(seed: int, growing: float) -> None:
    rng = np.random.default_rng([seed, round(100 * growing)])
    n, faces = int(rng.integers(1, 8)), int(rng.integers(1, 5))
    gap = rng.normal(2.0, 1.5, (n, faces))
    sd = rng.uniform(0.2, 1.5, (n, faces)) * (rng.random((n, faces)) > 0.1)
    grows = rng.random((faces, n, n)) < growing
    plain, found = cheapest(gap, sd, grows), _cheapest_runs(gap, sd, grows)
    if plain < 1.0:  # a division whose beginning alone costs that much is not continued: the bound is 1 then
        assert found == pytest.approx(plain, rel=1e-9)
    else:
        assert found >= 1.0
