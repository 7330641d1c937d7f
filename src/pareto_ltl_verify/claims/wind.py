"""Claims about the wind field: the posterior at its nodes, its forecasts, its time and its settings."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from careful_io.fingerprints import SOURCES
from careful_io.reading import read_json
from pareto_ltl_verify import wind_fit, wind_law
from pareto_ltl_verify.arrays import FloatArray, IntArray
from pareto_ltl_verify.claims import Claim, Verdict, close, far_apart, no_fault, same, true_of, within
from pareto_ltl_verify.claims.readings import models_of
from pareto_ltl_verify.claims.wind_modes import CLAIMS as MODE_CLAIMS
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import on_earth
from pareto_ltl_verify.wind_fit import Fit
from pareto_ltl_verify.wind_law import HOUR, VERSION_1, ErrorLaw
from pareto_ltl_verify.wind_tables import WindFile, level_of

LAWS = SOURCES / "wind_laws" / "data"
FIRST_LAW, PACKAGED = LAWS / "gfs.json", {path.stem: path for path in (LAWS / "parts").glob("*.json")}
LAWS_OF_MODELS = {"edzw": "icon_eu", "ecmf": "ecmwf_class", "kwbc 83": "hourly_fine"}  # centre, process
MOST_NODES = 4000  # limit of the number of nodes of a slot at which the posterior is computed
LAW_WEIGHT = 10.0  # degrees of freedom of a law in the factor of D, if it states none
FEWEST_PLACES, LONGEST_PAIR = 10, 1e6  # readings, and [m] between two of them, for the spread of the winds
LEAST_FACTOR, MAX_FACTOR = 0.25, 4.0
CLEAR = 2e-6  # largest allowed error of a posterior, as a share of the prior's standard deviation


def has_fit(result: Evidence) -> Verdict:
    """wind.nc names the readings from which it was fitted, and only calm air has none."""
    wind = result.wind
    found = "none" if wind.fit is None else f"{sum(map(len, wind.fit.points))} readings"
    return Verdict("readings or calm air", found, _is_calm(wind) == (wind.fit is None))


def _is_calm(wind: WindFile) -> bool:
    return not (wind.mean.any() or wind.latent.any() or wind.gust.any())


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
    wind = result.wind
    if (fit := wind.fit) is None:
        return None
    chosen, nodes = _node_table(wind)
    factor, worst = fit.factor(nodes), 0.0
    forecast = np.zeros(len(wind.times)) if wind.error is None else wind.error.forecast_variance(wind.leads)
    for k in range(len(wind.times)):
        for c in (0, 1):
            _, sd, _, noise = map(float, fit.hyper[k, c])
            mean, V = wind_fit.posterior(fit, k, c, nodes)
            plain = np.maximum(sd**2 - (V * V).sum(axis=0), 0.0)
            more = (
                wind.latent[k, ..., c].ravel()[chosen] - wind_fit.scaled(plain, noise, factor) - forecast[k]
            )
            off = np.maximum(-more, 0.0) if result.has_ensemble else np.abs(more)
            gap = np.abs(wind.mean[k, ..., c].ravel()[chosen] - mean)
            worst = max(worst, float(gap.max()) / (sd + noise), float(off.max()) / (sd + noise) ** 2)
    return within(f"{len(wind.times)} slots, {len(nodes)} nodes", worst, CLEAR)


def prior(result: Evidence) -> Verdict | None:
    """The prior mean is the readings' mean, noise at least wind.noise_min; all slots share the scales."""
    settings = result.settings["wind"]
    if (fit := result.wind.fit) is None:
        return None
    faults = {"scales differ": (fit.hyper[..., 1:] != fit.hyper[0, 0, 1:]).any()}
    faults["kernel"] = fit.kernel != settings["kernel"]
    for k, (winds, hyper) in enumerate(zip(fit.winds, fit.hyper, strict=False)):
        least = hyper[:, 3].min() < settings["noise_min"] * (1 - 1e-3) or hyper[:, 1:3].min() <= 0
        faults[f"slot {k}: scales"] = least
        alike = np.allclose(hyper[:, 0], winds.mean(axis=0), rtol=1e-6, atol=1e-9)
        faults[f"slot {k}: prior mean"] = not alike
    return no_fault(f"{len(fit.winds)} slots of readings", faults)


def gusts(result: Evidence) -> Verdict | None:
    """The white variance is the variance of the noise of the readings."""
    if (fit := result.wind.fit) is None:
        return None
    worst = float(np.abs(result.wind.gust / fit.hyper[..., 3] ** 2 - 1).max())
    return within("noise of the readings", worst, 1e-6)


