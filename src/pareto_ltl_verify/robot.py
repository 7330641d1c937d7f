"""The robot: its dynamics, airspeeds, power and turns, from the settings alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pareto_ltl_verify.arrays import BoolArray, FloatArray

PARTS = 2000  # time steps of a leg
NODES = 12  # of a quadrature over each of a robot's errors
SHARP = math.radians(169.9)  # [rad] sharper turns count as without room: an autopilot may turn the other way
G = 9.80665  # [m/s²]
Power = Callable[[float], float]


@dataclass(frozen=True)
class Errors:
    """Mean (Q,) and covariance (Q, Q) of the errors of a robot that last for a flight; Q = 0 without any.

    ``shared`` (2, Q) is the covariance of the start and the errors.
    """

    mean: FloatArray
    cov: FloatArray
    shared: FloatArray

    def __len__(self) -> int:
        return len(self.mean)

    @cached_property
    def root(self) -> FloatArray:
        """A root of the covariance, (Q, Q)."""
        size, axes = np.linalg.eigh(self.cov)
        return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)), float)

    @cached_property
    def start(self) -> FloatArray:
        """What a standard normal draw of each column of the root adds to the start, (2, Q) [m]."""
        return np.asarray(self.shared @ np.linalg.pinv(self.root, rcond=1e-12).T, float)

    @cached_property
    def flown(self) -> tuple[FloatArray, FloatArray]:
        """The mean of what is flown, as matrices (2, 2): of a control, and of the change from the last [s].

        The mean of (1 + a) R(b) and of c (1 + a) R(b), by quadrature over the three errors, which is exact
        for polynomials and here to rounding.
        """
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
        weights = weights / weights.sum()
        z = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij")).reshape(3, -1)
        share = np.einsum("i,j,k->ijk", weights, weights, weights).ravel()
        scale, angle, late = self.mean[:, None] + self.root @ z
        turn = (1.0 + scale) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return turn @ share, turn @ (late * share)


NO_ERRORS = Errors(np.zeros(0), np.zeros((0, 0)), np.zeros((2, 0)))


@dataclass(frozen=True)
class Robot:
    """Dynamics x' = A x + dt (B u + w), limits of the airspeed, feedback and position fixes; SI units."""

    a: FloatArray
    b: FloatArray
    dt: float
    u_min: float
    u_max: float
    start_sd: float
    feedback_time: float | None
    effort_risk: float
    fix_sd: float
    fix_time: float
    ball: float
    bank: float = 0.0
    turn_delay: float = 0.0
    power: Power | None = None  # [W] at an airspeed [m/s]; None without a power curve
    airspeed_sd: float | None = None  # of errors that last for a flight: relative; None if not modelled
    heading_sd: float | None = None  # [deg]
    clock_sd: float | None = None  # [s]
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)  # expected errors: relative, clockwise [deg], [s]
    correlation: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # of airspeed and heading, airspeed and clock, both
    start_shared: Any = ((0.0, 0.0),) * 3  # covariances of the start (x, y) [m] with the three errors
    capacity: float | None = None  # energy that the robot can use [J]; None if it is not limited

    @cached_property
    def errors(self) -> Errors:
        """The law of the errors of airspeed, heading [rad, counter-clockwise] and clock."""
        sd = np.array([self.airspeed_sd or 0.0, math.radians(self.heading_sd or 0.0), self.clock_sd or 0.0])
        (a, b, c), (ab, ac, bc) = self.bias, self.correlation
        if not sd.any():
            return NO_ERRORS
        alike = np.array([[1.0, -ab, ac], [-ab, 1.0, -bc], [ac, -bc, 1.0]])
        shared = np.array(self.start_shared).T * [1.0, -math.radians(1.0), 1.0]
        return Errors(np.array([a, -math.radians(b), c]), alike * np.outer(sd, sd), shared)

    def flown(self, u: FloatArray, before: FloatArray, drawn: FloatArray) -> FloatArray:
        """Velocities (n, 2) through the air of robots that command ``u`` (n, 2), and ``before`` a step ago.

        ``drawn`` (n, 3) are independent standard normal draws for each: the airspeed is wrong by a share, the
        heading by an angle, and the control of the step before is flown for a time too long.
        """
        if not drawn.shape[1]:
            return u
        scale, angle, late = (self.errors.mean + drawn @ self.errors.root.T).T[:, :, None]
        held = u + late / self.dt * (before - u)
        turned = np.stack([-held[:, 1], held[:, 0]], axis=1)
        return np.asarray((1.0 + scale) * (np.cos(angle) * held + np.sin(angle) * turned), float)

    @property
    def feedback(self) -> float:
        """Share of a deviation that feedback corrects in one step; 0 for a robot without feedback."""
        return step_shares(self.feedback_time, self.dt)[0]

    @property
    def exposed(self) -> float:
        """Share of a step's wind error that feedback leaves at its end."""
        return step_shares(self.feedback_time, self.dt)[1]

    @property
    def fix_gain(self) -> float:
        """Share of a deviation known from fixes that is corrected in one step."""
        return step_shares(self.fix_time, self.dt)[0]

    @property
    def closed(self) -> FloatArray:
        """A - K: the matrix (2, 2) that maps a deviation to the deviation of the next step."""
        return self.a - self.feedback * np.eye(2)

    def speed_left(self, correction: FloatArray) -> float:
        """Airspeed [m/s] left for the plan if corrections of this covariance (2, 2) [m²] are flown too.

        P(‖c‖ > r) <= exp(-r² / 2 λ), with λ the largest eigenvalue of the covariance.
        """
        turned = np.linalg.solve(self.b, np.linalg.solve(self.b, correction).T)
        widest = max(float(np.linalg.eigvalsh(0.5 * (turned + turned.T))[-1]), 0.0)
        return max(self.u_max - math.sqrt(-2.0 * math.log(self.effort_risk) * widest) / self.dt, 0.0)

    def spent(self, u: FloatArray) -> FloatArray:
        """Energy (n,) [J] that a step takes with each of the controls ``u`` (n, 2) [m/s]."""
        assert self.power is not None
        speeds, place = np.unique(np.hypot(*u.T), return_inverse=True)
        return self.dt * np.array([self.power(speed) for speed in speeds.tolist()])[place]

    def within_speed(self, u: FloatArray) -> FloatArray:
        """Controls ``u`` (n, 2) [m/s] cut to the least and the largest airspeed."""
        size = np.linalg.norm(u, axis=1, keepdims=True)
        return np.asarray(u * (np.clip(size, self.u_min, self.u_max) / np.maximum(size, 1e-12)), float)

    def least_speed(self, left: FloatArray) -> FloatArray:
        """Least airspeed [m/s] of the plan if ``left`` [m/s] is the greatest.

        Corrections may reduce the airspeed by as much as they may increase it.
        """
        return np.where(self.u_min > 0.0, self.u_min + (self.u_max - left), 0.0)


