"""Claims about the wind field: the posterior at its nodes, its forecasts, its time and its settings."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.reading import read_json
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault, same, within
from pareto_ltl_verify.claims.wind_modes import CLAIMS as MODE_CLAIMS
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.forecast_errors import HOUR, ErrorLaw, error_law, independent_changes
from pareto_ltl_verify.wind_fit import Fit, correlation, posterior, scaled, separation
from pareto_ltl_verify.wind_tables import WindFile, level_of, source_of

PACKAGED_LAW = PACKAGE / "support" / "data" / "forecast_errors" / "gfs.json"
MOST_NODES = 4000  # limit of the number of nodes of a slot at which the posterior is computed
LAW_WEIGHT = 10.0  # degrees of freedom of the law in the factor of D
LEAST_FACTOR, MOST_FACTOR = 0.25, 4.0
CLEAR = 2e-6  # largest allowed error of a posterior, as a share of the prior's standard deviation


def _fitted(result: Evidence) -> Fit | None:
    return result.wind.fit


def has_fit(result: Evidence) -> Verdict:
    """wind.nc names the readings from which it was fitted, and only calm air has none."""
    wind = result.wind
    still = not (wind.mean.any() or wind.latent.any() or wind.gust.any())
    return Verdict(
        "readings or calm air",
        "none" if wind.fit is None else f"{sum(map(len, wind.fit.points))} readings",
        still != (wind.fit is not None),
    )


def calm_air(result: Evidence) -> Verdict | None:
    """With wind.source=calm mean and gusts are 0 everywhere; with other sources they are not."""
    calm = result.settings["wind"]["source"] == "calm"
    moves = bool(result.wind.mean.any() or result.wind.gust.any())
    return same("calm" if calm else "wind", "wind" if moves else "calm")


def _node_table(wind: WindFile) -> tuple[IntArray, FloatArray]:
    """Indices (N,) and positions (N, 2) [m] of the nodes to compare, at most ``MOST_NODES`` at random."""
    places = np.stack(np.meshgrid(wind.x, wind.y, indexing="ij"), axis=-1).reshape(-1, 2)
    chosen = np.arange(len(places))
    if len(places) > MOST_NODES:
        chosen = np.random.default_rng(1).choice(len(places), MOST_NODES, replace=False)
    return chosen, places[chosen]


def posterior_field(result: Evidence) -> Verdict | None:
    """Mean and variance at the nodes are the posterior of a Gaussian process given the readings.

    The variance is the variance of the process times the variance factor, plus the variance of a forecast
    with the lead time of the slot. The members of an ensemble are not in the file; they may increase the
    variance.
    """
    fit, wind = _fitted(result), result.wind
    if fit is None:
        return None
    chosen, nodes = _node_table(wind)
    factor, worst = fit.factor(nodes), 0.0
    forecast = np.zeros(len(wind.times)) if wind.error is None else wind.error.forecast_variance(wind.leads)
    for k in range(len(wind.times)):
        for c in (0, 1):
            scale = float(fit.hyper[k, c, 1] + fit.hyper[k, c, 3])
            mean, V = posterior(fit, k, c, nodes)
            plain = np.maximum(fit.hyper[k, c, 1] ** 2 - (V * V).sum(axis=0), 0.0)
            latent = scaled(plain, float(fit.hyper[k, c, 3]), factor) + forecast[k]
            more = wind.latent[k, ..., c].ravel()[chosen] - latent
            off = np.maximum(-more, 0.0) if result.has_ensemble else np.abs(more)
            gap = np.abs(wind.mean[k, ..., c].ravel()[chosen] - mean)
            worst = max(worst, float(gap.max()) / scale, float(off.max()) / scale**2)
    return within(f"{len(wind.times)} slots, {len(nodes)} nodes", worst, CLEAR)


def prior(result: Evidence) -> Verdict | None:
    """The prior mean is the readings' mean, noise at least wind.noise_min; all slots share the scales."""
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
    faults += ["scales differ"] * bool((fit.hyper[..., 1:] != fit.hyper[0, 0, 1:]).any())
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
    """The nodes are evenly spaced and cover the map, times increase, and variances are not negative."""
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
    faults += ["gust_time"] * (
        wind.fit is not None and wind.gust_time != result.settings["wind"]["gust_time"]
    )
    return no_fault(f"{len(wind.x)} x {len(wind.y)} nodes, {len(wind.times)} slots", faults)


