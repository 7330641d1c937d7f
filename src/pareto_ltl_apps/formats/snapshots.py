"""Winds of many forecasts: there can be several cycles and members for one valid time.

Readings are made of the newest forecast of each time, or of the mean of an ensemble and the deviations of its
members. Nodes of a file are left out that have no value, and at a pressure level those below ground.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from careful_io.faults import Faults
from careful_io.times import iso
from flight_quantities.levels import PRESSURE, Level
from flight_quantities.sphere import wrap_longitude
from pareto_ltl import Readings
from pareto_ltl.extend import GeoBox, NodeAir, Snapshot, WindConfig, readings_of
from pareto_ltl.support.arrays import FloatArray, IntArray, rotate_vectors
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.levels import wind_level
from pareto_ltl.wind.readings import check_readings
from pareto_ltl.wind.snapshots import one_level

FEWEST_MEMBERS = 2
NEAR_NODE = 1e-3  # [deg] closer nodes of two members count as the same node
LARGEST_GAP = 3.0  # [deg] a node is left out if another member has no node within this distance


class Snapshots(NamedTuple):
    """Every wind in ``files``, and ``notes`` of quality control, one line each.

    ``law`` is the packaged law of forecast errors that fits their model; empty if it is not known.
    """

    winds: tuple[Snapshot, ...]
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    law: str = ""


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
            area.refuse_empty_crop(f"wind file {file}", lonlat)
    return Nodes(rows, lonlat[rows])


def earth_relative(
    found: Iterable[GridWind], files: tuple[Path, ...], level: Level, max_speed: float, notes: Iterable[str]
) -> Snapshots:
    """The winds turned to east and north, without nodes that have no value or are below ground.

    ``notes``, which are read after all winds, are completed by notes on these nodes. DataError if a wind is
    above ``max_speed`` [m/s].
    """
    turned: list[Snapshot] = []
    nodes = missing = checked = below = unchecked = 0  # numbers of nodes, and of fields not checked
    faults = Faults.of_files("wind file", files)
    for snap, twist, pressure in faults.going(found):
        here = np.asarray(np.isfinite(snap.winds).all(axis=1))
        nodes, missing = nodes + len(here), missing + int((~here).sum())
        if level.kind == PRESSURE and pressure is not None and len(pressure) == len(here):
            ground = here & (pressure < wind_level(snap.level).value)
            here, checked, below = here & ~ground, checked + len(here), below + int(ground.sum())
        else:
            unchecked += 1
        winds = snap.winds if twist is None else rotate_vectors(snap.winds, -twist)
        points, winds = (snap.points, winds) if here.all() else (snap.points[here], winds[here])
        where = f"wind file {snap.files[0]}, {iso(snap.time)}"
        with faults.noted():
            check_readings(points, winds, True, max_speed, where)
            if snap.air is not None:
                snap.air.check(where)
        turned.append(replace(snap, points=points, winds=winds))
    faults.refuse()
    more = []
    if missing:
        more.append(f"{missing} of {nodes} values at {level.text} are missing in the file and left out")
    if checked:
        more.append(
            f"{below} of {checked} values at {level.text} lie below ground, where the surface pressure is "
            "lower, and are left out"
        )
    if unchecked and level.kind == PRESSURE:
        more.append(
            f"{unchecked} fields at {level.text} come without surface pressure: whether nodes lie below "
            "ground could not be checked"
        )
    return Snapshots(tuple(turned), files, (*notes, *more))


def latest_readings(
    snapshots: Sequence[Snapshot], files: tuple[Path, ...], notes: tuple[str, ...] = (), law: str = ""
) -> Readings:
    """Readings with one wind for each valid time, from the newest cycle.

    Raises
    ------
    DataError
        If two snapshots have the same time and lead, or levels differ.
    """
    best: dict[float, Snapshot] = {}
    twice = 0
    for snap in snapshots:
        rival = best.get(snap.time)
        if rival is not None and same_snapshot(rival, snap):
            twice += 1
            continue
        if rival is not None and (rival.lead == snap.lead or np.isnan(rival.lead + snap.lead)):
            names = " and ".join(dict.fromkeys(file.name for file in (*rival.files, *snap.files)))
            raise DataError(
                f"wind files {names} both hold the wind at {iso(snap.time)} with the same lead; "
                "keep one member, or use wind.source=ensemble"
            )
        if rival is None or snap.lead < rival.lead:
            best[snap.time] = snap
    if twice:
        notes = (*notes, f"{twice} fields occur twice with the same values: read once")
    return readings_of([best[time] for time in sorted(best)], files, notes=notes, law=law)


def same_values(one: FloatArray, two: FloatArray) -> bool:
    """Whether two fields have the same shape and values, and miss the same ones."""
    return bool(one.shape == two.shape and np.array_equal(one, two, equal_nan=True))


def same_snapshot(one: Snapshot, two: Snapshot) -> bool:
    """Whether two fields have the same lead, level, places and winds."""
    leads = np.array([one.lead]), np.array([two.lead])
    pairs = (leads, (one.points, two.points), (one.winds, two.winds))
    return one.level == two.level and all(same_values(*pair) for pair in pairs)


def known_at(snapshots: Sequence[Snapshot], moment: float, delay: float) -> tuple[Snapshot, ...]:
    """The snapshots of cycles that began at least ``delay`` [s] before ``moment`` [s since 1970]."""
    return tuple(snap for snap in snapshots if snap.cycle <= moment - delay)


def ensemble_readings(
    snapshots: Sequence[Snapshot],
    files: tuple[Path, ...],
    cfg: WindConfig,
    notes: tuple[str, ...] = (),
    law: str = "",
) -> Readings:
    """Mean and deviations of the members at every valid time with at least two members.

    Members are runs of one model from perturbed initial states (GEFS), of several models, or of several
    cycles of one model (a time-lagged ensemble). With n members w_m on the same nodes::

        μ   = Σ_m w_m / n
        d_m = √(s (1 + 1/n) / (n - 1)) (w_m - μ),     Σ_m d_m d_m' = s (1 + 1/n) C

    where C is the covariance of the members. The factor 1 + 1/n accounts for the error of the mean of n
    members, if the truth is distributed as a further member. A member is the same at all times, so that its
    deviation persists and moves with the weather of that member.

    A covariance that is estimated from few members is uncertain. With n members it gets the share
    s = (n - 1) / (n - 1 + ν), and the law of forecast errors the share 1 - s, with ν =
    ``wind.ensemble_prior``. This is the mean of an inverse Wishart distribution whose prior is the parametric
    law (Gelman et al., Bayesian Data Analysis, 3rd ed., section 3.6).

    Parameters
    ----------
    files : tuple of Path
        The files of the source.
    cfg : WindConfig
        ``ensemble_prior`` is ν, the weight of the law of forecast errors as a number of members; with 0, or
        ``forecast_error=none``, only the members determine the error.
    notes : tuple of str
        Remarks to which those on the ensemble are added.
    law : str
        The law of forecast errors that fits the model; empty if it is not known.

    Raises
    ------
    DataError
        If no valid time has two members, or levels differ.
    """
    one_level(snapshots)
    groups = _by_time(snapshots)
    times = sorted(time for time, group in groups.items() if len(group) >= FEWEST_MEMBERS)
    if not times:
        raise DataError(
            f"{files[0].parent}: no valid time has two members ({len(groups)} times, "
            f"{iso(min(groups))} .. {iso(max(groups))}, one field each); an ensemble needs forecasts "
            "of several members or cycles for the same times: add them, or use wind.source=grib"
        )
    names = sorted({name for time in times for name in groups[time]})
    fewest = min(len(groups[time]) for time in times)
    share = (fewest - 1) / (fewest - 1 + (0.0 if cfg.forecast_error == "none" else cfg.ensemble_prior))
    found = [_mean_and_deviations(groups[time], names, share) for time in times]
    left_out = len(groups) - len(times)
    said = [f"{len(names)} members, at least {fewest} at each time"]
    said += [f"{left_out} times with a single member left out"] if left_out else []
    return readings_of(
        [mean for mean, _ in found],
        files,
        remarks=tuple(f"mean of {len(groups[time])} members" for time in times),
        notes=(*notes, *said),
        members=tuple(deviations for _, deviations in found),
        forecast_share=1.0 - share,
        law=law,
    )


def _by_time(snapshots: Sequence[Snapshot]) -> dict[float, dict[str, Snapshot]]:
    """The members of each valid time [s since 1970] by name (in the file, else the folder) and cycle."""
    groups: dict[float, dict[str, Snapshot]] = {}
    for snap in snapshots:
        name = f"{snap.member or snap.files[0].parent.name} of {iso(snap.cycle)}"
        members = groups.setdefault(snap.time, {})
        if name in members:
            both = " and ".join(file.name for file in (*members[name].files[:1], *snap.files[:1]))
            raise DataError(f"wind files {both} both hold the {name} at {iso(snap.time)}; keep one of them")
        members[name] = snap
    return groups


def _mean_and_deviations(
    group: dict[str, Snapshot], names: Sequence[str], share: float
) -> tuple[Snapshot, FloatArray]:
    """The mean wind of one time and the weighted deviations (N, 2, M) [m/s] from it.

    M is the number of members over all times; members without a field at this time have deviation 0.

    Eq. (M13) of docs/mathematics.md.
    """
    first = next(iter(group.values()))
    aligned = {name: _at_nodes(snap, first.points) for name, snap in group.items()}
    everywhere = np.all([np.isfinite(winds).all(axis=1) for winds in aligned.values()], axis=0)
    stack = np.stack([winds[everywhere] for winds in aligned.values()], axis=-1)
    mean, n = stack.mean(axis=-1), stack.shape[-1]
    weight = np.sqrt(share * (1.0 + 1.0 / n) / (n - 1))
    deviations = np.zeros((*mean.shape, len(names)))
    deviations[..., [names.index(name) for name in aligned]] = weight * (stack - mean[..., None])
    lead = min(snap.lead for snap in group.values())
    files = tuple(dict.fromkeys(file for snap in group.values() for file in snap.files))
    air = NodeAir.mean_of([snap.air for snap in group.values()])
    mean_wind = replace(first, lead=lead, points=first.points[everywhere], winds=mean, files=files, air=air)
    return mean_wind, deviations


def _at_nodes(snap: Snapshot, nodes: FloatArray) -> FloatArray:
    """Winds (N, 2) [m/s] of ``snap`` at ``nodes`` (N, 2) [deg], linear between its nodes; NaN outside."""
    if snap.points.shape == nodes.shape and np.abs(snap.points - nodes).max() < NEAR_NODE:
        return snap.winds
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import cKDTree

    middle = float(np.median(nodes[:, 0]))
    own, there = (np.column_stack([wrap_longitude(p[:, 0] - middle), p[:, 1]]) for p in (snap.points, nodes))
    found = np.asarray(LinearNDInterpolator(own, snap.winds)(there), float)
    far = cKDTree(own).query(there)[0] > LARGEST_GAP
    found[far] = np.nan
    return found
