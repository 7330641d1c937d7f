"""Claims about simulated flights: the promised failure rate, the flights of the results, and new flights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import binom, hypergeom

from pareto_ltl_verify import flights
from pareto_ltl_verify.arrays import BoolArray, FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, far_apart, likely, no_fault, same, within
from pareto_ltl_verify.claims.front import flights_judge
from pareto_ltl_verify.claims.plan import SPREAD, WEIGHTED
from pareto_ltl_verify.evidence import BATCH, LAWS, Evidence
from pareto_ltl_verify.flights import RARE
from pareto_ltl_verify.laws import Independent
from pareto_ltl_verify.rare import least_rate

SEEN = 16.0  # failures that new flights should have: so many contradict a rate told as a much smaller one
MISSED = 1.25  # times the upper end of a promise: weighted flights of both roads are few where failures are
LEAST_RATE = 1e-6  # promises below it are not distinguished: a few flights in a million decide on both roads
MAX_FLIGHTS = 200_000  # new flights of a rare promise at most
DOUBT = 1e-3  # significance level: probability that the flights reject a claim that is true
LEAST_WEIGHTED = 1000  # weighted flights, however few the plain ones
WEIGHTED_BELOW = 1e-3  # share of failed flights below which flights are weighted
RATE = {
    "failure": "failure",
    "low": "failure_low",
    "high": "failure_high",
    "runs": "runs",
    "law": "law",
}  # fmt: skip - what a promise claims, and the columns of the front that have it
LOOKS = 4  # steps at which positions of old and new flights are compared
METRICS = {
    "runs": "runs_{}", "failure": "failure_{}", "low": "failure_{}_low", "high": "failure_{}_high",
    "mission": "mission_failure_{}", "collision": "collision_{}", "off_map": "off_map_{}",
}  # fmt: skip
FLAGS = ("accepted", "collided", "off_map")


# --- the promise ------------------------------------------------------------------------------


def promise(result: Evidence) -> Verdict | None:
    """With judge=flights: rate, interval, claim, bound and verdict agree with each other and the settings."""
    stated, costs = result.plan["promise"], result.plan["objectives"]
    alarmed = result.has("replan.json") and result.replanned.get("alarms")  # no law explains the fixes
    if not flights_judge(result) or alarmed:
        return same(stated, None)
    wanted = {
        "bound": min(1.0, costs["mission_risk"] + costs["collision_risk"]),
        "linearity": _linearity(result),
        "passed": float(stands(stated)),
    }
    least, law = stated.get("floor", 0.0), result.wind.error
    known = law.floor if law is not None and law.parts else None
    return no_fault(
        f"{stated['failure']:.4g} of {stated['runs']} flights fail", _rate_faults(result, stated),
        _claim_faults(result, stated), far_apart(stated, wanted, SPREAD, 0.0),
        {f"rates from {least:.3g} on": not close(least, known or 0.0)},
    )  # fmt: skip


def _rate_faults(result: Evidence, stated: dict[str, Any]) -> Iterator[str]:
    runs = result.settings["selection"]["runs"]
    wanted = (result.planned_law, max(runs, LEAST_WEIGHTED) if stated["method"] == WEIGHTED else runs)
    if (stated["law"], stated["runs"]) != wanted or stated["method"] not in CHANCES:
        yield f"{stated['runs']} {stated['method']} in {stated['law']} winds"
        return
    if stated["method"] == WEIGHTED:  # the weights are not stored
        if not 0.0 <= stated["low"] <= stated["failure"] <= stated["high"] <= 1.0:
            yield f"the interval is {stated['low']:.4g} to {stated['high']:.4g}"
        limit = math.ceil(WEIGHTED_BELOW * runs) - 1
        if binom.cdf(limit, runs, stated["low"]) < RARE:
            share = f"{limit} of {runs} flights fail at {stated['low']:.4g}"
            yield f"more than {share}: no case for weights"
        return
    ends = flights.rate_of(_count(stated), stated["runs"])
    if far_apart(stated, ends, 1e-9):
        yield f"the interval is {ends['low']:.4g} to {ends['high']:.4g}"


def _claim_faults(result: Evidence, stated: dict[str, Any]) -> Iterator[str]:
    """The claim is the rate of the plan's row of the front, where a plan bent for its branches has none."""
    if (method := stated["claimed"].get("method", COUNTED)) != COUNTED:
        yield f"the claim is of {method}"
    if (result.plan.get("branches") or {}).get("bent") is not None:
        return
    rows = [row for k, row in enumerate(result.front) if np.array_equal(result.front_x(k), result.x)]
    claim = {column: str(stated["claimed"][key]) for key, column in RATE.items()}
    if [{column: row[column] for column in claim} for row in rows] != [claim]:
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