def known_until(result: Evidence) -> Verdict:
    """Slots begin at departure, no gap exceeds wind.max_gap, and the wind is known until the last slot.

    With wind.hold_last it is known for wind.max_gap longer.
    """
    wind, settings = result.wind, result.settings["wind"]
    if wind.fit is None:
        return same(wind.until, math.inf)
    faults = ["slots begin after departure"] * bool(wind.times[0] > 1e-6)
    faults += ["slots before departure"] * bool((wind.times[1:] < -1e-6).any())
    widest = float(np.diff(wind.times).max(initial=0.0))
    faults += [f"a gap of {widest / HOUR:g} h"] * (widest > settings["max_gap"] * HOUR + 1)
    ends = [float(wind.times[-1]) + settings["max_gap"] * HOUR * settings["hold_last"]]
    if result.horizon is None or wind.times[-1] >= result.horizon:  # later slots are left out
        ends.append(float(wind.times[-1]))
    faults += [f"it ends at {ends[0] / HOUR:g} h"] * (not any(close(wind.until, end, 1e-9) for end in ends))
    return no_fault(f"{wind.until / HOUR:g} h", faults)


def level_and_leads(result: Evidence) -> Verdict:
    """The level agrees with the settings, or is 10 m for the sample; no lead time is negative.

    Where forecasts have errors, each of several fields has a lead, except in the sample and in currents.
    """
    wind, settings = result.wind, result.settings["wind"]
    named = "10m" if settings["source"] == "sample" else wind.level
    if source_of(settings["source"]).level:
        named = str(settings["level"])
        tables_of_before = settings["source"] in ("csv", "stations") and wind.level == "10m"
        if tables_of_before and named == result.settings["robot"].get("level"):
            named = "10m"  # versions before 1.0 set wind.level to robot.level and read such tables as 10 m
    faults = [f"level {named}"] * (level_of(wind.level) != level_of(named))
    faults += ["a lead is negative"] * bool((wind.leads < 0).any())
    forecasts = wind.error is not None and wind.error.forecast_sd.any() and settings["source"] != "sample"
    if forecasts and len(wind.times) > 1 and not wind.level.endswith("depth"):
        faults += ["a lead is not known"] * (not np.isfinite(wind.leads).all())
    faults += ["leads of calm air"] * bool(wind.fit is None and np.isfinite(wind.leads).any())
    return no_fault(f"{wind.level}, {np.isfinite(wind.leads).sum()} leads", faults)


def forecast_error(result: Evidence) -> Verdict | None:
    """The law of forecast errors is wind.forecast_error, scaled to the winds' spread at the level."""
    wind = result.wind
    if wind.fit is None or wind.error is None:
        return same("no law" if wind.error is None else "a law", "no law" if wind.fit is None else "a law")
    name = _named_law(result)
    path = PACKAGED_LAW if name in ("none", "gfs") else Path(name).expanduser()
    if not path.is_file():
        return None
    law = error_law(read_json(path))
    faults = _law_faults(result, wind.error, law, wind.fit)
    wrong = name != "none" and bool(law.forecast_sd.any())
    if not result.has_ensemble:
        faults += ["whether forecasts have errors"] * (wrong != bool(wind.error.forecast_sd.any()))
    return no_fault(f"{name}, level {wind.error.level}", faults)


def _named_law(result: Evidence) -> str:
    """The law that wind.forecast_error names; for auto without a law of the source, the law in wind.nc."""
    settings, law = result.settings["wind"], result.wind.error
    source_law = "gfs" if law is not None and law.forecast_sd.any() else "none"
    usual = source_of(settings["source"]).law or source_law
    return usual if settings["forecast_error"] == "auto" else str(settings["forecast_error"])


def _law_faults(result: Evidence, stated: ErrorLaw, law: ErrorLaw, fit: Fit) -> list[str]:
    """Numbers that differ from the law's file; with an ensemble, forecast deviations may be smaller."""
    factor, faults = 1.0, []
    if result.wind.level != law.level:
        factor = stated.spread / law.spread
        spread = math.sqrt(float(np.mean([winds.var(axis=0).mean() for winds in fit.winds])))
        uncut = result.horizon is not None and result.wind.times[-1] < result.horizon
        faults += [f"spread {spread:.4g} m/s"] * (not close(stated.spread, spread, 1e-6 if uncut else 0.5))
    numbers = ("persistence", "persistence_time", "forecast_length", "change_length")
    faults += [name for name in numbers if not close(getattr(stated, name), getattr(law, name), 1e-9)]
    scaled = 1.0 if stated.scaled is None else math.sqrt(stated.scaled.factor)
    tables = {"leads": 1.0, "lags": 1.0, "change_sd": factor * scaled}
    faults += [
        name
        for name, times in tables.items()
        if not _alike(getattr(stated, name), times * getattr(law, name))
    ]
    wanted = factor * law.forecast_sd if stated.forecast_sd.any() else np.zeros(len(law.forecast_sd))
    share = stated.forecast_sd.max(initial=0.0) / max(wanted.max(initial=0.0), 1e-300)
    if result.has_ensemble and share < 1:
        wanted = share * wanted
    faults += ["forecast_sd"] * (not _alike(stated.forecast_sd, wanted))
    faults += ["level"] * (stated.level != result.wind.level)
    return faults


