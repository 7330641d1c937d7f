"""Names for packages that add kinds, and for what is made of plans (docs/adding.md).

Records of a run and what they consist of, studies, wind sources and costs of a path; failure rates; laws of
wind errors.

They are imported when they are used, as the names of ``pareto_ltl``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto_ltl.logic.automaton import Automaton
    from pareto_ltl.planning.cost import Cost
    from pareto_ltl.planning.evaluate import Forecast, completing_path
    from pareto_ltl.planning.limits import Price
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.rates import FailureRate, Promise
    from pareto_ltl.planning.records import Forest, Front, Objectives, Plan, PlannedPath, Tree
    from pareto_ltl.run.record import Record, record
    from pareto_ltl.run.study import Study
    from pareto_ltl.simulation.failure_modes import FlightEvent
    from pareto_ltl.simulation.promise import count_agrees
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.simulation.samples import FlightSample, plain_sample, weighted_samples
    from pareto_ltl.wind.between import with_interpolation_errors
    from pareto_ltl.wind.error_law import LawPart
    from pareto_ltl.wind.law_of_parts import LawOfParts
    from pareto_ltl.wind.named_laws import first_law, law_of_newer_runs, law_of_parts_named, packaged_laws
    from pareto_ltl.wind.sources import WindSource
    from pareto_ltl.world.cells import Decomposition

__all__ = [
    "Automaton",
    "Cost",
    "Decomposition",
    "Deployment",
    "FailureRate",
    "FlightEvent",
    "FlightSample",
    "Forecast",
    "Forest",
    "Front",
    "LawOfParts",
    "LawPart",
    "Objectives",
    "Plan",
    "PlannedPath",
    "Price",
    "Problem",
    "Promise",
    "Record",
    "Study",
    "Tree",
    "WindSource",
    "completing_path",
    "count_agrees",
    "first_law",
    "law_of_newer_runs",
    "law_of_parts_named",
    "packaged_laws",
    "plain_sample",
    "record",
    "weighted_samples",
    "with_interpolation_errors",
]

_EXPORTS = {
    "Automaton": "pareto_ltl.logic.automaton",
    "Cost": "pareto_ltl.planning.cost",
    "Decomposition": "pareto_ltl.world.cells",
    "Deployment": "pareto_ltl.simulation.records",
    "FailureRate": "pareto_ltl.planning.rates",
    "Forecast": "pareto_ltl.planning.evaluate",
    "Forest": "pareto_ltl.planning.records",
    "Front": "pareto_ltl.planning.records",
    "FlightEvent": "pareto_ltl.simulation.failure_modes",
    "FlightSample": "pareto_ltl.simulation.samples",
    "LawOfParts": "pareto_ltl.wind.law_of_parts",
    "LawPart": "pareto_ltl.wind.error_law",
    "Objectives": "pareto_ltl.planning.records",
    "Plan": "pareto_ltl.planning.records",
    "PlannedPath": "pareto_ltl.planning.records",
    "Price": "pareto_ltl.planning.limits",
    "Problem": "pareto_ltl.planning.problem",
    "Promise": "pareto_ltl.planning.rates",
    "Record": "pareto_ltl.run.record",
    "Study": "pareto_ltl.run.study",
    "Tree": "pareto_ltl.planning.records",
    "WindSource": "pareto_ltl.wind.sources",
    "completing_path": "pareto_ltl.planning.evaluate",
    "count_agrees": "pareto_ltl.simulation.promise",
    "first_law": "pareto_ltl.wind.named_laws",
    "with_interpolation_errors": "pareto_ltl.wind.between",
    "law_of_newer_runs": "pareto_ltl.wind.named_laws",
    "law_of_parts_named": "pareto_ltl.wind.named_laws",
    "packaged_laws": "pareto_ltl.wind.named_laws",
    "plain_sample": "pareto_ltl.simulation.samples",
    "record": "pareto_ltl.run.record",
    "weighted_samples": "pareto_ltl.simulation.samples",
}


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module 'pareto_ltl.extend' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
