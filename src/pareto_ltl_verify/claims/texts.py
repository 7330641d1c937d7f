"""Claims about what a reader sees: rates and areas in exported files, errors that rates cover, the page."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from datetime import UTC, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta, binom

from careful_io.reading import read_text
from careful_io.texts import interval_text, probability_text
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, far_apart, no_fault, unlike
from pareto_ltl_verify.claims.exports import PLAN, ROUTES
from pareto_ltl_verify.claims.outlines import corridor_cov
from pareto_ltl_verify.claims.plan import utc
from pareto_ltl_verify.evidence import HELD_RUNS, Evidence
from pareto_ltl_verify.flights import RARE, rate_of, same_rate
from pareto_ltl_verify.heights import level_flight, stated_level
from pareto_ltl_verify.sentences import HOLDS, SENTENCE, flown_by, left_over
from pareto_ltl_verify.sources import source_of
from pareto_ltl_verify.wind_law import HOUR, ErrorLaw
from pareto_ltl_verify.wind_tables import ENSEMBLE, level_of

SHARES = (0.5, 0.9, 0.95, 0.99)
RATE = re.compile(
    r"Of (?P<runs>[\d,]+) [^%]*flights flown (?P<how>.*) in (?P<law>\w+) (?P<flow>\w+), "
    r"(?P<fails>.* %.*) fail\."
)
LUA, VOLUMES = "plan.lua", "operational_intent.json"
AIRSPEED, IN_WATER = "airspeed", "speed through the water"
CALM = "calm air: no wind at all", "any wind", AIRSPEED
STILL = "still water: no current at all", "any current", IN_WATER


# --- failure rates ----------------------------------------------------------------------------


def mission_failure(result: Evidence) -> Verdict:
    """The failure by heading is the promise; by position, it is the rate of new flights with feedback."""
    stated = result.document("mission.plan")["pareto_ltl"]
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
        faults += [f"flown {part['how']}"] * (part["how"] != (HOLDS if by_position else flown_by(result)))
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
    others = left_over(result, name, text)
    return no_fault(f"{len(by_course)} rates", faults, {f"{others!r} is not derived": bool(others)})


def _text(result: Evidence, name: str) -> str:
    if name in ROUTES:
        return str(ROUTES[name](result).text)
    if name == LUA:
        comment = read_text(result.directory / name).partition("\n\n")[0]
        return " ".join(comment.splitlines()[2:])
    content = result.document(name)
    return str(content["pareto_ltl"]["note"] if name == VOLUMES else content["description"])


# --- corridors --------------------------------------------------------------------------------


def corridor_sizes(result: Evidence) -> Verdict | None:
    """The stated share p of new flights is inside the ellipses: at each time, and at all times."""
    features = result.document("corridor.geojson")["features"]
    laws = {feature["properties"]["wind_law"] for feature in features}
    if laws != {result.planned_law}:
        return no_fault(", ".join(sorted(laws)), [f"planned in {result.planned_law} winds"])
    if result.planned_law not in result.new_flights:
        return None
    gap = result.new_flights[result.planned_law] - result.x
    inverse = np.linalg.inv(corridor_cov(result))
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
    if about["meaning"] != ("whole_flight" if step < 0 else "at_time") or about["role"] != "corridor":
        return f"step {step} is {about['meaning']}, {about['role']}"
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


# --- errors that rates cover ------------------------------------------------------------------


def texts(result: Evidence) -> Verdict | None:
    """The texts on errors that rates cover follow from wind.nc; plans of the first versions have none."""
    plan, wind = result.plan, result.wind
    if "covered" not in plan:
        return None
    if wind.fit is None and not wind.gust.any():
        still = plan["covered"].startswith(STILL[0]) and _in_water(result)
        covered, uncovered, speed = STILL if still else CALM
        covers, leaves = _own_errors(result, speed)
        wanted = "; ".join([covered, *covers]) + ".", "; ".join([uncovered, *leaves]) + "."
    else:
        wanted = "; ".join(_covered(result)) + ".", "; ".join(_not_covered(result)) + "."
    faults = []
    for key, whole, assumed in zip(("covered", "not_covered"), wanted, _assumed(result), strict=True):
        stated = plan[key].split("; ")
        parts = whole.split("; ")
        if assumed and assumed in stated:  # files of earlier versions do not have it
            parts.insert(stated.index(assumed), assumed)
        words = [part for part in stated if part not in parts] or parts * (stated != parts)
        faults += [f"{key.replace('_', ' ')}: {' '.join(words)}"] * bool(words)
    return no_fault(f"{len(plan['not_covered'].split('; '))} errors not covered", faults)


def _in_water(result: Evidence) -> bool:
    levels = result.wind.level, stated_level(result.settings)
    return "depth" in [level_of(text)[0] for text in levels]


def _flow(result: Evidence) -> str:
    """What the texts name: a current, which earlier versions call a wind, or the wind."""
    current = level_of(result.wind.level)[0] == "depth"
    return "current" if current and not str(result.plan["covered"]).startswith("wind at") else "wind"


def _assumed(result: Evidence) -> tuple[str | None, str | None]:
    """A departure that no setting names, and a wind of another level than the robot's; None without them."""
    zero, flown = result.scene["time_zero"], stated_level(result.settings)
    departure = None
    if zero is not None and result.settings["mission"]["start_time"] is None:
        first = f"the first time of the {_flow(result)}, as mission.start_time is not set"
        departure = f"a departure at {_utc(zero)}, {first}"
    if result.wind.fit is None or not flown:
        return departure, None
    (kind, height, robot), (other, known, wind) = level_of(flown), level_of(result.wind.level)
    if {kind, other} == {"altitude", "pressure"}:
        height, known = level_flight(flown).metres, level_flight(result.wind.level).metres
    elif kind != other:
        height, known = 0.0, 1.0
    if abs(height - known) <= 0.2 * max(height, known):
        return departure, None
    moves, used = ("moves", "current") if kind == "depth" else ("flies", "wind")
    return departure, f"the robot {moves} {robot}, and the {used} used is {wind}"


