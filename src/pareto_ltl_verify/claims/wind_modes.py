"""Claims about the modes of each part of the wind's error, and about the correlations of the parts."""

from __future__ import annotations

from functools import partial

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault, number, within
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.wind_fit import persistence
from pareto_ltl_verify.wind_modes import (
    PartCovariance,
    aligned_fault,
    carried,
    correlation_length,
    rest_covariance,
)
from pareto_ltl_verify.wind_tables import FORECAST, PARTS, SPACE, TIME

MODE = 1e-4  # largest allowed relative difference of two covariances; modes are stored in float32
SHARE = 3e-3  # largest allowed difference of two shares of a variance that is averaged over time
LENGTH = 1e-2  # largest allowed relative difference of two correlation lengths
LITTLE = 1e-4  # share of the variance below which the remainder without the modes is rounding


def mode_span(part: int, result: Evidence) -> Verdict | None:
    """ψ ψ' is the leading part of the covariance C of a part of the error.

    C ψ ψ' = (ψ ψ')², and the trace of ψ ψ' is the sum of the largest eigenvalues.
    """
    modes, cov = result.wind.modes, result.error_parts.get(part)
    if modes is None or result.wind.fit is None:
        return None
    psi = modes.of(part)
    if cov is None:
        return no_fault("no modes", ["modes of an error that is 0"] * bool(psi.any())) if psi.size else None
    probe = np.random.default_rng(3).standard_normal((psi.shape[1], 8))
    worst = max(
        (_span_fault(cov, psi[k, :, c], k, probe) for k in range(len(psi)) for c in (0, 1)), default=0
    )
    return within(f"{psi.shape[-1]} modes per component", worst, MODE)


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


def mode_count(result: Evidence) -> Verdict | None:
    """The modes are the largest of all parts, and carry wind.energy of the variance or are wind.modes_max.

    With an ensemble only the number of modes and unused modes are judged.
    """
    modes, settings = result.wind.modes, result.settings["wind"]
    if modes is None or result.wind.fit is None:
        return None
    used = int((modes.part >= 0).sum())
    limits = f"energy {settings['energy']}, most {settings['modes_max']}"
    faults = [f"{used} modes"] * (used > settings["modes_max"])
    faults += ["unused modes are not 0"] * bool(modes.psi[..., modes.part < 0].any())
    parts = result.error_parts
    faults += ["modes of no part of the error"] * bool(
        set(modes.part) - {*parts, -1} and not result.has_ensemble
    )
    if result.has_ensemble or result.horizon is None:
        return no_fault(limits, faults)
    rows = {part: cov.leading(settings["modes_max"]) for part, cov in parts.items()}
    kept = [rows[part][: int((modes.part == part).sum())] for part in rows]
    left = [rows[part][int((modes.part == part).sum()) :] for part in rows]
    least, largest = min(np.concatenate(kept), default=np.inf), max(np.concatenate(left), default=0.0)
    faults += ["a larger mode is left out"] * bool(largest > least * (1 + SHARE))
    total = 2 * sum(float(cov.total.sum()) for cov in parts.values())
    share = sum(float(values.sum()) for values in kept) / max(total, 1e-300)
    if used < settings["modes_max"] and share < settings["energy"] - SHARE:
        faults.append(f"{used} modes carry {share:.4f}")
    return no_fault(limits, faults)


def energy(result: Evidence) -> Verdict | None:
    """The share of the variance that the modes carry, in every slot and component."""
    modes, parts = result.wind.modes, result.error_parts
    if modes is None or not parts or result.has_ensemble or result.horizon is None:
        return None
    total = np.sum([cov.total for cov in parts.values()], axis=0)[:, None]
    inside: FloatArray = np.sum([carried(modes, part, cov) for part, cov in parts.items()], axis=0)
    share = np.minimum(np.divide(inside, total, out=np.ones_like(inside), where=total > 0), 1.0)
    return within(f"{modes.energy.mean():.4f}", float(np.abs(share - modes.energy).max()), SHARE)


def rest_length(result: Evidence) -> Verdict | None:
    """The correlation length of the error without the modes, along rows and columns of their nodes."""
    modes, parts = result.wind.modes, result.error_parts
    if modes is None or not parts or result.has_ensemble or result.horizon is None:
        return None
    rest = rest_covariance(modes, parts)
    total = 2 * sum(float(cov.total.sum()) for cov in parts.values())
    if np.trace(rest) < LITTLE * total:
        side = float(modes.x[-1] - modes.x[0])
        return no_fault(f"{modes.rest_length:.4g} m", ["longer than the map"] * (modes.rest_length > side))
    return number(modes.rest_length, correlation_length(modes, rest), rel=LENGTH)


def mode_scales(result: Evidence) -> Verdict | None:
    """Length scales are the shortest of the parts; the gap is the median time between slots."""
    fit, modes, law = result.wind.fit, result.wind.modes, result.wind.error
    if fit is None or modes is None:
        return None
    shortest = fit.hyper[..., 2]
    if law is not None:
        shortest = np.minimum(shortest, min(law.forecast_length, law.change_length))
    faults = ["length scales"] * (not np.allclose(modes.length, shortest, rtol=1e-9))
    gap = float(np.median(np.diff(result.wind.times))) if len(result.wind.times) > 1 else 1.0
    faults += [f"gap {modes.gap:g} s of {gap:g} s"] * (not close(modes.gap, gap))
    return no_fault("length scales and gap", faults)


def error_persistence(result: Evidence) -> Verdict | None:
    """ρ is the setting, or matches the correlations of leave-one-out residuals over a day."""
    fit, modes = result.wind.fit, result.wind.modes
    if fit is None or modes is None:
        return None
    rho = result.settings["wind"]["rho"]
    return number(modes.rho, persistence(fit, result.wind.times) if rho is None else float(rho), rel=1e-4)


CLAIMS = (
    *(
        Claim(f"wind: modes of {PARTS[part]}", ("wind.nc",), partial(mode_span, part))
        for part in (SPACE, FORECAST, TIME)
    ),
    *(
        Claim(f"wind: {name}", ("wind.nc",), judge)
        for name, judge in (
            ("modes of one slot match the next", matched),
            ("number of modes", mode_count),
            ("share of the variance in the modes", energy),
            ("length of what the modes leave", rest_length),
            ("length scales of the modes", mode_scales),
            ("persistence rho", error_persistence),
        )
    ),
)
