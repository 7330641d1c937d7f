"""The error of a wind field at a time: error of its forecast, and change of the wind between fields.

Two variances per component, both uniform over the map [m²/s²]:

    e²(L)         error of a forecast with lead L
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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, require_shape
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.reading import Advice
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl.support.schemas import read_document
from pareto_ltl.wind.readings import HOUR

FORECAST_ERROR_SCHEMA = "pareto_ltl.forecast_error/1"
LAW_OF_PARTS_SCHEMA = "pareto_ltl.forecast_error/2"
LAWS_FOLDER = PACKAGE / "support" / "data" / "forecast_errors"
PARTS_FOLDER = LAWS_FOLDER / "parts"
VERSION_ONE = (
    "which `pareto-ltl wind-error --check` compares with tables; plans use laws of version 1: set "
    "wind.forecast_error=gfs, or the file that `pareto-ltl wind-error DIR` writes from GRIB files"
)
LAW_FILE = Advice(
    damaged="expected a file of `pareto-ltl wind-error`", missing="name a file of `pareto-ltl wind-error`"
)
Rows = tuple[tuple[str, str, float], ...]  # key in a file, attribute, unit of the file
FILE_ROWS: dict[str, Rows] = {
    "forecast": (
        ("lead_hours", "leads", HOUR),
        ("sd", "forecast_sd", 1.0),
        ("length", "forecast_length", 1.0),
        ("persistence", "persistence", 1.0),
        ("persistence_hours", "persistence_time", HOUR),
    ),
    "change": (("lag_hours", "lags", HOUR), ("sd", "change_sd", 1.0), ("length", "change_length", 1.0)),
}
VARIABILITY_ROWS: Rows = (
    ("from_seconds", "starts", 1.0),
    ("to_seconds", "ends", 1.0),
    ("mean_square", "squares", 1.0),
    ("freedom", "freedom", 1.0),
    ("factor", "factor", 1.0),
)
SHORT_TIME_POWER = 1.3  # D ~ τ^1.3 below the shortest time of a table, as between 3 and 6 h in GFS winds


@dataclass(frozen=True, slots=True)
class Variability:
    """Changes of the wind between P pairs of analyses, and the factor of D(τ) that follows from them.

    Attributes
    ----------
    starts, ends : (P,) float
        Times of the analyses [s since time_zero].
    squares : (P,) float
        Mean square change of a component near the map [m²/s²].
    freedom : float
        Effective number of independent changes.
    factor : float
        Factor of D(τ).
    """

    starts: FloatArray
    ends: FloatArray
    squares: FloatArray
    freedom: float
    factor: float

    def __post_init__(self) -> None:
        require_shape("to_seconds", self.ends, len(self.starts))
        require_shape("mean_square", self.squares, len(self.starts))


@dataclass(frozen=True, slots=True)
class ForecastError:
    """The error of forecasts and the change of the wind, as tables of standard deviations of one component.

    Attributes
    ----------
    name : str
        Name of the law, for reports.
    leads, forecast_sd : (n,) float
        Leads, increasing from 0 [s], and the standard deviation e of the error at each [m/s].
    forecast_length : float
        Length scale of the error, Matern-3/2 [m].
    persistence, persistence_time : float
        Correlation of the errors at valid times ``persistence_time`` [s] apart.
    lags, change_sd : (m,) float
        Times, increasing, above 0 [s], and the root mean square change √D of the wind over each [m/s].
    change_length : float
        Length scale of that change, Matern-3/2 [m].
    level : str
        The level at which the tables were measured.
    spread : float
        Standard deviation of the winds of one time, over places, in the data of the tables [m/s]. For winds
        of another level, both tables are scaled by the ratio of the spreads.
    variability : Variability or None
        What ``change_sd`` was scaled by to fit the winds at hand; None: it was not.
    """

    name: str
    leads: FloatArray
    forecast_sd: FloatArray
    forecast_length: float
    persistence: float
    persistence_time: float
    lags: FloatArray
    change_sd: FloatArray
    change_length: float
    level: str
    spread: float
    variability: Variability | None = None

    def __post_init__(self) -> None:
        require_shape("forecast_sd", self.forecast_sd, len(self.leads))
        require_shape("change_sd", self.change_sd, len(self.lags))
        for name, table in (("leads", self.leads), ("lags", self.lags)):
            if not len(table) or np.any(np.diff(table) <= 0):
                raise ValueError(f"{name} must increase")
        if self.lags[0] <= 0 or self.leads[0] != 0:
            raise ValueError("lags begin above 0, leads at 0")
        if not 0 <= self.persistence <= 1:
            raise ValueError(f"persistence must lie in [0, 1], got {self.persistence}")

    def forecast_variance(self, lead: FloatArray) -> FloatArray:
        """e²(L) [m²/s²] at leads [s], linear between the leads of the table and beyond; 0 for a lead of NaN.

        A linear variance means e ~ √L, the growth of a sum of independent errors.

        Eq. (M12) of docs/mathematics.md.
        """
        lead = np.asarray(lead, float)
        table = self.forecast_sd**2
        found = np.interp(lead, self.leads, table)
        if len(table) > 1:
            slope = max(table[-1] - table[-2], 0.0) / (self.leads[-1] - self.leads[-2])
            found = found + slope * np.maximum(lead - self.leads[-1], 0.0)
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

    def for_winds(self, level: str, spread: float) -> ForecastError:
        """The law for winds of a ``level`` with the standard deviation ``spread`` [m/s] over places."""
        if level == self.level:
            return self
        factor = spread / self.spread
        return replace(
            self, forecast_sd=factor * self.forecast_sd, change_sd=factor * self.change_sd, level=level,
            spread=spread,
        )  # fmt: skip

    def without_forecasts(self) -> ForecastError:
        """The law without errors of forecasts: only the change of the wind between fields."""
        return replace(self, name="none", forecast_sd=np.zeros_like(self.forecast_sd))

    def shared(self, share: float) -> ForecastError:
        """The law with a ``share`` of the variance of forecast errors; the ensemble has the rest."""
        return self if share == 1.0 else replace(self, forecast_sd=np.sqrt(share) * self.forecast_sd)

    def varying(self, found: Variability | None) -> ForecastError:
        """The law with D(τ) scaled to the variability of the winds at hand."""
        if found is None:
            return self
        return replace(self, change_sd=np.sqrt(found.factor) * self.change_sd, variability=found)

    def document(self) -> dict[str, Any]:
        """The numbers as they are written to a file."""
        head = {name: getattr(self, name) for name in ("name", "level", "spread")}
        tables = {section: _written(self, rows) for section, rows in FILE_ROWS.items()}
        if self.variability is not None:
            tables["variability"] = _written(self.variability, VARIABILITY_ROWS)
        return {"schema": FORECAST_ERROR_SCHEMA} | head | tables


def _written(record: object, rows: Rows) -> dict[str, Any]:
    return {key: np.asarray(getattr(record, name) / unit).tolist() for key, name, unit in rows}


def _read(section: Mapping[str, Any], rows: Rows) -> dict[str, Any]:
    """The attributes of ``rows``: arrays, and numbers."""
    found = {name: unit * np.array(section[key], float) for key, name, unit in rows}
    return {name: array if array.ndim else float(array) for name, array in found.items()}


def read_forecast_error(path: Path) -> ForecastError:
    """The law in a file of `pareto-ltl wind-error`; DataError if it is not valid, or a law of parts."""
    known = {FORECAST_ERROR_SCHEMA: "forecast_error", LAW_OF_PARTS_SCHEMA: "forecast_error_2"}
    document = read_document(path, known, LAW_FILE)
    if document["schema"] == LAW_OF_PARTS_SCHEMA:
        raise DataError(f"{path}: is a law of parts ({LAW_OF_PARTS_SCHEMA}), {VERSION_ONE}")
    try:
        return forecast_error_of(document)
    except ValueError as error:
        raise DataError(f"{path}: {error}; {LAW_FILE.damaged}") from None


def forecast_error_of(told: Mapping[str, Any]) -> ForecastError:
    """The law of a document that fits the schema; ValueError if its tables are not valid."""
    scaled = told.get("variability")
    return ForecastError(
        name=told["name"],
        level=told["level"],
        spread=float(told["spread"]),
        variability=None if scaled is None else Variability(**_read(scaled, VARIABILITY_ROWS)),
        **_read(told["forecast"], FILE_ROWS["forecast"]),
        **_read(told["change"], FILE_ROWS["change"]),
    )


def forecast_error_law(setting: str, usual: str) -> ForecastError:
    """The law of ``wind.forecast_error``; ``usual`` is the value of ``auto``: ``none`` or ``gfs``."""
    name = usual if setting == "auto" else setting
    own = name in ("gfs", "none")
    if not own and (PARTS_FOLDER / f"{name}.json").is_file() and not Path(name).exists():
        raise ConfigError(f"wind.forecast_error={name} is a packaged law of parts, {VERSION_ONE}")
    law = read_forecast_error(LAWS_FOLDER / "gfs.json" if own else Path(name).expanduser())
    return law.without_forecasts() if name == "none" else law
