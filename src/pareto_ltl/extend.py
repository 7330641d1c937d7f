"""Names for packages that add kinds, and for what is made of plans (docs/adding.md).

- A run and its records: ``Pipeline``, ``planned_run``, ``Record``, ``record``, ``Study``, ``UnpricedRun``;
  ``Plan``, ``Front``, ``Forest``, ``Problem``, ``Decomposition``, ``Automaton``, ``Deployment``, their parts.
- Flights: ``evaluate`` a path or controls, ``draw_flights`` and ``simulate_flights``, ``which_fail``, samples
  and rates of any event; ``Learnt`` from position ``Fix``; wind at a place: ``LocalWind``, ``LinearWind``.
- Kinds: ``Cost``; ``WindSource``, with what a reader of winds returns (``Snapshot``, ``readings_of``) and is
  asked for (``Wanted``, ``GeoBox``); readers of maps (``MapFile``, ``MapFormats``); laws of wind errors.
- Sections of :class:`pareto_ltl.Settings` and their ``Declaration``; ``Frame``, the plane and clock of a map.

They are imported when they are used, as the names of ``pareto_ltl``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto_ltl.logic.automaton import Automaton, show_letter, translate
    from pareto_ltl.logic.formula import Formula, disputed_reading, parse_formula
    from pareto_ltl.planning.branching.records import Branch, Branching, plan_on_branch
    from pareto_ltl.planning.conditioning import Fix, Learnt
    from pareto_ltl.planning.cost import Cost
    from pareto_ltl.planning.costs import cost_named, known_costs
    from pareto_ltl.planning.evaluate import Forecast, completing_path, evaluate
    from pareto_ltl.planning.limits import Price, SegmentLimits
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.rates import FailureRate, Promise
    from pareto_ltl.planning.records import Forest, Front, Objectives, Plan, PlannedPath, Tree
    from pareto_ltl.planning.selection import accepted_rows, non_dominated
    from pareto_ltl.planning.wind_lookup import LinearWind, LocalWind
    from pareto_ltl.run.pipeline import Pipeline
    from pareto_ltl.run.plan_run import UnpricedRun
    from pareto_ltl.run.progress import ProgressBar, Watcher, watched_by
    from pareto_ltl.run.record import Record, record
    from pareto_ltl.run.results import Planned, planned_run
    from pareto_ltl.run.study import Study
    from pareto_ltl.settings import (
        FidelityConfig,
        MissionConfig,
        PowerConfig,
        RobotConfig,
        SelectionConfig,
        WindConfig,
    )
    from pareto_ltl.settings.checks import Declaration, Setting
    from pareto_ltl.settings.heights import FlownAir, Height
    from pareto_ltl.simulation.beacons import BeaconMap
    from pareto_ltl.simulation.common_flights import DrawnFlights, draw_flights
    from pareto_ltl.simulation.failure_modes import FlightEvent
    from pareto_ltl.simulation.flights import law_seeds, simulate_flights
    from pareto_ltl.simulation.judging import which_fail
    from pareto_ltl.simulation.promise import count_agrees
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.simulation.samples import FlightSample, plain_sample, weighted_samples
    from pareto_ltl.wind.air import NodeAir
    from pareto_ltl.wind.area import GeoBox, Wanted
    from pareto_ltl.wind.between import with_interpolation_errors
    from pareto_ltl.wind.error_law import LawPart
    from pareto_ltl.wind.law_of_parts import LawOfParts
    from pareto_ltl.wind.named_laws import first_law, law_of_newer_runs, law_of_parts_named, packaged_laws
    from pareto_ltl.wind.snapshots import Snapshot, readings_of
    from pareto_ltl.wind.sources import WindFormats, WindSource, data_files
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.map_file import MapFile, MapFormats, Unread
    from pareto_ltl.world.projection import Frame
    from pareto_ltl.world.windows import Window

__all__ = [
    "Automaton",
    "BeaconMap",
    "Branch",
    "Branching",
    "Cost",
    "Declaration",
    "Decomposition",
    "Deployment",
    "DrawnFlights",
    "FailureRate",
    "FidelityConfig",
    "Fix",
    "FlightEvent",
    "FlightSample",
    "FlownAir",
    "Forecast",
    "Forest",
    "Formula",
    "Frame",
    "Front",
    "GeoBox",
    "Height",
    "LawOfParts",
    "LawPart",
    "Learnt",
    "LinearWind",
    "LocalWind",
    "MapFile",
    "MapFormats",
    "MissionConfig",
    "NodeAir",
    "Objectives",
    "Pipeline",
    "Plan",
    "Planned",
    "PlannedPath",
    "PowerConfig",
    "Price",
    "Problem",
    "ProgressBar",
    "Promise",
    "Record",
    "RobotConfig",
    "SegmentLimits",
    "SelectionConfig",
    "Setting",
    "Snapshot",
    "Study",
    "Tree",
    "UnpricedRun",
    "Unread",
    "Wanted",
    "Watcher",
    "WindConfig",
    "WindFormats",
    "WindSource",
    "Window",
    "accepted_rows",
    "completing_path",
    "cost_named",
    "count_agrees",
    "data_files",
    "disputed_reading",
    "draw_flights",
    "evaluate",
    "first_law",
    "known_costs",
    "law_of_newer_runs",
    "law_of_parts_named",
    "law_seeds",
    "non_dominated",
    "packaged_laws",
    "parse_formula",
    "plain_sample",
    "plan_on_branch",
    "planned_run",
    "readings_of",
    "record",
    "show_letter",
    "simulate_flights",
    "translate",
    "watched_by",
    "weighted_samples",
    "which_fail",
    "with_interpolation_errors",
]

_EXPORTS = {
    "Automaton": "pareto_ltl.logic.automaton",
    "BeaconMap": "pareto_ltl.simulation.beacons",
    "Branch": "pareto_ltl.planning.branching.records",
    "Branching": "pareto_ltl.planning.branching.records",
    "Cost": "pareto_ltl.planning.cost",
    "Declaration": "pareto_ltl.settings.checks",
    "Decomposition": "pareto_ltl.world.cells",
    "Deployment": "pareto_ltl.simulation.records",
    "DrawnFlights": "pareto_ltl.simulation.common_flights",
    "FailureRate": "pareto_ltl.planning.rates",
    "FidelityConfig": "pareto_ltl.settings",
    "Fix": "pareto_ltl.planning.conditioning",
    "FlightEvent": "pareto_ltl.simulation.failure_modes",
    "FlightSample": "pareto_ltl.simulation.samples",
    "FlownAir": "pareto_ltl.settings.heights",
    "Forecast": "pareto_ltl.planning.evaluate",
    "Forest": "pareto_ltl.planning.records",
    "Formula": "pareto_ltl.logic.formula",
    "Frame": "pareto_ltl.world.projection",
    "Front": "pareto_ltl.planning.records",
    "GeoBox": "pareto_ltl.wind.area",
    "Height": "pareto_ltl.settings.heights",
    "LawOfParts": "pareto_ltl.wind.law_of_parts",
    "LawPart": "pareto_ltl.wind.error_law",
    "Learnt": "pareto_ltl.planning.conditioning",
    "LinearWind": "pareto_ltl.planning.wind_lookup",
    "LocalWind": "pareto_ltl.planning.wind_lookup",
    "MapFile": "pareto_ltl.world.map_file",
    "MapFormats": "pareto_ltl.world.map_file",
    "MissionConfig": "pareto_ltl.settings",
    "NodeAir": "pareto_ltl.wind.air",
    "Objectives": "pareto_ltl.planning.records",
    "Pipeline": "pareto_ltl.run.pipeline",
    "Plan": "pareto_ltl.planning.records",
    "Planned": "pareto_ltl.run.results",
    "PlannedPath": "pareto_ltl.planning.records",
    "PowerConfig": "pareto_ltl.settings",
    "Price": "pareto_ltl.planning.limits",
    "Problem": "pareto_ltl.planning.problem",
    "ProgressBar": "pareto_ltl.run.progress",
    "Promise": "pareto_ltl.planning.rates",
    "Record": "pareto_ltl.run.record",
    "RobotConfig": "pareto_ltl.settings",
    "SegmentLimits": "pareto_ltl.planning.limits",
    "SelectionConfig": "pareto_ltl.settings",
    "Setting": "pareto_ltl.settings.checks",
    "Snapshot": "pareto_ltl.wind.snapshots",
    "Study": "pareto_ltl.run.study",
    "Tree": "pareto_ltl.planning.records",
    "UnpricedRun": "pareto_ltl.run.plan_run",
    "Unread": "pareto_ltl.world.map_file",
    "Wanted": "pareto_ltl.wind.area",
    "Watcher": "pareto_ltl.run.progress",
    "WindConfig": "pareto_ltl.settings",
    "WindFormats": "pareto_ltl.wind.sources",
    "WindSource": "pareto_ltl.wind.sources",
    "Window": "pareto_ltl.world.windows",
    "accepted_rows": "pareto_ltl.planning.selection",
    "completing_path": "pareto_ltl.planning.evaluate",
    "cost_named": "pareto_ltl.planning.costs",
    "count_agrees": "pareto_ltl.simulation.promise",
    "data_files": "pareto_ltl.wind.sources",
    "disputed_reading": "pareto_ltl.logic.formula",
    "draw_flights": "pareto_ltl.simulation.common_flights",
    "evaluate": "pareto_ltl.planning.evaluate",
    "first_law": "pareto_ltl.wind.named_laws",
    "known_costs": "pareto_ltl.planning.costs",
    "law_of_newer_runs": "pareto_ltl.wind.named_laws",
    "law_of_parts_named": "pareto_ltl.wind.named_laws",
    "law_seeds": "pareto_ltl.simulation.flights",
    "non_dominated": "pareto_ltl.planning.selection",
    "packaged_laws": "pareto_ltl.wind.named_laws",
    "parse_formula": "pareto_ltl.logic.formula",
    "plain_sample": "pareto_ltl.simulation.samples",
    "plan_on_branch": "pareto_ltl.planning.branching.records",
    "planned_run": "pareto_ltl.run.results",
    "readings_of": "pareto_ltl.wind.snapshots",
    "record": "pareto_ltl.run.record",
    "show_letter": "pareto_ltl.logic.automaton",
    "simulate_flights": "pareto_ltl.simulation.flights",
    "translate": "pareto_ltl.logic.automaton",
    "watched_by": "pareto_ltl.run.progress",
    "weighted_samples": "pareto_ltl.simulation.samples",
    "which_fail": "pareto_ltl.simulation.judging",
    "with_interpolation_errors": "pareto_ltl.wind.between",
}


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module 'pareto_ltl.extend' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
