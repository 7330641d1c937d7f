"""What every law of wind errors has, whichever version of the law it is.

Two kinds of errors of one component, with variances that are uniform over the map [m²/s²]:

    Σ_p σ_p²(L)   error of a forecast with lead L, a sum of independent parts (:mod:`wind_laws.law_of_parts`)
    D(τ)          mean square change of the wind at one place in a time τ (its structure function)

D determines the error of linear interpolation in time, for any process with stationary increments. Between
two fields that are ``gap`` apart, after the share a of the gap::

    w(t) - (1 - a) w_0 - a w_1  has variance  (1 - a) D(a gap) + a D((1 - a) gap) - a (1 - a) D(gap),

which is 0 at both fields and largest halfway. A field that is used τ after its time has the error variance
D(τ).

For GFS 10 m winds, D gives 0.91 and 1.66 m/s halfway in gaps of 6 and 12 h; measured with withheld fields it
is 1.05 (of which 0.5 m/s are the error of the withheld three-hour forecasts) and 1.67 m/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from careful_io.times import HOUR
from wind_laws.change_law import ChangeLaw, Variability
from wind_laws.types import FloatArray, require_shape

FORECAST = "forecast"  # the only part of a law of version 1
LASTING, GROWING, SLOW, LOCAL = "lasting", "growing", "slow", "local"
PART_NAMES = (LASTING, GROWING, SLOW, LOCAL)
LARGEST_SPREAD = 1.2  # of the logarithm of the scale of errors
SHORT_TIME_POWER = 1.3  # D ~ τ^1.3 below the shortest time of a table, as between 3 and 6 h in GFS winds


@dataclass(frozen=True, slots=True)
class LawPart:
    """One part of the error.

    Attributes
    ----------
    name : str
        One of ``PART_NAMES``, or ``FORECAST``.
    leads : (n,) float
        Leads, increasing from 0 [s].
    sd : (n,) float
        Standard deviation of one component at each lead [m/s].
    memory : (n,) float
        Time in which the correlation falls to 1/e at each lead [s]; infinite for the lasting part.
    length : float
        Length scale, Matern-3/2 [m].
    """

    LASTING: ClassVar[str] = LASTING
    GROWING: ClassVar[str] = GROWING
    SLOW: ClassVar[str] = SLOW
    LOCAL: ClassVar[str] = LOCAL

    name: str
    leads: FloatArray
    sd: FloatArray
    memory: FloatArray
    length: float

    def __post_init__(self) -> None:
        if self.name not in (*PART_NAMES, FORECAST):
            raise ValueError(f"a part is one of {', '.join(PART_NAMES)}, got {self.name!r}")
        require_shape(f"sd of the part {self.name}", self.sd, len(self.leads))
        require_shape(f"memory_hours of the part {self.name}", self.memory, len(self.leads))
        if not len(self.leads) or self.leads[0] != 0 or np.any(np.diff(self.leads) <= 0):
            raise ValueError(f"lead_hours of the part {self.name} must increase from 0")
        if not (np.isfinite(self.sd).all() and (self.sd >= 0).all() and self.sd.any()):
            raise ValueError(f"sd of the part {self.name} must not be negative, and not 0 at every lead")
        if not ((self.memory > 0).all() and self.length > 0):
            raise ValueError(f"memory and length of the part {self.name} must be above 0")

    def variance(self, lead: FloatArray) -> FloatArray:
        """σ_p²(L) [m²/s²] at leads [s] of any shape, linear between the leads of the table and beyond."""
        lead, table = np.asarray(lead, float), self.sd**2
        found = np.interp(lead, self.leads, table)
        if len(table) > 1:
            slope = max(table[-1] - table[-2], 0.0) / (self.leads[-1] - self.leads[-2])
            found = found + slope * np.maximum(lead - self.leads[-1], 0.0)
        return np.asarray(found, float)

    def clock(self, lead: FloatArray) -> FloatArray:
        """m_p(L) at leads [s] of any shape."""
        edges = np.concatenate([[0.0], 0.5 * (self.leads[1:] + self.leads[:-1])])
        passed = np.maximum(np.asarray(lead, float)[..., None] - edges, 0.0)
        rate = 1.0 / self.memory
        return np.asarray(passed @ np.diff(rate, prepend=0.0), float)

    def covariance(self, leads: FloatArray, variance: FloatArray) -> FloatArray:
        """Covariance (..., N, N) [m²/s²] at one place between ``leads`` (N,) [s] of one run.

        ``variance`` (..., N) [m²/s²]: of the part there, or of what a table shows of it.
        """
        clock, sd = self.clock(leads), np.sqrt(variance)
        return np.asarray(
            np.exp(-np.abs(clock[:, None] - clock)) * sd[..., :, None] * sd[..., None, :], float
        )

    def persistence(self, lead: FloatArray, passed: FloatArray) -> FloatArray:
        """Correlation of n_p at a lead [s] and a time ``passed`` [s] later; a lead of NaN counts as 0.

        Fields of successive runs count as one run from the first of the two leads on.
        """
        begin = np.nan_to_num(np.asarray(lead, float))
        return np.asarray(np.exp(self.clock(begin) - self.clock(begin + passed)), float)

    def words(self) -> tuple[str, str, str]:
        """Standard deviations at 6, 24 and 48 h, memory at 24 h, and length, as texts."""
        sd = ", ".join(f"{value:.2f}" for value in np.sqrt(self.variance(HOUR * np.array([6.0, 24.0, 48.0]))))
        memory = float(self.memory[np.argmin(np.abs(self.leads - 24 * HOUR))])
        return sd, "lasts" if np.isinf(memory) else f"{memory / HOUR:.1f} h", f"{self.length / 1e3:.0f} km"


@dataclass(frozen=True, slots=True)
class TailScale:
    """The spread of the logarithm of the scale of errors.

    Attributes
    ----------
    flight : float
        s_f, of the part that lasts over a flight.
    leads, moment : (n,) float
        Leads, increasing from 0 [s], and s_m at each, of the part that is renewed.
    memory : float
        Its memory τ [s].
    """

    flight: float
    leads: FloatArray
    moment: FloatArray
    memory: float

    def __post_init__(self) -> None:
        require_shape("moment", self.moment, len(self.leads))
        if not len(self.leads) or self.leads[0] != 0 or np.any(np.diff(self.leads) <= 0):
            raise ValueError("lead_hours of the scale must increase from 0")
        if self.flight < 0 or (self.moment < 0).any() or not self.memory > 0:
            raise ValueError("the scale must not be negative, and its memory must be above 0")
        if self.flight**2 + float(self.moment.max()) ** 2 > LARGEST_SPREAD**2:
            raise ValueError(f"the scale spreads by more than {LARGEST_SPREAD} in its logarithm")

    def spread(self, lead: float, time: float = 0.0) -> float:
        """s of an error at ``lead`` [s] (``time`` = 0), or of its mean over ``time`` [s] after that lead."""
        at = np.linspace(lead, lead + time, 33)
        moment = float(np.mean(np.interp(at, self.leads, self.moment) ** 2))
        return float(np.sqrt(self.flight**2 + self.averaged(time / self.memory) * moment))

    @staticmethod
    def averaged(x: FloatArray | float) -> FloatArray:
        """2 (x - 1 + exp(-x)) / x²: variance of a mean over the time x of a process with memory 1."""
        x = np.asarray(x, float)
        small = x < 1e-4
        safe = np.where(small, 1.0, x)
        return np.where(small, 1.0 - x / 3.0, 2.0 * (safe - 1.0 + np.exp(-safe)) / safe**2)


class ErrorLaw:
    """A law of errors: what its versions share."""

    __slots__ = ()

    if TYPE_CHECKING:  # the subclasses have fields of these names, which must not find a default here

        @property
        def name(self) -> str:
            """Name of the law, for reports."""
            raise NotImplementedError

        @property
        def level(self) -> str:
            """The level at which its tables were measured."""
            raise NotImplementedError

        @property
        def spread(self) -> float:
            """Standard deviation of the winds of one time, over places, in the data of the tables [m/s]."""
            raise NotImplementedError

        @property
        def parts(self) -> tuple[LawPart, ...]:
            """The parts of the error of forecasts; empty if these are taken as true."""
            raise NotImplementedError

        @property
        def tail(self) -> TailScale | None:
            """The tails of the error of forecasts; None: it is Gaussian."""
            raise NotImplementedError

        @property
        def situations(self) -> int | None:
            """Number n of independent situations in the data; None if the law does not state it."""
            raise NotImplementedError

        @property
        def lags(self) -> FloatArray:
            """Times (m,), increasing, above 0 [s]."""
            raise NotImplementedError

        @property
        def change_sd(self) -> FloatArray:
            """Root mean square change √D (m,) of the wind over each of ``lags`` [m/s]."""
            raise NotImplementedError

        @property
        def change_length(self) -> float:
            """Length scale of that change, Matern-3/2 [m]."""
            raise NotImplementedError

        @property
        def winds(self) -> ChangeLaw | None:
            """How ``change_sd`` depends on the winds at hand; None: it does not."""
            raise NotImplementedError

        @property
        def variability(self) -> Variability | None:
            """What ``change_sd`` was scaled by to fit the winds at hand; None: it was not."""
            raise NotImplementedError

    @property
    def floor(self) -> float:
        """1 / (n + 1): the data cannot tell a smaller rate from this one. 0 if n is not stated."""
        return 0.0 if self.situations is None else 1.0 / (self.situations + 1)

    @property
    def change_tail(self) -> float:
        """s, the standard deviation of the logarithm of the scale of changes of the wind; 0: Gaussian."""
        if self.winds is None:
            return 0.0
        return self.winds.tail(0.0 if self.variability is None else self.variability.freedom)

    @property
    def shortest_length(self) -> float:
        """Shortest length scale of the change and of the parts except the local one [m].

        The local part is narrower than flights deviate by nature: they average it.
        """
        lengths = [part.length for part in self.parts if part.name != LOCAL]
        return min([self.change_length, *lengths])

    def forecast_variance(self, lead: FloatArray) -> FloatArray:
        """Variance [m²/s²] of the error of a forecast at leads [s] of any shape; 0 for a lead of NaN.

        Linear between the leads of the tables and beyond: a linear variance means a standard deviation
        ~ √L, the growth of a sum of independent errors.

        Eq. (M12) of docs/mathematics.md.
        """
        lead = np.asarray(lead, float)
        found = np.zeros_like(lead)
        for part in self.parts:
            found = found + part.variance(lead)
        return np.asarray(np.where(np.isfinite(lead), found, 0.0), float)

    def change_variance(self, lag: FloatArray) -> FloatArray:
        """D(τ) [m²/s²] at times τ >= 0 [s], a power law between the lags of the table and beyond."""
        lag, table = np.asarray(lag, float), self.change_sd**2
        if not table.all():
            return np.zeros_like(lag)
        logs, x = np.log(self.lags), np.log(np.maximum(lag, 1e-9))
        found = np.interp(x, logs, np.log(table))
        found = np.where(x < logs[0], np.log(table[0]) + SHORT_TIME_POWER * (x - logs[0]), found)
        if len(table) > 1:
            slope = max(np.log(table[-1] / table[-2]) / (logs[-1] - logs[-2]), 0.0)
            found = np.where(x > logs[-1], np.log(table[-1]) + slope * (x - logs[-1]), found)
        return np.asarray(np.where(lag > 0, np.exp(found), 0.0), float)

    def between_variance(self, share: FloatArray, gap: FloatArray) -> FloatArray:
        """Error variance [m²/s²] of linear interpolation at a ``share`` of a ``gap`` [s] between two fields.

        Eq. (M11) of docs/mathematics.md.
        """
        a, D = np.asarray(share, float), self.change_variance
        found = (1 - a) * D(a * gap) + a * D((1 - a) * gap) - a * (1 - a) * D(np.asarray(gap, float))
        return np.asarray(np.maximum(found, 0.0), float)

    def change_correlation(self, first: float, second: float) -> float:
        """Correlation of the changes since a field over two times s, t [s]::

        (D(s) + D(t) - D(|t - s|)) / (2 √(D(s) D(t)))

        Eq. (M17) of docs/mathematics.md.
        """
        s, t, d = self.change_variance(np.array([first, second, abs(second - first)]))
        return 0.0 if s * t <= 0 else float(np.clip((s + t - d) / (2 * np.sqrt(s * t)), 0.0, 1.0))

    def for_winds(self, level: str, spread: float) -> Self:
        """The law for winds of a ``level`` whose components have the standard deviation ``spread`` [m/s]."""
        raise NotImplementedError

    def shared(self, share: float) -> Self:
        """The law with a ``share`` of the variance of forecast errors; the ensemble has the rest."""
        raise NotImplementedError

    def varying(self, found: Variability | None) -> Self:
        """The law with D(τ) scaled to the variability of the winds at hand."""
        raise NotImplementedError

    def document(self) -> dict[str, Any]:
        """The law as it is written to a file."""
        raise NotImplementedError


# --- numbers in files -------------------------------------------------------------------------

Rows = tuple[tuple[str, str, float], ...]  # key in a file, attribute, unit of the file


def written_rows(record: object, rows: Rows) -> dict[str, Any]:
    """The attributes of ``rows`` as they are written to a file."""
    return {key: np.asarray(getattr(record, name) / unit).tolist() for key, name, unit in rows}


def read_rows(section: Mapping[str, Any], rows: Rows) -> dict[str, Any]:
    """The attributes of ``rows``: arrays, and numbers."""
    found = {name: unit * np.array(section[key], float) for key, name, unit in rows}
    return {name: array if array.ndim else float(array) for name, array in found.items()}
