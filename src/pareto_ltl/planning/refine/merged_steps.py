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
