"""Costs of a path that are not probabilities: paths are compared by risk and by these costs, one file each.

The length is a cost of every path, the energy of every robot with a power curve. ``selection.costs`` adds
others, by the names of their files; costs of other packages are entry points in the group
``pareto_ltl.costs``.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module

from pareto_ltl.planning.cost import COSTS, Cost
from pareto_ltl.settings.planner import ALWAYS_COSTS, FURTHER_COSTS
from pareto_ltl.support import extensions

for _name in (*ALWAYS_COSTS, *FURTHER_COSTS):
    import_module(f"{__name__}.{_name}")
ALWAYS = tuple(COSTS[name] for name in ALWAYS_COSTS)


def cost_named(name: str) -> Cost:
    """The cost ``name``, of this package or of another; errors as in ``Group.kind``."""
    return extensions.COSTS.kind(COSTS, name, lambda loaded: isinstance(loaded, Cost))


def costs_with(names: Iterable[str]) -> tuple[Cost, ...]:
    """Length, energy, and the costs of ``names`` in that order."""
    return tuple(dict.fromkeys((*ALWAYS, *map(cost_named, names))))


def known_costs() -> tuple[Cost, ...]:
    """All costs, also of other packages."""
    return tuple(map(cost_named, (*COSTS, *extensions.COSTS.names(COSTS))))
