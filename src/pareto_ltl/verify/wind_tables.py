"""The wind of a results directory: ``wind.nc`` as arrays, and their values between nodes and slots."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError

COMPONENTS = ("u", "v")
HYPER = ("prior_mean", "prior_sd", "prior_length", "noise_sd")


@dataclass(frozen=True, slots=True)
class Fit:
    """What the field says that it was fitted from.

    Attributes
    ----------
    points, winds : list of K (n, 2) float
        Readings of each slot [m], [m/s].
    hyper : (K, 2, 4) float
        Prior mean, prior standard deviation [m/s], length scale [m], noise [m/s].
    """

    points: list[FloatArray]
    winds: list[FloatArray]
    hyper: FloatArray
    kernel: str


@dataclass(frozen=True, slots=True)
class Modes:
    """ψ (K, MX, MY, 2, P) on nodes ``x`` (MX,), ``y`` (MY,) [m]; ``energy``, ``length`` (K, 2)."""

    x: FloatArray
    y: FloatArray
    psi: FloatArray
    rho: float
    gap: float
    energy: FloatArray
    length: FloatArray


@dataclass(frozen=True, slots=True)
class WindFile:
    """Mean and variance of the smooth part (K, NX, NY, 2) on nodes ``x``, ``y`` [m], gust (K, 2); ``clock``
    is the unit of time."""

    x: FloatArray
    y: FloatArray
    times: FloatArray
    mean: FloatArray
    latent: FloatArray
    gust: FloatArray
    hold_last: bool
    gust_time: float
    score: dict[str, float]
    modes: Modes | None
    fit: Fit | None
    clock: str


def read_wind_file(path: Path) -> WindFile:
    """``wind.nc``; a DataError in one line where it is none."""
    import h5netcdf

    try:
        with h5netcdf.File(path, "r") as file:
            return _wind_file(file)
    except (OSError, KeyError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"{path}: not the wind of a run ({reason}); run the plan again") from error


def _wind_file(file: Any) -> WindFile:
    def both(suffix: str) -> FloatArray:
        return np.stack([np.asarray(file[name + suffix][...], float) for name in COMPONENTS], axis=-1)

    return WindFile(
        x=np.asarray(file["x"][...], float),
        y=np.asarray(file["y"][...], float),
        times=np.asarray(file["time"][...], float),
        mean=both("").transpose(0, 2, 1, 3),
        latent=both("_var").transpose(0, 2, 1, 3),
        gust=both("_gust_var"),
        hold_last=bool(file.attrs["hold_last"]),
        gust_time=float(file.attrs["gust_time"]),
        score=json.loads(file.attrs["score"]),
        modes=_modes(file) if "u_modes" in file else None,
        fit=_fit(file) if "reading_count" in file else None,
        clock=str(file["time"].attrs["units"]),
    )


def _modes(file: Any) -> Modes:
    psi = np.stack([np.asarray(file[f"{name}_modes"][...], float) for name in COMPONENTS], axis=-2)
    return Modes(
        x=np.asarray(file["mode_x"][...], float),
        y=np.asarray(file["mode_y"][...], float),
        psi=psi.transpose(0, 2, 1, 3, 4),
        rho=float(file.attrs["rho"]),
        gap=float(file.attrs["rho_gap"]),
        energy=np.stack([np.asarray(file[f"{name}_energy"][...], float) for name in COMPONENTS], axis=-1),
        length=np.stack([np.asarray(file[f"{name}_length"][...], float) for name in COMPONENTS], axis=-1),
    )


def _fit(file: Any) -> Fit:
    ends = np.cumsum(np.asarray(file["reading_count"][...], int))[:-1]
    points = np.stack([np.asarray(file[f"reading_{axis}"][...], float) for axis in "xy"], axis=-1)
    winds = np.stack([np.asarray(file[f"reading_{name}"][...], float) for name in COMPONENTS], axis=-1)
    hyper = [[np.asarray(file[f"{name}_{key}"][...], float) for key in HYPER] for name in COMPONENTS]
    return Fit(
        np.split(points, ends),
        np.split(winds, ends),
        np.array(hyper).transpose(2, 0, 1),
        str(file.attrs["kernel"]),
    )


# --- between nodes ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Square:
    """The squares of a lattice that hold points: lower corner, fractions, side [m]."""

    i: IntArray
    j: IntArray
    fx: FloatArray
    fy: FloatArray
    side: float

    def corners(self, table: FloatArray) -> tuple[FloatArray, ...]:
        """``table`` (NX, NY, ...) at south-west, south-east, north-west and north-east, each (P, ...)."""
        i, j = self.i, self.j
        return table[i, j], table[i + 1, j], table[i, j + 1], table[i + 1, j + 1]

    def value(self, table: FloatArray) -> FloatArray:
        """``table`` (NX, NY, ...) at the points, bilinear, (P, ...)."""
        sw, se, nw, ne = self.corners(table)
        fx, fy = (f.reshape(-1, *[1] * (sw.ndim - 1)) for f in (self.fx, self.fy))
        return np.asarray((1 - fx) * ((1 - fy) * sw + fy * nw) + fx * ((1 - fy) * se + fy * ne), float)

    def slopes(self, table: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives to east and north within the squares, (P, ...) each [1/m]."""
        sw, se, nw, ne = self.corners(table)
        fx, fy = (f.reshape(-1, *[1] * (sw.ndim - 1)) for f in (self.fx, self.fy))
        east = ((1 - fy) * (se - sw) + fy * (ne - nw)) / self.side
        north = ((1 - fx) * (nw - sw) + fx * (ne - se)) / self.side
        return np.asarray(east, float), np.asarray(north, float)


