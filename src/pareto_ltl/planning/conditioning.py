"""Conditioning on a position fix: the position of a robot on its way, and the wind error of its flight.

Under the law of the plan, linear about the means, the deviation e at the fix and the coefficients θ of the
field are jointly Gaussian with Σ = Cov(e), C = Cov(e, θ), θ ~ N(0, I). A fix y = x + e + ν, ν ~ N(0, r² I),
gives with d = y - x and S = Σ + r² I

    E[e | y] = Σ S⁻¹ d,        Cov(e | y) = Σ - Σ S⁻¹ Σ,
    E[θ | y] = C' S⁻¹ d,       Cov(θ | y) = I - B' B,    B = L⁻¹ C,  L L' = S.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Fix:
    """A measured position.

    Attributes
    ----------
    place : (2,) float
        In the plane [m].
    sd : float
        Standard deviation of its error in each direction [m].
    """

    place: FloatArray
    sd: float


@dataclass(frozen=True, slots=True)
class Learnt:
    """Distribution of the position and of the wind coefficients θ after a fix.

    Attributes
    ----------
    mean : (2,) float, cov : (2, 2) float
        Mean and covariance of the position after the fix [m, m²].
    before : (2, 2) float
        Covariance before the fix [m²].
    theta : (2, P) float
        E[θ | y], by component of the wind.
    told : (2, 2, P) float
        B, by row and component of the wind; Cov(θ | y) = I - B' B.
    """

    mean: FloatArray
    cov: FloatArray
    before: FloatArray
    theta: FloatArray
    told: FloatArray

    @property
    def sd(self) -> float:
        """Largest standard deviation of the position [m]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.cov)[-1], 0.0)))

    @property
    def sd_before(self) -> float:
        """Smallest standard deviation of the position before the fix [m]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.before)[0], 0.0)))


def learn(x: FloatArray, cov: FloatArray, cross: FloatArray, fix: Fix) -> Learnt:
    """Condition a deviation with covariance ``cov`` (2, 2) about ``x`` (2,) and θ on ``fix``.

    ``cross`` (2, 2, P) = Cov(e, θ), by row of e and component of the wind.

    Eq. (M67) of docs/mathematics_methods.md.
    """
    S = cov + fix.sd**2 * np.eye(2)
    L = np.linalg.cholesky(S)
    d = fix.place - x
    gain = np.linalg.solve(S, cov).T
    told = np.linalg.solve(L, cross.reshape(2, -1)).reshape(cross.shape)
    theta = np.einsum("rcm,r->cm", cross, np.linalg.solve(S, d))
    after = cov - gain @ cov
    return Learnt(x + gain @ d, 0.5 * (after + after.T), cov, theta, told)


def learn_at(problem: Problem, x: FloatArray, step: int, fix: Fix | None) -> Learnt:
    """Condition on ``fix`` at ``step`` of the means ``x`` (T+1, 2) [m], under the law of the plan.

    Without a fix it is what is known before one.

    If the plan counted on earlier fixes, the positions that they measured are not known here: the prior of θ
    stays N(0, I), and C covers only the errors that these fixes left. Both understate what the fix reveals.
    """
    flight = propagate(problem, x)
    xx, xy, yy = flight.cov[step]
    cov = np.array([[xx, xy], [xy, yy]], float)
    modes = problem.modes.psi.shape[-1]
    known = step > 0 and flight.memory is not None
    cross = flight.memory.theta[step - 1].astype(float) if known else np.zeros((2, 2, modes))
    if fix is None:
        return Learnt(x[step], cov, cov, np.zeros((2, modes)), np.zeros((2, 2, modes)))
    return learn(x[step], cov, cross, fix)


def likely_histories(x: FloatArray, fix: Fix, noise: FloatArray) -> FloatArray:
    """Samples of flights given a fix at their last position, from flights ``x`` (n, k+1, 2) [m] without it.

    Matheron's rule with the covariances of the flights: x + Cov(x_t, x_k) S⁻¹ (y + ν - x_k); ``noise``
    (n, 2) ~ N(0, 1).

    Eq. (M69) of docs/mathematics_methods.md.
    """
    off = x - x.mean(axis=0)
    cross = np.einsum("nti,nj->tij", off, off[:, -1]) / max(len(x) - 1, 1)
    S = cross[-1] + fix.sd**2 * np.eye(2)
    if np.linalg.det(S) <= 0.0:
        return x
    gap = fix.place + fix.sd * noise - x[:, -1]
    return np.asarray(x + np.einsum("tij,nj->nti", cross, np.linalg.solve(S, gap.T).T), float)


def states_reached(problem: Problem, x: FloatArray) -> IntArray:
    """Automaton state of each flight ``x`` (n, k+1, 2) after its last step, (n,)."""
    return np.array([problem.states(flight)[-1] for flight in x], np.int64)