def lattice(result: Evidence) -> Verdict:
    """The nodes are evenly spaced and cover the map, times increase, and variances are not negative."""
    (low, high), wind, faults = np.array(result.scene["bounds"]), result.wind, dict[str, object]()
    for c, nodes in enumerate((wind.x, wind.y)):
        gaps = np.diff(nodes)
        faults[f"{'xy'[c]} is uneven"] = not np.allclose(gaps, gaps[0], rtol=1e-6)
        faults[f"{'xy'[c]} ends within the map"] = nodes[0] > low[c] + 1 or nodes[-1] < high[c] - 1
    stated = result.settings["wind"]["gust_time"]
    faults |= {
        "times do not increase": (np.diff(wind.times) <= 0).any(),
        "a variance is negative": wind.latent.min() < 0 or wind.gust.min() < 0,
        "gust_time": wind.fit is not None and wind.gust_time != stated,
    }
    return no_fault(f"{len(wind.x)} x {len(wind.y)} nodes, {len(wind.times)} slots", faults)


def known_until(result: Evidence) -> Verdict:
    """Slots begin at departure, no gap exceeds wind.max_gap, and the wind is known until the last slot.

    With wind.hold_last it is known for wind.max_gap longer.
    """
    wind, settings, last = result.wind, result.settings["wind"], float(result.wind.times[-1])
    if wind.fit is None:
        return same(wind.until, math.inf)
    gap, widest = settings["max_gap"] * HOUR, float(np.diff(wind.times).max(initial=0.0))
    ends = [last + gap * settings["hold_last"]]
    if result.horizon is None or last >= result.horizon:  # later slots are left out
        ends.append(last)
    faults = {
        "slots begin after departure": wind.times[0] > 1e-6,
        "slots before departure": (wind.times[1:] < -1e-6).any(),
        f"a gap of {widest / HOUR:g} h": widest > gap + 1,
        f"it ends at {ends[0] / HOUR:g} h": not any(close(wind.until, end, 1e-9) for end in ends),
    }
    return no_fault(f"{wind.until / HOUR:g} h", faults)


def level_and_leads(result: Evidence) -> Verdict:
    """The level agrees with the settings, or is 10 m for the sample; no lead time is negative.

    Where forecasts have errors, each of several fields has a lead, except in the sample.
    """
    wind, settings = result.wind, result.settings["wind"]
    source = settings["source"]
    named = "10m" if source == "sample" else wind.level
    if result.source_row.level:
        named = str(settings["level"])
        tables_of_before = source in ("csv", "stations") and wind.level == "10m"
        if tables_of_before and named == result.settings["robot"].get("level"):
            named = "10m"  # versions before 1.0 set wind.level to robot.level and read such tables as 10 m
    known, several = np.isfinite(wind.leads), len(wind.times) > 1
    forecasts = wind.error is not None and wind.error.parts and source != "sample"
    faults = {
        f"level {named}": level_of(wind.level) != level_of(named),
        "a lead is negative": (wind.leads < 0).any(),
        "a lead is not known": forecasts and several and not known.all(),
        "leads of calm air": _is_calm(wind) and known.any(),
    }
    return no_fault(f"{wind.level}, {known.sum()} leads", faults)


def forecast_error(result: Evidence) -> Verdict | None:
    """The law of forecast errors is wind.forecast_error, scaled to the winds' spread at the level."""
    wind = result.wind
    if wind.fit is None or wind.error is None:
        return same("no law" if wind.error is None else "a law", "no law" if wind.fit is None else "a law")
    name = _named_law(result, wind.error)
    path = _law_file(name, wind.error)
    if not path.is_relative_to(LAWS) and not result.is_input(path):
        return None
    law = wind_law.error_law(read_json(path))
    wrong = name != "none" and bool(law.parts)
    faults = {
        "whether forecasts have errors": not result.has_ensemble and wrong != bool(wind.error.parts),
        f"the law {wind.error.name}": wind.error.name != ("none" if name == "none" else law.name),
        **{key: wind.error.facts[key] != value for key, value in law.facts.items()},
        "floor": not close(wind.error.floor or 0.0, law.floor or 0.0, least=1e-6),
    }
    return no_fault(
        f"{name}, level {wind.error.level}", faults, _law_faults(result, wind.error, law, wind.fit)
    )


