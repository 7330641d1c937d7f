"""Table of the starts: the recommended one, those that do not differ from it, and the reasons in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import write_npz
from careful_io.texts import probability_text, rate_text
from careful_io.times import HOUR, iso, seconds
from pareto_ltl import Settings
from pareto_ltl.extend import Plan, Study
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.studies import departure_fronts, tables
from pareto_ltl_apps.studies.departure_fronts import NEARLY, Comparison, FlownFront, SeedSpread, rates_at
from pareto_ltl_apps.studies.settings import DepartureConfig
from pareto_ltl_apps.studies.tables import Columns, interval_columns, length_cell, markdown_table, rate_cell

Found = dict[float, list[Columns]]  # results of each seed by time of departure [s since 1970]
SCHEMA = "pareto_ltl.departures/2"
CONDITIONS = ("wind_speed", "wind_sd", "tail_wind", "end_sd_m")
WINDIER, VAGUER = 0.3, 1.05  # differences to mention: m/s, ratio
NAN = float("nan")
EXTRA_FILE = "extra_paths.npz"
ExtraPath = tuple[str, FloatArray]  # how it was made, and its positions (T+1, 2) [m]
INNER = ("time", "metrics", "reason", "rates")  # keys of a row that are not columns


@dataclass(frozen=True, slots=True)
class Delivered:
    """The recommended start in full: its plan, its front, and the front that was compared.

    Both fronts are flown in the flights that compare the starts.
    """

    plan: Plan
    front: FlownFront
    compared: FlownFront

    @property
    def ratio(self) -> tuple[float, float, float]:
        """How many times as often the full front fails at equal length, with its interval over the winds."""
        limits = departure_fronts.common_lengths({0.0: [self.compared], 1.0: [self.front]})
        return departure_fronts.failure_ratio([self.compared], [self.front], limits, SeedSpread(0.0, 0), 1)

    @property
    def compared_rate(self) -> tuple[float, float, float]:
        """Rate of the safest compared path that is no longer than the plan, with its interval; else NaN."""
        limit = self.plan.path.objectives.length * (1.0 + 1e-9)
        able = self.compared.length[self.compared.length <= limit]
        rate, low, high = rates_at(self.compared, able[-1:])[0].tolist() if len(able) else (NAN,) * 3
        return rate, low, high


def folder_name(time: float) -> str:
    """The folder of a start: ``20181009T120000Z``."""
    return datetime.fromtimestamp(time, UTC).strftime("%Y%m%dT%H%M%SZ")


# --- what is compared ------------------------------------------------------------------------


def planned_path(results: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """The plan of the first seed: the path that the selection rule chose."""
    path: Mapping[str, Any] = results[0]["paths"][results[0]["plan"]]
    return path


def _limit(cfg: DepartureConfig) -> float:
    """Latest arrival [s since 1970]."""
    return math.inf if cfg.arrive_by is None else seconds(cfg.arrive_by)


def on_time(time: float, results: Sequence[Mapping[str, Any]], limit: float) -> bool:
    """Whether the plan of a start arrives by ``limit`` [s since 1970]: departure plus its steps."""
    return bool(results[0]["planned"]) and time + planned_path(results)["duration_s"] <= limit + 1e-6


def _paths_in_time(cfg: DepartureConfig, time: float, result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    limit = _limit(cfg) + 1e-6
    return [path for path in result.get("paths", ()) if time + path["duration_s"] <= limit]


def fronts_in_time(cfg: DepartureConfig, found: Found) -> dict[float, list[FlownFront]]:
    """The fronts of each start whose plan arrives in time, one for each seed, of paths that do so too."""
    return {
        time: [front_of(_paths_in_time(cfg, time, result), cfg.flights) for result in results]
        for time, results in found.items()
        if on_time(time, results, _limit(cfg))
    }


def front_of(paths: Sequence[Mapping[str, Any]], flights: int) -> FlownFront:
    """The front of paths as parts of a study have them."""
    failed = [tables.text_to_flags(path["failed"]) for path in paths]
    lengths = np.array([path["length_m"] for path in paths])
    return departure_fronts.flown_front(lengths, np.array(failed, bool).reshape(len(paths), flights))


def compared_paths(cfg: DepartureConfig, time: float, found: Found) -> list[ExtraPath]:
    """The paths of the front of a start, of all its seeds together, for the full plan."""
    paths = [path for result in found[time] for path in _paths_in_time(cfg, time, result)]
    lengths = set(front_of(paths, cfg.flights).length.tolist())
    chosen = {path["length_m"]: path for path in reversed(paths) if path["length_m"] in lengths}
    return [
        (f"compared start, {chosen[length]['origin']}", np.array(chosen[length]["x"], float))
        for length in sorted(chosen)
    ]


# --- rows ------------------------------------------------------------------------------------


def start_rows(settings: Settings, found: Found, comparison: Comparison) -> list[Columns]:
    """A row for each start, in the order of time."""
    cfg = settings[DepartureConfig]
    in_time = fronts_in_time(cfg, found)
    rows = []
    for time, results in found.items():
        own = in_time.get(time, ())
        row = _row(cfg, time, results)
        row |= interval_columns("ratio", *comparison.ratios.get(time, (NAN,) * 3))
        row |= {"as_good": time in comparison.alike, "recommended": time == comparison.recommended}
        row |= {"seeds": len(results)}
        row |= {"paths": len(departure_fronts.pooled_front(own).length) if own else 0}
        rows.append(row | {"rates": rates_of(own, comparison.limits)})
    best = next(row for row in rows if row["time"] == comparison.best)
    for row in rows:
        row["verdict"] = verdict(row, best, cfg)
    return rows


def rates_of(fronts: Sequence[FlownFront], limits: FloatArray) -> FloatArray:
    """Failure and its interval (G, 3) at ``limits``, of all seeds together; NaN without a path."""
    if not fronts:
        return np.full((len(limits), 3), NAN)
    return rates_at(departure_fronts.pooled_front(fronts), limits)


def _row(cfg: DepartureConfig, time: float, results: Sequence[Mapping[str, Any]]) -> Columns:
    """The columns of one start, without comparison; numbers of a start without a plan are NaN."""
    result = results[0]
    planned = bool(result["planned"])
    path = planned_path(results) if planned else {}
    row: Columns = {"time": time, "departure": iso(time)}
    row |= {"arrival": iso(time + path["duration_s"]) if planned else "", "planned": planned}
    row |= {"on_time": on_time(time, results, _limit(cfg))}
    row |= tables.rate_columns("failure", tables.text_to_flags(path.get("failed", "")))
    row |= {name: path.get(name, NAN) for name in ("length_m", "duration_s", "steps")}
    row |= {name: result.get("conditions", {}).get(name, NAN) for name in CONDITIONS}
    row |= {"order": path.get("order", ""), "law": result.get("law", "")}
    return row | {"metrics": result.get("metrics", {}), "reason": result.get("reason", "")}


# --- words -----------------------------------------------------------------------------------


def verdict(row: Columns, best: Columns, cfg: DepartureConfig) -> str:
    """How a start compares with the best one, and the conditions that differ."""
    if not row["planned"]:
        return f"no plan: {row['reason']}"
    if not row["on_time"]:
        return f"arrives at {row['arrival']}, after departure.arrive_by = {cfg.arrive_by}"
    begin = "recommended: " if row["recommended"] else ""
    if row is best:
        return f"{begin}fails least at equal length"
    text = f"{begin}fails {_ratio_of(row)} times as often at equal length"
    if row["as_good"]:
        return f"{text}: no difference beyond the noise"
    return "; ".join([text, *_reasons(row, best)])


def ratio_text(ratio: float, low: float, high: float) -> str:
    """A ratio of failures, with its interval."""
    return "{} [{}, {}]".format(
        *(f"{r:.2f}" if r < 10.0 else f"{r:.0f}" if r < 1e4 else "> 10000" for r in (ratio, low, high))
    )


def _ratio_of(row: Columns) -> str:
    """The ratio of a start to the best one."""
    return ratio_text(*(row[f"ratio{end}"] for end in ("", "_low", "_high")))


def _reasons(row: Columns, best: Columns) -> list[str]:
    """Differences along the routes of the plans, with numbers, if they are large enough."""
    reasons = []
    here, there = row["tail_wind"], best["tail_wind"]
    if here < there - WINDIER:
        now, then = (
            f"{abs(tail):.1f} m/s of {'tail' if tail >= 0 else 'head'} wind" for tail in (here, there)
        )
        reasons.append(f"{now} instead of {then}")
    if row["wind_sd"] > VAGUER * best["wind_sd"]:
        reasons.append(
            f"the wind along the route is less certain (sd {row['wind_sd']:.2f} instead of "
            f"{best['wind_sd']:.2f} m/s)"
        )
    if row["end_sd_m"] > VAGUER * best["end_sd_m"]:
        reasons.append(
            f"positions spread wider at the end (sd {row['end_sd_m'] / 1e3:.0f} instead of "
            f"{best['end_sd_m'] / 1e3:.0f} km)"
        )
    return reasons


# --- the study -------------------------------------------------------------------------------


def departure_study(
    settings: Settings, rows: Sequence[Columns], comparison: Comparison, found: Found, delivered: Delivered
) -> Study:
    """Tables, numbers and text."""
    planned = [row for row in rows if row["planned"]]
    best = next(row for row in rows if row["recommended"])
    names = list(dict.fromkeys(name for row in planned for name in row["metrics"]))
    table = [
        {key: int(value) if isinstance(value, bool) else value for key, value in _outer(row).items()}
        | {name: row["metrics"].get(name, NAN) for name in names}
        for row in rows
    ]
    in_time = fronts_in_time(settings[DepartureConfig], found)
    limits = departure_fronts.map_lengths(in_time)
    rates = [rates_of(in_time.get(row["time"], ()), limits) for row in rows]
    lengths = [
        {"departure": row["departure"], "length_m": limit} | interval_columns("failure", *ends)
        for row, own in zip(rows, rates, strict=True)
        if row["time"] in in_time
        for limit, ends in zip(limits.tolist(), own.tolist(), strict=True)
    ]
    numbers = {
        "starts": float(len(rows)),
        "starts_planned": float(len(planned)),
        "starts_as_good": float(sum(row["as_good"] for row in rows)),
        "plans": float(sum(map(len, found.values()))),
        "seed_spread": comparison.spread.sd,
        "best_departure_s": best["time"],
        "best_length_m": best["length_m"],
    } | {f"best_failure{end}": best[f"failure{end}"] for end in ("", "_low", "_high")}
    if delivered.plan.promise is not None:
        rate = delivered.plan.promise.rate
        numbers |= {"promise_failure": rate.failure, "promise_low": rate.low, "promise_high": rate.high}
    routes = {
        time: np.array(planned_path(own)["x"], float) for time, own in found.items() if own[0]["planned"]
    }
    text = departure_text(settings, rows, comparison, delivered)
    pictures = {"rows": rows, "routes": routes, "limits": limits, "rates": np.stack(rates)[:, :, 0]}
    return Study({"departures": table, "departure_lengths": lengths}, numbers, text, pictures)


def _outer(row: Columns) -> Columns:
    """The entries of ``row`` that are columns."""
    return {key: value for key, value in row.items() if key not in INNER}


def departures_document(
    settings: Settings, rows: Sequence[Columns], comparison: Comparison, delivered: Delivered, kept: str
) -> dict[str, Any]:
    """The content of ``departures.json``; ``kept`` is the folder of the recommended plan."""
    cfg, best = settings[DepartureConfig], next(row for row in rows if row["recommended"])
    promise, limits, spread = delivered.plan.promise, comparison.limits, comparison.spread
    ends, others = ("failure", "low", "high"), [time for time in comparison.alike if time != best["time"]]

    def objects(rates: FloatArray) -> list[dict[str, float]]:
        return [dict(zip(ends, row, strict=True)) for row in rates.tolist()]

    def folder(row: Columns) -> str | None:
        written = cfg.keep == "all" and row["planned"]
        return f"starts/{folder_name(row['time'])}" if written else None

    return {
        "schema": SCHEMA,
        "law": best["law"],
        "flights": cfg.flights,
        "seeds": cfg.seeds,
        "quick": cfg.quick,
        "arrive_by": cfg.arrive_by,
        "lengths_m": limits,
        "best": iso(comparison.best),
        "seed_spread": {"sd": spread.sd, "degrees_of_freedom": spread.freedom},
        "recommended": {
            "departure": best["departure"],
            "directory": kept,
            "plan": f"{kept}/plan.json",
            "promise": promise and {name: getattr(promise.rate, name) for name in ("law", *ends, "runs")},
            "as_good": [iso(time) for time in others],
            "failure_at": objects(rates_at(delivered.front, limits)),
            "ratio_to_compared": dict(zip(("ratio", *ends[1:]), delivered.ratio, strict=True)),
        },
        "starts": [
            _outer(row) | row["metrics"] | {"failure_at": objects(row["rates"]), "directory": folder(row)}
            for row in rows
        ],
    }


def departure_text(
    settings: Settings, rows: Sequence[Columns], comparison: Comparison, delivered: Delivered
) -> str:
    """The recommendation, the table of all starts, and why not another one."""
    limits = comparison.limits
    shown = sorted({0, len(limits) // 2, len(limits) - 1})
    coarse = ", planned with a coarser front" if settings[DepartureConfig].quick else ""
    table = markdown_table(
        f"Starts{coarse}; ratio: how many times as often a start fails as the best one at equal length, with "
        "an interval that holds for all starts together (95 %); failure at common lengths: interpolated "
        "along each front; plan: the path of the selection rule; wind: means along its route",
        {
            "departure": _departure_cell,
            "seeds": "seeds",
            "ratio": _ratio_cell,
            **{f"failed at {limits[k] / 1e3:.0f} km": partial(_rate_at, k) for k in shown},
            "plan failed": lambda row: rate_cell(row, "failure"),
            "length [km]": length_cell,
            "arrival": lambda row: row["arrival"] or "-",
            "flight [h]": lambda row: known_text(row["duration_s"] / HOUR, ".1f"),
            "wind [m/s]": lambda row: known_text(row["wind_speed"], ".1f"),
            "tail wind [m/s]": lambda row: known_text(row["tail_wind"], "+.1f"),
            "sd of the wind [m/s]": lambda row: known_text(row["wind_sd"], ".2f"),
        },
        rows,
    )
    why = [f"- {row['departure']}: {row['verdict']}" for row in rows]
    said = [
        recommendation_text(rows, comparison),
        noise_text(settings[DepartureConfig], comparison),
        delivered_text(settings[DepartureConfig], comparison.recommended, delivered),
    ]
    return "\n\n".join([*said, table.rstrip("\n"), "**Why, and why not at**", "\n".join(why)]) + "\n"


def recommendation_text(rows: Sequence[Columns], comparison: Comparison) -> str:
    """When to leave, and which starts do not differ."""
    named, alike = f"**Leave at {iso(comparison.recommended)}**", comparison.alike
    low, high = (f"{limit / 1e3:,.0f}" for limit in comparison.limits[[0, -1]])
    between = f"at equal length ({low} to {high} km)"
    rivals = [row for row in rows if row["on_time"] and row["time"] not in alike]
    if len(alike) > 1:
        names = ", ".join(iso(time) for time in alike)
        others = f" All others fail more often {between}." if rivals else ""
        best = next(row for row in rows if row["time"] == comparison.recommended)
        least = (
            "it fails least"
            if comparison.best == comparison.recommended
            else f"it is the earliest of those that fail at most {NEARLY:g} times as often as the best one "
            f"({_ratio_of(best)} times as often as {iso(comparison.best)})"
        )
        return (
            f"{named}. {len(alike)} starts do not differ beyond the noise {between}: {names}. Of these, "
            f"{least}.{others}"
        )
    if not rivals:
        late = any(row["planned"] and not row["on_time"] for row in rows)
        return f"{named}: no other start has a plan{' in time' if late else ''}."
    nearest = min(rivals, key=lambda row: float(row["ratio"]))
    return (
        f"{named}: {between}, every other start fails more often; the nearest one, {nearest['departure']}, "
        f"{_ratio_of(nearest)} times as often."
    )


def noise_text(cfg: DepartureConfig, comparison: Comparison) -> str:
    """The sources of chance that the intervals contain."""
    spread = comparison.spread
    if not spread.freedom:
        return (
            "The intervals contain the winds of the flights, not the spread between seeds of the planner, "
            f"which is not known{' with departure.seeds=1' if cfg.seeds == 1 else ''}."
        )
    return (
        "The intervals contain the winds of the flights and the seeds of the planner: another seed changes "
        f"the failure of a single plan at equal length by a factor of {math.exp(spread.sd):.2f} (one "
        f"standard deviation, {spread.freedom} degrees of freedom)."
    )


def delivered_text(cfg: DepartureConfig, time: float, delivered: Delivered) -> str:
    """The full plan of the start ``time`` against the compared plans."""
    rate, *ends = delivered.compared_rate
    promise, length = delivered.plan.promise, delivered.plan.path.objectives.length
    said = f"Planned in full (recommended/plan.json), a path of {length / 1e3:,.0f} km"
    said += " is chosen" if promise is None else f" fails {promise}"
    if math.isfinite(rate):
        said += f"; the safest compared path that is no longer has {rate_text(rate, *ends)}"
    if (arrival := time + float(delivered.plan.path.t[-1])) > _limit(cfg) + 1e-6:
        said += (
            f"; it arrives at {iso(arrival)}, after departure.arrive_by: take a shorter path of recommended/ "
            "(pareto-ltl choose)"
        )
    return (
        f"{said}. At equal length the full front fails {ratio_text(*delivered.ratio)} times as often as the "
        "compared one, whose paths were judged with it."
    )


def _departure_cell(row: Columns) -> str:
    mark = " (recommended)" if row["recommended"] else " (late)" if not row["on_time"] else ""
    return f"{row['departure']}{mark}" if row["planned"] else str(row["departure"])


def _ratio_cell(row: Columns) -> str:
    if not row["planned"]:
        return "no plan"
    return _ratio_of(row) if math.isfinite(row["ratio"]) else "-"


def _rate_at(k: int, row: Columns) -> str:
    """The failure at the common length ``k``."""
    return probability_text(row["rates"][k, 0])


def known_text(value: float, form: str) -> str:
    """``value`` in a format, or a dash for NaN."""
    return format(value, form) if math.isfinite(value) else "-"


def write_extra_paths(file: Path, paths: Sequence[ExtraPath]) -> None:
    """Write ``paths`` for ``selection.extra_paths``: ``path_000/x``, ``path_000/origin`` and so on."""
    arrays: dict[str, Any] = {}
    for number, (origin, x) in enumerate(paths):
        key = f"path_{number:03d}"
        arrays |= {f"{key}/x": x, f"{key}/origin": np.array([origin], np.str_)}
    write_npz(file, arrays)
