"""Samples of flights of a plan, plain or weighted, from which rates of any event are estimated.

A plain sample counts. A weighted one (:mod:`pareto_ltl.simulation.importance`) is drawn so that a rare event
happens often, and its flights carry weights; it also estimates every event that is less rare and lies in the
same directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.rates import WEIGHTED, FailureRate
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.simulation import flights as sim
from pareto_ltl.simulation.failure_modes import FlightEvent
from pareto_ltl.simulation.importance import (
    LEAST_DRAWS,
    least_share,
    make_proposal,
    weighted_flights,
    weighted_interval,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.seeds import unspawned


@dataclass(frozen=True, slots=True)
class FlightSample:
    """Flights of a plan in the winds of one law.

    Attributes
    ----------
    x : (n, T+1, 2) float
        Positions [m].
    weight : (n,) float or None
        Ratio of the density of each flight to the one it was drawn from; None for plain flights.
    plain : float
        Share of a weighted sample that is drawn as it is, over the largest weight of the tails.
    """

    law: str
    x: FloatArray
    weight: FloatArray | None = None
    plain: float = 1.0

    def __len__(self) -> int:
        return len(self.x)

    def rate(self, happens: BoolArray) -> FailureRate:
        """The rate of an event that ``happens`` (n,) to some of the flights, with its 95 % interval."""
        if self.weight is None:
            return FailureRate.counted(self.law, int(happens.sum()), len(self))
        weighted = np.where(happens, self.weight, 0.0)
        mean = min(float(weighted.mean()), 1.0)
        low, high = weighted_interval(weighted, self.plain)
        return FailureRate(self.law, mean, min(low, mean), max(high, mean), len(self), WEIGHTED)


def plain_sample(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FlightSample:
    """``runs`` flights of ``path`` in the law that it was planned in."""
    law = problem.fidelity.law
    return FlightSample(law, sim.simulate_flights(problem, path.u, runs, law, seed, path.x).x)


def weighted_samples(
    problem: Problem, path: PlannedPath, event: FlightEvent, runs: int, seed: SeedSequence, samples: int = 1
) -> list[FlightSample]:
    """``samples`` independent samples of ``runs`` flights, at least 1,000, for which ``event`` is not rare.

    An empty list if there is no proposal, as in :func:`~pareto_ltl.simulation.importance.weighted_rate`: for
    a plan that counts on position fixes, for an event that happens to the plan itself, and for one without a
    half-space within nine standard deviations.
    """
    sim.require_known_wind(problem, path.u, path.x)
    proposal = None if problem.landmarks else make_proposal(problem, path, event=event)
    if proposal is None:
        return []
    made, draws = list[FlightSample](), max(runs, LEAST_DRAWS)
    for child in unspawned(seed).spawn(samples):
        x = np.empty((draws, *path.x.shape))
        weight = weighted_flights(proposal, draws, child, x)[0]
        made.append(FlightSample(problem.fidelity.law, x, weight, least_share(problem, proposal.ladder)))
    return made
