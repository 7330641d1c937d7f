"""Writes current.csv: an invented current over the shelf south of Rhode Island, for eight days.

A jet along the edge of the shelf, a warm ring that drifts west, and a slow turn of the flow on the shelf.
"""

import csv
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

START, EVERY, TIMES = datetime(2018, 10, 9), timedelta(hours=6), 33
EAST, NORTH = np.arange(-72.4, -69.9, 0.3), np.arange(39.5, 41.3, 0.2)  # [deg]
KM_A_DEGREE = 111.2


def current(lon: float, lat: float, days: float) -> tuple[float, float]:
    """Towards east and north [m/s]."""
    east, north = KM_A_DEGREE * np.cos(np.deg2rad(40.4)) * (lon + 71.2), KM_A_DEGREE * (lat - 40.4)
    u, v = -0.22 * np.exp(-(((north + 20 + 0.1 * east) / 25) ** 2)), 0.0  # jet
    x, y = east - 45 + 5 * days, north + 70  # from the middle of the ring [km]
    spin = 0.35 * np.exp(0.5 - (x**2 + y**2) / (2 * 30**2)) / 30  # fastest 30 km from there
    angle = 2 * np.pi * days / 4
    return u + spin * y + 0.06 * np.cos(angle), v - spin * x - 0.06 * np.sin(angle)


with Path(__file__).with_name("current.csv").open("w", newline="") as file:
    table = csv.writer(file, lineterminator="\n")
    table.writerow(["time", "lat", "lon", "u", "v"])
    for k in range(TIMES):
        time = START + k * EVERY
        for lat in NORTH:
            for lon in EAST:
                u, v = current(lon, lat, k * EVERY / timedelta(days=1))
                table.writerow(
                    [f"{time:%Y-%m-%dT%H:%MZ}", f"{lat:.1f}", f"{lon:.1f}", f"{u:.3f}", f"{v:.3f}"]
                )
