"""The ways in which flights of a plan fail, as half-spaces of their deviations.

Deviations are e = M z with z ~ N(0, I) in the law linearised about the plan, so that a half-space of them has
the probability Φ(-τ). Where a flight fails, one event binds its margin (:mod:`pareto_ltl.kernels.margin`): a
point of the flight lies on the wrong side of a line. All deviations for which it does are a half-space H.

1. Common flights are flown with deviations enlarged until they fail; those that fail first give the events.
2. H can be far too large: a flight that misses a region at one step may visit it at another. If the flight at
   the centre of mass of H succeeds, a flight in H fails only if its event there fails as well. So H is
   replaced by the half-space that contains the intersection of both and touches it at its point nearest to
   the origin. This ends at a half-space whose centre fails: it touches failures near their most likely point,
   the dominating point of Sadowsky and Bucklew, IEEE Trans. Inf. Theory 36 (1990), doi:10.1109/18.54903.
3. Of half-spaces that are nearly parallel, the most likely one is retained.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtr

from pareto_ltl.kernels.margin import Slope, smoothed_failure
from pareto_ltl.planning.margin_model import margin_model, margin_scratch
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray

PILOTS = 500  # common flights whose events are looked for
ENLARGED = np.arange(1.0, 6.1, 0.5)  # factors of their deviations
MOST_EVENTS = 200  # events that are examined
FAR = 9.0  # standard deviations: a half-space farther away is left out, its probability is 1e-19
MOST_STEPS = 8  # replacements of one half-space
ALIKE = 0.95  # correlation of half-spaces that count as parallel
KEPT = 1.0 - 1e-6  # share of the sum of probabilities that is retained


@dataclass(frozen=True, slots=True)
class FailureModes:
    """Half-spaces Σ_t ``weight[j, t]``' e_t >= ``threshold[j]`` near the failures of a plan.

    Attributes
    ----------
    weight : (J, T+1, 2) float
        Scaled so that the sum has the variance 1 [1/m].
    threshold : (J,) float
        Distances in standard deviations, positive.
    """

    weight: FloatArray
    threshold: FloatArray

    def __len__(self) -> int:
        return len(self.threshold)

    @property
    def union_bound(self) -> float:
        """Σ_j Φ(-τ_j), which the probability of their union does not exceed."""
        return float(ndtr(-self.threshold).sum())


@dataclass(frozen=True, slots=True)
class HalfSpace:
    """``weight``' e >= ``threshold`` for the deviations e (2 (T+1),) of all steps, of variance 1."""

    weight: FloatArray
    threshold: float


def find_failure_modes(problem: Problem, mean: FloatArray, spread: FloatArray) -> FailureModes:
    """Half-spaces near the failures of flights about ``mean`` (T+1, 2) [m]; none if ``mean`` itself fails.

    Deviations of all steps are ``spread`` (2 (T+1), D) [m] times D independent standard normal numbers.
    """
    cov, margins = spread @ spread.T, Margins(problem, mean, math.sqrt(np.square(spread).sum(axis=1).max()))
    none = FailureModes(np.empty((0, *mean.shape)), np.empty(0))
    if margins.width == 0.0 or margins.of(np.zeros((1, mean.size)))[0] <= 0.0:
        return none
    found = [nearest_failures(margins, cov, e) for e in first_failures(margins, spread)]
    spaces = sorted((space for space in found if space is not None), key=lambda space: space.threshold)
    if not spaces:
        return none
    weight = np.array([space.weight for space in spaces])
    alike, retained = weight @ cov @ weight.T > ALIKE, np.zeros(len(spaces), bool)
    for j in range(len(spaces)):
        retained[j] = not (alike[j] & retained).any()
    threshold = np.array([space.threshold for space in spaces])[retained]
    chance = np.cumsum(ndtr(-threshold))
    count = int(np.searchsorted(chance, KEPT * chance[-1])) + 1
    return FailureModes(weight[retained][:count].reshape(-1, *mean.shape), threshold[:count])


