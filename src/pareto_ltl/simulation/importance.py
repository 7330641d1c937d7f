"""Rates of rare failures by importance sampling.

A flight is a vector z ~ N(0, I) of standard normal draws: its start, the white part of its winds and the
innovations of its field. If a plan fails once in 10^5 flights, few flights drawn so fail. Here they are drawn
from a mixture that fails often, and each is weighted by the ratio of its densities under the law and the
mixture.

The law linearised about the plan is used only for the proposal. Failures lie near half-spaces
H_j = {ω_j' z >= τ_j}, |ω_j| = 1 (:mod:`pareto_ltl.simulation.failure_modes`). A component of the mixture is
the law of z given H_j,

    z = ω_j r + (I - ω_j ω_j') ζ,    ζ ~ N(0, I),    r ~ N(0, 1) given r >= τ_j.

If component j has the probability Φ(-τ_j) / Σ_k Φ(-τ_k), this is the mixture of Owen, Maximov and Chertkov
(ALOE), Electronic Journal of Statistics 13 (2019), doi:10.1214/18-EJS1527, of density φ(z) S(z) / Σ_k Φ(-τ_k)
with S(z) the number of half-spaces that hold z. The nonlinear law fails beside them, too. So they are also
taken with thresholds lowered to s_l τ_j, s_l <= 1, and a share α of the flights is drawn as it is:

    q(z) / φ(z) = α + Σ_l β_l Σ_j 1{ω_j' z >= s_l τ_j} / Σ_k Φ(-s_l τ_k),    α + Σ_l β_l = 1,
    P(fail)     = E_φ[1{z fails}] = E_q[1{z fails} φ(z) / q(z)].

The mean of 1{z_i fails} φ(z_i) / q(z_i) over draws from q is unbiased whatever the half-spaces are, and for
the law in which the simulator decides whether z fails: nonlinear winds. No weight exceeds 1 / α. The
half-spaces only decide how many draws are needed.

Errors with tails have a scale c that is drawn first (:mod:`wind_laws.tails`). Given c, the
deviations are about c times as large, and τ_j / c stands for τ_j.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import Generator, SeedSequence
from scipy.special import gammaincinv, ndtr, ndtri

from careful_io.machine import on_all_cores
from pareto_ltl.kernels import importance as kernel
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.rates import WEIGHTED, FailureRate
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.simulation import flights as sim
from pareto_ltl.simulation.failure_modes import (
    FailureModes,
    FlightEvent,
    FlownPlan,
    directions_of,
    find_failure_modes,
    flown_plan,
    linear_deviations,
    linked_fields,
    normal_draws,
)
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray
from pareto_ltl.support.seeds import unspawned
from wind_laws.tails import TILTS, scaled_fields, typical_scale, weighted_scales

FARTHEST = 35.0  # standard deviations to the nearest half-space that a flight is pushed into: Φ(-35) = 1e-268
# Of a promise or of a volume. Of 20 draws in a law with tails, every seventeenth interval lay below a tenth
# of the rate.
LEAST_DRAWS = 1000
SPARE = 2.0  # the upper end of an interval allows for one more weight, this many times the largest one drawn


class Ladder(NamedTuple):
    """Levels s_l (L,), from 1 down, their shares β_l (L,) of the draws, and the share α = ``plain``."""

    level: FloatArray
    share: FloatArray
    plain: float


# β_l ∝ exp(-(1 - s_l) / 0.6). With these values the standard error of 20,000 draws is 1.4 to 3.5 % of the
# rate for plans for phi1 and phi2 with feedback that fail in 10^-2 to 3 x 10^-5 of the flights, and 5 % for
# one whose failures are of two kinds, beside obstacles and for want of airspeed (6.6 % with levels down to
# 0.6 and with 0.4 instead of 0.6). With level 1 and plain flights alone, failures beside the half-spaces are
# seldom drawn and weigh 1 / α.
LEVELS, PLAIN = np.arange(1.0, 0.3875, -0.025), 0.1
SHARES = np.exp((LEVELS - 1.0) / 0.6)
LADDER = Ladder(LEVELS, (1.0 - PLAIN) * SHARES / SHARES.sum(), PLAIN)


@dataclass(frozen=True, slots=True)
class Proposal:
    """The distribution from which weighted flights of a plan are drawn.

    Attributes
    ----------
    plan : FlownPlan
        The plan, and the law linearised about it.
    modes : FailureModes
        Half-spaces of its deviations, at least one; ``directions`` are their ω.
    """

    plan: FlownPlan
    modes: FailureModes
    directions: kernel.Directions
    ladder: Ladder = LADDER

    def chances(self, scale: FloatArray) -> FloatArray:
        """Φ(-s_l τ_j / c) of each level and half-space for flights of ``scale`` c (n,), (n, L, J)."""
        reach = np.outer(self.ladder.level, self.modes.threshold)
        return np.asarray(ndtr(-reach / scale[:, None, None]), float)

    def mixture(self, scale: FloatArray, chances: FloatArray) -> kernel.Mixture:
        """The half-spaces and levels in the form of the kernel, for flights of ``scale`` (n,)."""
        event, step = np.nonzero(self.modes.weight.any(axis=2))
        return kernel.Mixture(
            np.searchsorted(event, np.arange(len(self.modes) + 1)), step, self.modes.weight[event, step],
            self.modes.threshold, self.ladder.level, scale, self.ladder.share / chances.sum(axis=2),
            self.ladder.plain,
        )  # fmt: skip


# --- the rate ---------------------------------------------------------------------------------


def weighted_rate(problem: Problem, path: PlannedPath, draws: int, seed: SeedSequence) -> FailureRate | None:
    """Failure rate of ``path`` in the nonlinear winds of ``fidelity.law``, from ``draws`` weighted flights.

    None if there is no proposal: for a plan that counts on position fixes, after which deviations are not
    linear in z; for one whose mean itself fails, which fails often; and for one without a half-space within
    nine standard deviations, as without uncertainty.

    Eq. (M65) of docs/mathematics_methods.md.

    Raises
    ------
    ValueError
        If ``draws`` is not positive.
    InfeasibleError
        If the wind is not known for so long.
    """
    if draws < 1:
        raise ValueError(f"importance sampling needs at least one draw, got draws = {draws}")
    sim.require_known_wind(problem, path.u, path.x)
    law = problem.fidelity.law
    proposal = None if problem.landmarks else make_proposal(problem, path)
    if proposal is None:
        return None
    weights, failed = weighted_flights(proposal, draws, seed)
    weighted = np.where(failed, weights, 0.0)
    rate = min(float(weighted.mean()), 1.0)
    low, high = weighted_interval(weighted, least_share(problem, proposal.ladder))
    return FailureRate(law, rate, min(low, rate), max(high, rate), draws, WEIGHTED)


def least_share(problem: Problem, ladder: Ladder) -> float:
    """One over the largest weight that a draw can have, which a law with tails multiplies."""
    return ladder.plain / (1.0 if problem.tail is None else len(TILTS))


def weighted_interval(weights: FloatArray, plain: float, confidence: float = 0.95) -> tuple[float, float]:
    """Confidence interval of the mean of ``weights`` (n,), which are 0 for flights that do not fail.

    The gamma interval of Fay and Feuer, Statistics in Medicine 16 (1997) 791-801, for weighted counts. With y
    the mean, v its sampling variance and G(p; k) the quantile p of a gamma variable of shape k and scale 1,

        low = v/y G(a; y²/v),    high = v'/y' G(1 - a; y'²/v'),    y' = y + m,    v' = v + m²,

    for a confidence of 1 - 2 a. The upper end allows for one more flight of weight n m: twice the largest
    weight drawn, or 1 / ``plain``, the largest there is, where no flight fails. With once the largest, 9 % of
    the intervals lay below the rate of a plan with feedback, whose weights are skew; with twice, 4 % of
    the intervals of 200 draws and 2 % of the intervals of 2,000. In all, 1 to 5 % of the intervals missed
    the rates of five plans.

    Eq. (M66) of docs/mathematics_methods.md.
    """
    n, tail = len(weights), 0.5 * (1.0 - confidence)
    unit = math.ldexp(1.0, math.frexp(float(weights.max()))[1])  # squares of weights near 1e-170 would be 0
    weights = weights / unit
    y = float(weights.mean())
    v = float(weights.var()) / n
    m = (SPARE * float(weights.max()) if y > 0.0 else 1.0 / plain) / n
    low = v / y * float(gammaincinv(y**2 / v, tail)) if y > 0.0 and v > 0.0 else y
    above, spread = y + m, v + m**2
    high = spread / above * float(gammaincinv(above**2 / spread, 1.0 - tail))
    return min(unit * min(low, y), 1.0), min(unit * max(high, y), 1.0)


def make_proposal(
    problem: Problem, path: PlannedPath, ladder: Ladder = LADDER, event: FlightEvent | None = None
) -> Proposal | None:
    """The mixture for ``path`` by its failures, or by what else is rare; None if there are none."""
    plan = flown_plan(problem, path, event)
    modes = find_failure_modes(plan)
    if not len(modes):
        return None
    return Proposal(plan, modes, directions_of(plan.linear, modes.weight), ladder)


# --- weighted flights -------------------------------------------------------------------------


def weighted_flights(
    proposal: Proposal, draws: int, seed: SeedSequence, x: FloatArray | None = None
) -> tuple[FloatArray, BoolArray]:
    """Weights φ/q (n,) of ``draws`` flights from the proposal, and which of them fail (n,).

    Their positions are written to ``x`` (n, T+1, 2) [m], if it is given. The same ``seed`` gives the same
    flights, whatever the number of threads.
    """
    weights, failed = np.empty(draws), np.empty(draws, bool)
    plan, tail = proposal.plan, proposal.plan.tail

    def one(rows: slice, child: SeedSequence) -> None:
        n, rng = rows.stop - rows.start, np.random.default_rng(child)
        if tail is None:
            z, theta, density = draw_proposal(proposal, np.ones(n), rng)
            weights[rows] = 1.0 / density
        else:
            scales, weight = weighted_scales(tail, len(plan.linear.kept), n, rng)
            z, theta, density = draw_proposal(proposal, typical_scale(tail, scales), rng)
            weights[rows] = weight / density
            theta = scaled_fields(tail, theta, scales)
        flown, failed[rows] = plan.fly(z, theta)
        if x is not None:
            x[rows] = flown

    blocks = sim.block_rows(draws)
    on_all_cores(one, blocks, unspawned(seed).spawn(len(blocks)))
    return weights, failed


def draw_proposal(
    proposal: Proposal, scale: FloatArray, rng: Generator
) -> tuple[kernel.NormalDraws, Float32Array, FloatArray]:
    """Vectors z for flights of ``scale`` (n,) from the mixture, their fields θ, and densities q / φ (n,).

    z ~ N(0, I) is pushed along ω of a half-space into it.

    Eq. (M64) of docs/mathematics_methods.md.
    """
    law, modes, ladder, n = proposal.plan.linear, proposal.modes, proposal.ladder, len(scale)
    # Any scale gives a valid mixture; with a smaller one the chances of all half-spaces would round to 0.
    scale = np.maximum(scale, modes.threshold.min() / FARTHEST)
    chances = proposal.chances(scale)
    shares = np.append(ladder.share, ladder.plain)
    level = rng.choice(len(shares), n, p=shares / shares.sum())
    plain, rung = level == len(ladder.level), np.minimum(level, len(ladder.level) - 1)
    sums = chances[np.arange(n), rung].cumsum(axis=1)
    event = np.minimum((sums < rng.random((n, 1)) * sums[:, -1:]).sum(axis=1), len(modes) - 1)
    tau = np.where(plain, 0.0, ladder.level[rung] * modes.threshold[event] / scale)
    size = -ndtri((1.0 - rng.random(n)) * ndtr(-tau))  # r ~ N(0, 1) given r >= τ, by inversion
    z = normal_draws(law, n, rng)
    kernel.push_draws(proposal.directions, np.where(plain, -1, event), size, z)
    theta, density = linked_fields(law, z), np.empty(n)
    kernel.mixture_density(proposal.mixture(scale, chances), linear_deviations(law, z, theta), density)
    return z, theta, density
