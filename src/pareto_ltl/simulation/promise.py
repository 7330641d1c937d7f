"""The promise of a plan (``fidelity.judge=flights``): its failure rate in fresh flights.

The flights that judged the front also chose the path, so its rate there, the claim, may be too optimistic.
Before a path becomes the plan, it is flown through winds that neither the optimisation nor the choice has
used. If these flights fail significantly more often than the claim, the rule's next choice is taken.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import rate_text
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.rates import WEIGHTED, FailureRate, Promise
from pareto_ltl.planning.records import Front, PlannedPath
from pareto_ltl.planning.selection_rules import choose_path, part_of_front, selection_rule
from pareto_ltl.settings import SelectionConfig
from pareto_ltl.simulation.judging import count_failures
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import binomial_tail, hypergeometric_tail
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.wind.records import WindField

LOG = logging.getLogger(__name__)
LINEAR = 0.35  # standard deviation over length scale: beyond it the linearised law is unreliable
RARE = 1e-3  # lower rates are estimated with weighted flights: too few plain ones fail
WEIGHTED_CHILD = 2**17  # child of the seed that weighted flights draw from
DOUBT = 1e-3  # significance level: probability of rejecting a claim that is true


def promise_path(
    cfg: SelectionConfig, problem: Problem, wind: WindField, front: Front, seed: SeedSequence
) -> tuple[PlannedPath, Promise]:
    """The rule's first choice whose claim is consistent with fresh flights, and its promise.

    A path whose claim is rejected is replaced by the rule's next choice; at most ``cfg.examined`` paths are
    tried. With ``rule=threshold`` or ``energy`` a path whose promise exceeds ``cfg.alpha`` is replaced too.
    If all are rejected, the path with the least rate is returned; a warning says why for each.
    """
    left = front
    seen: list[tuple[PlannedPath, Promise]] = []
    for _ in range(cfg.examined):
        try:
            path = choose_path(cfg, left)
        except InfeasibleError:
            if not seen:
                raise
            break  # the rule accepts none of the others
        k = next(i for i, other in enumerate(left.paths) if other is path)
        promise = fresh_promise(problem, wind, path, left.rates[k], cfg.runs, seed)
        seen.append((path, promise))
        if holds(cfg, promise):
            break
        LOG.warning("%s", why_not(cfg, path, promise))
        if selection_rule(cfg).names_one or len(left.paths) == 1:
            break
        left = part_of_front(left, [i for i in range(len(left.paths)) if i != k])
    path, promise = seen[-1] if holds(cfg, seen[-1][1]) else min(seen, key=lambda s: s[1].rate.failure)
    if promise.linearity > LINEAR:
        LOG.warning(
            "the position's standard deviation reaches %.2f of the wind's length scale (%.2f is safe): "
            "bounds, which linearise the wind, are unreliable; use the failure rate of flights in %s "
            "winds, %s",
            promise.linearity, LINEAR, promise.rate.law, _rate_words(promise.rate),
        )  # fmt: skip
    return path, promise


def holds(cfg: SelectionConfig, promise: Promise) -> bool:
    """Whether the claim passes and, with rules that keep alpha, the upper limit is at most ``cfg.alpha``."""
    return promise.passed and (not selection_rule(cfg).keeps_alpha or promise.rate.high <= cfg.alpha)


def why_not(cfg: SelectionConfig, path: PlannedPath, promise: Promise) -> str:
    """Why a choice is rejected, for the log."""
    rate = promise.rate
    begin = f"{path.origin}: {_rate_words(rate)} of {rate.sample} in {rate.law} winds fail"
    over = f"more than the {_rate_words(promise.claimed)} of {promise.claimed.sample} that judged the front"
    if promise.passed:
        over = f"and the upper end is above selection.alpha = {cfg.alpha:g}"
    following = "the plan keeps it" if selection_rule(cfg).names_one else "the rule's next choice is tried"
    return f"{begin}, {over}; {following}"


def _rate_words(rate: FailureRate) -> str:
    return rate_text(rate.failure, rate.low, rate.high)


def fresh_promise(
    problem: Problem, wind: WindField, path: PlannedPath, claimed: FailureRate, runs: int, seed: SeedSequence
) -> Promise:
    """The promise of ``path`` from ``runs`` flights in the winds of ``fidelity.law``, and the bound V + R.

    Eq. (M41) of docs/mathematics.md.
    """
    rate = fresh_rate(problem, path, runs, seed)
    bound = min(1.0, path.objectives.mission_risk + path.objectives.collision_risk)
    far = linearity(problem, wind, path.cov)
    return Promise(rate, claimed, bound, far, claim_stands(rate, claimed), wind.floor)


def fresh_rate(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FailureRate:
    """The rate of ``runs`` fresh flights; below ``RARE``, the rate of as many weighted ones, at least 1,000.

    The count is used if there are no weighted flights, if its interval is narrower, and if it contradicts
    them: the weighted estimate then misses a failure mode.
    """
    from pareto_ltl.simulation.importance import LEAST_DRAWS, weighted_rate

    counted = FailureRate.counted(problem.fidelity.law, count_failures(problem, path, runs, seed), runs)
    if counted.failure >= RARE:
        return counted
    others = SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, WEIGHTED_CHILD))
    weighted = weighted_rate(problem, path, max(runs, LEAST_DRAWS), others)
    if weighted is None or weighted.high - weighted.low >= counted.high - counted.low:
        return counted
    if count_agrees(counted, weighted):
        return weighted
    LOG.warning(
        "%s: the rate of weighted flights, %s, does not agree with %d fresh ones in %s winds, %s; the "
        "latter is reported",
        path.origin, _rate_words(weighted), runs, counted.law, _rate_words(counted),
    )  # fmt: skip
    return counted


def count_agrees(counted: FailureRate, weighted: FailureRate) -> bool:
    """Whether the count is consistent with a rate within the interval of ``weighted``.

    The probability of so many failures or more at its upper end, and the probability of so few or fewer at
    its lower end, must both be at least ``DOUBT``.
    """
    more = binomial_tail(counted.failures, counted.runs, weighted.high)
    fewer = binomial_tail(counted.runs - counted.failures, counted.runs, 1.0 - weighted.low)
    return bool(min(more, fewer) >= DOUBT)


def claim_stands(rate: FailureRate, claimed: FailureRate) -> bool:
    """Whether the claim, a count of flights, is not significantly better than the fresh rate.

    The p value of the claim under the fresh rate must be at least ``DOUBT``. For fresh flights it is Fisher's
    exact test: given the failures of both, the probability of as many fresh ones or more. For weighted ones
    it is the probability that so few of the claim's flights fail at the lower end of their interval.

    Eq. (M60) of docs/mathematics_methods.md.
    """
    if rate.method == WEIGHTED:
        chance = float(binomial_tail(claimed.runs - claimed.failures, claimed.runs, 1.0 - rate.low))
    else:
        total, failures = rate.runs + claimed.runs, rate.failures + claimed.failures
        chance = hypergeometric_tail(rate.failures, total, failures, rate.runs)
    return chance >= DOUBT


def linearity(problem: Problem, wind: WindField, cov: FloatArray) -> float:
    """Largest ratio of the position's standard deviation to the shorter length scale of its slot."""
    if wind.modes is None or len(cov) < 2:
        return 0.0
    widest = np.sqrt(np.linalg.eigvalsh(cov[:-1])[:, 1])
    scale = wind.modes.length.min(axis=1)[problem.modes.slot[: len(cov) - 1]]
    return float((widest / scale).max())
