"""The wind field that planning uses: the posterior of wind readings on a lattice."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.display import probability_text
from pareto_ltl.wind.fit_cache import WindTable, WindTask, cached_wind_table, tabulate_wind
from pareto_ltl.wind.gp import Hyper
from pareto_ltl.wind.modes import ErrorParts
from pareto_ltl.wind.readings import HOUR
from pareto_ltl.wind.records import NodeLattice, WindEvidence, WindField, WindModes, WindObservations
from pareto_ltl.world.scene import Scene

FEWEST_MODE_CELLS, MOST_MODE_CELLS = 10, 24  # of the lattice of the modes, along the longer side of the scene
FEWEST_CELLS = 20  # of the lattice, along the longer side of the scene
MOST_CELLS = 500  # of the lattice, along its longer side
LEAST_COVERAGE, MOST_COVERAGE = 0.8, 0.97  # of 90 % intervals; outside this range a warning is logged
SAMPLES = 16  # instants at which a variance is averaged over time
LOG = logging.getLogger(__name__)
FIT_SETTINGS = ("kernel", "noise_min", "holdout", "energy", "modes_max")  # that a table depends on
LENGTH = Hyper._fields.index("length")


def fit_wind_field(
    cfg: WindConfig, observations: WindObservations, scene: Scene, horizon: float | None = None
) -> WindField:
    """Tabulate the posterior wind on a lattice that covers ``scene`` and ``cfg.padding`` around it.

    Without readings the wind is calm: zero mean and variance in one slot that holds for all times.

    Parameters
    ----------
    horizon : float, optional
        End of the longest flight [s since time_zero]; slots after the first one from there on are not used.
    """
    lattice = wind_lattice(cfg, scene)
    if not any(len(points) for points in observations.points):
        still, time = np.zeros((1, *lattice.shape, 2)), np.zeros(1)
        return WindField(
            lattice.origin, lattice.spacing, time, still, still.copy(), np.zeros((1, 2)),
            until=math.inf, source=observations.source,
        )  # fmt: skip
    seen = observations_until(observations, horizon)
    if cfg.hold_last:  # the last field is valid for longer
        seen = replace(seen, until=float(seen.times[-1]) + HOUR * cfg.max_gap)
    task = _wind_task(cfg, seen, scene, lattice, horizon)
    table = cached_wind_table(task) if cfg.cache else tabulate_wind(task)
    _warn_about_score(table, cfg)
    return WindField(
        origin=lattice.origin,
        spacing=lattice.spacing,
        times=seen.times,
        mean=table.mean,
        latent_var=table.latent_var,
        gust_var=table.gust_var,
        until=seen.until,
        score=table.score,
        source=seen.source,
        modes=_wind_modes(cfg, seen, task.mode_lattice, table),
        gust_time=cfg.gust_time,
        evidence=WindEvidence(seen.points, seen.winds, cfg.kernel, table.hyper),
        leads=seen.leads,
        level=seen.level,
        ends=seen.ends,
        error=seen.error,
    )


def _wind_task(
    cfg: WindConfig, seen: WindObservations, scene: Scene, lattice: NodeLattice, horizon: float | None
) -> WindTask:
    """The input of the fit and of the tabulation, with the variances of the parts of the error."""
    forecast, lengths = np.zeros(len(seen.times)), (1.0, 1.0)
    if seen.error is not None:
        forecast = seen.error.forecast_variance(seen.leads)
        lengths = seen.error.forecast_length, seen.error.change_length
    return WindTask(
        cfg=WindConfig(**{name: getattr(cfg, name) for name in FIT_SETTINGS}),
        seen=WindObservations(seen.times, seen.points, seen.winds, "", members=seen.members),
        bounds=scene.bounds,
        parts=ErrorParts(forecast, lengths[0], time_variances(seen, horizon), lengths[1]),
        lattice=lattice,
        mode_lattice=modes_lattice(cfg, scene),
    )


def time_variances(seen: WindObservations, horizon: float | None) -> FloatArray:
    """Variance of interpolation in time, averaged over the times nearest to each slot: (K,) [m²/s²]."""
    law, times = seen.error, seen.times
    if law is None:
        return np.zeros(len(times))
    end = min(times[-1] if seen.until is None else seen.until, np.inf if horizon is None else horizon)
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    gaps = np.diff(times)
    halves = [law.between_variance(0.5 * share, np.full(SAMPLES, gap)).mean() for gap in gaps]
    before = np.concatenate([[0.0], gaps, [0.0]]) / 2
    weight = np.concatenate([[0.0], halves, [0.0]]) * before
    total, width = weight[:-1] + weight[1:], before[:-1] + before[1:]
    if 0.0 < (held := end - times[-1]) < np.inf:
        total[-1] += held * law.change_variance(held * share).mean()
        width[-1] += held
    return np.asarray(np.where(width > 0, total / np.maximum(width, 1e-300), 0.0), float)


def _warn_about_score(table: WindTable, cfg: WindConfig) -> None:
    """Log a warning if the predictions of held-out readings show that the intervals of the fit are wrong."""
    covered = table.score.get("gp_coverage_90", math.nan)
    least = covered > MOST_COVERAGE and bool((table.hyper[..., 3] <= cfg.noise_min).all())
    if covered < LEAST_COVERAGE or covered > MOST_COVERAGE:
        LOG.warning(
            "of the wind readings on the map that the fit did not see, %s lie within its 90 %% intervals "
            "(expected %s to %s): promised probabilities are %s; try %swind.kernel, or more readings",
            probability_text(covered), probability_text(LEAST_COVERAGE), probability_text(MOST_COVERAGE),
            "too low" if covered < LEAST_COVERAGE else "higher than necessary",
            f"wind.noise_min below {cfg.noise_min:g} m/s, " if least else "",
        )  # fmt: skip


def _wind_modes(
    cfg: WindConfig, seen: WindObservations, lattice: NodeLattice, table: WindTable
) -> WindModes | None:
    """The modes in ``table``; None if there are none, because the variance is 0."""
    if table.psi.shape[-1] == 0:
        return None
    lengths = table.hyper[:, :, LENGTH]
    if seen.error is not None:
        lengths = np.minimum(lengths, min(seen.error.forecast_length, seen.error.change_length))
    return WindModes(
        origin=lattice.origin,
        spacing=lattice.spacing,
        psi=table.psi,
        part=table.part,
        rho=table.rho if cfg.rho is None else cfg.rho,
        gap=float(np.median(np.diff(seen.times))) if len(seen.times) > 1 else 1.0,
        length=lengths,
        energy=table.energy,
        rest_length=table.rest_length,
    )


def modes_lattice(cfg: WindConfig, scene: Scene) -> NodeLattice:
    """The coarser lattice of the modes, which covers the scene and one cell around it.

    Variance that this lattice does not resolve is added to the white variance.
    """
    extent = scene.bounds[1] - scene.bounds[0]
    side = float(extent.max())
    spacing = min(max(cfg.modes_spacing, side / MOST_MODE_CELLS), side / FEWEST_MODE_CELLS)
    return _centred_lattice(scene, spacing, np.ceil(extent / spacing - 1e-9).astype(int) + 2)


def wind_lattice(cfg: WindConfig, scene: Scene) -> NodeLattice:
    """The lattice of the wind field.

    It extends beyond the bounds by ``cfg.padding``, at most by the longer side of the scene. Its spacing is
    ``cfg.spacing``, finer for a small scene and coarser for a large one.
    """
    side = float(np.max(scene.bounds[1] - scene.bounds[0]))
    padding = min(cfg.padding, side)
    spacing = max(min(cfg.spacing, side / FEWEST_CELLS), (side + 2 * padding) / MOST_CELLS)
    extent = scene.bounds[1] - scene.bounds[0] + 2 * padding
    return _centred_lattice(scene, spacing, np.maximum(1, np.ceil(extent / spacing - 1e-9)).astype(int))


def _centred_lattice(scene: Scene, spacing: float, cells: IntArray) -> NodeLattice:
    """The lattice of ``cells`` (2,) around the middle of ``scene``."""
    origin = scene.bounds.mean(axis=0) - 0.5 * spacing * cells
    return NodeLattice(origin, spacing, (int(cells[0]) + 1, int(cells[1]) + 1))


def observations_until(observations: WindObservations, horizon: float | None) -> WindObservations:
    """The observations up to the first time at or after ``horizon`` [s since time_zero]."""
    if horizon is None:
        return observations
    n = min(int(np.searchsorted(observations.times, horizon)) + 1, len(observations.times))
    if n == len(observations.times):
        return observations
    return replace(
        observations,
        times=observations.times[:n],
        points=observations.points[:n],
        winds=observations.winds[:n],
        leads=observations.leads[:n],
        members=observations.members[:n],
        until=float(observations.times[n - 1]),
        ends="planner.max_steps ends there",
    )
