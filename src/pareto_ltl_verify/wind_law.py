"""The law of the errors of forecasts and of the change of the wind, from its JSON document.

The error of a forecast is a sum of independent parts. A law of version 1 has one part and no tails.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pareto_ltl_verify.arrays import FloatArray

HOUR = 3600.0  # [s]
FAR = 1e9  # [s] beyond every lead
SHORT_TIME_POWER = 1.3  # of D(τ) below the shortest time of a table
ONE_PART, LOCAL = "forecast", "local"
VERSION_1 = "pareto_ltl.forecast_error/1"
SHORTEST = 1e-9  # [s] memory of errors that do not persist
SPREAD_RANGE = (0.25, 2.5)  # least and largest spread at hand over the spread of the law
FACTS = ("schema", "n", "truth", "intervals")  # of the data of a law


@dataclass(frozen=True, slots=True)
class Scaled:
    """Mean ``squares`` [m²/s²] of changes between analyses at ``pairs`` (P, 2) [s], and the factor of D.

    ``spread`` [m/s] and ``latitude`` [deg] are the winds and the place that the factor depends on; None where
    it does not.
    """

    pairs: FloatArray
    squares: FloatArray
    freedom: float
    factor: float
    spread: float | None = None
    latitude: float | None = None


@dataclass(frozen=True, slots=True)
class OfWinds:
    """How D depends on the winds at hand: of a ``spread`` [m/s] and a ``latitude`` [deg] it is as stated.

    It grows as the ``power`` of the spread and exponentially with the latitude, by ``slope`` [1/deg]. Before
    data its inverse has ``freedom`` + 2 degrees of freedom; changes count at most as ``most_freedom``.
    """

    spread: float
    power: float
    latitude: float
    slope: float
    freedom: float
    most_freedom: float

    def expected(self, scaled: Scaled) -> float:
        """The factor of D for the spread and the latitude at hand."""
        exponent = 0.0
        if scaled.spread is not None:
            low, high = (math.log(edge) for edge in SPREAD_RANGE)
            relative = math.log(max(scaled.spread, 1e-9) / self.spread)
            exponent += self.power * min(max(relative, low), high)
        if scaled.latitude is not None:
            exponent += self.slope * (abs(scaled.latitude) - self.latitude)
        return math.exp(exponent)

    def counted(self, freedom: float) -> float:
        """Degrees of freedom that ``freedom`` of changes between analyses add."""
        return freedom * self.most_freedom / (freedom + self.most_freedom)

    def tail(self, freedom: float) -> float:
        """Standard deviation of half the logarithm of the inverse of a Gamma variable."""
        from scipy.stats import loggamma

        shape = (self.freedom + 2.0 + self.counted(freedom)) / 2.0
        return 0.5 * float(loggamma.std(shape))


@dataclass(frozen=True, slots=True)
class LawPart:
    """A part of the error of forecasts: ``sd`` (n,) [m/s] and ``memory`` (n,) [s] at ``leads`` (n,) [s].

    ``length`` [m] is its length scale.
    """

    name: str
    leads: FloatArray
    sd: FloatArray
    memory: FloatArray
    length: float

    def variance(self, lead: FloatArray) -> FloatArray:
        """Variance [m²/s²] at each lead [s], linear between leads and beyond; 0 where a lead is not known."""
        x, y = self.leads, self.sd**2
        if len(x) > 1:
            slope = max((y[-1] - y[-2]) / (x[-1] - x[-2]), 0.0)
            x, y = np.append(x, x[-1] + FAR), np.append(y, y[-1] + slope * FAR)
        known = np.isfinite(lead)
        return np.where(known, np.interp(np.where(known, lead, 0.0), x, y), 0.0)

    def kept(self, lead: float, passed: float) -> float:
        """Correlation of the part at a ``lead`` [s] with itself ``passed`` [s] later; 0 counts for NaN.

        exp(-Σ t / memory) with the time t that is spent nearest to each lead of the table.
        """
        begin = 0.0 if math.isnan(lead) else lead
        middles = (self.leads[1:] + self.leads[:-1]) / 2
        low, high = np.append(0.0, middles), np.append(middles, math.inf)
        spent = np.clip(begin + passed, low, high) - np.clip(begin, low, high)
        return math.exp(-float((spent / self.memory).sum()))


@dataclass(frozen=True, slots=True)
class Tail:
    """Spread of the logarithm of the scale of errors: ``flight`` of its part that lasts for a flight.

    ``moment`` (n,) at ``leads`` (n,) [s] is the spread of a part that is renewed in the time ``memory`` [s].
    """

    flight: float
    leads: FloatArray
    moment: FloatArray
    memory: float

    def moment_at(self, lead: float) -> float:
        """The spread of the renewed part at a lead [s]; 0 counts for a lead that is not known."""
        return float(np.interp(0.0 if math.isnan(lead) else lead, self.leads, self.moment))


@dataclass(frozen=True, slots=True)
class ErrorLaw:
    """Parts and tail of the errors of forecasts, and the change of the wind, of one component.

    ``lags`` [s], ``change_sd``, ``spread`` [m/s]; ``change_length`` [m] is a length scale; ``facts`` are
    what the document says of the data of the law, and ``floor`` is the least rate that they show. ``scaled``:
    changes of the winds at hand, to which ``change_sd`` was scaled.
    """

    name: str
    level: str
    spread: float
    parts: tuple[LawPart, ...]
    tail: Tail | None
    lags: FloatArray
    change_sd: FloatArray
    change_length: float
    facts: Mapping[str, Any]
    floor: float | None = None
    scaled: Scaled | None = None
    of_winds: OfWinds | None = None

    @property
    def change_tail(self) -> float:
        """Standard deviation of the logarithm of the scale of changes; 0 if they are Gaussian."""
        if self.of_winds is None:
            return 0.0
        return self.of_winds.tail(0.0 if self.scaled is None else self.scaled.freedom)

    @property
    def shortest_length(self) -> float:
        """The shortest length scale [m] of the change and of the parts that are not local."""
        wide = [part.length for part in self.parts if part.name != LOCAL]
        return min(self.change_length, *wide) if wide else self.change_length

    def times(self, forecasts: float, change: float) -> ErrorLaw:
        """The law with the standard deviations of forecasts and of the change times these factors."""
        parts = tuple(replace(part, sd=forecasts * part.sd) for part in self.parts)
        return replace(self, parts=parts, change_sd=change * self.change_sd)

    def numbers(self) -> dict[str, FloatArray]:
        """The tables and numbers of the law by name."""
        change = {"lags": self.lags, "change sd": self.change_sd, "change length": self.change_length}
        parts = {
            f"{part.name} {key}": getattr(part, key)
            for part in self.parts
            for key in ("leads", "sd", "memory", "length")
        }
        tail = {
            f"tail {key}": getattr(self.tail, key)
            for key in ("flight", "leads", "moment", "memory")
            if self.tail is not None
        }
        rule = self.of_winds
        names = () if rule is None else [each.name for each in fields(rule)]
        winds = {f"winds {name}": getattr(rule, name) for name in names}
        return {name: np.array(value, float) for name, value in (change | parts | tail | winds).items()}

    def forecast_variance(self, lead: FloatArray) -> FloatArray:
        """Variance [m²/s²] of the error of a forecast at each lead [s], the sum over the parts."""
        return sum((part.variance(lead) for part in self.parts), np.zeros(np.shape(lead)))

    def change_variance(self, lag: float) -> float:
        """D(τ) [m²/s²], a power of τ between two times of the table, and beyond."""
        x, y = self.lags, self.change_sd**2
        if lag <= 0.0 or not y.all():
            return 0.0
        i = int(np.searchsorted(x, lag, side="right")) - 1
        if i < 0:
            return float(y[0] * (lag / x[0]) ** SHORT_TIME_POWER)
        if len(x) == 1:
            return float(y[0])
        left = min(i, len(x) - 2)
        power = math.log(y[left + 1] / y[left]) / math.log(x[left + 1] / x[left])
        return float(y[i] * (lag / x[i]) ** (max(power, 0.0) if i == len(x) - 1 else power))

    def between_variance(self, passed: float, gap: float) -> float:
        """Variance [m²/s²] of interpolation ``passed`` [s] after the first of two fields ``gap`` apart.

        Var(X - a Y) of the changes X and Y of the wind in ``passed`` and in ``gap``, a = passed / gap::

            D(passed) + a² D(gap) - 2 a Cov(X, Y),    2 Cov(X, Y) = D(passed) + D(gap) - D(gap - passed)
        """
        a = passed / gap
        X, Y, rest = map(self.change_variance, (passed, gap, gap - passed))
        return max(X + a * a * Y - a * (X + Y - rest), 0.0)

    def change_correlation(self, first: float, second: float) -> float:
        """Correlation in [0, 1] of the changes of the wind up to two times [s] after one field."""
        s, t, apart = map(self.change_variance, (first, second, abs(second - first)))
        return min(max(0.5 * (s + t - apart) / math.sqrt(s * t), 0.0), 1.0) if s * t > 0 else 0.0


def error_law(document: Mapping[str, Any]) -> ErrorLaw:
    """The law of a JSON document ``pareto_ltl.forecast_error/1`` or ``/2``."""
    change, scaled, scale = document["change"], document.get("variability"), document.get("scale")
    first = document["schema"] == VERSION_1
    return ErrorLaw(
        name=str(document["name"]), level=str(document["level"]), spread=float(document["spread"]),
        parts=_one_part(document["forecast"]) if first else tuple(map(_part, document["parts"])),
        tail=None if scale is None else _tail(scale),
        lags=_hours(change["lag_hours"]), change_sd=np.array(change["sd"], float),
        change_length=float(change["length"]), facts={key: document.get(key) or None for key in FACTS},
        floor=document.get("floor"), scaled=None if scaled is None else _scaled(scaled),
        of_winds=_of_winds(change.get("winds")),
    )  # fmt: skip


def _hours(values: list[float | None]) -> FloatArray:
    """Times [s] of hours; None is for ever."""
    return HOUR * np.array([math.inf if value is None else value for value in values], float)


def _part(section: Mapping[str, Any]) -> LawPart:
    leads, memory = (_hours(section[key]) for key in ("lead_hours", "memory_hours"))
    return LawPart(section["name"], leads, np.array(section["sd"], float), memory, float(section["length"]))


def _one_part(section: Mapping[str, Any]) -> tuple[LawPart, ...]:
    """The part of a law of version 1: its memory is the same at every lead; none without errors."""
    kept, time = float(section["persistence"]), HOUR * float(section["persistence_hours"])
    memory = math.inf if kept >= 1.0 else -time / math.log(kept) if kept > 0.0 else SHORTEST
    leads, sd = _hours(section["lead_hours"]), np.array(section["sd"], float)
    part = LawPart(ONE_PART, leads, sd, np.full(len(leads), memory), float(section["length"]))
    return (part,) if sd.any() else ()


def _tail(section: Mapping[str, Any]) -> Tail:
    moment, memory = np.array(section["moment"], float), HOUR * float(section["memory_hours"])
    return Tail(float(section["flight"]), _hours(section["lead_hours"]), moment, memory)


def _scaled(document: Mapping[str, Any]) -> Scaled:
    pairs = np.stack([np.array(document[name], float) for name in ("from_seconds", "to_seconds")], axis=1)
    squares = np.array(document["mean_square"], float)
    known = (document.get(name) for name in ("spread", "latitude"))
    return Scaled(pairs, squares, float(document["freedom"]), float(document["factor"]), *known)


def _of_winds(section: Mapping[str, Any] | None) -> OfWinds | None:
    if section is None:
        return None
    return OfWinds(**{each.name: float(section[each.name]) for each in fields(OfWinds)})


def independent_changes(law: ErrorLaw, pairs: FloatArray, kinship: FloatArray) -> float:
    """Twice the squared mean over the variance of a mean of squares of equally distributed Gaussian changes.

    The changes have two components over ``pairs`` (P, 2) of times [s] at places with the correlations
    ``kinship`` (N, N).
    """
    total = 0.0
    for a, b in pairs:
        for c, d in pairs:
            D = [law.change_variance(abs(t)) for t in (b - c, d - a, a - c, b - d, b - a, d - c)]
            total += (D[0] + D[1] - D[2] - D[3]) ** 2 / (4 * D[4] * D[5])
    return 2 * len(pairs) ** 2 * kinship.size / (total * float((kinship**2).sum()))
