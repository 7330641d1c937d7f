"""``trajectory.nc``: the expected flight as a CF-1.8 discrete sampling geometry, a single trajectory."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.support.arrays import FloatArray

VARIABLES = {  # name: attribute of the log, standard name, unit, meaning
    "heading": ("heading", "platform_orientation", "degree", "true heading to hold on the leg that begins"),
    "airspeed": ("airspeed", "platform_speed_wrt_air", "m s-1", "airspeed on the leg that begins"),
    "course": ("track", "platform_course", "degree", "expected true track on the leg that begins"),
    "ground_speed": ("ground_speed", "platform_speed_wrt_ground", "m s-1", "expected speed on that leg"),
    "wind_speed": ("wind_speed", "wind_speed", "m s-1", "expected wind on that leg"),
    "wind_from": ("wind_from", "wind_from_direction", "degree", "direction that it blows from"),
    "wind_sd": ("wind_sd", None, "m s-1", "standard deviation of a component of the wind on that leg"),
    "radius_95": ("radius", None, "m", "of the circle that holds 95 % of the positions at that time"),
    "ellipse_major": ("major", None, "m", "standard deviation of the position along the major axis"),
    "ellipse_minor": ("minor", None, "m", "standard deviation of the position along the minor axis"),
    "ellipse_azimuth": ("azimuth", None, "degree", "true direction of the major axis"),
}


def trajectory_netcdf(exported: ExportedPlan) -> bytes:
    """The file; values of a leg stand at the time at which it begins, so the last ones are missing."""
    import h5netcdf

    log, content = exported.log, io.BytesIO()
    assert log.utc is not None
    since = log.utc[0].replace("T", " ").removesuffix("Z")
    coordinates: dict[str, tuple[FloatArray, dict[str, Any]]] = {
        "time": (log.t - log.t[0], {"standard_name": "time", "units": f"seconds since {since}",
                                    "calendar": "standard", "axis": "T"}),
        "lat": (log.lat, {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"}),
        "lon": (log.lon, {"standard_name": "longitude", "units": "degrees_east", "axis": "X"}),
    }  # fmt: skip
    with h5netcdf.File(content, "w") as file:
        file.attrs.update(
            {
                "Conventions": "CF-1.8",
                "featureType": "trajectory",
                "history": "written by pareto_ltl, from plan.json and wind.nc of the run",
                "title": f"Expected flight of {exported.name}",
                "comment": " ".join(exported.sentences()),
                "wind_law": log.law,
            }
        )
        name = np.frombuffer(exported.name.encode(), "S1")
        file.dimensions.update({"obs": len(log.t), "name_strlen": len(name)})
        file.create_variable("trajectory", ("name_strlen",), data=name).attrs.update(
            {"cf_role": "trajectory_id", "long_name": "name of the run"}
        )
        for key, (values, attributes) in coordinates.items():
            file.create_variable(key, ("obs",), data=values).attrs.update(attributes)
        for key, (source, standard, unit, meaning) in VARIABLES.items():
            values = getattr(log, source)
            padded = np.concatenate([values, np.full(len(log.t) - len(values), np.nan)])
            named = {} if standard is None else {"standard_name": standard}
            file.create_variable(key, ("obs",), data=padded, fillvalue=np.nan).attrs.update(
                named | {"units": unit, "long_name": meaning, "coordinates": "time lat lon"}
            )
    return content.getvalue()