class Margins:
    """Margins of flights near a plan, and the half-spaces beyond the events that bind them."""

    def __init__(self, problem: Problem, mean: FloatArray, width: float) -> None:
        self.model, self.mean, self.width = margin_model(problem), mean, width

    def of(self, e: FloatArray) -> FloatArray:
        """Margins (n,) [m] of the flights with deviations ``e`` (n, 2 (T+1)) [m]."""
        return self._evaluated(e)[0]

    def event(self, e: FloatArray) -> tuple[FloatArray, float]:
        """a (2 (T+1),) and b [m]: deviations near ``e`` (2 (T+1),) fail for a' e >= b by the same event."""
        (margin,), gradient = self._evaluated(e[None])
        share = 1.0 / (1.0 + math.exp(margin / self.width))
        a = gradient.ravel() * self.width / (share * (1.0 - share))
        return a, float(margin + a @ e)

    def _evaluated(self, e: FloatArray) -> tuple[FloatArray, FloatArray]:
        off = np.ascontiguousarray(e.reshape(len(e), *self.mean.shape).transpose(1, 2, 0))
        slope = Slope(np.zeros(self.mean.shape), np.zeros((len(self.mean), 3)))
        scratch = margin_scratch(self.model, len(e), len(self.mean))
        smoothed_failure(self.model, self.mean, off, self.width, slope, scratch)
        return scratch.margins, slope.gradient


def first_failures(margins: Margins, spread: FloatArray) -> FloatArray:
    """Deviations (n, 2 (T+1)) [m] of common flights, enlarged until they fail; the least enlarged first."""
    e = np.random.default_rng(0).standard_normal((PILOTS, spread.shape[1])) @ spread.T
    found = [np.empty((0, e.shape[1]))]
    for factor in ENLARGED:
        failed = margins.of(factor * e) <= 0.0
        found.append(factor * e[failed])
        e = e[~failed]
        if len(e) == 0:
            break
    return np.concatenate(found)[:MOST_EVENTS]


def nearest_failures(margins: Margins, cov: FloatArray, e: FloatArray) -> HalfSpace | None:
    """The half-space at the nearest failures by the events of the failed flight ``e``, None if there is none.

    ``cov`` (2 (T+1), 2 (T+1)) is the covariance of deviations [m²].
    """
    space: HalfSpace | None = None
    for _ in range(MOST_STEPS):
        a, b = margins.event(e)
        sd = math.sqrt(a @ cov @ a)
        if sd == 0.0:
            break
        event = HalfSpace(a / sd, b / sd)
        space = event if space is None else touching(space, event, cov)
        if not 0.0 < space.threshold < FAR:
            return None
        e = mean_beyond(space.threshold) * (cov @ space.weight)
        if margins.of(e[None])[0] <= 0.0:
            break
    return space


def touching(first: HalfSpace, second: HalfSpace, cov: FloatArray) -> HalfSpace:
    """The half-space that contains the intersection of two and touches it at its point nearest to the origin.

    With c = ω₀' ω_k, the nearest point is the one of a single half-space if it lies in the other, c τ₀ >= τ_k
    or c τ_k >= τ₀; else both are tight, and

        z* = [(τ₀ - c τ_k) ω₀ + (τ_k - c τ₀) ω_k] / (1 - c²).

    The threshold of opposite half-spaces, which do not intersect, is infinite.

    Eq. (M63) of docs/mathematics_methods.md.
    """
    shared = float(first.weight @ cov @ second.weight)
    if shared * first.threshold >= second.threshold:
        return first
    if shared * second.threshold >= first.threshold:
        return second
    rest = 1.0 - shared**2
    if rest < np.finfo(float).eps:
        return HalfSpace(first.weight, math.inf)
    nearest = (first.threshold - shared * second.threshold) * first.weight
    nearest = (nearest + (second.threshold - shared * first.threshold) * second.weight) / rest
    size = math.sqrt(nearest @ cov @ nearest)
    return HalfSpace(nearest / size, size)


def mean_beyond(threshold: float) -> float:
    """E[r | r >= τ] = φ(τ) / Φ(-τ) of r ~ N(0, 1)."""
    return math.exp(-0.5 * threshold**2 - 0.5 * math.log(2.0 * math.pi) - float(log_ndtr(-threshold)))
