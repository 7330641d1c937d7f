"""Winds of many forecasts: there can be several cycles and members for one valid time.

Nodes of a file are left out that have no value, and at a pressure level those below ground.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox, refuse_empty_crop
from pareto_ltl.wind.levels import PRESSURE, Level, parse_level
from pareto_ltl.wind.readings import Readings, check_readings, iso, lead_text, wrap_longitude
from pareto_ltl.world.projection import rotate_vectors


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The wind at one valid time from one cycle and one member of a model.

    Attributes
    ----------
    time : float
        Valid time [s since 1970-01-01 UTC].
    lead : float
        Valid time minus start of the forecast [s]; 0 for an analysis, NaN if it is not known.
    points : (n, 2) float
        Longitude (-180..180) and latitude [deg].
    winds : (n, 2) float
        Winds towards east and north [m/s].
    level : str
        Level of the wind: ``10m``, ``925hPa``, ...
    files : tuple of Path
        The files that contain it.
    member : str
        Name of the ensemble member; empty for a single forecast.
    """

    time: float
    lead: float
    points: FloatArray
    winds: FloatArray
    level: str
    files: tuple[Path, ...]
    member: str = ""

    @property
    def cycle(self) -> float:
        """Start of the forecast [s since 1970]; the valid time if the lead is not known."""
        return self.time if np.isnan(self.lead) else self.time - self.lead


class Snapshots(NamedTuple):
    """Every wind in ``files``, and ``notes`` of quality control, one line each."""

    winds: tuple[Snapshot, ...]
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()


# --- snapshots from the grid of a file ---------------------------------------------------------


class Nodes(NamedTuple):
    """Nodes of a grid, cropped.

    Attributes
    ----------
    kept : (N,) int
        Indices of the nodes among the flattened values of the grid.
    lonlat : (N, 2) float
        Longitude (-180..180) and latitude [deg].
    twist : (N,) float or None
        Angle from grid north to true north [rad]; None if the axes of the grid are east and north.
    """

    kept: IntArray
    lonlat: FloatArray
    twist: FloatArray | None = None


class GridWind(NamedTuple):
    """A wind as a file has it.

    Attributes
    ----------
    snap : Snapshot
        The wind along the axes of the grid, NaN for missing values.
    twist : (N,) float or None
        As in :class:`Nodes`.
    pressure : (N,) float or None
        Surface pressure [Pa]; None if it is not known.
    """

    snap: Snapshot
    twist: FloatArray | None
    pressure: FloatArray | None


class _LeftOut(NamedTuple):
    """Numbers of nodes of one field: all, those without a value, those below ground (None if not known)."""

    nodes: int
    missing: int
    below: int | None


def crop(file: Path, lon: FloatArray, lat: FloatArray, area: GeoBox | None) -> Nodes:
    """The nodes of a grid that are in ``area``; a DataError if there are none."""
    lonlat = np.stack([wrap_longitude(lon.reshape(-1)), lat.reshape(-1)], axis=1)
    inside = np.isfinite(lonlat).all(axis=1)
    if (np.abs(lonlat[inside, 1]) > 90.0).any():
        raise DataError(f"wind file {file}: a latitude is beyond 90 degrees; expected degrees north")
    if not inside.any():
        raise DataError(f"wind file {file} has no node with a latitude and longitude")
    rows = np.flatnonzero(inside)
    if area is not None:
        rows = rows[np.isin(rows, area.pick(lonlat))]
        if not len(rows):
            refuse_empty_crop(f"wind file {file}", lonlat, area)
    return Nodes(rows, lonlat[rows])


def earth_relative(
    found: Iterable[GridWind], files: tuple[Path, ...], level: Level, max_speed: float, notes: Iterable[str]
) -> Snapshots:
    """The winds turned to east and north, without nodes that have no value or are below ground.

    ``notes``, which are read after all winds, are completed by notes on these nodes. DataError if a wind is
    above ``max_speed`` [m/s].
    """
    turned = [_turned(wind, max_speed) for wind in found]
    more = _left_out_notes(level, [count for _, count in turned])
    return Snapshots(tuple(snap for snap, _ in turned), files, (*notes, *more))


