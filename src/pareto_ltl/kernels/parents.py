"""Rules of parent re-selection, which compare two parents: Eqs. (11) and (12) of the paper, and our own."""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.jit import by_type, implements, kernel
from pareto_ltl.support.arrays import FloatArray, IntArray

# Number of parents whose risks are computed for a vertex under the scaled rules. Computing all of them (5.7
# on phi2) makes growth twice as slow and no better: the hypervolume of the flown paths of ten trees is 0.32 ±
# 0.02, and 0.34 ± 0.03 with two.
APPRAISED = 2
UNLIKE = 1000.0  # rank of one transition to acceptance, more than any score
FLOOR = 1e-6  # added to risks before their logarithms are compared


class Dominance(NamedTuple):
    """The paper's rule. Slack of Eq. (11): ``beta_length`` [m] and ``beta_risk``, added to each risk."""

    beta_length: float
    beta_risk: float


class Scaled(NamedTuple):
    """Compares d_A first, then logarithms of risks, and length.

    The slack of risks is the factor 1 + ``beta_risk``, the slack of the length ``beta_length`` [m]. With
    ``scored``, one augmented Tchebycheff score of mission risk, collision risk and length decides instead,
    with ``weight`` (3,); ``per_length`` [1/m] scales the length in it. Both are one type, because one run
    grows trees of both kinds, and the kernels then compile once. Risks are computed only for the
    ``APPRAISED`` candidates whose risks have the best score. The first ``missions`` columns of risks hold
    mission risk; the collision risk follows, if the bound has one.
    """

    beta_length: float
    beta_risk: float
    weight: FloatArray
    per_length: float
    missions: int
    scored: bool


class Candidate(NamedTuple):
    """A parent in a comparison: d_A and length [m] of the new vertex with it, and its row of the risks."""

    distance: float
    length: float
    row: int


@by_type
def improves(
    rule: Dominance | Scaled, risks: FloatArray, new: Candidate, old: Candidate, strict: bool
) -> bool:
    """Whether parent ``new`` may replace ``old``: Eqs. (11) and (12), with ``strict`` only Eq. (12).

    ``risks`` (rows, columns): objectives of the candidates, -1 for a proposition not visited yet.

    Eq. (M44) of docs/mathematics_methods.md.
    """
    raise NotImplementedError


@by_type
def collision_limit(rule: Dominance | Scaled, risk: float, delta: float) -> float:
    """The largest collision risk that a candidate may have to improve on a parent of the given ``risk``."""
    raise NotImplementedError


@by_type
def rank_parent(rule: Dominance | Scaled, risks: FloatArray, parent: Candidate) -> float:
    """Rank of a candidate parent, lower is better, before the risks of the new vertex are computed.

    It depends on the parent's own row of ``risks``, and on d_A and length of the new vertex.
    """
    raise NotImplementedError


@by_type
def put_first(rule: Dominance | Scaled, pool: IntArray, ranks: FloatArray, count: int) -> int:
    """Move the parents whose risks are to be computed to the front of ``pool``; return their number.

    The pool has ``count`` parents, with their ``ranks``.
    """
    raise NotImplementedError


@implements(improves, Dominance)
def _dominates(rule: Dominance, risks: FloatArray, new: Candidate, old: Candidate, strict: bool) -> bool:
    better = new.distance < old.distance or new.length < old.length
    for i in range(risks.shape[1]):
        risk, rival = max(risks[new.row, i], 0.0), max(risks[old.row, i], 0.0)
        better = better or risk < rival
        if not strict and risk > rival + rule.beta_risk:
            return False
    return better and (strict or new.length <= old.length + rule.beta_length)


@implements(collision_limit, Dominance)
def _limit_added(rule: Dominance, risk: float, delta: float) -> float:
    return min(delta, risk + rule.beta_risk)


@implements(rank_parent, Dominance)
def _without_rank(_rule: Dominance, _risks: FloatArray, _parent: Candidate) -> float:
    return 0.0


@implements(put_first, Dominance)
def _all_of_them(_rule: Dominance, _pool: IntArray, _ranks: FloatArray, count: int) -> int:
    return count


@implements(improves, Scaled)
def _improves_scaled(rule: Scaled, risks: FloatArray, new: Candidate, old: Candidate, strict: bool) -> bool:
    if new.distance != old.distance:
        return new.distance < old.distance
    if rule.scored:
        return tchebycheff(rule, risks, new) < tchebycheff(rule, risks, old) - 1e-9
    better = new.length < old.length * (1.0 - 1e-9)
    for i in range(risks.shape[1]):
        risk, rival = max(risks[new.row, i], 0.0) + FLOOR, max(risks[old.row, i], 0.0) + FLOOR
        better = better or risk < rival * (1.0 - 1e-6)
        if not strict and risk > rival * (1.0 + rule.beta_risk) * (1.0 + 1e-9):
            return False
    return better and (strict or new.length <= old.length + rule.beta_length)


@implements(collision_limit, Scaled)
def _limit_scaled(rule: Scaled, risk: float, delta: float) -> float:
    return delta if rule.scored else min(delta, (risk + FLOOR) * (1.0 + rule.beta_risk))


@implements(rank_parent, Scaled)
def _rank_scaled(rule: Scaled, risks: FloatArray, parent: Candidate) -> float:
    return parent.distance * UNLIKE + tchebycheff(rule, risks, parent)


@implements(put_first, Scaled)
def _put_best_first(_rule: Scaled, pool: IntArray, ranks: FloatArray, count: int) -> int:
    kept = min(count, APPRAISED)
    for i in range(kept):
        least = i
        for k in range(i + 1, count):
            if ranks[k] < ranks[least]:
                least = k
        ranks[i], ranks[least] = ranks[least], ranks[i]
        for c in range(2):
            pool[i, c], pool[least, c] = pool[least, c], pool[i, c]
    return kept


@kernel
def tchebycheff(rule: Scaled, risks: FloatArray, candidate: Candidate) -> float:
    """max_i λ_i z_i + 0.05 Σ_i λ_i z_i; z: scaled logarithms of mission and collision risk, scaled length.

    The augmented Tchebycheff score of Steuer and Choo, Math. Programming 26 (1983), doi:10.1007/BF02591870.

    Eq. (M45) of docs/mathematics_methods.md.
    """
    mission, collision = 0.0, 0.0
    for i in range(risks.shape[1]):
        if i < rule.missions:
            mission += max(risks[candidate.row, i], 0.0)
        else:
            collision += risks[candidate.row, i]
    w = rule.weight
    v = w[0] * (math.log10(mission + FLOOR) + 6.0) / 6.0
    c = w[1] * (math.log10(collision + FLOOR) + 6.0) / 6.0
    d = w[2] * candidate.length * rule.per_length
    return float(max(v, c, d) + 0.05 * (v + c + d))
