"""Claims about failure rates and areas in the exported files: new flights agree with them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import beta, binom

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import interval_text, probability_text
from pareto_ltl_verify.claims import Claim, Verdict, far_apart, no_fault, unlike
from pareto_ltl_verify.claims.exports import PLAN, ROUTES, json_file
from pareto_ltl_verify.evidence import HELD_RUNS, Evidence
from pareto_ltl_verify.flights import RARE, rate_of, same_rate
from pareto_ltl_verify.geometry import in_plane, within

FINEST = 1.0  # [m] standard deviation whose square corridors add to each variance of the position
SHARES = (0.5, 0.9, 0.95, 0.99)
SENTENCE = re.compile(r"Of [\d,]+ [^%]*flights flown .*? fail\.")
RATE = re.compile(
    r"Of (?P<runs>[\d,]+) [^%]*flights flown (?P<how>.*) in (?P<law>\w+) (?P<flow>\w+), "
    r"(?P<fails>.* %.*) fail\."
)


# --- failure rates ----------------------------------------------------------------------------


def mission_failure(result: Evidence) -> Verdict:
    """The failure by heading is the promise; by position, it is the rate of new flights with feedback."""
    stated = json_file(result, "mission.plan")["pareto_ltl"]
    promise, by_heading = result.plan["promise"], stated["failure_by_heading"]
    faults = unlike(promise or {}, by_heading or {})
    faults += [f"by heading {by_heading}"] * ((promise is None) != (by_heading is None))
    rate = stated["failure_by_position"]
    if rate is None:  # after an alarm of replanning
        return no_fault("no rates", faults, {"alone by heading": by_heading is not None})
    count, runs = round(rate["failure"] * rate["runs"]), int(rate["runs"])
    faults += far_apart(rate, rate_of(count, runs), 1e-9) + unlike(rate, {"law": result.planned_law})
    return no_fault(f"{rate['failure']:.4g} by position", faults, _by_position(result, count, runs))


def _by_position(result: Evidence, count: int, runs: int) -> list[str]:
    """A fault if the rate of robots that know their positions is another than in new flights."""
    chance = same_rate(count, runs, *result.held_failures)
    return [f"by position {result.held_failures[0]} of {HELD_RUNS}, chance {chance:.1g}"] * (chance < RARE)


def stated_rates(name: str, result: Evidence) -> Verdict:
    """Sentences of a file: the promise, the rate of new flights with known positions, errors not covered."""
    text, promise = _text(result, name), result.plan["promise"]
    matches = [RATE.fullmatch(sentence) for sentence in SENTENCE.findall(text)]
    by_course = {("feedback_time=60)" in part["how"]): part for part in matches if part is not None}
    rates = 0 if result.plan["objectives"]["mission_risk"] is None else 1 + (promise is not None)
    faults = [f"{len(by_course)} rates"] * (len(by_course) != len(matches) or len(by_course) != rates)
    for by_position, part in by_course.items():
        known = part["law"] == result.planned_law and part["flow"] in result.flows
        faults += [f"{part['law']} {part['flow']}"] * (not known)
        runs = int(part["runs"].replace(",", ""))
        if by_position:
            share = float(part["fails"].partition(" %")[0].lstrip("< ")) / 100
            faults += _by_position(result, round(share * runs), runs)
        elif promise is not None:
            ends = interval_text(promise["low"], promise["high"])
            wanted = f"{probability_text(promise['failure'])} (95 %: {ends})", promise["runs"]
            faults += [f"{part['fails']} of {runs} by heading"] * ((part["fails"], runs) != wanted)
    left = result.plan["not_covered"].rstrip(".")
    faults += ["errors not covered"] * (bool(left) and f"Not covered: {left}." not in text)
    return no_fault(f"{len(by_course)} rates", faults)


def _text(result: Evidence, name: str) -> str:
    return str(ROUTES[name](result).text if name in ROUTES else json_file(result, name)["description"])


# --- corridors --------------------------------------------------------------------------------


def corridor_sizes(result: Evidence) -> Verdict | None:
    """The stated share p of new flights is inside the ellipses: at each time, and at all times."""
    features = json_file(result, "corridor.geojson")["features"]
    laws = {feature["properties"]["wind_law"] for feature in features}
    if laws != {result.planned_law}:
        return no_fault(", ".join(sorted(laws)), [f"planned in {result.planned_law} winds"])
    if result.planned_law not in result.new_flights:
        return None
    gap = result.new_flights[result.planned_law] - result.x
    inverse = np.linalg.inv(np.array(result.plan["cov"]) + FINEST**2 * np.eye(2))
    sizes = np.sqrt(np.einsum("nti,tij,ntj->nt", gap, inverse, gap))
    faults = [*_missing(features, len(result.x)), *(_unheld(f["properties"], sizes) for f in features)]
    return no_fault(f"{len(features)} areas", [fault for fault in faults if fault])


def _missing(features: Sequence[dict[str, Any]], steps: int) -> list[str]:
    written = sorted((f["properties"]["probability"], f["properties"].get("step", -1)) for f in features)
    wanted = sorted((share, step) for share in SHARES for step in range(-1, steps))
    return [] if written == wanted else [f"{len(written)} areas, not {len(wanted)}"]


def _unheld(about: dict[str, Any], sizes: FloatArray) -> str:
    """The fault of the size of one area; an empty text if it is right."""
    whole = about["meaning"] == "whole_flight"
    step, share, runs = about.get("step", -1), about["probability"], about["flights"]
    if whole != (step < 0):
        return f"step {step} is {about['meaning']}"
    if step == 0:
        return ""  # all flights begin at one place, or are drawn with start_sd
    met, size = (sizes.max(axis=1) if whole else sizes[:, step]), about["standard_deviations"]
    held = int((met <= size).sum())
    k = math.ceil((runs + 1) * share - 1e-9)
    ends = [float(beta.ppf(q, k, max(runs + 1 - k, 1))) for q in (RARE / 4, 1 - RARE / 4)]  # share it holds
    low, high = binom.ppf(RARE / 4, len(met), ends[0]), binom.ppf(1 - RARE / 4, len(met), ends[1])
    if held < low or (held > high and size > 1.0):
        return f"{about['meaning']} {step}: {held / len(met):.4g} for {share}"
    return ""


def corridor_areas(result: Evidence) -> Verdict:
    """Areas have the extent of their sizes: polygons around ellipses, and tubes that hold all ellipses."""
    cov = np.array(result.plan["cov"]) + FINEST**2 * np.eye(2)
    faults = []
    for feature in json_file(result, "corridor.geojson")["features"]:
        about, geometry = feature["properties"], feature["geometry"]
        if geometry["type"] != "Polygon":
            continue  # cut at the 180th meridian
        drawn = in_plane(result.scene["crs"], np.array(geometry["coordinates"][0], float))[:-1]
        size = about["standard_deviations"]
        if about["meaning"] == "at_time":
            gap = drawn - result.x[about["step"]]
            met = np.sqrt(np.einsum("ni,ij,nj->n", gap, np.linalg.inv(cov[about["step"]]), gap)) / size
            if met.min() < 0.99 or met.max() > 1.02:
                faults.append(f"{about['probability']} at step {about['step']}: {met.min():.3g} of its size")
        else:
            rim = _rims(result.x, cov, 0.99 * size)
            if not within(drawn, rim).all():
                faults.append(f"the tube of {about['probability']} leaves some of its ellipses out")
    return no_fault(f"shares {', '.join(f'{share:g}' for share in SHARES)}", faults)


def _rims(mean: FloatArray, cov: FloatArray, size: float) -> FloatArray:
    """Points (16 (T + 1), 2) [m] on the ellipses of ``size`` standard deviations."""
    angle = np.arange(16) * (math.pi / 8)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    rings = mean[:, :, None] + size * np.linalg.cholesky(cov) @ circle
    return np.asarray(rings.transpose(0, 2, 1).reshape(-1, 2), float)


TEXTS = (*ROUTES, "mavlink_script.json")  # files that have sentences
ALL = (*PLAN, "cells.json", "automaton.json", "wind.nc", "deployments.npz")
CLAIMS = (
    Claim("exports: failure of mission.plan", ("mission.plan", *ALL), mission_failure),
    *(Claim(f"exports: rates in {name}", (name, *ALL), partial(stated_rates, name)) for name in TEXTS),
    Claim("exports: sizes of corridors", ("corridor.geojson", *ALL), corridor_sizes),
    Claim("exports: areas of corridors", ("corridor.geojson", *PLAN), corridor_areas),
)
