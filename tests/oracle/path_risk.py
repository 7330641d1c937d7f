"""Every probability of the planner as its formula, in plain NumPy.

The kernels compute the same quantities fast; the tests compare the two. Where the checker of results has the
same formula, it is used here: Eqs. (M34) and (M35) are ``left_out`` and ``in_polygon`` of
:mod:`pareto_ltl_verify.gaussians`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from oracle.segments import hazard_costs
from pareto_ltl.planning.pack_logic import step_epochs
from pareto_ltl.planning.wind_lookup import bilinear_value, interpolate, interpolate_time, lattice_corners
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl_verify.gaussians import beyond, in_polygon, left_out, spread_along
from pareto_ltl_verify.geometry import Convex, convex

if TYPE_CHECKING:
    from pareto_ltl.kernels.data import Modes
    from pareto_ltl.planning.problem import Problem


# --- one polygon, one Gaussian ----------------------------------------------------------------


def inside_bound(normals: FloatArray, offsets: FloatArray, mean: FloatArray, cov: FloatArray) -> float:
    """P(x in polygon) ≤ min_k Φ((d_k - c_k' x̂) / σ_k), Eq. (10).

    Eq. (M34) of docs/mathematics.md.
    """
    return float(beyond(normals @ mean - offsets, spread_along(normals, cov)).min())


# --- the Gaussian along a path ----------------------------------------------------------------


def propagate_independent(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariances (T+1, 2, 2) and controls (T, 2) along the means ``x`` (T+1, 2), Section III.

    Σ_{t+1} = A Σ_t A' + dt² Σ_w(x*),    x* of largest trace in a ball about x̂_t,
    u_t = B⁻¹ (x̂_{t+1} - A x̂_t - dt μ(x̂_t, t)) / dt.

    Eq. (M21) of docs/mathematics.md.
    """
    from pareto_ltl.kernels.motion import BALL

    motion, wind = problem.motion, problem.wind
    cov, u = [np.eye(2) * problem.start_variance], []
    for t in range(len(x) - 1):
        radius = motion.ball * np.sqrt(np.trace(cov[-1]) / 2)
        around = x[t] + radius * np.vstack([[0.0, 0.0], BALL])
        latent = np.array([interpolate(wind, wind.latent, t, p) for p in around])
        worst = latent[np.argmax(latent.sum(axis=1))] + interpolate_time(wind, wind.gust, t)
        worst = worst + wind.between[t]
        cov.append(
            motion.closed @ cov[-1] @ motion.closed.T + (motion.exposed * motion.dt) ** 2 * np.diag(worst)
        )
        mean = interpolate(wind, wind.mean, t, x[t])
        u.append(motion.b_inv @ (x[t + 1] - motion.a @ x[t] - motion.dt * mean) / motion.dt)
    return np.array(cov), np.array(u).reshape(-1, 2)


def propagate_coherent(problem: Problem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariances (T+1, 2, 2) and controls (T, 2) along the means ``x`` (T+1, 2) under the coherent law.

    With C = Cov(e, θ), F = A - K + h Dμ(x̂_t), h = φ dt, ψ = blkdiag(ψ_x', ψ_y'):

        Σ_{t+1} = F Σ F' + h (F C ψ' + ψ C' F') + h² (ψ ψ' + white),    C_{t+1} = ρ (F C + h ψ),
        u_t = B⁻¹ (x̂_{t+1} - A x̂_t - dt (μ + ½ D²μ : Σ + ∂ψ : C)) / dt.

    Eqs. (M23) and (M24) of docs/mathematics.md.
    """
    motion, wind, modes = problem.motion, problem.wind, problem.modes
    p, h = modes.psi.shape[-1], motion.exposed * motion.dt
    sigma, C = np.eye(2) * problem.start_variance, np.zeros((2, 2 * p))
    cov, u = [sigma], []
    for t in range(len(x) - 1):
        slope, bend = interpolate(wind, modes.slope, t, x[t]), interpolate(wind, modes.bend, t, x[t])
        F = motion.closed + h * slope.reshape(2, 2)
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
        mixed = h * F @ C @ psi.T
        sigma = F @ sigma @ F.T + mixed + mixed.T + h**2 * (psi @ psi.T + np.diag(white))
        C = np.tile(modes.kept[t + 1], 2) * (F @ C + h * psi)
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
    epoch, faces = step_epochs(bound.logic.epoch, len(x)), bound.faces
    risks = np.zeros(len(problem.atoms))
    for i in range(len(problem.atoms)):
        visits = np.flatnonzero(atoms[epoch, cell, i])
        if len(visits):
            parts = np.flatnonzero(bound.atom == i)
            rows = [slice(faces.ptr[k], faces.ptr[k + 1]) for k in parts]
            region = [Convex(np.empty((0, 2)), faces.normal[r], faces.offset[r]) for r in rows]
            risks[i] = min([1.0] + [left_out(part, x[t], cov[t]) for t in visits for part in region])
    return risks


def ordered_bound(problem: Problem, x: FloatArray, cov: FloatArray) -> float:
    """V: a bound on P(mission fails) that respects the order of visits, for every automaton.

    V(p) = 0 if q₀ ≥ p else 1 before the first letter; then

        V_t(p) = min(1, min_q [V_{t-1}(q) + P(label(x_t) not in {s : δ(q, s) ≥ p}) + Σ_h P(h met)]),

    the last sum over the hazards whose label loses q (:mod:`oracle.segments`), and the labels without
    these; the bound is min_{p accepting} V_T(p).

    Eq. (M37) of docs/mathematics.md.
    """
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
    """P(x_t in cell) for every step, (T+1,); a position known exactly lies in one cell."""
    part = convex(problem.decomposition.cells[cell])
    P = (problem.locate(x) == cell).astype(float)
    for t in np.flatnonzero(np.linalg.det(cov) > 0.0):
        P[t] = in_polygon(part, x[t], cov[t])
    return P
