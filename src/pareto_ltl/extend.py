"""Names for packages that add kinds, and for what is made of plans (docs/adding.md).

- A run and its records: ``Pipeline``, ``planned_run``, ``Record``, ``record``, ``Study``, ``UnpricedRun``;
  ``Plan``, ``Front``, ``Forest``, ``Problem``, ``Decomposition``, ``Automaton``, ``Deployment``, their parts.
- Flights: ``evaluate`` a path or controls, ``draw_flights`` and ``simulate_flights``, ``which_fail``, samples
  and rates of any event; wind at a place: ``LocalWind``, ``LinearWind``.
- Planning again: ``build_problem`` of other records, ``search_paths`` on which given flights seldom fail,
  ``evaluate_path``, ``fresh_promise``; a ``PlanAddition`` to plans, e.g. their ``Branching`` with its parts.
- Kinds: ``Cost``; ``WindSource``, with what a reader of winds returns (``Snapshot``, ``readings_of``) and is
  asked for (``Wanted``, ``GeoBox``); readers of maps (``MapFormats``, ``SceneSketch``) and of automata
  (``AutomatonFormats``); laws of wind errors.
- Sections of :class:`pareto_ltl.Settings` and their ``Declaration``, of which a section of another package is
  made, too: ``CheckedSettings``, ``setting``, ``check_time``; ``Frame``, the plane and clock of a map.

They stand in ``extend.pyi`` and are imported when they are used, as the names of ``pareto_ltl``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from careful_io.stated_names import stated_names

__all__ = sorted(stated_names(__file__))  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    module = stated_names(__file__).get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(module), name)


def __dir__() -> list[str]:
    return __all__