def _named_law(result: Evidence, stated: ErrorLaw) -> str:
    """The law that wind.forecast_error names; for auto without a law of the source, the law in wind.nc.

    With auto, the model of GRIB files decides; of files that are not read once more, the law in wind.nc.
    """
    settings = result.settings["wind"]
    row, named = result.source_row, str(settings["forecast_error"])
    if named != "auto":
        return named
    if level_of(result.wind.level)[0] == "depth" and row.law != "none":
        return "currents"
    if not row.names_model:
        hourly = settings["source"] == "noaa" and settings.get("model") == "hrrr"
        return "hourly_fine" if hourly else row.law or ("gfs" if stated.parts else "none")
    if (models := models_of(result)) is None:
        return stated.name if stated.name in PACKAGED else "gfs"
    laws = {LAWS_OF_MODELS.get(model, LAWS_OF_MODELS.get(model.split()[0], "gfs")) for model in models}
    return laws.pop() if len(laws) == 1 else "gfs"


def _law_file(name: str, stated: ErrorLaw) -> Path:
    """The file of the law ``name``: a packaged one, or another."""
    first = stated.facts["schema"] == VERSION_1  # "gfs" in earlier versions of the program
    if (first and name in PACKAGED) or name in ("none", "gfs_one_part"):
        return FIRST_LAW
    return PACKAGED.get(name, Path(name).expanduser())


def _law_faults(result: Evidence, stated: ErrorLaw, law: ErrorLaw, fit: Fit) -> list[str]:
    """Numbers that differ from the law's file; with an ensemble, forecast deviations may be smaller."""
    wind, factor, spread, rel = result.wind, 1.0, stated.spread, 1e-6
    if wind.level != law.level:
        factor = stated.spread / law.spread
        spread = math.sqrt(float(np.mean([winds.var(axis=0).mean() for winds in fit.winds])))
        uncut = result.horizon is not None and wind.times[-1] < result.horizon
        rel = 1e-6 if uncut else 0.5
    scale = 1.0 if stated.scaled is None else math.sqrt(stated.scaled.factor)
    largest = [max((part.sd.max() for part in each.parts), default=0.0) for each in (stated, law)]
    share = largest[0] / max(factor * largest[1], 1e-300)
    share = min(share, 1.0) if result.has_ensemble else 1.0
    used = law if stated.parts else replace(law, parts=())  # whether there may be none is judged apart
    change = scale if law.of_winds is not None else scale * factor
    wanted, numbers = used.times(share * factor, change).numbers(), stated.numbers()
    other = {
        f"spread {spread:.4g} m/s": not close(stated.spread, spread, rel),
        "level": stated.level != wind.level,
        "parts": set(numbers) != set(wanted),
    }
    return [*true_of(other), *(key for key in wanted if not _alike(numbers.get(key), wanted[key]))]


def variability(result: Evidence) -> Verdict | None:
    """The factor of D(τ) follows from the spread of the first winds and from changes between analyses.

    Successive analyses among the slots, at the same places, must be among the pairs.
    """
    wind, law, fit = result.wind, result.wind.error, result.wind.fit
    if law is None or fit is None:
        return None
    own = [k for k in np.flatnonzero(wind.leads == 0) if np.array_equal(fit.points[k], fit.points[0])]
    among = {
        (float(wind.times[j]), float(wind.times[k])): float(((fit.winds[k] - fit.winds[j]) ** 2).mean())
        for j, k in pairwise(own)
        if law.lags[0] - 1 <= wind.times[k] - wind.times[j] <= law.lags[-1] + 1
    }
    modelled = result.source_row.modelled and not wind.level.endswith("depth")
    if (stated := law.scaled) is None:
        unused = among and modelled
        return no_fault(
            "law as it is",
            {"analyses are not used": unused, "winds are not used": law.of_winds is not None},
        )
    listed = dict(zip(map(tuple, stated.pairs.tolist()), stated.squares.tolist(), strict=True))
    rule = law.of_winds
    spread = None if rule is None else _spread_near(fit)
    expected = 1.0 if rule is None else rule.expected(stated)
    prior = LAW_WEIGHT if rule is None else rule.freedom
    wanted: dict[str, float] = {"freedom": 0.0, "factor": expected}
    if listed:
        plain = law.times(1.0, 1.0 / math.sqrt(stated.factor))
        apart = wind_fit.separation(fit.points[0], fit.points[0])
        places = wind_fit.correlation("matern32", apart / law.change_length)
        freedom = wind_law.independent_changes(plain, stated.pairs, places)
        weight = freedom if rule is None else rule.counted(freedom)
        ratio = float(np.mean([m / plain.change_variance(b - a) for (a, b), m in listed.items()])) / expected
        factor = min(max((prior + weight * ratio) / (prior + weight), LEAST_FACTOR), MAX_FACTOR)
        wanted = {"freedom": freedom, "factor": expected * factor}
    said = {"freedom": stated.freedom, "factor": stated.factor}
    if spread is not None and stated.spread is not None:
        wanted["spread"], said["spread"] = spread, stated.spread
    latitude = _latitude_of(result) if rule is not None else None
    return no_fault(
        f"D times {stated.factor:.3g}",
        {
            "the source has no analyses": bool(listed) and modelled is False,
            "spread": (spread is None) != (stated.spread is None),
            "latitude": not _is_latitude(stated.latitude, latitude, result.source_row.planar),
        },
        (f"change from {a:g} s" for (a, b), m in among.items() if not close(listed.get((a, b), -1.0), m)),
        far_apart(said, wanted),
    )


