"""Collision risk of one step of full fidelity (DESIGN 4.5)."""

from __future__ import annotations

import math

from pareto_ltl.arrays import IntArray
from pareto_ltl.kernels.gaussian import tail, variance_along
from pareto_ltl.kernels.jit import kernel
from pareto_ltl.kernels.tables import Faces

FAR = 7.0  # standard deviations; beyond them an obstacle's probability is below 2e-12


@kernel
def pass_by(
    obstacles: Faces,
    x0: float, y0: float, xx0: float, xy0: float, yy0: float,
    x1: float, y1: float, xx1: float, xy1: float, yy1: float,
    last_faces: IntArray, before: int, faces: IntArray, now: int,
) -> tuple[float, float]:  # fmt: skip
    """Risk at the end of a step from (x0, y0) to (x1, y1), and what the path's risk grows by.

    Both ends must lie beyond one face of every obstacle. Of those faces the one that adds least to R is
    taken: P(x1 not beyond it), and where the step before had another face (row ``before`` of
    ``last_faces``, -1 for none), P(x0 not beyond it) too, since runs overlap where the face changes. Row
    ``now`` of ``faces`` gets them; the first figure is Σ_j p_tj <= epsilon, inf where an obstacle has no
    common face.
    """
    ptr, normal, offset = obstacles.ptr, obstacles.normal, obstacles.offset
    far0, far1 = FAR * math.sqrt(xx0 + yy0), FAR * math.sqrt(xx1 + yy1)
    at_step, grows = 0.0, 0.0
    for j in range(len(ptr) - 1):
        last = last_faces[before, j]
        if last >= 0:
            ahead = normal[last, 0] * x1 + normal[last, 1] * y1 - offset[last]
            if ahead >= far1 and ahead >= 0.0:
                faces[now, j] = last
                continue
        best, own, chosen = math.inf, 0.0, -1
        for k in range(ptr[j], ptr[j + 1]):
            nx, ny = normal[k, 0], normal[k, 1]
            here, there = nx * x0 + ny * y0 - offset[k], nx * x1 + ny * y1 - offset[k]
            if here < 0.0 or there < 0.0:
                continue
            p = 0.0 if there >= far1 and far1 > 0.0 else tail(there, variance_along(nx, ny, xx1, xy1, yy1))
            cost = p
            if last >= 0 and k != last and here < far0:
                cost += tail(here, variance_along(nx, ny, xx0, xy0, yy0))
            if cost < best:
                best, own, chosen = cost, p, k
                if cost == 0.0:
                    break
        if chosen < 0:
            return math.inf, math.inf
        faces[now, j] = chosen
        at_step += own
        grows += best
    return at_step, grows
