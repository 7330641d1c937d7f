"""The wind field that planning reads: the posterior on a lattice, remembered between runs.

``wind`` is the stage; ``to_netcdf`` and ``from_netcdf`` store a field.
"""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support import cache
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import whole_file
from pareto_ltl.support.fingerprints import code_fingerprint
from pareto_ltl.wind import gp, modes
from pareto_ltl.wind.records import WindField, WindModes, WindObservations
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    import h5netcdf

LOG = logging.getLogger(__name__)
MODES_COARSEST, MODES_FINEST = 10, 24  # squares of the modes' lattice along the scene's longer side
COARSEST, FINEST = 20, 400  # nodes along the longer side: of the scene at least, of the lattice at most

TABLE_CODE = ("wind.field", "wind.gp", "wind.modes")  # what a table depends on: other code, other entries

GRID = ("time", "y", "x")
MODE_GRID = ("time", "mode_y", "mode_x", "mode")

Variable = tuple[str, tuple[str, ...], Any, dict[str, Any]]  # name, dimensions, values, attributes
Table = dict[str, Any]  # mean, latent_var, gust_var, score: what the cache keeps


def wind(
    cfg: WindConfig, observations: WindObservations, scene: Scene, horizon: float | None = None
) -> WindField:
    """Tabulate the posterior wind over ``scene`` and ``cfg.padding`` around it.

    Parameters
    ----------
    horizon : float, optional
        Times after the first one at or past it [s since time_zero] are left out.

    Without readings the air is calm: zeros in one slot that holds for ever.
    """
    origin, spacing, shape = lattice(cfg, scene)
    if not any(len(points) for points in observations.points):
        still = np.zeros((1, *shape, 2))
        return WindField(
            origin, spacing, np.zeros(1), still, still.copy(), np.zeros((1, 2)), True, {}, observations.source
        )
    seen = _until(observations, horizon)
    settings = (cfg.kernel, cfg.noise_min, cfg.holdout)
    coarse = modes_lattice(cfg, scene)
    kept = (cfg.energy, cfg.modes_max)
    code = code_fingerprint(*TABLE_CODE)
    arguments = (settings, seen.times, seen.points, seen.winds, origin, spacing, shape, coarse, kept, code)
    table = _remembered(*arguments) if cfg.cache else _tabulate(*arguments)
    return WindField(
        origin=origin,
        spacing=spacing,
        times=seen.times,
        mean=table["mean"],
        latent_var=table["latent_var"],
        gust_var=table["gust_var"],
        hold_last=cfg.hold_last,
        score=table["score"],
        source=seen.source,
        modes=_modes(cfg, seen.times, coarse, table),
        gust_time=cfg.gust_time,
    )


def _modes(
    cfg: WindConfig, times: FloatArray, coarse: tuple[FloatArray, float, tuple[int, int]], table: Table
) -> WindModes | None:
    if table["psi"].shape[-1] == 0:
        return None
    return WindModes(
        origin=coarse[0], spacing=coarse[1], psi=table["psi"],
        rho=table["rho"] if cfg.rho is None else cfg.rho,
        gap=float(np.median(np.diff(times))) if len(times) > 1 else 1.0,
        length=table["length"], energy=table["energy"],
    )  # fmt: skip


def modes_lattice(cfg: WindConfig, scene: Scene) -> tuple[FloatArray, float, tuple[int, int]]:
    """The modes' own, coarser lattice: the scene and one node around it.

    What it does not resolve counts as white, since the white part is whatever the modes leave of the
    variance.
    """
    extent = scene.bounds[1] - scene.bounds[0]
    side = float(extent.max())
    spacing = min(max(cfg.modes_spacing, side / MODES_FINEST), side / MODES_COARSEST)
    cells = np.ceil(extent / spacing - 1e-9).astype(int) + 2
    origin = scene.bounds.mean(axis=0) - 0.5 * spacing * cells
    return origin, spacing, (int(cells[0]) + 1, int(cells[1]) + 1)


def lattice(cfg: WindConfig, scene: Scene) -> tuple[FloatArray, float, tuple[int, int]]:
    """South-west node [m], spacing [m] and number of nodes (NX, NY).

    It reaches ``cfg.padding`` past the bounds, or the longer side of a scene smaller than that; a small
    scene gets a finer lattice and a huge one a coarser.
    """
    side = float(np.max(scene.bounds[1] - scene.bounds[0]))
    padding = min(cfg.padding, side)
    spacing = max(min(cfg.spacing, side / COARSEST), (side + 2 * padding) / FINEST)
    extent = scene.bounds[1] - scene.bounds[0] + 2 * padding
    cells = np.maximum(1, np.ceil(extent / spacing - 1e-9)).astype(int)
    origin = scene.bounds.mean(axis=0) - 0.5 * spacing * cells
    return origin, spacing, (int(cells[0]) + 1, int(cells[1]) + 1)


