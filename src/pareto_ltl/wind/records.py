"""Wind as stages hand it on: readings in the plane of a scene, and the fitted field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.support.arrays import FloatArray, require_shape
from pareto_ltl.support.display import Displayed


@dataclass(frozen=True, slots=True)
class WindObservations:
    """Wind readings in the plane of the scene.

    Attributes
    ----------
    times : (K,) float
        Increasing [s since time_zero].
    points : tuple of (n_k, 2) float
        Where each time's readings were taken [m].
    winds : tuple of (n_k, 2) float
        Towards +x and +y of the plane [m/s].
    source : str
        What the readings are, for the records of the run.
    """

    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    source: str

    def __post_init__(self) -> None:
        if not len(self.times) == len(self.points) == len(self.winds):
            raise ValueError("times, points and winds must have one entry per observation time")
        if np.any(np.diff(self.times) <= 0):
            raise ValueError("observation times must increase")


@dataclass(frozen=True, slots=True)
class WindModes:
    """Karhunen-Loeve modes of the posterior: w(x) = μ(x) + ψ(x)' θ, one θ ~ N(0, I) a flight, slot and
    component.

    Attributes
    ----------
    origin : (2,) float
        South-west node of the modes' own lattice [m]; neighbours are ``spacing`` [m] apart.
    psi : (K, MX, MY, 2, P) float32
        U √Λ [m/s]; modes that a slot does not need are 0.
    rho : float
        θ_{k+1} = ρ θ_k + √(1 - ρ²) η between slots ``gap`` [s] apart; 0 independent, 1 frozen.
    gap : float
        Median time between slots [s].
    length : (K, 2) float
        Length scale of the Gaussian process [m].
    energy : (K, 2) float
        Share of the posterior variance that the modes carry.
    """

    origin: FloatArray
    spacing: float
    psi: NDArray[np.float32]
    rho: float
    gap: float
    length: FloatArray
    energy: FloatArray

    def __post_init__(self) -> None:
        require_shape("psi", self.psi, None, None, None, 2, None)
        require_shape("length", self.length, len(self.psi), 2)
        require_shape("energy", self.energy, len(self.psi), 2)
        if not 0.0 <= self.rho <= 1.0:
            raise ValueError(f"rho must lie in [0, 1], got {self.rho}")


@dataclass(frozen=True, slots=True, repr=False)
class WindField(Displayed):
    """Posterior wind on a regular lattice, linear in time between its slots.

    Attributes
    ----------
    origin : (2,) float
        South-west node [m]; neighbours are ``spacing`` [m] apart.
    times : (K,) float
        Slots [s since time_zero].
    mean : (K, NX, NY, 2) float
        Expected wind [m/s]; axis 1 runs east, axis 2 runs north.
    latent_var : (K, NX, NY, 2) float
        Variance of the smooth field, per component [m²/s²].
    gust_var : (K, 2) float
        Variance of the white part, independent from step to step [m²/s²].
    hold_last : bool
        Whether the last slot stands in for all later times.
    score : mapping of name to float
        How well the fit predicts held-out readings (``gp_z_sd``, ``gp_coverage_90``).
    source : str
        What the field was made from.
    modes : WindModes or None
        How the smooth part hangs together over a flight; None where nothing is uncertain.
    gust_time : float
        Integral time scale of the white part [s] in the coherent law.
    """

    origin: FloatArray
    spacing: float
    times: FloatArray
    mean: FloatArray
    latent_var: FloatArray
    gust_var: FloatArray
    hold_last: bool = False
    score: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    modes: WindModes | None = None
    gust_time: float = 1800.0

    def __post_init__(self) -> None:
        require_shape("mean", self.mean, len(self.times), None, None, 2)
        if self.latent_var.shape != self.mean.shape:
            raise ValueError(f"latent_var must match mean {self.mean.shape}, got {self.latent_var.shape}")
        require_shape("gust_var", self.gust_var, len(self.times), 2)
        if self.modes is not None and len(self.modes.psi) != len(self.times):
            raise ValueError(f"modes must have {len(self.times)} slots, got {len(self.modes.psi)}")

    def facts(self) -> Mapping[str, str]:
        k, east, north = self.mean.shape[:3]
        return {
            "slots": f"{k} over {float(self.times[-1] - self.times[0]) / 3600:.1f} h",
            "lattice": f"{east} x {north} nodes, {self.spacing / 1e3:g} km apart",
            "mean speed": f"{float(np.linalg.norm(self.mean, axis=-1).mean()):.1f} m/s",
            "source": self.source or "unknown",
        }
