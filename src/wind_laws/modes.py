"""Karhunen-Loeve modes of the error of a wind field, and the persistence of its parts.

A flight meets one wind field. Its error is a sum of independent parts, each with
modes ψ and a persistence ρ; together they are modes of the sum of the covariances::

    w(x, t)   = μ(x, t) + Σ_parts ψ(x, t)' θ,      θ ~ N(0, I)
    θ_{k+1}   = ρ θ_k + √(1 - ρ²) η,               η ~ N(0, I)

    space      covariance C of the Gaussian process given the readings of a slot, C = U Λ U', ψ = U √Λ
    forecast   for each part of the law the modes of a Matern-3/2 process, times σ(L) of the slot's lead
    time       the modes of another process, scaled at each step by the error of interpolation in time
    ensemble   deviations of the members of an ensemble

The variance that the modes do not carry is added to the white part; ``rest_length`` is its correlation
length.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from careful_io.machine import cores
from wind_laws import gp
from wind_laws.gp import CORRELATIONS, WindPosterior
from wind_laws.places import pairwise_distances, same_places
from wind_laws.records import ENSEMBLE, SPACE, TIME
from wind_laws.types import Float32Array, FloatArray, IntArray

LOG = logging.getLogger(__name__)

MODE_LANES = 8  # the number of modes is a multiple of this, to fill vector registers
SAME_PLACE = 1e3  # [m] closer readings of two times count as from one station
DAY = 86_400.0  # [s]
FEWEST_PAIRS = 10  # pairs of residuals; with fewer, ρ = 1
RELATIVE_RIDGE = 1e-9  # added noise variance over amplitude², for the Cholesky factor
ERROR_KERNEL = "matern32"  # of the parts that are not fitted to readings


class UniformPart(NamedTuple):
    """A part of the error that is uniform over the map.

    Attributes
    ----------
    part : int
        Its number among ``PARTS``: one of forecasts, or ``TIME``.
    variance : (K,) float
        Variance in each slot [m²/s²]; of interpolation in time, averaged over the times nearest to the slot.
    length : float
        Length scale, Matern-3/2 [m].
    """

    part: int
    variance: FloatArray
    length: float


class ModeTable(NamedTuple):
    """The modes at N nodes and K slots.

    ``psi`` (K, N, 2, P) float32 [m/s], for the part ``TIME`` with a variance of 1; ``part`` (P,): the
    part of each mode, -1 for columns of zeros; ``energy`` (K, 2): share of the variance that the modes carry;
    ``rest_length``: correlation length of the remainder [m].
    """

    psi: Float32Array
    part: IntArray
    energy: FloatArray
    rest_length: float


class _Spectrum(NamedTuple):
    """One part of the error.

    ``psi`` (K, N, 2, p): its modes, largest first; ``total`` (K, 2): variance summed over nodes; ``lags``
    (H,): mean covariance of nodes h rows or columns apart, summed over slots and components.
    """

    psi: FloatArray
    total: FloatArray
    lags: FloatArray


def error_modes(
    posterior: WindPosterior, parts: Sequence[UniformPart], members: FloatArray, shape: tuple[int, int],
    nodes: FloatArray, energy: float, limit: int,
) -> ModeTable:  # fmt: skip
    """The modes of the error at ``nodes`` (N, 2) [m] of a lattice of ``shape``, for every slot and component.

    ``members`` (K, N, 2, M) are the deviations of an ensemble at the nodes [m/s], whose sum of squares is the
    variance; M = 0 without an ensemble.

    Of all parts together, the modes with the largest variance over all slots are used, until they carry the
    share ``energy`` of the variance or their number is ``limit``.

    Eq. (M14) of docs/mathematics.md.
    """
    between = pairwise_distances(nodes, nodes)
    spectra = {SPACE: _space_spectrum(posterior, nodes, between, shape, limit)}
    for part, variance, length in parts:
        if variance.any():
            spectra[part] = _common_spectrum(variance, between / length, shape, limit)
    if members.shape[-1]:
        spectra[ENSEMBLE] = _member_spectrum(members, shape)
    counts = _mode_counts(spectra, energy, limit)
    leading = {part: found.psi[..., : counts[part]] for part, found in spectra.items()}
    leading[SPACE] = _aligned(leading[SPACE])
    carried = sum((psi**2).sum(axis=(1, 3)) for psi in leading.values())
    total = sum(found.total for found in spectra.values())
    rest = sum(spectra[part].lags - _mode_lags(psi, shape) for part, psi in leading.items())
    if TIME in leading:
        time = next(each.variance for each in parts if each.part == TIME)
        unit = np.sqrt(np.where(time > 0, time, 1.0))[:, None, None, None]
        one = (leading[TIME] / unit)[np.flatnonzero(time > 0)[:1]]
        leading[TIME] = np.broadcast_to(one, leading[TIME].shape)
    psi, owner = _stacked(leading)
    share = np.where(total > 0, carried / np.maximum(total, 1e-300), 1.0)
    return ModeTable(psi, owner, np.minimum(share, 1.0), _correlation_length(nodes, np.asarray(rest)))


# --- the parts --------------------------------------------------------------------------------


def _space_spectrum(
    posterior: WindPosterior, nodes: FloatArray, between: FloatArray, shape: tuple[int, int], limit: int
) -> _Spectrum:
    from joblib import Parallel, delayed
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    def one(k: int) -> tuple[FloatArray, float, FloatArray]:
        C = posterior_covariance(posterior, k, nodes, between)
        return leading_modes(C, limit), float(np.trace(C)), _matrix_lags(C, shape)

    # Both components have the same covariance, and so do slots with readings at the same places.
    groups = same_places(posterior.points)
    with threadpool_limits(1):
        jobs = 1 if max(len(points) for points in posterior.points) > gp.MANY else min(len(groups), cores())
        found = Parallel(n_jobs=jobs, prefer="threads")(delayed(one)(int(slots[0])) for slots in groups)
    psi = np.zeros((len(posterior.times), len(nodes), 2, max(leading.shape[1] for leading, _, _ in found)))
    total, lags = np.zeros((len(posterior.times), 2)), np.zeros_like(found[0][2])
    for slots, (leading, trace, own) in zip(groups, found, strict=True):
        psi[slots, ..., : leading.shape[1]] = leading[:, None]
        total[slots] = trace
        lags += 2.0 * len(slots) * own
    return _Spectrum(psi, total, lags)


def posterior_covariance(
    posterior: WindPosterior, k: int, nodes: FloatArray, between: FloatArray
) -> FloatArray:
    """Covariance C (N, N) [m²/s²] of slot ``k`` at ``nodes`` (N, 2) with mutual distances ``between`` [m].

    The variance factor is included: rows and columns are scaled to the latent variance v' of
    :meth:`~wind_laws.gp.WindPosterior.at`::

        C  = k(X*, X*) - k(X*, X) (K + σ² I)⁻¹ k(X, X*)
        C' = √(v' / v) C √(v' / v)',    v = diag C

    Eqs. (M7) and (M9) of docs/mathematics.md.
    """
    from scipy.linalg import solve_triangular

    h, points = posterior.hyper, posterior.points[k]
    rho, a2 = CORRELATIONS[posterior.kernel], h.amplitude**2
    L = np.linalg.cholesky(gp.reading_covariance(posterior.kernel, h, points, RELATIVE_RIDGE))
    V = solve_triangular(L, a2 * rho(pairwise_distances(points, nodes) / h.length), lower=True)
    C: FloatArray = a2 * rho(between / h.length) - V.T @ V
    v = np.maximum(np.diag(C), 0.0)
    wanted = gp.scaled_variance(v, h.noise**2, posterior.variance_factor(nodes))
    root = np.sqrt(np.where(v > 0, wanted / np.maximum(v, 1e-300), 0.0))
    C *= root[:, None] * root[None, :]
    return C


def _common_spectrum(
    variance: FloatArray, distance: FloatArray, shape: tuple[int, int], limit: int
) -> _Spectrum:
    """The modes of a stationary process, times the standard deviation of each slot.

    ``variance`` (K,) [m²/s²]; ``distance`` (N, N) between nodes, in length scales.
    """
    C = CORRELATIONS[ERROR_KERNEL](distance)
    shared = leading_modes(C, limit)
    psi = np.sqrt(variance)[:, None, None, None] * shared[None, :, None, :]
    total = np.repeat(variance[:, None] * len(C), 2, axis=1)
    return _Spectrum(np.repeat(psi, 2, axis=2), total, 2.0 * variance.sum() * _matrix_lags(C, shape))


def _member_spectrum(members: FloatArray, shape: tuple[int, int]) -> _Spectrum:
    """Members rotated, per component, so that the first modes carry most variance over slots and nodes."""
    psi = np.empty_like(members)
    for c in (0, 1):
        flat = members[:, :, c].reshape(-1, members.shape[-1])
        _, rotation = np.linalg.eigh(flat.T @ flat)
        psi[:, :, c] = members[:, :, c] @ rotation[:, ::-1]
    return _Spectrum(psi, (psi**2).sum(axis=(1, 3)), _mode_lags(psi, shape))


def leading_modes(C: FloatArray, limit: int) -> FloatArray:
    """U √Λ (N, p) of the ``limit`` largest eigenvalues of a covariance ``C`` (N, N); p = 0 if it is 0."""
    from scipy.linalg import eigh

    n = len(C)
    if np.trace(C) <= 0.0:
        return np.zeros((n, 0))
    values, vectors = eigh(C, subset_by_index=[max(0, n - limit), n - 1], check_finite=False)
    return np.asarray(vectors[:, ::-1] * np.sqrt(np.maximum(values[::-1], 0.0)), float)


# --- how many modes, and in which order -------------------------------------------------------


def _mode_counts(spectra: Mapping[int, _Spectrum], energy: float, limit: int) -> dict[int, int]:
    """Number of modes of each part among the largest of all, by their variance over all slots."""
    values = {part: (found.psi**2).sum(axis=(0, 1, 2)) for part, found in spectra.items()}
    owner = np.concatenate([np.full(len(v), part) for part, v in values.items()])
    joined = np.concatenate(list(values.values()))
    order = np.argsort(-joined, kind="stable")
    total = float(sum(found.total.sum() for found in spectra.values()))
    if total <= 0.0:
        return dict.fromkeys(spectra, 0)
    wanted = int(np.searchsorted(np.cumsum(joined[order]), energy * total)) + 1
    leading = owner[order[: min(wanted, limit)]]
    return {part: int((leading == part).sum()) for part in spectra}


def _aligned(psi: FloatArray) -> FloatArray:
    """ψ (K, N, 2, p) with the modes of every slot rotated to match the modes of the previous slot."""
    result = psi.copy()
    for k in range(1, len(psi)):
        for c in (0, 1):
            result[k, :, c] = align_modes(psi[k, :, c], result[k - 1, :, c])
    return result


def align_modes(psi: FloatArray, before: FloatArray) -> FloatArray:
    """ψ Q (N, p), with the rotation Q for which ψ Q is closest to the modes ``before`` of the previous slot.

    ψ is unique up to a rotation, but correlating slots mode by mode needs modes that correspond. Q does not
    change ψ ψ'; it maximises the trace of Cov(w_k, w_{k+1}) = ρ ψ_k ψ_{k+1}'. Orthogonal Procrustes problem
    (Schönemann, 1966, doi:10.1007/BF02289451)::

        ψ' before = U S V',   Q = U V'

    Eq. (M18) of docs/mathematics.md.
    """
    U, _, Vt = np.linalg.svd(psi.T @ before)
    return np.asarray(psi @ (U @ Vt), float)


def _stacked(modes: Mapping[int, FloatArray]) -> tuple[Float32Array, IntArray]:
    """The modes of all parts side by side, with columns of zeros up to a multiple of ``MODE_LANES``."""
    part = np.concatenate([np.full(psi.shape[-1], name, np.int64) for name, psi in modes.items()])
    missing = -len(part) % MODE_LANES
    slots, nodes = next(iter(modes.values())).shape[:2]
    columns = [*modes.values(), np.zeros((slots, nodes, 2, missing))]
    psi = np.concatenate(columns, axis=-1).astype(np.float32)
    return psi, np.concatenate([part, np.full(missing, -1, np.int64)])


# --- the remainder that the modes do not carry ------------------------------------------------


def _matrix_lags(C: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Mean of ``C`` (N, N) over pairs of nodes h rows or h columns apart, h = 0 .. half the side: (H,)."""
    table = C.reshape(*shape, *shape)
    lags = []
    for h in range(min(shape) // 2 + 1):
        east = np.einsum("ijij->ij", table[h:, :, : shape[0] - h, :])
        north = np.einsum("ijij->ij", table[:, h:, :, : shape[1] - h])
        lags.append(0.5 * (east.mean() + north.mean()))
    return np.array(lags)


def _mode_lags(psi: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """:func:`_matrix_lags` of ψ ψ', summed over slots and components, from ``psi`` (K, N, 2, p): (H,)."""
    table = psi.reshape(len(psi), *shape, 2, psi.shape[-1])
    lags = []
    for h in range(min(shape) // 2 + 1):
        east = (table[:, h:] * table[:, : shape[0] - h]).sum(axis=(0, 3, 4))
        north = (table[:, :, h:] * table[:, :, : shape[1] - h]).sum(axis=(0, 3, 4))
        lags.append(0.5 * (east.mean() + north.mean()))
    return np.array(lags)


def _correlation_length(nodes: FloatArray, lags: FloatArray) -> float:
    """∫ (1 - s/H) κ(s) ds [m] from 0 to H, half the shorter side of the map, over ``lags`` (H/Δ + 1,).

    With it, the mean of the remainder over a line of length H has its true variance: what the modes leave
    changes its sign within short distances, and errors of opposite sign cancel. At least 0.

    Eq. (M19) of docs/mathematics.md.
    """
    if lags[0] <= 0.0:
        return 0.0
    spacing = float(nodes[1, 1] - nodes[0, 1])
    weight = 1.0 - np.arange(len(lags)) / len(lags)
    weight[0] = 0.5
    return max(spacing * float(weight @ lags / lags[0]), 0.0)


# --- persistence ------------------------------------------------------------------------------


def error_persistence(posterior: WindPosterior, remedy: str = "") -> float:
    """ρ in [0, 1], the correlation of errors of interpolation in space from one slot to the next.

    It is estimated from leave-one-out residuals z of readings at the same place, j slots apart::

        r_j = Σ z_k z_{k+j} / √(Σ z_k² Σ z_{k+j}²),      Σ_j ρ^j = Σ_j r_j,    j = 1, 2, ... within a day

    The correlation of real errors does not decrease like ρ^j: at withheld nodes of GFS fields it is 0.69,
    0.48 and 0.35 after 3, 6 and 9 h and remains at 0.3 from 12 to 30 h, since terrain and coasts do not
    change. A flight accumulates errors, so ρ is chosen to match the sum of the correlations over a day. With
    fewer than ``FEWEST_PAIRS`` pairs, ρ = 1: errors do not change during a flight, the conservative case; the
    warning ends with ``remedy``.

    Eq. (M16) of docs/mathematics.md.
    """
    slots = len(posterior.times)
    residuals, matched = posterior.residuals, _stations(posterior.points)
    correlations: list[float] = []
    for apart in range(1, slots):
        if correlations and np.median(posterior.times[apart:] - posterior.times[:-apart]) > DAY:
            break
        correlation = _residual_correlation(matched, residuals, apart)
        if correlation is None:
            break
        correlations.append(correlation)
    if not correlations:
        if slots > 1:
            LOG.warning(
                "too few stations report at neighbouring times to fit how long wind errors last; they "
                "are assumed to last for ever%s",
                remedy,
            )
        return 1.0
    return persistence_of(correlations)


def _stations(points: Sequence[FloatArray]) -> Callable[[int, int], tuple[IntArray, IntArray]]:
    """A function of two time indices: the readings of both times at common places, as two index arrays.

    Pairs of times with the same places are computed once.
    """
    groups = same_places(points)
    group = {k: g for g, slots in enumerate(groups) for k in slots.tolist()}

    @cache
    def matched(one: int, other: int) -> tuple[IntArray, IntArray]:
        gap = pairwise_distances(points[groups[one][0]], points[groups[other][0]])
        i = np.flatnonzero(gap.min(axis=1) < SAME_PLACE)
        return i, gap[i].argmin(axis=1)

    return lambda k, other: matched(group[k], group[other])


def _residual_correlation(
    matched: Callable[[int, int], tuple[IntArray, IntArray]], residuals: Sequence[FloatArray], apart: int
) -> float | None:
    """r_j for j = ``apart`` slots; None if there are too few pairs."""
    cross = first = second = 0.0
    pairs = 0
    for k in range(len(residuals) - apart):
        i, j = matched(k, k + apart)
        a, b = residuals[k][i], residuals[k + apart][j]
        cross, first, second = cross + (a * b).sum(), first + (a * a).sum(), second + (b * b).sum()
        pairs += 2 * len(i)
    if pairs < FEWEST_PAIRS or first * second <= 0.0:
        return None
    return float(cross / np.sqrt(first * second))


def persistence_of(correlations: Sequence[float]) -> float:
    """ρ in [0, 1] with Σ_j ρ^j = Σ_j ``correlations[j]``, limited to that range."""
    total = float(np.sum(correlations))
    if total <= 0.0:
        return 0.0
    if total >= len(correlations):
        return 1.0
    from scipy.optimize import brentq

    powers = np.arange(1, len(correlations) + 1)
    return float(brentq(lambda rho: (rho**powers).sum() - total, 0.0, 1.0))
