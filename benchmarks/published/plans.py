"""Plans of any planner: tables of true headings and airspeeds, as controls in the plane of a mission."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from pareto_ltl.extend import Frame
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.wind_lookup import interpolate
from pareto_ltl.support.arrays import FloatArray, rotate_vectors
from pareto_ltl.support.errors import DataError
from published.dataset import Mission

COLUMNS = ("duration_s", "heading_true_deg", "airspeed_m_s")
SLACK = 1e-3  # [m/s] beyond the limits of the airspeed: rounding of other programs


def read_orders(path: Path, mission: Mission) -> FloatArray:
    """Heading [rad] and airspeed [m/s] of every step (T, 2) of a table; other columns are not read.

    A leg lasts whole steps. Rows without a duration, such as the arrival, are no legs.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        table = csv.DictReader(file)
        if missing := set(COLUMNS) - set(table.fieldnames or ()):
            raise DataError(
                f"{path}: missing column {', '.join(sorted(missing))}; expected {', '.join(COLUMNS)}"
            )
        legs = [(number, row) for number, row in enumerate(table, 1) if (row["duration_s"] or "").strip()]
    orders = [order for number, row in legs for order in _steps_of(f"{path}: row {number}", row, mission)]
    if not 0 < len(orders) <= mission.most_steps:
        raise DataError(
            f"{path}: {len(orders)} steps of {mission.dt:g} s; expected 1 to {mission.most_steps}"
        )
    return np.array(orders)


def _steps_of(where: str, row: dict[str, str], mission: Mission) -> list[tuple[float, float]]:
    """The orders of the steps of one leg; a drifting robot needs no heading."""
    try:
        duration, airspeed = float(row["duration_s"]), float(row["airspeed_m_s"])
        heading = math.radians(float(row["heading_true_deg"] or ("0" if airspeed == 0.0 else "")))
    except ValueError:
        raise DataError(f"{where}: expected numbers in {', '.join(COLUMNS)}") from None
    steps = round(duration / mission.dt) if math.isfinite(duration) else 0
    if steps < 1 or abs(duration - steps * mission.dt) > 1.0:
        raise DataError(f"{where}: duration_s must be a multiple of {mission.dt:g} s, got {duration:g}")
    if not mission.u_min - SLACK <= airspeed <= mission.u_max + SLACK or not math.isfinite(heading):
        raise DataError(
            f"{where}: airspeed_m_s must be between {mission.u_min:g} and {mission.u_max:g}, not {airspeed:g}"
        )
    return [(heading, airspeed)] * steps


def controls(problem: Problem, orders: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Controls (T, 2) [m/s] and the flight without gusts (T+1, 2) [m] of ``orders`` in the true wind.

    North of the plane differs from true north by an angle that changes on the way; the one halfway is used.
    """
    crs, wind, dt = str(problem.scene.crs), problem.wind, problem.motion.dt
    x, u = [np.asarray(problem.scene.start, float)], list[FloatArray]()
    for step, (heading, airspeed) in enumerate(orders):
        drift = interpolate(wind, wind.mean, min(step, len(wind.slot) - 1), x[-1])
        order, control = airspeed * np.array([math.sin(heading), math.cos(heading)]), np.zeros(2)
        for _ in range(2):
            lon, lat = Frame(crs).to_geographic(x[-1] + 0.5 * dt * (control + drift))
            angle = Frame(crs).convergence(lon, lat)
            control = rotate_vectors(order[None], angle)[0]
        u.append(control)
        x.append(x[-1] + dt * (control + drift))
    return np.array(u), np.array(x)
