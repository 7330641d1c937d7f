"""Claims about the modes of each part of the wind's error, and about the correlations of the parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, number, within
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.wind_fit import Fit, correlation, persistence, posterior_covariance, separation
from pareto_ltl_verify.wind_law import ErrorLaw
from pareto_ltl_verify.wind_tables import OF_FORECASTS, PARTS, SPACE, TIME, Modes, WindFile

ERROR_KERNEL = "matern32"  # correlation of the parts that are not fitted to readings
INSTANTS = 400  # instants at which a variance is evaluated for its mean over time
MODE = 1e-4  # largest allowed relative difference of two covariances; modes are stored in float32
SHARE = 3e-3  # largest allowed difference of two shares of a variance that is averaged over time
LENGTH = 1e-2  # largest allowed relative difference of two correlation lengths
LITTLE = 1e-4  # share of the variance below which the remainder without the modes is rounding


# --- covariances ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PartCovariance:
    """Covariances of the slots of one part, as multiples of a few matrices, and of its modes.

    Slot k has the covariance ``scale[k]`` times ``matrices[owner[k]]`` (N, N) [m²/s²], and modes ψ of
    ``unit[k]`` times that matrix.
    """

    matrices: list[FloatArray]
    owner: list[int]
    scale: FloatArray
    unit: FloatArray

    @cached_property
    def eigenvalues(self) -> list[FloatArray]:
        """Eigenvalues of each matrix, largest first."""
        return [np.maximum(np.linalg.eigvalsh(C)[::-1], 0.0) for C in self.matrices]

    @property
    def total(self) -> FloatArray:
        """Variance of one component summed over nodes, (K,)."""
        traces = np.array([np.trace(C) for C in self.matrices])
        return np.asarray(self.scale * traces[self.owner], float)

    def leading(self, limit: int) -> FloatArray:
        """Variance of mode 1, 2, ... up to ``limit``, summed over slots, components and nodes."""
        rows = [values[:limit] for values in self.eigenvalues]
        return np.asarray(2 * sum(s * rows[i] for s, i in zip(self.scale, self.owner, strict=True)), float)

    def over_slots(self) -> FloatArray:
        """The covariance summed over slots and both components, (N, N)."""
        weights = np.bincount(self.owner, self.scale, len(self.matrices))
        return np.asarray(2 * sum(w * C for w, C in zip(weights, self.matrices, strict=True)), float)


@lru_cache(maxsize=1)
def error_parts(result: Evidence) -> dict[int, PartCovariance]:
    """The parts of the error that follow from wind.nc, by number; the ensemble's part does not."""
    wind, horizon = result.wind, math.inf if result.horizon is None else result.horizon
    fit, modes = wind.fit, wind.modes
    if fit is None or modes is None:
        return {}
    nodes = modes.nodes()
    parts = {SPACE: _space(fit, nodes)}
    if (law := wind.error) is not None:
        apart = separation(nodes, nodes)
        for number, part in wind.law_parts.items():
            if (forecast := part.variance(wind.leads)).any():
                parts[number] = _common(forecast, forecast, apart / part.length)
        if (between := time_variances(wind, law, horizon)).any():
            parts[TIME] = _common(between, np.ones(len(between)), apart / law.change_length)
    return parts


def _space(fit: Fit, nodes: FloatArray) -> PartCovariance:
    owner = [next(i for i, group in enumerate(fit.groups) if k in group) for k in range(len(fit.points))]
    matrices = [posterior_covariance(fit, group[0], nodes) for group in fit.groups]
    ones = np.ones(len(owner))
    return PartCovariance(matrices, owner, ones, ones)


def _common(scale: FloatArray, unit: FloatArray, distance: FloatArray) -> PartCovariance:
    return PartCovariance([correlation(ERROR_KERNEL, distance)], [0] * len(scale), scale, unit)


def time_variances(wind: WindFile, law: ErrorLaw, horizon: float) -> FloatArray:
    """Mean variance of interpolation in time, (K,) [m²/s²], over the time for which a slot is the nearest."""
    shares = (np.arange(INSTANTS) + 0.5) / INSTANTS
    spent, spans = np.zeros(len(wind.times)), np.zeros(len(wind.times))
    for k, gap in enumerate(np.diff(wind.times)):
        half = np.mean([law.between_variance(0.5 * gap * share, gap) for share in shares])
        spent[k : k + 2] += 0.5 * gap * half
        spans[k : k + 2] += 0.5 * gap
    held = min(wind.until, horizon) - wind.times[-1]
    if 0 < held < math.inf:
        spent[-1] += held * np.mean([law.change_variance(held * share) for share in shares])
        spans[-1] += held
    return np.divide(spent, spans, out=np.zeros_like(spent), where=spans > 0)


