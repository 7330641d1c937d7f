"""How long legs take at full airspeed, as in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from pareto_ltl.kernels.pacing import LEAST, SLOWEST, fill_leg_times
from pareto_ltl.planning.wind_lookup import wind_and_gradient
from problems import KM, box, make_problem, make_scene, smooth_wind


def leg_times(problem, cap, x):
    """Eq. (M57) for all legs at once."""
    motion, leg = problem.motion, np.diff(x, axis=0)
    wind, _ = wind_and_gradient(problem.wind, x[:-1])
    length = np.linalg.norm(leg, axis=1)
    along = np.einsum("ti,ti->t", leg, wind) / np.maximum(length, LEAST)
    across = np.maximum((wind**2).sum(axis=1) - along**2, 0.0)
    speed = along + np.sqrt(np.maximum((cap * motion.u_max) ** 2 - across, 0.0))
    return length / (motion.dt * np.maximum(speed, SLOWEST * motion.u_max))


@pytest.mark.parametrize("speed", [0.0, 6.0, 40.0])  # calm, usual, and faster than the robot
def test_times_of_legs_are_as_in_numpy(speed):
    scene = make_scene({"a": box(13, 2, 17, 6)}, [], start=(2.0, 3.0))
    problem = make_problem("F a", scene, smooth_wind(scene, speed=speed))
    rng = np.random.default_rng(4)
    x = rng.uniform(-2.0, 22.0, (3 * len(problem.wind.slot), 2)) * KM  # also off the map, and after the wind
    x[7] = x[6]  # a leg of no length
    needed = np.empty(len(x) - 1)
    fill_leg_times(problem.wind, problem.motion, 0.98, x, needed)
    np.testing.assert_allclose(needed, leg_times(problem, 0.98, x), rtol=1e-10)
    assert needed[6] == 0.0
