"""Importance sampling of flights in plain NumPy: the readable form of ``kernels.importance``.

Here z is one vector of D = 2 + 2 T + 2 E P + Q numbers, in the order start, white, innovations of the field,
the robot's own errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from pareto_ltl.kernels.importance import LinearLaw, NormalDraws


def joined(draws: NormalDraws) -> FloatArray:
    """All standard normal draws of n flights, one row each (n, D)."""
    n = len(draws.start)
    white = np.moveaxis(draws.white, 1, 0).reshape(n, -1)
    field = np.moveaxis(draws.field, 1, 0).reshape(n, -1).astype(float)
    return np.hstack([draws.start, white, field, draws.errors])


def deviation_map(law: LinearLaw) -> FloatArray:
    """M (T+1, 2, D) of the deviations e_t = M_t z,

    M_{t+1} = F_t M_t + dt (ψ_t' Θ_k + E_t κ + white_t),    Θ_k = ρ_k Θ_{k-1} + √(1 - ρ_k²) η_k,

    with Θ_k (2, P, D) the rows of θ in epoch k.

    Eq. (M22) of docs/mathematics.md.
    """
    steps, (epochs, modes) = len(law.white), law.kept.shape
    size = 2 + 2 * steps + 2 * epochs * modes + law.push.shape[-1]
    unit = np.eye(size)
    start, white = unit[:2], unit[2 : 2 + 2 * steps]
    innovation, own = np.split(unit[2 + 2 * steps :], [2 * epochs * modes])
    white = white.reshape(steps, 2, size)
    theta = innovation.reshape(epochs, 2, modes, size).copy()
    kept = law.kept.astype(float)
    for k in range(1, epochs):
        rho = kept[k][None, :, None]
        theta[k] = rho * theta[k - 1] + np.sqrt(1.0 - rho**2) * theta[k]
    rows = [law.start_sd * start + law.lean @ own]
    for t in range(steps):
        wind = np.einsum("cm,cmd->cd", law.psi[t].astype(float), theta[law.epoch[t]])
        met = wind + law.push[t] @ own + law.white[t][:, None] * white[t]
        rows.append(law.F[t] @ rows[-1] + law.dt * met)
    return np.array(rows)


def half_space_directions(law: LinearLaw, weight: FloatArray) -> FloatArray:
    """ω (J, D) of Σ_t ``weight[j, t]``' e_t = ω_j' z, for ``weight`` (J, T+1, 2)."""
    directions: FloatArray = np.einsum("jti,tid->jd", weight, deviation_map(law))
    return directions


def proposal_density(
    reached: FloatArray, threshold: FloatArray, level: FloatArray, share: FloatArray, plain: float
) -> FloatArray:
    """q/φ (n,), summed over the components of the mixture.

    The component of half-space j at level l has the probability p_jl and the density
    φ 1{ω_j' z >= s_l τ_j} / Φ(-s_l τ_j).

        q/φ = α + Σ_l Σ_j p_jl 1{ω_j' z >= s_l τ_j} / Φ(-s_l τ_j),    p_jl = β_l Φ(-s_l τ_j) / Σ_k Φ(-s_l τ_k)

    Eq. (M64) of docs/mathematics_methods.md.

    Parameters
    ----------
    reached : (n, J) float
        ω_j' z.
    threshold : (J,) float, level, share : (L,) float, plain : float
        τ, s, β and α.
    """
    density = np.full(len(reached), plain)
    for s, beta in zip(level, share, strict=True):
        chance = ndtr(-s * threshold)
        probability = beta * chance / chance.sum()
        density += ((reached >= s * threshold) * (probability / chance)).sum(axis=1)
    return density
