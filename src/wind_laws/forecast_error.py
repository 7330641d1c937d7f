"""The law of wind errors of version 1: one part, whose memory does not depend on the lead.

Laws of version 2 are a sum of parts (:mod:`wind_laws.law_of_parts`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from careful_io.times import HOUR
from wind_laws.change_law import Variability, variability_of_document
from wind_laws.error_law import FORECAST, ErrorLaw, LawPart, Rows, read_rows, written_rows
from wind_laws.types import FloatArray, require_shape

FORECAST_ERROR_SCHEMA = "pareto_ltl.forecast_error/1"
SHORTEST = 1e-3  # [s] memory of errors that do not persist
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


@dataclass(frozen=True, slots=True)
class ForecastError(ErrorLaw):
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

    @property
    def tail(self) -> None:
        """The errors are Gaussian."""

    @property
    def winds(self) -> None:
        """The change does not depend on the winds at hand, but for changes between analyses."""

    @property
    def situations(self) -> None:
        """The law does not state how many situations its data have."""

    @property
    def parts(self) -> tuple[LawPart, ...]:
        """One part for all errors of forecasts; none if these are 0."""
        if not self.forecast_sd.any():
            return ()
        kept = self.persistence ** (1.0 / self.persistence_time)  # over a second
        memory = np.inf if kept == 1.0 else SHORTEST if kept == 0.0 else -1.0 / math.log(kept)
        memories = np.full(len(self.leads), memory)
        return (LawPart(FORECAST, self.leads, self.forecast_sd, memories, self.forecast_length),)

    def for_winds(self, level: str, spread: float) -> Self:
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

    def shared(self, share: float) -> Self:
        """The law with a ``share`` of the variance of forecast errors; the ensemble has the rest."""
        return self if share == 1.0 else replace(self, forecast_sd=np.sqrt(share) * self.forecast_sd)

    def varying(self, found: Variability | None) -> Self:
        """The law with D(τ) scaled to the variability of the winds at hand."""
        if found is None:
            return self
        return replace(self, change_sd=np.sqrt(found.factor) * self.change_sd, variability=found)

    def document(self) -> dict[str, Any]:
        """The numbers as they are written to a file."""
        head = {name: getattr(self, name) for name in ("name", "level", "spread")}
        tables = {section: written_rows(self, rows) for section, rows in FILE_ROWS.items()}
        if self.variability is not None:
            tables["variability"] = self.variability.document()
        return {"schema": FORECAST_ERROR_SCHEMA} | head | tables


def forecast_error_of(reported: Mapping[str, Any]) -> ForecastError:
    """The law of a document that fits the schema; ValueError if its tables are not valid."""
    return ForecastError(
        name=reported["name"],
        level=reported["level"],
        spread=float(reported["spread"]),
        variability=variability_of_document(reported.get("variability")),
        **read_rows(reported["forecast"], FILE_ROWS["forecast"]),
        **read_rows(reported["change"], FILE_ROWS["change"]),
    )
