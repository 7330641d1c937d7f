"""Costs of a path that are not probabilities, and the limits of a plan with their prices.

Paths are compared by risk and by these costs, one row each.

The length is a cost of every path, the energy of every robot with a power curve. ``selection.costs`` adds
others; costs of other packages are entry points in the group ``pareto_ltl.costs``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, energy_text
from pareto_ltl.support.extensions import COST_GROUP, extension_names, known_kind

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem

PRICE_KINDS = {
    "obstacle": "{} smaller on every side",
    "border": "{} farther out",
    "region": "{} larger on every side",
    "avoided": "{} smaller on every side",
    "airspeed": "{} more",
    "length": "{} more",
}  # kind: what a small change of it is, in words
SIGNIFICANT = 4.0  # standard errors of a price that is shown, at least
STILL = 1e-9  # [m] shorter steps have no course


@dataclass(frozen=True, slots=True)
class Cost:
    """A cost of a path; a lower one is better.

    Attributes
    ----------
    name : str
        Its key in ``Objectives.costs``, ``plan.json`` and ``selection.costs``.
    column : str
        Its column in ``front.csv`` and its name in ``metrics.json``, with the unit.
    of : callable
        Function from the problem, positions (T+1, 2) [m] and air-relative velocities (T, 2) [m/s] to the
        cost; None if the robot has no such cost. The expected path is straight, at constant speed, between
        positions.
    text : callable
        The number with its unit, as text.
    note : str
        What the number is, in a few words, for the page.
    label : str
        Its name with the unit of axes and heads of tables; the column if it is empty.
    scale : float
        The number in the unit of ``label``, for 1 in the unit of ``column``.
    """

    name: str
    column: str
    of: Callable[[Problem, FloatArray, FloatArray], float | None]
    text: Callable[[float], str]
    note: str = ""
    label: str = ""
    scale: float = 1.0


def path_length(_problem: Problem, x: FloatArray, _u: FloatArray) -> float:
    """Length of the expected path [m]."""
    return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())


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


def cost_in_column(column: str) -> Cost | None:
    """The cost in a column of ``front.csv``, None if there is none."""
    return next((cost for cost in known_costs() if cost.column == column), None)


def path_costs(problem: Problem, x: FloatArray, u: FloatArray) -> dict[str, float]:
    """The costs of ``problem.costs`` that its robot has, by name."""
    values = ((cost.name, cost.of(problem, x, u)) for cost in problem.costs)
    return {name: value for name, value in values if value is not None}


# --- limits: the chance constraint of each segment, and prices ----------------------------------------


@dataclass(frozen=True, slots=True)
class SegmentLimits:
    """How close each of T segments comes to its chance constraint, obstacles and walls together.

    Attributes
    ----------
    nearest : tuple of str
        The barrier whose supporting line is the fewest standard deviations from the segment.
    deviations : (T,) float
        Standard deviations of its nearer end beyond that line, 40 at most.
    probability : (T,) float
        Σ_lines Q(z) of the segment, which ``planner.epsilon`` limits; Eq. (M73) of docs/mathematics.md.
    price : (T,) float
        Failures saved per metre by which all barriers were farther from the segment [1/m].
    """

    nearest: tuple[str, ...]
    deviations: FloatArray
    probability: FloatArray
    price: FloatArray

    def after(self, step: int) -> SegmentLimits:
        """The limits of the segments from ``step`` on."""
        return SegmentLimits(
            self.nearest[step:], self.deviations[step:], self.probability[step:], self.price[step:]
        )


@dataclass(frozen=True, slots=True)
class Price:
    """The failures that a small change of one limit would save.

    Attributes
    ----------
    kind : str
        A key of :data:`PRICE_KINDS`.
    name : str
        The obstacle, border, region or limit.
    step : int or None
        The step at which the saving is largest.
    saving : float
        Fall of the failure rate per metre, and per m/s of airspeed.
    error : float
        Standard error of ``saving``: the flights that it is computed from are few. 0 where it is not known.
    """

    kind: str
    name: str
    step: int | None
    saving: float
    error: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether the interval of 95 % of the saving reaches from at least half of it to one and a half."""
        return self.saving >= SIGNIFICANT * self.error
