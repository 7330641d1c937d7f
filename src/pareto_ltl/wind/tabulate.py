"""Fit the posterior wind and tabulate it on lattices: a pure function, so that its result can be cached."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray, require_shape
from pareto_ltl.wind import gp, modes
from pareto_ltl.wind.records import NodeLattice, WindObservations


class WindTask(NamedTuple):
    """All inputs of a wind table.

    Attributes
    ----------
    kernel, noise_min, holdout, energy, modes_max
        The settings of the same names in section ``wind``.
    times, points, winds, members
        The readings, as in :class:`WindObservations`.
    bounds : (2, 2) float
        South-west and north-east corner of the map, where the fit is scored [m].
    forecast_var, time_var : (K,) float
        As in :class:`~pareto_ltl.wind.modes.ErrorParts`.
    forecast_length, time_length : float
        As in :class:`~pareto_ltl.wind.modes.ErrorParts`.
    lattice, mode_lattice : NodeLattice
        Nodes of the field, and the coarser nodes of its modes.
    """

    kernel: str
    noise_min: float
    holdout: float
    energy: float
    modes_max: int
    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    members: tuple[FloatArray, ...]
    bounds: FloatArray
    forecast_var: FloatArray
    forecast_length: float
    time_var: FloatArray
    time_length: float
    lattice: NodeLattice
    mode_lattice: NodeLattice


class WindTable(NamedTuple):
    """The posterior wind on the lattices of a task with K times.

    Attributes
    ----------
    mean : (K, NX, NY, 2) float
        Expected wind [m/s].
    latent_var : (K, NX, NY, 2) float
        Variance of the smooth part of the error [m²/s²].
    gust_var : (K, 2) float
        Variance of the white part [m²/s²].
    psi : (K, MX, MY, 2, P) float
        Modes [m/s].
    part : (P,) int
        The part of the error to which each mode belongs.
    energy : (K, 2) float
        Share of the variance that the modes carry.
    hyper : (K, 2, 4) float
        Prior mean [m/s], amplitude [m/s], length scale [m], noise [m/s].
    rho : float
        Correlation of the errors of interpolation in space from one time to the next.
    rest_length : float
        Correlation length of the remainder that the modes do not carry [m].
    score : dict of str to float
        Scores of held-out readings; NaN if there were too few.
    """

    mean: FloatArray
    latent_var: FloatArray
    gust_var: FloatArray
    psi: Float32Array
    part: IntArray
    energy: FloatArray
    hyper: FloatArray
    rho: float
    rest_length: float
    score: dict[str, float]

    def check_for(self, task: WindTask) -> None:
        """Raise ``ValueError`` if this is not a table of ``task``: wrong shapes, NaN, values out of range."""
        slots, nodes, modes = len(task.times), task.lattice.shape, task.mode_lattice.shape
        require_shape("mean", self.mean, slots, *nodes, 2)
        require_shape("latent_var", self.latent_var, slots, *nodes, 2)
        require_shape("gust_var", self.gust_var, slots, 2)
        require_shape("psi", self.psi, slots, *modes, 2, None)
        require_shape("part", self.part, self.psi.shape[-1])
        require_shape("energy", self.energy, slots, 2)
        require_shape("hyper", self.hyper, slots, 2, 4)
        for name, array in self._asdict().items():
            kind = "i" if name == "part" else "f"
            if isinstance(array, np.ndarray) and not (array.dtype.kind == kind and np.isfinite(array).all()):
                raise ValueError(f"{name} is not finite")
        if not 0.0 <= self.rest_length < np.inf:
            raise ValueError("rest_length is negative or not finite")
        if not (min(self.latent_var.min(), self.gust_var.min()) >= 0 and 0 <= self.rho <= 1):
            raise ValueError("a variance is negative, or rho is not between 0 and 1")


def tabulate_wind(task: WindTask) -> WindTable:
    """Fit the readings of ``task`` and evaluate the posterior on its lattices."""
    cfg = WindConfig(kernel=task.kernel, noise_min=task.noise_min, holdout=task.holdout)
    observations = WindObservations(task.times, task.points, task.winds, "")
    posterior = gp.fit_posterior(cfg, observations, task.bounds)
    nodes, mode_nodes = task.lattice.nodes(), task.mode_lattice.nodes()
    mean, var = posterior.at(nodes)
    var = var + task.forecast_var[:, None, None] + (posterior.spread_out(task.members, nodes) ** 2).sum(-1)
    parts = modes.ErrorParts(
        task.forecast_var, task.forecast_length, task.time_var, task.time_length,
        posterior.spread_out(task.members, mode_nodes),
    )  # fmt: skip
    found = modes.error_modes(
        posterior, parts, task.mode_lattice.shape, mode_nodes, task.energy, task.modes_max
    )
    slots = len(task.times)
    return WindTable(
        mean=mean.reshape(slots, *task.lattice.shape, 2),
        latent_var=var.reshape(slots, *task.lattice.shape, 2),
        gust_var=posterior.gust_var,
        psi=found.psi.reshape(slots, *task.mode_lattice.shape, 2, -1),
        part=found.part,
        energy=found.energy,
        hyper=np.array(posterior.hyper),
        rho=modes.error_persistence(posterior),
        rest_length=found.rest_length,
        score=posterior.score,
    )
