"""Temperature and pressure of the air in wind files, beside the winds at their level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from careful_io.faults import Faults
from flight_quantities.heights import MeasuredAir
from flight_quantities.levels import HEIGHT, PRESSURE, Level
from pareto_ltl.support.arrays import FloatArray, require_shape
from pareto_ltl.support.levels import wind_level

COLDEST, WARMEST = 173.15, 333.15  # [K] of air up to 32 km
LEAST_PRESSURE, LARGEST_PRESSURE = 500.0, 110_000.0  # [Pa]
FEWEST_NODES = 4  # from which the air of a map is taken, if fewer lie on the map
GROUND = Level(HEIGHT, 0.0).text


class NodeAir(NamedTuple):
    """The air at one time at the nodes of a file.

    Attributes
    ----------
    points : (n, 2) float
        Longitude and latitude [deg], or x and y [m].
    temperature, pressure : (n,) float
        [K], [Pa]; NaN where they are not known.
    level, pressure_level : str
        Where they are measured, e.g. ``2m`` and ``0m``.
    """

    points: FloatArray
    temperature: FloatArray
    level: str
    pressure: FloatArray
    pressure_level: str = GROUND

    def check(self, where: str, rows: Sequence[int] | None = None) -> None:
        """Raise a DataError for temperatures and pressures that no air has, with the first of each.

        The messages begin with ``where`` and, of a table, with the first of the ``rows`` of its nodes.
        """
        faults = Faults(where)
        limits = (
            ("temperature", self.temperature, COLDEST, WARMEST, "K"),
            ("pressure", self.pressure, LEAST_PRESSURE, LARGEST_PRESSURE, "Pa"),
        )
        for name, values, low, high, unit in limits:
            bad = np.flatnonzero(np.isfinite(values) & ~((values >= low) & (values <= high)))
            if len(bad):
                row = "" if rows is None else f", row {rows[bad[0]]}"
                several = f" ({len(bad)} such values)" if len(bad) > 1 else ""
                faults.add(
                    f"{where}{row}: {name} {values[bad[0]]:.6g} {unit} is not plausible for air{several}; "
                    f"expected {low:g} to {high:g} {unit}: correct its unit or its values, or write the file "
                    "without it"
                )
        faults.refuse()

    @staticmethod
    def mean_of(airs: Sequence[NodeAir | None]) -> NodeAir | None:
        """The mean air of the members of an ensemble that have it on the same nodes as the first one."""
        there = [air for air in airs if air is not None]
        alike = [air for air in there if np.array_equal(air.points, there[0].points)]
        if not alike:
            return None
        stacks = (np.stack([getattr(air, name) for air in alike]) for name in ("temperature", "pressure"))
        temperature, pressure = (stack.mean(axis=0) for stack in stacks)
        return alike[0]._replace(temperature=temperature, pressure=pressure)


@dataclass(frozen=True, slots=True)
class MapAir:
    """Means of the air over a map at K times, on which a wind file has it.

    Attributes
    ----------
    times : (K,) float
        Increasing [s since time_zero].
    temperature, pressure : (K,) float
        [K], [Pa]; the pressure is NaN where it is not known.
    level, pressure_level : str
        As in :class:`NodeAir`.
    """

    times: FloatArray
    temperature: FloatArray
    pressure: FloatArray
    level: str
    pressure_level: str = GROUND

    def __post_init__(self) -> None:
        for name in ("temperature", "pressure"):
            require_shape(name, getattr(self, name), len(self.times))
        if not (np.isfinite(self.temperature).all() and (np.diff(self.times) > 0).all()):
            raise ValueError("temperatures must be finite and times increase")

    def during(self, t: FloatArray) -> MeasuredAir:
        """Means over the times ``t`` [s since time_zero], linear between the times of the file."""
        warmth = float(np.interp(t, self.times, self.temperature).mean())
        known = np.isfinite(self.pressure)
        pressure = float(np.interp(t, self.times, self.pressure).mean()) if known.all() else None
        return MeasuredAir(warmth, self.level, pressure, self.pressure_level)


def map_air(airs: Mapping[float, NodeAir | None], bounds: FloatArray) -> MapAir | None:
    """Means over a map of ``airs`` by time [s since time_zero], whose points are in its plane [m].

    ``bounds`` (2, 2) are its corners. Nodes below the ground of a pressure level do not count. None if no
    time has a temperature.
    """
    rows = []
    for time, air in airs.items():
        if air is not None and (here := _on_map(air, bounds)) is not None:
            rows.append((time, *here, air.level, air.pressure_level))
    if not rows:
        return None
    times, temperature, pressure, levels, pressure_levels = zip(*rows, strict=True)
    if len({*levels}) > 1 or len({*pressure_levels}) > 1:
        return None
    return MapAir(np.array(times), np.array(temperature), np.array(pressure), levels[0], pressure_levels[0])


def _on_map(air: NodeAir, bounds: FloatArray) -> tuple[float, float] | None:
    """Mean temperature and pressure of the nodes on the map, or of those nearest to it."""
    known = np.isfinite(air.temperature)
    level = wind_level(air.level)
    if level.kind == PRESSURE:
        known &= ~(air.pressure < level.value)
    if not known.any():
        return None
    points = air.points[known]
    outside = np.maximum(0.0, np.maximum(bounds[0] - points, points - bounds[1]))
    gap = np.hypot(outside[:, 0], outside[:, 1])
    chosen = np.flatnonzero(gap == 0.0)
    if len(chosen) < FEWEST_NODES:
        chosen = np.argsort(gap, kind="stable")[:FEWEST_NODES]
    return float(air.temperature[known][chosen].mean()), float(air.pressure[known][chosen].mean())