def _covered(result: Evidence) -> Iterator[str]:
    wind = result.wind
    yield f"{_flow(result)} at {wind.level} of {wind.source or 'an unknown source'}"
    if wind.fit is not None:
        share = wind.score.get("gp_coverage_90", np.nan)
        known = np.isfinite(share)
        scored = f"{probability_text(share)} lie in 90 % intervals" if known else "none was scored"
        counts = _range([len(points) for points in wind.fit.points], "readings a time")
        yield (
            f"interpolation in space between {counts} ({wind.fit.kernel}; "
            f"of readings on the map that the fit did not see, {scored})"
        )
    leads = wind.leads[np.isfinite(wind.leads)]
    if (law := wind.error) is not None:
        if law.parts and len(leads):
            sd = _range(np.sqrt(law.forecast_variance(leads)), "m/s")
            ages = _range(leads / HOUR, "h")
            yield f"forecast error by the law {law.name} for leads {ages}, {sd} a component{_tails(law)}"
        fields = wind.times[wind.times <= wind.last_field]
        if len(fields) > 1:
            yield f"interpolation in time between fields {_range(np.diff(fields) / HOUR, 'h')} apart"
        if law.scaled is not None:
            factor = np.sqrt(law.scaled.factor)
            reasons = ["the spread of the winds"] if law.scaled.spread is not None else []
            reasons += ["changes between analyses near the map"] if len(law.scaled.pairs) else []
            by = " and ".join(reasons) or "the latitude"
            tails = "" if law.of_winds is None else ", with heavy tails"
            yield f"changes in time {factor:.2f} times those of the law, by {by}{tails}"
    held, zero = wind.until - wind.last_field, result.scene["time_zero"]
    if 0.0 < held < np.inf:
        when = "" if zero is None else f" ({_utc(zero, wind.last_field)})"
        yield f"the last field{when} held for up to {held / HOUR:g} h, and the change since then"
    if wind.modes is not None and (wind.modes.part == ENSEMBLE).any():
        yield "the spread of the members of an ensemble"
    yield f"a white part of {np.sqrt(wind.gust.mean()):.2g} m/s"
    yield from _own_errors(result, IN_WATER if _flow(result) == "current" else AIRSPEED)[0]


def _tails(law: ErrorLaw) -> str:
    """What the text says of the tails and the data of a law of forecast errors."""
    if law.floor is None:
        return ""
    word = "situation" if law.facts["n"] == 1 else "situations"
    least = f"{law.facts['n']} {word}, which cannot tell rates below {probability_text(law.floor)}"
    return f"{' with heavy tails' if law.tail else ''} ({least})"