COUNTED = "flights"
CHANCES = {COUNTED: _among_flights, WEIGHTED: _of_claim}  # by method


def _linearity(result: Evidence) -> float:
    """Largest ratio of the position's standard deviation to the shorter length scale of its slot."""
    modes = result.wind.modes
    if modes is None or len(result.x) < 2:
        return 0.0
    widest = np.sqrt(np.linalg.eigvalsh(result.course.cov[:-1])[:, 1])
    nearest = result.law(result.planned_law).times.nearest[: len(widest)]
    scale: FloatArray = modes.length.min(axis=1)[nearest]
    return float((widest / scale).max())


def promised_rate(result: Evidence) -> Verdict | None:
    """The promised rate agrees with new flights, and with the run's flights of the finished plan.

    The rarer the promised failures, the more flights: 20,000 do not contradict a rate of 8e-4 told as 1e-6.
    They come in batches, and end with the first that contradicts the promise; of all looks together at most
    :data:`RARE` of honest promises are contradicted. A promise that was made by weighted flights is also
    compared with new weighted ones, which contradict a rate of one in a million that is stated too low.
    """
    stated = result.plan["promise"]
    if not stated or stated["law"] not in result.new_flights:
        return None
    new, old = result.new_failures(stated["law"]), result.flights[f"{stated['law']}/x"]
    failed, runs = int(new.sum()) + int(result.ground.failed(old).sum()), len(new) + len(old)
    more = 0
    if stated["method"] == WEIGHTED:
        wanted = min(SEEN / max(stated["high"], SEEN / MAX_FLIGHTS), MAX_FLIGHTS)
        more = max(math.ceil(wanted) - len(new), 0)
    batches = result.more_failures(stated["law"], more)
    limit = RARE / (1 + math.ceil(more / BATCH))
    while (chance := _chance(stated, failed, runs)) >= limit and (batch := next(batches, None)) is not None:
        failed, runs = failed + batch[0], runs + batch[1]
    found, least = f"{failed} of {runs}, chance {chance:.1g}", 0.0
    if stated["method"] == WEIGHTED and chance >= limit and len(weights := result.rare_failures):
        least = least_rate(weights, RARE)
        found += f"; weighted flights: {weights.mean():.3g}, at least {least:.3g}"
    holds = chance >= limit and MISSED * max(stated["high"], LEAST_RATE) >= least
    return Verdict(f"{stated['failure']:.4g}", found, holds)


def _chance(stated: dict[str, Any], failed: int, runs: int) -> float:
    """The probability of so unlikely a number of failures if the promise is right."""
    if stated["method"] != WEIGHTED:
        return flights.same_rate(_count(stated), stated["runs"], failed, runs)
    ends = binom.sf(failed - 1, runs, stated["high"]), binom.cdf(failed, runs, stated["low"])
    return min(1.0, 2 * float(min(ends)))


# --- flights of the results, new flights ------------------------------------------------------


def flown(law: str, judge: Callable[[Evidence, str], Verdict | None], result: Evidence) -> Verdict | None:
    """Verdict of ``judge`` on the flights under a wind law; None if there are none."""
    return judge(result, law) if f"{law}/x" in result.flights else None


def flown_laws(result: Evidence) -> Verdict:
    """There are deployment.runs flights under every law of deployment.laws, each as long as the plan."""
    runs, laws = result.settings["deployment"]["runs"], result.settings["deployment"]["laws"]
    shapes = {"x": (runs, len(result.u) + 1, 2), "walled": (1,)}
    faults = [f"no flights under {law}" for law in laws if f"{law}/x" not in result.flights]
    for name, array in result.flights.items():
        law, _, key = name.partition("/")
        walls = key == "walled" and bool(array.all()) != result.ground.walled
        if array.shape != shapes.get(key, (runs,)) or law not in laws or walls:
            faults.append(f"{name} {array.shape}")
    return no_fault(f"{runs} flights, {', '.join(laws)}", faults)