def variability(result: Evidence) -> Verdict | None:
    """The factor of D(τ) follows from the changes between analyses; the changes of slots are in wind.nc.

    Successive analyses among the slots, at the same places, must be among the pairs.
    """
    wind, settings = result.wind, result.settings["wind"]
    law, fit = wind.error, wind.fit
    if law is None or fit is None:
        return None
    own = [k for k in np.flatnonzero(wind.leads == 0) if np.array_equal(fit.points[k], fit.points[0])]
    within = {
        (float(wind.times[j]), float(wind.times[k])): float(((fit.winds[k] - fit.winds[j]) ** 2).mean())
        for j, k in itertools.pairwise(own)
        if law.lags[0] - 1 <= wind.times[k] - wind.times[j] <= law.lags[-1] + 1
    }
    modelled = settings["source"] not in ("sample", "stations") and not wind.level.endswith("depth")
    if (stated := law.scaled) is None:
        return no_fault("law as it is", ["analyses are not used"] * bool(within and modelled))
    listed = {
        (float(a), float(b)): float(square)
        for (a, b), square in zip(stated.pairs, stated.squares, strict=True)
    }
    faults = ["the source has no analyses"] * (not modelled)
    faults += [
        f"change from {a:g} s" for (a, b), m in within.items() if not close(listed.get((a, b), -1.0), m)
    ]
    plain = replace(law, change_sd=law.change_sd / math.sqrt(stated.factor))
    places = correlation("matern32", separation(fit.points[0], fit.points[0]) / law.change_length)
    freedom = independent_changes(plain, stated.pairs, places)
    ratio = float(np.mean([m / plain.change_variance(b - a) for (a, b), m in listed.items()]))
    computed = min(max((LAW_WEIGHT + freedom * ratio) / (LAW_WEIGHT + freedom), LEAST_FACTOR), MOST_FACTOR)
    faults += [f"freedom {freedom:.4g}"] * (not close(stated.freedom, freedom, 1e-6))
    faults += [f"factor {computed:.4g}"] * (not close(stated.factor, computed, 1e-6))
    return no_fault(f"D times {stated.factor:.3g}", faults)


def _alike(stated: FloatArray, computed: FloatArray) -> bool:
    return stated.shape == computed.shape and bool(np.allclose(stated, computed, rtol=1e-9, atol=1e-12))


def wind_metrics(result: Evidence) -> Verdict:
    """The metrics of the wind follow from wind.nc."""
    wind, metrics = result.wind, result.metrics
    pairs = dict(wind.score)
    if "wind_speed_m_s" in metrics:  # runs of earlier versions have none
        pairs["wind_speed_m_s"] = np.hypot(wind.mean[..., 0], wind.mean[..., 1]).mean()
        pairs["wind_sd_m_s"] = math.sqrt(wind.latent.mean() + wind.gust.mean())
    if wind.modes is not None:
        pairs |= {
            "wind_modes": wind.modes.psi.shape[-1],
            "wind_energy": wind.modes.energy.mean(),
            "wind_rho": wind.modes.rho,
        }
    faults = [name for name, value in pairs.items() if not _is_metric(metrics[name], float(value))]
    return no_fault(", ".join(pairs)[:44] or "none", faults)


def _is_metric(stated: float | None, computed: float) -> bool:
    """Whether ``stated`` of metrics.json is the number ``computed``; NaN is null there."""
    return math.isnan(computed) if stated is None else close(stated, computed)


CLAIMS = (
    *(
        Claim(f"wind: {name}", ("wind.nc",), judge)
        for name, judge in (
            ("there are readings, or the air is calm", has_fit),
            ("source of the settings", calm_air),
            ("mean and variance are the posterior", posterior_field),
            ("prior mean, noise and kernel", prior),
            ("white variance", gusts),
            ("lattice, slots and settings", lattice),
            ("known until", known_until),
            ("level and leads", level_and_leads),
            ("law of forecast errors", forecast_error),
            ("variability of the wind", variability),
            ("metrics", wind_metrics),
        )
    ),
    *MODE_CLAIMS,
)
