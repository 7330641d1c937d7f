"""Records of wind: readings in the plane of a scene, modes, and the fitted field."""

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
        Positions of the readings at each time [m].
    winds : tuple of (n_k, 2) float
        Towards +x and +y of the plane [m/s].
    source : str
        Description of the readings for the records of the run.
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
    """Karhunen-Loeve modes of the posterior wind, one θ per flight, slot and component::

        w(x)    = μ(x) + ψ(x)' θ,            θ ~ N(0, I)
        θ_{k+1} = ρ θ_k + √(1 - ρ²) η,       η ~ N(0, I)

    Attributes
    ----------
    origin : (2,) float
        South-west node of the lattice of the modes [m]; neighbours are ``spacing`` [m] apart.
    psi : (K, MX, MY, 2, P) float32
        U √Λ [m/s]; unused modes of a slot are 0.
    rho : float
        Correlation of θ between slots ``gap`` [s] apart: 0 for independent slots, 1 for a constant field.
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


@dataclass(frozen=True, slots=True)
class WindEvidence:
    """What a field was fitted from, so that it can be fitted again.

    Attributes
    ----------
    points, winds : tuple of K (n_k, 2) float
        Positions [m] and winds [m/s] of the readings of each slot.
    kernel : str
        ``matern32`` or ``rbf``.
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
        Variance of the white part, which is independent from step to step [m²/s²].
    hold_last : bool
        Whether the last slot holds for all later times.
    score : mapping of name to float
        Accuracy of predictions of held-out readings: ``gp_z_sd``, ``gp_coverage_90``.
    source : str
        Description of the readings.
    modes : WindModes or None
        Modes of the smooth part for the coherent law; None if its variance is 0.
    gust_time : float
        Integral time scale of the white part under the coherent law [s].
    evidence : WindEvidence or None
        Readings and hyperparameters of the fit; None if the field was not fitted.
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
    evidence: WindEvidence | None = None

    def __post_init__(self) -> None:
        require_shape("mean", self.mean, len(self.times), None, None, 2)
        if self.latent_var.shape != self.mean.shape:
            raise ValueError(f"latent_var must match mean {self.mean.shape}, got {self.latent_var.shape}")
        require_shape("gust_var", self.gust_var, len(self.times), 2)
        if self.modes is not None and len(self.modes.psi) != len(self.times):
            raise ValueError(f"modes must have {len(self.times)} slots, got {len(self.modes.psi)}")
        if self.evidence is not None and len(self.evidence.points) != len(self.times):
            raise ValueError(f"evidence must have {len(self.times)} slots, got {len(self.evidence.points)}")

    def facts(self) -> Mapping[str, str]:
        k, east, north = self.mean.shape[:3]
        return {
            "slots": f"{k} over {float(self.times[-1] - self.times[0]) / 3600:.1f} h",
            "lattice": f"{east} x {north} nodes, {self.spacing / 1e3:g} km apart",
            "mean speed": f"{float(np.linalg.norm(self.mean, axis=-1).mean()):.1f} m/s",
            "source": self.source or "unknown",
        }


__all__ = ["WindEvidence", "WindField", "WindModes", "WindObservations"]
