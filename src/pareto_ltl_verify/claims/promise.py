"""Claims about the promised failure rate, and about the plan's headings, airspeeds and clock times."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import numpy as np
from scipy.stats import binom, hypergeom

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.reading import read_json
from pareto_ltl_verify.claims.front import flights_judge
from pareto_ltl_verify.claims.plan import SPREAD, WEIGHTED
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault, same
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE, clopper_pearson, same_rate

DOUBT = 1e-3  # significance level: probability that the flights reject a claim that is true
WEIGHTED_BELOW = 1e-3  # share of failed flights below which flights are weighted
PLACE, ANGLE = 1e-9, 1e-3  # [deg] largest allowed difference of two coordinates and of two headings
AHEAD = 1.0  # [m] distance from a position to the second point that gives the heading there
RATE = ("failure", "low", "high", "runs", "law", "method")


def promise(result: Evidence) -> Verdict | None:
    """With judge=flights: rate, interval, claim, bound and verdict agree with each other and the settings."""
    stated = result.plan["promise"]
    if not flights_judge(result) or after_alarm(result):
        return same(stated, None)
    faults = [*_rate_faults(result, stated), *_claim_faults(result, stated)]
    costs = result.plan["objectives"]
    pairs = {
        "bound": min(1.0, costs["mission_risk"] + costs["collision_risk"]),
        "linearity": _linearity(result),
        "passed": float(stands(stated)),
    }
    faults += [
        f"{key} {stated[key]} is {v:.6g}" for key, v in pairs.items() if not close(stated[key], v, SPREAD)
    ]
    return no_fault(f"{stated['failure']:.4g} of {stated['runs']} flights fail", faults)


def after_alarm(result: Evidence) -> bool:
    """Whether the plan was made during a flight, after a measurement that its law does not explain."""
    return result.has("replan.json") and bool(read_json(result.directory / "replan.json").get("alarms"))


def _rate_faults(result: Evidence, stated: dict[str, Any]) -> Iterator[str]:
    wanted = (result.planned_law, result.settings["selection"]["runs"])
    if (stated["law"], stated["runs"]) != wanted or stated["method"] not in CHANCES:
        yield f"{stated['runs']} {stated['method']} in {stated['law']} winds"
        return
    if stated["method"] == WEIGHTED:  # the weights are not stored
        if not 0.0 <= stated["low"] <= stated["failure"] <= stated["high"] <= 1.0:
            yield f"the interval is {stated['low']:.4g} to {stated['high']:.4g}"
        limit = math.ceil(WEIGHTED_BELOW * stated["runs"]) - 1
        if binom.cdf(limit, stated["runs"], stated["low"]) < RARE:
            share = f"{limit} of {stated['runs']} flights fail at {stated['low']:.4g}"
            yield f"more than {share}: no case for weights"
        return
    count = round(stated["failure"] * stated["runs"])
    computed = (count / stated["runs"], *clopper_pearson(count, stated["runs"]))
    interval = (stated["failure"], stated["low"], stated["high"])
    if not all(close(a, b, 1e-9, 1e-12) for a, b in zip(interval, computed, strict=True)):
        yield f"the interval is {computed[1]:.4g} to {computed[2]:.4g}"


def _claim_faults(result: Evidence, stated: dict[str, Any]) -> Iterator[str]:
    """The claim is the rate of the plan's row of the front."""
    columns = dict(zip(RATE, ("failure", "failure_low", "failure_high", "runs", "law"), strict=False))
    rows = [row for k, row in enumerate(result.front) if np.array_equal(result.front_x(k), result.x)]
    claim = [str(stated["claimed"][key]) for key in columns]
    if [[row[name] for name in columns.values()] for row in rows] != [claim]:
        yield f"the claim {stated['claimed']['failure']:.4g} is not in the front"


def stands(stated: dict[str, Any]) -> bool:
    """Whether the claimed rate is not significantly lower than the rate of the new flights."""
    return bool(CHANCES[stated["method"]](stated, stated["claimed"]) >= DOUBT)


def _count(stated: dict[str, Any]) -> int:
    return round(float(stated["failure"]) * int(stated["runs"]))


def _among_flights(stated: dict[str, Any], claimed: dict[str, Any]) -> float:
    """Fisher's exact test of two counts, one-sided."""
    both = hypergeom(stated["runs"] + claimed["runs"], _count(stated) + _count(claimed), stated["runs"])
    return float(both.sf(_count(stated) - 1))


def _of_claim(stated: dict[str, Any], claimed: dict[str, Any]) -> float:
    """p value of the claim's failures, or fewer, at the lower end of the interval of weighted flights."""
    return float(binom.cdf(_count(claimed), claimed["runs"], stated["low"]))


CHANCES = {"flights": _among_flights, WEIGHTED: _of_claim}  # by method


