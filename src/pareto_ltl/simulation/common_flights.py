"""Flights in winds that are drawn once, to compare or improve plans in the same winds."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels.path import Flight
from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.planning.power import EnergyModel
from pareto_ltl.planning.problem import Problem, merged_draws
from pareto_ltl.simulation import flights as sim
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.cores import cores


@dataclass(frozen=True, slots=True)
class DrawnFlights:
    """Flights of one wind ``law``, drawn for up to the longest plan.

    Attributes
    ----------
    noise : (T+1, n, 2) float
        Standard normal draws for the errors of position fixes; no rows without landmarks.
    start : (n, 2) float
        Deviations of the start [m].
    draws : kernels.flight.Draws
    """

    problem: Problem
    law: str
    noise: FloatArray
    start: FloatArray
    draws: Any

    def __len__(self) -> int:
        return len(self.start)

    def positions(self, flight: Flight) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls of ``flight``, whatever energy they take."""
        return self._flown_by(self._pilot(flight.u, flight.x), flight.x, None)

    def flown(self, u: FloatArray, mean: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2) along the means ``mean`` (T+1, 2)."""
        return self._flown_by(self._pilot(u, mean), mean, self.problem.energy)

    def unaided(self, flight: Flight) -> FloatArray:
        """The positions of :meth:`positions` without position fixes."""
        return self._flown_by(Autopilot(flight.u, np.ascontiguousarray(flight.x)), flight.x, None)

    def held(self, u: FloatArray, mean: FloatArray) -> FloatArray:
        """Positions (n, T+1, 2) [m] of the controls ``u`` (T, 2) along ``mean`` without position fixes.

        A robot with feedback steers towards ``mean``.
        """
        return self._flown_by(Autopilot(u, np.ascontiguousarray(mean)), mean, self.problem.energy)

    def _pilot(self, u: FloatArray, mean: FloatArray) -> Any:
        return sim.pilot_maker(self.problem, u, mean, self.law)(self.noise)

    def _flown_by(self, pilot: Any, mean: FloatArray, energy: EnergyModel | None) -> FloatArray:
        x = np.empty((len(self), len(mean), 2))
        x[:, 0] = self.problem.scene.start + self.start
        sim.fly_draws(self.problem, self.draws, pilot, x, energy)
        return x

    def failed(self, x: FloatArray) -> BoolArray:
        """Which of the flights ``x`` (n, T+1, 2) fail."""
        return sim.judge_flights(self.problem, self.law, x).failed

    def only(self, rows: IntArray) -> DrawnFlights:
        """The flights of ``rows``, ascending."""
        if len(rows) == len(self):
            return self
        draws = self.draws._replace(white=np.ascontiguousarray(self.draws.white[:, rows]))
        if hasattr(draws, "theta"):
            draws = draws._replace(theta=np.ascontiguousarray(self.draws.theta[:, rows]))
        noise = np.ascontiguousarray(self.noise[:, rows])
        return replace(self, noise=noise, start=self.start[rows], draws=draws)

    def merged(self, problem: Problem, times: int) -> DrawnFlights:
        """The same flights in ``problem``, whose steps are ``times`` as long, in the coherent law."""
        white = merged_draws(self.draws.white, times)
        draws = self.draws._replace(law=problem.laws[self.law], white=white)
        return replace(self, problem=problem, noise=np.ascontiguousarray(self.noise[::times]), draws=draws)


def draw_flights(problem: Problem, law: str, runs: int, seed: SeedSequence) -> DrawnFlights:
    """Draw the winds of ``runs`` flights for as many steps as any plan may have.

    Flights are drawn block by block, so that the whole blocks of fewer flights are the first of more.
    """
    wind, start, fixes = seed.spawn(3)
    blocks = sim.block_rows(runs)

    def drawn_block(rows: slice, child: SeedSequence) -> Any:
        return sim.DRAWS[law](problem, rows.stop - rows.start, problem.horizon, np.random.default_rng(child))

    with ThreadPoolExecutor(cores()) as pool:
        parts = list(pool.map(drawn_block, blocks, wind.spawn(len(blocks))))
    drawn = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=1) for name in parts[0]._fields[1:]
    }
    draws = parts[0]._replace(**drawn)
    off = math.sqrt(problem.start_variance) * np.random.default_rng(start).standard_normal((runs, 2))
    return DrawnFlights(problem, law, sim.fix_noise(problem, runs, problem.horizon, fixes), off, draws)


def is_certain(problem: Problem) -> bool:
    """Whether every flight is the same: a start and a wind that are known exactly."""
    if problem.start_variance > 0.0 or problem.wind.gust.any() or problem.wind.between.any():
        return False
    return not problem.wind.latent.any() and problem.modes.psi.shape[-1] == 0
