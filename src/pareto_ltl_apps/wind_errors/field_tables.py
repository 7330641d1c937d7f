"""Winds on a latitude-longitude grid at several times, from an npz file.

Arrays: ``hours_since_1970`` (T,), ``lat`` (J,), ``lon`` (I,) [deg], and ``uv`` (T, 2, J, I) or ``u`` and
``v`` (T, J, I) [m/s]; names may end with ``_int16``, as in :mod:`pareto_ltl_apps.wind_errors.point_tables`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from careful_io.times import HOUR, iso
from flight_quantities.sphere import wrap_longitude
from pareto_ltl.extend import Snapshot
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import check_readings
from pareto_ltl_apps.wind_errors.point_tables import npz_arrays, numbers_of, unpacked_winds

TIMES = "hours_since_1970"
AXES = (TIMES, "lat", "lon")


def is_field_table(file: Path) -> bool:
    """Whether an npz file has the times and axes of fields; DataError if it is damaged."""
    return file.suffix == ".npz" and set(AXES) <= npz_arrays(file).keys()


def read_field_table(file: Path, max_speed: float, level: str) -> tuple[Snapshot, ...]:
    """The fields as analyses (lead 0) at ``level``, in order of time.

    Raises
    ------
    DataError
        If shapes do not fit, a time occurs twice, or a wind is above ``max_speed`` [m/s].
    """
    arrays = npz_arrays(file)
    hours, lat, lon = (numbers_of(arrays[name], name).ravel() for name in AXES)
    if "uv" in arrays or "uv_int16" in arrays:
        winds = unpacked_winds(arrays, "uv")
    else:
        winds = np.stack([unpacked_winds(arrays, name) for name in ("u", "v")], axis=1)
    expected = (len(hours), 2, len(lat), len(lon))
    if winds.shape != expected or len(np.unique(hours)) < len(hours):
        raise DataError(f"{file}: winds have the shape {winds.shape}; expected {expected}, each time once")
    east, north = np.meshgrid(wrap_longitude(lon), lat)
    points: FloatArray = np.column_stack([east.ravel(), north.ravel()])
    found = []
    for k in np.argsort(hours).tolist():
        here = winds[k].reshape(2, -1).T
        known = np.isfinite(here).all(axis=1)
        check_readings(points[known], here[known], True, max_speed, f"{file}, {iso(HOUR * hours[k])}")
        nodes = points if known.all() else points[known]
        found.append(Snapshot(HOUR * float(hours[k]), 0.0, nodes, here[known], level, (file,)))
    return tuple(found)
