"""Records of wind: readings in a plane, and a field with the modes of its error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from wind_laws.error_law import FORECAST as FORECAST_PART
from wind_laws.error_law import PART_NAMES, ErrorLaw, LawPart
from wind_laws.lattice import NodeLattice, lattice_slopes, lattice_values
from wind_laws.types import Float32Array, FloatArray, IntArray, require_shape

PARTS = (  # of the error of a field
    "interpolation in space", "forecast", "interpolation in time", "ensemble", "change of a held field",
    *(f"{name} part of the forecast" for name in PART_NAMES),
)  # fmt: skip
SPACE, FORECAST, TIME, ENSEMBLE, HELD = range(5)
FORECAST_PARTS = {FORECAST_PART: FORECAST, **{name: 5 + n for n, name in enumerate(PART_NAMES)}}  # of a law


def forecast_parts(error: ErrorLaw | None) -> tuple[tuple[int, LawPart], ...]:
    """The parts of the error of forecasts, each with its number among ``PARTS``."""
    return () if error is None else tuple((FORECAST_PARTS[part.name], part) for part in error.parts)


@dataclass(frozen=True, slots=True)
class PlacedReadings:
    """Wind readings in a plane.

    Attributes
    ----------
    times : (K,) float
        Increasing [s].
    points : tuple of (n_k, 2) float
        Positions of the readings at each time [m].
    winds : tuple of (n_k, 2) float
        Winds towards +x and +y of the plane [m/s].
    source : str
        Description of the readings.
    leads : (K,) float
        Valid time minus start of the forecast [s]; NaN if it is not known. Empty: all NaN.
    level : str
        Height of the wind, e.g. ``10m``.
    until : float or None
        End of the time for which the wind is known [s]; None: the last time.
    ends : str
        Why it is not known for longer, for messages.
    error : ErrorLaw or None
        Error of forecasts and change of the wind in time; None: neither is covered.
    members : tuple of K (n_k, 2, M) float
        Deviations of the members of an ensemble at ``points`` [m/s], whose sum of squares is the variance.
    """

    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    source: str
    leads: FloatArray = field(default_factory=lambda: np.empty(0))
    level: str = "10m"
    until: float | None = None
    ends: str = ""
    error: ErrorLaw | None = None
    members: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.leads):
            object.__setattr__(self, "leads", np.full(len(self.times), np.nan))
        require_shape("leads", self.leads, len(self.times))
        if self.members and [m.shape[:1] for m in self.members] != [p.shape[:1] for p in self.points]:
            raise ValueError("members must have one row for each reading")
        if not len(self.times) == len(self.points) == len(self.winds):
            raise ValueError("times, points and winds must have one entry per observation time")
        if np.any(np.diff(self.times) <= 0):
            raise ValueError("observation times must increase")


Readings = TypeVar("Readings", bound=PlacedReadings)


def readings_until(readings: Readings, horizon: float | None, ends: str = "") -> Readings:
    """The readings up to the first time at or after ``horizon`` [s]; ``ends`` says why they end there."""
    if horizon is None:
        return readings
    n = min(int(np.searchsorted(readings.times, horizon)) + 1, len(readings.times))
    if n == len(readings.times):
        return readings
    return replace(
        readings,
        times=readings.times[:n],
        points=readings.points[:n],
        winds=readings.winds[:n],
        leads=readings.leads[:n],
        members=readings.members[:n],
        until=float(readings.times[n - 1]),
        ends=ends,
    )


@dataclass(frozen=True, slots=True)
class WindModes:
    """Karhunen-Loeve modes of the error of a wind field, one θ per flight, slot and component::

        w(x)    = μ(x) + ψ(x)' θ,            θ ~ N(0, I)
        θ_{k+1} = ρ θ_k + √(1 - ρ²) η,       η ~ N(0, I)

    Every mode belongs to a part of the error, and each part has one ρ .

    Attributes
    ----------
    origin : (2,) float
        South-west node of the lattice of the modes [m]; neighbours are ``spacing`` [m] apart.
    psi : (K, MX, MY, 2, P) float32
        U √Λ [m/s], for the part ``TIME`` with a variance of 1; unused modes are 0.
    part : (P,) int
        Index into ``PARTS`` of each mode, -1 for unused ones.
    rho : float
        Correlation of θ of the part ``SPACE`` between slots ``gap`` [s] apart: 0 for independent slots, 1 for
        a constant field.
    gap : float
        Median time between slots [s].
    length : (K, 2) float
        Shortest length scale of the parts [m].
    energy : (K, 2) float
        Share of the variance of the error that the modes carry.
    rest_length : float
        Correlation length [m] of the remainder, the integral of its correlation over the distance.
    """

    origin: FloatArray
    spacing: float
    psi: NDArray[np.float32]
    part: IntArray
    rho: float
    gap: float
    length: FloatArray
    energy: FloatArray
    rest_length: float = 0.0

    def __post_init__(self) -> None:
        require_shape("psi", self.psi, None, None, None, 2, None)
        require_shape("part", self.part, self.psi.shape[-1])
        if len(self.part) and not (self.part.min() >= -1 and self.part.max() < len(PARTS)):
            raise ValueError(f"part must lie in -1..{len(PARTS) - 1}")
        if not 0.0 <= self.rest_length < math.inf:
            raise ValueError(f"rest_length must not be negative, got {self.rest_length}")
        require_shape("length", self.length, len(self.psi), 2)
        require_shape("energy", self.energy, len(self.psi), 2)
        if not 0.0 <= self.rho <= 1.0:
            raise ValueError(f"rho must lie in [0, 1], got {self.rho}")

    def between(self, table: FloatArray, places: FloatArray) -> FloatArray:
        """``table`` (MX, MY, ...) on the lattice of the modes at ``places`` (N, 2) [m], (N, ...)."""
        return lattice_values(self, table, places)


@dataclass(frozen=True, slots=True)
class WindEvidence:
    """The readings and hyperparameters of a field, from which it can be fitted again.

    Attributes
    ----------
    points, winds : tuple of K (n_k, 2) float
        Positions [m] and winds [m/s] of the readings of each slot.
    kernel : str
        ``matern12``, ``matern32`` or ``rbf``.
    hyper : (K, 2, 4) float
        Prior mean, amplitude [m/s], length scale [m] and noise [m/s] of each process.
    """

    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    kernel: str
    hyper: FloatArray

    def __post_init__(self) -> None:
        require_shape("hyper", self.hyper, len(self.points), 2, 4)
        if [p.shape for p in self.points] != [w.shape for w in self.winds]:
            raise ValueError("points and winds must have the same shapes")


@dataclass(frozen=True, slots=True)
class UncertainWind:
    """Posterior wind on a regular lattice, linear in time between its slots.

    Attributes
    ----------
    origin : (2,) float
        South-west node [m]; neighbours are ``spacing`` [m] apart.
    times : (K,) float
        Slots [s].
    mean : (K, NX, NY, 2) float
        Expected wind [m/s]; axis 1 runs east, axis 2 runs north.
    latent_var : (K, NX, NY, 2) float
        Variance of the smooth part of the error at the time of a slot, per component [m²/s²].
    gust_var : (K, 2) float
        Variance of the white part, which is independent from step to step [m²/s²].
    until : float or None
        End of the time for which the wind is known [s]; after the last slot, the field of the
        last slot is used. None: the time of the last slot.
    score : mapping of name to float
        Accuracy of predictions of held-out readings: ``gp_z_sd``, ``gp_coverage_90``.
    source : str
        Description of the readings.
    modes : WindModes or None
        Modes of the smooth part for the coherent law; None if its variance is 0.
    gust_time : float
        Time constant of the white part under the coherent law [s], twice the integral of its correlation over
        time: over a time T it displaces a flight with the standard deviation √(σ² gust_time T).
    evidence : WindEvidence or None
        Readings and hyperparameters of the fit; None if the field was not fitted.
    leads : (K,) float
        Lead of the forecast of each slot [s]; NaN if it is not known. Empty: all NaN.
    level : str
        Height of the wind, e.g. ``10m``.
    ends : str
        Why the wind is not known for longer, for messages.
    error : ErrorLaw or None
        The law of forecast errors that ``latent_var`` includes, and of the change of the wind in time.
    held : float or None
        Time of the last field of the data [s], if the slots are that field, conditioned on position fixes at
        later times: then ``latent_var`` includes the variance of the change since the field. None: the last
        slot is the last field.
    """

    origin: FloatArray
    spacing: float
    times: FloatArray
    mean: FloatArray
    latent_var: FloatArray
    gust_var: FloatArray
    until: float | None = None
    score: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    modes: WindModes | None = None
    gust_time: float = 1800.0
    evidence: WindEvidence | None = None
    leads: FloatArray = field(default_factory=lambda: np.empty(0))
    level: str = "10m"
    ends: str = ""
    error: ErrorLaw | None = None
    held: float | None = None

    @property
    def lattice(self) -> NodeLattice:
        """The nodes of ``mean``."""
        east, north = self.mean.shape[1:3]
        return NodeLattice(self.origin, self.spacing, (east, north))

    def __post_init__(self) -> None:
        if not len(self.leads):
            object.__setattr__(self, "leads", np.full(len(self.times), np.nan))
        require_shape("leads", self.leads, len(self.times))
        require_shape("mean", self.mean, len(self.times), None, None, 2)
        if self.latent_var.shape != self.mean.shape:
            raise ValueError(f"latent_var must match mean {self.mean.shape}, got {self.latent_var.shape}")
        require_shape("gust_var", self.gust_var, len(self.times), 2)
        if self.modes is not None and len(self.modes.psi) != len(self.times):
            raise ValueError(f"modes must have {len(self.times)} slots, got {len(self.modes.psi)}")
        if self.evidence is not None and len(self.evidence.points) != len(self.times):
            raise ValueError(f"evidence must have {len(self.times)} slots, got {len(self.evidence.points)}")

    @property
    def known_until(self) -> float:
        """End of the time for which the wind is known [s]."""
        return float(self.times[-1]) if self.until is None else self.until

    @property
    def floor(self) -> float:
        """The least rate that the data of the law of forecast errors can say; 0 without such a law."""
        return self.error.floor if self.error is not None and self.error.parts else 0.0

    @property
    def last_field(self) -> float:
        """Time of the last field of the data [s]; later wind is that field, held."""
        return float(self.times[-1]) if self.held is None else self.held

    def at(self, x: Any, t: float) -> FloatArray:
        """Expected wind (N, 2) [m/s] at positions ``x`` (N, 2) [m] and the time ``t`` [s].

        Bilinear on the lattice and linear between slots; constant beyond the lattice, before the first slot
        and after the last.
        """
        return lattice_values(self, self._mean_at(t), np.atleast_2d(np.asarray(x, float)))

    def gradient(self, x: Any, t: float) -> FloatArray:
        """Derivative (N, 2, 2) [1/s] of :meth:`at`, by component and direction; 0 beyond the lattice."""
        return lattice_slopes(self, self._mean_at(t), np.atleast_2d(np.asarray(x, float)))

    def _mean_at(self, t: float) -> FloatArray:
        """``mean`` (NX, NY, 2) at ``t``."""
        at = np.interp(t, self.times, np.arange(len(self.times)))
        k = min(int(at), len(self.times) - 1)
        share = float(at) - k
        if share == 0.0:
            return np.asarray(self.mean[k], float)
        return np.asarray((1.0 - share) * self.mean[k] + share * self.mean[k + 1], float)

    def later(self, moment: float) -> Self:
        """The field from the last slot at or before ``moment`` [s] on, with times that count from ``moment``.

        Its evidence is dropped: the fit also used the slots before.
        """
        from wind_laws.conditioned import field_from

        return field_from(self, moment)

    def given(self, theta: FloatArray, known: FloatArray) -> Self:
        """The field conditioned on position fixes at time 0 (:mod:`wind_laws.conditioned`).

        ``theta`` (2, P) is the expected θ by component, ``known`` (N, 2, P) the matrix B of its covariance
        I - B' B.
        """
        from wind_laws.conditioned import conditioned_field

        return conditioned_field(self, theta, known)

    def coefficients_given(
        self, theta: Float32Array, slots: IntArray, expected: FloatArray, known: FloatArray
    ) -> Float32Array:
        """θ (E, n, 2, P) of winds of this field as coefficients of the modes of the field :meth:`given`.

        ``slots`` (E,) are of that field, ``known`` is as there; ``expected`` (2, P) or (n, 2, P) is the
        expected θ, of all winds or of each.
        """
        from wind_laws.conditioned import conditioned_coefficients

        return conditioned_coefficients(self, theta, slots, expected, known)

    def time_variance(self, t: FloatArray) -> FloatArray:
        """Variance [m²/s²] of interpolation in time at times ``t`` (S,) [s], shape (S,).

        It is 0 at the times of the slots; after the last slot, it is the variance of the change since then.
        In a field with ``held`` it is 0: ``latent_var`` includes it.
        """
        if self.error is None or self.held is not None:
            return np.zeros(len(t))
        late = np.maximum(t - self.times[-1], 0.0)
        held = self.error.change_variance(late)
        if len(self.times) == 1:
            return held
        slot = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        gap = np.diff(self.times)[slot]
        share = np.clip((t - self.times[slot]) / gap, 0.0, 1.0)
        return np.asarray(np.where(late > 0.0, held, self.error.between_variance(share, gap)), float)
