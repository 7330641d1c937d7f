"""A wind field conditioned on position fixes: the expected wind changes, and the uncertainty decreases.

At time 0 θ ~ N(m, I - B' B) instead of N(0, I). A part of the error with the persistence ρ from there to a
slot then has m_slot = ρ m and, with R = diag(ρ) of all modes, Cov = I - R B' B R in that slot, so that

    μ  <-  μ + ψ' R m,        ψ  <-  ψ (I - R B' B R)^½,

with the symmetric root, by which modes of neighbouring slots continue to correspond. The covariance within
one component of the wind is exact; the one between the components, which the fix causes too, is neglected.
From slot to slot the modes keep their persistence, although the directions that the fixes determine are
renewed faster: this overestimates the spread of positions slightly.

A field that is held after its time changes by an error that grows. It gets additional slots after the fix,
and the modes of its change become a part of the error, ``HELD``, whose persistence is the correlation of the
changes since the field (M17). The error of interpolation between two fields ends with the next field;
information on it is not used.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from wind_laws.records import ENSEMBLE, HELD, SPACE, TIME, UncertainWind, forecast_parts
from wind_laws.types import Float32Array, FloatArray, IntArray

HELD_STEP = 10_800.0  # [s] between the slots of a held field
INSTANTS = 8  # at which a variance is averaged around a slot
Field = TypeVar("Field", bound=UncertainWind)


def field_from(field: Field, moment: float) -> Field:
    """``field`` from the last slot at or before ``moment`` [s] on, with times that count from ``moment``.

    Its evidence is dropped: the fit also used the slots before.
    """
    first = max(int(np.searchsorted(field.times, moment + 1e-6, side="right")) - 1, 0)
    times = field.times[first:] - moment
    return replace(
        _with_slots(field, times, np.arange(first, len(field.times))),
        until=field.known_until - moment,
        held=None if field.held is None else field.held - moment,
    )


def _with_slots(field: Field, times: FloatArray, rows: IntArray) -> Field:
    """``field`` with slots at ``times`` that have the content of the slots ``rows``, without evidence."""
    modes = field.modes
    if modes is not None:
        modes = replace(modes, psi=modes.psi[rows], length=modes.length[rows], energy=modes.energy[rows])
    return replace(
        field,
        times=times,
        mean=field.mean[rows],
        latent_var=field.latent_var[rows],
        gust_var=field.gust_var[rows],
        leads=field.leads[rows],
        modes=modes,
        evidence=None,
    )


def with_held_slots(field: Field) -> Field:
    """A field that is held from before time 0 on, with slots from 0 to its end; another one unchanged.

    The variance of the change since the field becomes part of ``latent_var``, and its modes the part
    ``HELD``. In each slot they have the mean of that variance over the times nearest to the slot.

    Eq. (M68a) of docs/mathematics_methods.md.
    """
    modes, error, last = field.modes, field.error, field.last_field
    changes = modes is not None and bool((modes.part == TIME).any())
    end = max(field.known_until, 1.0)
    if error is None or modes is None or not changes or not (last < 0.0 and end < np.inf):
        return field
    times = np.append(np.arange(0.0, end - 0.5 * HELD_STEP, HELD_STEP), end)
    times = times if len(times) > 1 else np.array([0.0, end])
    edges = np.concatenate([[0.0], 0.5 * (times[1:] + times[:-1]), [end]])
    share = (np.arange(INSTANTS) + 0.5) / INSTANTS
    around = edges[:-1, None] + np.diff(edges)[:, None] * share
    size = np.sqrt(error.change_variance(around - last).mean(axis=1))
    last_row = np.full(len(times), len(field.times) - 1)
    held = _with_slots(field, times, last_row)
    variance = held.latent_var + error.change_variance(times - last)[:, None, None, None]
    grown = np.where(modes.part == TIME, size[:, None], 1.0).astype(np.float32)[:, None, None, None]
    modes = replace(
        modes,
        psi=modes.psi[last_row] * grown,
        part=np.where(modes.part == TIME, HELD, modes.part),
        length=modes.length[last_row],
        energy=modes.energy[last_row],
    )
    return replace(held, latent_var=variance, modes=modes, held=last)


def persistence(field: UncertainWind, since: float) -> FloatArray:
    """ρ (K, P): share of θ of each mode that remains from ``since`` [s], the time of a slot, to each slot."""
    modes, times = field.modes, field.times
    if modes is None:
        return np.zeros((len(times), 0))
    last = field.last_field
    apart = np.abs(np.minimum(times, last) - min(since, last))[:, None]
    rho = np.zeros((len(times), len(modes.part)))
    rho[:, modes.part == SPACE] = modes.rho ** (apart / modes.gap)
    rho[:, modes.part == ENSEMBLE] = 1.0
    if field.error is not None:
        begin = np.where(times < since, field.leads, field.leads[np.argmin(np.abs(times - since))])[:, None]
        for number, part in forecast_parts(field.error):
            rho[:, modes.part == number] = part.persistence(begin, apart)
        rho[:, modes.part == HELD] = _kept_change(field, since)[:, None]
    return rho


def _kept_change(field: UncertainWind, since: float) -> FloatArray:
    """Persistence (K,) of the change of a held field from the slot at ``since`` to each later slot."""
    if field.held is None or field.error is None:
        return np.zeros(len(field.times))
    lags, first = field.times - field.held, int(np.argmin(np.abs(field.times - since)))
    fade = [
        field.error.change_correlation(a, b) for a, b in zip(lags[first:-1], lags[first + 1 :], strict=True)
    ]
    return np.concatenate([np.zeros(first), np.cumprod([1.0, *fade])])


def conditioned_field(field: Field, theta: FloatArray, known: FloatArray) -> Field:
    """``field``, conditioned on the information of position fixes.

    Eq. (M68) of docs/mathematics_methods.md.

    Parameters
    ----------
    theta : (2, P) float
        Expected θ, by component of the wind.
    known : (N, 2, P) float
        B, by row and component of the wind, with Cov(θ) = I - B' B.
    """
    field = with_held_slots(field)
    modes = field.modes
    if modes is None or not len(modes.part):
        return field
    slot = int(np.argmin(np.abs(field.times)))  # slot of the modes at time 0
    rho = persistence(field, float(field.times[slot]))
    mean, latent, psi = field.mean.copy(), field.latent_var.copy(), modes.psi.copy()
    nodes, shape = field.lattice.nodes(), mean.shape[1:3]
    for k in range(len(field.times)):
        for c in (0, 1):
            B = known[:, c] * rho[k]
            roots = psi[k, :, :, c].astype(float)
            columns = roots @ np.column_stack([rho[k] * theta[c], B.T])  # the shift; roots of what is lost
            here = modes.between(columns, nodes)
            mean[k, ..., c] += here[:, 0].reshape(shape)
            lost = (here[:, 1:] ** 2).sum(axis=1).reshape(shape)
            latent[k, ..., c] = np.maximum(latent[k, ..., c] - lost, 0.0)
            psi[k, :, :, c] = roots @ less_doubt(B)
    return replace(field, mean=mean, latent_var=latent, modes=replace(modes, psi=psi))


def conditioned_coefficients(
    field: UncertainWind, theta: Float32Array, slots: IntArray, expected: FloatArray, known: FloatArray
) -> Float32Array:
    """(I - R B' B R)^-½ (θ - R m): N(R m, I - R B' B R) becomes N(0, I), as in the conditioned field.

    Parameters
    ----------
    theta : (E, n, 2, P) float
        θ of n winds in each of ``slots`` (E,) of the conditioned field.
    expected : (2, P) or (n, 2, P) float
        m at the time of the plan, by component of the wind.
    known : (N, 2, P) float
        B.
    """
    field = with_held_slots(field)
    rho = persistence(field, float(field.times[np.argmin(np.abs(field.times))]))
    found = np.empty_like(theta)
    for e, share in enumerate(rho[slots]):
        for c in (0, 1):
            root = less_doubt(known[:, c] * share)
            found[e, :, c] = np.linalg.solve(root, (theta[e, :, c] - share * expected[..., c, :]).T).T
    return found


def less_doubt(known: FloatArray) -> FloatArray:
    """(I - B' B)^½ (P, P) of one component, for ``known`` (N, P) = B.

    Eq. (M68) of docs/mathematics_methods.md.
    """
    _, s, rows = np.linalg.svd(known, full_matrices=False)
    less = np.sqrt(np.clip(1.0 - s**2, 0.0, 1.0)) - 1.0
    return np.asarray(np.eye(known.shape[1]) + (rows.T * less) @ rows, float)
