"""Collision risk of one step of full fidelity (DESIGN 4.5)."""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import Faces
from pareto_ltl.kernels.gaussian import tail, variance_along
from pareto_ltl.kernels.jit import kernel
from pareto_ltl.support.arrays import Float32Array, Int32Array

# Standard deviations beyond which an obstacle, at below 3e-7, is not looked at (growth runs a sixth
# faster than with seven). R of a finished path leaves nothing out.
FAR = 5.0


@kernel
def pass_by(
    obstacles: Faces,
    x0: float, y0: float, xx0: float, xy0: float, yy0: float,
    x1: float, y1: float, xx1: float, xy1: float, yy1: float,
    last_faces: Int32Array, last_runs: Float32Array, before: int,
    faces: Int32Array, runs: Float32Array, now: int,
) -> tuple[float, float]:  # fmt: skip
    """Risk at the end of a step from (x0, y0) to (x1, y1), and what the path's risk grows by.

    Both ends must lie beyond one face of every obstacle; the steps in a row that have the same face are a
    run, and a run costs min(Σ p, 2 Φ(-least gap / largest σ)) (R of DESIGN 4.5). Of the faces that serve
    the step the one that adds least is taken. Row ``now`` of ``faces`` (., m) and ``runs`` (., m, 3) = (Σ
    p, least gap, largest variance) gets them; rows ``before`` are the last step's, with face -1 for none.
    The first figure is Σ_j p_tj <= epsilon, inf where an obstacle has no common face.
    """
    ptr, normal, offset = obstacles.ptr, obstacles.normal, obstacles.offset
    far0, far1 = FAR * widest_of(xx0, xy0, yy0), FAR * widest_of(xx1, xy1, yy1)
    at_step, grows = 0.0, 0.0
    for j in range(len(ptr) - 1):
        last = last_faces[before, j]
        if last >= 0:
            total, least = float(last_runs[before, j, 0]), float(last_runs[before, j, 1])
            widest = float(last_runs[before, j, 2])
            ahead = normal[last, 0] * x1 + normal[last, 1] * y1 - offset[last]
            if ahead >= far1 and ahead >= 0.0:
                faces[now, j] = last
                runs[now, j, 0], runs[now, j, 1], runs[now, j, 2] = total, least, widest
                continue
        best, own, chosen = math.inf, 0.0, -1
        for k in range(ptr[j], ptr[j + 1]):
            nx, ny = normal[k, 0], normal[k, 1]
            here, there = nx * x0 + ny * y0 - offset[k], nx * x1 + ny * y1 - offset[k]
            if here < 0.0 or there < 0.0:
                continue
            p, v = 0.0, 0.0
            if there < far1 or far1 <= 0.0:
                v = variance_along(nx, ny, xx1, xy1, yy1)
                p = tail(there, v)
            if last >= 0 and k == last:
                s, g, w = total + p, min(least, there) if v > 0.0 else least, max(widest, v)
                cost = run_cost(s, g, w) - run_cost(total, least, widest)
            else:
                s, g, w = p, there if v > 0.0 else math.inf, v
                if last >= 0 and here < far0:
                    u = variance_along(nx, ny, xx0, xy0, yy0)
                    s, g, w = s + tail(here, u), min(g, here), max(w, u)
                cost = run_cost(s, g, w)
            if cost < best:
                best, own, chosen = cost, p, k
                runs[now, j, 0], runs[now, j, 1], runs[now, j, 2] = s, g, w
                if cost == 0.0:
                    break
        if chosen < 0:
            return math.inf, math.inf
        faces[now, j] = chosen
        at_step += own
        grows += best
    return at_step, grows


@kernel
def widest_of(xx: float, xy: float, yy: float) -> float:
    """An upper bound of the largest standard deviation (Gershgorin)."""
    return math.sqrt(max(xx, yy) + abs(xy))


@kernel
def run_cost(total: float, least: float, widest: float) -> float:
    """min(Σ p, 2 Φ(-least / √widest)) of one run."""
    if total <= 0.0 or widest <= 0.0:
        return total
    return min(total, 2.0 * tail(least, widest))
