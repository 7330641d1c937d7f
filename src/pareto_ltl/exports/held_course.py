"""Failure rate of a plan if an autopilot holds its positions, instead of its headings and airspeeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels import flight as kernel
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import FailureRate, PlannedPath, counted_rate
from pareto_ltl.simulation.flights import fly_pilot

GAIN = 1.0  # robot.feedback of an autopilot that holds positions: it returns to the course in one step


def held_course_rate(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FailureRate:
    """The rate of ``runs`` flights with ``robot.feedback = 1``, within the airspeeds of the robot."""
    motion = problem.motion._replace(gain=GAIN, closed=problem.motion.a - GAIN * np.eye(2))
    world = problem.world._replace(law=problem.world.law._replace(motion=motion))
    held = replace(problem, world=world)
    pilot = kernel.Autopilot(path.u, np.ascontiguousarray(path.x))
    law = problem.fidelity.law
    flown = fly_pilot(held, lambda _count, _rng: pilot, len(path.u), runs, law, seed)
    return counted_rate(law, int(flown.failed.sum()), runs)
