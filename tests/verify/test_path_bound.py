"""The checker's bound R of one obstacle: runs of steps, each beyond one face, against its definition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from pareto_ltl_verify.gaussians import ON_EDGE, _cheapest_runs, segment_risks
from pareto_ltl_verify.geometry import beyond_bounds, convex


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


@pytest.mark.parametrize(("west", "counted"), [(-10.0, 1), (3.0, 2)])
def test_a_border_behind_the_line_of_an_obstacle_adds_nothing_to_a_segment(west: float, counted: int) -> None:
    """An obstacle along the northern border hides it if no line past its end comes nearer."""
    km = 1e3
    walls = beyond_bounds(km * np.array([[-10.0, -10.0], [10.0, 10.0]]))
    strip = convex([(km * a, km * b) for a, b in ((west, 8.0), (10.0, 8.0), (10.0, 10.0), (west, 10.0))])
    x, cov = (
        km * np.array([[-1.0, 5.0], [1.0, 5.0]]),
        km**2 * np.repeat(np.diag([0.04, 1.0])[None], 2, axis=0),
    )
    z, risks = segment_risks((*walls, strip), x, cov)
    assert z[0, 3] == pytest.approx(5.0, rel=1e-6)  # the northern border
    near, border = float(norm.sf(z[0, 4])), float(norm.sf(5.0))
    assert z[0, 4] == pytest.approx(3.0, rel=1e-3) if counted == 1 else z[0, 4] > 4.0
    assert risks[0] == pytest.approx(near + (counted - 1) * border, rel=1e-4)
