"""The problem of one branch: the rest of the flight from a cell, and the flights in the cell as its flights.

The problem starts at the expected position of the flights in the cell, in the wind conditioned on the cell,
with the remaining mission. Its law neglects the covariance of position and wind, which a cell leaves; its
*flights* do not: they are the flights of the whole plan that fall into the cell, with the position, the wind
and the own errors that each of them has. Searches minimise the failures of these flights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pareto_ltl import Run, WindField
from pareto_ltl.extend import DrawnFlights, Problem, build_problem
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray
from pareto_ltl_apps.conditioning import Joint, Learnt


class Countered(NamedTuple):
    """What robots that counter the drift of their measured positions expect of it.

    E[θ | y] (n, 2, P), and E[κ | y] (n, Q) of the standardised coefficients of the errors of the robots.
    """

    theta: FloatArray
    errors: FloatArray

    @classmethod
    def of(cls, prior: Joint, sd: float, off: FloatArray) -> Countered:
        """At the measured y - x = ``off`` (n, 2) [m] of one fix with the error ``sd`` [m]."""
        weight = off @ np.linalg.inv(prior.among + sd**2 * np.eye(2))
        return cls(np.einsum("nr,rcm->ncm", weight, prior.cross), weight @ prior.own)

    def only(self, rows: IntArray) -> Countered:
        """Of the robots ``rows``."""
        return Countered(self.theta[rows], self.errors[rows])


@dataclass(frozen=True, slots=True)
class Rest:
    """The rest of a flight from ``step`` on: its problem, what is learnt, and the wind without that."""

    problem: Problem
    wind: WindField
    learnt: Learnt
    step: int

    def flights(self, winds: DrawnFlights, x: FloatArray, countered: Countered | None = None) -> DrawnFlights:
        """The flights ``winds``, which are at ``x`` (n, 2) [m] at the step, as flights of the rest.

        They have the winds and errors that they have been drawn with, less what is ``countered``.
        """
        problem = self.problem
        law = problem.own_errors(winds.law)
        errors = winds.errors if countered is None else winds.errors - countered.errors
        if len(law.mean):
            before = winds.problem.own_errors(winds.law)
            own = before.mean + errors @ before.root.T
            errors = (own - law.mean) @ np.linalg.pinv(law.root, rcond=1e-9).T
        return winds.later(problem, self.step, x, errors, self._whitened(winds, countered))

    def _whitened(self, winds: DrawnFlights, countered: Countered | None = None) -> Float32Array:
        """θ in the modes of the conditioned wind, in each epoch, less what of each flight is countered."""
        modes, old = self.problem.modes, winds.problem.modes
        epochs, first = np.unique(modes.epoch[: self.problem.horizon], return_index=True)
        found = np.zeros((int(epochs.max(initial=0)) + 1, *winds.draws.theta.shape[1:]), np.float32)
        expected = self.learnt.theta if countered is None else self.learnt.theta + countered.theta
        theta = winds.draws.theta[old.epoch[self.step + first]]
        found[epochs] = self.wind.coefficients_given(theta, modes.slot[first], expected, self.learnt.told)
        return found


def rest_of_flight(run: Run, learnt: Learnt, step: int, state: int, reserve: float = 0.0) -> Rest:
    """The rest of the flight from ``step`` on, at automaton ``state``, given what is ``learnt``.

    It leaves ``reserve`` [m/s] of the largest airspeed, at most half of it, for what robots add.

    Raises
    ------
    DataError
        If the wind is not known for the rest.
    """
    settings, whole = run.settings, run.problem
    u_max = max(settings.robot.u_max - reserve, 0.5 * (settings.robot.u_min + settings.robot.u_max))
    moment = step * whole.motion.dt
    wind = run.wind.later(moment)
    scene = replace(whole.scene.later(moment, learnt.mean), landmarks=(), landmark_fixes=())
    problem = build_problem(
        replace(settings.robot, dt=whole.motion.dt, u_max=u_max),
        replace(settings.planner, max_steps=settings.planner.max_steps - step),
        settings.wind,
        scene,
        wind.given(learnt.theta, learnt.told),
        run.cells,
        run.automaton.after(state, moment),
        settings.fidelity,
    )
    problem = replace(learnt.start_of(problem), costs=whole.costs, tail=None)  # the flights have their scales
    return Rest(problem, wind, learnt, step)
