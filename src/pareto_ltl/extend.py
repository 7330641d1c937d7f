"""Names for packages that add kinds, and for what is made of plans (docs/adding.md).

Records of a run, wind sources and costs of a path; failure rates; laws of wind errors.

They are imported when they are used, as the names of ``pareto_ltl``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto_ltl.planning.cost import Cost
    from pareto_ltl.planning.rates import FailureRate, Promise
    from pareto_ltl.run.record import Record, record
    from pareto_ltl.wind.error_law import LawPart
    from pareto_ltl.wind.law_of_parts import LawOfParts
    from pareto_ltl.wind.named_laws import first_law, law_of_newer_runs, law_of_parts_named, packaged_laws
    from pareto_ltl.wind.sources import WindSource

__all__ = [
    "Cost",
    "FailureRate",
    "LawOfParts",
    "LawPart",
    "Promise",
    "Record",
    "WindSource",
    "first_law",
    "law_of_newer_runs",
    "law_of_parts_named",
    "packaged_laws",
    "record",
]

_EXPORTS = {
    "Cost": "pareto_ltl.planning.cost",
    "FailureRate": "pareto_ltl.planning.rates",
    "LawOfParts": "pareto_ltl.wind.law_of_parts",
    "LawPart": "pareto_ltl.wind.error_law",
    "Promise": "pareto_ltl.planning.rates",
    "Record": "pareto_ltl.run.record",
    "WindSource": "pareto_ltl.wind.sources",
    "first_law": "pareto_ltl.wind.named_laws",
    "law_of_newer_runs": "pareto_ltl.wind.named_laws",
    "law_of_parts_named": "pareto_ltl.wind.named_laws",
    "packaged_laws": "pareto_ltl.wind.named_laws",
    "record": "pareto_ltl.run.record",
}


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module 'pareto_ltl.extend' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
