"""An independent simulator: the Cessna 172 of JSBSim, with its autopilot, flies a dead-reckoning table.

JSBSim (Berndt, AIAA 2004-4923, doi:10.2514/6.2004-4923) integrates six degrees of freedom over the WGS 84
ellipsoid. The autopilot of its model ``c172x`` holds heading and height; here a proportional-integral law of
the throttle holds the calibrated airspeed, which JSBSim computes from the pressure at the pitot tube. The
aircraft receives a true heading, an airspeed and a time, as a navigator reads them from the table, and no
position.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError

MODEL = "c172x"
FOOT, KNOT = 0.3048, 1852.0 / 3600.0  # [m], [m/s]
WIND_SECONDS = 1.0  # interval at which the wind is updated [s]
THROTTLE_SECONDS = 0.2  # interval at which the throttle is updated [s]
PROPORTIONAL, INTEGRAL = 0.06, 0.003  # gains of the throttle [1/(m/s)], [1/(m/s s)]
SETTLED = 90.0  # time before departure in which heading, height and airspeed settle [s]
CRUISE = 0.7  # initial throttle, of 1
LONGITUDINAL = 0  # the mode of JSBSim that trims angle of attack, elevator and throttle
GROUND = -1000.0  # [m] height of the ground above the sea, so that winds of 10 m are flown at 10 m
LOST = 0.1  # relative error of the mean airspeed above which the flight is not valid

Air = Callable[[float, float, float], tuple[float, float]]  # t [s], lat, lon [deg] -> east, north wind [m/s]


@dataclass(frozen=True, slots=True)
class Orders:
    """The orders of the table, leg by leg.

    Attributes
    ----------
    heading : (T,) float
        True [deg].
    airspeed : (T,) float
        Calibrated [m/s].
    duration : (T,) float
        [s]
    start : (2,) float
        Latitude and longitude [deg].
    """

    heading: FloatArray
    airspeed: FloatArray
    duration: FloatArray
    start: FloatArray


@dataclass(frozen=True, slots=True)
class Track:
    """Positions of an aircraft at the start and at the end of every leg: ``lat``, ``lon`` (T+1,) [deg].

    ``airspeed`` (T,) [m/s] is the mean calibrated airspeed of each leg, ``true`` (T,) [m/s] the mean true
    one, ``climb`` [m] the largest error of the height at the end of a leg.
    """

    lat: FloatArray
    lon: FloatArray
    airspeed: FloatArray
    true: FloatArray
    climb: float


def read_orders(path: Path, airspeed: str = "airspeed_cas_m_s") -> Orders:
    """The orders of a ``dead_reckoning.csv``; DataError if it is damaged or has no leg.

    ``airspeed`` is the column whose numbers the autopilot takes for calibrated airspeeds.
    """
    import csv

    from careful_io.reading import read_text

    names = ("heading_true_deg", airspeed, "duration_s")
    rows = list(csv.DictReader(read_text(path).splitlines()))
    try:
        legs = np.array([[float(row[name]) for name in names] for row in rows[:-1]])
        start = np.array([float(rows[0][name]) for name in ("lat_deg", "lon_deg")])
        if not (len(legs) and np.isfinite(legs).all() and (legs[:, 1:] > 0.0).all()):
            raise ValueError("it has no leg, or a leg without heading, airspeed or time")
    except (IndexError, KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path} is not a dead-reckoning table ({error}); export the plan again") from error
    return Orders(legs[:, 0], legs[:, 1], legs[:, 2], start)


class Cessna:
    """One aircraft in flight; it flies for ``SETTLED`` seconds before its first leg.

    Parameters
    ----------
    start : (lat, lon)
        Its position at the beginning [deg].
    wind : (east, north)
        Wind at the end of the ``SETTLED`` seconds, which begin in calm air [m/s].
    height : float
        Height to hold above the sea [m].
    rate : float
        Integration steps per second.
    """

    def __init__(
        self,
        orders: Orders,
        start: tuple[float, float],
        height: float,
        rate: float,
        wind: tuple[float, float],
    ) -> None:
        import jsbsim

        base: Any = jsbsim.FGJSBBase  # without it every aircraft prints a banner
        base().debug_lvl = 0
        self.plane: Any = jsbsim.FGFDMExec(None)
        self.plane.set_debug_level(0)
        self.plane.load_model(MODEL)
        self.plane.set_output_filename(0, os.devnull)  # the model writes a table into the working folder
        self.plane.set_dt(1.0 / rate)
        self.rounds = max(1, round(THROTTLE_SECONDS * rate))
        self.tick = self.rounds / rate  # [s]
        self.whole = 0.0  # integral of the throttle
        begin = {
            "ic/lat-geod-deg": start[0], "ic/long-gc-deg": start[1],
            "ic/h-sl-ft": height / FOOT, "ic/psi-true-deg": orders.heading[0],
            "ic/vc-kts": orders.airspeed[0] / KNOT, "ic/terrain-elevation-ft": GROUND / FOOT,
        }  # fmt: skip
        for name, value in begin.items():
            self.plane[name] = float(value)
        if not self.plane.run_ic():
            raise DataError(f"JSBSim cannot begin a flight with {MODEL} at {orders.airspeed[0]:g} m/s")
        self.trim(float(orders.airspeed[0]))
        hold = {
            "ap/attitude_hold": 0, "ap/altitude_hold": 1, "ap/heading_hold": 1,
            "ap/altitude_setpoint": (height - GROUND) / FOOT,  # it is above the ground
        }  # fmt: skip
        for name, value in hold.items():
            self.plane[name] = value
        self.turn_to(float(orders.heading[0]))
        rounds = round(SETTLED / self.tick)
        for k in range(rounds):
            share = min(2.0 * k / rounds, 1.0)  # a sudden wind would change the airspeed by as much
            self.meet((share * wind[0], share * wind[1]))
            self.fly_on(float(orders.airspeed[0]))

    def trim(self, airspeed: float) -> None:
        """Trim elevator and throttle for level flight at ``airspeed`` [m/s].

        The autopilot alone finds the elevator in a quarter of an hour, and climbs by up to 800 m until then.
        """
        cruise = {
            "propulsion/set-running": -1, "propulsion/fuel_freeze": 1, "fcs/mixture-cmd-norm": 0.87,
            "fcs/throttle-cmd-norm": CRUISE,
        }  # fmt: skip
        for name, value in cruise.items():
            self.plane[name] = value
        try:
            self.plane.do_trim(LONGITUDINAL)
        except Exception as error:  # the class is not exported by every version of JSBSim
            raise DataError(
                f"JSBSim cannot trim {MODEL} for level flight at {airspeed:g} m/s: plan for its airspeeds, "
                "e.g. robot=light_aircraft"
            ) from error
        self.whole = self.plane["fcs/throttle-cmd-norm"] - CRUISE

    @property
    def place(self) -> tuple[float, float]:
        """Latitude and longitude [deg]."""
        return self.plane["position/lat-geod-deg"], self.plane["position/long-gc-deg"]

    @property
    def airspeed(self) -> float:
        """Calibrated airspeed [m/s]."""
        return float(self.plane["velocities/vc-fps"]) * FOOT

    @property
    def true_airspeed(self) -> float:
        """True airspeed [m/s]."""
        return float(self.plane["velocities/vt-fps"]) * FOOT

    @property
    def height(self) -> float:
        """Height above the sea [m]."""
        return float(self.plane["position/h-sl-ft"]) * FOOT

    def turn_to(self, heading: float) -> None:
        """Order a heading [deg]."""
        self.plane["ap/heading_setpoint"] = heading % 360.0

    def meet(self, wind: tuple[float, float]) -> None:
        """Set the wind (east, north) [m/s]."""
        self.plane["atmosphere/wind-east-fps"] = wind[0] / FOOT
        self.plane["atmosphere/wind-north-fps"] = wind[1] / FOOT

    def fly_on(self, airspeed: float) -> None:
        """Move the throttle towards ``airspeed`` [m/s] and fly for ``tick`` seconds."""
        short = airspeed - self.airspeed
        wanted = CRUISE + self.whole + PROPORTIONAL * short
        if 0.0 < wanted < 1.0:  # no integration at the stops of the throttle (anti-windup)
            self.whole += INTEGRAL * short * self.tick
        self.plane["fcs/throttle-cmd-norm"] = min(max(wanted, 0.0), 1.0)
        for _ in range(self.rounds):
            self.plane.run()


def fly_orders(orders: Orders, air: Air, height: float, rate: float) -> Track:
    """Fly the whole table; the wind at the position of the aircraft is updated every second.

    Raises
    ------
    DataError
        If the aircraft cannot hold the airspeeds of the table: a Cessna 172 does not fly them.
    """
    lat, lon = (float(value) for value in orders.start)
    wind = air(0.0, lat, lon)
    # a trial flight from the start gives how far before it a settled aircraft has to begin
    north, east = Cessna(orders, (lat, lon), height, rate, wind).place
    cessna = Cessna(orders, (2.0 * lat - north, 2.0 * lon - east), height, rate, wind)
    every = max(1, round(WIND_SECONDS / cessna.tick))
    places, means, trues, climb, count = [cessna.place], [], [], 0.0, 0
    ends = np.cumsum(orders.duration)
    for heading, airspeed, end in zip(orders.heading, orders.airspeed, ends, strict=True):
        cessna.turn_to(float(heading))
        seen = []
        while count * cessna.tick < end - 0.5 * cessna.tick:
            if count % every == 0:
                cessna.meet(air(count * cessna.tick, *cessna.place))
            cessna.fly_on(float(airspeed))
            count += 1
            seen.append((cessna.airspeed, cessna.true_airspeed))
        climb = max(climb, abs(cessna.height - height))
        held, true = np.mean(seen, axis=0).tolist()
        means.append(held)
        trues.append(true)
        places.append(cessna.place)
    flown = np.array(means)
    require_held(orders, flown, len(ends))
    found = np.array(places)
    return Track(found[:, 0], found[:, 1], flown, np.array(trues), climb)


def require_held(orders: Orders, flown: FloatArray, legs: int) -> None:
    """Raise DataError if the mean airspeed differs from the table by more than ``LOST``."""
    weights = orders.duration / orders.duration.sum()
    wanted, found = float(orders.airspeed @ weights), float(flown @ weights)
    if not abs(found - wanted) <= LOST * wanted:
        raise DataError(
            f"the {MODEL} of JSBSim flew {found:.1f} m/s, but the {legs} legs of the table require "
            f"{wanted:.1f} m/s: plan for its airspeeds, e.g. robot=light_aircraft"
        )


def airspeed_errors(orders: Orders, tracks: Sequence[Track]) -> FloatArray:
    """Mean calibrated airspeed of each leg minus its airspeed in the table, (flights, T) [m/s]."""
    return np.array([track.airspeed - orders.airspeed for track in tracks])
