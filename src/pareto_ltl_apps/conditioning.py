"""Conditioning on position fixes: the position of a robot on its way, the wind error of its flight, its own.

Under the law of the plan, linear about the means, the deviation e at the time of the plan, the deviations
e_1 ... e_n at the fixes and the coefficients θ of the field, or κ of the robot's own errors in its place, are
jointly Gaussian. Fixes y_i = x_i + e_i +
ν_i, ν_i ~ N(0, r_i² I), give with d = (y_i - x_i), S = Cov(e_i, e_j) + diag(r_i² I) = L L', D = Cov(e, e_i)
and C = Cov(e_i, θ)

    E[e | y] = D S⁻¹ d,        Cov(e | y) = Σ - D S⁻¹ D',
    E[θ | y] = C' S⁻¹ d,       Cov(θ | y) = I - B' B,    B = L⁻¹ C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.extend import Problem, cross_covariance, evaluate
from pareto_ltl.support.arrays import FloatArray, square_matrices

if TYPE_CHECKING:
    from pareto_ltl.extend import Flight, RobotErrors


ROUNDING = 1e-12  # share of a variance below which the variance of a fix is lost by rounding


@dataclass(frozen=True, slots=True)
class Fix:
    """A measured position.

    Attributes
    ----------
    place : (2,) float
        Position in the plane [m].
    sd : float
        Standard deviation of its error in each direction [m].
    step : int
        Step of the plan at which it was measured.
    """

    place: FloatArray
    sd: float
    step: int


@dataclass(frozen=True, slots=True)
class Joint:
    """Covariances of the deviations at n fixes, and of the position and θ at the time of the plan.

    Attributes
    ----------
    mean : (2,) float, cov : (2, 2) float
        Law of the position at the time of the plan before the fixes [m, m²].
    among : (2n, 2n) float, to : (2, 2n) float
        Covariances of the deviations at the fixes, and of the one at the time of the plan with them [m²].
    cross : (2n, 2, P) float
        Cov(e_i, θ) with θ at the time of the plan, by row and component of the wind.
    own : (2n, Q) float, now : (2, Q) float
        Cov(e_i, κ) and Cov(e, κ) with the coefficients κ of the robot's own errors, which do not change.
    errors : RobotErrors
        Law of the robot's own errors before the fixes.
    """

    mean: FloatArray
    cov: FloatArray
    among: FloatArray
    to: FloatArray
    cross: FloatArray
    own: FloatArray
    now: FloatArray
    errors: RobotErrors

    @classmethod
    def at(cls, problem: Problem, x: FloatArray, step: int, fixes: Sequence[Fix]) -> Joint:
        """The covariances of the deviations at ``fixes``, and of position, θ and own errors at ``step``.

        If the plan counted on fixes at landmarks, the positions that they measured are not known here: the
        prior of θ stays N(0, I). One fix at ``step`` itself uses the covariance that the plan expects; more
        fixes, or earlier ones, use the covariance of a flight without landmarks.
        """
        at = [fix.step for fix in fixes]
        alone = at == [step]
        flight = evaluate(problem if alone else problem.without_fixes(), x=x[: step + 1])
        cov = square_matrices(flight.cov)
        cross = np.concatenate([_theta_at(problem, flight, t, step) for t in at])
        now, errors = flight.errors.cross[step], flight.errors.law
        if alone:
            return cls(x[step], cov[step], cov[step], cov[step], cross, now, now, errors)
        across = _across_time(problem, flight)
        among = np.block([[across[t, s] if t >= s else across[s, t].T for s in at] for t in at])
        to = np.hstack([across[step, t] for t in at])
        own = np.concatenate([flight.errors.cross[t] for t in at])
        return cls(x[step], cov[step], among, to, cross, own, now, errors)


@dataclass(frozen=True, slots=True)
class Learnt:
    """Distribution of the position and of the wind coefficients θ after fixes.

    Attributes
    ----------
    mean : (2,) float, cov : (2, 2) float
        Mean and covariance of the position after the fixes [m, m²].
    before : (2, 2) float
        Covariance before the fixes [m²].
    theta : (2, P) float
        E[θ | y], by component of the wind.
    told : (2n, 2, P) float
        B, by row and component of the wind; Cov(θ | y) = I - B' B.
    distance : (n,) float
        Distance of each fix from its mean given the fixes before, in standard deviations: ‖z_i‖ for the two
        components i of z = L⁻¹ d. Under the law, P(‖z_i‖ > r) = exp(-r²/2).
    errors : (Q,) float, errors_cov : (Q, Q) float
        Mean and covariance of the robot's own errors after the fixes, as in
        :class:`~pareto_ltl.extend.RobotErrors`; Q = 0 for a robot without errors.
    shared : (2, Q) float
        Covariance of the position and these errors after the fixes.
    """

    mean: FloatArray
    cov: FloatArray
    before: FloatArray
    theta: FloatArray
    told: FloatArray
    distance: FloatArray
    errors: FloatArray
    errors_cov: FloatArray
    shared: FloatArray

    @classmethod
    def at(cls, problem: Problem, x: FloatArray, step: int, fixes: Sequence[Fix] = ()) -> Learnt:
        """What ``fixes`` until ``step`` of the means ``x`` (T+1, 2) [m] say, under the law of the plan.

        Without fixes the position that the law expects, which is not conditioned.
        """
        if fixes:
            return learn(Joint.at(problem, x, step, fixes), x[[fix.step for fix in fixes]], fixes)
        flight = evaluate(problem, x=x[: step + 1])
        cov = square_matrices(flight.cov)[step]
        modes, own = problem.modes.psi.shape[-1], flight.errors.law
        return cls(
            x[step], cov, cov, np.zeros((2, modes)), np.zeros((0, 2, modes)), np.zeros(0), own.mean,
            own.root @ own.root.T, flight.errors.cross[step] @ own.root.T,
        )  # fmt: skip

    def at_place(self, place: FloatArray, sd: float) -> Learnt:
        """The same for a robot at ``place`` (2,) [m], with an independent error ``sd`` [m]."""
        return replace(self, mean=place, cov=sd**2 * np.eye(2), shared=np.zeros_like(self.shared))

    def start_of(self, problem: Problem) -> Problem:
        """``problem``, which begins at ``mean``, with the law of that position and of the own errors."""
        return problem.with_start(self.cov, self.errors, self.errors_cov, self.shared)

    @property
    def sd(self) -> float:
        """Largest standard deviation of the position [m]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.cov)[-1], 0.0)))

    @property
    def sd_apart(self) -> float:
        """The largest standard deviation of the position [m] if the robot's own errors were known."""
        if not len(self.errors):
            return self.sd
        known = self.shared @ np.linalg.pinv(self.errors_cov, rcond=1e-12, hermitian=True) @ self.shared.T
        return float(np.sqrt(max(np.linalg.eigvalsh(self.cov - known)[-1], 0.0)))

    @property
    def sd_before(self) -> float:
        """Smallest standard deviation of the position before the fixes [m]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.before)[0], 0.0)))


def learn(prior: Joint, means: FloatArray, fixes: Sequence[Fix]) -> Learnt:
    """Condition position, θ and the robot's own errors on ``fixes``.

    ``means`` (n, 2) [m] are the expected positions there.

    Eq. (M67) of docs/mathematics_methods.md.
    """
    error = np.repeat([fix.sd**2 for fix in fixes], 2)
    S = prior.among + np.diag(np.maximum(error, ROUNDING * np.diag(prior.among)))
    L = np.linalg.cholesky(S)
    d = (np.array([fix.place for fix in fixes]) - means).ravel()
    z = np.linalg.solve(L, d)
    factor = np.linalg.solve(L, prior.cross.reshape(len(d), -1)).reshape(prior.cross.shape)
    half = np.linalg.solve(L, prior.to.T)  # (2n, 2)
    after, own = prior.cov - half.T @ half, np.linalg.solve(L, prior.own)
    known = own @ prior.errors.root.T
    return Learnt(
        prior.mean + half.T @ z, 0.5 * (after + after.T), prior.cov, np.einsum("rcm,r->cm", factor, z),
        factor,
        np.linalg.norm(z.reshape(-1, 2), axis=1),
        prior.errors.mean + known.T @ z, prior.errors.root @ prior.errors.root.T - known.T @ known,
        prior.now @ prior.errors.root.T - half.T @ known,
    )  # fmt: skip


def _across_time(problem: Problem, flight: Flight) -> FloatArray:
    """Cov(e_t, e_s) for s <= t, (T+1, T+1, 2, 2)."""
    if flight.memory is not None:
        return cross_covariance(problem.coherent, flight)
    cov = square_matrices(flight.cov)
    across = np.zeros((len(cov), len(cov), 2, 2))
    for s in range(len(cov)):
        across[s, s] = cov[s]
        for t in range(s, len(cov) - 1):
            across[t + 1, s] = flight.F[t] @ across[t, s]
    return across


def _theta_at(problem: Problem, flight: Flight, t: int, step: int) -> FloatArray:
    """Cov(e_t, θ) (2, 2, P) with θ of ``step``, a later one."""
    if flight.memory is None or t == 0:  # under the independent law there is no memory
        return np.zeros((2, 2, flight.psi.shape[-1]))
    faded = problem.modes.kept[t + 1 : step + 1].astype(float).prod(axis=0)
    return np.asarray(flight.memory.theta[t - 1] * faded, float)
