"""Claims about what a reader sees: errors that a rate covers, the source of the wind, and ``report.html``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, timedelta
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import interval_text, probability_text
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.reading import parse_json, read_text
from pareto_ltl_verify.claims import Claim, Verdict, far_apart, no_fault, same, unlike
from pareto_ltl_verify.claims.plan import utc
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import in_plane
from pareto_ltl_verify.wind_fit import HOUR
from pareto_ltl_verify.wind_tables import ENSEMBLE, level_of

UNLISTED = ("noaa",)  # sources whose files are downloaded, and no inputs of the run
OWN_ERRORS = "the robot's own errors of {}, heading and timing"
CALM = "calm air: no wind at all.", f"any wind; {OWN_ERRORS.format('airspeed')}."
STILL = (
    "still water: no current at all.",
    f"any current; {OWN_ERRORS.format('speed through the water')}.",
)
PAGE = "report.html"
DATA = re.compile(r'<script type="application/json" id="page-data">(.*?)</script>', re.DOTALL)
HEADLINE = re.compile(
    r'<div class="fact main"><dt>fails</dt><dd>(.*?)<small>(.*?)</small></dd></div>', re.DOTALL
)
COLUMNS = (
    "failure", "failure_low", "failure_high", "length_m", "mission_risk", "collision_risk", "duration_s",
)  # fmt: skip
ROUNDED = 1e-3  # largest allowed error of a position in the page, as a share of the map's longer side


# --- errors that rates cover ------------------------------------------------------------------


def texts(result: Evidence) -> Verdict | None:
    """The texts on errors that rates cover follow from wind.nc; plans of the first versions have none."""
    plan, wind = result.plan, result.wind
    if "covered" not in plan:
        return None
    if wind.fit is None and not wind.gust.any():
        wanted = STILL if plan["covered"] == STILL[0] and _in_water(result) else CALM
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
    levels = result.wind.level, result.settings["robot"].get("level") or ""
    return "depth" in [level_of(text)[0] for text in levels]


def _flow(result: Evidence) -> str:
    """What the texts name: a current, which earlier versions call a wind, or the wind."""
    current = level_of(result.wind.level)[0] == "depth"
    return "current" if current and not str(result.plan["covered"]).startswith("wind at") else "wind"


def _assumed(result: Evidence) -> tuple[str | None, str | None]:
    """A departure that no setting names, and a wind of another level than the robot's; None without them."""
    zero, flown = result.scene["time_zero"], result.settings["robot"].get("level", "")
    departure = None
    if zero is not None and result.settings["mission"]["start_time"] is None:
        first = f"the first time of the {_flow(result)}, as mission.start_time is not set"
        departure = f"a departure at {_utc(zero)}, {first}"
    if result.wind.fit is None or not flown:
        return departure, None
    (kind, height, robot), (other, known, wind) = level_of(flown), level_of(result.wind.level)
    if kind == other and abs(height - known) <= 0.2 * max(height, known):
        return departure, None
    moves, used = ("moves", "current") if kind == "depth" else ("flies", "wind")
    mismatch = f"the robot {moves} {robot} (robot.level), and the {used} used is {wind}"
    earlier = f"the robot flies {robot} (robot.level), and the wind is that {wind}"
    return departure, earlier if earlier in result.plan["not_covered"] else mismatch


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
        if law.forecast_sd.any() and len(leads):
            sd = _range(np.sqrt(law.forecast_variance(leads)), "m/s")
            ages = _range(leads / HOUR, "h")
            yield f"forecast error by the law {law.name} for leads {ages}, {sd} a component"
        fields = wind.times[wind.times <= wind.last_field]
        if len(fields) > 1:
            yield f"interpolation in time between fields {_range(np.diff(fields) / HOUR, 'h')} apart"
        if law.scaled is not None:
            factor = np.sqrt(law.scaled.factor)
            yield f"changes in time {factor:.2f} times those of the law, as between analyses near the map"
    held, zero = wind.until - wind.last_field, result.scene["time_zero"]
    if 0.0 < held < np.inf:
        when = "" if zero is None else f" ({_utc(zero, wind.last_field)})"
        yield f"the last field{when} held for up to {held / HOUR:g} h, and the change since then"
    if wind.modes is not None and (wind.modes.part == ENSEMBLE).any():
        yield "the spread of the members of an ensemble"
    yield f"a white part of {np.sqrt(wind.gust.mean()):.2g} m/s"


def _utc(zero: str, later: float = 0.0) -> str:
    """The time ``later`` [s] after ``zero``, in UTC."""
    time = (utc(zero) + timedelta(seconds=later)).astimezone(UTC)
    return time.isoformat(timespec="seconds").replace("+00:00", "Z")