def _linearity(result: Evidence) -> float:
    """Largest ratio of the position's standard deviation to the shorter length scale of its slot."""
    modes = result.wind.modes
    if modes is None or len(result.x) < 2:
        return 0.0
    widest = np.sqrt(np.linalg.eigvalsh(result.course.cov[:-1])[:, 1])
    scale: FloatArray = modes.length.min(axis=1)[result.times.nearest[: len(widest)]]
    return float((widest / scale).max())


def promised_rate(result: Evidence) -> Verdict | None:
    """The promised rate agrees with new flights, and with the run's flights of the finished plan."""
    stated = result.plan["promise"]
    if not stated or stated["law"] not in result.new_flights:
        return None
    x = result.new_flights[stated["law"]]
    old = result.flights[f"{stated['law']}/x"]
    again = int(result.ground.failed(np.concatenate([x, old])).sum())
    runs = len(x) + len(old)
    if stated["method"] == WEIGHTED:
        ends = binom.sf(again - 1, runs, stated["high"]), binom.cdf(again, runs, stated["low"])
        chance = min(1.0, 2 * float(min(ends)))
    else:
        chance = same_rate(_count(stated), stated["runs"], again, runs)
    return Verdict(f"{stated['failure']:.4g}", f"{again} of {runs}, chance {chance:.1g}", chance >= RARE)


def models(result: Evidence) -> Verdict:
    """The models of the plan agree with the settings."""
    settings = {key: value for key, value in result.settings["fidelity"].items() if key != "name"}
    return same(result.plan["models"], settings)


# --- for a pilot ------------------------------------------------------------------------------


def airspeeds(result: Evidence) -> Verdict:
    """The airspeed of each step is the length of its control."""
    stated, computed = np.array(result.plan["airspeed"], float), np.linalg.norm(result.u, axis=1)
    faults = [] if stated.shape == computed.shape else [f"{len(stated)} airspeeds"]
    if not faults:
        faults = [f"step {t}" for t in np.flatnonzero(np.abs(stated - computed) > 1e-9 * (1 + computed))]
    return no_fault(f"{len(stated)} steps", faults)


def clock_times(result: Evidence) -> Verdict:
    """Times in UTC count from the departure of the map."""
    zero, stated = result.scene["time_zero"], result.plan["time_utc"]
    if zero is None or stated is None:
        return same(stated, zero)
    begin, *rest = (datetime.fromisoformat(text) for text in (zero, *stated))
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    faults = [f"{len(rest)} times"] * (len(rest) != len(result.plan["t"]))
    faults += [
        f"step {t}"
        for t, (time, seconds) in enumerate(zip(rest, result.plan["t"], strict=False))
        if abs((time - begin).total_seconds() - seconds) > 1e-5
    ]
    return no_fault(f"{stated[0]} to {stated[-1]}", faults)


def places(result: Evidence) -> Verdict:
    """Longitudes, latitudes and headings follow from the plane positions and the controls."""
    plan, crs = result.plan, result.scene["crs"]
    if crs is None or plan["crs"] != crs:
        return same([plan[key] for key in ("crs", "lat", "lon", "heading_true")], [crs] * 4)
    from pyproj import Geod, Transformer

    back = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    lon, lat = back.transform(*result.x.T)
    stated = np.array([plan["lon"], plan["lat"]], float)
    if stated.shape != (2, len(lon)):
        return same(stated.shape, (2, len(lon)))
    faults = [f"step {t}: position" for t in np.flatnonzero(np.abs(stated - [lon, lat]).max(axis=0) > PLACE)]
    speed = np.maximum(np.linalg.norm(result.u, axis=1, keepdims=True), 1e-12)
    ahead = result.x[:-1] + AHEAD * result.u / speed
    azimuth = Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], *back.transform(*ahead.T))[0]
    heading = np.array(plan["heading_true"], float)  # null becomes NaN
    gap = np.abs((heading - azimuth + 180.0) % 360.0 - 180.0)
    wrong = np.where(result.u.any(axis=1), ~(gap <= ANGLE), ~np.isnan(heading))
    faults += [f"step {t}: heading {heading[t]:.4g} is {azimuth[t] % 360:.4g}" for t in np.flatnonzero(wrong)]
    return no_fault(f"{len(lon)} positions", faults)


FRONT = ("front.csv", "front.npz", "plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
CLAIMS = (
    Claim("plan: promise by flights", FRONT, promise),
    Claim("plan: promised rate", ("deployments.npz", *FRONT), promised_rate),
    Claim("plan: models", ("plan.json",), models),
    Claim("plan: airspeed of each step", ("plan.json",), airspeeds),
    Claim("plan: times in UTC", ("plan.json", "scene.json"), clock_times),
    Claim("plan: positions and headings on Earth", ("plan.json", "scene.json"), places),
)
