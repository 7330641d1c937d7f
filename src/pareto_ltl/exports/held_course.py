"""Failure rate of a plan if an autopilot holds its positions, instead of its headings and airspeeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.planning.pack import with_feedback
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import FailureRate, PlannedPath, counted_rate
from pareto_ltl.simulation.flights import fly_pilot

HELD_TIME = 60.0  # robot.feedback_time of an autopilot that holds positions [s]


def held_problem(problem: Problem) -> Problem:
    """``problem`` for a robot that always knows its position (``robot.feedback_time=60``)."""
    motion = with_feedback(problem.motion, HELD_TIME)
    return replace(problem, world=problem.world._replace(law=problem.world.law._replace(motion=motion)))


def held_course_rate(problem: Problem, path: PlannedPath, runs: int, seed: SeedSequence) -> FailureRate:
    """The rate of ``runs`` flights with ``robot.feedback_time=60``, within the airspeeds of the robot."""
    held = held_problem(problem)
    pilot = Autopilot(path.u, np.ascontiguousarray(path.x))
    law = problem.fidelity.law
    flown = fly_pilot(held, lambda _noise: pilot, len(path.u), runs, law, seed)
    return counted_rate(law, int(flown.failed.sum()), runs)
