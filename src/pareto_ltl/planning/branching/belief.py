"""What a cell of measured positions says: the law of position, wind and own errors of the flights in it.

The measured position y = x + e + ν, ν ~ N(0, r² I), is N(x, S) with S = Σ + r² I. In a cell it has the mean
x + d and the covariance V (:mod:`~pareto_ltl.planning.branching.cells`). Whatever y is, the rest is Gaussian
given y, so that with D = Cov(e, y) = Σ and C = Cov(e, θ)

    E[e | cell] = D S⁻¹ d,         Cov(e | cell) = Σ - D W D',       W = S⁻¹ (S - V) S⁻¹,
    E[θ | cell] = C' S⁻¹ d,        Cov(θ | cell) = I - C' W C,       Cov(e, θ | cell) = C - D W C,

and the same with κ, the robot's own errors, in the place of θ. V = 0 is a position fix, (M67).
"""

from __future__ import annotations

import numpy as np

from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.branching.cells import Cell, Moments, cell_moments
from pareto_ltl.planning.branching.records import BranchFix
from pareto_ltl.planning.conditioning import Fix, Joint, Learnt, joint_at
from pareto_ltl.planning.evaluate import cross_covariance, propagate
from pareto_ltl.planning.problem import Problem, unaided
from pareto_ltl.support.arrays import FloatArray, square_matrices

INSIDE_DRAWS = 200_000  # of positions, for a fix that only a landmark gives
INSIDE_SEED = 20181009


def prior_at(problem: Problem, fix: BranchFix, x: FloatArray) -> Joint:
    """The joint law of position, θ and own errors at the fix of the plan with means ``x`` (T+1, 2) [m]."""
    return joint_at(problem, x, fix.step, [Fix(fix.place, fix.sd, fix.step)])


def measured_moments(fix: BranchFix, cell: Cell, cov: FloatArray) -> Moments:
    """Share of the flights that take the fix, mean (2,) - x and covariance (2, 2) of y in the cell.

    Both are in the plane [m, m²], and ``cov`` (2, 2) is Σ. A fix that only a landmark gives tells that the
    robot is in it: its moments come from a fixed sample of positions in the landmark.
    """
    axes = fix.axes
    if fix.landmark is None:
        S = axes @ (cov + fix.sd**2 * np.eye(2)) @ axes.T
        share, mean, V = cell_moments(cell, np.zeros(2), S)
    else:
        rng = np.random.default_rng(INSIDE_SEED)
        e, noise = rng.standard_normal((2, INSIDE_DRAWS, 2))
        e = e @ np.linalg.cholesky(cov + 1e-9 * np.trace(cov) * np.eye(2)).T
        taken = fix.inside(fix.place + e)
        y = fix.distances(fix.place + e[taken] + fix.sd * noise[taken])
        held = cell.holds(y)
        if held.sum() < 2:
            raise ValueError(f"no position in the landmark lies {cell.words}")
        share, mean, V = float(held.mean()), y[held].mean(axis=0), np.cov(y[held].T)
    return Moments(share, axes.T @ mean, axes.T @ V @ axes)


def learnt_in_cell(prior: Joint, told: Moments, sd: float) -> Learnt:
    """The law of position, θ and own errors of the flights whose measured position lies in a cell.

    ``told`` are the moments of y - x in the cell, ``sd`` [m] of the measurement.

    Eq. (M80) of docs/mathematics_methods.md.
    """
    S = prior.cov + sd**2 * np.eye(2)
    inverse = np.linalg.inv(S)
    value, vector = np.linalg.eigh(S - told.cov)
    # Rows R with R' R = W: what the cell takes off the covariances.
    R = (vector * np.sqrt(np.maximum(value, 0.0))).T @ inverse
    half, factor = R @ prior.cov, np.einsum("rs,scm->rcm", R, prior.cross)
    weight, own = inverse @ told.mean, R @ prior.own
    known = own @ prior.errors.root.T
    after = prior.cov - half.T @ half
    return Learnt(
        mean=prior.mean + prior.cov @ weight,
        cov=0.5 * (after + after.T),
        before=prior.cov,
        theta=np.einsum("rcm,r->cm", prior.cross, weight),
        told=factor,
        distance=np.zeros(0),
        errors=prior.errors.mean + prior.errors.root @ (prior.own.T @ weight),
        errors_cov=prior.errors.root @ prior.errors.root.T - known.T @ known,
        shared=prior.now @ prior.errors.root.T - half.T @ known,
    )


def course_in_cell(problem: Problem, x: FloatArray, fix: BranchFix, told: Moments) -> Flight:
    """The flight along the means ``x`` (T+1, 2) with means and covariances of the flights in the cell.

    From the fix on; before it they belong to all flights. ``x`` are the means without a fix of the
    controls of the plan to the fix, and of the branch from there.

    Eq. (M81) of docs/mathematics_methods.md.
    """
    law = unaided(problem.world.law)
    flight = propagate(problem, x, law)
    assert not hasattr(law, "landmarks")
    across = cross_covariance(law, flight)  # type: ignore[arg-type]
    k = fix.step
    S = across[k, k] + fix.sd**2 * np.eye(2)
    inverse = np.linalg.inv(S)
    W = inverse @ (S - told.cov) @ inverse
    means, cov = x.copy(), square_matrices(flight.cov)
    for t in range(k, len(x)):
        D = across[t, k]
        means[t] = x[t] + D @ inverse @ told.mean
        after = cov[t] - D @ W @ D.T
        cov[t] = 0.5 * (after + after.T)
    return flight._replace(x=means, cov=np.ascontiguousarray(cov.reshape(-1, 4)[:, [0, 1, 3]]))
