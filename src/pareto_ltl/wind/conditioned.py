"""A wind field conditioned on a position fix: the expected wind changes, and the uncertainty decreases.

At the time of the fix θ ~ N(m, I - B' B) instead of N(0, I). A part of the error with the persistence ρ from
there to a slot then has m_slot = ρ m and Cov = I - ρ² B' B in that slot, so that

    μ  <-  μ + ψ' ρ m,        ψ  <-  ψ (I - ρ² B' B)^½,

with the symmetric root, by which modes of neighbouring slots continue to correspond. The covariance within
one component of the wind and one part of the error is exact; the covariance between components and parts,
which the fix causes too, is neglected. From slot to slot the modes keep their persistence, although the two
directions that the fix determines are renewed faster: this overestimates the spread of positions slightly.

The error of interpolation in time is independent in every gap between fields, so information on it is not
used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.wind.records import ENSEMBLE, FORECAST, SPACE, WindField, WindModes


def field_from(field: WindField, moment: float) -> WindField:
    """``field`` from the last slot at or before ``moment`` [s] on, with times that count from ``moment``.

    Its evidence is dropped: the fit also used the slots before.
    """
    first = max(int(np.searchsorted(field.times, moment + 1e-6, side="right")) - 1, 0)
    modes = field.modes
    if modes is not None:
        modes = replace(
            modes, psi=modes.psi[first:], length=modes.length[first:], energy=modes.energy[first:]
        )
    return replace(
        field,
        times=field.times[first:] - moment,
        mean=field.mean[first:],
        latent_var=field.latent_var[first:],
        gust_var=field.gust_var[first:],
        until=field.known_until - moment,
        modes=modes,
        evidence=None,
        leads=field.leads[first:],
    )


def persistence(field: WindField, since: float) -> FloatArray:
    """ρ (K, P): share of θ of each mode that is kept from ``since`` [s], the time of a slot, to each slot."""
    modes = field.modes
    if modes is None:
        return np.zeros((len(field.times), 0))
    apart = np.abs(field.times - since)[:, None]
    kept = np.zeros((len(field.times), len(modes.part)))
    kept[:, modes.part == SPACE] = modes.rho ** (apart / modes.gap)
    kept[:, modes.part == ENSEMBLE] = 1.0
    if field.error is not None:
        kept[:, modes.part == FORECAST] = field.error.persistence ** (apart / field.error.persistence_time)
    return kept


def conditioned_field(field: WindField, theta: FloatArray, told: FloatArray) -> WindField:
    """``field``, whose times count from a fix, conditioned on the information of that fix.

    Eq. (M68) of docs/mathematics_methods.md.

    Parameters
    ----------
    theta : (2, P) float
        Expected θ, by component of the wind.
    told : (2, 2, P) float
        B, by row and component of the wind, with Cov(θ) = I - B' B.
    """
    modes = field.modes
    if modes is None or not len(modes.part):
        return field
    slot = int(np.argmin(np.abs(field.times)))  # that of the modes at the fix
    kept = persistence(field, float(field.times[slot]))
    mean, latent, psi = field.mean.copy(), field.latent_var.copy(), modes.psi.copy()
    nodes = field.lattice.nodes()
    for k in range(len(field.times)):
        here = mode_values(modes, k, nodes)  # (N, 2, P)
        shape = mean.shape[1:3]
        for c in (0, 1):
            mean[k, ..., c] += (here[:, c] @ (kept[k] * theta[c])).reshape(shape)
            root = less_doubt(told[:, c], kept[k], modes.part)
            after = here[:, c] @ root
            lost = (here[:, c] ** 2).sum(axis=1) - (after**2).sum(axis=1)
            latent[k, ..., c] = np.maximum(latent[k, ..., c] - lost.reshape(shape), 0.0)
            psi[k, :, :, c] = psi[k, :, :, c].astype(float) @ root
    return replace(field, mean=mean, latent_var=latent, modes=replace(modes, psi=psi))


def less_doubt(told: FloatArray, kept: FloatArray, part: IntArray) -> FloatArray:
    """(I - ρ² B' B)^½ (P, P) of one component, block by block for the parts of the error.

    ``told`` (2, P) = B, ``kept`` (P,) = ρ, ``part`` (P,) of each mode.

    Eq. (M68) of docs/mathematics_methods.md.
    """
    root = np.eye(len(part))
    for g in np.unique(part):
        own = np.flatnonzero(part == g)
        B = told[:, own] * kept[own]
        values, vectors = np.linalg.eigh(B.T @ B)
        few = values > 1e-12
        less = np.sqrt(np.clip(1.0 - values[few], 0.0, 1.0)) - 1.0
        root[np.ix_(own, own)] += (vectors[:, few] * less) @ vectors[:, few].T
    return root


def mode_values(modes: WindModes, slot: int, places: FloatArray) -> FloatArray:
    """ψ (N, 2, P) [m/s] of a slot at ``places`` (N, 2) [m], bilinear; constant beyond the lattice."""
    psi = modes.psi[slot]
    size = np.array(psi.shape[:2])
    at = np.clip((places - modes.origin) / modes.spacing, 0.0, size - 1.0)
    low = np.minimum(at.astype(int), size - 2)
    fx, fy = (at - low).T[:, :, None, None]
    i, j = low.T
    near = (1 - fy) * psi[i, j] + fy * psi[i, j + 1]
    far = (1 - fy) * psi[i + 1, j] + fy * psi[i + 1, j + 1]
    return np.asarray((1 - fx) * near + fx * far, float)
