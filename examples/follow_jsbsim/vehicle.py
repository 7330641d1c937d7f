"""A simulated vehicle behind MAVLink: it flies in one wind of a plan, and takes headings and airspeeds.

    python examples/follow_jsbsim/vehicle.py outputs/hop/RUN --speed 60
    pareto-ltl follow outputs/hop/RUN --connect udpin:127.0.0.1:14550 --departure now --vehicle-clock

With ``--jsbsim`` the Cessna 172 of JSBSim flies (extra ``sim``), else a point that turns at once. It has a
satellite fix for a moment after each share of the flight in ``--fixes``.
"""

from __future__ import annotations

import argparse
import math
import os
import time

import numpy as np

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported
from pymavlink import mavutil
from pyproj import Geod

import pareto_ltl
from pareto_ltl.run.results import planned_run
from pareto_ltl.simulation.flights import DRAWS
from pareto_ltl_apps.exports.navigation_log import navigation_log
from pareto_ltl_apps.flight.airspeeds import airspeeds_of
from pareto_ltl_apps.studies.aircraft import Cessna, Orders
from pareto_ltl_apps.studies.sitl import flight_air

TICK = 1.0  # [s] of flight between two messages
GUIDED, ARMED, PLANE, ARDUPILOT = 15, 128, 1, 3
FIX_SECONDS, FIX_SD = 12.0, 100.0
GLOBE = Geod(ellps="WGS84")


class Point:
    """A vehicle that turns and changes its airspeed at once; ``factor`` is true by calibrated airspeed."""

    factor = 1.0

    def __init__(self, lat: float, lon: float, heading: float, airspeed: float) -> None:
        self.place, self.heading, self.airspeed = (lat, lon), heading, airspeed

    def fly(self, wind: tuple[float, float]) -> None:
        """Fly for one tick in a wind (east, north) [m/s]."""
        turn = math.radians(self.heading)
        true = self.factor * self.airspeed
        east, north = true * math.sin(turn) + wind[0], true * math.cos(turn) + wind[1]
        lat, lon = self.place
        track, far = math.degrees(math.atan2(east, north)), TICK * math.hypot(east, north)
        lon, lat, _ = GLOBE.fwd(lon, lat, track, far)
        self.place = (lat, lon)

    def measured(self) -> tuple[float, float]:
        """Heading [deg] and calibrated airspeed [m/s]."""
        return self.heading, self.airspeed


class Aircraft(Point):
    """The Cessna 172 of JSBSim."""

    def __init__(self, lat: float, lon: float, heading: float, airspeed: float) -> None:
        super().__init__(lat, lon, heading, airspeed)
        one = np.ones(1)
        orders = Orders(heading * one, airspeed * one, one, np.array([lat, lon]))
        there = Cessna(orders, (lat, lon), 300.0, 60.0, (0.0, 0.0)).place
        self.cessna = Cessna(orders, (2 * lat - there[0], 2 * lon - there[1]), 300.0, 60.0, (0.0, 0.0))

    def fly(self, wind: tuple[float, float]) -> None:
        """Fly for one tick in a wind (east, north) [m/s]."""
        self.cessna.turn_to(self.heading)
        self.cessna.meet(wind)
        for _ in range(round(TICK / self.cessna.tick)):
            self.cessna.fly_on(self.airspeed)
        self.place = self.cessna.place

    def measured(self) -> tuple[float, float]:
        """As compass and pitot tube measure them, without errors."""
        heading = math.degrees(self.cessna.plane["attitude/heading-true-rad"])
        return heading, self.cessna.airspeed


def heard(link: mavutil.mavfile, vehicle: Point) -> bool:
    """Take the commands that have come, and acknowledge them; whether a heading or airspeed was one."""
    guided = False
    while (message := link.recv_match(type=["COMMAND_LONG", "COMMAND_INT"], blocking=False)) is not None:
        if message.command == mavutil.mavlink.MAV_CMD_GUIDED_CHANGE_HEADING:
            vehicle.heading, guided = message.param2, True
        elif message.command == mavutil.mavlink.MAV_CMD_GUIDED_CHANGE_SPEED:
            vehicle.airspeed, guided = message.param2, True
        link.mav.command_ack_send(message.command, mavutil.mavlink.MAV_RESULT_ACCEPTED)
    return guided