def square_of(x: FloatArray, y: FloatArray, points: FloatArray) -> Square:
    """The squares that hold ``points`` (P, 2) [m], clamped to the nodes ``x``, ``y``."""
    side = float((x[-1] - x[0]) / (len(x) - 1))
    g = (points - [x[0], y[0]]) / side
    top = np.array([len(x) - 1, len(y) - 1])
    held = np.clip(g, 0.0, top)
    lower = np.minimum(held.astype(int), top - 1)
    fx, fy = (held - lower).T
    return Square(lower[:, 0], lower[:, 1], fx, fy, side)


# --- between slots ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Clock:
    """Step t lies between slots ``slot[t]`` and ``slot[t] + 1`` at ``weight[t]``; its field is that of slot
    ``nearest[t]``, of which θ keeps the share ``keep[t]`` of step t - 1."""

    slot: IntArray
    weight: FloatArray
    nearest: IntArray
    keep: FloatArray


def clock(wind: WindFile, dt: float, steps: int) -> Clock:
    """The slots of steps 0 to ``steps``; DataError where the wind is not known for so long."""
    t = dt * np.arange(steps + 1)
    if steps and not wind.hold_last and t[-2] > wind.times[-1] + 1e-6:
        raise DataError(f"the wind ends {wind.times[-1]:g} s after departure, the plan flies at {t[-2]:g} s")
    if len(wind.times) == 1:
        slot, weight = np.zeros(len(t), int), np.zeros(len(t))
    else:
        slot = np.clip(np.searchsorted(wind.times, t, side="right") - 1, 0, len(wind.times) - 2)
        weight = np.clip((t - wind.times[slot]) / np.diff(wind.times)[slot], 0.0, 1.0)
    nearest = slot + (weight > 0.5)
    keep = np.ones(len(t))
    if wind.modes is not None:
        passed = np.diff(wind.times[nearest], prepend=wind.times[nearest[0]]) / wind.modes.gap
        keep = np.where(passed > 0, wind.modes.rho**passed, 1.0)
    return Clock(slot, weight, nearest, keep)


def at_step(table: FloatArray, times: Clock, t: int) -> FloatArray:
    """``table`` (K, ...) at step t, linear between its slots."""
    k, w = times.slot[t], times.weight[t]
    return np.asarray(table[k] if w == 0 else (1 - w) * table[k] + w * table[k + 1], float)


# --- the fit ----------------------------------------------------------------------------------


def correlation(kernel: str, r: FloatArray) -> FloatArray:
    """Matérn 3/2 or squared-exponential correlation at distance ``r`` in length scales."""
    if kernel == "rbf":
        return np.asarray(np.exp(-0.5 * r * r), float)
    if kernel == "matern32":
        return np.asarray((1 + np.sqrt(3.0) * r) * np.exp(-np.sqrt(3.0) * r), float)
    raise DataError(f"wind.nc names the kernel {kernel!r}; expected matern32 or rbf")


def separation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (n, m) between points (n, 2) and (m, 2) [m]."""
    return np.asarray(np.hypot(a[:, None, 0] - b[:, 0], a[:, None, 1] - b[:, 1]), float)


def posterior(fit: Fit, k: int, c: int, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (N,) of component c in slot k at ``nodes`` (N, 2), and V (n, N) = L⁻¹ k(X, nodes), L L' = K + σ²I.

    The posterior covariance of two nodes x, y is k(x, y) - V_x' V_y.
    """
    m, amplitude, length, noise = fit.hyper[k, c]
    points = fit.points[k]
    K = amplitude**2 * correlation(fit.kernel, separation(points, points) / length)
    K[np.diag_indices(len(K))] += noise**2
    cross = amplitude**2 * correlation(fit.kernel, separation(points, nodes) / length)
    root = np.linalg.inv(np.linalg.cholesky(K))
    V = root @ cross
    return m + V.T @ (root @ (fit.winds[k][:, c] - m)), V


def persistence(fit: Fit, same_place: float = 1e3, fewest: int = 10) -> float:
    """ρ: correlation of standardised leave-one-out residuals of readings at one place in successive slots."""
    z = [np.column_stack([_residuals(fit, k, c) for c in (0, 1)]) for k in range(len(fit.points))]
    pairs = []
    for k in range(len(z) - 1):
        apart = separation(fit.points[k], fit.points[k + 1])
        i = np.flatnonzero(apart.min(axis=1) < same_place)
        pairs.append(np.stack([z[k][i], z[k + 1][apart[i].argmin(axis=1)]]))
    a, b = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0, 2))
    size = float((a * a).sum() * (b * b).sum())
    if a.size < fewest or size <= 0.0:
        return 1.0
    return float(np.clip((a * b).sum() / np.sqrt(size), 0.0, 1.0))


def _residuals(fit: Fit, k: int, c: int) -> FloatArray:
    m, amplitude, length, noise = fit.hyper[k, c]
    K = amplitude**2 * correlation(fit.kernel, separation(fit.points[k], fit.points[k]) / length)
    inverse = np.linalg.inv(K + noise**2 * np.eye(len(K)))
    return np.asarray(inverse @ (fit.winds[k][:, c] - m) / np.sqrt(np.diag(inverse)), float)
