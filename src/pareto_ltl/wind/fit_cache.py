"""Tables of the fitted wind, and their cache on disk: one archive ``KEY.npz`` for each table.

KEY is the fingerprint of all inputs of a table. An entry holds only arrays, each with a checksum; nothing in
it is executed. An entry that is damaged, or whose shapes do not fit its task, is made again.
"""

from __future__ import annotations

import hashlib
import logging
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support import cache
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray, require_shape
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_npz
from pareto_ltl.support.fingerprints import code_fingerprint
from pareto_ltl.wind import gp, modes
from pareto_ltl.wind.records import NodeLattice, WindObservations

LOG = logging.getLogger(__name__)
TABLE_CODE = ("wind.fit_cache", "wind.gp", "wind.modes")  # the code that a table depends on
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
    parts : ErrorParts
        The errors of forecasts and of interpolation in time.
    lattice, mode_lattice : NodeLattice
        Nodes of the field, and the coarser nodes of its modes.
    """

    cfg: WindConfig
    seen: WindObservations
    bounds: FloatArray
    parts: modes.ErrorParts
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


def tabulate_wind(task: WindTask) -> WindTable:
    """Fit the readings of ``task`` and evaluate the posterior on its lattices."""
    cfg, seen = task.cfg, task.seen
    posterior = gp.fit_posterior(cfg, seen, task.bounds)
    nodes, mode_nodes = task.lattice.nodes(), task.mode_lattice.nodes()
    mean, var = posterior.at(nodes)
    ensemble = (posterior.spread_out(seen.members, nodes) ** 2).sum(-1)
    var = var + task.parts.forecast_var[:, None, None] + ensemble
    members = posterior.spread_out(seen.members, mode_nodes)
    shape = task.mode_lattice.shape
    found = modes.error_modes(posterior, task.parts, members, shape, mode_nodes, cfg.energy, cfg.modes_max)
    slots = len(seen.times)
    return WindTable(
        mean=mean.reshape(slots, *task.lattice.shape, 2),
        latent_var=var.reshape(slots, *task.lattice.shape, 2),
        gust_var=posterior.gust_var,
        hyper=np.array(posterior.hyper),
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
        cache.make_private(folder)
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
    cache.mark_used(path)
    return table


def _keep_table(folder: Path, key: str, table: WindTable) -> None:
    content = table._asdict()
    content |= content.pop("score")
    write_npz(folder / f"{key}.npz", {name: np.asarray(value) for name, value in content.items()})
    cache.trim_folder(folder, cache.cache_limit())


@lru_cache(maxsize=8)
def _warn_once(reason: str) -> None:
    """Log a warning about the cache; each reason is logged once."""
    LOG.warning("%s; PARETO_LTL_CACHE names another folder", reason)
