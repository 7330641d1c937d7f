"""Power of a robot at an airspeed, and the energy of a path: one type for each ``robot.power.kind``.

The power is for level flight at constant speed, without climbs, turns and gusts (docs/vehicles.md lists what
this leaves out).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pareto_ltl.settings import PowerConfig
from pareto_ltl.support.arrays import FloatArray

JOULE_PER_WH = 3600.0


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

    @property
    def hovers(self) -> bool:
        """Whether the robot has rotary wings, so that it can stay in place."""
        return isinstance(self.curve, Rotor)

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
