"""From wind readings to the wind field that planning uses: the posterior on a lattice."""

from __future__ import annotations

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.fit_cache import cached_wind_table
from pareto_ltl.wind.gp import Hyper
from pareto_ltl.wind.records import WindEvidence, WindField, WindModes, WindObservations
from pareto_ltl.wind.tabulate import NodeLattice, WindTable, WindTask, tabulate_wind
from pareto_ltl.world.scene import Scene

FEWEST_MODE_CELLS, MOST_MODE_CELLS = 10, 24  # of the lattice of the modes, along the longer side of the scene
FEWEST_CELLS = 20  # of the lattice, along the longer side of the scene
MOST_CELLS = 400  # of the lattice, along its longer side
LENGTH = Hyper._fields.index("length")


def fit_wind_field(
    cfg: WindConfig, observations: WindObservations, scene: Scene, horizon: float | None = None
) -> WindField:
    """Tabulate the posterior wind on a lattice that covers ``scene`` and ``cfg.padding`` around it.

    Without readings the wind is calm: zero mean and variance in one slot that holds for all times.

    Parameters
    ----------
    horizon : float, optional
        End of the longest flight [s since time_zero]; of the slots from there on only the first is used.
    """
    lattice = wind_lattice(cfg, scene)
    if not any(len(points) for points in observations.points):
        return _calm_field(lattice, observations.source)
    seen = _observations_until(observations, horizon)
    task = WindTask(
        kernel=cfg.kernel,
        noise_min=cfg.noise_min,
        holdout=cfg.holdout,
        energy=cfg.energy,
        modes_max=cfg.modes_max,
        times=seen.times,
        points=seen.points,
        winds=seen.winds,
        lattice=lattice,
        mode_lattice=modes_lattice(cfg, scene),
    )
    table = cached_wind_table(task) if cfg.cache else tabulate_wind(task)
    return WindField(
        origin=lattice.origin,
        spacing=lattice.spacing,
        times=seen.times,
        mean=table.mean,
        latent_var=table.latent_var,
        gust_var=table.gust_var,
        hold_last=cfg.hold_last,
        score=table.score,
        source=seen.source,
        modes=_wind_modes(cfg, seen.times, task.mode_lattice, table),
        gust_time=cfg.gust_time,
        evidence=WindEvidence(seen.points, seen.winds, cfg.kernel, table.hyper),
    )


def _calm_field(lattice: NodeLattice, source: str) -> WindField:
    still = np.zeros((1, *lattice.shape, 2))
    return WindField(
        origin=lattice.origin,
        spacing=lattice.spacing,
        times=np.zeros(1),
        mean=still,
        latent_var=still.copy(),
        gust_var=np.zeros((1, 2)),
        hold_last=True,
        source=source,
    )


def _wind_modes(
    cfg: WindConfig, times: FloatArray, lattice: NodeLattice, table: WindTable
) -> WindModes | None:
    """The modes in ``table``; None if there are none, that is, if the variance is 0."""
    if table.psi.shape[-1] == 0:
        return None
    return WindModes(
        origin=lattice.origin,
        spacing=lattice.spacing,
        psi=table.psi,
        rho=table.rho if cfg.rho is None else cfg.rho,
        gap=float(np.median(np.diff(times))) if len(times) > 1 else 1.0,
        length=table.hyper[:, :, LENGTH],
        energy=table.energy,
    )


def modes_lattice(cfg: WindConfig, scene: Scene) -> NodeLattice:
    """The coarser lattice of the modes, which covers the scene and one cell around it.

    Variance that this lattice does not resolve is part of the white variance, the remainder of the posterior
    variance.
    """
    extent = scene.bounds[1] - scene.bounds[0]
    side = float(extent.max())
    spacing = min(max(cfg.modes_spacing, side / MOST_MODE_CELLS), side / FEWEST_MODE_CELLS)
    cells = np.ceil(extent / spacing - 1e-9).astype(int) + 2
    origin = scene.bounds.mean(axis=0) - 0.5 * spacing * cells
    return NodeLattice(origin, spacing, (int(cells[0]) + 1, int(cells[1]) + 1))


def wind_lattice(cfg: WindConfig, scene: Scene) -> NodeLattice:
    """The lattice of the wind field.

    It extends beyond the bounds by ``cfg.padding``, at most by the longer side of the scene. Its spacing is
    ``cfg.spacing``, finer for a small scene and coarser for a large one.
    """
    side = float(np.max(scene.bounds[1] - scene.bounds[0]))
    padding = min(cfg.padding, side)
    spacing = max(min(cfg.spacing, side / FEWEST_CELLS), (side + 2 * padding) / MOST_CELLS)
    extent = scene.bounds[1] - scene.bounds[0] + 2 * padding
    cells = np.maximum(1, np.ceil(extent / spacing - 1e-9)).astype(int)
    origin = scene.bounds.mean(axis=0) - 0.5 * spacing * cells
    return NodeLattice(origin, spacing, (int(cells[0]) + 1, int(cells[1]) + 1))


def _observations_until(observations: WindObservations, horizon: float | None) -> WindObservations:
    """The observations up to the first time at or after ``horizon`` [s since time_zero]."""
    if horizon is None:
        return observations
    n = int(np.searchsorted(observations.times, horizon)) + 1
    return WindObservations(
        observations.times[:n], observations.points[:n], observations.winds[:n], observations.source
    )


__all__ = ["fit_wind_field", "modes_lattice", "wind_lattice"]