def _flags(result: Evidence, law: str) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which flights the results call accepted, collided and off the map."""
    accepted, collided, off_map = (result.flights[f"{law}/{name}"] for name in FLAGS)
    return accepted, collided, off_map


def counts(result: Evidence, law: str) -> Verdict:
    """The rates and the interval in the metrics follow from the flights."""
    computed = flights.rates(*_flags(result, law), result.ground.walled)
    stated = {key: result.metrics[name.format(law)] for key, name in METRICS.items()}
    checked = f"{computed['failure']:.4g} of {computed['runs']:.0f} fail"
    return no_fault(checked, far_apart(stated, computed, 1e-9))


def judged_again(result: Evidence, law: str) -> Verdict:
    """Every flight's verdict follows from its positions: labels, obstacles on segments, the border."""
    x = result.flights[f"{law}/x"]
    wrong = flights.misjudged(result.ground, x, _flags(result, law), 1e-3 * result.grain)
    return Verdict(f"{len(x)} flights", f"{wrong} judged otherwise", wrong == 0)


def starts(result: Evidence, law: str) -> Verdict:
    """Flights begin about the start of the map."""
    gap = np.abs(result.flights[f"{law}/x"][:, 0] - result.start).max()
    sd = result.robot.start_sd + float(np.linalg.norm(result.law(law).errors.start))
    return within("the start", float(gap), 8 * sd + result.grain, " m")


def drawn_winds(result: Evidence, law: str) -> Verdict | None:
    """Under the independent law, the winds of open-loop flights are N(μ, Σ_w) at the robots' positions."""
    model, x = result.law(law), result.flights[f"{law}/x"]
    guided = result.robot.feedback > 0 or result.law("coherent").landmarks
    if guided or not isinstance(model, Independent):
        return None
    return likely("drawn from wind.nc", flights.winds_as_drawn(model, x, result.u), RARE)


def new_positions(result: Evidence, law: str) -> Verdict:
    """Positions are distributed like the positions of new flights."""
    old, new = result.flights[f"{law}/x"], result.new_flights[law]
    steps = np.unique(np.linspace(1, old.shape[1] - 1, LOOKS).astype(int))
    chance = flights.same_distribution(old[:, steps], new[:, steps], 2e-3 * result.grain)
    return likely(f"{len(old)} flights", chance, RARE)


def new_rate(result: Evidence, law: str) -> Verdict:
    """The failure rate agrees with new flights with other random numbers."""
    failed = flights.failures(*_flags(result, law), result.ground.walled)
    again = result.new_failures(law)
    chance = flights.same_rate(int(failed.sum()), len(failed), int(again.sum()), len(again))
    found = f"{again.mean():.4g} of {len(again)}, chance {chance:.1g}"
    return Verdict(f"{failed.mean():.4g}", found, chance >= RARE)


def reported_laws(result: Evidence) -> Verdict:
    """The metrics have rates for the wind laws that were simulated and for no other."""
    reported = sorted(law for law in LAWS if f"failure_{law}" in result.metrics)
    return same(reported, sorted({name.partition("/")[0] for name in result.flights}))


FILES = ("deployments.npz", "plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
FRONT = ("front.csv", "front.npz", "plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
CLAIMS: tuple[Claim, ...] = (
    Claim("plan: promise by flights", FRONT, promise),
    Claim("plan: promised rate", ("deployments.npz", *FRONT), promised_rate),
    Claim("flights: laws and numbers", FILES, flown_laws),
    Claim("flights: laws of the metrics", ("deployments.npz",), reported_laws),
    *(
        Claim(f"{law}: {name}", FILES, partial(flown, law, judge))
        for law in LAWS
        for name, judge in (
            ("rates and interval", counts),
            ("verdicts of the flights", judged_again),
            ("start of the flights", starts),
            ("winds of the flights", drawn_winds),
            ("positions of the flights", new_positions),
            ("failure rate of new flights", new_rate),
        )
    ),
)
