"""Comparison of starts: the recommended one, those as good, and the reasons in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pareto_ltl.planning.records import Plan
from pareto_ltl.report.records import Study
from pareto_ltl.settings import DepartureConfig, Settings
from pareto_ltl.studies.departure_starts import folder_name
from pareto_ltl.studies.statistics import Columns, rate_columns
from pareto_ltl.studies.tables import kilometres_text, markdown_table, rate_cell, text_to_flags
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.display import probability_text, rate_text
from pareto_ltl.wind.readings import HOUR, iso, seconds

Found = Mapping[float, Mapping[str, Any]]  # results by time of departure [s since 1970]
SCHEMA = "pareto_ltl.departures/1"
CONDITIONS = ("wind_speed", "wind_sd", "tail_wind", "end_sd_m")
LONGER, WINDIER, VAGUER, ALIKE = 0.01, 0.3, 1.05, 0.1  # differences to mention: share, m/s, ratio, share
LEAST_RATE = 1e-6  # used for a rate of 0, which has no logarithm
NAN = float("nan")


def start_rows(settings: Settings, found: Found) -> list[Columns]:
    """A row for each start, in order; the one with the least failure rate of those in time is recommended."""
    rows = [_row(settings.departure, time, result) for time, result in found.items()]
    open_rows = [row for row in rows if row["planned"] and row["on_time"]]
    best = min(open_rows, key=lambda row: (row["failure"], row["length_m"], row["time"]))
    fronts = {time: result["front"] for time, result in found.items() if result["planned"]}
    common = common_length(found)
    flags = {time: text_to_flags(result["failed"]) for time, result in found.items() if result["planned"]}
    for row in rows:
        row.update(same_length_columns(fronts.get(row["time"], []), common))
    for row in rows:
        gaps = (NAN,) * 3
        if row["planned"]:
            gaps = paired_difference(flags[best["time"]], flags[row["time"]])
        row.update(zip(("difference", "difference_low", "difference_high"), gaps, strict=True))
        row["as_good"] = bool(row["planned"] and row["on_time"] and row["difference_low"] <= 0.0)
        row["recommended"] = row is best
        row["verdict"] = verdict(row, best, settings.departure)
    return rows


def _row(cfg: DepartureConfig, time: float, result: Mapping[str, Any]) -> Columns:
    """The columns of one start, without comparison; numbers of a start without a plan are NaN."""
    planned = bool(result["planned"])
    arrival = time + result["duration_s"] if planned else NAN
    limit = math.inf if cfg.arrive_by is None else seconds(cfg.arrive_by)
    row: Columns = {
        "time": time,
        "departure": iso(time),
        "arrival": iso(arrival) if planned else "",
        "planned": planned,
        "on_time": on_time(time, result, limit),
    }
    row |= rate_columns("failure", text_to_flags(result["failed"] if planned else ""))
    row |= {name: result[name] if planned else NAN for name in ("length_m", "duration_s", "steps")}
    row |= {name: result["conditions"][name] if planned else NAN for name in CONDITIONS}
    row |= {"order": result["order"] if planned else "", "law": result["law"] if planned else ""}
    return row | {"metrics": result["metrics"] if planned else {}, "reason": result.get("reason", "")}


def on_time(time: float, result: Mapping[str, Any], limit: float) -> bool:
    """Whether the plan of a start arrives by ``limit`` [s since 1970]: departure plus its steps."""
    return bool(result["planned"]) and time + result["duration_s"] <= limit + 1e-6


def common_length(found: Found) -> float:
    """The length [m] at which fronts are compared: of the shortest plan, or the least of all fronts."""
    planned = [result for result in found.values() if result["planned"]]
    reached = [result["front"][0][0] for result in planned if result["front"]]
    return float(max([min(result["length_m"] for result in planned), *reached]))


def same_length_columns(front: Sequence[Sequence[float]], length: float) -> Columns:
    """Failure of a path of ``length`` [m], interpolated between two points of a front.

    ``front`` has rows (length, failure, low, high), shortest first; logarithms of rates are interpolated.
    Beyond the longest path its values are taken; NaN below the shortest, and with ``judge=bound``.
    """
    names = ("failure_same_length", "failure_same_length_low", "failure_same_length_high")
    if not front or length < front[0][0]:
        return {"same_length_m": length} | dict.fromkeys(names, NAN)
    table = np.array(front, float)
    logs = np.log(np.maximum(table[:, 1:], LEAST_RATE))
    values = (float(np.exp(np.interp(length, table[:, 0], logs[:, k]))) for k in range(3))
    return {"same_length_m": length} | dict(zip(names, values, strict=True))


# --- words -----------------------------------------------------------------------------------


def verdict(row: Columns, best: Columns, cfg: DepartureConfig) -> str:
    """Why a start is recommended, or why not."""
    if not row["planned"]:
        return f"no plan: {row['reason']}"
    if not row["on_time"]:
        return f"arrives at {row['arrival']}, after departure.arrive_by = {cfg.arrive_by}"
    if row is best:
        return f"recommended: fails least, {_rate(row)} in {row['law']} winds"
    more = _points_text(row)
    said = f"as good within chance: fails {more} more" if row["as_good"] else f"fails {more} more"
    return "; ".join([said, *_reasons(row, best)])


def _rate(row: Columns) -> str:
    return rate_text(row["failure"], row["failure_low"], row["failure_high"])


def _points_text(row: Columns) -> str:
    """A difference of rates with its interval, in percentage points."""
    gap, low, high = (100.0 * row[f"difference{end}"] for end in ("", "_low", "_high"))
    return f"{gap:.2f} points [{low:.2f}, {high:.2f}]"


def _reasons(row: Columns, best: Columns) -> list[str]:
    """Differences along the route, with numbers, if they are large enough."""
    said = []
    extra = row["length_m"] - best["length_m"]
    if abs(extra) > LONGER * best["length_m"]:
        said.append(f"{abs(extra) / 1e3:.0f} km {'longer' if extra > 0 else 'shorter'}")
    here, there = row["tail_wind"], best["tail_wind"]
    if here < there - WINDIER:
        said.append(f"{_along_text(here)} instead of {_along_text(there)}")
    if row["wind_sd"] > VAGUER * best["wind_sd"]:
        said.append(
            f"the wind along the route is less certain (sd {row['wind_sd']:.2f} instead of "
            f"{best['wind_sd']:.2f} m/s)"
        )
    if row["end_sd_m"] > VAGUER * best["end_sd_m"]:
        said.append(
            f"positions spread wider at the end (sd {row['end_sd_m'] / 1e3:.0f} instead of "
            f"{best['end_sd_m'] / 1e3:.0f} km)"
        )
    same, least = row["failure_same_length"], best["failure_same_length"]
    if abs(same - least) > ALIKE * least:
        said.append(
            f"at {best['same_length_m'] / 1e3:.0f} km it fails {probability_text(same)} instead of "
            f"{probability_text(least)}"
        )
    return said


def _along_text(tail: float) -> str:
    return f"{abs(tail):.1f} m/s of {'tail' if tail >= 0 else 'head'} wind"


# --- the study -------------------------------------------------------------------------------


def departure_study(settings: Settings, rows: Sequence[Columns], found: Found, plan: Plan) -> Study:
    """Tables, numbers and text; ``plan`` is that of the recommended start in full."""
    planned = [row for row in rows if row["planned"]]
    best = next(row for row in rows if row["recommended"])
    names = list(dict.fromkeys(name for row in planned for name in row["metrics"]))
    table = tuple(
        {key: _cell(value) for key, value in row.items() if key not in ("time", "metrics", "reason")}
        | {name: row["metrics"].get(name, NAN) for name in names}
        for row in rows
    )
    numbers = {
        "starts": float(len(rows)),
        "starts_planned": float(len(planned)),
        "starts_as_good": float(sum(row["as_good"] for row in rows)),
        "best_departure_s": best["time"],
        "best_length_m": best["length_m"],
    } | {f"best_failure{end}": best[f"failure{end}"] for end in ("", "_low", "_high")}
    if plan.promise is not None:
        rate = plan.promise.rate
        numbers |= {"promise_failure": rate.failure, "promise_low": rate.low, "promise_high": rate.high}
    routes = {time: np.array(result["x"], float) for time, result in found.items() if result["planned"]}
    text = departure_text(settings, rows, plan)
    return Study({"departures": table}, numbers, text, {"rows": tuple(rows), "routes": routes})


def _cell(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


def departures_document(settings: Settings, rows: Sequence[Columns], plan: Plan, kept: str) -> dict[str, Any]:
    """The content of ``departures.json``; ``kept`` is the folder of the recommended plan."""
    cfg, best = settings.departure, next(row for row in rows if row["recommended"])
    promise = plan.promise
    return {
        "schema": SCHEMA,
        "law": best["law"],
        "flights": cfg.flights,
        "quick": cfg.quick,
        "arrive_by": cfg.arrive_by,
        "same_length_m": best["same_length_m"],
        "recommended": {
            "departure": best["departure"],
            "directory": kept,
            "plan": f"{kept}/plan.json",
            "promise": None
            if promise is None
            else {name: getattr(promise.rate, name) for name in ("law", "failure", "low", "high", "runs")},
            "as_good": [row["departure"] for row in rows if row["as_good"] and row is not best],
        },
        "starts": [
            {key: value for key, value in row.items() if key not in ("time", "metrics", "reason")}
            | row["metrics"]
            | {"directory": f"starts/{folder_name(row['time'])}" if _has_folder(cfg, row) else None}
            for row in rows
        ],
    }


def _has_folder(cfg: DepartureConfig, row: Columns) -> bool:
    return cfg.keep == "all" and bool(row["planned"])


def departure_text(settings: Settings, rows: Sequence[Columns], plan: Plan) -> str:
    """The recommendation, the table of all starts, and why not another one."""
    best = next(row for row in rows if row["recommended"])
    alike = [row["departure"] for row in rows if row["as_good"] and row is not best]
    lines = [
        f"**Leave at {best['departure']}**: {_rate(best)} of {settings.departure.flights:,} fresh flights "
        f"fail in {best['law']} winds. " + (f"As good within chance: {', '.join(alike)}." if alike else
                                            "No other start is as good."),
    ]  # fmt: skip
    if plan.promise is not None:
        lines.append(f"Planned in full (recommended/plan.json) it fails {plan.promise.rate}.")
    table = markdown_table(
        f"Starts{', planned with a coarser front' if settings.departure.quick else ''}; failure with its "
        "95 % interval, and the difference to the recommended start in percentage points; at one length of "
        f"{best['same_length_m'] / 1e3:.0f} km: interpolated along each front; wind: means along the route",
        ("departure", "arrival", "failed", "difference", "same length", "length [km]", "flight [h]", "steps",
         "wind [m/s]", "tail wind [m/s]", "sd of the wind [m/s]"),
        (_text_row(row) for row in rows),
    )  # fmt: skip
    why = [f"- {row['departure']}: {row['verdict']}" for row in rows]
    return "\n\n".join([*lines, table.rstrip("\n"), "**Why, and why not at**", "\n".join(why)]) + "\n"


def _text_row(row: Columns) -> tuple[str, ...]:
    if not row["planned"]:
        return (row["departure"], "no plan", *("-" for _ in range(9)))
    mark = " (recommended)" if row["recommended"] else " (late)" if not row["on_time"] else ""
    return (
        f"{row['departure']}{mark}",
        row["arrival"],
        rate_cell(row, "failure"),
        "-" if row["recommended"] else _points_text(row),
        probability_text(row["failure_same_length"]),
        kilometres_text(row["length_m"]),
        f"{row['duration_s'] / HOUR:.1f}",
        f"{row['steps']}",
        f"{row['wind_speed']:.1f}",
        f"{row['tail_wind']:+.1f}",
        f"{row['wind_sd']:.2f}",
    )


__all__ = [
    "Found",
    "departure_study",
    "departures_document",
    "on_time",
    "same_length_columns",
    "start_rows",
    "verdict",
]
