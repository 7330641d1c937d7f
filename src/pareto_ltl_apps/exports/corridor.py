"""Corridors that hold the position at a time, or whole flights, with a given probability.

Both are ellipses around the expected positions. Their shape follows the plan's covariance, and their size
comes from simulated flights. Of n flights, the k-th smallest size with k = ceil((n + 1) p) holds a fresh
flight with a probability of at least p (order statistics of exchangeable draws; Vovk, Gammerman and Shafer,
2005).

- At a time: at each single step, share p of all flights are inside its ellipse.
- Of whole flights: share p of all flights are inside the ellipse of every step, and, since they fly straight
  from step to step, never leave the convex hull of the ellipses at both ends of a leg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.extend import PlannedPath, Problem, simulate_flights
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.ellipses import ellipse_outlines

SHARES = (0.5, 0.9, 0.95, 0.99)
FINEST = 1.0  # [m] added (as a variance) so that a position known exactly has an ellipse too
CORNERS = 36  # corners of the polygon around an ellipse, which is 0.4 % wider


@dataclass(frozen=True, slots=True)
class Corridor:
    """Sizes of the ellipses of a plan of T steps, in standard deviations of ``cov``.

    Attributes
    ----------
    law : str
        Wind law of the flights.
    runs : int
        Number of flights from which the sizes are computed.
    shares : (L,) float
        The probabilities p.
    mean : (T+1, 2) float, cov : (T+1, 2, 2) float
        Expected positions [m] and their covariances [m²], of 1 m² at least.
    at_time : (L, T+1) float
        Sizes at each single step.
    whole : (L,) float
        Sizes for whole flights.
    """

    law: str
    runs: int
    shares: FloatArray
    mean: FloatArray
    cov: FloatArray
    at_time: FloatArray
    whole: FloatArray

    def outlines(self, scale: FloatArray) -> FloatArray:
        """Polygons (..., T+1, CORNERS, 2) [m] around the ellipses of sizes ``scale`` (..., T+1)."""
        return ellipse_outlines(self.mean, self.cov, scale, CORNERS)

    def level(self, share: float) -> int:
        """The index of ``share`` in ``shares``."""
        return int(np.flatnonzero(self.shares == share)[0])


def flown_corridor(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> Corridor:
    """The corridors of ``path`` from ``runs`` flights in the wind law that it was planned in."""
    law = problem.fidelity.law
    flown = simulate_flights(problem, path.u, runs, law, seed, path.x)
    cov = path.cov + FINEST**2 * np.eye(2)
    sizes = ellipse_sizes(flown.x, path.x, cov)
    shares = np.array(SHARES)
    return Corridor(
        law=law,
        runs=runs,
        shares=shares,
        mean=path.x,
        cov=cov,
        at_time=np.maximum(held_sizes(sizes, shares), 1.0),
        whole=np.maximum(held_sizes(sizes.max(axis=1), shares), 1.0),
    )


def ellipse_sizes(x: FloatArray, mean: FloatArray, cov: FloatArray) -> FloatArray:
    """Sizes (n, T+1) of the ellipses on which the positions ``x`` (n, T+1, 2) lie::

    s² = (x - x^)' Σ⁻¹ (x - x^)
    """
    whiten = np.linalg.inv(np.linalg.cholesky(cov))  # lower triangles: four products instead of einsum
    east, north = x[..., 0] - mean[:, 0], x[..., 1] - mean[:, 1]
    return np.asarray(
        np.hypot(whiten[:, 0, 0] * east, whiten[:, 1, 0] * east + whiten[:, 1, 1] * north), float
    )


def held_sizes(sizes: FloatArray, shares: FloatArray) -> FloatArray:
    """Sizes (L, ...) that hold a fresh flight with each of ``shares`` (L,), from ``sizes`` (n, ...) of n.

    Eq. (M61) of docs/mathematics_methods.md.
    """
    n = len(sizes)
    rank = [min(math.ceil((n + 1) * share - 1e-9), n) - 1 for share in shares]
    return np.asarray(np.sort(sizes, axis=0)[rank], float)
