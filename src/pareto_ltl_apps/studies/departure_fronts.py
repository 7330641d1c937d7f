"""Comparison of fronts at common lengths: which starts fail least, and which of them do not differ.

A start is planned with several seeds; its front is computed from all these plans. All paths fly in the
same winds. Two sources of chance separate a start from its rival: the winds of the flights, known from the
pairs, and the seed of the planner, known from the scores of single plans of one start.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pareto_ltl.extend import non_dominated
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.counts import clopper_pearson

MAP_LENGTHS = 24  # about the largest number of rows of the heat map
LENGTHS = 12  # common lengths at which fronts are compared
NEARLY = 1.1  # ratio of failures up to which an earlier start is preferred
MANY = 1e6  # degrees of freedom from which Student's t is the normal distribution
ERROR = 0.05  # probability that one of the intervals of all rivals together misses its ratio
# Variance of the least of R independent standard normal numbers, R = 1, 2, ...
LEAST_VARIANCE = (1.0, 0.68169, 0.55947, 0.49172, 0.44753, 0.41593, 0.39192, 0.37290, 0.35735, 0.34434)


@dataclass(frozen=True, slots=True)
class FlownFront:
    """Paths that are non-dominated in length and failure, shortest first.

    Attributes
    ----------
    length : (P,) float
        Lengths [m], increasing.
    failed : (P, n) bool
        Which flights fail; flights of the same number have the same draws on all paths of all starts.
    """

    length: FloatArray
    failed: BoolArray

    @property
    def rates(self) -> FloatArray:
        """Failure rates (P,) with half a failure added, so that they have logarithms: (k + ½) / (n + 1)."""
        return np.asarray((self.failed.sum(axis=1) + 0.5) / (self.failed.shape[1] + 1.0))


Fronts = Mapping[float, Sequence[FlownFront]]  # by time of departure, one for each seed


def flown_front(length: FloatArray, failed: BoolArray) -> FlownFront:
    """The front of paths with these lengths (P,) [m] and flights (P, n)."""
    length, failed = np.asarray(length, float), np.asarray(failed, bool)
    if len(length):
        front = np.flatnonzero(non_dominated(np.column_stack([length, failed.sum(axis=1)])))
        front = front[np.argsort(length[front])]
        length, failed = length[front], failed[front]
    return FlownFront(length, failed)


def pooled_front(fronts: Sequence[FlownFront]) -> FlownFront:
    """The front of the paths of all ``fronts`` together."""
    return flown_front(np.concatenate([f.length for f in fronts]), np.concatenate([f.failed for f in fronts]))


def length_weights(length: FloatArray, limits: FloatArray) -> FloatArray:
    """Weights (G, P) of linear interpolation from ``length`` (P,) to ``limits`` (G,).

    Beyond the longest path, the weight is on that path; below the shortest all weights are 0.
    """
    if not len(length):
        return np.zeros((len(limits), 0))
    weights = np.stack([np.interp(limits, length, unit) for unit in np.eye(len(length))], axis=1)
    return np.asarray(np.where(limits[:, None] < length[0], 0.0, weights))


def rates_at(front: FlownFront, limits: FloatArray) -> FloatArray:
    """Failure rate at each of ``limits`` (G,) and its 95 % interval, (G, 3); NaN below the shortest path.

    Logarithms of the rates, and of the ends of their intervals, are interpolated between paths.
    """
    n = front.failed.shape[1]
    counts = front.failed.sum(axis=1).tolist()
    table = np.array([[k / n, *clopper_pearson(k, n)] for k in counts]).reshape(-1, 3)
    logs = np.log(np.maximum(table, 0.5 / (n + 1.0)))
    weights = length_weights(front.length, limits)
    known = weights.sum(axis=1) > 0.0
    return np.where(known[:, None], np.exp(weights @ logs), math.nan)


def score(front: FlownFront, limits: FloatArray) -> float:
    """Mean logarithm of the failure rate over ``limits`` (G,); the rate is 1 below the shortest path.

    Eq. (M59a) of docs/mathematics_methods.md.
    """
    return float((length_weights(front.length, limits) @ np.log(front.rates)).mean())


def common_lengths(fronts: Fronts) -> FloatArray:
    """Lengths (G,) [m] from the longest of the starts' shortest paths to the median of the longest ones."""
    pooled = [front for own in fronts.values() if len((front := pooled_front(own)).length)]
    low = max(float(front.length[0]) for front in pooled)
    high = float(np.median([front.length[-1] for front in pooled]))
    return np.linspace(low, max(low, high), LENGTHS)


def map_lengths(fronts: Fronts) -> FloatArray:
    """Round lengths (M,) [m] of the heat map: from the shortest path to beyond the longest common length."""
    low = min(float(front.length[0]) for own in fronts.values() for front in own if len(front.length))
    high = float(common_lengths(fronts)[-1])
    least = max(high - low, 1e-3 * low) / MAP_LENGTHS
    power = 10.0 ** math.floor(math.log10(least))
    step = next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= least)
    return np.asarray(step * np.arange(math.ceil(low / step), math.ceil(high / step) + 1))


# --- what chance explains ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SeedSpread:
    """Standard deviation of the scores of plans of one start with different seeds.

    ``freedom`` is its number of degrees of freedom, 0 if each start was planned once.
    """

    sd: float
    freedom: int


