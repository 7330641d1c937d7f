"""Costs of a path that are not probabilities: paths are compared by risk and by these costs, one row each.

The length is a cost of every path, the energy of every robot with a power curve. ``selection.costs`` adds
others; costs of other packages are entry points in the group ``pareto_ltl.costs``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.planning.cost import Cost
from pareto_ltl.planning.held_air import air_text, held_air
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.display import distance_text, energy_text
from pareto_ltl.support.extensions import COST_GROUP, extension_names, known_kind

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem

STILL = 1e-9  # [m] shorter steps have no course


def path_length(_problem: Problem, x: FloatArray, _u: FloatArray) -> float:
    """Length of the expected path [m]."""
    return length_of(x)


def path_energy(problem: Problem, _x: FloatArray, u: FloatArray) -> float | None:
    """Energy of the airspeeds [J]; None without a power curve."""
    return None if problem.energy is None else problem.energy.of(u, problem.motion.dt)


def flight_time(problem: Problem, _x: FloatArray, u: FloatArray) -> float:
    """Time from departure to arrival [s]."""
    return len(u) * problem.motion.dt


def turned_angle(_problem: Problem, x: FloatArray, _u: FloatArray) -> float:
    """Sum of the absolute changes of course along the expected path [deg]."""
    steps = np.diff(x, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > STILL]
    course = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.degrees(np.abs(np.diff(course)).sum()))


def hours_text(seconds: float) -> str:
    """A time [s] as text in hours."""
    return f"{seconds / 3600:,.2f} h"


def degrees_text(angle: float) -> str:
    """An angle [deg] as text."""
    return f"{angle:,.0f}°"


COSTS = {
    cost.name: cost
    for cost in (
        Cost(
            "length", "length_m", path_length, distance_text, "of the expected path", "path length [km]", 1e-3
        ),
        Cost("energy", "energy_j", path_energy, energy_text, "for the airspeeds", "energy [MJ]", 1e-6),
        Cost("duration", "arrival_s", flight_time, hours_text, "until arrival", "duration [h]", 1 / 3600),
        Cost("turns", "turns_deg", turned_angle, degrees_text, "sum of all turns", "turns [deg]"),
        Cost("containment", "air_km2_h", held_air, air_text, "area and time that hold it", "air [km² h]"),
    )
}
ALWAYS = (COSTS["length"], COSTS["energy"])


def cost_named(name: str) -> Cost:
    """The cost ``name``, of this package or of another; errors as in ``known_kind``."""
    return known_kind(COST_GROUP, COSTS, name, lambda loaded: isinstance(loaded, Cost))


def costs_with(names: Iterable[str]) -> tuple[Cost, ...]:
    """Length, energy, and the costs of ``names`` in that order."""
    return tuple(dict.fromkeys((*ALWAYS, *map(cost_named, names))))


def known_costs() -> tuple[Cost, ...]:
    """All costs, also of other packages."""
    return tuple(map(cost_named, (*COSTS, *extension_names(COST_GROUP, COSTS))))
