"""Fields of wind files: nodes of a grid in the wanted area, and the snapshot that two components make.

Nodes are left out that have no value, and at a pressure level those below ground.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox, refuse_empty_crop
from pareto_ltl.wind.levels import PRESSURE, Level
from pareto_ltl.wind.readings import check_readings, iso, wrap_longitude
from pareto_ltl.wind.snapshots import Snapshot, Snapshots
from pareto_ltl.world.projection import rotate_vectors


@dataclass(frozen=True, slots=True)
class Nodes:
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


@dataclass(frozen=True, slots=True)
class Field:
    """Both components of the wind at one time.

    Attributes
    ----------
    time, lead : float
        Valid time [s since 1970], and valid time minus start of the forecast [s].
    winds : (N, 2) float
        Components along the axes of the grid [m/s]; NaN for missing values.
    pressure : (N,) float or None
        Surface pressure [Pa]; None if it is not known.
    member : str
        Name of the ensemble member; empty for a single forecast.
    """

    time: float
    lead: float
    winds: FloatArray
    pressure: FloatArray | None
    member: str


@dataclass(frozen=True, slots=True)
class LeftOut:
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


def snapshot_of(
    field: Field, nodes: Nodes, level: Level, files: tuple[Path, ...], max_speed: float
) -> tuple[Snapshot, LeftOut]:
    """The Earth-relative winds of ``field``, and the numbers of nodes that are left out.

    Raises
    ------
    DataError
        If a wind is above ``max_speed`` [m/s].
    """
    here = np.asarray(np.isfinite(field.winds).all(axis=1))
    missing, below = len(here) - int(here.sum()), None
    if level.kind == PRESSURE and field.pressure is not None and len(field.pressure) == len(here):
        ground = here & (field.pressure < level.value)
        here, below = here & ~ground, int(ground.sum())
    winds = field.winds if nodes.twist is None else rotate_vectors(field.winds, -nodes.twist)
    points, winds = (nodes.lonlat, winds) if here.all() else (nodes.lonlat[here], winds[here])
    check_readings(points, winds, True, max_speed, lambda _: f"wind file {files[0]}, {iso(field.time)}")
    found = Snapshot(field.time, field.lead, points, winds, level.text, files, field.member)
    return found, LeftOut(len(here), missing, below)


def snapshots_with_notes(
    found: Sequence[tuple[Snapshot, LeftOut]], files: tuple[Path, ...], level: Level, notes: Iterable[str]
) -> Snapshots:
    """The snapshots, with ``notes`` and those on the nodes that were left out."""
    more = _left_out_notes(level, [count for _, count in found])
    return Snapshots(tuple(snapshot for snapshot, _ in found), files, (*notes, *more))


def _left_out_notes(level: Level, counts: Sequence[LeftOut]) -> Iterator[str]:
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
