"""A run as a dataset of xarray: its wind and its plan, with units and coordinates as CF names them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.extras import EXTRAS

if TYPE_CHECKING:
    import xarray as xr

    from pareto_ltl.planning.records import Plan
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.scene import Scene

METRES = {"units": "m"}


def dataset_of(scene: Scene, wind: WindField, plan: Plan | None) -> xr.Dataset:
    """Wind on (``time``, ``y``, ``x``) and, if there is one, the plan on (``step``) and (``leg``).

    Times are seconds since departure, and dates if its date is known.
    """
    EXTRAS.require("netcdf", "Run.to_xarray")
    import xarray as xr

    x, y = (wind.origin[k] + wind.spacing * np.arange(wind.mean.shape[1 + k]) for k in (0, 1))
    coords: dict[str, Any] = {
        "time": ("time", wind.times, _clock(scene)),
        "x": ("x", x, METRES | {"standard_name": "projection_x_coordinate"}),
        "y": ("y", y, METRES | {"standard_name": "projection_y_coordinate"}),
    }
    grid = ("time", "y", "x")
    variables: dict[str, Any] = {}
    for k, name in enumerate(("wind_x", "wind_y")):
        variables[name] = (grid, wind.mean[..., k].swapaxes(1, 2), {"units": "m s-1"})
        variables[f"{name}_var"] = (grid, wind.latent_var[..., k].swapaxes(1, 2), {"units": "m2 s-2"})
    about = {"crs": scene.crs or "", "level": wind.level, "source": wind.source}
    if plan is not None:
        variables |= _of_plan(plan, _clock(scene))
        about["formula"] = plan.formula
    return xr.decode_cf(xr.Dataset(variables, coords, about))


def _of_plan(plan: Plan, clock: dict[str, str]) -> dict[str, Any]:
    path, known = plan.path, plan.navigation
    found: dict[str, Any] = {
        "path_time": ("step", path.t, clock),
        "path_x": ("step", path.x[:, 0], METRES),
        "path_y": ("step", path.x[:, 1], METRES),
        "path_cov": (("step", "row", "column"), path.cov, {"units": "m2"}),
        "airspeed_x": ("leg", path.u[:, 0], {"units": "m s-1"}),
        "airspeed_y": ("leg", path.u[:, 1], {"units": "m s-1"}),
    }
    if known is not None and known.lat is not None:
        found["path_lat"] = ("step", known.lat, {"units": "degrees_north"})
        found["path_lon"] = ("step", known.lon, {"units": "degrees_east"})
        found["heading_true"] = ("leg", known.heading_true, {"units": "degree"})
    return found


def _clock(scene: Scene) -> dict[str, str]:
    if scene.time_zero is None:
        return {"units": "s"}
    return {"units": f"seconds since {scene.time_zero.removesuffix('Z')}", "calendar": "standard"}
