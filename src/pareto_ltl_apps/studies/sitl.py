"""Software in the loop: an independent aircraft flies the exported table in the winds of our flights.

Each flight of JSBSim meets the wind field of one of our flights: the same θ and the same white part,
evaluated at the position of the aircraft. The aircraft differs: six degrees of freedom, turns, an autopilot
with errors, a wind that changes with the position within a step, the ellipsoid instead of the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import rate_text
from pareto_ltl import Run, Settings
from pareto_ltl.extend import Deployment, Frame, Plan, Problem, Study
from pareto_ltl.kernels import flight as kernel
from pareto_ltl.simulation import flights
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl.support.seeds import stage_seeds, unspawned
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.studies import aircraft as jsbsim
from pareto_ltl_apps.studies.aircraft import Air, Orders, Track
from pareto_ltl_apps.studies.parts import Progress
from pareto_ltl_apps.studies.settings import SitlConfig
from pareto_ltl_apps.studies.tables import mcnemar_test, rate_columns

COLUMNS = {"cas": "airspeed_cas_m_s", "tas": "airspeed_tas_m_s"}
TABLE = FORMATS["dead_reckoning"].file


@dataclass(frozen=True, slots=True)
class SitlFlights:
    """Flights of the aircraft and ours in the same winds, and tracks of the aircraft.

    Attributes
    ----------
    aircraft, steps : Deployment
        Positions at the ends of the legs, (n, T+1, 2) [m], and which flights fail.
    tracks : tuple of n Track
    """

    orders: Orders
    aircraft: Deployment
    steps: Deployment
    tracks: tuple[Track, ...]

    @property
    def apart(self) -> FloatArray:
        """Distance of the aircraft from our flight at the end of each leg, (n, T) [m]."""
        return np.asarray(np.linalg.norm(self.aircraft.x - self.steps.x, axis=2)[:, 1:], float)


def run_sitl(settings: Settings, world: Run, place: Path, progress: Progress = None) -> Study:
    """The study: ``sitl.csv`` with a row for each flight, and the numbers that compare both aircraft.

    Raises
    ------
    ConfigError
        If JSBSim is not installed.
    DataError
        If the plan was not exported as a dead-reckoning table, or the robot has feedback.
    """
    cfg, problem, plan = settings[SitlConfig], world.problem, world.plan
    EXTRAS.require("sim", "a flight in JSBSim")
    table = place / TABLE
    if not table.is_file():
        raise DataError(
            f"the plan was not exported as {TABLE}, which the aircraft needs: add dead_reckoning to "
            "exports.formats, and give the map a place on Earth (scene.centre)"
        )
    if problem.motion.gain > 0.0 or plan.path.fixes:
        raise DataError(
            "an aircraft that flies by the table does not measure its position: set "
            "robot.feedback_time=null and remove the landmarks of the map"
        )
    height = settings.flight_height.above_sea_level(settings.scene.ground)
    seeds, orders = stage_seeds(settings.seed, "sitl"), jsbsim.read_orders(table, COLUMNS[cfg.airspeed])
    flown = fly_both(cfg, problem, plan, orders, height, seeds, progress)
    return sitl_study(cfg, flown)


def fly_both(
    cfg: SitlConfig, problem: Problem, plan: Plan, orders: Orders, height: float, seeds: SeedSequence,
    progress: Progress = None,
) -> SitlFlights:  # fmt: skip
    """Fly ``cfg.flights`` pairs, the aircraft and ours in the same wind."""
    law, u = problem.fidelity.law, plan.path.u
    flights.require_known_wind(problem, u, plan.path.x)
    blocks, own = flights.block_rows(cfg.flights), problem.own_errors(law)
    pilot = flights.pilot_maker(problem, u, plan.path.x, law)
    ours, theirs, tracks = np.empty((cfg.flights, len(u) + 1, 2)), np.empty((cfg.flights, len(u) + 1, 2)), []
    for rows, child in zip(blocks, unspawned(seeds).spawn(len(blocks)), strict=True):
        block = flights.draw_block(problem, law, rows.stop - rows.start, len(u), child)
        flights.fly_block(problem, block, pilot, ours[rows])
        for i in range(rows.stop - rows.start):
            lon, lat = problem.scene.frame.to_geographic(block.start[i : i + 1])
            begun = erring_orders(orders, own.mean + own.root @ block.errors[i])
            begun = replace(begun, start=np.concatenate([lat, lon]))  # starts may differ between flights
            track = jsbsim.fly_orders(begun, flight_air(problem, block.draws, i, len(u)), height, cfg.rate)
            theirs[rows.start + i] = problem.scene.frame.to_plane(track.lon, track.lat)
            tracks.append(track)
            if progress is not None:
                progress(len(tracks), cfg.flights)
    aircraft, steps = (Deployment.judged(problem, law, x) for x in (theirs, ours))
    return SitlFlights(orders, aircraft, steps, tuple(tracks))


def erring_orders(orders: Orders, errors: FloatArray) -> Orders:
    """``orders`` as a robot with ``errors`` flies them: of airspeed, heading [rad] and clock [s], or none.

    The clock moves the changes between legs; departure and end stay where they are.
    """
    if not len(errors):
        return orders
    scale, turn, late = errors.tolist()
    duration = orders.duration.copy()
    duration[0] += late
    duration[-1] -= late
    heading = (orders.heading - np.degrees(turn)) % 360.0  # turn is counter-clockwise
    return replace(orders, heading=heading, airspeed=orders.airspeed * (1.0 + scale), duration=duration)


def flight_air(problem: Problem, draws: Any, i: int, steps: int) -> Air:
    """The wind that flight ``i`` of ``draws`` meets, by time and place on Earth.

    Within a step the wind does not change with time, as in our flights, but with the position.
    """
    own = _one_of(draws, i)
    crs, dt = str(problem.scene.crs), problem.motion.dt
    x, met = np.zeros((1, steps + 1, 2)), np.empty((1, 4))

    def air(time: float, lat: float, lon: float) -> tuple[float, float]:
        t = min(int(time / dt + 1e-9), steps - 1)
        place = np.array([lon]), np.array([lat])
        x[0, t] = Frame(crs).to_plane(*place)[0]
        kernel.wind_met(own, t, x, met)
        turn = -float(Frame(crs).convergence(*place)[0])  # from the plane to true north
        cos, sin = np.cos(turn), np.sin(turn)
        east, north = met[0, 0], met[0, 1]
        return float(cos * east - sin * north), float(sin * east + cos * north)

    return air


def _one_of(draws: Any, i: int) -> Any:
    """The draws of flight ``i`` alone."""
    own = draws._replace(white=np.ascontiguousarray(draws.white[:, i : i + 1]))
    if isinstance(draws, kernel.CoherentDraws):
        own = own._replace(theta=np.ascontiguousarray(draws.theta[:, i : i + 1]))
    return own


# --- tables --------------------------------------------------------------------------------------


def sitl_study(cfg: SitlConfig, flown: SitlFlights) -> Study:
    """Tables, numbers and text of the flights."""
    theirs, ours, apart = flown.aircraft.failed, flown.steps.failed, flown.apart
    error = jsbsim.airspeed_errors(flown.orders, flown.tracks)
    only = int((theirs & ~ours).sum()), int((ours & ~theirs).sum())
    numbers: dict[str, float] = {"sitl_flights": cfg.flights}
    numbers |= rate_columns("sitl_failure", theirs) | rate_columns("sitl_steps_failure", ours)
    numbers |= {"sitl_fails_alone": only[0], "sitl_steps_fail_alone": only[1]}
    numbers |= {"sitl_same_chance": mcnemar_test(*only)}
    for name, distances in (("apart", apart), ("apart_end", apart[:, -1])):
        numbers[f"sitl_{name}_median_m"] = float(np.median(distances))
        numbers[f"sitl_{name}_95_m"] = float(np.quantile(distances, 0.95))
    numbers |= {"sitl_airspeed_error": float(error.mean()), "sitl_airspeed_error_sd": float(error.std())}
    numbers |= {"sitl_height_error_m": max(track.climb for track in flown.tracks)}
    rows = [
        {
            "flight": k,
            "failed": int(theirs[k]),
            "failed_steps": int(ours[k]),
            "collided": int(flown.aircraft.collided[k]),
            "off_map": int(flown.aircraft.off_map[k]),
            "apart_median_m": float(np.median(apart[k])),
            "apart_most_m": float(apart[k].max()),
            "apart_end_m": float(apart[k, -1]),
            "airspeed_error_m_s": float(error[k].mean()),
        }
        for k in range(cfg.flights)
    ]
    pictures = {"flights": flown, "drawn": cfg.drawn}
    return Study({"sitl": rows}, numbers, sitl_text(numbers, flown.aircraft.law), pictures)


def sitl_text(numbers: dict[str, float], law: str) -> str:
    """The numbers as a table in Markdown."""

    def rate(name: str) -> str:
        return rate_text(*(numbers[f"{name}_failure{end}"] for end in ("", "_low", "_high")))

    def km(name: str) -> str:
        middle, upper = numbers[f"sitl_{name}_median_m"] / 1e3, numbers[f"sitl_{name}_95_m"] / 1e3
        return f"{middle:.2f} km, 95 % within {upper:.2f} km"

    alone = f"{numbers['sitl_fails_alone']:.0f} and {numbers['sitl_steps_fail_alone']:.0f} flights"
    lines = [
        f"| {numbers['sitl_flights']:.0f} flights in the same {law} winds | |",
        "|---|---|",
        f"| JSBSim fails | {rate('sitl')} |",
        f"| our steps fail | {rate('sitl_steps')} |",
        f"| only one of them fails: JSBSim, our steps | {alone}, chance {numbers['sitl_same_chance']:.2g} |",
        f"| apart at the ends of legs, median | {km('apart')} |",
        f"| apart at the end of the flight, median | {km('apart_end')} |",
        f"| airspeed of a leg minus airspeed in the table | {numbers['sitl_airspeed_error']:+.2f} m/s, "
        f"sd {numbers['sitl_airspeed_error_sd']:.2f} m/s |",
    ]
    return "\n".join(lines) + "\n"
