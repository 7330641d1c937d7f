"""The ways in which flights of a plan fail, as half-spaces of their deviations.

Deviations are e = M' z with z ~ N(0, I) in the law linearised about the plan, so that a half-space of them
has the probability Φ(-τ). A certificate of the plan (:mod:`pareto_ltl.simulation.certificates`) gives a first
set that covers all failures: the half-space beyond each of its lines. Such a half-space can be far too large:
a flight that misses a region at one step may visit it at another. It is then divided:

1. The most likely half-space H is taken. If its centre of mass, the flight E[e | H], has a certificate with
   other lines, then a flight in H fails only if it also violates one of those.
2. H is replaced by its intersections with the half-spaces beyond them. Each intersection of two half-spaces
is
   replaced by the half-space that contains it and touches it at its point nearest to the origin.

So failures stay covered, and the sum of probabilities decreases. It ends when no centre has a certificate:
then the half-space touches failures at their most likely point, the dominating point of Sadowsky and Bucklew,
IEEE Trans. Inf. Theory 36 (1990), doi:10.1109/18.54903. To cover a failure once, the parts of H are ordered,
and a flight that violates a line of an earlier part belongs to that part.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import log_ndtr, ndtr

from pareto_ltl.simulation.certificates import Key, Landscape, Lines, find_certificate
from pareto_ltl.support.arrays import BoolArray, FloatArray

MOST_DIVIDED = 300  # half-spaces that are examined; a plan for phi1 or phi2 needs 20 to 200
MOST_KEPT = 2000
UNDECIDED = 0.02  # share of the probability that may be left undivided
NEGLIGIBLE = 1e-8  # share of the first cover below which a part is dropped
KEPT = 1.0 - 1e-6  # share of the probability of the last cover that is kept


@dataclass(frozen=True, slots=True)
class FailureModes:
    """Half-spaces Σ_t ``weight[j, t]``' e_t >= ``threshold[j]`` that cover the failures of a plan.

    Attributes
    ----------
    weight : (J, T+1, 2) float
        Scaled so that the sum has the variance 1 [1/m].
    threshold : (J,) float
        In standard deviations, positive.
    """

    weight: FloatArray
    threshold: FloatArray

    def __len__(self) -> int:
        return len(self.threshold)

    @property
    def union_bound(self) -> float:
        """Σ_j Φ(-τ_j), which the probability of their union does not exceed."""
        return float(ndtr(-self.threshold).sum())


@dataclass(frozen=True, slots=True, order=True)
class _Part:
    """A half-space of the cover; ordered by probability, the most likely first.

    Its flights violate the lines ``broken``; flights that violate one of ``left`` belong to other parts.
    """

    chance: float  # negative, so that a heap has the most likely part on top
    number: int
    weight: FloatArray = field(compare=False)
    threshold: float = field(compare=False)
    broken: frozenset[Key] = field(compare=False)
    left: frozenset[Key] = field(compare=False)


def find_failure_modes(scape: Landscape, cov: FloatArray) -> FailureModes | None:
    """Half-spaces that cover the failures of the plan of ``scape``.

    ``cov`` (2 (T+1), 2 (T+1)) is the covariance of the deviations of all steps [m²]. None if the plan itself
    has no certificate: then about half of its flights or more fail.
    """
    lines = find_certificate(scape, scape.x, ())
    if lines is None:
        return None
    search = _Search(scape, cov)
    search.begin(lines)
    search.divide()
    return search.cover()


class _Search:
    """The parts of the cover: ``waiting`` may be divided, ``final`` are not."""

    def __init__(self, scape: Landscape, cov: FloatArray) -> None:
        self.scape, self.cov = scape, cov
        self.waiting: list[_Part] = []
        self.final: list[_Part] = []
        self.numbers = 0
        self.negligible = 0.0

    def begin(self, lines: Lines) -> None:
        """Begin with the half-spaces beyond the lines of the plan."""
        weight, threshold = self.beyond(lines)
        self.negligible = NEGLIGIBLE * float(ndtr(-threshold).sum())
        self.add(lines, self.on_paths(lines, weight), threshold, frozenset(), frozenset())

    def divide(self) -> None:
        """Divide the most likely part until at most ``UNDECIDED`` of the probability is undecided."""
        decided, undecided = 0.0, -sum(part.chance for part in self.waiting)
        for _ in range(MOST_DIVIDED):
            if not self.waiting or undecided <= UNDECIDED * decided or len(self.waiting) > MOST_KEPT:
                return
            part = heapq.heappop(self.waiting)
            undecided += part.chance
            before = len(self.waiting)
            if self.replace(part):
                undecided -= sum(new.chance for new in self.waiting[before:])
                heapq.heapify(self.waiting)
            else:
                self.final.append(part)
                decided -= part.chance

    def replace(self, part: _Part) -> bool:
        """Append the parts of ``part`` to ``waiting``; False if they are not less likely than ``part``."""
        along = self.cov @ part.weight
        centre = self.scape.x + (mean_beyond(part.threshold) * along).reshape(self.scape.x.shape)
        lines = find_certificate(self.scape, centre, part.broken)
        if lines is None:
            return False
        lines = _without(lines, part.left)
        weight, threshold = self.beyond(lines)
        shared = np.einsum("ki,ki->k", weight, along.reshape(-1, 2)[lines.step])
        mixed = nearest_mixture(part.threshold, threshold, shared)
        if float(ndtr(-mixed.threshold).sum()) >= -part.chance:
            return False
        whole = mixed.first[:, None] * part.weight
        whole += self.on_paths(lines, mixed.second[:, None] * weight)
        self.add(lines, whole, mixed.threshold, part.broken, part.left)
        return True

    def on_paths(self, lines: Lines, weight: FloatArray) -> FloatArray:
        """Weights (K, 2) of e at the steps of ``lines`` as weights of all steps, (K, 2 (T+1))."""
        rows = np.zeros((len(lines), *self.scape.x.shape))
        rows[np.arange(len(lines)), lines.step] = weight
        return rows.reshape(len(lines), self.scape.x.size)

    def beyond(self, lines: Lines) -> tuple[FloatArray, FloatArray]:
        """The half-spaces beyond ``lines``: weights of e at their steps (K, 2) [1/m] and thresholds (K,)."""
        gap = lines.offset - np.sum(lines.normal * self.scape.x[lines.step], axis=1)
        return lines.normal / lines.sd[:, None], gap / lines.sd

    def add(
        self,
        lines: Lines,
        weight: FloatArray,
        threshold: FloatArray,
        broken: frozenset[Key],
        left: frozenset[Key],
    ) -> None:
        """Add one part for each line, the most likely first, without the flights of earlier parts."""
        passed = set(left)
        for i in np.argsort(threshold, kind="stable").tolist():
            chance = float(ndtr(-threshold[i]))
            if chance <= self.negligible:
                break
            key = lines.key[i]
            part = _Part(
                -chance, self.numbers, weight[i], float(threshold[i]), broken | {key}, frozenset(passed)
            )
            self.waiting.append(part)
            self.numbers += 1
            passed.add(key)

    def cover(self) -> FailureModes:
        """All parts, the most likely first, without the last millionth of their probability."""
        parts = sorted([*self.final, *self.waiting])
        chance = -np.array([part.chance for part in parts])
        count = int(np.searchsorted(np.cumsum(chance), KEPT * chance.sum())) + 1
        kept = parts[:count]
        weight = np.array([part.weight for part in kept]).reshape(-1, *self.scape.x.shape)
        return FailureModes(weight, np.array([part.threshold for part in kept]))


def _without(lines: Lines, left: frozenset[Key]) -> Lines:
    """The lines whose key is not in ``left``."""
    kept = np.array([key not in left for key in lines.key], bool)
    keys = tuple(key for key in lines.key if key not in left)
    return Lines(lines.step[kept], lines.normal[kept], lines.offset[kept], lines.sd[kept], keys)


def mean_beyond(threshold: float) -> float:
    """E[r | r >= τ] = φ(τ) / Φ(-τ) of r ~ N(0, 1)."""
    return math.exp(-0.5 * threshold**2 - 0.5 * math.log(2.0 * math.pi) - float(log_ndtr(-threshold)))


@dataclass(frozen=True, slots=True)
class Mixtures:
    """Half-spaces ``first`` ω₀ + ``second`` ω_k >= ``threshold``, each (K,)."""

    first: FloatArray
    second: FloatArray
    threshold: FloatArray


def nearest_mixture(tau: float, others: FloatArray, shared: FloatArray) -> Mixtures:
    """The half-spaces that touch {ω₀' z >= τ₀} ∩ {ω_k' z >= τ_k} at its point nearest to the origin.

    With c = ω₀' ω_k (``shared``), the nearest point is that of one half-space alone if it lies in the other,
    c τ₀ >= τ_k or c τ_k >= τ₀; else both are tight, and

        |z*|² = (τ₀² - 2 c τ₀ τ_k + τ_k²) / (1 - c²),    z* = [(τ₀ - c τ_k) ω₀ + (τ_k - c τ₀) ω_k] / (1 - c²).

    ``tau`` and ``others`` (K,) are at least 0.

    Eq. (M63) of docs/mathematics_methods.md.
    """
    first_alone = shared * tau >= others
    second_alone: BoolArray = ~first_alone & (shared * others >= tau)
    rest = np.maximum(1.0 - shared**2, np.finfo(float).tiny)
    apart = np.maximum(tau**2 - 2.0 * shared * tau * others + others**2, 0.0)  # of equal ones, rounding
    with np.errstate(over="ignore"):  # opposite half-spaces do not intersect: their threshold is infinite
        norm = np.sqrt(apart / rest)
    scale = np.maximum(rest * norm, np.finfo(float).tiny)
    first, second = (tau - shared * others) / scale, (others - shared * tau) / scale
    return Mixtures(
        np.where(first_alone, 1.0, np.where(second_alone, 0.0, first)),
        np.where(first_alone, 0.0, np.where(second_alone, 1.0, second)),
        np.where(first_alone, tau, np.where(second_alone, others, norm)),
    )