def _turned(wind: GridWind, max_speed: float) -> tuple[Snapshot, _LeftOut]:
    snap, pressure = wind.snap, wind.pressure
    here, level = np.asarray(np.isfinite(snap.winds).all(axis=1)), parse_level(snap.level)
    missing, below = len(here) - int(here.sum()), None
    if level.kind == PRESSURE and pressure is not None and len(pressure) == len(here):
        ground = here & (pressure < level.value)
        here, below = here & ~ground, int(ground.sum())
    winds = snap.winds if wind.twist is None else rotate_vectors(snap.winds, -wind.twist)
    points, winds = (snap.points, winds) if here.all() else (snap.points[here], winds[here])
    check_readings(points, winds, True, max_speed, lambda _: f"wind file {snap.files[0]}, {iso(snap.time)}")
    return replace(snap, points=points, winds=winds), _LeftOut(len(here), missing, below)


def _left_out_notes(level: Level, counts: Sequence[_LeftOut]) -> Iterator[str]:
    """A line for each kind of node that is left out, and one if some fields could not be checked."""
    nodes = sum(count.nodes for count in counts)
    if missing := sum(count.missing for count in counts):
        yield f"{missing} of {nodes} values at {level.text} are missing in the file and left out"
    if level.kind != PRESSURE or not counts:
        return
    checked = [count for count in counts if count.below is not None]
    if checked:
        below = sum(count.below or 0 for count in checked)
        yield (
            f"{below} of {sum(count.nodes for count in checked)} values at {level.text} lie below ground, "
            "where the surface pressure is lower, and are left out"
        )
    if len(checked) < len(counts):
        yield (
            f"{len(counts) - len(checked)} fields at {level.text} come without surface pressure: whether "
            "nodes lie below ground could not be checked"
        )


# --- readings of snapshots ---------------------------------------------------------------------


def latest_readings(
    snapshots: Sequence[Snapshot], files: tuple[Path, ...], notes: tuple[str, ...] = ()
) -> Readings:
    """Readings with one wind for each valid time, from the newest cycle.

    Raises
    ------
    DataError
        If two snapshots have the same time and lead, or levels differ.
    """
    best: dict[float, Snapshot] = {}
    for snap in snapshots:
        rival = best.get(snap.time)
        if rival is not None and (rival.lead == snap.lead or np.isnan(rival.lead + snap.lead)):
            names = " and ".join(dict.fromkeys(file.name for file in (*rival.files, *snap.files)))
            raise DataError(
                f"wind files {names} both hold the wind at {iso(snap.time)} with the same lead; "
                "keep one member, or use wind.source=ensemble"
            )
        if rival is None or snap.lead < rival.lead:
            best[snap.time] = snap
    return readings_of([best[time] for time in sorted(best)], files, notes=notes)


def readings_of(
    fields: Sequence[Snapshot], files: tuple[Path, ...], geographic: bool = True, **more: Any
) -> Readings:
    """The readings of ``fields``, whose times increase; ``more`` are further attributes of the readings."""
    usual = {"remarks": tuple(lead_text(snap.lead) for snap in fields), "level": one_level(fields)}
    return Readings(
        times=np.array([snap.time for snap in fields]),
        points=tuple(snap.points for snap in fields),
        winds=tuple(snap.winds for snap in fields),
        geographic=geographic,
        files=files,
        origins=tuple(snap.files for snap in fields),
        leads=np.array([snap.lead for snap in fields]),
        **usual | more,
    )


def one_level(snapshots: Sequence[Snapshot]) -> str:
    """The level of all ``snapshots``; a DataError if they have several."""
    levels = sorted({snap.level for snap in snapshots})
    if len(levels) > 1:
        raise DataError(f"wind files hold several levels ({', '.join(levels)}); pick one with wind.level")
    return levels[0] if levels else "10m"


def known_at(snapshots: Sequence[Snapshot], moment: float, delay: float) -> tuple[Snapshot, ...]:
    """The snapshots of cycles that began at least ``delay`` [s] before ``moment`` [s since 1970]."""
    return tuple(snap for snap in snapshots if snap.cycle <= moment - delay)
