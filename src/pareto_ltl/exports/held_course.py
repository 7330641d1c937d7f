"""How often a plan fails where an autopilot holds its positions, instead of its headings and airspeeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels import flight as kernel
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import FailureRate, PlannedPath
from pareto_ltl.simulation.flights import (
    block_rows,
    counted_rate,
    draw_block,
    fly_block,
    judge_flights,
    unspawned,
)

GAIN = 1.0  # robot.feedback of an autopilot that holds a course by position: back on it in one step


def held_course_rate(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FailureRate:
    """The rate of ``runs`` flights with ``robot.feedback = 1``, within the airspeeds of the robot."""
    motion = problem.motion._replace(gain=GAIN, closed=problem.motion.a - GAIN * np.eye(2))
    law = problem.world.law._replace(motion=motion)
    held = replace(problem, world=problem.world._replace(law=law))
    pilot = kernel.Autopilot(path.u, np.ascontiguousarray(path.x))
    name, x = problem.fidelity.law, np.empty((runs, len(path.x), 2))
    blocks = block_rows(runs)
    for rows, child in zip(blocks, unspawned(seed).spawn(len(blocks)), strict=True):
        block = draw_block(held, name, rows.stop - rows.start, len(path.u), child)
        fly_block(held, block, lambda count, rng: pilot, x[rows])
    return counted_rate(name, int(judge_flights(held, name, x).failed.sum()), runs)


__all__ = ["GAIN", "held_course_rate"]
