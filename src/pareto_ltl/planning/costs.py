"""Costs of a path that are not probabilities, the limits of a plan with their prices, and the robot's power.

Paths are compared by risk and by these costs, one row each.

The length is a cost of every path, the energy of every robot with a power curve. ``selection.costs`` adds
others; costs of other packages are entry points in the group ``pareto_ltl.costs``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.settings import PowerConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, energy_text, probability_text
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
JOULE_PER_WH = 3600.0
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
class WorstSegment:
    """The segment of a path that is most likely to collide.

    Attributes
    ----------
    step : int
        Number of the segment, the first has the number 0.
    nearest : str
        Its closest barrier: ``obstacle 3``, ``the western border``, ``region c`` that the mission forbids.
    probability : float
        Σ_lines Q(z) over obstacles, walls and forbidden regions; Eq. (M73) of docs/mathematics.md.
    """

    step: int
    nearest: str
    probability: float


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change that was tried on a plan, and the figures of the same path after it.

    Attributes
    ----------
    change : str
        For people: ``position feedback, robot.feedback_time=300``.
    worst_segment_probability : float
        Collision probability of the worst segment.
    failure : float
        Share of ``runs`` flights that fail.
    """

    change: str
    worst_segment_probability: float
    failure: float
    runs: int


def remedies_text(remedies: Sequence[Remedy]) -> str:
    """The figures of changes that help, at least one, for people."""
    shown = (
        f"{remedy.change}: worst segment {probability_text(remedy.worst_segment_probability)}, fails "
        f"{probability_text(remedy.failure)}"
        for remedy in remedies
    )
    return f"tried with {remedies[0].runs:,} flights of the same path each: {'; '.join(shown)}"


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


# --- power at an airspeed, and the energy of a path: one type for each ``robot.power.kind`` ----------------

# The power is for level flight at constant speed, without climbs, turns and gusts (docs/vehicles.md lists
# what this leaves out).


@dataclass(frozen=True, slots=True)
class Body:
    """A body that its own buoyancy carries, an airship or an underwater glider: P = base + drag v³."""

    base: float
    drag: float

    def watts(self, airspeed: FloatArray) -> FloatArray:
        """P(v) [W] at ``airspeed`` [m/s], elementwise."""
        return self.base + self.drag * airspeed**3


@dataclass(frozen=True, slots=True)
class Wing:
    """A fixed wing: parasitic drag grows with v, induced drag falls; P = base + drag v³ + lift / v.

    Anderson, Aircraft Performance and Design, 1999, Section 5.6; v > 0.
    """

    base: float
    drag: float
    lift: float

    def watts(self, airspeed: FloatArray) -> FloatArray:
        """P(v) [W] at ``airspeed`` > 0 [m/s], elementwise."""
        return self.base + self.drag * airspeed**3 + self.lift / airspeed


@dataclass(frozen=True, slots=True)
class Rotor:
    """Rotary wings (Zeng, Xu and Zhang, Eq. 12, doi:10.1109/TWC.2019.2902559).

    P = base + blade (1 + 3 v² / tip²) + lifting (√(1 + v⁴ / 4 wake⁴) - v² / 2 wake²)^½ + drag v³
    """

    base: float
    drag: float
    blade: float
    lifting: float
    tip: float
    wake: float

    def watts(self, airspeed: FloatArray) -> FloatArray:
        """P(v) [W] at ``airspeed`` [m/s], elementwise."""
        ratio = airspeed**2 / (2.0 * self.wake**2)
        inflow = 1.0 / (np.sqrt(1.0 + ratio**2) + ratio)  # √(1 + r²) - r, written so that no digits cancel
        profile = self.blade * (1.0 + 3.0 * airspeed**2 / self.tip**2)
        return np.asarray(self.base + profile + self.lifting * np.sqrt(inflow) + self.drag * airspeed**3)


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Linear interpolation between measured points: rising ``airspeed`` (n,) [m/s] and ``power`` (n,) [W]."""

    base: float
    airspeed: FloatArray
    power: FloatArray

    def watts(self, airspeed: FloatArray) -> FloatArray:
        """P(v) [W] at ``airspeed`` [m/s], elementwise; outside the table the value at its nearer end."""
        return self.base + np.interp(airspeed, self.airspeed, self.power)


PowerCurve = Body | Wing | Rotor | Table
CURVES: dict[str, Callable[[PowerConfig], PowerCurve | None]] = {
    "none": lambda _cfg: None,
    "body": lambda cfg: Body(cfg.base, cfg.drag),
    "wing": lambda cfg: Wing(cfg.base, cfg.drag, cfg.lift),
    "rotor": lambda cfg: Rotor(cfg.base, cfg.drag, cfg.blade, cfg.lifting, cfg.tip, cfg.wake),
    "table": lambda cfg: Table(cfg.base, *np.array(cfg.points, float).T),
}


@dataclass(frozen=True, slots=True)
class EnergyModel:
    """The power curve of a robot, and the energy that it can use [J]; None where that is not known."""

    curve: PowerCurve
    capacity: float | None

    def of(self, u: FloatArray, dt: float) -> float:
        """Energy of the controls ``u`` (T, 2) [m/s], each held for ``dt`` [s]: Σ P(‖u_t‖) dt [J].

        Eq. (M4) of docs/mathematics.md.
        """
        return float(self.curve.watts(np.hypot(u[:, 0], u[:, 1])).sum() * dt)


def energy_model(cfg: PowerConfig) -> EnergyModel | None:
    """The model of the settings; None for a robot without a power curve."""
    curve = CURVES[cfg.kind](cfg)
    if curve is None:
        return None
    return EnergyModel(curve, None if cfg.capacity is None else cfg.capacity * JOULE_PER_WH)
