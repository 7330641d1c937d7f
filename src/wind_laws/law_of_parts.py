"""The law of a forecast's error as a sum of independent parts (``pareto_ltl.forecast_error/2``).

One component of the error at the lead L and the place x is, with g and every n standard normal,

    e(x, L)              = exp(s g - s²) Σ_p σ_p(L) n_p(x, L)
    Corr n_p(x, L) n_p(y, M) = exp(-|m_p(L) - m_p(M)|) ρ(|x - y| / l_p),     m_p(L) = ∫_0^L dM / memory_p(M)

σ_p² is linear between the leads of a table and beyond it, 1 / memory_p is constant between the middles of
its leads, and ρ is the Matern-3/2 correlation. m_p is a clock of the part: the correlation is positive
definite for any memory that depends on the lead. The lasting part has m_p = 0.

**Truth.** Against observations e is the error. Against a newer run of the same model with the lead l, errors
that the two runs share cannot be seen. As for successive forecasts of one quantity, of which each uses all
information of the earlier ones, the difference has the variance

    σ_p²(L) - σ_p²(l) + σ_p²(0),    0 for l = L,

without the lasting part. σ_p²(0) is noise of each run.

**Tails.** The logarithm of the scale has a part that lasts over a flight, of variance s_f², and one that is
renewed with the memory τ, of variance s_m²(L). Averaged over a time T:

    s²(T) = s_f² + f(T / τ) s_m²,    f(x) = 2 (x - 1 + exp(-x)) / x²
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from careful_io.times import HOUR
from wind_laws.change_law import ChangeLaw, Variability, change_law_of_document, variability_of_document
from wind_laws.error_law import LASTING, ErrorLaw, LawPart, TailScale
from wind_laws.types import FloatArray, require_shape

LAW_OF_PARTS_SCHEMA = "pareto_ltl.forecast_error/2"
OWN, OBSERVED = "own", "observed"  # what verifies a table: newer runs of the model, or observations
TRUTHS = (OWN, OBSERVED)


@dataclass(frozen=True, slots=True)
class LawOfParts(ErrorLaw):
    """The law of the errors of one class of forecasts.

    Attributes
    ----------
    name : str
        Name of the law, for reports.
    level : str
        Level of the winds of its data.
    spread : float
        Standard deviation of the winds of one time over places in its data [m/s]. For another level all
        parts are scaled by the ratio of the spreads.
    parts : tuple of LawPart
        The parts, each name at most once; empty if an ensemble has all of the error.
    scale : TailScale
        The tails.
    situations : int
        Number n of independent situations (dates at least two days apart) in the data of the parts, except
        the lasting one. No rate below 1 / (n + 1) can be claimed.
    truth : str
        What verified the data: ``own`` (newer runs) or ``observed``.
    origin : str
        Origin of the numbers.
    lags, change_sd : (m,) float
        Times, increasing, above 0 [s], and the root mean square change √D of the wind over each [m/s].
    change_length : float
        Length scale of that change, Matern-3/2 [m].
    winds : ChangeLaw or None
        How that change depends on the winds at hand, and its tails; None: it does not.
    intervals : mapping
        95 % intervals of numbers of the law, by name: [low, high].
    variability : Variability or None
        What ``change_sd`` was scaled by to fit the winds at hand; None: it was not.
    """

    OWN: ClassVar[str] = OWN
    OBSERVED: ClassVar[str] = OBSERVED

    name: str
    level: str
    spread: float
    parts: tuple[LawPart, ...]
    scale: TailScale
    situations: int
    truth: str
    origin: str
    lags: FloatArray
    change_sd: FloatArray
    change_length: float
    winds: ChangeLaw | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    variability: Variability | None = None

    def __post_init__(self) -> None:
        names = [part.name for part in self.parts]
        if len(set(names)) < len(names):
            raise ValueError(f"the parts of a law have different names, got {', '.join(names)}")
        require_shape("change sd", self.change_sd, len(self.lags))
        if not len(self.lags) or self.lags[0] <= 0 or np.any(np.diff(self.lags) <= 0):
            raise ValueError("lag_hours must increase from above 0")
        if self.truth not in TRUTHS:
            raise ValueError(f"truth is one of {', '.join(TRUTHS)}, got {self.truth!r}")
        if self.situations < 1 or not self.spread > 0:
            raise ValueError("situations must be at least 1, and spread above 0")

    @property
    def tail(self) -> TailScale:
        """The tails of the errors of forecasts."""
        return self.scale

    def part(self, name: str) -> LawPart | None:
        """The part ``name``; None if the law does not have it."""
        return next((part for part in self.parts if part.name == name), None)

    def for_winds(self, level: str, spread: float) -> Self:
        """The law for winds of a ``level`` whose components have the standard deviation ``spread`` [m/s].

        A change that depends on the winds at hand (``winds``) is scaled by these alone.
        """
        if level == self.level:
            return self
        factor = spread / self.spread
        scaled = self.shared(factor**2)
        change_sd = self.change_sd if self.winds is not None else factor * self.change_sd
        return replace(scaled, level=level, spread=spread, change_sd=change_sd)

    def shared(self, share: float) -> Self:
        """The law with a ``share`` of the variance of forecast errors; the ensemble has the rest."""
        if share == 1.0:
            return self
        factor = np.sqrt(share)
        parts = tuple(replace(part, sd=factor * part.sd) for part in self.parts) if share > 0.0 else ()
        return replace(self, parts=parts)

    def varying(self, found: Variability | None) -> Self:
        """The law with D(τ) scaled to the variability of the winds at hand."""
        if found is None:
            return self
        return replace(self, change_sd=np.sqrt(found.factor) * self.change_sd, variability=found)

    def seen_by(self, truth: str) -> tuple[LawPart, ...]:
        """The parts that a table verified by ``truth`` can show."""
        return tuple(part for part in self.parts if truth == OBSERVED or part.name != LASTING)

    def variance(self, lead: FloatArray, truth: str = OBSERVED) -> FloatArray:
        """Variance of one component [m²/s²] at leads [s] of any shape, of the parts that ``truth`` shows."""
        lead = np.asarray(lead, float)
        found = np.zeros_like(lead)
        for part in self.seen_by(truth):
            found = found + part.variance(lead)
        return found

    def covariance(self, leads: FloatArray, newer: FloatArray | None = None) -> FloatArray:
        """Covariance of one component at one place between leads.

        Parameters
        ----------
        leads : (N,) float
            Leads of one forecast [s].
        newer : (..., N) float, optional
            Leads of the newer runs that verify it [s], at most ``leads``. None: observations do.

        Returns
        -------
        (N, N) or (..., N, N) float
            [m²/s²]
        """
        leads = np.asarray(leads, float)
        found = np.zeros((len(leads), len(leads)))
        for part in self.parts if newer is None else self.seen_by(OWN):
            seen = part.variance(leads) if newer is None else seen_variance(part, leads, newer)
            found = found + part.covariance(leads, seen)
        return found

    def document(self) -> dict[str, Any]:
        """The law as it is written to a file."""
        scaled = self.variability
        return {
            "schema": LAW_OF_PARTS_SCHEMA,
            "name": self.name,
            "level": self.level,
            "spread": self.spread,
            "origin": self.origin,
            "n": self.situations,
            "floor": self.floor,
            "truth": self.truth,
            "parts": [_part_document(part) for part in self.parts],
            "scale": {
                "flight": self.scale.flight,
                "lead_hours": (self.scale.leads / HOUR).tolist(),
                "moment": self.scale.moment.tolist(),
                "memory_hours": self.scale.memory / HOUR,
            },
            "change": {
                "lag_hours": (self.lags / HOUR).tolist(),
                "sd": self.change_sd.tolist(),
                "length": self.change_length,
                **({} if self.winds is None else {"winds": self.winds.document()}),
            },
            "intervals": {name: list(ends) for name, ends in self.intervals.items()},
            **({} if scaled is None else {"variability": scaled.document()}),
        }


def seen_variance(part: LawPart, leads: FloatArray, newer: FloatArray) -> FloatArray:
    """Variance [m²/s²] of the difference of a forecast at ``leads`` and a newer run at ``newer`` [s]."""
    found = part.variance(leads) - part.variance(newer) + part.variance(np.zeros(1))
    return np.asarray(np.where(newer < leads, np.maximum(found, 0.0), 0.0), float)


# --- files ------------------------------------------------------------------------------------


def _part_document(part: LawPart) -> dict[str, Any]:
    memory = [None if np.isinf(value) else value / HOUR for value in part.memory.tolist()]
    return {
        "name": part.name,
        "lead_hours": (part.leads / HOUR).tolist(),
        "sd": part.sd.tolist(),
        "memory_hours": memory,
        "length": part.length,
    }


def law_of_parts_of(document: Mapping[str, Any]) -> LawOfParts:
    """The law of a document that fits the schema; ValueError if its numbers are not valid."""
    parts = tuple(
        LawPart(
            each["name"],
            HOUR * np.array(each["lead_hours"], float),
            np.array(each["sd"], float),
            np.array([np.inf if hours is None else HOUR * hours for hours in each["memory_hours"]], float),
            float(each["length"]),
        )
        for each in document["parts"]
    )
    scale, change = document["scale"], document["change"]
    law = LawOfParts(
        document["name"], document["level"], float(document["spread"]), parts,
        TailScale(
            float(scale["flight"]), HOUR * np.array(scale["lead_hours"], float),
            np.array(scale["moment"], float), HOUR * float(scale["memory_hours"]),
        ),
        int(document["n"]), document["truth"], document.get("origin", ""),
        HOUR * np.array(change["lag_hours"], float), np.array(change["sd"], float), float(change["length"]),
        change_law_of_document(change.get("winds")),
        {name: (float(low), float(high)) for name, (low, high) in document.get("intervals", {}).items()},
        variability_of_document(document.get("variability")),
    )  # fmt: skip
    if abs(float(document["floor"]) - law.floor) > 1e-6:
        raise ValueError(f"floor is 1 / (n + 1) = {law.floor:.6g}, got {document['floor']}")
    return law
