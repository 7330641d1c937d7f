"""Wind components and vector fields as files have them, and directions of the axes of a grid."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from careful_io.errors import DataError
from pareto_ltl_verify.arrays import FloatArray

U, V, SPEED, FROM, TOWARDS = "u", "v", "speed", "direction from", "direction towards"
KNOT = 1852.0 / 3600.0  # [m/s]


class UnreadError(DataError):
    """The second reader does not read a file; the message is the reason."""


@dataclass(frozen=True, slots=True)
class Component:
    """One component at one time.

    Attributes
    ----------
    kind : str
        ``U``, ``V``, ``SPEED``, ``FROM`` or ``TOWARDS``.
    time, lead : float
        Valid time [s since 1970] and time since the start of the forecast [s], NaN if it is not stated.
    member : str
        Member of an ensemble; empty for a single forecast.
    places : (N, 2) float
        Longitude and latitude [deg].
    values : (N,) float
        Speed [m/s] or direction [deg]; NaN where there is none.
    turn : (N,) float or None
        Angle from east to the axis of u, counter-clockwise [rad]; None if u is towards the east.
    """

    kind: str
    time: float
    lead: float
    member: str
    places: FloatArray
    values: FloatArray
    turn: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Field:
    """The wind at one time: ``winds`` (N, 2) [m/s] at ``places`` (N, 2).

    Places are longitude and latitude [deg], or x and y [m] in a ``plane``. The winds are towards east and
    north, or x and y; ``turned`` from the axes of a grid or not.
    """

    time: float
    lead: float
    member: str
    places: FloatArray
    winds: FloatArray
    turned: bool = False
    plane: bool = False


def fields_of(components: Iterable[Component]) -> list[Field]:
    """The vector field of every time, lead and member; UnreadError if one lacks its counterpart."""
    groups: dict[tuple[float, str, str], dict[str, Component]] = {}
    for one in components:
        group = groups.setdefault((one.time, f"{one.lead:.0f}", one.member), {})
        there = group.setdefault(one.kind, one)
        if there is not one and not np.array_equal(there.values, one.values, equal_nan=True):
            raise UnreadError("a component occurs twice with other values")
    return [field for group in groups.values() if len((field := _joined(group)).places)]


def _joined(group: dict[str, Component]) -> Field:
    if U in group and V in group:
        one, two = group[U], group[V]
        u, v, turn = one.values, two.values, one.turn
    elif SPEED in group and (way := {FROM, TOWARDS} & set(group)):
        one, two = group[SPEED], group[way.pop()]
        angle, turn = np.deg2rad(np.where(one.values == 0.0, 0.0, two.values)), None
        sign = 1.0 if two.kind == TOWARDS else -1.0
        u, v = sign * one.values * np.sin(angle), sign * one.values * np.cos(angle)
    else:
        raise UnreadError(f"there is the {' and '.join(group)} alone")
    if one.places.shape != two.places.shape or not np.allclose(one.places, two.places, atol=1e-6):
        raise UnreadError("two components are on different grids")
    if turn is not None:
        u, v = u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)
    winds = np.stack([u, v], axis=1)
    known = np.isfinite(winds).all(axis=1) & np.isfinite(one.places).all(axis=1)
    return Field(one.time, one.lead, one.member, one.places[known], winds[known], turn is not None)


def on_unit_sphere(lon: FloatArray, lat: FloatArray) -> FloatArray:
    """Unit vectors (..., 3) of longitudes and latitudes [deg]."""
    a, b = np.deg2rad(lon), np.deg2rad(lat)
    return np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)


def axis_angle(lon: FloatArray, lat: FloatArray) -> FloatArray:
    """Angle from east to the direction of the rows of a grid (Y, X) [deg], counter-clockwise, (Y, X) [rad].

    By differences of second order of the positions along a row. UnreadError for a row of one node.
    """
    nodes = lon.shape[1]
    if nodes < 2:
        raise UnreadError("the grid has one node in a row, which has no direction")
    step = np.gradient(on_unit_sphere(lon, lat), axis=1, edge_order=2 if nodes > 2 else 1)
    a, b = np.deg2rad(lon), np.deg2rad(lat)
    east = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=-1)
    north = np.stack([-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)], axis=-1)
    return np.asarray(np.arctan2((step * north).sum(axis=-1), (step * east).sum(axis=-1)), float)