def report(link: mavutil.mavfile, vehicle: Point, t: float, fix: bool, rng: np.random.Generator) -> None:
    """One message of each kind."""
    lat, lon = vehicle.place
    heading, airspeed = vehicle.measured()
    link.mav.heartbeat_send(PLANE, ARDUPILOT, ARMED | 1, GUIDED, 4)
    link.mav.attitude_send(round(1e3 * (t + 1.0)), 0.0, 0.0, math.radians(heading), 0.0, 0.0, 0.0)
    link.mav.vfr_hud_send(airspeed, airspeed, round(heading) % 360, 50, 300.0, 0.0)
    if fix:
        east, north = FIX_SD * rng.standard_normal(2)
        lon, lat, _ = GLOBE.fwd(lon, lat, math.degrees(math.atan2(east, north)), math.hypot(east, north))
    place = (round(1e7 * lat), round(1e7 * lon)) if fix else (0, 0)
    accuracy = round(1e3 * FIX_SD) if fix else 0
    link.mav.gps_raw_int_send(0, 3 if fix else 1, *place, 0, 100, 100, 0, 0, 0, h_acc=accuracy)


def fly(options: argparse.Namespace) -> tuple[float, float]:
    """Fly to the end of the plan; returns the last position."""
    run = planned_run(pareto_ltl.load_results(options.directory))
    problem, plan = run.problem, run.plan
    log, rng = navigation_log(problem, plan.path), np.random.default_rng(options.seed)
    draws = DRAWS["coherent"](problem, 1, len(plan.path.u), rng)
    air = flight_air(problem, draws, 0, len(plan.path.u))
    kind = Aircraft if options.jsbsim else Point
    airspeeds = airspeeds_of(run.settings)  # autopilots know calibrated airspeeds, the log true ones
    calibrated = log.airspeed * airspeeds.calibrated(1.0, 0.0)
    vehicle = kind(float(log.lat[0]), float(log.lon[0]), float(log.heading[0]), float(calibrated[0]))
    vehicle.factor = airspeeds.true(1.0, 0.0)
    link = mavutil.mavlink_connection(options.to, dialect="all", source_system=7)
    fixes = [float(share) * log.t[-1] for share in options.fixes.split(",") if share]
    begun, guided, steps_end = time.monotonic(), False, len(plan.path.u) * problem.motion.dt
    for second in np.arange(0.0, log.t[-1], TICK):
        if guided and second >= steps_end:  # the orders belong to steps; the table also has time for turns
            break
        time.sleep(max(0.0, begun + second / options.speed - time.monotonic()))
        guided = heard(link, vehicle) or guided
        if not guided:  # nobody sends: the plan by the clock
            leg = int(np.searchsorted(log.t, second, side="right")) - 1
            vehicle.heading, vehicle.airspeed = float(log.heading[leg]), float(calibrated[leg])
        report(link, vehicle, second, any(0.0 <= second - fix < FIX_SECONDS for fix in fixes), rng)
        vehicle.fly(air(second, *vehicle.place))
    _, _, off = GLOBE.inv(vehicle.place[1], vehicle.place[0], log.lon[-1], log.lat[-1])
    print(f"landed at {vehicle.place[0]:.4f},{vehicle.place[1]:.4f}, {off / 1e3:.1f} km from the planned end")
    return vehicle.place


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory")
    parser.add_argument("--to", default="udpout:127.0.0.1:14550")
    parser.add_argument("--speed", type=float, default=1.0, help="seconds of flight in a second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fixes", default="0.3,0.6", help="shares of the flight with a satellite fix")
    parser.add_argument("--jsbsim", action="store_true")
    fly(parser.parse_args())
