"""Turns between two legs: of a robot that turns on the spot, or of an aircraft that banks.

A plan is flown by heading and airspeed, leg by leg. After a turn, an aircraft that banks is beside and behind
the place where a robot that turns on the spot would be, by a vector that does not depend on the wind: a
reversal at 55 m/s and 30° of bank displaces it by 2 km. Its orders are therefore computed with the turn
included, so that each leg still ends where the plan expects it, later by the time that the turn takes.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely

from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.arrays import FloatArray

GRAVITY = 9.80665  # [m/s²]
ITERATIONS = 200  # at most, of the fixed-point iteration of a leg
MOST = math.radians(170.0)  # largest turn: in a larger one an autopilot may turn the other way
CLOSE = 1e-9  # [rad] change of the angle at which the iteration has converged
PARTS = 32  # points of a turn at which its distance from the planned line is computed


class OrderedLegs(NamedTuple):
    """Orders to a pilot, and where they are expected to lead; T legs in the plane.

    Attributes
    ----------
    t : (T+1,) float
        When each order is given, and the arrival [s since departure].
    x : (T+1, 2) float
        Expected positions then [m].
    u : (T, 2) float
        Airspeed along the heading of each order [m/s].
    late : float
        Time that all turns lose [s].
    swing : float
        Largest distance of the expected flight from the straight lines between the planned positions [m].
    """

    t: FloatArray
    x: FloatArray
    u: FloatArray
    late: float
    swing: float


@dataclass(frozen=True, slots=True)
class TurnsOnTheSpot:
    """Turns need no time and no distance: the orders are the controls of the plan."""

    @property
    def acceleration(self) -> None:
        """None: turns on the spot have no radius."""

    def ordered(self, t: FloatArray, x: FloatArray, u: FloatArray, wind: FloatArray) -> OrderedLegs:  # noqa: ARG002
        """The controls of the plan, unchanged; arguments as of :meth:`BankedTurns.ordered`."""
        return OrderedLegs(t, x, u, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class BankedTurns:
    """Level turns at a constant bank φ, which begin some time after the order.

    The heading stays for ``delay`` [s], in which the aircraft rolls, then changes at ω = g tan φ / V towards
    the ordered heading, in the shorter direction; V is the airspeed of the new leg. The first leg needs no
    turn.

    Attributes
    ----------
    bank : float
        φ [rad].
    delay : float
        Time from the order until half of the bank is reached [s].
    """

    bank: float
    delay: float

    @property
    def acceleration(self) -> float:
        """Centripetal acceleration g tan φ [m/s²]."""
        return GRAVITY * math.tan(self.bank)

    def ordered(self, t: FloatArray, x: FloatArray, u: FloatArray, wind: FloatArray) -> OrderedLegs:
        """Orders whose expected flight is at ``x`` at the end of each leg.

        ``t`` (T+1,) [s], ``x`` (T+1, 2) [m], ``u`` (T, 2) and the expected ``wind`` of each leg (T, 2) [m/s].

        A leg that would turn by more than 170° turns by that, as far along as planned, and ends to the side.
        A leg that is too short for its turn keeps the order of the plan. Its end is then where the turn has
        led, and the next leg goes on from there.
        """
        planned, air, winds = _complex(x), _complex(u), _complex(wind)
        places, orders, times = [planned[0]], [], [float(t[0])]
        heading, swing = cmath.phase(air[0]) if len(air) else 0.0, 0.0
        for k, order in enumerate(air):
            leg = self._leg_to(planned[k + 1] - places[k], abs(order), heading, winds[k])
            if leg is None:
                turn = math.remainder(cmath.phase(order) - heading, math.tau)
                leg = Leg(self, heading, abs(order), turn, winds[k], float(t[k + 1] - t[k]))
            swing = max(swing, leg.swing(places[k], planned[k], planned[k + 1]))
            places.append(places[k] + leg.at(leg.duration))
            orders.append(cmath.rect(leg.airspeed, leg.order))
            times.append(times[k] + leg.duration)
            heading = leg.heading(leg.duration)
        late = times[-1] - float(t[-1])
        return OrderedLegs(np.array(times), _pairs(places), _pairs(orders), late, swing)

    def rate(self, airspeed: float) -> float:
        """Rate of turn at an airspeed [rad/s]."""
        return self.acceleration / airspeed

    def _leg_to(self, way: complex, airspeed: float, heading: float, wind: complex) -> Leg | None:
        """The fastest leg of this airspeed over ``way`` [m] from ``heading`` [rad]; None if there is none."""
        still = Leg(self, heading, airspeed, 0.0, wind)
        found = (_solved(still, way, side) for side in (1.0, -1.0))
        return min((leg for leg in found if leg is not None), key=lambda leg: leg.duration, default=None)


@dataclass(frozen=True, slots=True)
class Leg:
    """One leg of an aircraft that banks, in the expected wind; angles counter-clockwise from +x [rad].

    Attributes
    ----------
    start : float
        Heading at the order.
    airspeed : float
        [m/s]
    angle : float
        Angle of its turn, positive to the left.
    wind : complex
        [m/s]
    duration : float
        [s]
    """

    turns: BankedTurns
    start: float
    airspeed: float
    angle: float
    wind: complex
    duration: float = 0.0

    @property
    def order(self) -> float:
        """The ordered heading [rad]."""
        return self.start + self.angle

    @property
    def busy(self) -> float:
        """Time from the order to the end of the turn [s]."""
        return self.turns.delay + abs(self.angle) / self.turns.rate(self.airspeed)

    @property
    def displacement(self) -> complex:
        """Place after the turn minus the place with the new heading at once [m], D of (M71)."""
        return self._turning(self.busy) - self.busy * cmath.rect(self.airspeed, self.order)

    def heading(self, time: float) -> float:
        """Heading ``time`` [s] after the order [rad]."""
        turned = self.turns.rate(self.airspeed) * max(time - self.turns.delay, 0.0)
        return self.start + math.copysign(min(turned, abs(self.angle)), self.angle)

    def at(self, time: float) -> complex:
        """Displacement over ground until ``time`` [s] after the order [m]."""
        after = max(time - self.busy, 0.0)
        air = self._turning(time - after) + after * cmath.rect(self.airspeed, self.order)
        return air + time * self.wind

    def _turning(self, time: float) -> complex:
        """Displacement through the air until ``time`` [s], which is at most the end of the turn [m]."""
        old, now = cmath.rect(1.0, self.start), cmath.rect(1.0, self.heading(time))
        rate = math.copysign(self.turns.rate(self.airspeed), self.angle)
        return self.airspeed * (min(time, self.turns.delay) * old + (now - old) / (1j * rate))

    def time_along(self, way: complex) -> float:
        """Time at which the progress along ``way`` equals its length [s]; 0 if it leads the other way."""
        ahead = way.conjugate() / abs(way)
        progress = ((cmath.rect(self.airspeed, self.order) + self.wind) * ahead).real
        return ((way - self.displacement) * ahead).real / progress if progress > 0.0 else 0.0

    def swing(self, start: complex, first: complex, last: complex) -> float:
        """Largest distance of the leg, flown from ``start``, from the line between two places [m]."""
        turn = np.linspace(0.0, min(self.busy, self.duration), PARTS)
        flown = [
            start + self.at(float(time)) for time in (*turn, self.duration)
        ]  # straight between the last two
        line = shapely.LineString(_pairs([first, last]))
        return float(shapely.distance(line, shapely.points(_pairs(flown))).max())


def _solved(leg: Leg, way: complex, side: float) -> Leg | None:
    """``leg`` with the turn to ``side`` (1: left) and the duration that lead over ``way`` [m].

    A leg of T seconds leads to D(ψ) + T (V e^iψ + w): T and ψ solve the wind triangle over way - D(ψ),
    computed as a fixed point. Eqs. (M71), (M72) of docs/mathematics_methods.md.
    """
    for _ in range(ITERATIONS):
        rest = way - leg.displacement
        duration = _time_over(rest, leg.airspeed, leg.wind)
        if not math.isfinite(duration):
            return None
        angle = _turned(leg.start, cmath.phase(rest / duration - leg.wind), side)
        settled = abs(angle - leg.angle) < CLOSE
        leg = replace(leg, angle=angle, duration=duration)
        if settled:
            break
    else:
        return None
    if MOST < abs(leg.angle) <= math.tau - MOST:
        leg = replace(leg, angle=math.copysign(MOST, leg.angle))
        leg = replace(leg, duration=leg.time_along(way))
    return leg if abs(leg.angle) <= MOST and leg.duration >= leg.busy else None  # else it is still turning


def _turned(heading: float, order: float, side: float) -> float:
    """Angle from ``heading`` to ``order`` [rad], turning to ``side``: from -π/2 to 3π/2 in that direction."""
    return side * ((side * (order - heading) + 0.5 * math.pi) % math.tau - 0.5 * math.pi)


def _time_over(way: complex, airspeed: float, wind: complex) -> float:
    """Shortest T with |way / T - wind| = airspeed [s]; inf if the wind is too strong."""
    a, b, c = abs(way) ** 2, (way * wind.conjugate()).real, abs(wind) ** 2 - airspeed**2
    root = b * b - a * c
    if root < 0.0 or a == 0.0:
        return math.inf
    inverse = (b + math.sqrt(root)) / a
    return 1.0 / inverse if inverse > 0.0 else math.inf


def _complex(pairs: FloatArray) -> list[complex]:
    return [complex(x, y) for x, y in pairs.tolist()]


def _pairs(values: list[complex]) -> FloatArray:
    return np.array([[value.real, value.imag] for value in values]).reshape(-1, 2)


Turns = TurnsOnTheSpot | BankedTurns  # how a robot turns from one heading to the next


def turns_of(robot: RobotConfig) -> Turns:
    """How the robot of the settings turns."""
    if robot.bank == 0.0:
        return TurnsOnTheSpot()
    return BankedTurns(math.radians(robot.bank), robot.turn_delay)
