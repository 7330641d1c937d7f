"""Warnings on readings: an age that is assumed, and edges, extents and spreads that do not fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from careful_io.times import HOUR, iso
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import Readings
from wind_laws.error_law import ErrorLaw

USUAL_DELAY = 4 * HOUR  # from the start of a forecast to its publication: GFS 3.5 to 5 h, ECMWF 6 h, HRRR 1 h
EDGE_SHARE = 0.02  # of the longer side of the map, that readings may end inside of it without a warning
LEAST_EXTENT = 0.01  # of the longer side of the map, that readings in a plane have at least
FACTOR = 3.0  # between the spread of the winds and the spread of the law
SAMPLES = 11  # positions along each side of the map


def assumed_leads(readings: Readings) -> tuple[FloatArray, str]:
    """The leads (K,) [s] with those that the files do not state, and the warning that says so.

    Without a stated lead, the first time is as old as a forecast is when it is published. If the leads of
    some times are stated, the others belong to the earliest of their runs. The warning is empty if all are.
    """
    unknown = np.isnan(readings.leads)
    if not unknown.any():
        return readings.leads, ""
    begun = readings.times[0] - USUAL_DELAY
    when = f"{USUAL_DELAY / HOUR:g} h before its first time, {iso(readings.times[0])}"
    when += ", as forecasts that have just been published"
    some = ""
    if not unknown.all():
        begun = float(np.nanmin(readings.times - readings.leads))
        some, when = f" at {unknown.sum()} of {len(unknown)} times", f"at {iso(begun)}, as its other times"
    message = (
        f"{readings.name} does not state how old its forecast is{some}: it is assumed to have begun {when}, "
        "so that errors grow from there; state the leads (column lead_hours of a table, "
        "forecast_reference_time of NetCDF), or set wind.forecast_error=none if all its fields are analyses "
        "or observations"
    )
    assumed = np.maximum(0.0, readings.times - begun)
    return np.asarray(np.where(unknown, assumed, readings.leads), float), message


def edge_warning(name: str, bounds: FloatArray, points: Sequence[FloatArray]) -> str:
    """The warning for a map ``bounds`` (2, 2) [m] that extends beyond readings at ``points``; else empty."""
    import shapely

    side = float(np.ptp(bounds, axis=0).max())
    corners = np.stack(np.meshgrid(*np.linspace(bounds[0], bounds[1], SAMPLES).T), axis=-1).reshape(-1, 2)
    places = shapely.points(corners)
    worst = 0.0
    for some in {id(each): each for each in points}.values():
        hull = shapely.convex_hull(shapely.MultiPoint(some))
        worst = max(worst, float(shapely.distance(places, hull).max()))
    if worst <= EDGE_SHARE * side:
        return ""
    return (
        f"{name}: the readings end inside the map, which reaches up to {worst / 1e3:.3g} km beyond them; "
        "there the wind is extrapolated and its standard deviation grows to its largest value: add readings "
        "beyond the edge of the map, or draw a smaller one"
    )


def refuse_small_extent(name: str, bounds: FloatArray, points: FloatArray) -> None:
    """Raise a DataError if readings in a plane, ``points`` (N, 2) [m], cover next to nothing of the map."""
    side = float(np.ptp(bounds, axis=0).max())
    extent = float(np.ptp(points, axis=0).max())
    if len(points) > 1 and extent < LEAST_EXTENT * side:
        share = 100.0 * float(np.prod(np.ptp(points, axis=0)) / np.prod(np.ptp(bounds, axis=0)))
        raise DataError(
            f"{name}: x and y of the readings span {extent:.4g} m, and the map {side:.4g} m: they cover "
            f"{share:.2g} % of it; expected metres of the plane of the map: multiply kilometres by 1000"
        )


def spread_warning(name: str, law: ErrorLaw, level: str, spread: float) -> str:
    """The warning for winds whose ``spread`` [m/s] over places does not fit ``law``; else empty."""
    if level != law.level or not law.parts or spread <= 0:
        return ""  # at other levels the law follows the spread
    ratio = spread / law.spread
    if 1 / FACTOR <= ratio <= FACTOR:
        return ""
    small = "smaller" if ratio > 1 else "larger"
    return (
        f"{name}: a component of the wind varies by {spread:.2g} m/s between places; the law of forecast "
        f"errors {law.name} was estimated from winds that vary by {law.spread:.2g} m/s, and may be {small} "
        "than the errors of this wind: estimate a law for it (pareto-ltl wind-error), and set "
        "wind.forecast_error"
    )
