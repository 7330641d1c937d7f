"""Every probability of the planner as its formula, in plain NumPy.

The kernels compute the same quantities fast; the tests compare the two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, owens_t

from pareto_ltl.planning.epochs import step_epochs
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.data import Modes, Wind
    from pareto_ltl.planning.problem import Problem

ROUNDING_FLOOR = 1e-13  # below this the exact polygon probability is rounding error: use half planes


def deviation(normals: FloatArray, cov: FloatArray) -> FloatArray:
    """σ_j = √(a_j' Σ a_j), shape (n,)."""
    variance: FloatArray = np.einsum("ij,jk,ik->i", normals, cov, normals)
    return np.sqrt(variance)


def _tail(gap: FloatArray, sd: FloatArray) -> FloatArray:
    """1 - Φ(gap / sd), a step function where sd = 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sd > 0, ndtr(-gap / sd), np.where(gap >= 0, 0.0, 1.0))


def outside_bound(normals: FloatArray, offsets: FloatArray, mean: FloatArray, cov: FloatArray) -> float:
    """P(x not in polygon) ≤ Σ_j (1 - Φ((b_j - a_j' x̂) / σ_j)), Eq. (6).

    Eq. (M34) of docs/mathematics.md.
    """
    return float(_tail(offsets - normals @ mean, deviation(normals, cov)).sum())


def inside_bound(normals: FloatArray, offsets: FloatArray, mean: FloatArray, cov: FloatArray) -> float:
    """P(x in polygon) ≤ min_k Φ((d_k - c_k' x̂) / σ_k), Eq. (10).

    Eq. (M34) of docs/mathematics.md.
    """
    return float(min(1.0, _tail(normals @ mean - offsets, deviation(normals, cov)).min()))


def gaussian_in_polygon(polygon: FloatArray, mean: FloatArray, cov: FloatArray) -> float:
    """P(N(mean, cov) in polygon), exact in two dimensions.

    Whitened by the Cholesky factor, with h the signed distance of a directed edge from the origin and
    v₁, v₂ its end coordinates along it,

        P = Σ_e sgn(h) {[atan(v₂/|h|) - atan(v₁/|h|)] / 2π - [T(|h|, v₂/|h|) - T(|h|, v₁/|h|)]},

    T = Owen's T. ``polygon`` (n, 2) is counter-clockwise.

    Eq. (M35) of docs/mathematics.md.
    """
    L = np.linalg.cholesky(cov)
    white = np.linalg.solve(L, (polygon - mean).T).T
    edge = np.roll(white, -1, axis=0) - white
    along = edge / np.linalg.norm(edge, axis=1)[:, None]
    h = white[:, 0] * along[:, 1] - white[:, 1] * along[:, 0]
    size = np.maximum(np.abs(h), 1e-300)
    v1 = np.einsum("ij,ij->i", white, along)
    v2 = v1 + np.linalg.norm(edge, axis=1)
    turn = (np.arctan2(v2, size) - np.arctan2(v1, size)) / (2 * np.pi)
    share = np.sign(h) * (turn - (owens_t(size, v2 / size) - owens_t(size, v1 / size)))
    return float(np.clip(share.sum(), 0.0, 1.0))


# --- wind on its lattice ----------------------------------------------------------------------


def lattice_corners(
    lattice: Wind | Modes, table: FloatArray, slot: IntArray, x: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The square that holds each of ``x`` (P, 2), clamped to the lattice.

    Returns the values (2, 2, P, ...) of slots ``slot`` (P,) of ``table`` (K, NX, NY, ...) at its corners, by
    east and north neighbour; the fractions (P, 2); and which coordinates lie on the lattice (P, 2).
    """
    top = np.array(table.shape[1:3]) - 1
    g = (x - np.array([lattice.west, lattice.south])) * lattice.per_metre
    inside = (g >= 0) & (g <= top)
    g = np.clip(g, 0, top)
    i, j = np.minimum(g.astype(np.int64), top - 1).T
    corners = np.array([[table[slot, i + a, j + b] for b in (0, 1)] for a in (0, 1)])
    return corners, g - np.column_stack([i, j]), inside


def bilinear_value(corners: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Linear along the second index of ``corners`` (2, 2, ...), then along the first."""
    low, high = ((1 - second) * c[0] + second * c[1] for c in corners)
    return np.asarray((1 - first) * low + first * high, float)


def interpolate_time(wind: Wind, table: FloatArray, step: int) -> FloatArray:
    """A table (K, ...) at a step, linear between slots."""
    k, w = wind.slot[step], wind.weight[step]
    return np.asarray(table[k] if w == 0 else (1 - w) * table[k] + w * table[k + 1], float)


def interpolate(wind: Wind, table: FloatArray, step: int, point: FloatArray) -> FloatArray:
    """A table (K, NX, NY, n) at a step and a point, (n,)."""
    now = interpolate_time(wind, table, step)[None]
    corners, (fraction,), _ = lattice_corners(wind, now, np.zeros(1, np.int64), point[None])
    value: FloatArray = bilinear_value(corners, *fraction)[0]
    return value


def wind_at_place(wind: Wind, step: int, point: FloatArray) -> FloatArray:
    """μ (2,) [m/s] at one step and place: ten times faster than :func:`interpolate`, for loops in Python."""
    gx, gy = (float(point[0]) - wind.west) * wind.per_metre, (float(point[1]) - wind.south) * wind.per_metre
    nx, ny = wind.mean.shape[1:3]
    gx, gy = min(max(gx, 0.0), nx - 1.0), min(max(gy, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    square = interpolate_time(wind, wind.mean[:, i : i + 2, j : j + 2], step)
    return bilinear_value(square, gx - i, gy - j)


def wind_and_gradient(wind: Wind, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """μ(x_t, t) (T, 2) [m/s] and Dμ (T, 2, 2) [1/s] at the rows of ``x``, one per step.

    μ is bilinear on the lattice, so ∂μ/∂x runs linearly between the differences along the lower and the
    upper side of the square. Beyond the lattice the wind is constant.
    """
    k, w = wind.slot[: len(x)], wind.weight[: len(x), None]
    now, fractions, inside = lattice_corners(wind, wind.mean, k, x)
    after, _, _ = lattice_corners(wind, wind.mean, np.minimum(k + 1, len(wind.mean) - 1), x)
    corners = (1 - w) * now + w * after
    fx, fy = fractions.T[..., None]
    (c00, c01), (c10, c11) = corners
    mean = bilinear_value(np.swapaxes(corners, 0, 1), fy, fx)
    along = (1 - fy) * (c10 - c00) + fy * (c11 - c01)
    across = (1 - fx) * (c01 - c00) + fx * (c11 - c10)
    gradient = np.stack([along, across], axis=-1) * wind.per_metre * inside[:, None, :]
    return mean, gradient


# --- the Gaussian along a path ----------------------------------------------------------------


def propagate_independent(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariances (T+1, 2, 2) and controls (T, 2) along the means ``x`` (T+1, 2), Section III.

    Σ_{t+1} = A Σ_t A' + dt² Σ_w(x*),    x* of largest trace in a ball about x̂_t,
    u_t = B⁻¹ (x̂_{t+1} - A x̂_t - dt μ(x̂_t, t)) / dt.

    Eq. (M21) of docs/mathematics.md.
    """
    from pareto_ltl.kernels.propagation import BALL

    motion, wind = problem.motion, problem.wind
    cov, u = [np.eye(2) * problem.start_variance], []
    for t in range(len(x) - 1):
        radius = motion.ball * np.sqrt(np.trace(cov[-1]) / 2)
        around = x[t] + radius * np.vstack([[0.0, 0.0], BALL])
        latent = np.array([interpolate(wind, wind.latent, t, p) for p in around])
        worst = latent[np.argmax(latent.sum(axis=1))] + interpolate_time(wind, wind.gust, t)
        worst = worst + wind.between[t]
        cov.append(motion.closed @ cov[-1] @ motion.closed.T + motion.dt**2 * np.diag(worst))
        mean = interpolate(wind, wind.mean, t, x[t])
        u.append(motion.b_inv @ (x[t + 1] - motion.a @ x[t] - motion.dt * mean) / motion.dt)
    return np.array(cov), np.array(u).reshape(-1, 2)


def propagate_coherent(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariances (T+1, 2, 2) and controls (T, 2) along the means ``x`` (T+1, 2) under the coherent law.

    With C = Cov(e, θ), F = A - K + dt Dμ(x̂_t), ψ = blkdiag(ψ_x', ψ_y'):

        Σ_{t+1} = F Σ F' + dt (F C ψ' + ψ C' F') + dt² (ψ ψ' + white),    C_{t+1} = ρ (F C + dt ψ),
        u_t = B⁻¹ (x̂_{t+1} - A x̂_t - dt (μ + ½ D²μ : Σ + ∂ψ : C)) / dt.

    Eqs. (M23) and (M24) of docs/mathematics.md.
    """
    motion, wind, modes = problem.motion, problem.wind, problem.modes
    p = modes.psi.shape[-1]
    sigma, C = np.eye(2) * problem.start_variance, np.zeros((2, 2 * p))
    cov, u = [sigma], []
    for t in range(len(x) - 1):
        slope, bend = interpolate(wind, modes.slope, t, x[t]), interpolate(wind, modes.bend, t, x[t])
        F = motion.closed + motion.dt * slope.reshape(2, 2)
        psi, east, north = modes_at_place(modes, t, x[t])
        left = interpolate(wind, wind.latent, t, x[t]) + wind.between[t] - np.diag(psi @ psi.T)
        white = modes.white * interpolate_time(wind, wind.gust, t) + modes.rest * np.maximum(left, 0.0)
        curved = [
            0.5 * (b[0] * sigma[0, 0] + 2 * b[1] * sigma[0, 1] + b[2] * sigma[1, 1])
            for b in (bend[:3], bend[3:])
        ]
        swept = [
            (east[c] * C[0, c * p : (c + 1) * p] + north[c] * C[1, c * p : (c + 1) * p]).sum() for c in (0, 1)
        ]
        drift = interpolate(wind, wind.mean, t, x[t]) + curved + swept
        u.append(motion.b_inv @ (x[t + 1] - motion.a @ x[t] - motion.dt * drift) / motion.dt)
        mixed = motion.dt * F @ C @ psi.T
        sigma = F @ sigma @ F.T + mixed + mixed.T + motion.dt**2 * (psi @ psi.T + np.diag(white))
        C = np.tile(modes.kept[t + 1], 2) * (F @ C + motion.dt * psi)
        cov.append(sigma)
    return np.array(cov), np.array(u).reshape(-1, 2)


def modes_at_place(modes: Modes, step: int, point: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """blkdiag(ψ_x', ψ_y') (2, 2P) at a point, and ψ's derivatives to east and north, (2, P) each [1/s]."""
    psi = (modes.scale[step] * modes.psi[modes.slot[step]]).astype(float)[None]
    corners, ((fx, fy),), _ = lattice_corners(modes, psi, np.zeros(1, np.int64), point[None])
    (a, c), (b, d) = corners[:, :, 0]
    here = bilinear_value(corners, fx, fy)[0]
    east = modes.per_metre * ((1 - fy) * (b - a) + fy * (d - c))
    north = modes.per_metre * ((1 - fx) * (c - a) + fx * (d - b))
    p = psi.shape[-1]
    both = np.zeros((2, 2 * p))
    both[0, :p], both[1, p:] = here
    return both, east, north


# --- mission risk -----------------------------------------------------------------------------


def theorem2_bound(problem: Problem, x: FloatArray, cov: FloatArray, cell: IntArray) -> FloatArray:
    """f_o^i = min_{t in T_i} Σ_j (1 - Φ((b_ij - a_ij' x̂_t) / σ_ij(t))), 0 where T_i is empty (Theorem 1).

    Known faults: the witness may be a visit made before the automaton needs it, and formulas with a
    proper ``until`` are not covered. :func:`ordered_bound` has neither.

    Eq. (M36) of docs/mathematics.md.
    """
    bound, atoms = problem.theorem2, problem.theorem2.holds
    epoch = step_epochs(bound.logic.epoch, len(x))
    risks = np.zeros(len(problem.atoms))
    for i in range(len(problem.atoms)):
        visits = np.flatnonzero(atoms[epoch, cell, i])
        if len(visits):
            parts = np.flatnonzero(bound.atom == i)
            risks[i] = min(_region_missed(problem, parts, x[t], cov[t]) for t in visits)
    return risks


def _region_missed(problem: Problem, parts: IntArray, mean: FloatArray, cov: FloatArray) -> float:
    """Bound on P(position not in a region) by its best convex part, at most 1."""
    faces = problem.theorem2.faces
    rows = [slice(faces.ptr[k], faces.ptr[k + 1]) for k in parts]
    return min([1.0] + [outside_bound(faces.normal[r], faces.offset[r], mean, cov) for r in rows])


def ordered_bound(problem: Problem, x: FloatArray, cov: FloatArray) -> float:
    """V: a bound on P(mission fails) that respects the order of visits, for every automaton.

    V(p) = 0 if q₀ ≥ p else 1 before the first letter; then

        V_t(p) = min(1, min_q [V_{t-1}(q) + P(label(x_t) not in {s : δ(q, s) ≥ p}) + Σ_h P(h met)]),

    the last sum over the hazards whose label loses q (:mod:`reference_segments`), and the labels without
    these; the bound is min_{p accepting} V_T(p).

    Eq. (M37) of docs/mathematics.md.
    """
    from pareto_ltl.planning.reference_segments import hazard_costs

    logic = problem.logic
    column, P = label_probabilities(problem, x, cov)
    way = hazard_costs(problem, x, cov)
    V = np.where(logic.covers[logic.initial], 0.0, 1.0)
    for t in range(len(x)):
        read = problem.reading(t)
        spoils = ~logic.covers[read.delta[:, column]]  # (Q, S, Q): reading s in q does not reach p
        spoils[:, :-1] &= ~read.loses[:, column[:-1], None]
        fail = np.einsum("qsp,s->qp", spoils, P[t])
        V = np.minimum(1.0, (V[:, None] + way[t, :, None] + fail).min(axis=0))
    accepting = logic.distance == 0.0
    return float(V[accepting].min()) if accepting.any() else 1.0


def label_probabilities(problem: Problem, x: FloatArray, cov: FloatArray) -> tuple[IntArray, FloatArray]:
    """P(label of x_t = s) along a path, exact sums over the cells that show the label.

    Returns the automaton column of each cell with a label and, last, of the empty label; and the
    probabilities (T+1, S). Obstacles and what lies off the map show the empty label.
    """
    labelled = np.array([c for c, label in enumerate(problem.labels) if label], np.int64)
    P = np.zeros((len(x), len(labelled) + 1))
    for k, c in enumerate(labelled):
        P[:, k] = _cell_probability(problem, int(c), x, cov)
    P[:, -1] = np.clip(1.0 - P[:, :-1].sum(axis=1), 0.0, 1.0)
    return np.append(labelled, len(problem.labels)), P


def _cell_probability(problem: Problem, cell: int, x: FloatArray, cov: FloatArray) -> FloatArray:
    """P(x_t in cell) for every step, (T+1,)."""
    polygon = problem.decomposition.cells[cell]
    faces = problem.cells.faces
    rows = slice(faces.ptr[cell], faces.ptr[cell + 1])
    normals, offsets = faces.normal[rows], faces.offset[rows]
    gap = x @ normals.T - offsets
    sd = np.sqrt(np.einsum("ij,tjk,ik->ti", normals, cov, normals))
    P = _tail(gap, sd).min(axis=1)
    exact = (P > ROUNDING_FLOOR) & (np.linalg.det(cov) > 0.0)
    known = sd.max(axis=1) == 0.0  # a position known exactly lies in one cell
    P[known] = (problem.locate(x[known]) == cell).astype(float)
    for t in np.flatnonzero(exact):
        P[t] = gaussian_in_polygon(polygon, x[t], cov[t])
    return np.asarray(P, float)
