"""The wind of a results directory: ``wind.nc`` as arrays, and their values between nodes and slots."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from careful_io.errors import DataError
from pareto_ltl_verify.arrays import FloatArray, IntArray
from pareto_ltl_verify.wind_fit import Fit
from pareto_ltl_verify.wind_law import ErrorLaw, LawPart, error_law

COMPONENTS = ("u", "v")
PARTS = (  # of the error of a field
    "interpolation in space", "forecast", "interpolation in time", "ensemble", "change of a held field",
    "lasting part of the forecast", "growing part of the forecast", "slow part of the forecast",
    "local part of the forecast",
)  # fmt: skip
SPACE, FORECAST, TIME, ENSEMBLE, HELD, LASTING, GROWING, SLOW, LOCAL = range(len(PARTS))
OF_FORECASTS = {  # by the name of a part of the law
    "forecast": FORECAST, "lasting": LASTING, "growing": GROWING, "slow": SLOW, "local": LOCAL,
}  # fmt: skip
HELD_EPOCH = 10_800.0  # [s] time for which the error of a held field has one spatial pattern
HYPER = ("prior_mean", "prior_sd", "prior_length", "noise_sd")


SIDES = {
    "depth": ("depth", "below the surface"),
    "amsl": ("altitude", "above mean sea level"),
    "msl": ("altitude", "above mean sea level"),
}


def level_of(text: str) -> tuple[str, float, str]:
    """Kind of a level, its height [m], depth [m] or pressure [Pa], and how texts name it."""
    found = re.fullmatch(r"(\d+\.?\d*)\s*([a-z]+?)\s*(depth|amsl|msl|agl)?", text.strip().lower())
    if found is None:
        return "no level", 0.0, text
    number, unit, side = found.groups()
    if unit in (factors := {"pa": 1.0, "hpa": 100.0, "mb": 100.0, "mbar": 100.0}):
        pressure = float(number) * factors[unit]
        return "pressure", pressure, f"at {pressure / 100.0:.10g} hPa"
    metres = float(number) * {"km": 1000.0, "ft": 0.3048}.get(unit, 1.0)
    kind, where = SIDES.get(side, ("height", "above ground"))
    return kind, metres, f"{metres:.10g} m {where}"


@dataclass(frozen=True, slots=True)
class Modes:
    """ψ (K, MX, MY, 2, P) [m/s] on nodes ``x`` (MX,), ``y`` (MY,) [m].

    ``energy`` (K, 2); ``length`` (K, 2) [m]; the ``part`` (P,) of the error of each mode, -1 for unused
    modes; ``rest_length`` [m] is the correlation length of the error without the modes.
    """

    x: FloatArray
    y: FloatArray
    psi: FloatArray
    part: IntArray
    rho: float
    gap: float
    energy: FloatArray
    length: FloatArray
    rest_length: float

    def nodes(self) -> FloatArray:
        """Positions (N, 2) [m]."""
        return np.stack(np.meshgrid(self.x, self.y, indexing="ij"), axis=-1).reshape(-1, 2)

    def of(self, part: int) -> FloatArray:
        """The modes of one part of the error, (K, N, 2, p)."""
        k, nx, ny, c, _ = self.psi.shape
        chosen = self.psi[..., self.part == part]
        return chosen.reshape(k, nx * ny, c, chosen.shape[-1])


class AirTable(NamedTuple):
    """Mean temperature [K] and pressure [Pa] over the map at ``times`` (K,) [s], and their levels."""

    times: FloatArray
    temperature: FloatArray
    pressure: FloatArray
    level: str
    pressure_level: str


@dataclass(frozen=True, slots=True)
class WindFile:
    """Mean [m/s] and ``latent`` variance (K, NX, NY, 2) on nodes ``x``, ``y`` [m]; ``gust`` variance (K, 2).

    ``clock`` is the unit of time; the wind is known ``until`` [s]; ``leads`` (K,) [s]
    are lead times of forecasts. The slots of a field that is ``held`` since a time [s] include the variance
    of its change.
    """

    x: FloatArray
    y: FloatArray
    times: FloatArray
    mean: FloatArray
    latent: FloatArray
    gust: FloatArray
    until: float
    source: str
    level: str
    leads: FloatArray
    gust_time: float
    score: dict[str, float]
    modes: Modes | None
    fit: Fit | None
    error: ErrorLaw | None
    clock: str
    held: float | None = None
    air: AirTable | None = None

    @property
    def last_field(self) -> float:
        """Time of the last field of the data [s]; later it is held."""
        return float(self.times[-1]) if self.held is None else self.held

    @property
    def law_parts(self) -> dict[int, LawPart]:
        """The parts of the law of forecast errors, by their numbers among ``PARTS``."""
        return {} if self.error is None else {OF_FORECASTS[part.name]: part for part in self.error.parts}


def read_wind_file(path: Path) -> WindFile:
    """The content of ``wind.nc``; DataError if the file is not the wind of a run."""
    from careful_io.netcdf4 import opened_netcdf

    try:
        with opened_netcdf(path) as file:
            return _wind_file(file)
    except (OSError, KeyError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"{path}: not the wind of a run ({reason}); run the plan again") from error


def _table(file: Any, name: str) -> FloatArray:
    return np.asarray(file[name][...], float)


def _both(file: Any, name: str, axis: int = -1) -> FloatArray:
    """Tables of both components, stacked; their names begin with u and v in place of ``{}``."""
    return np.stack([_table(file, name.format(component)) for component in COMPONENTS], axis=axis)


def _wind_file(file: Any) -> WindFile:
    attrs = file.attrs
    return WindFile(
        x=_table(file, "x"), y=_table(file, "y"), times=_table(file, "time"), leads=_table(file, "lead"),
        mean=_both(file, "{}").transpose(0, 2, 1, 3), latent=_both(file, "{}_var").transpose(0, 2, 1, 3),
        gust=_both(file, "{}_gust_var"), until=float(attrs["known_until"]),
        source=str(attrs["source"]), level=str(attrs["level"]),
        gust_time=float(attrs["gust_time"]), score=json.loads(attrs["score"]),
        modes=_modes(file) if "u_modes" in file else None,
        fit=_fit(file) if "reading_count" in file else None,
        error=error_law(json.loads(attrs["forecast_error"])) if "forecast_error" in attrs else None,
        clock=str(file["time"].attrs["units"]),
        held=float(attrs["held_since"]) if "held_since" in attrs else None,
        air=_air(file) if "air_temperature" in file else None,
    )  # fmt: skip


def _air(file: Any) -> AirTable:
    warmth, pressure = "air_temperature", "air_pressure_measured"
    levels = [str(file[name].attrs["level"]) for name in (warmth, pressure)]
    return AirTable(_table(file, "air_time"), _table(file, warmth), _table(file, pressure), *levels)


def _modes(file: Any) -> Modes:
    return Modes(
        x=_table(file, "mode_x"), y=_table(file, "mode_y"),
        psi=_both(file, "{}_modes", axis=-2).transpose(0, 2, 1, 3, 4),
        part=_table(file, "mode_part").astype(int), energy=_both(file, "{}_energy"),
        length=_both(file, "{}_length"), rho=float(file.attrs["rho"]), gap=float(file.attrs["rho_gap"]),
        rest_length=float(file.attrs["rest_length"]),
    )  # fmt: skip


def _fit(file: Any) -> Fit:
    ends = np.cumsum(_table(file, "reading_count").astype(int))[:-1]
    points = np.stack([_table(file, f"reading_{axis}") for axis in "xy"], axis=-1)
    hyper = np.stack([_both(file, f"{{}}_{key}") for key in HYPER], axis=-1)
    winds = np.split(_both(file, "reading_{}"), ends)
    return Fit(np.split(points, ends), winds, hyper, str(file.attrs["kernel"]))


# --- between nodes ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Square:
    """The squares of a lattice that contain points: lower corner, fractions, side [m]."""

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
    """The squares that contain ``points`` (P, 2) [m], clamped to the nodes ``x``, ``y``."""
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
    """The position of each step between the slots of the wind.

    Step t lies between slots ``slot[t]`` and ``slot[t] + 1`` at ``weight[t]``; its modes belong to slot
    ``nearest[t]``, and ``keep[t, g]`` is the correlation of θ of part g of the error with θ of step t - 1.
    ``between`` [m²/s²] is the variance of interpolation in time; the wind is known for ``known`` steps.
    """

    slot: IntArray
    weight: FloatArray
    nearest: IntArray
    keep: FloatArray
    between: FloatArray
    known: int


def clock(wind: WindFile, dt: float, steps: int, limit: int) -> Clock:
    """The slots of steps 0 to ``steps`` of at most ``limit``; DataError if the wind is known for less."""
    t: FloatArray = dt * np.arange(steps + 1, dtype=float)
    if steps and t[-2] > wind.until + 1e-6:
        raise DataError(
            f"the wind is known until {wind.until:g} s after departure, but the plan needs it at {t[-2]:g} s"
        )
    if len(wind.times) == 1:
        slot, weight = np.zeros(len(t), int), np.zeros(len(t))
    else:
        slot = np.clip(np.searchsorted(wind.times, t, side="right") - 1, 0, len(wind.times) - 2)
        weight = np.clip((t - wind.times[slot]) / np.diff(wind.times)[slot], 0.0, 1.0)
    nearest = slot + (weight > 0.5)
    keep = np.array([_kept(wind, nearest, t, n) for n in range(len(t))])
    between = np.array([_between(wind, float(now)) for now in t])
    known = int((dt * np.arange(limit) <= wind.until + 1e-6).sum())
    return Clock(slot, weight, nearest, keep, between, known)


def _between(wind: WindFile, now: float) -> float:
    """Variance [m²/s²] of the error of interpolation in time or, after the last field, of holding it."""
    if wind.error is None or wind.held is not None:
        return 0.0
    if now >= wind.times[-1]:
        return wind.error.change_variance(now - float(wind.times[-1]))
    k = int(np.searchsorted(wind.times, now, side="right")) - 1
    return wind.error.between_variance(now - float(wind.times[k]), float(wind.times[k + 1] - wind.times[k]))


def _kept(wind: WindFile, nearest: IntArray, t: FloatArray, n: int) -> FloatArray:
    """Correlation of θ of each part at step n with θ at step n - 1.

    Interpolation in space: ρ to the power of the time between the slots. Forecasts: what each part of the law
    keeps over that time from the lead of the slot before on. Interpolation in time: 0 from one gap between
    fields to the next; of a held field, the correlation of its changes up to the middles of two periods.
    Slots of a held field differ only in the change since it.
    """
    keep = np.ones(len(PARTS))
    if n == 0:
        return keep
    here, there = (min(float(wind.times[nearest[k]]), wind.last_field) for k in (n, n - 1))
    passed = here - there
    if wind.modes is not None and passed > 0:
        keep[SPACE] = wind.modes.rho ** (passed / wind.modes.gap)
    if wind.error is None:
        return keep
    for number, part in wind.law_parts.items():
        keep[number] = part.kept(float(wind.leads[nearest[n - 1]]), passed)
    if wind.held is not None:
        if nearest[n] != nearest[n - 1]:
            lags = (float(wind.times[nearest[k]]) - wind.held for k in (n - 1, n))
            keep[HELD] = wind.error.change_correlation(*lags)
        return keep
    before, now = t[n - 1] - wind.times[-1], t[n] - wind.times[-1]
    if now < 0:
        gaps = np.searchsorted(wind.times, t[n - 1 : n + 1], side="right")
        keep[TIME] = float(gaps[0] == gaps[1])
    elif before < 0:
        keep[TIME] = 0.0
    elif before // HELD_EPOCH != now // HELD_EPOCH:
        middles = ((float(late) // HELD_EPOCH + 0.5) * HELD_EPOCH for late in (before, now))
        keep[TIME] = wind.error.change_correlation(*middles)
    return keep


def at_step(table: FloatArray, times: Clock, t: int) -> FloatArray:
    """``table`` (K, ...) at step t, linear between its slots."""
    k, w = times.slot[t], times.weight[t]
    return np.asarray(table[k] if w == 0 else (1 - w) * table[k] + w * table[k + 1], float)
