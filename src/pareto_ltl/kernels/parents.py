"""The rule of parent re-selection, which compares two parents: Eqs. (11) and (12) of the paper."""

from __future__ import annotations

from typing import NamedTuple

from pareto_ltl.support.arrays import FloatArray
from typed_kernels.jit import kernel


class Dominance(NamedTuple):
    """The slack of Eq. (11): ``beta_length`` [m] and ``beta_risk``, added to each risk."""

    beta_length: float
    beta_risk: float


class Candidate(NamedTuple):
    """A parent in a comparison: d_A and length [m] of the new vertex with it, and its row of the risks."""

    distance: float
    length: float
    row: int


@kernel
def improves(rule: Dominance, risks: FloatArray, new: Candidate, old: Candidate, strict: bool) -> bool:
    """Whether parent ``new`` may replace ``old``: Eqs. (11) and (12), with ``strict`` only Eq. (12).

    ``risks`` (rows, P): f_o^i of the candidates, -1 for a proposition not visited yet.

    Eq. (M44) of docs/mathematics_methods.md.
    """
    better = new.distance < old.distance or new.length < old.length
    for i in range(risks.shape[1]):
        risk, rival = max(risks[new.row, i], 0.0), max(risks[old.row, i], 0.0)
        better = better or risk < rival
        if not strict and risk > rival + rule.beta_risk:
            return False
    return better and (strict or new.length <= old.length + rule.beta_length)
