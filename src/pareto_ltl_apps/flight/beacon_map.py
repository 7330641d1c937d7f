"""Where one fix would reduce the failure of a plan most: beacons tried along and beside its path.

A beacon is a disc in which the robot measures its position. The flights of a plan are simulated with a beacon
at each of many places, in the same winds: robots that pass it correct their course, all others fly on. So the
value of a place is exact for the plan as it is; a plan that is made anew for a beacon is at least as good.
Further beacons are placed one after the other, each with those before it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import SeedSequence

from careful_io.machine import on_all_cores
from pareto_ltl.extend import (
    DrawnFlights,
    FailureRate,
    PlannedPath,
    Problem,
    RobotConfig,
    draw_flights,
    which_fail,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.seeds import unspawned

ALONG = 48  # places along the path
ASIDE = (0.0, -0.8, 0.8, -1.6, 1.6)  # standard deviations to the left of the path of the places at a step
SHORTLIST = 8  # best places that are compared again, since the best of 200 is partly the luckiest
AGAIN = 10_000  # other flights that compare them
FRESH = 20_000  # flights that judge the best place


@dataclass(frozen=True, slots=True)
class BeaconPlaces:
    """Places that are tried, ``at`` (N, 2) [m].

    ``step`` (N,) is the step at which the plan passes, ``aside`` (N,) the distance left of the path [m].
    """

    at: FloatArray
    step: IntArray
    aside: FloatArray

    def __len__(self) -> int:
        return len(self.at)


@dataclass(frozen=True, slots=True)
class BeaconSite:
    """The best place for a further beacon.

    Attributes
    ----------
    number : int
        Number of the place.
    rate : FailureRate
        Failure rate with this beacon and the ones before it, in fresh flights.
    saved : (float, float, float)
        Failures more (negative: fewer) than with those before it only, and the ends of its 95 % interval.
    """

    number: int
    rate: FailureRate
    saved: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class BeaconMap:
    """The value of a beacon at many places.

    Attributes
    ----------
    radius : float
        Radius of the beacons [m].
    without : FailureRate
        Failure rate of the plan without new beacons, in the fresh flights.
    failure : (N,) float
        Failure rate with one beacon at each of ``places``, and ``flights`` common flights.
    sites : tuple of BeaconSite
        The best places for one, two, ... beacons.
    """

    radius: float
    places: BeaconPlaces
    without: FailureRate
    failure: FloatArray
    flights: int
    sites: tuple[BeaconSite, ...]

    @classmethod
    def of(
        cls, problem: Problem, robot: RobotConfig, path: PlannedPath, radius: float, number: int,
        flights: int, seed: SeedSequence,
    ) -> BeaconMap:  # fmt: skip
        """Try beacons of ``radius`` [m] along and beside ``path``, and place ``number`` of them.

        ``robot`` has the error of a fix (``fix_sd``). The best places in ``flights`` common flights are
        compared again in others, and the best of them is judged in fresh ones.

        Raises
        ------
        ConfigError
            If the robot of these settings takes no position fixes.
        """
        places = beacon_places(problem, path, radius)
        search, judge, again = unspawned(seed).spawn(3)
        placed = np.empty((0, 2))
        marked = problem.with_beacons(robot, places.at[:1], radius)
        drawn, others = (
            draw_flights(marked, problem.fidelity.law, runs, child)
            for runs, child in ((flights, search), (AGAIN, again))
        )
        before = which_fail(problem, [path], FRESH, judge)[0]
        law, first, sites = problem.fidelity.law, np.empty(0), list[BeaconSite]()
        without = FailureRate.counted(law, int(before.sum()), FRESH)
        for _ in range(number):
            rates = tried(problem, robot, path, places.at, drawn, placed, radius)
            first = rates if not len(first) else first
            short = np.argsort(rates, kind="stable")[:SHORTLIST]
            best = short[np.argmin(tried(problem, robot, path, places.at[short], others, placed, radius))]
            placed = np.vstack([placed, places.at[best]])
            marked = problem.with_beacons(robot, placed, radius)
            failed = which_fail(marked, [path], FRESH, judge)[0]
            rate = FailureRate.counted(law, int(failed.sum()), FRESH)
            sites.append(BeaconSite(int(best), rate, paired_difference(before, failed)))
            before = failed
        return cls(radius, places, without, first, flights, tuple(sites))


def beacon_places(problem: Problem, path: PlannedPath, radius: float) -> BeaconPlaces:
    """Places on the path, evenly, and beside it where a beacon would cover other flights; all on the map."""
    steps = np.unique(np.linspace(1, len(path.u), ALONG).round().astype(int))
    along = path.x[np.minimum(steps + 1, len(path.u))] - path.x[steps - 1]
    left = (
        np.column_stack([-along[:, 1], along[:, 0]])
        / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    )
    across = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", left, path.cov[steps], left), 0.0))
    at, step, aside = [], [], []
    for share in ASIDE:
        gap = share * across
        use = np.abs(gap) >= 0.5 * radius if share else np.ones(len(steps), bool)
        at.append((path.x[steps] + gap[:, None] * left)[use])
        step.append(steps[use])
        aside.append(gap[use])
    points = np.vstack(at)
    low, high = problem.scene.bounds + radius * np.array([[1.0], [-1.0]])
    inside = ((points >= low) & (points <= high)).all(axis=1)
    return BeaconPlaces(points[inside], np.concatenate(step)[inside], np.concatenate(aside)[inside])


def tried(
    problem: Problem, robot: RobotConfig, path: PlannedPath, places: FloatArray, drawn: DrawnFlights,
    placed: FloatArray, radius: float,
) -> FloatArray:  # fmt: skip
    """Failure rates (N,) of the flights ``drawn`` with beacons at ``placed`` and one more at each place.

    ``places`` (N, 2) and ``placed`` (n, 2) [m].
    """

    def failed(at: FloatArray) -> BoolArray:
        whole = problem.with_beacons(robot, np.vstack([placed, at]), radius)
        own = replace(drawn, problem=whole)
        return own.failed(own.flown(path.u, path.x))

    return np.array([rows.mean() for rows in on_all_cores(failed, places)])
