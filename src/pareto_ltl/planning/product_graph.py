"""The high-level planner's map: product of cells and automaton (Section IV-B).

Product states are numbered z = q * C + r. An edge leads from (q, r) through a door to
(delta(q, label(r')), r'), or stays in r where reading its label again changes q. States from which the
mission cannot be completed are left out of every edge.
"""

from __future__ import annotations

import numpy as np

from pareto_ltl.kernels.data import Logic
from pareto_ltl.kernels.dijkstra import Product
from pareto_ltl.kernels.growth import Fans
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.world.cells import Decomposition, moments


def product_graph(decomposition: Decomposition, logic: Logic, bounds: FloatArray) -> Product:
    """The product graph as arrays for Dijkstra."""
    cells, states = len(decomposition.cells), len(logic.distance)
    shapes = [moments(cell) for cell in decomposition.cells]
    area, centre = np.array([a for a, _ in shapes]), np.array([c for _, c in shapes])
    diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
    rows = _product_edges(decomposition.doors, logic, cells)
    tail, head = rows[:, 0], rows[:, 1]
    metres = np.linalg.norm(centre[tail % cells] - centre[head % cells], axis=1) / diagonal
    metres = np.maximum(metres, 1e-3)  # reading a label again costs a step as well
    return Product(
        ptr=np.searchsorted(tail, np.arange(states * cells + 1)).astype(np.int64),
        head=head,
        metres=metres,
        volume=np.tile(area / area.sum(), states),
        urgency=np.repeat(1.0 / (np.where(np.isinf(logic.distance), 1e6, logic.distance) + 1.0), cells),
        goal=np.repeat(logic.distance == 0.0, cells),
    )


def _product_edges(doors: IntArray, logic: Logic, cells: int) -> IntArray:
    """Rows (z, z') sorted by z."""
    both = np.vstack(
        [doors.reshape(-1, 2), doors.reshape(-1, 2)[:, ::-1], np.repeat(np.arange(cells), 2).reshape(-1, 2)]
    )
    found = []
    for q in np.flatnonzero(np.isfinite(logic.distance)):
        then = logic.delta[q, both[:, 1]]
        keep = np.isfinite(logic.distance[then]) & ((both[:, 0] != both[:, 1]) | (then != q))
        found.append(np.column_stack([q * cells + both[keep, 0], then[keep] * cells + both[keep, 1]]))
    rows = np.vstack(found) if found else np.empty((0, 2), np.int64)
    return rows[np.lexsort((rows[:, 1], rows[:, 0]))]


def cell_fans(decomposition: Decomposition) -> Fans:
    """Cells as fans of triangles, for uniform samples."""
    corners, shares, ptr = [], [], [0]
    for cell in decomposition.cells:
        triangles = np.stack([np.repeat(cell[:1], len(cell) - 2, axis=0), cell[1:-1], cell[2:]], axis=1)
        ab, ac = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        area = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
        corners.append(triangles)
        shares.append(np.cumsum(area) / area.sum())
        ptr.append(ptr[-1] + len(triangles))
    return Fans(np.array(ptr, np.int64), np.vstack(corners), np.concatenate(shares))
