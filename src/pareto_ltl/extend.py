"""Names for packages that add kinds, and for what is made of plans (docs/adding.md).

Records of a run, wind sources and costs of a path; failure rates, and samples of flights for other rates;
laws of wind errors; a plan in a newer forecast, and other controls for its positions.

They are imported when they are used, as the names of ``pareto_ltl``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto_ltl.planning.cost import Cost
    from pareto_ltl.planning.evaluate import completing_path
    from pareto_ltl.planning.rates import FailureRate, Promise
    from pareto_ltl.run.newer_wind import in_newer_wind
    from pareto_ltl.run.record import Record, record
    from pareto_ltl.simulation.failure_modes import FlightEvent
    from pareto_ltl.simulation.promise import count_agrees
    from pareto_ltl.simulation.samples import FlightSample, plain_sample, weighted_samples
    from pareto_ltl.wind.error_law import LawPart
    from pareto_ltl.wind.law_of_parts import LawOfParts
    from pareto_ltl.wind.named_laws import first_law, law_of_parts_named, packaged_laws
    from pareto_ltl.wind.sources import WindSource

__all__ = [
    "Cost",
    "FailureRate",
    "FlightEvent",
    "FlightSample",
    "LawOfParts",
    "LawPart",
    "Promise",
    "Record",
    "WindSource",
    "completing_path",
    "count_agrees",
    "first_law",
    "in_newer_wind",
    "law_of_parts_named",
    "packaged_laws",
    "plain_sample",
    "record",
    "weighted_samples",
]

_EXPORTS = {
    "Cost": "pareto_ltl.planning.cost",
    "FailureRate": "pareto_ltl.planning.rates",
    "FlightEvent": "pareto_ltl.simulation.failure_modes",
    "FlightSample": "pareto_ltl.simulation.samples",
    "LawOfParts": "pareto_ltl.wind.law_of_parts",
    "LawPart": "pareto_ltl.wind.error_law",
    "Promise": "pareto_ltl.planning.rates",
    "Record": "pareto_ltl.run.record",
    "WindSource": "pareto_ltl.wind.sources",
    "completing_path": "pareto_ltl.planning.evaluate",
    "count_agrees": "pareto_ltl.simulation.promise",
    "first_law": "pareto_ltl.wind.named_laws",
    "in_newer_wind": "pareto_ltl.run.newer_wind",
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
