"""Claims about the wind field: the posterior at its nodes, its modes and its time."""

from __future__ import annotations

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.verify.claims.verdict import Claim, Verdict, close, no_fault, number, same, within
from pareto_ltl.verify.evidence import Evidence
from pareto_ltl.verify.wind_tables import (
    Fit,
    Modes,
    WindFile,
    correlation,
    persistence,
    posterior,
    separation,
)

MOST_NODES = 4000  # of a slot, at which the posterior is worked out
CLEAR = 2e-6  # largest difference of a posterior, as a share of its prior


def _fitted(result: Evidence) -> Fit | None:
    return result.wind.fit


def has_fit(result: Evidence) -> Verdict:
    """The file names the readings it was fitted from; calm air has none."""
    wind = result.wind
    still = not (wind.mean.any() or wind.latent.any() or wind.gust.any())
    return Verdict(
        "readings or calm air",
        "none" if wind.fit is None else f"{sum(map(len, wind.fit.points))} readings",
        still != (wind.fit is not None),
    )


def calm_air(result: Evidence) -> Verdict | None:
    """With wind.source=calm there is no wind at all; otherwise there is some."""
    calm = result.settings["wind"]["source"] == "calm"
    moves = bool(result.wind.mean.any() or result.wind.gust.any())
    return same("calm" if calm else "wind", "wind" if moves else "calm")


def _node_table(wind: WindFile) -> tuple[IntArray, FloatArray]:
    """Indices (N,) and positions (N, 2) [m] of the nodes that are looked at, all of them if they are few."""
    places = np.stack(np.meshgrid(wind.x, wind.y, indexing="ij"), axis=-1).reshape(-1, 2)
    chosen = np.arange(len(places))
    if len(places) > MOST_NODES:
        chosen = np.random.default_rng(1).choice(len(places), MOST_NODES, replace=False)
    return chosen, places[chosen]


def posterior_field(result: Evidence) -> Verdict | None:
    """Mean and variance at the nodes are those of a Gaussian process given the readings."""
    fit, wind = _fitted(result), result.wind
    if fit is None:
        return None
    chosen, nodes = _node_table(wind)
    worst = 0.0
    for k in range(len(wind.times)):
        for c in (0, 1):
            scale = float(fit.hyper[k, c, 1] + fit.hyper[k, c, 3])
            mean, V = posterior(fit, k, c, nodes)
            said = wind.mean[k, ..., c].ravel()[chosen], wind.latent[k, ..., c].ravel()[chosen]
            latent = np.maximum(fit.hyper[k, c, 1] ** 2 - (V * V).sum(axis=0), 0.0)
            worst = max(
                worst,
                float(np.abs(said[0] - mean).max()) / scale,
                float(np.abs(said[1] - latent).max()) / scale**2,
            )
    return within(f"{len(wind.times)} slots, {len(nodes)} nodes", worst, CLEAR)


def prior(result: Evidence) -> Verdict | None:
    """The prior mean is that of the readings; the noise is at least wind.noise_min; positive scales."""
    fit = _fitted(result)
    if fit is None:
        return None
    least = result.settings["wind"]["noise_min"]
    faults = []
    for k, winds in enumerate(fit.winds):
        if not np.allclose(fit.hyper[k, :, 0], winds.mean(axis=0), rtol=1e-6, atol=1e-9):
            faults.append(f"slot {k}: prior mean")
        if fit.hyper[k, :, 3].min() < least * (1 - 1e-3) or fit.hyper[k, :, 1:3].min() <= 0:
            faults.append(f"slot {k}: scales")
    faults += ["kernel"] * (fit.kernel != result.settings["wind"]["kernel"])
    return no_fault(f"{len(fit.winds)} slots of readings", faults)


def gusts(result: Evidence) -> Verdict | None:
    """The white variance is the variance of the noise of the readings."""
    fit = _fitted(result)
    if fit is None:
        return None
    return within(
        "noise of the readings", float(np.abs(result.wind.gust / fit.hyper[..., 3] ** 2 - 1).max()), 1e-6
    )


def lattice(result: Evidence) -> Verdict:
    """The nodes are evenly spaced and cover the map."""
    bounds, wind = np.array(result.scene["bounds"]), result.wind
    faults = []
    for c, nodes in enumerate((wind.x, wind.y)):
        gaps = np.diff(nodes)
        faults += [f"{'xy'[c]} is uneven"] * (not np.allclose(gaps, gaps[0], rtol=1e-6))
        faults += [f"{'xy'[c]} ends within the map"] * bool(
            nodes[0] > bounds[0, c] + 1 or nodes[-1] < bounds[1, c] - 1
        )
    faults += ["times do not increase"] * bool((np.diff(wind.times) <= 0).any())
    faults += ["a variance is negative"] * bool(wind.latent.min() < 0 or wind.gust.min() < 0)
    faults += ["hold_last"] * (
        wind.hold_last != bool(result.settings["wind"]["hold_last"] or wind.fit is None)
    )
    faults += ["gust_time"] * (
        wind.fit is not None and wind.gust_time != result.settings["wind"]["gust_time"]
    )
    return no_fault(f"{len(wind.x)} x {len(wind.y)} nodes, {len(wind.times)} slots", faults)