def _latitude_of(result: Evidence) -> float | None:
    """Latitude of the middle of the map [deg]; None without a position on Earth."""
    crs, bounds = result.scene.get("crs"), np.array(result.scene["bounds"], float)
    return None if crs is None else float(on_earth(str(crs), bounds.mean(axis=0)[None])[1, 0])


def _is_latitude(stated: float | None, latitude: float | None, planar: bool) -> bool:
    if stated is None or latitude is None:
        return stated is latitude or (stated is None and planar)
    return abs(stated - latitude) < 1e-6


def _spread_near(fit: Fit) -> float | None:
    """Standard deviation of a component over pairs of the first readings at most ``LONGEST_PAIR`` apart."""
    points, winds = fit.points[0], fit.winds[0]
    if len(points) < FEWEST_PLACES:
        return None
    total, count = 0.0, 0
    for k in range(len(points) - 1):
        gap = np.hypot(*(points[k + 1 :] - points[k]).T)
        near = (gap > 0.0) & (gap <= LONGEST_PAIR)
        total += float(((winds[k + 1 :][near] - winds[k]) ** 2).sum())
        count += int(near.sum())
    return math.sqrt(total / count / 4.0) if count else None


def _alike(stated: FloatArray | None, computed: FloatArray) -> bool:
    if stated is None or stated.shape != computed.shape:
        return False
    return bool(np.allclose(stated, computed, rtol=1e-9, atol=1e-12))


def wind_metrics(result: Evidence) -> Verdict:
    """The metrics of the wind follow from wind.nc."""
    wind, metrics, modes = result.wind, result.metrics, result.wind.modes
    wanted = dict(wind.score)
    if "wind_speed_m_s" in metrics:  # runs of earlier versions have none
        wanted["wind_speed_m_s"] = np.hypot(wind.mean[..., 0], wind.mean[..., 1]).mean()
        wanted["wind_sd_m_s"] = math.sqrt(wind.latent.mean() + wind.gust.mean())
    if modes is not None:
        wanted |= {
            "wind_modes": modes.psi.shape[-1],
            "wind_energy": modes.energy.mean(),
            "wind_rho": modes.rho,
        }
    unknown = {name for name, value in wanted.items() if math.isnan(value) and metrics[name] is None}
    known = {name: value for name, value in wanted.items() if name not in unknown}
    return no_fault(", ".join(wanted)[:44] or "none", far_apart(metrics, known, least=0.0))


CLAIMS: tuple[Claim, ...] = (
    Claim("wind: there are readings, or the air is calm", ("wind.nc",), has_fit),
    Claim("wind: source of the settings", ("wind.nc",), calm_air),
    Claim("wind: mean and variance are the posterior", ("wind.nc",), posterior_field),
    Claim("wind: prior mean, noise and kernel", ("wind.nc",), prior),
    Claim("wind: white variance", ("wind.nc",), gusts),
    Claim("wind: lattice, slots and settings", ("wind.nc",), lattice),
    Claim("wind: known until", ("wind.nc",), known_until),
    Claim("wind: level and leads", ("wind.nc",), level_and_leads),
    Claim("wind: law of forecast errors", ("wind.nc",), forecast_error),
    Claim("wind: variability of the wind", ("wind.nc",), variability),
    Claim("wind: metrics", ("wind.nc",), wind_metrics),
    *MODE_CLAIMS,
)
