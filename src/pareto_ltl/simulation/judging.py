"""The front by flights (``fidelity.judge=flights``): the failure rate of every path, in the same winds.

All paths fly in the same winds (common random numbers), so that two paths are compared by the flights that
only one of them completes: their difference is known far better than either rate. The paths race: after 250,
500, ... flights, a path that is significantly worse than a shorter one is dropped. Of the trees' many paths,
those farthest behind the front are dropped as well; of refined ones they are not, since long paths that
rarely fail look like shorter ones until thousands of flights are flown.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, repeat
from typing import NamedTuple

import numpy as np
from numpy.random import SeedSequence

from careful_io.machine import on_all_cores, require_memory
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import Front, PlannedPath
from pareto_ltl.planning.selection import box_above, chance_of_failures, hypervolume, non_dominated
from pareto_ltl.planning.separation import keeps_epsilon
from pareto_ltl.simulation import flights as sim
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.seeds import unspawned

LOG = logging.getLogger(__name__)
RAW_DRAWS = 500  # flights of each path in the race among the trees' paths
LAST_LOOK = 1000  # flights for the message if every flight of every path fails
CROWD = 40  # paths of trees retained after each comparison, for each cost other than the failure rate
DROP_CHANCE = (
    1e-4  # probability, in one comparison, of dropping a path that is not worse than the shorter one
)
ENOUGH = 200  # failures of every path that is left, with which a race ends: its rates are known within 7 %
LEAST_FLIGHTS = 1000  # before it ends


def judge_front(
    problem: Problem,
    refined: Sequence[PlannedPath],
    raw: Sequence[PlannedPath],
    draws: int,
    seed: SeedSequence,
    *,
    strict: bool = True,
) -> Front:
    """The paths of ``raw`` and ``refined`` that are non-dominated in failure rate and costs.

    The trees' paths race among themselves first, in fewer flights: the remaining ones are the front before
    refinement, and those that satisfy ``planner.epsilon`` compete with the refined ones.

    Parameters
    ----------
    raw, refined : sequence of PlannedPath
        Paths of the trees, with R in its looser form, and refined paths. Bounds are not used here.
    draws : int
        Flights of every path that survives the race, in the winds of ``fidelity.law``; fewer if each of them
        fails ``ENOUGH`` times before.
    seed : SeedSequence
        Seed of the flights; the optimisation must use another one, or its paths look better than they are.
    strict : bool
        Refuse paths of which every flight fails; otherwise a warning says how they fail.

    Raises
    ------
    InfeasibleError
        If there is no path, a path lasts longer than the known wind, or ``strict`` and all flights of all
        paths fail.
    """
    if not refined and not raw:
        raise InfeasibleError("no path completes the mission; raise planner.n_max")
    trees = fly_race(problem, raw, min(draws, RAW_DRAWS), seed, CROWD)
    admitted = [flown.path for flown in trees if keeps_epsilon(problem, flown.path)]
    if not refined and not admitted:  # those that keep it lost the race to others that do not
        admitted = [path for path in raw if keeps_epsilon(problem, path)]
    race = race_among(problem, [*refined, *admitted], draws, seed, enough=ENOUGH)
    judged = race.flown
    if all(flown.failed.all() for flown in judged):
        _refuse_or_warn(_how_all_fail(problem, judged), strict)
    grown = {id(path) for path in raw}
    before, after = (
        [final_bound(problem, flown) if id(flown.path) in grown else flown for flown in unbeaten(paths)]
        for paths in (trees, judged)
    )
    law = problem.fidelity.law
    costs = np.array([list(path.objectives.costs.values()) for path in (*refined, *raw)])
    reference = np.array([1.0, *box_above(costs)])
    return Front(
        paths=tuple(flown.path for flown in after),
        raw=tuple(flown.path.objectives for flown in before),
        hypervolume=hypervolume(np.array([flown.row for flown in after]), reference),
        reference=reference,
        rates=tuple(flown.rate(law) for flown in after),
        raw_rates=tuple(flown.rate(law) for flown in before),
        failed=np.stack([flown.failed for flown in after]),
        models=problem.fidelity,
        judged=race.rows,
    )


def _refuse_or_warn(text: str, strict: bool) -> None:
    if strict:
        raise InfeasibleError(text)
    LOG.warning("%s", text)


def _how_all_fail(problem: Problem, judged: Sequence[Flown]) -> str:
    """Text for paths of which no flight succeeds: how the best path fails."""
    seed = SeedSequence(0)  # a text says the same about the same paths

    def outcome(path: PlannedPath) -> Deployment:
        return sim.simulate_flights(problem, path.u, LAST_LOOK, problem.fidelity.law, seed, path.x)

    def reached(flights: Deployment) -> float:
        return float(flights.accepted.mean() - flights.collided.mean() - flights.off_map.mean())

    path, flights = max(
        ((flown.path, outcome(flown.path)) for flown in judged), key=lambda row: reached(row[1])
    )
    parts = [f"{100 * (~flights.accepted).mean():.0f} % miss the mission"]
    parts += [f"{100 * flights.collided.mean():.0f} % touch an obstacle"]
    parts += [f"{100 * flights.off_map.mean():.0f} % leave the map"] if problem.scene.walled else []
    return (
        f"every path fails in all {len(judged[0].failed):,} flights in {problem.fidelity.law} winds; of "
        f"{LAST_LOOK:,} flights of the nearest ({path.order}, {path.objectives.length / 1e3:.1f} km), "
        f"{', '.join(parts)}: give the robot more airspeed (robot.u_max), position fixes "
        "(robot.feedback_time or landmarks on the map), or regions wider than its drift"
    )


@dataclass(frozen=True, slots=True)
class Flown:
    """A path that survives the race, and which of its flights ``failed`` (n,)."""

    path: PlannedPath
    failed: BoolArray

    @property
    def row(self) -> tuple[float, ...]:
        """Failure rate and all costs, the length [m] first."""
        return float(self.failed.mean()), *self.path.objectives.costs.values()

    def rate(self, law: str) -> FailureRate:
        """The failure rate with its interval."""
        return FailureRate.counted(law, int(self.failed.sum()), len(self.failed))


class Race(NamedTuple):
    """The paths that survive a race, and a row for every path of it.

    Attributes
    ----------
    flown : list of Flown
    rows : (P, 2 + C) float
        Number of flights of each path, how many of them fail, and all costs, the length [m] first.
    """

    flown: list[Flown]
    rows: FloatArray


def final_bound(problem: Problem, flown: Flown) -> Flown:
    """The same with R in its tighter form."""
    return replace(flown, path=evaluate_path(problem, flown.path.x, flown.path.origin))


def unbeaten(paths: Sequence[Flown]) -> list[Flown]:
    """The paths that are non-dominated in failure rate and costs, the safest first."""
    if not paths:
        return []
    undominated = non_dominated(np.array([flown.row for flown in paths]))
    return sorted(
        (flown for flown, keep in zip(paths, undominated, strict=True) if keep), key=lambda f: f.row
    )


# --- the race ---------------------------------------------------------------------------------


Failures = Callable[[int, Sequence[int]], BoolArray]


def race_of(
    problem: Problem, paths: Sequence[PlannedPath], runs: int, seed: SeedSequence
) -> tuple[list[slice], Failures]:
    """The blocks of ``runs`` flights, as in ``simulate_flights`` with the same seed, and who fails in them.

    The function takes the number of a block and the numbers of R ``paths``; it returns which flights of the
    block fail on each of these paths, (R, n).
    """
    for path in paths:
        sim.require_known_wind(problem, path.u, path.x)
    law, blocks, longest = problem.fidelity.law, sim.block_rows(runs), max(len(path.u) for path in paths)
    seeds = unspawned(seed).spawn(len(blocks))
    pilots = [sim.pilot_maker(problem, path.u, path.x, law) for path in paths]

    def failures(number: int, running: Sequence[int]) -> BoolArray:
        n = blocks[number].stop - blocks[number].start
        block = sim.draw_block(problem, law, n, longest, seeds[number])
        failed = np.empty((len(running), n), bool)
        for row, k in enumerate(running):
            x = np.empty((n, len(paths[k].x), 2))
            sim.fly_block(problem, block, pilots[k], x)
            failed[row] = Deployment.judged(problem, law, x).failed
        return failed

    return blocks, failures


def fly_race(
    problem: Problem, paths: Sequence[PlannedPath], draws: int, seed: SeedSequence, crowd: float = math.inf
) -> list[Flown]:
    """The paths that survive the race over ``draws`` flights; at most about ``crowd`` for each cost."""
    return race_among(problem, paths, draws, seed, crowd).flown


def race_among(
    problem: Problem, paths: Sequence[PlannedPath], draws: int, seed: SeedSequence, crowd: float = math.inf,
    enough: float = math.inf,
) -> Race:  # fmt: skip
    """The race of :func:`fly_race`, with the flights of those that do not survive it.

    It ends before all flights are flown if each path that is left has failed ``enough`` times.
    """
    if not paths:
        return Race([], np.zeros((0, 0)))
    require_memory(2.0 * len(paths), "selection.draws", draws, "flights that judge the front")
    blocks, failures = race_of(problem, paths, draws, seed)
    costs = np.array([list(path.objectives.costs.values()) for path in paths])
    running, failed = np.arange(len(paths)), np.zeros((len(paths), draws), bool)
    flights = np.zeros(len(paths))
    for numbers in looks(len(blocks)):
        flown = on_all_cores(failures, numbers, repeat(running.tolist()))
        for number, found in zip(numbers, flown, strict=True):
            failed[running, blocks[number]] = found
        flights[running] = end = blocks[numbers[-1]].stop
        seen = failed[running, :end]
        left = ~certainly_beaten(seen, costs[running])
        running = running[left][outermost(seen[left].mean(axis=1), costs[running[left]], crowd)]
        if end >= LEAST_FLIGHTS and failed[running].sum(axis=1).min() >= enough:
            break
    rows = np.column_stack([flights, failed.sum(axis=1), costs])
    return Race([Flown(paths[k], failed[k, :end]) for k in running.tolist()], rows)


def count_failures(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> int:
    """How many of ``runs`` flights of ``path`` fail, in the winds of ``fidelity.law``."""
    return int(which_fail(problem, [path], runs, seed).sum())


def which_fail(problem: Problem, paths: Sequence[PlannedPath], runs: int, seed: SeedSequence) -> BoolArray:
    """Which of ``runs`` flights of each of P ``paths`` fail, in the same winds of the law, (P, runs)."""
    blocks, failures = race_of(problem, paths, runs, seed)
    return np.concatenate(on_all_cores(failures, range(len(blocks)), repeat(range(len(paths)))), axis=1)


def looks(blocks: int) -> list[range]:
    """The blocks flown before each comparison of the paths; the number of flights doubles each time."""
    ends = [0, 1]
    while ends[-1] < blocks:
        ends.append(min(2 * ends[-1], blocks))
    return [range(begin, end) for begin, end in pairwise(ends)]


def outermost(rates: FloatArray, costs: FloatArray, crowd: float) -> BoolArray:
    """Which paths stay: whole fronts in their order, while they are at most ``crowd`` paths for each cost.

    The first front is the front of all paths, the second the front of all others, and so on (Goldberg,
    Genetic Algorithms in Search, Optimization and Machine Learning, 1989). The first front always stays.
    """
    import moocore

    layers = np.asarray(moocore.pareto_rank(np.column_stack([rates, costs])), int)
    sizes = np.cumsum(np.bincount(layers)) if len(layers) else np.zeros(0, int)
    return np.asarray(layers < max(1, int((sizes <= crowd * costs.shape[1]).sum())), bool)


def certainly_beaten(failed: BoolArray, costs: FloatArray) -> BoolArray:
    """Which paths fail significantly more often than one that costs no more.

    Each path is compared with the one with the fewest failures among those that cost no more.

    Parameters
    ----------
    failed : (P, n) bool
        The flights of each path that fail, in the same winds.
    costs : (P, c) float
        All costs, the length [m] first.
    """
    order = np.argsort(costs[:, 0], kind="stable")
    counts = failed.sum(axis=1)
    rivals = np.empty(len(order), int)
    for place, k in enumerate(order):
        before = order[: place + 1]
        before = before[(costs[before] <= costs[k]).all(axis=1)]
        rivals[k] = before[np.argmin(counts[before])]
    return np.asarray(chance_of_failures(failed, failed[rivals]) < DROP_CHANCE, bool)
