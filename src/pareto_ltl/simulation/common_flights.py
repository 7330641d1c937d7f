"""Flights in winds that are drawn once, to compare or improve plans in the same winds."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from careful_io.machine import on_all_cores
from pareto_ltl.kernels import flight as kernel
from pareto_ltl.kernels.path import Flight
from pareto_ltl.kernels.pilots import Autopilot, RejoiningPilot
from pareto_ltl.planning.evaluate import takes_fixes
from pareto_ltl.planning.power import EnergyModel
from pareto_ltl.planning.problem import Problem, merged_draws
from pareto_ltl.planning.refine.sampled import deviations_from
from pareto_ltl.simulation import flights as sim
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.simulation.robot_errors import draw_errors, erring_pilot
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pareto_ltl.support.seeds import later_child, unspawned


@dataclass(frozen=True, slots=True)
class DrawnFlights:
    """Flights of one wind ``law``, drawn for up to the longest plan.

    Attributes
    ----------
    noise : (T+1, n, 2) float
        Standard normal draws for the errors of position fixes; no rows without landmarks.
    errors : (n, Q) float
        Coefficients κ of the robot's own errors; Q = 0 for a robot without them.
    start : (n, 2) float
        Deviations of the start [m].
    draws : kernel.Draws
    linearised : bool
        Whether deviations follow the linearised law, for a search that flies thousands of times. On phi2 they
        differ by a tenth of their size from deviations in the nonlinear winds, and failure rates by 0 to 4 %
        of the rate.
    """

    problem: Problem
    law: str
    noise: FloatArray
    errors: FloatArray
    start: FloatArray
    draws: Any
    linearised: bool = False

    def __len__(self) -> int:
        return len(self.start)

    def positions(self, flight: Flight) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls of ``flight``, whatever energy they take."""
        return self._flown_by(self._pilot(flight.u, flight.x), flight.x, None, self._winds_about(flight))

    def flown(self, u: FloatArray, mean: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2) along the means ``mean`` (T+1, 2)."""
        return self._flown_by(self._pilot(u, mean), mean, self.problem.energy, self.draws)

    def deviations(self, flight: Flight) -> FloatArray:
        """Deviations (T+1, 2, n) [m] of :meth:`positions` from the means of ``flight``.

        Linearised flights of robots that do not correct their course follow the law of ``flight`` itself.
        """
        drawn, motion, T = self.draws, self.problem.motion, len(flight.u)
        linear = self.linearised and isinstance(drawn, kernel.CoherentDraws) and motion.gain == 0.0
        if not linear or takes_fixes(flight):
            return deviations_from(self.positions(flight), flight.x)
        off, errors = np.empty((T + 1, 2, len(self))), flight.errors
        off[0] = self.start.T
        along = kernel.LinearLaw(flight.F, flight.psi, np.sqrt(flight.white), errors.push, motion.dt)
        epoch = drawn.law.modes.epoch[:T]
        kernel.linear_deviations(along, epoch, drawn.white, drawn.theta, self.errors, off)
        return off

    def unaided(self, flight: Flight) -> FloatArray:
        """The deviations without position fixes."""
        pilot = self._autopilot(flight.u, flight.x)
        return deviations_from(self._flown_by(pilot, flight.x, None, self._winds_about(flight)), flight.x)

    def ended(self, flight: Flight) -> tuple[FloatArray, BoolArray]:
        """The deviations, and which flights of a robot that corrects its course lack energy (n,).

        Robots that do not correct it spend what the plan does, which is compared with the capacity later.
        """
        energy, pilot = self.problem.energy, self._pilot(flight.u, flight.x)
        capacity = None if energy is None else energy.capacity
        if not energy or not capacity or not sim.corrects(self.problem.motion, pilot):
            return self.deviations(flight), np.zeros(len(self), bool)
        endless, x = replace(energy, capacity=sys.float_info.max), self._begun(flight.x)
        tank = sim.fly_draws(self.problem, self._winds_about(flight), pilot, x, endless)
        return deviations_from(x, flight.x), np.asarray(tank.spent > capacity, bool)

    def _winds_about(self, flight: Flight) -> Any:
        """The winds of these flights if they fly the controls of ``flight``.

        Linearised coherent winds are linear in the distance from its path, with the controls of the pilot:
        Eq. (M22) of docs/mathematics.md.
        """
        drawn, motion, T = self.draws, self.problem.motion, len(flight.u)
        if not self.linearised or not isinstance(drawn, kernel.CoherentDraws):
            return drawn
        expected = (flight.free - flight.x[:-1] @ motion.a.T) / motion.dt
        wind = np.repeat(expected[:, None], len(self), axis=1)
        epoch = drawn.law.modes.epoch[:T]
        kernel.winds_at_means(flight.psi, np.sqrt(flight.white), epoch, drawn.white, drawn.theta, wind)
        slope = (flight.F - motion.closed) / (motion.exposed * motion.dt)
        return kernel.LinearDraws(np.ascontiguousarray(flight.x), wind, slope)

    def held(self, u: FloatArray, mean: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2) along ``mean`` without position fixes.

        A robot with feedback steers towards ``mean``.
        """
        pilot = self._autopilot(u, mean)
        return self._flown_by(pilot, mean, self.problem.energy, self.draws)

    def rejoining(self, u: FloatArray, change: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2) + ``change`` (T, n, 2) [m/s] by flight.

        Robots without feedback and without position fixes, except those that the change comes from.
        """
        own = self.problem.own_errors(self.law)
        pilot = erring_pilot(RejoiningPilot(u, change), u, own, self.errors, linear=self.linearised)
        return self._flown_by(pilot, np.zeros((len(u) + 1, 2)), self.problem.energy, self.draws)

    def _pilot(self, u: FloatArray, mean: FloatArray) -> Any:
        maker = sim.pilot_maker(self.problem, u, mean, self.law, linear=self.linearised)
        return maker(self.noise, self.errors)

    def _autopilot(self, u: FloatArray, mean: FloatArray) -> Any:
        """The pilot of robots that take no fixes."""
        pilot, own = Autopilot(u, np.ascontiguousarray(mean)), self.problem.own_errors(self.law)
        return erring_pilot(pilot, u, own, self.errors, linear=self.linearised)

    def _flown_by(self, pilot: Any, mean: FloatArray, energy: EnergyModel | None, draws: Any) -> FloatArray:
        x = self._begun(mean)
        sim.fly_draws(self.problem, draws, pilot, x, energy)
        return x

    def _begun(self, mean: FloatArray) -> FloatArray:
        """Memory for the positions (n, T+1, 2) along ``mean`` (T+1, 2) [m]; the start is filled."""
        x = np.empty((len(self), len(mean), 2))
        x[:, 0] = self.problem.scene.start + self.start
        return x

    def failed(self, x: FloatArray) -> BoolArray:
        """Which of the flights ``x`` (n, T+1, 2) fail."""
        return Deployment.judged(self.problem, self.law, x).failed

    def linear(self) -> DrawnFlights:
        """The same flights in the linearised law."""
        return replace(self, linearised=True)

    def exact(self) -> DrawnFlights:
        """The same flights in the law itself."""
        return replace(self, linearised=False)

    def only(self, rows: IntArray) -> DrawnFlights:
        """The flights of ``rows``, ascending."""
        if len(rows) == len(self):
            return self
        draws = self.draws._replace(white=np.ascontiguousarray(self.draws.white[:, rows]))
        if hasattr(draws, "theta"):
            draws = draws._replace(theta=np.ascontiguousarray(self.draws.theta[:, rows]))
        noise = np.ascontiguousarray(self.noise[:, rows])
        return replace(self, noise=noise, errors=self.errors[rows], start=self.start[rows], draws=draws)

    def later(
        self, problem: Problem, step: int, x: FloatArray, errors: FloatArray, theta: Float32Array
    ) -> DrawnFlights:
        """The same flights from ``step`` on, where they are at ``x`` (n, 2) [m], as flights of ``problem``.

        ``errors`` (n, Q) and ``theta`` (E, n, 2, P) are their coefficients in its coherent law.
        """
        white = np.ascontiguousarray(self.draws.white[step : step + problem.horizon])
        draws = self.draws._replace(law=problem.laws[self.law], white=white, theta=theta)
        return replace(
            self, problem=problem, noise=np.empty((0, len(x), 2)), errors=errors,
            start=x - problem.scene.start, draws=draws,
        )  # fmt: skip

    def merged(self, problem: Problem, times: int) -> DrawnFlights:
        """The same flights in ``problem``, whose steps are ``times`` as long, in the coherent law."""
        white = merged_draws(self.draws.white, times)
        draws = self.draws._replace(law=problem.laws[self.law], white=white)
        return replace(self, problem=problem, noise=np.ascontiguousarray(self.noise[::times]), draws=draws)


def draw_flights(problem: Problem, law: str, runs: int, seed: SeedSequence) -> DrawnFlights:
    """Draw the winds of ``runs`` flights for as many steps as any plan may have.

    Flights are drawn block by block, so that the whole blocks of fewer flights are the first of more.
    """
    wind, start, fixes = unspawned(seed).spawn(3)
    blocks = sim.block_rows(runs)

    def drawn_block(rows: slice, child: SeedSequence) -> Any:
        return sim.DRAWS[law](problem, rows.stop - rows.start, problem.horizon, np.random.default_rng(child))

    parts = on_all_cores(drawn_block, blocks, wind.spawn(len(blocks)))
    drawn = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=1) for name in parts[0]._fields[1:]
    }
    draws = parts[0]._replace(**drawn)
    noise, errors = [], []
    for rows, child in zip(blocks, fixes.spawn(len(blocks)), strict=True):
        n = rows.stop - rows.start
        noise.append(sim.fix_noise(problem, n, problem.horizon, child))
        errors.append(draw_errors(problem, law, n, later_child(child, sim.OWN_ERRORS)))
    off = math.sqrt(problem.start_variance) * np.random.default_rng(start).standard_normal((runs, 2))
    own = np.concatenate(errors)
    off += own @ problem.own_errors(law).start.T
    return DrawnFlights(problem, law, np.concatenate(noise, axis=1), own, off, draws)


def draw_mirrored(problem: Problem, law: str, runs: int, seed: SeedSequence) -> DrawnFlights:
    """Draw every second flight of ``runs``; the flight after it has all errors with the opposite sign.

    Both have the law of flights (antithetic variates, Hammersley and Morton, 1956,
    doi:10.1017/S0305004100031455): a path is not moved aside because by chance more of them err to the left
    than to the right. They are no independent sample: rates in them have no binomial error.
    """
    drawn = draw_flights(problem, law, -(-runs // 2), seed)
    draws = {name: _with_mirrored(getattr(drawn.draws, name), 1, runs) for name in drawn.draws._fields[1:]}
    return replace(
        drawn, noise=_with_mirrored(drawn.noise, 1, runs), errors=_with_mirrored(drawn.errors, 0, runs),
        start=_with_mirrored(drawn.start, 0, runs), draws=drawn.draws._replace(**draws),
    )  # fmt: skip


def _with_mirrored(drawn: FloatArray, axis: int, runs: int) -> FloatArray:
    """``drawn`` with -``drawn`` in turn along ``axis``, in ``runs`` rows."""
    both = np.repeat(drawn, 2, axis=axis)
    rows = np.moveaxis(both, axis, 0)
    rows[1::2] *= -1.0
    return np.ascontiguousarray(np.moveaxis(rows[:runs], 0, axis))


def is_certain(problem: Problem) -> bool:
    """Whether every flight is the same: a start and a wind that are known exactly."""
    if problem.start_variance > 0.0 or problem.wind.gust.any() or problem.wind.between.any():
        return False
    own = problem.own_errors(problem.fidelity.law)
    if own.root.any() or own.start.any():
        return False
    return not problem.wind.latent.any() and problem.modes.psi.shape[-1] == 0