def to_netcdf(field: WindField, path: Path, scene: Scene | None = None) -> Path:
    """Write ``field`` as CF NetCDF; with ``scene`` its clock and projection are named.

    Straight through h5netcdf: xarray opens the file, but its import would take a fifth of a whole run.
    """
    import h5netcdf

    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as draft, h5netcdf.File(draft, "w") as file:
        file.attrs.update(_about(field))
        file.dimensions.update(zip(GRID, (len(field.times), *field.mean.shape[2:0:-1]), strict=True))
        if field.modes is not None:
            psi = field.modes.psi
            file.dimensions.update(
                zip(MODE_GRID[1:], (psi.shape[2], psi.shape[1], psi.shape[4]), strict=True)
            )
        for name, dimensions, values, attributes in _variables(field, scene):
            file.create_variable(name, dimensions, data=values).attrs.update(attributes)
    return path


def from_netcdf(path: Path) -> WindField:
    """Read what :func:`to_netcdf` wrote."""
    import h5netcdf

    if not path.is_file():
        raise DataError(f"wind field {path} does not exist; expected the wind.nc of a run")
    try:
        with h5netcdf.File(path, "r") as file:
            return _field(file)
    except (OSError, KeyError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(
            f"wind field {path} cannot be read ({reason}); expected the wind.nc of a run"
        ) from None


def _until(observations: WindObservations, horizon: float | None) -> WindObservations:
    """The observations up to the first time at or past ``horizon``."""
    if horizon is None:
        return observations
    n = int(np.searchsorted(observations.times, horizon)) + 1
    return WindObservations(
        observations.times[:n], observations.points[:n], observations.winds[:n], observations.source
    )


def _tabulate(
    settings: tuple[str, float, float],
    times: FloatArray,
    points: tuple[FloatArray, ...],
    winds: tuple[FloatArray, ...],
    origin: FloatArray,
    spacing: float,
    shape: tuple[int, int],
    coarse: tuple[FloatArray, float, tuple[int, int]],
    kept: tuple[float, int],
    edition: str,
) -> Table:
    """Fit and evaluate: a pure function of its arguments, so that its result can be remembered."""
    kernel, noise_min, holdout = settings
    cfg = WindConfig(kernel=kernel, noise_min=noise_min, holdout=holdout)
    posterior = gp.fit(cfg, WindObservations(times, points, winds, ""))
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
    mean, var = posterior.at(origin + spacing * nodes)
    places = np.stack(np.meshgrid(*map(np.arange, coarse[2]), indexing="ij"), axis=-1).reshape(-1, 2)
    psi, energy = modes.modes(posterior, coarse[0] + coarse[1] * places, *kept)
    return {
        "mean": mean.reshape(len(times), *shape, 2),
        "latent_var": var.reshape(len(times), *shape, 2),
        "gust_var": posterior.gust_var,
        "score": posterior.score,
        "psi": psi.reshape(len(times), *coarse[2], 2, -1),
        "energy": energy,
        "rho": modes.persistence(posterior),
        "length": np.array([[h.length for h in pair] for pair in posterior.hyper]),
    }


def cache_folder() -> Path:
    """Where fits are remembered."""
    return cache.cache_root() / "wind"


def _remembered(*arguments: Any) -> Table:
    """``_tabulate``, from the cache where possible; a cache that fails costs time, never the run."""
    from joblib import Memory, hash

    folder = cache_folder()
    try:
        memory = Memory(folder, verbose=0)
        recall = memory.cache(_tabulate)
        recall.warn = lambda _: _complain(folder, "an entry is damaged and is made again")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            if recall.check_call_in_cache(*arguments):
                table: Table = recall(*arguments)
            else:
                with cache.lock_entry(hash(arguments)):  # jobs that begin together fit once
                    table = recall(*arguments)
                    memory.reduce_size(bytes_limit=cache.cache_limit())
    except OSError as error:
        _complain(folder, str(error))
        return _tabulate(*arguments)
    for warning in caught:
        if warning.category.__module__.startswith("joblib"):
            _complain(folder, str(warning.message))
        else:  # the fit's own
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return table


@lru_cache(maxsize=8)
def _complain(folder: Path, reason: str) -> None:
    """Say once what is wrong with the cache."""
    reason = reason.splitlines()[0]
    LOG.warning(
        "wind fits are not remembered in %s: %s; set PARETO_LTL_CACHE to another folder", folder, reason
    )


def _about(field: WindField) -> dict[str, Any]:
    return {
        "Conventions": "CF-1.11",
        "title": "Posterior wind of a pareto_ltl run",
        "source": field.source,
        "origin": field.origin,
        "spacing": field.spacing,
        "hold_last": int(field.hold_last),
        "gust_time": field.gust_time,
        **({} if field.modes is None else {"rho": field.modes.rho, "rho_gap": field.modes.gap}),
        "score": json.dumps(dict(field.score), sort_keys=True),
    }


def _variables(field: WindField, scene: Scene | None) -> Iterator[Variable]:
    """Coordinates, then lattice arrays (time, x, y) as CF variables (time, y, x)."""
    x, y = (field.origin[i] + field.spacing * np.arange(field.mean.shape[i + 1]) for i in (0, 1))
    yield "time", ("time",), field.times, {"standard_name": "time", "axis": "T", **_clock(scene)}
    yield "y", ("y",), y, {"standard_name": "projection_y_coordinate", "units": "m", "axis": "Y"}
    yield "x", ("x",), x, {"standard_name": "projection_x_coordinate", "units": "m", "axis": "X"}
    placed: dict[str, Any] = {}
    if scene is not None and scene.crs is not None:
        yield "crs", (), 0, _grid_mapping(scene.crs)
        placed = {"grid_mapping": "crs"}
    for c, name in enumerate("uv"):
        axis = "xy"[c]
        mean, var = (a[..., c].transpose(0, 2, 1) for a in (field.mean, field.latent_var))
        expected = _attrs(f"expected wind towards +{axis}", "m s-1", f"{axis}_wind")
        yield name, GRID, mean, expected | placed
        yield f"{name}_var", GRID, var, _attrs(f"variance of the smooth part of {name}", "m2 s-2") | placed
        white = f"variance of the part of {name} that is independent from step to step"
        yield f"{name}_gust_var", ("time",), field.gust_var[:, c], _attrs(white, "m2 s-2")
    if field.modes is not None:
        yield from _mode_variables(field.modes)


def _mode_variables(found: WindModes) -> Iterator[Variable]:
    """ψ with the coordinates of its lattice, and what belongs to each slot."""
    x, y = (found.origin[i] + found.spacing * np.arange(found.psi.shape[i + 1]) for i in (0, 1))
    yield "mode_y", ("mode_y",), y, {"units": "m", "long_name": "y of the modes' lattice"}
    yield "mode_x", ("mode_x",), x, {"units": "m", "long_name": "x of the modes' lattice"}
    for c, name in enumerate("uv"):
        psi = found.psi[..., c, :].transpose(0, 2, 1, 3)
        yield (
            f"{name}_modes",
            MODE_GRID,
            psi,
            _attrs(f"Karhunen-Loeve modes of {name}, U sqrt(Lambda)", "m s-1"),
        )
        yield f"{name}_length", ("time",), found.length[:, c], _attrs(f"length scale of {name}", "m")
        yield (
            f"{name}_energy",
            ("time",),
            found.energy[:, c],
            _attrs(f"share of variance in {name}_modes", "1"),
        )


def _clock(scene: Scene | None) -> dict[str, Any]:
    if scene is None or scene.time_zero is None:
        return {"units": "s"}
    return {"units": f"seconds since {scene.time_zero}", "calendar": "standard"}


def _attrs(long_name: str, units: str, standard_name: str | None = None) -> dict[str, Any]:
    named = {"standard_name": standard_name} if standard_name else {}
    return {"long_name": long_name, "units": units, **named}


def _grid_mapping(crs: str) -> dict[str, Any]:
    """CF grid mapping, so that maps find their place."""
    import pyproj

    described = pyproj.CRS.from_user_input(crs).to_cf()
    return {key: value for key, value in described.items() if value is not None}


def _field(file: h5netcdf.File) -> WindField:
    def stack(*names: str) -> FloatArray:
        return np.stack([np.asarray(file[name][...], float) for name in names], axis=-1)

    return WindField(
        origin=np.asarray(file.attrs["origin"], float),
        spacing=float(file.attrs["spacing"]),
        times=np.asarray(file["time"][...], float),
        mean=np.ascontiguousarray(stack("u", "v").transpose(0, 2, 1, 3)),
        latent_var=np.ascontiguousarray(stack("u_var", "v_var").transpose(0, 2, 1, 3)),
        gust_var=stack("u_gust_var", "v_gust_var"),
        hold_last=bool(file.attrs["hold_last"]),
        score=json.loads(file.attrs["score"]),
        source=str(file.attrs["source"]),
        modes=_stored_modes(file) if "u_modes" in file else None,
        gust_time=float(file.attrs["gust_time"]),
    )


def _stored_modes(file: h5netcdf.File) -> WindModes:
    x, y = np.asarray(file["mode_x"][...], float), np.asarray(file["mode_y"][...], float)
    psi = np.stack([np.asarray(file[f"{name}_modes"][...], np.float32) for name in "uv"], axis=-2)
    return WindModes(
        origin=np.array([x[0], y[0]]),
        spacing=float(x[1] - x[0]),
        psi=np.ascontiguousarray(psi.transpose(0, 2, 1, 3, 4)),
        rho=float(file.attrs["rho"]),
        gap=float(file.attrs["rho_gap"]),
        length=np.stack([np.asarray(file[f"{name}_length"][...], float) for name in "uv"], axis=-1),
        energy=np.stack([np.asarray(file[f"{name}_energy"][...], float) for name in "uv"], axis=-1),
    )


__all__ = ["from_netcdf", "lattice", "to_netcdf", "wind"]
