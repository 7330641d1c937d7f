"""The wind field that planning uses: the posterior of wind readings on a lattice, and its cache on disk.

The cache has one archive ``KEY.npz`` for each table of the posterior. KEY is the fingerprint of all inputs of
the table. An entry holds only arrays, each with a checksum; nothing in it is executed. An entry that is
damaged, or whose shapes do not fit its task, is made again.
"""

from __future__ import annotations

import hashlib
import logging
import math
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from careful_io import folders
from careful_io.archives import read_npz
from careful_io.files import write_npz
from careful_io.fingerprints import code_fingerprint
from careful_io.texts import probability_text
from careful_io.times import HOUR
from pareto_ltl.settings import WindConfig
from pareto_ltl.support import cache
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray, require_shape
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind import gp, modes
from pareto_ltl.wind.records import (
    TIME,
    NodeLattice,
    WindEvidence,
    WindField,
    WindModes,
    WindObservations,
    forecast_parts,
)
from pareto_ltl.world.scene import Scene

FEWEST_MODE_CELLS, MAX_MODE_CELLS = 10, 24  # of the lattice of the modes, along the longer side of the scene
FEWEST_CELLS = 20  # of the lattice, along the longer side of the scene
MAX_CELLS = 500  # of the lattice, along its longer side
LEAST_COVERAGE, MAX_COVERAGE = 0.8, 0.97  # of 90 % intervals; outside this range a warning is logged
SAMPLES = 16  # instants at which a variance is averaged over time
LOG = logging.getLogger(__name__)
FIT_SETTINGS = ("kernel", "noise_min", "holdout", "energy", "modes_max")  # that a table depends on
LENGTH, NOISE = 2, 3  # columns of the hyperparameters of a table
# The code that a table depends on.
TABLE_CODE = ("pareto_ltl.wind.field", "pareto_ltl.wind.gp", "pareto_ltl.wind.modes")
TABLE_PACKAGES = ("numpy", "scipy", "scikit-learn")  # other versions round differently


class WindTask(NamedTuple):
    """All inputs of a wind table, and nothing else: what differs in a task is fitted anew.

    Attributes
    ----------
    cfg : WindConfig
        The settings of the fit and of the modes; all others have their default.
    seen : WindObservations
        The readings, with the deviations of members.
    bounds : (2, 2) float
        South-west and north-east corner of the map, where the fit is scored [m].
    parts : tuple of UniformPart
        The errors of forecasts and of interpolation in time.
    lattice, mode_lattice : NodeLattice
        Nodes of the field, and the coarser nodes of its modes.
    """

    cfg: WindConfig
    seen: WindObservations
    bounds: FloatArray
    parts: tuple[modes.UniformPart, ...]
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
        slots, nodes, coarse = len(task.seen.times), task.lattice.shape, task.mode_lattice.shape
        require_shape("mean", self.mean, slots, *nodes, 2)
        require_shape("latent_var", self.latent_var, slots, *nodes, 2)
        require_shape("gust_var", self.gust_var, slots, 2)
        require_shape("psi", self.psi, slots, *coarse, 2, None)
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
        air=seen.air,
    )


def _wind_task(
    cfg: WindConfig, seen: WindObservations, scene: Scene, lattice: NodeLattice, horizon: float | None
) -> WindTask:
    """The input of the fit and of the tabulation, with the variances of the parts of the error."""
    return WindTask(
        cfg=WindConfig(**{name: getattr(cfg, name) for name in FIT_SETTINGS}),
        seen=WindObservations(seen.times, seen.points, seen.winds, "", members=seen.members),
        bounds=scene.bounds,
        parts=uniform_parts(seen, horizon),
        lattice=lattice,
        mode_lattice=modes_lattice(cfg, scene),
    )


