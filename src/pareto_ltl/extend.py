"""Names for packages that add kinds: records of a run, wind sources and costs of a path (docs/adding.md).

They are imported when they are used, as the names of ``pareto_ltl``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto_ltl.planning.cost import Cost
    from pareto_ltl.run.record import Record, record
    from pareto_ltl.wind.sources import WindSource

__all__ = ["Cost", "Record", "WindSource", "record"]

_EXPORTS = {
    "Cost": "pareto_ltl.planning.cost",
    "Record": "pareto_ltl.run.record",
    "WindSource": "pareto_ltl.wind.sources",
    "record": "pareto_ltl.run.record",
}


def __getattr__(name: str) -> Any:
    if name in _EXPORTS:
        return getattr(import_module(_EXPORTS[name]), name)
    raise AttributeError(f"module 'pareto_ltl.extend' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
