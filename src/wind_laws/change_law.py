"""How the mean square change D(τ) of the wind depends on the winds at hand.

With S the spread of the winds near the map, φ the latitude, m the mean ratio of observed to expected mean
square changes between earlier analyses and ν its effective number of changes,

    D(τ | S, φ, m) = c f D(τ),     f = (S / S_0)^p exp(q (|φ| - φ_0)),     c = (n_0 + w m) / (n_0 + w),
    1 / w = 1 / ν + 1 / ν_0

w is 0 without earlier analyses. ν_0 limits their weight, because the wind becomes more or less variable with
time. 1 / c has a Gamma distribution with n_0 + 2 + w degrees of freedom, so that changes have heavy tails:

    log scale has the standard deviation s = √ψ'((n_0 + 2 + w) / 2) / 2     (ψ': trigamma function)

Eq. (M12a) and (M12b) of docs/mathematics.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wind_laws.types import FloatArray, require_shape

LAW_WEIGHT = 10.0  # n_0 of a law that does not state how its change depends on the winds
LEAST_FACTOR, MAX_FACTOR = 0.25, 4.0  # of c
SPREADS = (0.25, 2.5)  # S / S_0 counts at least and at most as these, nearly the range of the data
LONGEST_PAIR = 1000e3  # [m] between readings whose difference counts for S
FEWEST_PLACES = 10  # readings for S; with fewer it is S_0


@dataclass(frozen=True, slots=True)
class Variability:
    """What D(τ) was scaled by to fit the winds at hand.

    Attributes
    ----------
    starts, ends : (P,) float
        Times of pairs of analyses [s since time_zero].
    squares : (P,) float
        Mean square change of a component near the map between them [m²/s²].
    freedom : float
        ν, the effective number of independent changes of all pairs; 0 without pairs.
    factor : float
        Factor c f of D(τ).
    spread, latitude : float or None
        S [m/s] and φ [deg]; None where they are not known, and for a law that does not depend on them.
    """

    starts: FloatArray
    ends: FloatArray
    squares: FloatArray
    freedom: float
    factor: float
    spread: float | None = None
    latitude: float | None = None

    def __post_init__(self) -> None:
        require_shape("to_seconds", self.ends, len(self.starts))
        require_shape("mean_square", self.squares, len(self.starts))

    def document(self) -> dict[str, Any]:
        """The section ``variability`` of a law in a file."""
        known = {"spread": self.spread, "latitude": self.latitude}
        return {
            "from_seconds": self.starts.tolist(),
            "to_seconds": self.ends.tolist(),
            "mean_square": self.squares.tolist(),
            "freedom": self.freedom,
            "factor": self.factor,
        } | {name: value for name, value in known.items() if value is not None}


def reasons_text(found: Variability) -> str:
    """What the factor of D(τ) follows from."""
    reasons = [] if found.spread is None else ["the spread of the winds"]
    reasons += ["changes between analyses near the map"] if len(found.starts) else []
    return " and ".join(reasons) or "the latitude"


def variability_of_document(section: Mapping[str, Any] | None) -> Variability | None:
    """The section ``variability`` of a document, if it has one."""
    if section is None:
        return None
    starts, ends, squares = (
        np.array(section[key], float) for key in ("from_seconds", "to_seconds", "mean_square")
    )
    return Variability(
        starts, ends, squares, float(section["freedom"]), float(section["factor"]), section.get("spread"),
        section.get("latitude"),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ChangeLaw:
    """The dependence of D(τ) on the spread of the winds and the latitude, and how uncertain D then is.

    Attributes
    ----------
    spread : float
        S_0 [m/s].
    power : float
        p.
    latitude, slope : float
        φ_0 [deg] and q [1/deg].
    freedom : float
        n_0.
    most_freedom : float
        ν_0.
    situations : int
        Number n of situations in its data.
    origin : str
        Its data.
    """

    spread: float
    power: float
    latitude: float
    slope: float
    freedom: float
    most_freedom: float
    situations: int
    origin: str = ""

    def __post_init__(self) -> None:
        if not (self.spread > 0 and self.power >= 0 and self.freedom > 0 and self.most_freedom > 0):
            raise ValueError("change.winds: spread, freedom and most_freedom are above 0, power at least 0")
        if self.situations < 1:
            raise ValueError("change.winds: n must be at least 1")

    def expected(self, spread: float | None, latitude: float | None) -> float:
        """f for a spread S [m/s] and a latitude [deg]; where one is not known, its value in the law."""
        ratio = 1.0 if spread is None else float(np.clip(spread / self.spread, *SPREADS))
        north = self.latitude if latitude is None else abs(latitude)
        return float(ratio**self.power * np.exp(self.slope * (north - self.latitude)))

    def weight(self, freedom: float) -> float:
        """w of ``freedom`` = ν changes."""
        return 0.0 if freedom <= 0.0 else 1.0 / (1.0 / freedom + 1.0 / self.most_freedom)

    def tail(self, freedom: float = 0.0) -> float:
        """s after ``freedom`` = ν changes."""
        from scipy.special import polygamma

        return float(0.5 * np.sqrt(polygamma(1, 0.5 * (self.freedom + 2.0 + self.weight(freedom)))))

    def document(self) -> dict[str, Any]:
        """The section ``winds`` of ``change`` in the file of a law."""
        return {
            "spread": self.spread,
            "power": self.power,
            "latitude": self.latitude,
            "slope": self.slope,
            "freedom": self.freedom,
            "most_freedom": self.most_freedom,
            "n": self.situations,
            "origin": self.origin,
        }


def change_law_of_document(section: Mapping[str, Any] | None) -> ChangeLaw | None:
    """The section ``winds`` of a document's ``change``, if it has one; ValueError if it is not valid."""
    if section is None:
        return None
    names = ("spread", "power", "latitude", "slope", "freedom", "most_freedom")
    numbers = {name: float(section[name]) for name in names}
    return ChangeLaw(**numbers, situations=int(section["n"]), origin=section.get("origin", ""))
