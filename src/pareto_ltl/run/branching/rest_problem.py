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

from pareto_ltl.kernels import data as kd
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.planning.conditioning import Joint, Learnt
from pareto_ltl.planning.costs import costs_with
from pareto_ltl.planning.pack import build_problem
from pareto_ltl.planning.problem import Problem
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.common_flights import DrawnFlights
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from wind_laws.conditioned import less_doubt, persistence, with_held_slots


@dataclass(frozen=True, slots=True)
class World:
    """What a run knows: the records that problems are built from."""

    settings: Settings
    problem: Problem
    wind: WindField
    cells: Decomposition
    automaton: Automaton


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
    """The rest of a flight from ``step`` on: its problem, and the law that its flights are taken from."""

    problem: Problem
    field: WindField
    learnt: Learnt
    step: int

    def flights(self, winds: DrawnFlights, x: FloatArray, countered: Countered | None = None) -> DrawnFlights:
        """The flights ``winds``, which are at ``x`` (n, 2) [m] at the step, as flights of the rest.

        They have the winds and errors that they have been drawn with, less what is ``countered``.
        """
        problem, k = self.problem, self.step
        law = problem.own_errors(winds.law)
        errors = winds.errors if countered is None else winds.errors - countered.errors
        if len(law.mean):
            before = winds.problem.own_errors(winds.law)
            own = before.mean + errors @ before.root.T
            errors = (own - law.mean) @ np.linalg.pinv(law.root, rcond=1e-9).T
        steps = problem.horizon
        white = np.ascontiguousarray(winds.draws.white[k : k + steps])
        theta = self._whitened(winds, countered)
        draws = winds.draws._replace(law=problem.laws[winds.law], white=white, theta=theta)
        return replace(
            winds, problem=problem, noise=np.empty((0, len(x), 2)), errors=errors,
            start=x - problem.scene.start, draws=draws,
        )  # fmt: skip

    def _whitened(self, winds: DrawnFlights, countered: Countered | None = None) -> Float32Array:
        """θ in the modes of the conditioned wind: (I - R B' B R)^-½ (θ - R m) in each epoch.

        m is what is learnt, and of each flight what is countered.
        """
        modes, old = self.problem.modes, winds.problem.modes
        steps = self.problem.horizon
        epochs, first = np.unique(modes.epoch[:steps], return_index=True)
        shape = (int(epochs.max(initial=0)) + 1, *winds.draws.theta.shape[1:])
        found = np.zeros(shape, np.float32)
        slot = int(np.argmin(np.abs(self.field.times)))
        rho = persistence(self.field, float(self.field.times[slot]))
        for epoch, n in zip(epochs.tolist(), first.tolist(), strict=True):
            theta = winds.draws.theta[old.epoch[self.step + n]]
            if not len(self.learnt.told):
                found[epoch] = theta
                continue
            share = rho[modes.slot[n]]
            for c in (0, 1):
                root, known = less_doubt(self.learnt.told[:, c] * share), self.learnt.theta[c]
                if countered is not None:
                    known = known + countered.theta[:, c]
                found[epoch, :, c] = np.linalg.solve(root, (theta[:, c] - share * known).T).T
        return found


def rest_of_flight(world: World, learnt: Learnt, step: int, state: int, reserve: float = 0.0) -> Rest:
    """The rest of the flight from ``step`` on, at automaton ``state``, given what is ``learnt``.

    It leaves ``reserve`` [m/s] of the largest airspeed, at most half of it, for what robots add.

    Raises
    ------
    DataError
        If the wind is not known for the rest.
    """
    settings, whole = world.settings, world.problem
    u_max = max(settings.robot.u_max - reserve, 0.5 * (settings.robot.u_min + settings.robot.u_max))
    moment = step * whole.motion.dt
    field = with_held_slots(world.wind.later(moment))
    scene = replace(world.problem.scene.later(moment, learnt.mean), landmarks=(), landmark_fixes=())
    problem = build_problem(
        replace(settings.robot, dt=whole.motion.dt, u_max=u_max),
        replace(settings.planner, max_steps=settings.planner.max_steps - step),
        settings.wind,
        scene,
        world.wind.later(moment).given(learnt.theta, learnt.told) if len(learnt.told) else field,
        world.cells,
        world.automaton.after(state, moment),
        settings.fidelity,
    )
    errors = own_errors(learnt)
    laws: dict[str, kd.Law] = {
        name: law if isinstance(law, kd.IndependentLaw) else law._replace(errors=errors)
        for name, law in problem.laws.items()
    }
    known = errors.start @ errors.start.T
    spread = float(np.linalg.eigvalsh(learnt.cov - known)[-1])
    problem = replace(
        problem, laws=laws, world=problem.world._replace(law=laws[settings.fidelity.law]),
        start_variance=max(spread, 0.0), costs=costs_with(settings.selection.costs),
        tail=None,  # the flights have their scales
    )  # fmt: skip
    return Rest(problem, field, learnt, step)


def own_errors(learnt: Learnt) -> kd.RobotErrors:
    """The law of the robot's own errors in the cell, with their covariance with the position."""
    if not len(learnt.errors):
        return kd.EXACT
    value, vector = np.linalg.eigh(learnt.errors_cov)
    root = vector * np.sqrt(np.maximum(value, 1e-12 * max(float(value.max()), 1e-30)))
    _, upper = np.linalg.qr(root.T)  # a lower triangular root: root root' = R' R
    lower = upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    start = np.linalg.solve(lower, learnt.shared.T).T
    return kd.RobotErrors(learnt.errors, np.ascontiguousarray(lower), np.ascontiguousarray(start))
