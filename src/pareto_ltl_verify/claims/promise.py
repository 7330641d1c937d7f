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
    told = result.plan["promise"]
    if not flights_judge(result) or after_alarm(result):
        return same(told, None)
    faults = [*_rate_faults(result, told), *_claim_faults(result, told)]
    costs = result.plan["objectives"]
    pairs = {
        "bound": min(1.0, costs["mission_risk"] + costs["collision_risk"]),
        "linearity": _linearity(result),
        "passed": float(stands(told)),
    }
    faults += [f"{key} {told[key]} is {v:.6g}" for key, v in pairs.items() if not close(told[key], v, SPREAD)]
    return no_fault(f"{told['failure']:.4g} of {told['runs']} flights fail", faults)


def after_alarm(result: Evidence) -> bool:
    """Whether the plan was made during a flight, after a measurement that its law does not explain."""
    return result.has("replan.json") and bool(read_json(result.directory / "replan.json").get("alarms"))


def _rate_faults(result: Evidence, told: dict[str, Any]) -> Iterator[str]:
    wanted = (result.planned_law, result.settings["selection"]["runs"])
    if (told["law"], told["runs"]) != wanted or told["method"] not in CHANCES:
        yield f"{told['runs']} {told['method']} in {told['law']} winds"
        return
    if told["method"] == WEIGHTED:  # the weights are not stored
        if not 0.0 <= told["low"] <= told["failure"] <= told["high"] <= 1.0:
            yield f"the interval is {told['low']:.4g} to {told['high']:.4g}"
        most = math.ceil(WEIGHTED_BELOW * told["runs"]) - 1
        if binom.cdf(most, told["runs"], told["low"]) < RARE:
            yield f"more than {most} of {told['runs']} flights fail at {told['low']:.4g}: no case for weights"
        return
    count = round(told["failure"] * told["runs"])
    found = (count / told["runs"], *clopper_pearson(count, told["runs"]))
    said = (told["failure"], told["low"], told["high"])
    if not all(close(a, b, 1e-9, 1e-12) for a, b in zip(said, found, strict=True)):
        yield f"the interval is {found[1]:.4g} to {found[2]:.4g}"


def _claim_faults(result: Evidence, told: dict[str, Any]) -> Iterator[str]:
    """The claim is the rate of the plan's row of the front."""
    columns = dict(zip(RATE, ("failure", "failure_low", "failure_high", "runs", "law"), strict=False))
    rows = [row for k, row in enumerate(result.front) if np.array_equal(result.front_x(k), result.x)]
    said = [str(told["claimed"][key]) for key in columns]
    if [[row[name] for name in columns.values()] for row in rows] != [said]:
        yield f"the claim {told['claimed']['failure']:.4g} is not in the front"


def stands(told: dict[str, Any]) -> bool:
    """Whether the claimed rate is not significantly lower than the rate of the new flights."""
    return bool(CHANCES[told["method"]](told, told["claimed"]) >= DOUBT)


def _count(told: dict[str, Any]) -> int:
    return round(float(told["failure"]) * int(told["runs"]))


def _among_flights(told: dict[str, Any], claimed: dict[str, Any]) -> float:
    """Fisher's exact test of two counts, one-sided."""
    both = hypergeom(told["runs"] + claimed["runs"], _count(told) + _count(claimed), told["runs"])
    return float(both.sf(_count(told) - 1))


def _of_claim(told: dict[str, Any], claimed: dict[str, Any]) -> float:
    """p value of the claim's failures, or fewer, at the lower end of the interval of weighted flights."""
    return float(binom.cdf(_count(claimed), claimed["runs"], told["low"]))


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
    told = result.plan["promise"]
    if not told or told["law"] not in result.new_flights:
        return None
    x = result.new_flights[told["law"]]
    old = result.flights[f"{told['law']}/x"]
    again = int(result.ground.failed(np.concatenate([x, old])).sum())
    runs = len(x) + len(old)
    if told["method"] == WEIGHTED:
        ends = binom.sf(again - 1, runs, told["high"]), binom.cdf(again, runs, told["low"])
        chance = min(1.0, 2 * float(min(ends)))
    else:
        chance = same_rate(_count(told), told["runs"], again, runs)
    return Verdict(f"{told['failure']:.4g}", f"{again} of {runs}, chance {chance:.1g}", chance >= RARE)


def models(result: Evidence) -> Verdict:
    """The models of the plan agree with the settings."""
    told = {key: value for key, value in result.settings["fidelity"].items() if key != "name"}
    return same(result.plan["models"], told)


# --- for a pilot ------------------------------------------------------------------------------


def airspeeds(result: Evidence) -> Verdict:
    """The airspeed of each step is the length of its control."""
    said, found = np.array(result.plan["airspeed"], float), np.linalg.norm(result.u, axis=1)
    faults = [] if said.shape == found.shape else [f"{len(said)} airspeeds"]
    if not faults:
        faults = [f"step {t}" for t in np.flatnonzero(np.abs(said - found) > 1e-9 * (1 + found))]
    return no_fault(f"{len(said)} steps", faults)


def clock_times(result: Evidence) -> Verdict:
    """Times in UTC count from the departure of the map."""
    zero, told = result.scene["time_zero"], result.plan["time_utc"]
    if zero is None or told is None:
        return same(told, zero)
    begin, *rest = (datetime.fromisoformat(text) for text in (zero, *told))
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    faults = [f"{len(rest)} times"] * (len(rest) != len(result.plan["t"]))
    faults += [
        f"step {t}"
        for t, (time, seconds) in enumerate(zip(rest, result.plan["t"], strict=False))
        if abs((time - begin).total_seconds() - seconds) > 1e-5
    ]
    return no_fault(f"{told[0]} to {told[-1]}", faults)


def places(result: Evidence) -> Verdict:
    """Longitudes, latitudes and headings follow from the plane positions and the controls."""
    plan, crs = result.plan, result.scene["crs"]
    if crs is None or plan["crs"] != crs:
        return same([plan[key] for key in ("crs", "lat", "lon", "heading_true")], [crs] * 4)
    from pyproj import Geod, Transformer

    back = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    lon, lat = back.transform(*result.x.T)
    said = np.array([plan["lon"], plan["lat"]], float)
    if said.shape != (2, len(lon)):
        return same(said.shape, (2, len(lon)))
    faults = [f"step {t}: position" for t in np.flatnonzero(np.abs(said - [lon, lat]).max(axis=0) > PLACE)]
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
