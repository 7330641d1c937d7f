"""Solver of a second-order cone programme on a chain of points: a primal-dual interior-point method.

It moves the points of a path whose steps p_t have limits, and whose length has one. Variables are the
displacements d_t of the points, t = 0 ... T, d_0 = 0, and the lengths l_t of the legs, t = 0 ... T - 1.
With p_t = p̄_t + C d_{t+1} - E_t d_t and v_t = v̄_t + d_{t+1} - d_t:

    minimise    Σ g_t' d_t + ½ d_t' H_t d_t
    subject to  ‖p_t‖ ≤ cap_t,    û_t' p_t ≥ floor_t,    ‖v_t‖ ≤ l_t,    Σ l_t ≤ longest,
                low_t ≤ d_t ≤ high_t

Row t of a table of points holds d_t and l_t; cone 2 t holds ‖p_t‖, cone 2 t + 1 holds ‖v_t‖. The
method uses Nesterov and Todd's scaling and Mehrotra's corrector, as in Vandenberghe's "The CVXOPT linear and
quadratic cone program solvers" (2010). The notation follows this text: slacks s, multipliers z, λ = W z =
W⁻¹ s; "room" is h - G x. The matrix P + G' W⁻² G is block tridiagonal except for the constraint on the sum of
lengths. A general solver takes ten times as long, and holds the interpreter's lock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from plane_kernels.block_matrix import add_block, eliminate, substitute
from plane_kernels.types import FloatArray
from typed_kernels.jit import kernel

MOST = 30  # largest number of iterations
WITHIN = 1e-5  # tolerance of the constraints
GAP = 1e-6  # tolerance of the mean product of slacks and multipliers
LEVEL = 1e-4  # tolerance of the gradient of the Lagrangian
FIRST = 0.1  # smallest initial slack, and initial product of slack and multiplier
KEPT = 0.99  # share of the step to the boundary of the cones that is taken

S, Z, ROOM, DS, DZ, AIM, PULL, W, SCALED = range(9)  # tables of cones; lines have the first seven
X, DX, TOTAL = range(3)  # tables of points


class StepModel(NamedTuple):
    """Data of one programme, in units in which the longest step is about 1: tolerances are absolute.

    Attributes
    ----------
    gradient (T+1, 2), hessian (T+1, 3) : float
        g_t, and H_t as (xx, xy, yy).
    ahead (2, 2), behind (T, 2, 2) : float
        C and E_t.
    heading : (T, 2) float
        û_t; no rows if steps have no floor.
    cone : (2 T, 3) float
        Rows (cap_t, p̄_t) and (0, v̄_t).
    line : (L,) float
        For t = 1 ... T high_t and -low_t (east, north); then longest; then û_t' p̄_t - floor_t.
    """

    gradient: FloatArray
    hessian: FloatArray
    ahead: FloatArray
    behind: FloatArray
    heading: FloatArray
    cone: FloatArray
    line: FloatArray


class Work(NamedTuple):
    """Memory of the solver: tables of points, of cone and linear constraints, and a factorisation.

    ``points`` (3, T+1, 3): the current point X, its change DX, and TOTAL, the solution for the constraint on
    the sum of lengths. ``cones`` (9, 2 T, 3) and ``lines`` (7, L): slacks S, multipliers Z, ROOM = h - G x,
    changes DS and DZ, target AIM of the products, multipliers PULL for an unchanged point; for cones also w̄
    (W) and λ (SCALED). ``eta`` (2 T,): η of each cone. ``pivot`` (T+1, 3): inverses of the pivots; ``below``
    (T, 2, 2): the blocks below them.
    """

    points: FloatArray
    cones: FloatArray
    lines: FloatArray
    eta: FloatArray
    pivot: FloatArray
    below: FloatArray


# --- one cone -----------------------------------------------------------------------------------


@kernel
def determinant(u: FloatArray) -> float:
    """u_0² - u_1² - u_2²."""
    size = math.sqrt(u[1] * u[1] + u[2] * u[2])
    return float((u[0] - size) * (u[0] + size))


@kernel
def stretched(w: FloatArray, eta: float, u: FloatArray, sign: float, out: FloatArray) -> None:
    """Fill ``out`` with W u for ``sign`` 1 and η, or with W⁻¹ u for ``sign`` -1 and 1 / η."""
    a, b, c = w[0], sign * w[1], sign * w[2]
    along = b * u[1] + c * u[2]
    more = u[0] + along / (1.0 + a)
    out[0], out[1], out[2] = eta * (a * u[0] + along), eta * (u[1] + b * more), eta * (u[2] + c * more)


@kernel
def squared(w: FloatArray, eta: float, u: FloatArray, out: FloatArray) -> None:
    """Fill ``out`` with W⁻² u = (2 a (a' u) - J u) / η², a = (w_0, -w_1, -w_2)."""
    one = 1.0 / (eta * eta)
    along = 2.0 * (w[0] * u[0] - w[1] * u[1] - w[2] * u[2])
    out[0] = one * (along * w[0] - u[0])
    out[1], out[2] = one * (u[1] - along * w[1]), one * (u[2] - along * w[2])


@kernel
def border(u: FloatArray, du: FloatArray) -> float:
    """The largest share of ``du`` that can be added to ``u`` within its cone; inf if there is no limit."""
    a = du[0] * du[0] - du[1] * du[1] - du[2] * du[2]
    b = u[0] * du[0] - u[1] * du[1] - u[2] * du[2]
    c = determinant(u)
    square = b * b - a * c
    below = math.sqrt(square) - b if square >= 0.0 else 0.0
    return c / below if below > 0.0 else math.inf


# --- constraints ----------------------------------------------------------------------------------


@kernel
def fill_room(model: StepModel, x: FloatArray, share: float, cone: FloatArray, line: FloatArray) -> None:
    """Fill ``cone`` and ``line`` with ``share`` h - G x; ``share`` is 0 or 1."""
    C, E, T, total = model.ahead, model.behind, len(model.behind), 0.0
    for t in range(T):
        ax, ay, bx, by = x[t, 0], x[t, 1], x[t + 1, 0], x[t + 1, 1]
        px = C[0, 0] * bx + C[0, 1] * by - E[t, 0, 0] * ax - E[t, 0, 1] * ay
        py = C[1, 0] * bx + C[1, 1] * by - E[t, 1, 0] * ax - E[t, 1, 1] * ay
        cone[2 * t, 0], cone[2 * t, 1], cone[2 * t, 2] = 0.0, px, py
        cone[2 * t + 1, 0], cone[2 * t + 1, 1], cone[2 * t + 1, 2] = x[t, 2], bx - ax, by - ay
        line[4 * t], line[4 * t + 1], line[4 * t + 2], line[4 * t + 3] = -bx, -by, bx, by
        total += x[t, 2]
        if len(model.heading) > 0:
            line[4 * T + 1 + t] = model.heading[t, 0] * px + model.heading[t, 1] * py
    line[4 * T] = -total
    if share > 0.0:
        for k in range(2 * T):
            for c in range(3):
                cone[k, c] += model.cone[k, c]
        for j in range(len(line)):
            line[j] += model.line[j]


@kernel
def fill_slope(model: StepModel, x: FloatArray, cone: FloatArray, line: FloatArray, out: FloatArray) -> None:
    """Fill ``out`` (T+1, 3) with -(P x + g) - G' (``cone``, ``line``)."""
    C, E, T = model.ahead, model.behind, len(model.behind)
    for t in range(T + 1):
        xx, xy, yy = model.hessian[t, 0], model.hessian[t, 1], model.hessian[t, 2]
        out[t, 0] = -model.gradient[t, 0] - xx * x[t, 0] - xy * x[t, 1]
        out[t, 1] = -model.gradient[t, 1] - xy * x[t, 0] - yy * x[t, 1]
    for t in range(T):
        ex, ey, vx, vy = cone[2 * t, 1], cone[2 * t, 2], cone[2 * t + 1, 1], cone[2 * t + 1, 2]
        if len(model.heading) > 0:
            ex += line[4 * T + 1 + t] * model.heading[t, 0]
            ey += line[4 * T + 1 + t] * model.heading[t, 1]
        out[t + 1, 0] += C[0, 0] * ex + C[1, 0] * ey + vx - line[4 * t] + line[4 * t + 2]
        out[t + 1, 1] += C[0, 1] * ex + C[1, 1] * ey + vy - line[4 * t + 1] + line[4 * t + 3]
        out[t, 0] -= E[t, 0, 0] * ex + E[t, 1, 0] * ey + vx
        out[t, 1] -= E[t, 0, 1] * ex + E[t, 1, 1] * ey + vy
        out[t, 2] = cone[2 * t + 1, 0] - line[4 * T]
    out[0, 0] = out[0, 1] = out[T, 2] = 0.0


# --- the matrix -----------------------------------------------------------------------------------


@kernel
def scale(cones: FloatArray, eta: FloatArray) -> None:
    """Compute the Nesterov-Todd scaling of all cones: W, ``eta`` and SCALED."""
    for k in range(len(eta)):
        s, z, w = cones[S, k], cones[Z, k], cones[W, k]
        ds, dz = math.sqrt(determinant(s)), math.sqrt(determinant(z))
        product = s[0] * z[0] + s[1] * z[1] + s[2] * z[2]
        half = 1.0 / (2.0 * math.sqrt(0.5 * (1.0 + product / (ds * dz))))
        w[0] = half * (s[0] / ds + z[0] / dz)
        w[1], w[2] = half * (s[1] / ds - z[1] / dz), half * (s[2] / ds - z[2] / dz)
        eta[k] = math.sqrt(ds / dz)
        stretched(w, eta[k], z, 1.0, cones[SCALED, k])


@kernel
def assemble(model: StepModel, work: Work) -> None:
    """Fill the blocks of P + G' W⁻² G for d_t; the lengths l_t are eliminated leg by leg."""
    pivot, below, w, eta = work.pivot, work.below, work.cones[W], work.eta
    C, E, s, z, T = model.ahead, model.behind, work.lines[S], work.lines[Z], len(model.behind)
    for t in range(T + 1):
        for k in range(3):
            pivot[t, k] = model.hessian[t, k]
    for t in range(T):
        k, one = 2 * t, 1.0 / (eta[2 * t] * eta[2 * t])
        xx, xy = one * (1.0 + 2.0 * w[k, 1] * w[k, 1]), one * 2.0 * w[k, 1] * w[k, 2]
        yy = one * (1.0 + 2.0 * w[k, 2] * w[k, 2])
        if len(model.heading) > 0:
            row = 4 * T + 1 + t
            weight, hx, hy = z[row] / s[row], model.heading[t, 0], model.heading[t, 1]
            xx, xy, yy = xx + weight * hx * hx, xy + weight * hx * hy, yy + weight * hy * hy
        add_block(pivot, t + 1, C, (xx, xy, yy))
        add_block(pivot, t, E[t], (xx, xy, yy))
        k, one = 2 * t + 1, 1.0 / (eta[2 * t + 1] * eta[2 * t + 1])
        bend = 2.0 / (2.0 * w[k, 0] * w[k, 0] - 1.0)
        nxx, nxy = one * (1.0 - bend * w[k, 1] * w[k, 1]), -one * bend * w[k, 1] * w[k, 2]
        nyy = one * (1.0 - bend * w[k, 2] * w[k, 2])
        for j in range(t, t + 2):
            pivot[j, 0] += nxx
            pivot[j, 1] += nxy
            pivot[j, 2] += nyy
        for j in range(2):
            mx, my = xx * E[t, 0, j] + xy * E[t, 1, j], xy * E[t, 0, j] + yy * E[t, 1, j]
            below[t, 0, j] = -(C[0, 0] * mx + C[1, 0] * my)
            below[t, 1, j] = -(C[0, 1] * mx + C[1, 1] * my)
        below[t, 0, 0] -= nxx
        below[t, 0, 1] -= nxy
        below[t, 1, 0] -= nxy
        below[t, 1, 1] -= nyy
        for r in range(2):
            up, down = 4 * t + r, 4 * t + 2 + r
            pivot[t + 1, 2 * r] += z[up] / s[up] + z[down] / s[down]
    pivot[0, 0], pivot[0, 1], pivot[0, 2] = 1.0, 0.0, 1.0
    below[0, 0, 0] = below[0, 0, 1] = below[0, 1, 0] = below[0, 1, 1] = 0.0


@kernel
def without_total(work: Work, b: FloatArray) -> None:
    """Solve in place for ``b`` (T+1, 3), without the constraint on the sum of lengths."""
    w, eta, T = work.cones[W], work.eta, len(b) - 1
    for t in range(T):
        k = 2 * t + 1
        share = -2.0 * w[k, 0] / (2.0 * w[k, 0] * w[k, 0] - 1.0) * b[t, 2]
        for r in range(2):
            b[t + 1, r] -= share * w[k, 1 + r]
            b[t, r] += share * w[k, 1 + r]
    b[0, 0] = b[0, 1] = 0.0
    substitute(work.pivot, work.below, b)
    for t in range(T):
        k = 2 * t + 1
        along = w[k, 1] * (b[t + 1, 0] - b[t, 0]) + w[k, 2] * (b[t + 1, 1] - b[t, 1])
        rest = eta[k] * eta[k] * b[t, 2] + 2.0 * w[k, 0] * along
        b[t, 2] = rest / (2.0 * w[k, 0] * w[k, 0] - 1.0)


# --- iterations -----------------------------------------------------------------------------------


@kernel
def fill_pull(work: Work) -> None:
    """Fill PULL with the multipliers for an unchanged point and products equal to AIM."""
    for k in range(len(work.eta)):
        w, one, scaled, aim = work.cones[W, k], 1.0 / work.eta[k], work.cones[SCALED, k], work.cones[AIM, k]
        pull, room, s, dz = work.cones[PULL, k], work.cones[ROOM, k], work.cones[S, k], work.cones[DZ, k]
        for c in range(3):
            dz[c] = s[c] - room[c]
        stretched(w, one, dz, -1.0, pull)
        x = (scaled[0] * aim[0] - scaled[1] * aim[1] - scaled[2] * aim[2]) / determinant(scaled)
        dz[0] = pull[0] + x
        for c in range(1, 3):
            dz[c] = pull[c] + (aim[c] - x * scaled[c]) / scaled[0]
        stretched(w, one, dz, -1.0, pull)
    lines = work.lines
    for j in range(lines.shape[1]):
        lines[PULL, j] = (lines[Z, j] * (lines[S, j] - lines[ROOM, j]) + lines[AIM, j]) / lines[S, j]


@kernel
def limit_total(work: Work) -> None:
    """Correct the change of the point for the constraint on the sum of lengths."""
    dx, total, last = work.points[DX], work.points[TOTAL], 4 * (work.points.shape[1] - 1)
    weight, own, rest = work.lines[Z, last] / work.lines[S, last], 0.0, 0.0
    for t in range(len(dx) - 1):
        own += dx[t, 2]
        rest += total[t, 2]
    share = weight * own / (1.0 + weight * rest)
    for t in range(len(dx)):
        for c in range(3):
            dx[t, c] -= share * total[t, c]


@kernel
def fill_changes(work: Work) -> None:
    """Fill the changes DS and DZ; on entry, DS holds the change of ROOM by the change of the point."""
    for k in range(len(work.eta)):
        ds, dz = work.cones[DS, k], work.cones[DZ, k]
        squared(work.cones[W, k], work.eta[k], ds, dz)
        for c in range(3):
            dz[c] = work.cones[PULL, k, c] - dz[c] - work.cones[Z, k, c]
            ds[c] += work.cones[ROOM, k, c] - work.cones[S, k, c]
    lines = work.lines
    for j in range(lines.shape[1]):
        lines[DZ, j] = lines[PULL, j] - lines[Z, j] * (1.0 + lines[DS, j] / lines[S, j])
        lines[DS, j] += lines[ROOM, j] - lines[S, j]


@kernel
def longest_share(work: Work) -> float:
    """The largest share of the change with which slacks and multipliers stay in their cones; at most 2."""
    share = 2.0
    for u in range(2):
        for k in range(len(work.eta)):
            share = min(share, border(work.cones[S + u, k], work.cones[DS + u, k]))
        for j in range(work.lines.shape[1]):
            if work.lines[DS + u, j] < 0.0:
                share = min(share, -work.lines[S + u, j] / work.lines[DS + u, j])
    return share


@kernel
def mean_product(work: Work) -> float:
    """Mean of s' z over all constraints."""
    cones, lines, total = work.cones, work.lines, 0.0
    for k in range(cones.shape[1]):
        for c in range(3):
            total += cones[S, k, c] * cones[Z, k, c]
    for j in range(lines.shape[1]):
        total += lines[S, j] * lines[Z, j]
    return float(total / (cones.shape[1] + lines.shape[1]))


@kernel
def aim_at(work: Work, wanted: float) -> None:
    """Set AIM to ``wanted`` minus the second-order term of the last change (Mehrotra's corrector)."""
    for k in range(len(work.eta)):
        w, eta, a, b = work.cones[W, k], work.eta[k], work.cones[PULL, k], work.cones[DZ, k]
        stretched(w, 1.0 / eta, work.cones[DS, k], -1.0, a)
        stretched(w, eta, b, 1.0, work.cones[DS, k])
        b = work.cones[DS, k]
        work.cones[AIM, k, 0] = wanted - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]
        for c in range(1, 3):
            work.cones[AIM, k, c] = -a[0] * b[c] - b[0] * a[c]
    for j in range(work.lines.shape[1]):
        work.lines[AIM, j] = wanted - work.lines[DS, j] * work.lines[DZ, j]


@kernel
def add_share(table: FloatArray, more: FloatArray, share: float) -> None:
    """Add ``share`` times ``more`` to ``table``."""
    for k in range(table.shape[0]):
        for c in range(table.shape[1]):
            table[k, c] += share * more[k, c]


@kernel
def fill_first_point(model: StepModel, x: FloatArray) -> None:
    """Fill ``x`` (T+1, 3) with zero displacements and lengths slightly above the lengths of the last path."""
    x[:] = 0.0
    for t in range(len(x) - 1):
        x[t, 2] = math.hypot(model.cone[2 * t + 1, 1], model.cone[2 * t + 1, 2]) + FIRST


@kernel
def fill_first_slacks(work: Work) -> None:
    """Fill slacks and multipliers from ROOM of the first point, moved into their cones where necessary."""
    s, z = work.cones[S], work.cones[Z]
    for k in range(len(s)):
        for c in range(3):
            s[k, c] = work.cones[ROOM, k, c]
        s[k, 0] = max(s[k, 0], math.hypot(s[k, 1], s[k, 2]) + FIRST)
        share = FIRST / determinant(s[k])
        z[k, 0], z[k, 1], z[k, 2] = share * s[k, 0], -share * s[k, 1], -share * s[k, 2]
    for j in range(work.lines.shape[1]):
        work.lines[S, j] = max(work.lines[ROOM, j], FIRST)
        work.lines[Z, j] = FIRST / work.lines[S, j]


@kernel
def is_solved(work: Work) -> bool:
    """Whether slacks equal ROOM and the gradient of the Lagrangian, stored in DX, is 0, within tolerances."""
    cones, lines, slope = work.cones, work.lines, work.points[DX]
    for k in range(cones.shape[1]):
        for c in range(3):
            if abs(cones[ROOM, k, c] - cones[S, k, c]) > WITHIN:
                return False
    for j in range(lines.shape[1]):
        if abs(lines[ROOM, j] - lines[S, j]) > WITHIN:
            return False
    for t in range(len(slope)):
        for c in range(3):
            if abs(slope[t, c]) > LEVEL:
                return False
    return True


@kernel
def solve_step(model: StepModel, work: Work) -> int:
    """Fill ``work.points[X]`` with the solution; return the number of iterations, ``MOST`` on failure.

    Eq. (M56) of docs/mathematics_methods.md.
    """
    x, dx, total = work.points[X], work.points[DX], work.points[TOTAL]
    cones, lines = work.cones, work.lines
    fill_first_point(model, x)
    for number in range(MOST):
        fill_room(model, x, 1.0, cones[ROOM], lines[ROOM])
        if number == 0:
            fill_first_slacks(work)
        fill_slope(model, x, cones[Z], lines[Z], dx)
        gap = mean_product(work)
        if gap <= GAP and is_solved(work):
            return number
        scale(cones, work.eta)
        assemble(model, work)
        if not eliminate(work.pivot, work.below):
            return MOST
        total[:, :2] = 0.0
        total[:, 2] = 1.0
        without_total(work, total)
        cones[AIM] = 0.0
        lines[AIM] = 0.0
        for corrector in range(2):
            fill_pull(work)
            fill_slope(model, x, cones[PULL], lines[PULL], dx)
            without_total(work, dx)
            limit_total(work)
            fill_room(model, dx, 0.0, cones[DS], lines[DS])
            fill_changes(work)
            share = longest_share(work)
            if not corrector:
                aim_at(work, gap * (1.0 - min(share, 1.0)) ** 3)
        share = min(KEPT * share, 1.0)
        add_share(x, dx, share)
        for u in range(2):
            add_share(cones[S + u], cones[DS + u], share)
            add_share(lines[S + u : S + u + 1], lines[DS + u : DS + u + 1], share)
    return MOST
