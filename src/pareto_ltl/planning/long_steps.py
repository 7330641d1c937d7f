"""A problem in steps that are several times as long, and the same winds in them.

A run of steps has the wind of its middle, and the mean of the gusts of its steps.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray, IntArray


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


def _middles(steps: int, times: int) -> IntArray:
    return times * np.arange(steps // times) + times // 2


def _merged_gain(gain: float, times: int) -> float:
    return 1.0 - (1.0 - gain) ** times


def _kept_between(keep: FloatArray, at: IntArray) -> FloatArray:
    """What θ keeps from each of the steps ``at`` to the next, (len(at) + 1, G); row 0: up to the first."""
    ends = [0, *(at + 1).tolist(), len(keep)]
    return np.array([keep[i:j].prod(axis=0) for i, j in pairwise(ends)])
