"""The bound f_o on the mission risk, and the probabilities of the letters of one step.

The ordered bound V (:mod:`plane_logic.ordered_bound`) combines the steps.
"""

from __future__ import annotations

import math

import numpy as np

from plane_kernels.gaussian import inside, region_missed, tail, variance_along
from plane_kernels.geometry import locate_cell
from plane_kernels.polygon import polygon_probability
from plane_kernels.types import Cov, FloatArray, Gaussian, IntArray, Point
from plane_logic.letters import epoch_at
from plane_logic.types import Ordered, Theorem2
from typed_kernels.jit import allocating, kernel

REMOTE = 7.35  # standard deviations to one face, with probability 1e-13: the exact value is below rounding
CERTAIN = 8.0  # standard deviations; beyond this distance probabilities are below 1e-15

# --- the bound f_o ------------------------------------------------------------------------------


@kernel
def visit_risk(bound: Theorem2, e: int, atom: int, cell: int, here: Gaussian, before: float) -> float:
    """f_o^i (Theorem 1) after a step into ``cell`` in epoch ``e``: the least risk over all visits so far.

    ``before`` and the result are -1 if there is no visit yet.

    Eq. (M36) of docs/mathematics.md.
    """
    if not bound.holds[e, cell, atom]:
        return before
    now = region_missed(bound.faces, bound.atom, atom, here)
    return now if before < 0.0 else min(before, now)


@allocating
def theorem2_risks(bound: Theorem2, x: FloatArray, cov: FloatArray, cell: IntArray) -> FloatArray:
    """f_o^i of every proposition along a path, (P,); 0 for a proposition that is never visited.

    ``x`` (T+1, 2) [m], ``cov`` (T+1, 3) = (xx, xy, yy) [m²], ``cell`` (T+1,).

    Eq. (M36) of docs/mathematics.md.
    """
    risks = np.empty(bound.holds.shape[2])
    for atom in range(len(risks)):
        risk = -1.0
        for t in range(len(x)):
            here = Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))
            risk = visit_risk(bound, epoch_at(bound.logic.epoch, t), atom, cell[t], here, risk)
        risks[atom] = max(risk, 0.0)
    return risks


# --- probabilities of the letters of a step -------------------------------------------------


@kernel
def label_probability(bound: Ordered, part: int, here: Gaussian, width: float) -> float:
    """P(position in labelled cell ``part``); ``width`` [m] is at least the largest standard deviation."""
    labelled = bound.labelled
    dx, dy = here.mean.x - labelled.middle[part, 0], here.mean.y - labelled.middle[part, 1]
    reach = labelled.radius[part] + CERTAIN * width
    if dx * dx + dy * dy > reach * reach:
        return 0.0
    faces, cell = bound.cells.faces, labelled.cell[part]
    for k in range(faces.ptr[cell], faces.ptr[cell + 1]):
        nx, ny = faces.normal[k, 0], faces.normal[k, 1]
        gap = nx * here.mean.x + ny * here.mean.y - faces.offset[k]
        if gap > 0.0 and gap * gap > REMOTE * REMOTE * variance_along(nx, ny, here.cov):
            return inside(faces, cell, here)
    return polygon_probability(labelled, part, here)


@kernel
def read_labels(bound: Ordered, here: Gaussian, seen: FloatArray) -> None:
    """Fill ``seen`` (L + 1,): P(position in each labelled cell), and last P(no label)."""
    cells = len(bound.labelled.cell)
    rest = 1.0
    known = here.cov.xx <= 0.0 or here.cov.yy <= 0.0
    cell = locate_cell(bound.cells, here.mean) if known else -1
    width = math.sqrt(here.cov.xx + here.cov.yy)
    for part in range(cells):
        if known:
            seen[part] = 1.0 if bound.labelled.cell[part] == cell else 0.0
        else:
            seen[part] = label_probability(bound, part, here, width)
        rest -= seen[part]
    seen[cells] = min(max(rest, 0.0), 1.0)


@kernel
def read_place(bound: Ordered, here: Gaussian, met: FloatArray) -> None:
    """Fill ``met`` (H,) at the start: upper bounds on P(position in each hazard)."""
    hazards = bound.logic.hazards
    for h in range(len(hazards.cell)):
        met[h] = inside(bound.cells.faces, hazards.cell[h], here)


@kernel
def read_way(bound: Ordered, before: Gaussian, here: Gaussian, met: FloatArray) -> None:
    """Fill ``met`` (H,): upper bounds on P(segment between two positions meets each hazard)."""
    for h in range(len(met)):
        met[h] = meeting_bound(bound, h, before, here)


@kernel
def meeting_bound(bound: Ordered, h: int, before: Gaussian, here: Gaussian) -> float:
    """P(segment meets hazard h) ≤ min over lines of P(before not beyond) + P(here not beyond).

    A segment does not meet the polygon if both its ends are beyond one line that does not cross the polygon.
    The lines are the lines of its faces, and the parallel to the line through both means that touches the
    polygon at its nearest corner.

    Eq. (M38) of docs/mathematics.md.
    """
    hazards, normal, offset = bound.logic.hazards, bound.cells.faces.normal, bound.cells.faces.offset
    (ax, ay), (bx, by) = before.mean, here.mean
    dx, dy = bx - ax, by - ay
    length = math.sqrt(dx * dx + dy * dy)
    spread = max(before.cov.xx + before.cov.yy, here.cov.xx + here.cov.yy)
    reach = hazards.radius[h] + 0.5 * length + CERTAIN * math.sqrt(spread)
    mx, my = hazards.middle[h, 0] - 0.5 * (ax + bx), hazards.middle[h, 1] - 0.5 * (ay + by)
    if mx * mx + my * my > reach * reach:
        return 0.0
    cell, best = hazards.cell[h], 1.0
    for k in range(bound.cells.faces.ptr[cell], bound.cells.faces.ptr[cell + 1]):
        nx, ny = normal[k, 0], normal[k, 1]
        first = tail(nx * ax + ny * ay - offset[k], variance_along(nx, ny, before.cov))
        best = min(best, first + tail(nx * bx + ny * by - offset[k], variance_along(nx, ny, here.cov)))
    if length > 0.0:
        nx, ny = -dy / length, dx / length
        low, high = math.inf, -math.inf
        for k in range(hazards.ptr[h], hazards.ptr[h + 1]):
            at = nx * (hazards.corner[k, 0] - ax) + ny * (hazards.corner[k, 1] - ay)
            low, high = min(low, at), max(high, at)
        gap = max(low, -high)
        if gap >= 0.0:
            first = tail(gap, variance_along(nx, ny, before.cov))
            best = min(best, first + tail(gap, variance_along(nx, ny, here.cov)))
    return best
