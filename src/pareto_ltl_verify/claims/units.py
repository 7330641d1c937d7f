"""Claims about NetCDF files: units of wind.nc and trajectory.nc, and the numbers of the trajectory."""

from __future__ import annotations

from functools import partial

import numpy as np

from pareto_ltl_verify.claims import Claim, Verdict, no_fault
from pareto_ltl_verify.claims.exports import TABLE, column
from pareto_ltl_verify.evidence import Evidence

TRAJECTORY, SPEED = "trajectory.nc", "m s-1"
UNITS = {
    **dict.fromkeys(
        (
            "x",
            "y",
            "mode_x",
            "mode_y",
            "reading_x",
            "reading_y",
            "radius_95",
            "ellipse_major",
            "ellipse_minor",
        ),
        "m",
    ),
    **dict.fromkeys(
        (
            "u",
            "v",
            "u_modes",
            "v_modes",
            "reading_u",
            "reading_v",
            "u_prior_mean",
            "v_prior_mean",
            "u_prior_sd",
            "v_prior_sd",
            "u_noise_sd",
            "v_noise_sd",
            "airspeed",
            "calibrated_airspeed",
            "ground_speed",
            "wind_speed",
            "wind_sd",
        ),
        SPEED,
    ),
    **dict.fromkeys(("u_var", "v_var", "u_gust_var", "v_gust_var"), "m2 s-2"),
    **dict.fromkeys(("heading", "course", "wind_from", "ellipse_azimuth"), "degree"),
    "lat": "degrees_north",
    "lon": "degrees_east",
    "lead": "s",
}  # fmt: skip - of both files
COLUMNS = {
    "heading": "heading_true_deg",
    "airspeed": "airspeed_tas_m_s",
    "calibrated_airspeed": "airspeed_cas_m_s",
    "course": "track_true_deg",
    "ground_speed": "ground_speed_m_s",
    "wind_speed": "wind_m_s",
    "wind_from": "wind_from_deg",
    "wind_sd": "wind_sd_m_s",
    "radius_95": "radius_95_m",
    "ellipse_major": "ellipse_major_m",
    "ellipse_minor": "ellipse_minor_m",
    "ellipse_azimuth": "ellipse_azimuth_deg",
}  # fmt: skip - variables of trajectory.nc and columns of the table


def units(name: str, result: Evidence) -> Verdict:
    """The units of every variable whose unit is known."""
    from careful_io.netcdf4 import opened_netcdf

    with opened_netcdf(result.directory / name) as file:
        known = [key for key in UNITS if key in file]
        stated = {key: str(file[key].attrs.get("units", "")) for key in known}
    faults = [f"{key} in {unit!r}" for key, unit in stated.items() if unit != UNITS[key]]
    return no_fault(f"{len(known)} units", faults)


def trajectory(result: Evidence) -> Verdict:
    """Every number of trajectory.nc is a number of the table of dead reckoning."""
    from careful_io.netcdf4 import opened_netcdf

    rows, faults = result.table(TABLE), list[str]()
    with opened_netcdf(result.directory / TRAJECTORY) as file:
        shown = {key: np.asarray(file[key][...], float).ravel() for key in COLUMNS if key in file}
    for key, values in shown.items():
        wanted = column(rows, COLUMNS[key])
        there = np.isfinite(wanted)
        alike = values.shape == wanted.shape and np.allclose(
            values[there], wanted[there], rtol=1e-6, atol=1e-6
        )
        faults += [key] * (not alike)
    return no_fault(f"{len(shown)} variables", faults)


CLAIMS: tuple[Claim, ...] = (
    *(Claim(f"units: {name}", (name,), partial(units, name)) for name in ("wind.nc", TRAJECTORY)),
    Claim("exports: numbers of trajectory.nc", (TRAJECTORY, TABLE), trajectory),
)