def mode_span(result: Evidence) -> Verdict | None:
    """ψ ψ' is the leading part of the posterior covariance C at the nodes of the modes: C ψ ψ' = (ψ ψ')²."""
    fit, modes = _fitted(result), result.wind.modes
    if fit is None or modes is None:
        return None
    nodes = np.stack(np.meshgrid(modes.x, modes.y, indexing="ij"), axis=-1).reshape(-1, 2)
    probe = np.random.default_rng(3).standard_normal((len(nodes), 8))
    worst = max(_mode_fault(fit, modes, k, c, nodes, probe) for k in range(len(fit.points)) for c in (0, 1))
    return within(f"{modes.psi.shape[-1]} modes a component", worst, 1e-4)


def _mode_fault(fit: Fit, modes: Modes, k: int, c: int, nodes: FloatArray, probe: FloatArray) -> float:
    """The larger of what C ψψ' and (ψψ')² differ by, and what the share of the variance is off by."""
    _, V = posterior(fit, k, c, nodes)
    between = fit.hyper[k, c, 1] ** 2 * correlation(fit.kernel, separation(nodes, nodes) / fit.hyper[k, c, 2])
    C = between - V.T @ V
    psi = modes.psi[k, :, :, c].reshape(len(nodes), -1)
    carried = psi @ (psi.T @ probe)
    twice = psi @ (psi.T @ carried)
    size = max(float(np.abs(twice).max()), 1e-12)
    share = float((psi**2).sum() / max(np.trace(C), 1e-300))
    return max(
        float(np.abs(C @ carried - twice).max()) / size,
        abs(share - modes.energy[k, c]) if len(psi.T) else 0.0,
    )


def mode_count(result: Evidence) -> Verdict | None:
    """The modes carry wind.energy of the variance, or there are wind.modes_max of them."""
    modes, told = result.wind.modes, result.settings["wind"]
    if modes is None:
        return None
    used = (np.abs(modes.psi).max(axis=(0, 1, 2, 3)) > 0).sum()
    full = bool((modes.energy >= told["energy"] - 1e-9).all() or used >= told["modes_max"])
    return Verdict(
        f"energy {told['energy']}, most {told['modes_max']}", f"{modes.energy.min():.3f}, {used} modes", full
    )


def mode_scales(result: Evidence) -> Verdict | None:
    """Length scales are those of the fit; the gap is the median time between slots."""
    fit, modes = _fitted(result), result.wind.modes
    if fit is None or modes is None:
        return None
    faults = ["length scales"] * (not np.allclose(modes.length, fit.hyper[..., 2], rtol=1e-9))
    gap = float(np.median(np.diff(result.wind.times))) if len(result.wind.times) > 1 else 1.0
    faults += [f"gap {modes.gap:g} s of {gap:g} s"] * (not close(modes.gap, gap))
    return no_fault("length scales and gap", faults)


def rho(result: Evidence) -> Verdict | None:
    """ρ is the setting, or the correlation of leave-one-out residuals of successive slots."""
    fit, modes = _fitted(result), result.wind.modes
    if fit is None or modes is None:
        return None
    told = result.settings["wind"]["rho"]
    return number(modes.rho, persistence(fit) if told is None else float(told), rel=1e-4)


def wind_metrics(result: Evidence) -> Verdict:
    """The metrics of the wind are the attributes of wind.nc."""
    wind, told = result.wind, result.metrics
    pairs = dict(wind.score)
    if wind.modes is not None:
        pairs |= {
            "wind_modes": wind.modes.psi.shape[-1],
            "wind_energy": wind.modes.energy.mean(),
            "wind_rho": wind.modes.rho,
        }
    return no_fault(
        ", ".join(pairs)[:44] or "none", [name for name in pairs if not close(told[name], float(pairs[name]))]
    )


CLAIMS = tuple(
    Claim(f"wind: {name}", ("wind.nc",), judge)
    for name, judge in (
        ("there are readings, or the air is calm", has_fit),
        ("source of the settings", calm_air),
        ("mean and variance are the posterior", posterior_field),
        ("prior mean, noise and kernel", prior),
        ("white variance", gusts),
        ("lattice, slots and settings", lattice),
        ("modes are those of the posterior", mode_span),
        ("number of modes", mode_count),
        ("length scales of the modes", mode_scales),
        ("persistence rho", rho),
        ("metrics", wind_metrics),
    )
)
