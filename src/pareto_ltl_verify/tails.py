"""The scale of wind errors, which differs from one new flight to another: they have tails.

In slot k the logarithm of the scale is Gaussian, with the variance s² = s_f² + s_k² and the mean -s², so that
the mean square of the scale is 1. Its part s_f lasts for the flight; the other one is renewed from slot to
slot. Changes of the wind in time have another scale, which lasts for the flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.laws import Coherent, Law
from pareto_ltl_verify.wind_tables import HELD, OF_FORECASTS, TIME


@dataclass(frozen=True, slots=True)
class Scales:
    """The scales (runs,) of flights: of forecasts by slot, and of changes; None for errors without tails."""

    forecasts: Mapping[int, FloatArray] = field(default_factory=dict)
    change: FloatArray | None = None

    def typical(self, runs: int) -> FloatArray:
        """About how many times as large as without tails the deviations of the flights are, (runs,)."""
        if self.forecasts:
            return np.asarray(np.mean(list(self.forecasts.values()), axis=0), float)
        return np.ones(runs) if self.change is None else self.change


SHIFTS = np.array([0.0, 1.0, 2.0, 3.0])  # of as many equal parts of the weighted flights [sd]
SHIFTED = float(len(SHIFTS))  # at most so much larger is a weight


class ScaleDraws:
    """A source of normal numbers for :func:`drawn_scales` that makes large scales frequent.

    Each flight has all its first numbers, those before any slot's own, raised by one of :data:`SHIFTS`;
    ``weight`` (n,) is the ratio of the densities without and with these, at most :data:`SHIFTED`.
    """

    def __init__(self, runs: int, rng: Generator) -> None:
        """Numbers of ``runs`` flights from ``rng``."""
        self._rng, self._raised, self._over = rng, rng.choice(SHIFTS, runs), False
        self._logarithm = np.zeros((len(SHIFTS), runs))  # of the ratios of raised densities to the plain one
        self.drawn: list[FloatArray] = []

    @property
    def weight(self) -> FloatArray:
        """The weights of what was drawn until now, (n,)."""
        return np.asarray(1.0 / np.exp(self._logarithm).mean(axis=0), float)

    def standard_normal(self, size: int | tuple[int, ...]) -> FloatArray:
        """Numbers (n,) or (rows, n); only those before the slots' own are raised."""
        drawn: FloatArray = self._rng.standard_normal(size)
        if not self._over:
            self._over = drawn.ndim == 2
            drawn = drawn + self._raised
            for number in np.atleast_2d(drawn):
                self._logarithm += np.outer(SHIFTS, number) - SHIFTS[:, None] ** 2 / 2.0
        self.drawn.append(drawn)
        return drawn


class Again:
    """A source that gives numbers that were ``drawn`` once more, in the same order."""

    def __init__(self, drawn: list[FloatArray]) -> None:
        """The numbers of a :class:`ScaleDraws`."""
        self._left = list(drawn)

    def standard_normal(self, size: int | tuple[int, ...]) -> FloatArray:  # noqa: ARG002
        """The next numbers."""
        return self._left.pop(0)


class UnitScales:
    """A source of numbers for :func:`drawn_scales` of flights whose scales are about 1."""

    def standard_normal(self, size: int | tuple[int, ...]) -> FloatArray:
        """Zeros (n,) or (rows, n): the logarithm of a scale is then minus its variance."""
        return np.zeros(size)


Numbers = Generator | ScaleDraws | Again | UnitScales


def drawn_scales(law: Law, runs: int, rng: Numbers) -> Scales:
    """The scales of ``runs`` new flights, in the slots whose modes are used."""
    wind, found = law.wind, dict[int, FloatArray]()
    error = wind.error
    if error is None or wind.modes is None or not isinstance(law, Coherent):
        return Scales()
    spread, change = error.change_tail, None
    if spread > 0.0:
        change = np.exp(spread * rng.standard_normal(runs) - spread**2)
    if (tail := error.tail) is None:
        return Scales(found, change)
    lasting, renewed = rng.standard_normal((2, runs))
    before: float | None = None
    for k in np.unique(law.times.nearest).tolist():
        now, moment = min(float(wind.times[k]), wind.last_field), tail.moment_at(float(wind.leads[k]))
        if before is not None:
            kept = math.exp((before - now) / tail.memory)
            renewed = kept * renewed + math.sqrt(1.0 - kept**2) * rng.standard_normal(runs)
        logarithm = tail.flight * lasting + moment * renewed
        found[k] = np.exp(logarithm - tail.flight**2 - moment**2)
        before = now
    return Scales(found, change)


def scaled_field(law: Law, t: int, theta: FloatArray, scales: Scales) -> FloatArray:
    """θ (n, N) of step t with the coefficients of errors that have tails times the scale of the flight."""
    modes, scale = law.wind.modes, scales.forecasts.get(int(law.times.nearest[t]))
    if modes is None:
        return theta
    for kinds, factor in ((tuple(OF_FORECASTS.values()), scale), ((TIME, HELD), scales.change)):
        if factor is not None:
            scaled = np.zeros(theta.shape[1], bool)
            scaled[: law.modes] = np.tile(np.isin(modes.part, kinds), 2)
            theta = np.where(scaled, factor[:, None] * theta, theta)
    return theta