def uniform_parts(seen: WindObservations, horizon: float | None) -> tuple[modes.UniformPart, ...]:
    """The parts of the law of ``seen``, with their variance in each slot: 0 for a lead of NaN."""
    law = seen.error
    if law is None:
        return ()
    known = np.isfinite(seen.leads)
    return (
        *(
            modes.UniformPart(number, np.where(known, part.variance(seen.leads), 0.0), part.length)
            for number, part in forecast_parts(law)
        ),
        modes.UniformPart(TIME, time_variances(seen, horizon), law.change_length),
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
    least = covered > MAX_COVERAGE and bool((table.hyper[..., NOISE] <= cfg.noise_min).all())
    if covered < LEAST_COVERAGE or covered > MAX_COVERAGE:
        LOG.warning(
            "of the wind readings on the map that the fit did not see, %s lie within its 90 %% intervals "
            "(expected %s to %s): promised probabilities are %s; try %swind.kernel, or more readings",
            probability_text(covered), probability_text(LEAST_COVERAGE), probability_text(MAX_COVERAGE),
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
        lengths = np.minimum(lengths, seen.error.shortest_length)
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
    spacing = min(max(cfg.modes_spacing, side / MAX_MODE_CELLS), side / FEWEST_MODE_CELLS)
    return _centred_lattice(scene, spacing, np.ceil(extent / spacing - 1e-9).astype(int) + 2)


def wind_lattice(cfg: WindConfig, scene: Scene) -> NodeLattice:
    """The lattice of the wind field.

    It extends beyond the bounds by ``cfg.padding``, at most by the longer side of the scene. Its spacing is
    ``cfg.spacing``, finer for a small scene and coarser for a large one.
    """
    side = float(np.max(scene.bounds[1] - scene.bounds[0]))
    padding = min(cfg.padding, side)
    spacing = max(min(cfg.spacing, side / FEWEST_CELLS), (side + 2 * padding) / MAX_CELLS)
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


# --- tables and their cache ------------------------------------------------------------------


def tabulate_wind(task: WindTask) -> WindTable:
    """Fit the readings of ``task`` and evaluate the posterior on its lattices."""
    cfg, seen = task.cfg, task.seen
    posterior = gp.fit_posterior(cfg, seen, task.bounds)
    nodes, mode_nodes = task.lattice.nodes(), task.mode_lattice.nodes()
    mean, var = posterior.at(nodes)
    ensemble = (posterior.spread_out(seen.members, nodes) ** 2).sum(-1)
    forecasts = sum((each.variance for each in task.parts if each.part != TIME), np.zeros(len(seen.times)))
    var = var + forecasts[:, None, None] + ensemble
    members = posterior.spread_out(seen.members, mode_nodes)
    shape = task.mode_lattice.shape
    found = modes.error_modes(posterior, task.parts, members, shape, mode_nodes, cfg.energy, cfg.modes_max)
    slots = len(seen.times)
    scales = np.broadcast_to(posterior.hyper, (slots, 2, 3))
    return WindTable(
        mean=mean.reshape(slots, *task.lattice.shape, 2),
        latent_var=var.reshape(slots, *task.lattice.shape, 2),
        gust_var=posterior.gust_var,
        hyper=np.concatenate([posterior.means[..., None], scales], axis=-1),
        rho=modes.error_persistence(posterior),
        score=posterior.score,
        **found._replace(psi=found.psi.reshape(slots, *shape, 2, -1))._asdict(),
    )


def cached_wind_table(task: WindTask) -> WindTable:
    """:func:`tabulate_wind` of ``task``, read from the cache if it has an entry.

    If the cache cannot be used, the table is computed and a warning logged.
    """
    folder, key = cache.cache_root() / cache.FITS_FOLDER, task_key(task)
    try:
        folders.make_private(folder)
    except (OSError, DataError) as error:
        return _unkept(folder, error, tabulate_wind(task))
    if (table := _kept_table(folder, key, task)) is not None:
        return table
    with cache.lock_entry(key):  # jobs that start together fit once
        table = _kept_table(folder, key, task) or tabulate_wind(task)
        try:
            _keep_table(folder, key, table)
        except OSError as error:
            return _unkept(folder, error, table)
    return table


def _unkept(folder: Path, error: Exception, table: WindTable) -> WindTable:
    """Log once why the table cannot be stored; return ``table``."""
    _warn_once(f"wind fits are not remembered in {folder}: {error}")
    return table


def task_key(task: WindTask) -> str:
    """Fingerprint of the task, of the code and of the package versions, 64 hexadecimal digits."""
    editions = [code_fingerprint(*TABLE_CODE), *map(version, TABLE_PACKAGES)]
    digest = hashlib.sha256(" ".join(editions).encode())
    _add_content(digest, task)
    return digest.hexdigest()


def _add_content(digest: Any, content: Any) -> None:
    """Add numbers, texts, arrays, and tuples and records of these to ``digest``, with types and shapes."""
    if is_dataclass(content):
        content = tuple(getattr(content, each.name) for each in fields(content))
    if isinstance(content, tuple):
        digest.update(f"{len(content)} items\0".encode())
        for item in content:
            _add_content(digest, item)
    elif isinstance(content, np.ndarray):
        digest.update(f"{content.dtype.str} {content.shape}\0".encode())
        digest.update(np.ascontiguousarray(content).tobytes())
    else:
        digest.update(f"{type(content).__name__} {content!r}\0".encode())


def _kept_table(folder: Path, key: str, task: WindTask) -> WindTable | None:
    """The entry ``key``; None if there is none, or if it is damaged, which is logged."""
    path = folder / f"{key}.npz"
    if not path.is_file():
        return None
    try:
        content: dict[str, Any] = read_npz(path)
        content |= {name: float(content[name].item()) for name in ("rho", "rest_length")}
        score = {name: float(content.pop(name).item()) for name in gp.SCORES}
        table = WindTable(**content, score=score)
        table.check_for(task)
    except (DataError, ValueError, TypeError, KeyError) as error:
        _warn_once(f"{path} is damaged and is made again: {error}")
        return None
    folders.mark_used(path)
    return table


def _keep_table(folder: Path, key: str, table: WindTable) -> None:
    content = table._asdict()
    content |= content.pop("score")
    write_npz(folder / f"{key}.npz", {name: np.asarray(value) for name, value in content.items()})
    folders.trim_folder(folder, cache.cache_limit())


@lru_cache(maxsize=8)
def _warn_once(reason: str) -> None:
    """Log a warning about the cache; each reason is logged once."""
    LOG.warning("%s; PARETO_LTL_CACHE names another folder", reason)
