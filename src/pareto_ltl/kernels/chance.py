"""The chance constraint of each segment of a path, as a penalty of the failure that is lowered.

Both ends of a segment shall keep its closest supporting lines so far away that their risks are at most
epsilon together. What an end lacks, in standard deviations of one line, is penalised by its square. Lines and
standard deviations are held fixed in a solve. Inside an obstacle the risk goes on growing, so that the
penalty leads out of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pareto_ltl.kernels.path import Flight
from pareto_ltl.support.arrays import FloatArray
from plane_kernels.gaussian import tail, variance_along
from plane_kernels.supporting_lines import SegmentLines, segment_lines
from plane_kernels.types import BoolArray, Corners, Cov
from plane_logic.margin import Slope
from typed_kernels.jit import kernel

RESERVE = 0.05  # standard deviations that are kept beyond epsilon: a penalty leaves a little to lack
DEEP = 0.45  # risks above are counted in proportion
LARGEST = 0.5  # deviations that count in the curvature of several lines: more would make solves timid
LEAST_RISK = 1e-12
STEPS = 8  # of Newton's method for a quantile


class Chance(NamedTuple):
    """The largest risk ``limit`` of a segment, inf for none, and what it is the risk of.

    ``stiff``: the penalty of a lacking standard deviation [failures]. ``polygons`` to avoid, ``requested``
    (T, m): which of them each segment avoids; ``least`` [m²] is added to every variance; ``lines`` and
    ``side`` (K, 4) are scratch.
    """

    stiff: float
    polygons: Corners
    requested: BoolArray
    limit: float
    least: float
    lines: SegmentLines
    side: FloatArray


@kernel
def density(z: float) -> float:
    """The density of the normal law at ``z``."""
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


@kernel
def deviations_for(risk: float) -> float:
    """z with 1 - Φ(z) = ``risk``, by Newton's method; above ``DEEP`` it falls in proportion to the risk."""
    z, exact = 0.0, min(max(risk, LEAST_RISK), DEEP)
    for _ in range(STEPS):
        z += (tail(z, 1.0) - exact) / density(z)
    return z - max(risk - DEEP, 0.0) / density(z)


@kernel
def risk_beyond(z: float) -> float:
    """1 - Φ(z), continued by its tangent for z < 0: the risk of a line with a position on its wrong side."""
    return tail(z, 1.0) if z >= 0.0 else 0.5 - z * density(0.0)


@kernel
def add_breach(chance: Chance, flight: Flight, slope: Slope) -> float:
    """½ ``stiff`` Σ s², s the standard deviations that ends of segments lack; ``slope`` is added to.

    Eq. (M82) of docs/mathematics_methods.md.
    """
    if chance.limit == math.inf:
        return 0.0
    segment_lines(chance.polygons, chance.requested, flight.x, flight.cov, chance.least, 0.0, chance.lines)
    line, owner, risk = chance.lines.line, chance.lines.owner, chance.lines.risk
    wanted, total = deviations_for(chance.limit) + RESERVE, 0.0
    for t in range(len(risk)):
        if 2.0 * risk[t] < chance.limit:
            continue
        count, elsewhere = 0, risk[t]
        while count < owner.shape[1] and owner[t, count] >= 0:
            elsewhere -= tail(line[t, count, 3], 1.0)
            count += 1
        for k in range(t, t + 2):
            total += add_end(chance, line[t, :count], max(elsewhere, 0.0), wanted, flight, k, slope)
    return total


@kernel
def add_end(
    chance: Chance, lines: FloatArray, elsewhere: float, wanted: float, flight: Flight, k: int, slope: Slope
) -> float:
    """What position ``k`` lacks of the ``wanted`` deviations from ``lines`` (K, 4), as a penalty.

    With the risk R(z) of its lines together, s = wanted - Q⁻¹(R). ``elsewhere``: the risk of other lines.
    """
    x, cov, side, together = flight.x, flight.cov, chance.side, elsewhere
    for j in range(len(lines)):
        east, north = lines[j, 0], lines[j, 1]
        sd = math.sqrt(variance_along(east, north, Cov(cov[k, 0], cov[k, 1], cov[k, 2])) + chance.least)
        z = (east * x[k, 0] + north * x[k, 1] - lines[j, 2]) / sd
        together += risk_beyond(z)
        side[j, 0], side[j, 1], side[j, 2], side[j, 3] = east / sd, north / sd, density(max(z, 0.0)), z
    all_of = deviations_for(together)
    lacking = wanted - all_of
    if lacking <= 0.0:
        return 0.0
    scale, east, north = density(max(all_of, deviations_for(DEEP))), 0.0, 0.0
    for j in range(len(lines)):
        weight, z = side[j, 2] / scale, side[j, 3]
        east -= weight * side[j, 0]
        north -= weight * side[j, 1]
        if len(lines) > 1:  # the risk of one line alone has no curvature in its deviations
            curve = chance.stiff * min(lacking, LARGEST) * weight * max(z, 0.0)
            add_square(slope, k, curve, side[j, 0], side[j, 1])
    slope.gradient[k, 0] += chance.stiff * lacking * east
    slope.gradient[k, 1] += chance.stiff * lacking * north
    add_square(slope, k, chance.stiff, east, north)
    return 0.5 * chance.stiff * lacking * lacking


@kernel
def add_square(slope: Slope, k: int, curve: float, east: float, north: float) -> None:
    """Add ``curve`` v v' to the Hessian of position ``k``, v = (``east``, ``north``)."""
    slope.hessian[k, 0] += curve * east * east
    slope.hessian[k, 1] += curve * east * north
    slope.hessian[k, 2] += curve * north * north
