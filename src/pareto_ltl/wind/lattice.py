"""Values on a regular lattice between its nodes, bilinear, and their slopes."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pareto_ltl.support.arrays import FloatArray


class OnLattice(Protocol):
    """What lies on a lattice: its south-west node ``origin`` (2,) and the distance of its nodes, both [m]."""

    @property
    def origin(self) -> FloatArray:
        """South-west node (2,) [m]."""

    @property
    def spacing(self) -> float:
        """Distance of neighbours [m]."""


def lattice_values(lattice: OnLattice, table: FloatArray, places: FloatArray) -> FloatArray:
    """``table`` (NX, NY, ...) on ``lattice`` at ``places`` (N, 2) [m], bilinear, (N, ...).

    Constant beyond the lattice.
    """
    (c00, c01, c10, c11), fx, fy = _squares(lattice, table, places)
    near = (1 - fy) * c00 + fy * c01
    far = (1 - fy) * c10 + fy * c11
    return np.asarray((1 - fx) * near + fx * far, float)


def lattice_slopes(lattice: OnLattice, table: FloatArray, places: FloatArray) -> FloatArray:
    """Derivatives of :func:`lattice_values` towards x and y, (N, ..., 2); 0 beyond the lattice."""
    (c00, c01, c10, c11), fx, fy = _squares(lattice, table, places)
    slopes = [(1 - fy) * (c10 - c00) + fy * (c11 - c01), (1 - fx) * (c01 - c00) + fx * (c11 - c10)]
    g = (places - lattice.origin) / lattice.spacing
    inside = (g >= 0.0) & (g <= np.array(table.shape[:2]) - 1.0)
    within = inside.reshape(len(places), *[1] * (table.ndim - 2), 2)
    return np.asarray(np.stack(slopes, axis=-1) * within / lattice.spacing, float)


def _squares(
    lattice: OnLattice, table: FloatArray, places: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray, FloatArray]:
    """The values (N, ...) at the corners of the square of each place, and its shares of the sides."""
    at = np.clip((places - lattice.origin) / lattice.spacing, 0.0, np.array(table.shape[:2]) - 1.0)
    low = np.minimum(at.astype(int), np.array(table.shape[:2]) - 2)
    i, j = low.T
    fx, fy = (share.reshape(-1, *[1] * (table.ndim - 2)) for share in (at - low).T)
    return (table[i, j], table[i, j + 1], table[i + 1, j], table[i + 1, j + 1]), fx, fy
