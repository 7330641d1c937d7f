"""Karhunen-Loeve modes of the posterior wind, and the persistence of its errors in time.

Under the coherent law a flight meets one wind field. For each slot and component, the posterior covariance C
on a lattice gives the modes ψ; ρ correlates neighbouring slots::

    C         = U Λ U'
    ψ         = U √Λ
    w(x)      = μ(x) + ψ(x)' θ,              θ ~ N(0, I)
    θ_{k+1}   = ρ θ_k + √(1 - ρ²) η,         η ~ N(0, I)
"""

from __future__ import annotations

import logging

import numpy as np

from pareto_ltl.support.arrays import Float32Array, FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.wind.gp import CORRELATIONS, Hyper, WindPosterior, pairwise_distances

LOG = logging.getLogger(__name__)

MODE_LANES = 8  # the number of modes is a multiple of this, to fill vector registers
SAME_PLACE = 1e3  # [m] readings of two times that are closer belong to one station
FEWEST_PAIRS = 10  # pairs of residuals; with fewer, ρ = 1
RELATIVE_RIDGE = 1e-9  # added noise variance over amplitude², for the Cholesky factor


def posterior_modes(
    posterior: WindPosterior, nodes: FloatArray, energy: float, most: int
) -> tuple[Float32Array, FloatArray]:
    """ψ at ``nodes`` (N, 2) [m] for every slot and component, and the variance it carries.

    Parameters
    ----------
    energy : float
        Share of the posterior variance that the modes carry; the remainder is white.
    most : int
        Largest number of modes.

    Returns
    -------
    ψ (K, N, 2, P) float32 [m/s], P the same for all slots; share of the variance carried (K, 2).
    """
    from joblib import Parallel, delayed
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    between = pairwise_distances(nodes, nodes)
    jobs = [(k, c) for k in range(len(posterior.times)) for c in (0, 1)]
    with threadpool_limits(1):
        found = Parallel(n_jobs=min(len(jobs), cores()), prefer="threads")(
            delayed(_leading_modes)(posterior, k, c, nodes, between, energy, most) for k, c in jobs
        )
    columns = max((psi.shape[1] for psi, _ in found), default=0)
    columns = -(-columns // MODE_LANES) * MODE_LANES
    table = np.zeros((len(posterior.times), len(nodes), 2, columns), np.float32)
    share = np.ones((len(posterior.times), 2))
    last: dict[int, FloatArray] = {}
    for (k, c), (psi, kept) in zip(jobs, found, strict=True):
        wide = np.zeros((len(nodes), columns))
        wide[:, : psi.shape[1]] = psi
        last[c] = wide if c not in last else align_modes(wide, last[c])
        table[k, :, c], share[k, c] = last[c], kept
    return table, share


def _leading_modes(
    posterior: WindPosterior, k: int, c: int, nodes: FloatArray, between: FloatArray, energy: float, most: int
) -> tuple[FloatArray, float]:
    """U √Λ (N, p) [m/s] of one slot and component, and the share of the variance that p modes carry."""
    from scipy.linalg import eigh

    h = posterior.hyper[k][c]
    C = posterior_covariance(posterior.kernel, h, posterior.points[k], nodes, between)
    n, trace = len(C), float(np.trace(C))
    if trace <= 0.0:
        return np.zeros((n, 0)), 1.0
    values, vectors = eigh(C, subset_by_index=[max(0, n - most), n - 1], check_finite=False)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    carried = np.cumsum(values) / trace
    p = min(int(np.searchsorted(carried, energy)) + 1, len(values))
    return vectors[:, :p] * np.sqrt(values[:p]), float(carried[p - 1])


def posterior_covariance(
    kernel: str, h: Hyper, points: FloatArray, nodes: FloatArray, between: FloatArray
) -> FloatArray:
    """Posterior covariance (N, N) [m²/s²] at ``nodes`` (N, 2) with mutual distances ``between`` (N, N) [m].

    C = k(X*, X*) - k(X*, X) (K + σ² I)⁻¹ k(X, X*)
    """
    from scipy.linalg import solve_triangular

    rho, a2 = CORRELATIONS[kernel], h.amplitude**2
    K = a2 * rho(pairwise_distances(points, points) / h.length)
    K[np.diag_indices_from(K)] += h.noise**2 + RELATIVE_RIDGE * a2
    V = solve_triangular(
        np.linalg.cholesky(K), a2 * rho(pairwise_distances(points, nodes) / h.length), lower=True
    )
    C: FloatArray = a2 * rho(between / h.length) - V.T @ V
    return C


def align_modes(psi: FloatArray, before: FloatArray) -> FloatArray:
    """ψ Q, where the rotation Q makes ψ Q closest to the modes of the slot ``before``.

    ψ is unique up to a rotation, but correlating slots mode by mode needs modes that correspond. Q does not
    change ψ ψ'; it maximises the trace of Cov(w_k, w_{k+1}) = ρ ψ_k ψ_{k+1}'. Orthogonal Procrustes problem
    (Schönemann, 1966, doi:10.1007/BF02289451)::

        ψ' before = U S V',   Q = U V'
    """
    U, _, Vt = np.linalg.svd(psi.T @ before)
    return np.asarray(psi @ (U @ Vt), float)


def error_persistence(posterior: WindPosterior) -> float:
    """ρ in [0, 1], the correlation of leave-one-out residuals between neighbouring slots.

    Residuals in closed form (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, Eqs. 5.10
    to 5.12), and their correlation over readings at the same place::

        r_i = [K⁻¹ (w - m)]_i / [K⁻¹]_ii,   Var r_i = 1 / [K⁻¹]_ii,   z_i = r_i / √(Var r_i)

        ρ = Σ z_k z_{k+1} / √(Σ z_k² Σ z_{k+1}²)

    With fewer than ``FEWEST_PAIRS`` pairs, ρ = 1: errors do not change during a flight, the conservative
    case.
    """
    residuals = [_leave_one_out_residuals(posterior, k) for k in range(len(posterior.times))]
    cross = first = second = 0.0
    pairs = 0
    for k in range(len(residuals) - 1):
        gap = pairwise_distances(posterior.points[k], posterior.points[k + 1])
        i = np.flatnonzero(gap.min(axis=1) < SAME_PLACE)
        a, b = residuals[k][i], residuals[k + 1][gap[i].argmin(axis=1)]
        cross, first, second = cross + (a * b).sum(), first + (a * a).sum(), second + (b * b).sum()
        pairs += 2 * len(i)
    if pairs < FEWEST_PAIRS or first * second <= 0.0:
        if len(residuals) > 1:
            LOG.warning(
                "too few stations report at neighbouring times to fit how long wind errors last; they are "
                "taken to last for ever (set wind.rho to change that)"
            )
        return 1.0
    return float(np.clip(cross / np.sqrt(first * second), 0.0, 1.0))


def _leave_one_out_residuals(posterior: WindPosterior, k: int) -> FloatArray:
    """Standardised leave-one-out residuals z of one slot, shape (n, 2)."""
    between = pairwise_distances(posterior.points[k], posterior.points[k])
    columns = []
    for c, h in enumerate(posterior.hyper[k]):
        K = h.amplitude**2 * CORRELATIONS[posterior.kernel](between / h.length)
        K[np.diag_indices_from(K)] += h.noise**2 + RELATIVE_RIDGE * h.amplitude**2
        K_inv = np.linalg.inv(K)
        columns.append(K_inv @ (posterior.winds[k][:, c] - h.mean) / np.sqrt(np.diag(K_inv)))
    return np.column_stack(columns)


__all__ = ["align_modes", "error_persistence", "posterior_covariance", "posterior_modes"]
