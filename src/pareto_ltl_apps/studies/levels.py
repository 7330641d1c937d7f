"""Choice of the height: one mission planned at each level of the same wind files, whose fronts are compared.

A candidate is a level, with ``levels.starts`` a level and a departure. Each is a run with that ``wind.level``
and ``robot.level``; map and automaton are made once. Fronts are compared as for departures
(:mod:`~pareto_ltl_apps.studies.departure_fronts`): at equal length, in fresh flights of the same random
numbers, with intervals that hold for all candidates together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import plain_data, write_json
from careful_io.texts import probability_text
from careful_io.times import HOUR, iso, seconds
from pareto_ltl import ConfigError, DataError, InfeasibleError, Run, Settings
from pareto_ltl.extend import Study, UnpricedRun, which_fail
from pareto_ltl.planning.selection_rules import within_capacity
from pareto_ltl.support.seeds import stage_seeds
from pareto_ltl_apps.flight.rest_of_flight import quick_settings
from pareto_ltl_apps.studies import departure_fronts, tables
from pareto_ltl_apps.studies.departure import (
    METRICS,
    QUICK_RUNS,
    STAGES,
    path_columns,
    plan_start,
    repeated,
    route_conditions,
    same_map,
)
from pareto_ltl_apps.studies.departure_fronts import NEARLY, Comparison, compare_fronts, starts_to_repeat
from pareto_ltl_apps.studies.departure_table import (
    CONDITIONS,
    NAN,
    front_of,
    known_text,
    planned_path,
    rates_of,
    ratio_text,
)
from pareto_ltl_apps.studies.parts import Part, Progress, half_the_cores, part_key, work_parts
from pareto_ltl_apps.studies.settings import EvaluationConfig, LevelsConfig
from pareto_ltl_apps.studies.tables import Columns, interval_columns, length_cell, markdown_table, rate_cell

STREAM = "levels"  # random stream of the flights that compare levels
SCHEMA = "pareto_ltl.levels/1"
GRAVITY = 9.80665  # [m/s²]
OUTER = ("key", "metrics", "reason", "rates", "time")  # keys of a row that are not columns
Found = dict[float, list[Columns]]  # results of each seed, by the number of the candidate


@dataclass(frozen=True, slots=True)
class Candidate:
    """A level, and a departure [s since 1970] where there are several."""

    level: str
    start: float | None = None

    @property
    def name(self) -> str:
        """``925hPa``, or ``925hPa 2018-10-09T06:00Z``."""
        return self.level if self.start is None else f"{self.level} {iso(self.start)}"


@dataclass(frozen=True, slots=True)
class LevelsContext:
    """Data for all candidates."""

    settings: Settings
    world: Run
    candidates: tuple[Candidate, ...]


def run_levels(settings: Settings, world: Run, directory: Path, progress: Progress = None) -> Study:
    """Plan the candidates of ``settings.levels`` and compare their fronts.

    Raises
    ------
    ConfigError
        If there are fewer than two candidates.
    DataError
        If the wind files have none of the levels.
    InfeasibleError
        If no level has a plan.
    """
    cfg = settings[LevelsConfig]
    starts = [None] if not cfg.starts else sorted({seconds(text) for text in cfg.starts})
    candidates = tuple(Candidate(level, start) for level in cfg.levels for start in starts)
    if len(candidates) < 2:
        raise ConfigError(
            "levels.levels must list at least two levels of the wind files, e.g. levels.levels=[10m,925hPa]"
        )
    context = LevelsContext(settings, world, candidates)
    numbers = [float(k) for k in range(len(candidates))]
    results = _worked(context, [(number, 0) for number in numbers], directory, progress)
    found: Found = {number: [result] for number, result in zip(numbers, results, strict=True)}
    _require_one(candidates, found)
    while again := starts_to_repeat(_fronts(cfg.flights, found), cfg.seeds):
        pieces = [(number, len(found[number])) for number in again]
        for number, result in zip(again, _worked(context, pieces, directory, progress), strict=True):
            found[number].append(result)
    comparison = compare_fronts(_fronts(cfg.flights, found))
    rows = level_rows(settings, candidates, found, comparison)
    write_json(directory / "levels.json", levels_document(settings, rows, comparison))
    return levels_study(settings, rows, comparison, found)


def _fronts(flights: int, found: Found) -> dict[float, list[departure_fronts.FlownFront]]:
    return {
        number: [front_of(result.get("paths", ()), flights) for result in results]
        for number, results in found.items()
        if results[0]["planned"]
    }


def _require_one(candidates: Sequence[Candidate], found: Found) -> None:
    """Raise DataError if the files have none of the levels, InfeasibleError if none has a plan."""
    if any(results[0]["planned"] for results in found.values()):
        return
    first = found[0.0][0]
    kind = DataError if all(results[0]["data"] for results in found.values()) else InfeasibleError
    raise kind(f"none of the {len(candidates)} levels has a plan; {candidates[0].name}: {first['reason']}")


# --- one candidate ---------------------------------------------------------------------------


def level_settings(settings: Settings, candidate: Candidate, repeat: int = 0) -> Settings:
    """The settings of a run at a level; ``repeat`` 0 has the seed of ``settings``."""
    mission = settings.mission
    if candidate.start is not None:
        mission = replace(mission, start_time=iso(candidate.start))
    mine = replace(
        repeated(settings, repeat),
        mission=mission,
        wind=replace(settings.wind, level=candidate.level),
        robot=replace(settings.robot, level=candidate.level),
        pipelines=replace(settings.pipelines, stages=list(STAGES)),
    )
    if not settings[LevelsConfig].quick:
        return mine
    quicker = quick_settings(mine)
    return replace(quicker, selection=replace(mine.selection, runs=min(mine.selection.runs, QUICK_RUNS)))


def level_part(context: LevelsContext, number: float, repeat: int) -> Columns:
    """The front of one candidate with one seed, its flights and its plan; or why there is no plan."""
    candidate = context.candidates[int(number)]
    try:
        settings = level_settings(context.settings, candidate, repeat)
        run = UnpricedRun(settings)
        if same_map(run.scene, context.world.scene):
            run.records |= context.world.make("cells", "automaton")
        plan_start(run)
    except (ConfigError, DataError) as error:
        return {"planned": False, "data": True, "reason": str(error)}
    except InfeasibleError as error:
        return {"planned": False, "data": False, "reason": str(error)}
    problem, path = run.problem, run.plan.path
    paths = within_capacity(settings.selection, run.front, problem).paths
    flown = which_fail(
        problem, paths, settings[LevelsConfig].flights, stage_seeds(context.settings.seed, STREAM)
    )
    numbers = run.metrics
    return {
        "planned": True,
        "law": problem.fidelity.law,
        "plan": next(k for k, other in enumerate(paths) if np.array_equal(other.x, path.x)),
        "paths": [path_columns(other, failed) for other, failed in zip(paths, flown, strict=True)],
        "metrics": {name: numbers[name] for name in METRICS if name in numbers},
        "conditions": route_conditions(problem, path),
        "height_m": settings.flight_height.metres,
    }


def climb_energy(settings: Settings, height: float) -> float:
    """Energy of the climb beyond level flight, m g h / efficiency [J]; NaN without a mass or power curve.

    The descent gives none of it back.
    """
    cfg = settings[LevelsConfig]
    if cfg.mass is None or settings.robot.power.kind == "none":
        return NAN
    return cfg.mass * GRAVITY * max(height, 0.0) / cfg.climb_efficiency


def _worked(
    context: LevelsContext, pieces: Sequence[tuple[float, int]], directory: Path, progress: Progress
) -> list[Columns]:
    """Results of pairs (number of the candidate, number of the seed)."""
    settings = context.settings
    parts = []
    for number, repeat in pieces:
        candidate = context.candidates[int(number)]
        start = "" if candidate.start is None else iso(candidate.start)
        key = part_key(settings, STREAM, asdict(settings[LevelsConfig]), candidate.level, start, repeat)
        name = "".join(letter for letter in f"{candidate.level}{start}" if letter.isalnum())
        parts.append(Part(f"level-{name}-{repeat}", (number, repeat), key))
    return work_parts(
        half_the_cores(settings[EvaluationConfig]), directory, level_part, context, parts, progress
    )


# --- the table -------------------------------------------------------------------------------


def level_rows(
    settings: Settings, candidates: Sequence[Candidate], found: Found, comparison: Comparison
) -> list[Columns]:
    """A row for each candidate, in the order of the settings."""
    fronts, rows = _fronts(settings[LevelsConfig].flights, found), []
    for number, results in found.items():
        result, candidate = results[0], candidates[int(number)]
        path = planned_path(results) if result["planned"] else {}
        row: Columns = {"key": number, "time": number, "name": candidate.name, "level": candidate.level}
        row |= {"departure": "" if candidate.start is None else iso(candidate.start)}
        row |= {"height_m": result.get("height_m", NAN), "planned": bool(result["planned"])}
        row |= tables.rate_columns("failure", tables.text_to_flags(path.get("failed", "")))
        row |= {name: path.get(name, NAN) for name in ("length_m", "duration_s", "steps")}
        row |= {name: result.get("conditions", {}).get(name, NAN) for name in CONDITIONS}
        row |= {"order": path.get("order", ""), "law": result.get("law", "")}
        row |= {"energy_j": result.get("metrics", {}).get("energy_j", NAN)}
        row |= {"climb_j": climb_energy(settings, row["height_m"]) if row["planned"] else NAN}
        row |= interval_columns("ratio", *comparison.ratios.get(number, (NAN,) * 3))
        row |= {"as_good": number in comparison.alike, "recommended": number == comparison.recommended}
        row |= {"seeds": len(results), "reason": result.get("reason", ""), "metrics": {}}
        rows.append(row | {"rates": rates_of(fronts.get(number, ()), comparison.limits)})
    return rows


def recommendation(rows: Sequence[Columns], comparison: Comparison) -> str:
    """Where to fly, or that the levels cannot be distinguished."""
    best = next(row for row in rows if row["recommended"])
    alike = [row["name"] for row in rows if row["as_good"]]
    low, high = (f"{limit / 1e3:,.0f}" for limit in comparison.limits[[0, -1]])
    between = f"at equal length ({low} to {high} km)"
    others = [row for row in rows if row["planned"] and not row["as_good"]]
    worse = "; ".join(f"{row['name']} {_ratio_of(row)} times as often" for row in others)
    if len(alike) > 1:
        said = (
            f"**Cannot tell between {', '.join(alike)}**: they do not differ beyond the noise {between}. "
            f"{best['name']} is the first of those that fail at most {NEARLY:g} times as often as the best."
        )
        return f"{said} The others fail more often: {worse}." if others else said
    if not others:
        return f"**Fly at {best['name']}**: no other level has a plan."
    return f"**Fly at {best['name']}**: {between} the others fail more often: {worse}."


def median_ratio(rows: Sequence[Columns]) -> float:
    """Failure at the median level over failure at the best one, at equal length: what choosing brings."""
    ratios = sorted(row["ratio"] for row in rows if math.isfinite(row["ratio"]))
    return float(np.median(ratios)) if ratios else NAN


def _ratio_of(row: Columns) -> str:
    return ratio_text(*(row[f"ratio{end}"] for end in ("", "_low", "_high")))


def levels_study(settings: Settings, rows: list[Columns], comparison: Comparison, found: Found) -> Study:
    """Tables, numbers and text."""
    fronts = _fronts(settings[LevelsConfig].flights, found)
    limits = departure_fronts.map_lengths(fronts)
    rates = [rates_of(fronts.get(row["key"], ()), limits) for row in rows]
    table = [
        {key: int(value) if isinstance(value, bool) else value for key, value in _outer(row).items()}
        for row in rows
    ]
    lengths = [
        {"name": row["name"], "length_m": limit} | interval_columns("failure", *ends)
        for row, own in zip(rows, rates, strict=True)
        if row["planned"]
        for limit, ends in zip(limits.tolist(), own.tolist(), strict=True)
    ]
    numbers = {
        "levels": float(len(rows)),
        "levels_planned": float(sum(row["planned"] for row in rows)),
        "levels_as_good": float(sum(row["as_good"] for row in rows)),
        "plans": float(sum(map(len, found.values()))),
        "seed_spread": comparison.spread.sd,
        "median_ratio": median_ratio(rows),
    }
    routes = {
        number: np.array(planned_path(results)["x"], float)
        for number, results in found.items()
        if results[0]["planned"]
    }
    law = next(row["law"] for row in rows if row["planned"])
    heading = f"Plans by level, {law} {settings.medium.flows}"
    pictures = {
        "rows": rows, "routes": routes, "limits": limits, "rates": np.stack(rates)[:, :, 0],
        "heading": heading,
    }  # fmt: skip
    text = levels_text(settings, rows, comparison)
    return Study({"levels": table, "level_lengths": lengths}, numbers, text, pictures)


def _outer(row: Columns) -> Columns:
    return {key: value for key, value in row.items() if key not in OUTER}


def levels_text(settings: Settings, rows: Sequence[Columns], comparison: Comparison) -> str:
    """The recommendation, the table of all levels, and why some have no plan."""
    middle = len(comparison.limits) // 2
    table = markdown_table(
        "Levels; ratio: how many times as often a level fails as the best one at equal length, with an "
        "interval that holds for all levels together (95 %); plan: the path of the selection rule",
        {
            "level": lambda row: row["name"] + (" (recommended)" if row["recommended"] else ""),
            "seeds": "seeds",
            "ratio": lambda row: _ratio_of(row) if math.isfinite(row["ratio"]) else "no plan",
            f"failed at {comparison.limits[middle] / 1e3:.0f} km": lambda row: probability_text(
                row["rates"][middle, 0]
            ),
            "plan failed": lambda row: rate_cell(row, "failure"),
            "length [km]": length_cell,
            "flight [h]": lambda row: known_text(row["duration_s"] / HOUR, ".1f"),
            "wind [m/s]": lambda row: known_text(row["wind_speed"], ".1f"),
            "tail wind [m/s]": lambda row: known_text(row["tail_wind"], "+.1f"),
            "sd of the wind [m/s]": lambda row: known_text(row["wind_sd"], ".2f"),
            "energy [Wh]": lambda row: known_text(row["energy_j"] / HOUR, ".0f"),
            "climb [Wh]": lambda row: known_text(row["climb_j"] / HOUR, ".1f"),
        },
        rows,
    )
    said = [recommendation(rows, comparison)]
    if settings[LevelsConfig].mass is None and settings.robot.power.kind != "none":
        said.append("The energy of the climb is not known: set levels.mass [kg].")
    missing = [f"- {row['name']}: no plan: {row['reason']}" for row in rows if not row["planned"]]
    return "\n\n".join([*said, table.rstrip("\n"), *(["\n".join(missing)] if missing else [])]) + "\n"


def levels_document(settings: Settings, rows: Sequence[Columns], comparison: Comparison) -> dict[str, Any]:
    """The content of ``levels.json``."""
    spread, best = comparison.spread, next(row for row in rows if row["recommended"])
    alike = [row["name"] for row in rows if row["as_good"]]
    ends = ("failure", "low", "high")
    content: dict[str, Any] = plain_data({
        "schema": SCHEMA,
        "law": best["law"],
        "flights": settings[LevelsConfig].flights,
        "quick": settings[LevelsConfig].quick,
        "lengths_m": comparison.limits,
        "seed_spread": {"sd": spread.sd, "degrees_of_freedom": spread.freedom},
        "recommended": best["name"],
        "cannot_tell": alike if len(alike) > 1 else [],
        "median_ratio": median_ratio(rows),
        "levels": [
            _outer(row)
            | {"failure_at": [dict(zip(ends, rate, strict=True)) for rate in row["rates"].tolist()]}
            | {"reason": row["reason"]}
            for row in rows
        ],
    })  # fmt: skip
    return content
