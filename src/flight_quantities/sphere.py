"""Positions on the Earth as a sphere."""

from __future__ import annotations

import numpy as np

from flight_quantities.arrays import FloatArray


def wrap_longitude(lon: FloatArray) -> FloatArray:
    """Longitudes [deg] converted to -180..180."""
    return (lon + 180.0) % 360.0 - 180.0


def on_sphere(lonlat: FloatArray) -> FloatArray:
    """Unit vectors (N, 3) of longitudes and latitudes (N, 2) [deg], whose distances increase with the arc."""
    lon, lat = np.deg2rad(lonlat).T
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
