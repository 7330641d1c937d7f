"""Regular lattices: their nodes, values between these, bilinear, and slopes."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from wind_laws.types import FloatArray, IntArray

FEWEST_CELLS, MAX_CELLS = 20, 500  # of a wind: along the longer side of the bounds, of the lattice
FEWEST_MODE_CELLS, MAX_MODE_CELLS = 10, 24  # of the lattice of the modes, along the longer side of the bounds


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


class NodeLattice(NamedTuple):
    """Regular lattice: node (i, j) lies at ``origin + spacing * (i, j)`` [m]; ``shape`` is (NX, NY)."""

    origin: FloatArray
    spacing: float
    shape: tuple[int, int]

    def nodes(self) -> FloatArray:
        """Positions of all nodes, shape (NX * NY, 2) [m]; y varies fastest."""
        steps = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1)
        return self.origin + self.spacing * steps.reshape(-1, 2)

    @staticmethod
    def centred(bounds: FloatArray, spacing: float, cells: IntArray) -> NodeLattice:
        """The lattice of ``cells`` (2,), ``spacing`` [m] wide, around the middle of ``bounds`` (2, 2) [m]."""
        origin = bounds.mean(axis=0) - 0.5 * spacing * cells
        return NodeLattice(origin, spacing, (int(cells[0]) + 1, int(cells[1]) + 1))


def wind_lattice(bounds: FloatArray, spacing: float, padding: float) -> NodeLattice:
    """The lattice of the wind over ``bounds`` (2, 2) and ``padding`` around them [m].

    The padding is at most the longer side of the bounds. The spacing is ``spacing`` [m], finer for small
    bounds and coarser for large ones.
    """
    extent = bounds[1] - bounds[0]
    side = float(np.max(extent))
    padding = min(padding, side)
    spacing = max(min(spacing, side / FEWEST_CELLS), (side + 2 * padding) / MAX_CELLS)
    cells = np.maximum(1, np.ceil((extent + 2 * padding) / spacing - 1e-9)).astype(int)
    return NodeLattice.centred(bounds, spacing, cells)


def mode_lattice(bounds: FloatArray, spacing: float) -> NodeLattice:
    """The coarser lattice of the modes, which covers ``bounds`` (2, 2) and one cell around them [m].

    Variance that this lattice does not resolve is added to the white variance.
    """
    extent = bounds[1] - bounds[0]
    side = float(extent.max())
    spacing = min(max(spacing, side / MAX_MODE_CELLS), side / FEWEST_MODE_CELLS)
    return NodeLattice.centred(bounds, spacing, np.ceil(extent / spacing - 1e-9).astype(int) + 2)
