"""The fit of wind readings as one task, and its result as one table of arrays that can be kept on disk."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from careful_io.archives import read_npz
from careful_io.files import write_npz
from wind_laws import gp, modes
from wind_laws.gp import FitOptions
from wind_laws.lattice import NodeLattice
from wind_laws.records import TIME, PlacedReadings, UncertainWind, WindEvidence, WindModes, forecast_parts
from wind_laws.types import Float32Array, FloatArray, IntArray, require_shape

SAMPLES = 16  # instants at which a variance is averaged over time
LENGTH, NOISE = 2, 3  # columns of the hyperparameters of a table


class WindTask(NamedTuple):
    """All inputs of a wind table, and nothing else: what differs in a task is fitted anew.

    Attributes
    ----------
    options : FitOptions
        How the readings are fitted, and how many modes there are.
    seen : PlacedReadings
        The readings, with the deviations of members.
    bounds : (2, 2) float
        South-west and north-east corner of the region where the fit is scored [m].
    parts : tuple of UniformPart
        The errors of forecasts and of interpolation in time.
    lattice, mode_lattice : NodeLattice
        Nodes of the field, and the coarser nodes of its modes.
    """

    options: FitOptions
    seen: PlacedReadings
    bounds: FloatArray
    parts: tuple[modes.UniformPart, ...]
    lattice: NodeLattice
    mode_lattice: NodeLattice

    @staticmethod
    def of(
        options: FitOptions, seen: PlacedReadings, bounds: FloatArray, lattice: NodeLattice,
        mode_lattice: NodeLattice, horizon: float | None = None,
    ) -> WindTask:  # fmt: skip
        """The task of readings, with the variances of the parts of the error up to ``horizon`` [s]."""
        plain = PlacedReadings(seen.times, seen.points, seen.winds, "", members=seen.members)
        return WindTask(options, plain, bounds, uniform_parts(seen, horizon), lattice, mode_lattice)

    def fingerprint(self, *editions: str) -> str:
        """Fingerprint of the task and of the ``editions`` of what works on it, 64 hexadecimal digits."""
        digest = hashlib.sha256(" ".join(editions).encode())
        _add_content(digest, self)
        return digest.hexdigest()


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

    @staticmethod
    def read(path: Path, task: WindTask) -> WindTable:
        """The table of ``task`` in the archive ``path``; DataError or ValueError if it holds another one."""
        content: dict[str, Any] = read_npz(path)
        try:
            content |= {name: float(content[name].item()) for name in ("rho", "rest_length")}
            score = {name: float(content.pop(name).item()) for name in gp.SCORES}
            table = WindTable(**content, score=score)
        except (KeyError, TypeError) as error:
            raise ValueError(str(error)) from error
        table.check_for(task)
        return table

    def write(self, path: Path) -> None:
        """Write the table as an archive ``.npz``."""
        content = self._asdict()
        content |= content.pop("score")
        write_npz(path, {name: np.asarray(value) for name, value in content.items()})

    def wind(
        self, task: WindTask, seen: PlacedReadings, rho: float | None = None, gust_time: float = 1800.0
    ) -> UncertainWind:
        """The field of the table, with what the readings ``seen`` of ``task`` are.

        ``rho`` replaces the fitted persistence; ``gust_time`` [s] is the time constant of the white part.
        """
        return UncertainWind(
            origin=task.lattice.origin,
            spacing=task.lattice.spacing,
            times=seen.times,
            mean=self.mean,
            latent_var=self.latent_var,
            gust_var=self.gust_var,
            until=seen.until,
            score=self.score,
            source=seen.source,
            modes=self._modes(task.mode_lattice, seen, self.rho if rho is None else rho),
            gust_time=gust_time,
            evidence=WindEvidence(seen.points, seen.winds, task.options.kernel, self.hyper),
            leads=seen.leads,
            level=seen.level,
            ends=seen.ends,
            error=seen.error,
        )

    def _modes(self, lattice: NodeLattice, seen: PlacedReadings, rho: float) -> WindModes | None:
        """The modes of the table; None if there are none, because the variance is 0."""
        if self.psi.shape[-1] == 0:
            return None
        lengths = self.hyper[:, :, LENGTH]
        if seen.error is not None:
            lengths = np.minimum(lengths, seen.error.shortest_length)
        return WindModes(
            origin=lattice.origin,
            spacing=lattice.spacing,
            psi=self.psi,
            part=self.part,
            rho=rho,
            gap=float(np.median(np.diff(seen.times))) if len(seen.times) > 1 else 1.0,
            length=lengths,
            energy=self.energy,
            rest_length=self.rest_length,
        )


def uniform_parts(seen: PlacedReadings, horizon: float | None) -> tuple[modes.UniformPart, ...]:
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


def time_variances(seen: PlacedReadings, horizon: float | None) -> FloatArray:
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


def tabulate_wind(task: WindTask, remedy: str = "") -> WindTable:
    """Fit the readings of ``task`` and evaluate the posterior on its lattices.

    ``remedy`` ends the warning that the readings do not say how long errors last.
    """
    options, seen = task.options, task.seen
    posterior = gp.fit_posterior(options, seen, task.bounds)
    nodes, mode_nodes = task.lattice.nodes(), task.mode_lattice.nodes()
    mean, var = posterior.at(nodes)
    ensemble = (posterior.spread_out(seen.members, nodes) ** 2).sum(-1)
    forecasts = sum((each.variance for each in task.parts if each.part != TIME), np.zeros(len(seen.times)))
    var = var + forecasts[:, None, None] + ensemble
    members = posterior.spread_out(seen.members, mode_nodes)
    shape = task.mode_lattice.shape
    found = modes.error_modes(
        posterior, task.parts, members, shape, mode_nodes, options.energy, options.modes_max
    )
    slots = len(seen.times)
    scales = np.broadcast_to(posterior.hyper, (slots, 2, 3))
    return WindTable(
        mean=mean.reshape(slots, *task.lattice.shape, 2),
        latent_var=var.reshape(slots, *task.lattice.shape, 2),
        gust_var=posterior.gust_var,
        hyper=np.concatenate([posterior.means[..., None], scales], axis=-1),
        rho=modes.error_persistence(posterior, remedy),
        score=posterior.score,
        **found._replace(psi=found.psi.reshape(slots, *shape, 2, -1))._asdict(),
    )


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
