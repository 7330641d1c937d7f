"""What a cell of measured positions says: the law of position, wind and own errors of the flights in it.

The measured position y = x + e + ν, ν ~ N(0, r² I), is N(x, S) with S = Σ + r² I. In a cell it has the mean
x + d and the covariance V (:mod:`~pareto_ltl_apps.branching.moments`). Whatever y is, the rest is Gaussian
given y, so that with D = Cov(e, y) = Σ and C = Cov(y, θ)

    E[e | cell] = D S⁻¹ d,         Cov(e | cell) = Σ - D W D',       W = S⁻¹ (S - V) S⁻¹,
    E[θ | cell] = C' S⁻¹ d,        Cov(θ | cell) = I - C' W C,       Cov(e, θ | cell) = Cov(e, θ) - D W C,

and the same with κ, the robot's own errors, in the place of θ. V = 0 is a position fix, (M67). Of two fixes y
is the vector of both measured positions, and a cell is a cell at each.

If the robot flies off y - p, p the planned position at the fix, in the n steps after it, then

    e' = e - G (y - p),    G_t = Σ_s F_{t-1} ... F_{s+1} g_s    over the steps s before t,

with g = 1/n in these n steps; γ dt is added to g from the fix on if it counters the drift at the rate γ, as
long as its airspeeds allow it. Cells at a second fix hold positions measured after that. Moments ``told``
are always of y as it would be without: y - x of the second fix is less by G (y - p) of the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pareto_ltl.extend import (
    BranchFix,
    Cell,
    Problem,
    cross_covariance,
    evaluate,
)
from pareto_ltl.support.arrays import FloatArray, square_matrices
from pareto_ltl_apps.branching.moments import Moments, cell_moments
from pareto_ltl_apps.conditioning import Fix, Joint, Learnt

if TYPE_CHECKING:
    from pareto_ltl.extend import Flight

INSIDE_DRAWS = 200_000  # of positions, for a fix that only a landmark gives
BOTH_DRAWS = 1_000_000  # of pairs of positions, for cells at two fixes
INSIDE_SEED = 20181009


class Passed(NamedTuple):
    """A fix, and the cell that the position measured there lies in."""

    fix: BranchFix
    cell: Cell


def prior_at(problem: Problem, passed: Sequence[Passed], x: FloatArray) -> Joint:
    """The joint law of position, θ and own errors at the last fix, of the means ``x`` (T+1, 2) [m]."""
    fixes = [Fix(fix.place, fix.sd, fix.step) for fix, _ in passed]
    return Joint.at(problem, x, fixes[-1].step, fixes)


def measured_moments(
    passed: Sequence[Passed], among: FloatArray, means: FloatArray, back: FloatArray | None = None
) -> Moments:
    """What the cells at n fixes say of y - x, the measured positions about their means.

    The share is the one of the last cell, of the flights that are in the cells before it and take the fix;
    mean (2n,) and covariance (2n, 2n) are in the plane [m, m²]. ``among`` (2n, 2n) [m²] is Cov(e), and
    ``means`` (n, 2) [m] are the expected positions of all flights of these controls. One fix that can be
    taken anywhere has the moments of (M79), others have moments of a fixed sample: a fix that only
    a landmark gives tells that the robot is in it. ``back`` (n, n, 2, 2): G at fix n of what was measured at
    an earlier one.
    """
    if len(passed) == 1 and passed[0].fix.landmark is None:
        (fix, cell), axes = passed[0], passed[0].fix.axes
        S = axes @ (among + fix.sd**2 * np.eye(2)) @ axes.T
        share, mean, V = cell_moments(cell, axes @ (means[0] - fix.place), S)
        return Moments(share, axes.T @ mean - (means[0] - fix.place), axes.T @ V @ axes)
    rng = np.random.default_rng(INSIDE_SEED)
    draws = INSIDE_DRAWS if len(passed) == 1 else BOTH_DRAWS
    shape = (draws, len(passed), 2)
    root = np.linalg.cholesky(among + 1e-9 * np.trace(among) * np.eye(len(among)))
    off = (rng.standard_normal((draws, len(among))) @ root.T).reshape(shape)
    held = taken = np.ones(draws, bool)
    flown_off = np.zeros(shape)
    for n, (fix, cell) in enumerate(passed):
        there = means[n] + off[:, n] - flown_off[:, n]
        off[:, n] += fix.sd * rng.standard_normal((draws, 2))
        y = means[n] + off[:, n] - flown_off[:, n]
        taken = held & fix.inside(there)
        held = taken & cell.holds(fix.distances(y))
        if back is not None:
            for later in range(n + 1, len(passed)):
                flown_off[:, later] += (y - fix.place) @ back[later, n].T
    if held.sum() < 2:
        raise ValueError(f"no position that can be measured lies {passed[-1].cell.words}")
    y = off[held].reshape(-1, len(among))
    return Moments(float(held.sum() / taken.sum()), y.mean(axis=0), np.cov(y.T))


def noise_of(passed: Sequence[Passed]) -> FloatArray:
    """The covariance (2n, 2n) [m²] of the errors of the measured positions."""
    return np.diag(np.repeat([fix.sd**2 for fix, _ in passed], 2))


def learnt_in_cell(prior: Joint, told: Moments, noise: FloatArray) -> Learnt:
    """The law of position, θ and own errors of the flights whose measured positions lie in cells.

    ``told`` are the moments of y - x in the cells, ``noise`` (2n, 2n) [m²] is the covariance of the errors
    of y.

    Eq. (M80) of docs/mathematics_methods.md.
    """
    S = prior.among + noise
    inverse = np.linalg.inv(S)
    value, vector = np.linalg.eigh(S - told.cov)
    # Rows R with R' R = W: what the cell takes off the covariances.
    R = (vector * np.sqrt(np.maximum(value, 0.0))).T @ inverse
    half, factor = R @ prior.to.T, np.einsum("rs,scm->rcm", R, prior.cross)
    weight, own = inverse @ told.mean, R @ prior.own
    known = own @ prior.errors.root.T
    after = prior.cov - half.T @ half
    return Learnt(
        mean=prior.mean + prior.to @ weight,
        cov=0.5 * (after + after.T),
        before=prior.cov,
        theta=np.einsum("rcm,r->cm", prior.cross, weight),
        told=factor,
        distance=np.zeros(0),
        errors=prior.errors.mean + prior.errors.root @ (prior.own.T @ weight),
        errors_cov=prior.errors.root @ prior.errors.root.T - known.T @ known,
        shared=prior.now @ prior.errors.root.T - half.T @ known,
    )


@dataclass(frozen=True, slots=True)
class Course:
    """The flights of one set of controls: means and covariances of all, and covariances over time."""

    flight: Flight
    across: FloatArray
    dt: float

    @classmethod
    def of(cls, problem: Problem, x: FloatArray) -> Course:
        """The flights whose means are ``x`` (T+1, 2) [m], without a fix."""
        flight = evaluate(problem, x=x)
        return cls(flight, cross_covariance(problem.coherent, flight), problem.motion.dt)

    def between(self, steps: Sequence[int], others: Sequence[int]) -> FloatArray:
        """Cov(e_t, e_s) for t in ``steps`` and s in ``others``, (2n, 2m) [m²]."""
        return np.block(
            [[self.across[t, s] if t >= s else self.across[s, t].T for s in others] for t in steps]
        )

    def told(self, passed: Sequence[Passed]) -> Moments:
        """The moments of the measured positions in the cells ``passed``."""
        steps = [fix.step for fix, _ in passed]
        between, back = self.between(steps, steps), None
        if any(fix.rejoin for fix, _ in passed):
            back = np.array([self.back(passed)[:, step] for step in steps])
        return measured_moments(passed, between, self.flight.x[steps], back)

    def back(self, passed: Sequence[Passed]) -> FloatArray:
        """G (n, T+1, 2, 2) of each fix: the share of what it measures that is flown off at each step."""
        F, steps = self.flight.F, [fix.step for fix, _ in passed]
        found = np.zeros((len(passed), len(self.flight.x), 2, 2))
        for n, (fix, _) in enumerate(passed):
            until = min([len(F), *steps[n + 1 :]])  # a later fix replaces it
            rate = np.zeros(len(F))
            rate[fix.step : until] = fix.counter * self.dt
            rate[fix.step : min(fix.step + fix.rejoin, until)] += 1.0 / max(fix.rejoin, 1)
            for t in range(fix.step, len(F)):
                found[n, t + 1] = F[t] @ found[n, t] + rate[t] * np.eye(2)
        return found

    def given(self, passed: Sequence[Passed], told: Moments) -> Flight:
        """The flight with means and covariances of the flights in the cells, from the last fix on.

        Before it they belong to all flights.

        Eq. (M81) of docs/mathematics_methods.md.
        """
        steps, x = [fix.step for fix, _ in passed], self.flight.x
        S = self.between(steps, steps) + noise_of(passed)
        inverse = np.linalg.inv(S)
        W = inverse @ (S - told.cov) @ inverse
        means, cov = x.copy(), square_matrices(self.flight.cov)
        off, place = self._flown_off(passed) if any(fix.rejoin for fix, _ in passed) else (None, told.mean)
        for t in range(steps[-1], len(x)):
            D = self.between([t], steps)
            means[t] = x[t] + D @ inverse @ told.mean
            after = cov[t] - D @ W @ D.T
            if off is not None:
                means[t] -= off[t] @ (told.mean - place)
                mixed = off[t] @ told.cov @ inverse @ D.T
                after += off[t] @ told.cov @ off[t].T - mixed - mixed.T
            cov[t] = 0.5 * (after + after.T)
        packed = np.ascontiguousarray(cov.reshape(-1, 4)[:, [0, 1, 3]])
        return self.flight._replace(x=means, cov=packed)

    def _flown_off(self, passed: Sequence[Passed]) -> tuple[FloatArray, FloatArray]:
        """H (T+1, 2, 2n) and r (2n,) [m]: H (a - r) is flown off, with a = y - x as it would be without.

        H (a - r) = Σ_i G_i (y_i - p_i), where y_i is less by what earlier fixes have flown off.
        """
        G, n = self.back(passed), len(passed)
        steps = [fix.step for fix, _ in passed]
        place = np.concatenate([fix.place - self.flight.x[fix.step] for fix, _ in passed])
        # y_i - p_i = Σ_j M_ij (a - place)_j, with M_i = 1_i - Σ_{j<i} G_j(k_i) M_j
        M = np.eye(2 * n)
        for i in range(n):
            for j in range(i):
                M[2 * i : 2 * i + 2] -= G[j, steps[i]] @ M[2 * j : 2 * j + 2]
        H = np.concatenate(list(G), axis=-1) @ M
        return H, place