def seed_spread(fronts: Fronts, limits: FloatArray) -> SeedSpread:
    """The spread within starts, pooled over all starts."""
    groups = [[score(front, limits) for front in own] for own in fronts.values()]
    freedom = sum(len(group) - 1 for group in groups)
    squares = sum(float(np.var(group)) * len(group) for group in groups)
    return SeedSpread(math.sqrt(squares / freedom) if freedom else 0.0, freedom)


def flight_variance(first: FlownFront, second: FlownFront, limits: FloatArray) -> float:
    """Variance of the difference of two scores over the winds of the paired flights.

    A flight adds its weight over the rate of each path that it fails on. One flight that fails on all paths
    of ``first`` alone and one of ``second`` alone are added: without failures the variance is not 0.
    """
    n = first.failed.shape[1]
    slopes = [length_weights(front.length, limits).mean(axis=0) / front.rates for front in (first, second)]
    gap = slopes[1] @ second.failed - slopes[0] @ first.failed
    variance = gap.var() + sum(slope.sum() ** 2 for slope in slopes) / n
    return float(variance / n)


def failure_ratio(
    best: Sequence[FlownFront],
    other: Sequence[FlownFront],
    limits: FloatArray,
    spread: SeedSpread,
    rivals: int,
) -> tuple[float, float, float]:
    """How many times as often ``other`` fails as ``best`` at equal length, with its interval (low, high).

    The geometric mean over ``limits``. Both starts take part with the same number R of seeds. The intervals
    of all ``rivals`` of the best start hold together with a probability of 95 % (Bonferroni)::

        d ± t √(v + 2 s² w_R)

    with the difference d of the scores, the variance v over winds, the spread s between seeds, the variance
    w_R of the least of R normal numbers, and Student's t with the degrees of freedom of s times
    ((v + 2 s² w_R) / (2 s² w_R))² (Welch and Satterthwaite): v is from thousands of flights.

    Eq. (M59b) of docs/mathematics_methods.md.
    """
    from scipy.special import ndtri, stdtrit

    count = min(len(best), len(other))
    first, second = pooled_front(best[:count]), pooled_front(other[:count])
    middle = score(second, limits) - score(first, limits)
    seeds = 2.0 * spread.sd**2 * LEAST_VARIANCE[count - 1]
    total = flight_variance(first, second, limits) + seeds
    level = 1.0 - 0.5 * ERROR / max(rivals, 1)
    freedom = spread.freedom * (total / seeds) ** 2 if seeds else math.inf  # Welch and Satterthwaite
    half = math.sqrt(total) * float(stdtrit(freedom, level) if freedom < MANY else ndtri(level))
    low, high = (math.exp(min(end, 700.0)) for end in (middle - half, middle + half))
    return math.exp(middle), low, high


# --- the comparison ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Comparison:
    """The comparison of all starts.

    Attributes
    ----------
    limits : (G,) float
        Common lengths [m].
    best : float
        Start with the lowest score; ratios refer to it.
    ratios : mapping of float to (ratio, low, high)
        How many times as often each start fails as ``best`` at equal length.
    spread : SeedSpread
        The spread between seeds of the planner.
    """

    limits: FloatArray
    best: float
    ratios: Mapping[float, tuple[float, float, float]]
    spread: SeedSpread

    @property
    def alike(self) -> tuple[float, ...]:
        """The best start and those that do not differ from it beyond the noise, in the order of time."""
        return tuple(sorted(time for time, (_, low, _) in self.ratios.items() if low <= 1.0))

    @property
    def recommended(self) -> float:
        """The earliest of :attr:`alike` that fails at most ``NEARLY`` times as often as the best one.

        Among equal starts the seed does not choose, and a start that is likely to be worse is not chosen.
        """
        return next(time for time in self.alike if self.ratios[time][0] <= NEARLY)


def compare_fronts(fronts: Fronts) -> Comparison:
    """Compare the starts at common lengths; at least one must have a path."""
    limits = common_lengths(fronts)
    spread = seed_spread(fronts, limits)
    longest = max(len(own) for own in fronts.values())
    best = min(
        (time for time, own in fronts.items() if len(own) == longest),
        key=lambda time: (score(pooled_front(fronts[time]), limits), time),
    )
    ratios = {
        time: (1.0, 1.0, 1.0)
        if time == best
        else failure_ratio(fronts[best], own, limits, spread, len(fronts) - 1)
        for time, own in fronts.items()
    }
    return Comparison(limits, best, ratios, spread)


def starts_to_repeat(fronts: Fronts, seeds: int) -> tuple[float, ...]:
    """Starts to plan with one more seed, at most ``seeds`` for each; empty if the comparison is complete.

    First the better half, which shows the spread between seeds; then all that may still be the best.
    """
    if seeds < 2 or len(fronts) < 2:
        return ()
    if all(len(own) == 1 for own in fronts.values()):
        limits = common_lengths(fronts)
        ranked = sorted(fronts, key=lambda time: (score(fronts[time][0], limits), time))
        return tuple(sorted(ranked[: max(2, -(-len(ranked) // 2))]))
    alike = compare_fronts(fronts).alike
    return tuple(time for time in alike if len(fronts[time]) < seeds) if len(alike) > 1 else ()
