"""The benefit of replanning in real winds: random missions flown through later analyses.

The missions and what planning knows at departure are as in ``pipelines=forecast_test``. Each is flown once
in each way of ``studies/replanning.py``, through the later fields; a newer forecast is what has become
available ``forecast_test.delay`` after the start of its cycle. A mission is one trial.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM, Records
from pareto_ltl.run.rest_of_flight import NewWind
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.common_flights import DrawnFlights, draw_flights
from pareto_ltl.studies.forecast_test import UNIMPORTANT, known_of_files, mission_settings, reality
from pareto_ltl.studies.known_winds import DepartureWinds
from pareto_ltl.studies.parts import Part, PartsProgress, half_the_cores, part_key, work_parts
from pareto_ltl.studies.random_missions import Mission, mission
from pareto_ltl.studies.replanning import (
    EFFORT,
    ReplanningContext,
    fly_way,
    replanning_study,
    ways_of,
)
from pareto_ltl.studies.statistics import Columns
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.support.fingerprints import file_fingerprint

STREAM = "replan test"
LAW = "later"  # the winds of the flights: later fields


@dataclass(frozen=True, slots=True)
class FieldCycles:
    """Forecasts of the files that have become available on the way of ``task``."""

    known: DepartureWinds
    task: Mission

    def at(self, run: Run, _wind: DrawnFlights, _number: int, step: int) -> NewWind:
        """The readings known at ``step``."""
        return self.known.readings(self.task, step * run[PROBLEM].motion.dt)


def run_replan_test(
    settings: Settings, _: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Fly the missions of ``settings.forecast_test`` in the ways of ``settings.replanning``."""
    cfg, ways = settings.forecast_test, settings.replanning
    known = known_of_files(settings, replace(cfg, known="departure"), directory)
    inputs = {key: value for key, value in asdict(cfg).items() if key not in UNIMPORTANT}
    files = [file_fingerprint(file) for file in known.truth.files]
    replans = [ways.fixes, ways.every, ways.forecasts, ways.fix_sd, EFFORT]
    base = part_key(settings, STREAM, inputs, settings.border, replans, files)
    todo = [Part(f"mission-{k}", (k,), part_key(settings, base, k)) for k in range(cfg.missions)]
    results = work_parts(half_the_cores(settings.evaluation), directory, mission_part, known, todo, progress)
    return missions_study(results)


def mission_part(known: DepartureWinds, k: int) -> Columns:
    """Mission ``k`` flown once in each way; the reason if it has no plan."""
    settings, cfg = known.settings, known.cfg
    task = mission(cfg, settings.seed, k, known.spells, settings.border)
    run = known.run_of(task, mission_settings(settings, cfg, task, settings.fidelity))
    try:
        run.make(PLAN)
    except (InfeasibleError, DataError) as error:
        return {"reason": str(error), "flown": {}}
    winds = draw_flights(reality(known, run), "independent", 1, stage_seeds(settings.seed + k, STREAM))
    ways = ways_of(settings.replanning, run)
    context = ReplanningContext(run, winds, ways, FieldCycles(known, task))
    about = {
        "mission": k,
        "formula": task.formula,
        "departure": task.scene.time_zero,
        "situation": task.spell.name,
    }
    return {"reason": "", "flown": {way.name: about | fly_way(context, way, 0) for way in ways}}


def missions_study(results: Sequence[Mapping[str, Any]]) -> Study:
    """The rates of all missions that have a plan; InfeasibleError if none has."""
    planned = [result["flown"] for result in results if result["flown"]]
    if not planned:
        raise InfeasibleError(
            f"none of {len(results)} random missions has a plan ({results[0]['reason']}); lower "
            "forecast_test.side, or raise robot.u_max or planner.epsilon"
        )
    flown = {name: [flights[name] for flights in planned] for name in planned[0]}
    weather = len({flight["situation"] for flight in flown[next(iter(flown))]})
    study = replanning_study(
        flown, LAW,
        f"{len(planned)} of {len(results)} random missions with a plan, each flown once through the later "
        f"fields of {weather} weather situations, which the intervals ignore",
    )  # fmt: skip
    counts = {"missions": float(len(results)), "missions_planned": float(len(planned))}
    return replace(study, numbers={**study.numbers, **counts})