def step_shares(time: float | None, dt: float) -> tuple[float, float]:
    """Shares of a deviation corrected in a step of ``dt`` [s], and of the step's wind error that is left.

    The solution of ė = -e / T + w after a step, for T = ``time`` [s]; None: no correction.
    """
    if time is None:
        return 0.0, 1.0
    left = math.exp(-dt / time)
    return 1.0 - left, (1.0 - left) * time / dt


# --- power ------------------------------------------------------------------------------------


def power_law(settings: Mapping[str, Any]) -> Power | None:
    """Power [W] at an airspeed [m/s]; None without a power curve."""
    kind = settings.get("kind", "none")
    return None if kind == "none" else lambda v: float(settings["base"] + POWER_LAWS[kind](settings, v))


def energy_limits(settings: Mapping[str, Any]) -> dict[str, Any]:
    """``power`` [W] at an airspeed and ``capacity`` [J]; None where there is no curve or no limit."""
    power, hours = power_law(settings), settings.get("capacity")
    return {"power": power, "capacity": None if hours is None or power is None else 3600.0 * hours}


def _rotor(settings: Mapping[str, Any], v: float) -> float:
    induced = math.sqrt(1 + v**4 / (4 * settings["wake"] ** 4)) - v**2 / (2 * settings["wake"] ** 2)
    profile = settings["blade"] * (1 + 3 * v**2 / settings["tip"] ** 2)
    return float(profile + settings["lifting"] * math.sqrt(max(induced, 0.0)) + settings["drag"] * v**3)


POWER_LAWS: Mapping[str, Callable[[Mapping[str, Any], float], float]] = {
    "body": lambda settings, v: settings["drag"] * v**3,
    "wing": lambda settings, v: settings["drag"] * v**3 + settings["lift"] / v,
    "rotor": _rotor,
    "table": lambda settings, v: np.interp(v, *np.transpose(settings["points"])),
}  # [W], without the settings' ``base``


# --- turns ------------------------------------------------------------------------------------


def fly_table(
    robot: Robot, heading: FloatArray, airspeed: FloatArray, duration: FloatArray, wind: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Displacements of the legs (T, 2) [m], and which are long enough for their turn (T,).

    ``heading`` (T,) counter-clockwise from +x [rad], ``airspeed`` (T,), ``duration`` (T,), ``wind`` (T, 2)::

        ψ' = g tan(bank) / V towards the order, from delay after it on;    x' = V (cos ψ, sin ψ) + w
    """
    ways, roomy = np.empty((len(heading), 2)), np.ones(len(heading), bool)
    nose = float(heading[0]) if len(heading) else 0.0
    for k in range(len(heading)):
        left = math.remainder(float(heading[k]) - nose, math.tau)
        rate = G * math.tan(robot.bank) / float(airspeed[k])
        time = np.linspace(0.0, float(duration[k]), PARTS + 1)
        turned = np.minimum(rate * np.maximum(time - robot.turn_delay, 0.0), abs(left))
        angle = nose + math.copysign(1.0, left) * turned
        air = airspeed[k] * np.column_stack([np.cos(angle), np.sin(angle)])
        ways[k] = np.trapezoid(air, time, axis=0) + duration[k] * wind[k]
        roomy[k] = abs(left) < SHARP and turned[-1] >= abs(left) - 1e-9
        nose = float(angle[-1])
    return ways, roomy