def _not_covered(result: Evidence) -> Iterator[str]:
    wind, law, flow = result.wind, result.wind.error, _flow(result)
    leads = wind.leads[np.isfinite(wind.leads)] / HOUR
    if law is None or not law.forecast_sd.any():
        leads_text = f" (leads {_range(leads, 'h')})" if len(leads) else ""
        yield f"errors of the fields themselves: analyses and forecasts{leads_text} are taken as true"
    elif not len(leads):
        yield "forecast error: the readings do not say how old their forecast is (lead_hours)"
    elif law.forecast_sd[0] <= 0:
        yield "errors of analyses (forecasts of lead 0)"
    if law is None:
        yield f"the change of the {flow} between fields"
    other, medium, speed = (
        ("currents at other depths", "water", "speed through the water")
        if flow == "current"
        else ("winds at other heights", "air", "airspeed")
    )
    yield f"{other} than {wind.level}, and vertical motion of the {medium}"
    yield "errors that are not Gaussian, such as a front or a storm that comes early"
    yield OWN_ERRORS.format(speed)


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
    known = kind in UNLISTED or re.fullmatch(r"[, ]*( and \d+ more)?", left) is not None
    return Verdict(result.wind.source[:44], f"{wanted}, {len(inputs)} inputs", kind == wanted and known)


# --- the page ---------------------------------------------------------------------------------


def page_data(result: Evidence) -> Any:
    """The JSON data that the script of the page reads; DataError unless there is exactly one set."""
    blocks = DATA.findall(read_text(result.directory / PAGE))
    if len(blocks) != 1:
        raise DataError(f"{PAGE}: has {len(blocks)} sets of numbers; one was expected")
    return parse_json(blocks[0].encode(), PAGE)


def points(result: Evidence) -> Verdict:
    """Each point of the scatter plot is a row of front.csv; without rates its failure is the bound."""
    stated, rows = page_data(result)["points"], result.front
    if len(stated) != len(rows):
        return same(f"{len(stated)} points", f"{len(rows)} points")
    faults = []
    for k, (point, row) in enumerate(zip(stated, rows, strict=True)):
        wanted = {name: float(row[name]) for name in COLUMNS if row[name]}
        if "failure" not in wanted:
            wanted["failure"] = min(1.0, wanted["mission_risk"] + wanted["collision_risk"])
        others = {name: None for name in COLUMNS if name not in wanted}
        wrong = unlike(point, others | {"law": row["law"] or result.planned_law})
        faults += [f"point {k}: {fault}" for fault in [*wrong, *far_apart(point, wanted, 1e-9)]]
    return no_fault(f"{len(stated)} points", faults)


def chosen(result: Evidence) -> Verdict:
    """The chosen path and its promise agree with plan.json."""
    data, plan = page_data(result), result.plan
    way, promise = data["paths"][str(data["chosen"])], data["promise"]
    size = float(np.ptp(np.array(result.scene["bounds"], float), axis=0).max())
    x = np.array(way["line"], float)  # in degrees for a map on the Earth
    x = in_plane(result.scene["crs"], x) if data["map"]["earthly"] else x
    faults = {
        "positions of the path": x.shape != result.x.shape or np.abs(x - result.x).max() > ROUNDED * size,
        "automaton states": way["q"] != plan["q"],
        "times": way["utc"] != plan["time_utc"],
        f"promise {promise}": (promise is None) != (plan["promise"] is None),
    }
    return no_fault(f"point {data['chosen']}", faults, unlike(plan["promise"] or {}, promise or {}))


def headline(result: Evidence) -> Verdict | None:
    """The rate in large letters is the promise of plan.json, with its interval and its wind law."""
    matches, promise = HEADLINE.findall(read_text(result.directory / PAGE)), result.plan["promise"]
    if promise is None:
        return None
    value = probability_text(promise["failure"])
    begin = f"{interval_text(promise['low'], promise['high'])} (95 %), under {promise['law']}"
    notes = tuple(f"{begin} {flow}" for flow in result.flows)
    if len(matches) != 1:
        return Verdict(f"{len(matches)} rates", f"{value}, {notes[0]}", False)
    rate, note = map(unescape, matches[0])
    return Verdict(f"{rate}, {note}", f"{value}, {notes[0]}", rate == value and note.startswith(notes))


CLAIMS = (
    Claim("plan: errors that its rates cover", ("plan.json", "wind.nc", "scene.json"), texts),
    Claim("wind: source", ("wind.nc",), source),
    Claim("page: points of the front", (PAGE, "front.csv", "plan.json"), points),
    Claim("page: path and promise", (PAGE, "plan.json", "scene.json"), chosen),
    Claim("page: rate in the headline", (PAGE, "plan.json"), headline),
)