def carried(modes: Modes, part: int, cov: PartCovariance) -> FloatArray:
    """Variance that the modes of a part carry, summed over nodes, (K, 2) [m²/s²]."""
    squares: FloatArray = (modes.of(part) ** 2).sum(axis=(1, 3))
    return squares * (cov.scale / np.where(cov.unit > 0, cov.unit, 1.0))[:, None]


def rest_covariance(modes: Modes, parts: Mapping[int, PartCovariance]) -> FloatArray:
    """Covariance of the error without its modes, summed over slots and components, (N, N) [m²/s²]."""
    left = np.zeros((len(modes.nodes()),) * 2)
    for part, cov in parts.items():
        psi = modes.of(part) * np.sqrt(cov.scale / np.where(cov.unit > 0, cov.unit, 1.0))[:, None, None, None]
        flat = psi.transpose(1, 0, 2, 3).reshape(len(left), -1)
        left += cov.over_slots() - flat @ flat.T
    return left


def correlation_length(modes: Modes, cov: FloatArray) -> float:
    """Half a line [m] times the variance of the mean of ``cov`` (N, N) over it, relative to the variance.

    The line lies along rows or columns of the nodes and is half as long as the shorter side. The variance is
    a sum over pairs of its nodes: n of them at distance 0, and 2 (n - h) at distance h.
    """
    nx, ny = len(modes.x), len(modes.y)
    i, j = np.divmod(np.arange(nx * ny), ny)
    n, total, variance = min(nx, ny) // 2 + 1, 0.0, 0.0
    for h in range(n):
        east, north = np.flatnonzero(i + h < nx), np.flatnonzero(j + h < ny)
        mean = (cov[east, east + h * ny].mean() + cov[north, north + h].mean()) / 2
        variance = variance or mean
        total += mean * (n - h) * (2 if h else 1)
    if variance <= 0:
        return 0.0
    return max(float((modes.y[1] - modes.y[0]) * total / (2 * n * variance)), 0.0)


def aligned_fault(modes: Modes) -> float:
    """Relative deviation of the modes of interpolation in space from the best match of consecutive slots.

    ψ_k is rotated so that ψ_k' ψ_{k-1} has its largest trace: that matrix is then symmetric and positive.
    """
    psi, worst = modes.of(SPACE), 0.0
    for k in range(1, len(psi)):
        for c in (0, 1):
            match = psi[k, :, c].T @ psi[k - 1, :, c]
            size = max(float(np.linalg.norm(match)), 1e-12)
            skew = float(np.linalg.norm(match - match.T)) / size
            least = float(np.linalg.eigvalsh(match + match.T)[0]) / size if len(match) else 0.0
            worst = max(worst, skew, -least)
    return worst


# --- claims -----------------------------------------------------------------------------------


def fitted(judge: Callable[[Evidence, Modes, Fit], Verdict | None], result: Evidence) -> Verdict | None:
    """Verdict of ``judge`` on the modes of a wind that was fitted to readings; None without them."""
    modes, fit = result.wind.modes, result.wind.fit
    return None if modes is None or fit is None else judge(result, modes, fit)


def mode_span(part: int, result: Evidence, modes: Modes, _fit: Fit) -> Verdict | None:
    """ψ ψ' is the leading part of the covariance C of a part of the error.

    C ψ ψ' = (ψ ψ')², and the trace of ψ ψ' is the sum of the largest eigenvalues.
    """
    psi, cov = modes.of(part), error_parts(result).get(part)
    if cov is None:
        return no_fault("no modes", {"modes of an error that is 0": psi.any()}) if psi.size else None
    probe = np.random.default_rng(3).standard_normal((psi.shape[1], 8))
    faults = [_span_fault(cov, psi[k, :, c], k, probe) for k in range(len(psi)) for c in (0, 1)]
    return within(f"{psi.shape[-1]} modes per component", max(faults, default=0.0), MODE)


def _span_fault(cov: PartCovariance, psi: FloatArray, k: int, probe: FloatArray) -> float:
    """The larger relative error: of C ψψ' = (ψψ')², or of the trace as a sum of eigenvalues."""
    owner, unit = cov.owner[k], float(cov.unit[k])
    carried_by = psi @ (psi.T @ probe)
    twice = psi @ (psi.T @ carried_by)
    size = max(float(np.abs(twice).max()), 1e-12)
    off = float(np.abs(unit * cov.matrices[owner] @ carried_by - twice).max()) / size
    limit = unit * float(cov.eigenvalues[owner][: psi.shape[1]].sum())
    return max(off, abs(float((psi**2).sum()) - limit) / limit if limit > 0 else float(psi.any()))


def matched(result: Evidence) -> Verdict | None:
    """Modes of interpolation in space are rotated to match the modes of the slot before."""
    modes = result.wind.modes
    if modes is None or len(modes.psi) < 2:
        return None
    return within(f"{len(modes.psi)} slots", aligned_fault(modes), MODE)


