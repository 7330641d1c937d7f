"""Long paths: the search takes steps that are several times as long, its paths are flown in all steps.

The time of a search is proportional to the number of steps. A path of more than :data:`MANY` steps is
therefore refined in runs of several steps with one control each: in about :data:`LEGS` runs, none longer than
the share ``SHARE_OF_PLACE`` of the narrowest place, so that no flight passes a region between two of its
positions. The wind of a run is the wind of its middle, its gust the mean of the gusts of its
steps: the flights are the same. The paths are then polished once more, checked and judged in all steps.

Steps are merged in the coherent law only, whose gusts are averaged over time, and for missions without time
windows, which are read at the steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest
from pareto_ltl.planning.refine.pacing import retimed_means
from pareto_ltl.planning.refine.sampled import Candidate, divided, path_length
from pareto_ltl.planning.refine.starts import (
    Start,
    StartKind,
    line_starts,
    roadmap_starts,
    tree_starts,
    unlike_starts,
)
from pareto_ltl.planning.refine.sweep import FINE, Sweep
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.world.time_step import SHARE_OF_PLACE, narrowest_place

MANY = 200  # steps of the shortest start, above which steps are merged
LEGS = 100  # runs of steps that it then has, about
SOLVES = 4  # of the last polish in all steps


def steps_to_merge(problem: Problem, starts: Iterable[Start]) -> int:
    """How many steps of ``problem`` are one step of the search from ``starts``; 1 if they are not merged."""
    fewest = min((len(start.x) - 1 for start in starts), default=0)
    law = problem.world.law
    still = bool((problem.motion.a == np.eye(2)).all())
    if fewest <= MANY or isinstance(law, kd.IndependentLaw) or len(problem.logic.delta) > 1 or not still:
        return 1
    marks = (
        [2.0 * float(radius) for radius in law.landmarks.disc[:, 2]]
        if isinstance(law, kd.LandmarkLaw)
        else []
    )
    width = min([narrowest_place(problem.scene).width, *marks])
    return max(1, min(round(fewest / LEGS), int(SHARE_OF_PLACE * width / problem.reach)))


def with_merged_steps(problem: Problem, times: int) -> Problem:
    """``problem`` in steps that are ``times`` as long; a rest of the known wind is left out."""
    laws = {name: _merged_law(law, times) for name, law in problem.laws.items()}
    world = problem.world._replace(law=laws[problem.fidelity.law])
    return replace(problem, laws=laws, world=world, max_steps=problem.max_steps // times)


def _merged_law(law: kd.Law, times: int) -> kd.Law:
    wind, motion = merged_wind(law.wind, times), merged_motion(law.motion, times)
    if isinstance(law, kd.IndependentLaw):
        return law._replace(wind=wind, motion=motion)
    modes = merged_modes(law.modes, times)
    if isinstance(law, kd.CoherentLaw):
        return law._replace(wind=wind, modes=modes, motion=motion)
    marks = law.landmarks._replace(gain=_merged_gain(law.landmarks.gain, times))
    return law._replace(wind=wind, modes=modes, motion=motion, landmarks=marks)


def merged_wind(wind: kd.Wind, times: int) -> kd.Wind:
    """The wind in the middle of each run of ``times`` steps."""
    middle = _middles(len(wind.slot), times)
    return wind._replace(
        slot=wind.slot[middle], weight=wind.weight[middle], between=np.ascontiguousarray(wind.between[middle])
    )


def merged_modes(modes: kd.Modes, times: int) -> kd.Modes:
    """The modes in the middle of each run; epochs keep their numbers."""
    middle = _middles(len(modes.slot), times)
    keep = _kept_between(modes.keep, middle)
    return modes._replace(
        slot=modes.slot[middle], epoch=modes.epoch[middle], keep=keep,
        kept=keep[:, modes.part].astype(np.float32), scale=np.ascontiguousarray(modes.scale[middle]),
        white=modes.white / times, rest=modes.rest / times,
    )  # fmt: skip


def merged_motion(motion: kd.Motion, times: int) -> kd.Motion:
    """The motion in one step of ``times`` steps: K' = 1 - (1 - K)^times, and φ' = K' T / dt'."""
    gain = _merged_gain(motion.gain, times)
    exposed = gain * motion.exposed / (motion.gain * times) if motion.gain > 0.0 else 1.0
    return motion._replace(
        dt=motion.dt * times, gain=gain, exposed=exposed, closed=motion.a - gain * np.eye(2)
    )


def merged_draws(white: FloatArray, times: int) -> FloatArray:
    """The draws (T // times, n, 2) whose winds are the means of runs of ``white`` (T, n, 2)."""
    runs = len(white) // times
    grouped = white[: runs * times].reshape(runs, times, *white.shape[1:])
    return np.asarray(grouped.sum(axis=1) / math.sqrt(times), float)


def starts_in_merged_steps(
    problem: Problem, merged: Problem, forest: Forest, times: int
) -> dict[StartKind, Start]:
    """The starts of ``merged``: its lines, and tree paths at every ``times``-th step and at the last one."""
    grown = [
        replace(start, x=np.vstack([start.x[:-1:times], start.x[-1:]]))
        for start in tree_starts(problem, forest)
    ]
    return unlike_starts(merged, [*line_starts(merged), *roadmap_starts(merged), *grown])


def in_all_steps(sweep: Sweep, times: int, ended: tuple[Candidate, Candidate]) -> tuple[Candidate, Candidate]:
    """A path before and after its last solve in all steps: straight runs, the last one polished.

    The polish is left out if a segment then breaks epsilon.
    """
    begun, end = (_divided(sweep, times, k) for k in ended)
    how = sweep.polish_of(FINE[-1:], SOLVES)
    flight = sweep.refiner.polished(end.flight.x, sweep.flights, how, end.length)
    if sweep.closing.penalty(flight, math.inf) <= 0.0:
        end = replace(end, flight=flight, length=path_length(flight.x))
    return begun, end


def slower_runs(sweep: Sweep, times: int, k: Candidate) -> Iterator[Candidate]:
    """``k`` in all steps, polished with one run of steps more and with two; without its chance constraints.

    The convex programme of :func:`~.last_polish.closed` needs 8 GiB for 1,300 steps.
    """
    for more in (times, 2 * times):
        x = retimed_means(sweep.problem, k.flight.x, min(k.steps + more, sweep.problem.horizon))
        flight = sweep.refiner.polished(x, sweep.flights, sweep.polish_of(FINE[-1:], SOLVES), k.length)
        yield replace(k, flight=flight, length=path_length(flight.x))


def _divided(sweep: Sweep, times: int, k: Candidate) -> Candidate:
    flight = sweep.refiner.flown(divided(k.flight.x, times))
    return replace(k, flight=flight, length=path_length(flight.x), kind=None)


def _middles(steps: int, times: int) -> IntArray:
    return times * np.arange(steps // times) + times // 2


def _merged_gain(gain: float, times: int) -> float:
    return 1.0 - (1.0 - gain) ** times


def _kept_between(keep: FloatArray, at: IntArray) -> FloatArray:
    """What θ keeps from each of the steps ``at`` to the next, (len(at) + 1, G); row 0: up to the first."""
    ends = [0, *(at + 1).tolist(), len(keep)]
    return np.array([keep[i:j].prod(axis=0) for i, j in pairwise(ends)])