def _own_errors(result: Evidence, speed: str) -> tuple[list[str], list[str]]:
    """Which of the robot's own errors rates cover, and which they do not; none under the independent law."""
    robot, wording = result.robot, []
    known = result.planned_law != "independent"
    sds = [robot.airspeed_sd, robot.heading_sd, robot.clock_sd] if known else [None] * 3
    missing = [name for name, sd in zip((speed, "heading", "timing"), sds, strict=True) if sd is None]
    (airspeed, heading, clock), (faster, turned, late) = sds, robot.bias
    if airspeed is not None:
        wording.append(f"{speed} errors of {100 * airspeed:.3g} %{_about(100 * faster, '%')}")
    if heading is not None:
        degrees = "degree" if heading == 1 else "degrees"
        wording.append(f"heading errors of {heading:.3g} {degrees}{_about(turned, 'degrees')}")
    if clock is not None:
        wording.append(f"clock errors of {clock:.3g} s{_about(late, 's')}")
    left = [f"the robot's own errors of {_and(missing)}"] if missing else []
    if not wording:
        return [], left
    return (
        [f"{_and(wording)} (1 sd, constant over a flight)"],
        [*left, "changes of the robot's own errors during a flight"],
    )


def _about(bias: float, unit: str) -> str:
    return f" about {bias:+.3g} {unit}" if bias else ""


def _and(words: Sequence[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _utc(zero: str, later: float = 0.0) -> str:
    """The time ``later`` [s] after ``zero``, in UTC."""
    time = (utc(zero) + timedelta(seconds=later)).astimezone(UTC)
    return time.isoformat(timespec="seconds").replace("+00:00", "Z")


def _not_covered(result: Evidence) -> Iterator[str]:
    wind, law, flow = result.wind, result.wind.error, _flow(result)
    leads = wind.leads[np.isfinite(wind.leads)] / HOUR
    if law is None or not law.parts:
        leads_text = f" (leads {_range(leads, 'h')})" if len(leads) else ""
        yield f"errors of the fields themselves: analyses and forecasts{leads_text} are taken as true"
    elif not len(leads):
        yield "forecast error: the readings do not say how old their forecast is (lead_hours)"
    elif law.forecast_variance(np.zeros(1))[0] <= 0:
        yield "errors of analyses (forecasts of lead 0)"
    if law is None:
        yield f"the change of the {flow} between fields"
    other, medium, speed = (
        ("currents at other depths", "water", "speed through the water")
        if flow == "current"
        else ("winds at other heights", "air", "airspeed")
    )
    yield f"{other} than {wind.level}, and vertical motion of the {medium}"
    if law is None or law.tail is None:
        yield "errors that are not Gaussian, such as a front or a storm that comes early"
    else:
        yield "a front or a storm that comes hours early, beyond the tails of the law"
    yield from _own_errors(result, speed)[1]


def _range(values: Sequence[float] | FloatArray, unit: str) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def source(result: Evidence) -> Verdict | None:
    """The source of the wind is set in the settings, and the files that it names are inputs of the run."""
    wanted, inputs = result.settings["wind"]["source"], result.run["inputs"]
    if wanted == "given":  # from Python, with any text
        return None
    kind, _, left = result.wind.source.partition(": ")
    for name in sorted((Path(name).name for name in inputs), key=len, reverse=True):
        left = left.replace(name, "")
    known = source_of(kind).live or re.fullmatch(r"[, ]*( and \d+ more)?", left) is not None
    return Verdict(result.wind.source[:44], f"{wanted}, {len(inputs)} inputs", kind == wanted and known)


TEXTS = (*ROUTES, "mavlink_script.json", "corridor.geojson", LUA, VOLUMES)  # with sentences
ALL = (*PLAN, "cells.json", "automaton.json", "wind.nc", "deployments.npz")
CLAIMS: tuple[Claim, ...] = (
    Claim("exports: failure of mission.plan", ("mission.plan", *ALL), mission_failure),
    *(Claim(f"exports: rates in {name}", (name, *ALL), partial(stated_rates, name)) for name in TEXTS),
    Claim("exports: sizes of corridors", ("corridor.geojson", *ALL), corridor_sizes),
    Claim("plan: errors that its rates cover", ("plan.json", "wind.nc", "scene.json"), texts),
    Claim("wind: source", ("wind.nc",), source),
)
