"""Claims about texts: which errors of the wind a failure rate covers, and where the wind comes from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import probability_text
from pareto_ltl_verify.claims.verdict import Claim, Verdict, no_fault
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.forecast_errors import HOUR
from pareto_ltl_verify.wind_tables import ENSEMBLE, level_of

UNLISTED = ("noaa",)  # sources whose files are downloaded, and no inputs of the run
OWN_ERRORS = "the robot's own errors of {}, heading and timing"
CALM = "calm air: no wind at all.", f"any wind; {OWN_ERRORS.format('airspeed')}."
STILL = (
    "still water: no current at all.",
    f"any current; {OWN_ERRORS.format('speed through the water')}.",
)


def texts(result: Evidence) -> Verdict | None:
    """The texts on errors that rates cover follow from wind.nc; plans of the first versions have none."""
    if "covered" not in result.plan:
        return None
    wind = result.wind
    if wind.fit is None and not wind.gust.any():
        wanted = STILL if result.plan["covered"] == STILL[0] and _in_water(result) else CALM
    else:
        wanted = "; ".join(_covered(result)) + ".", "; ".join(_not_covered(result)) + "."
    stated = (result.plan["covered"], result.plan["not_covered"])
    full = [_with_assumed(*texts) for texts in zip(stated, wanted, _assumed(result), strict=True)]
    faults = [
        f"{name}: {' '.join(words)}"
        for name, a, b in zip(("covered", "not covered"), stated, full, strict=True)
        if (words := [part for part in a.split("; ") if part not in b.split("; ")] or [b] * (a != b))
    ]
    return no_fault(f"{len(stated[1].split('; '))} errors not covered", faults)


def _in_water(result: Evidence) -> bool:
    return "depth" in (
        level_of(result.wind.level)[0],
        level_of(result.settings["robot"].get("level") or "")[0],
    )


def _of_current(result: Evidence) -> bool:
    """Whether the texts name a current; earlier versions call it a wind."""
    current = level_of(result.wind.level)[0] == "depth"
    return current and not str(result.plan["covered"]).startswith("wind at")


def _assumed(result: Evidence) -> tuple[str, str]:
    """A departure that no setting names, and a wind of another level than the robot's; empty without them."""
    zero, flown = result.scene["time_zero"], result.settings["robot"].get("level", "")
    departure = ""
    if zero is not None and result.settings["mission"]["start_time"] is None:
        flow = "current" if _of_current(result) else "wind"
        departure = (
            f"a departure at {_utc(zero)}, the first time of the {flow}, as mission.start_time is not set"
        )
    if result.wind.fit is None or not flown:
        return departure, ""
    (kind, height, robot), (other, known, wind) = level_of(flown), level_of(result.wind.level)
    alike = kind == other and abs(height - known) <= 0.2 * max(height, known)
    if alike:
        return departure, ""
    moves, used = ("moves", "current") if kind == "depth" else ("flies", "wind")
    mismatch = f"the robot {moves} {robot} (robot.level), and the {used} used is {wind}"
    earlier = f"the robot flies {robot} (robot.level), and the wind is that {wind}"
    return departure, earlier if earlier in result.plan["not_covered"] else mismatch


def _with_assumed(stated: str, wanted: str, assumed: str) -> str:
    """``wanted`` with the part ``assumed``, which files of earlier versions do not have, in its place."""
    if not assumed or assumed not in stated.split("; "):
        return wanted
    parts, place = wanted.split("; "), stated.split("; ").index(assumed)
    return "; ".join([*parts[:place], assumed, *parts[place:]])


def _covered(result: Evidence) -> Iterator[str]:
    wind = result.wind
    flow = "current" if _of_current(result) else "wind"
    yield f"{flow} at {wind.level} of {wind.source or 'an unknown source'}"
    if wind.fit is not None:
        share = wind.score.get("gp_coverage_90", np.nan)
        scored = (
            f"{probability_text(share)} lie in 90 % intervals" if np.isfinite(share) else "none was scored"
        )
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
    held = wind.until - wind.last_field
    if 0.0 < held < np.inf:
        yield f"the last field{_when(result)} held for up to {held / HOUR:g} h, and the change since then"
    if wind.modes is not None and (wind.modes.part == ENSEMBLE).any():
        yield "the spread of the members of an ensemble"
    yield f"a white part of {np.sqrt(wind.gust.mean()):.2g} m/s"


def _when(result: Evidence) -> str:
    """The time of the last field in UTC, if the map has a departure."""
    if (zero := result.scene["time_zero"]) is None:
        return ""
    return f" ({_utc(zero, result.wind.last_field)})"


def _utc(zero: str, later: float = 0.0) -> str:
    """The time ``later`` [s] after ``zero``, in UTC."""
    begin = datetime.fromisoformat(zero)
    begin = (begin if begin.tzinfo else begin.replace(tzinfo=UTC)) + timedelta(seconds=later)
    return begin.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _not_covered(result: Evidence) -> Iterator[str]:
    wind, law = result.wind, result.wind.error
    leads = wind.leads[np.isfinite(wind.leads)] / HOUR
    if law is None or not law.forecast_sd.any():
        leads_text = f" (leads {_range(leads, 'h')})" if len(leads) else ""
        yield f"errors of the fields themselves: analyses and forecasts{leads_text} are taken as true"
    elif not len(leads):
        yield "forecast error: the readings do not say how old their forecast is (lead_hours)"
    elif law.forecast_sd[0] <= 0:
        yield "errors of analyses (forecasts of lead 0)"
    if law is None:
        yield f"the change of the {'current' if _of_current(result) else 'wind'} between fields"
    if _of_current(result):
        yield f"currents at other depths than {wind.level}, and vertical motion of the water"
    else:
        yield f"winds at other heights than {wind.level}, and vertical motion of the air"
    yield "errors that are not Gaussian, such as a front or a storm that comes early"
    yield OWN_ERRORS.format("speed through the water" if _of_current(result) else "airspeed")


def _range(values: Sequence[float] | FloatArray, unit: str) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def source(result: Evidence) -> Verdict | None:
    """The source of the wind is set in the settings, and the files that it names are inputs of the run."""
    wanted = result.settings["wind"]["source"]
    if wanted == "given":  # from Python, with any text
        return None
    kind, _, left = result.wind.source.partition(": ")
    for name in sorted((Path(name).name for name in result.run["inputs"]), key=len, reverse=True):
        left = left.replace(name, "")
    known = kind in UNLISTED or re.fullmatch(r"[, ]*( and \d+ more)?", left) is not None
    return Verdict(
        result.wind.source[:44], f"{wanted}, {len(result.run['inputs'])} inputs", kind == wanted and known
    )


CLAIMS = (
    Claim("plan: errors that its rates cover", ("plan.json", "wind.nc", "scene.json"), texts),
    Claim("wind: source", ("wind.nc",), source),
)
