"""Fit the posterior wind and tabulate it on lattices: a pure function, so that its result can be cached."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind import gp, modes
from pareto_ltl.wind.records import WindObservations

WindTable = dict[str, Any]


class NodeLattice(NamedTuple):
    """Regular lattice: node (i, j) lies at ``origin + spacing * (i, j)`` [m]; ``shape`` is (NX, NY)."""

    origin: FloatArray
    spacing: float
    shape: tuple[int, int]

    def nodes(self) -> FloatArray:
        """Positions of all nodes, shape (NX * NY, 2) [m]; y varies fastest."""
        steps = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1)
        positions: FloatArray = self.origin + self.spacing * steps.reshape(-1, 2)
        return positions


class WindTask(NamedTuple):
    """Everything that a wind table depends on, apart from the code.

    Attributes
    ----------
    kernel, noise_min, holdout, energy, modes_max
        The settings of the same names in section ``wind``.
    times, points, winds
        The readings, as in :class:`WindObservations`.
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
    lattice: NodeLattice
    mode_lattice: NodeLattice


def tabulate_wind(task: WindTask, edition: str = "") -> WindTable:
    """Fit the readings of ``task`` and evaluate the posterior on its lattices.

    Parameters
    ----------
    edition : str
        Digest of the code; it only distinguishes the entries of the cache.

    Returns
    -------
    dict
        ``mean`` [m/s] and ``latent_var`` [m²/s²] (K, NX, NY, 2), ``gust_var`` (K, 2) [m²/s²], ``score``,
        ``psi`` (K, MX, MY, 2, P) [m/s], ``energy`` (K, 2), ``rho``, ``hyper`` (K, 2, 4) = prior
        mean, amplitude [m/s], length scale [m], noise [m/s].
    """
    cfg = WindConfig(kernel=task.kernel, noise_min=task.noise_min, holdout=task.holdout)
    posterior = gp.fit_posterior(cfg, WindObservations(task.times, task.points, task.winds, ""))
    mean, var = posterior.at(task.lattice.nodes())
    psi, energy = modes.posterior_modes(posterior, task.mode_lattice.nodes(), task.energy, task.modes_max)
    slots = len(task.times)
    return {
        "mean": mean.reshape(slots, *task.lattice.shape, 2),
        "latent_var": var.reshape(slots, *task.lattice.shape, 2),
        "gust_var": posterior.gust_var,
        "score": posterior.score,
        "psi": psi.reshape(slots, *task.mode_lattice.shape, 2, -1),
        "energy": energy,
        "rho": modes.error_persistence(posterior),
        "hyper": np.array(posterior.hyper),
    }


__all__ = ["NodeLattice", "WindTable", "WindTask", "tabulate_wind"]