def mode_count(result: Evidence, modes: Modes, _fit: Fit) -> Verdict | None:
    """The modes are the largest of all parts, and carry wind.energy of the variance or are wind.modes_max.

    With an ensemble only the number of modes and unused modes are judged.
    """
    parts, settings = error_parts(result), result.settings["wind"]
    used, limit = int((modes.part >= 0).sum()), settings["modes_max"]
    faults = {
        f"{used} modes": used > limit,
        "unused modes are not 0": modes.psi[..., modes.part < 0].any(),
        "modes of no part of the error": set(modes.part) - {*parts, -1} and not result.has_ensemble,
    }
    if _whole_error(result):
        rows = [np.split(cov.leading(limit), [(modes.part == part).sum()]) for part, cov in parts.items()]
        kept, left = (np.concatenate([row[side] for row in rows]) for side in (0, 1))
        share = float(kept.sum()) / max(_total(parts), 1e-300)
        larger = left.max(initial=0.0) > kept.min(initial=math.inf) * (1 + SHARE)
        faults["a larger mode is left out"] = larger
        faults[f"{used} modes carry {share:.4f}"] = used < limit and share < settings["energy"] - SHARE
    return no_fault(f"energy {settings['energy']}, most {limit}", faults)


def _whole_error(result: Evidence) -> bool:
    """Whether all parts of the error follow from wind.nc."""
    return not result.has_ensemble and result.horizon is not None


def _total(parts: Mapping[int, PartCovariance]) -> float:
    """Variance of the whole error, summed over slots, components and nodes."""
    return 2 * sum(float(cov.total.sum()) for cov in parts.values())


def energy(result: Evidence, modes: Modes, _fit: Fit) -> Verdict | None:
    """The share of the variance that the modes carry, in every slot and component."""
    parts = error_parts(result)
    if not _whole_error(result):
        return None
    total = np.sum([cov.total for cov in parts.values()], axis=0)[:, None]
    inside: FloatArray = np.sum([carried(modes, part, cov) for part, cov in parts.items()], axis=0)
    share = np.minimum(np.divide(inside, total, out=np.ones_like(inside), where=total > 0), 1.0)
    return within(f"{modes.energy.mean():.4f}", float(np.abs(share - modes.energy).max()), SHARE)


def rest_length(result: Evidence, modes: Modes, _fit: Fit) -> Verdict | None:
    """The correlation length of the error without the modes, along rows and columns of their nodes."""
    parts = error_parts(result)
    if not _whole_error(result):
        return None
    rest, side = rest_covariance(modes, parts), float(modes.x[-1] - modes.x[0])
    if np.trace(rest) < LITTLE * _total(parts):
        longer = {"longer than the map": modes.rest_length > side}
        return no_fault(f"{modes.rest_length:.4g} m", longer)
    return number(modes.rest_length, correlation_length(modes, rest), rel=LENGTH)


def mode_scales(result: Evidence, modes: Modes, fit: Fit) -> Verdict | None:
    """Length scales are the shortest of the parts; the gap is the median time between slots.

    Flights average the local part of a forecast's error, whose length does not count.
    """
    law, times = result.wind.error, result.wind.times
    longest = math.inf if law is None else law.shortest_length
    gap = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    faults = {
        "length scales": not np.allclose(modes.length, np.minimum(fit.hyper[..., 2], longest), rtol=1e-9),
        f"gap {modes.gap:g} s of {gap:g} s": not close(modes.gap, gap),
    }
    return no_fault("length scales and gap", faults)


def error_persistence(result: Evidence, modes: Modes, fit: Fit) -> Verdict | None:
    """ρ is the setting, or matches the correlations of leave-one-out residuals over a day."""
    rho = result.settings["wind"]["rho"]
    return number(modes.rho, persistence(fit, result.wind.times) if rho is None else float(rho), rel=1e-4)


CLAIMS: tuple[Claim, ...] = (
    Claim("wind: modes of one slot match the next", ("wind.nc",), matched),
    *(
        Claim(f"wind: modes of {PARTS[part]}", ("wind.nc",), partial(fitted, partial(mode_span, part)))
        for part in (SPACE, TIME, *OF_FORECASTS.values())
    ),
    Claim("wind: number of modes", ("wind.nc",), partial(fitted, mode_count)),
    Claim("wind: share of the variance in the modes", ("wind.nc",), partial(fitted, energy)),
    Claim("wind: length of what the modes leave", ("wind.nc",), partial(fitted, rest_length)),
    Claim("wind: length scales of the modes", ("wind.nc",), partial(fitted, mode_scales)),
    Claim("wind: persistence rho", ("wind.nc",), partial(fitted, error_persistence)),
)
