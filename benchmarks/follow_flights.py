"""Failures of the same flights with and without ``follow``: a position fix, a new plan if it is better.

python benchmarks/follow_flights.py +experiment=hop --flights 400 --out follow_flights.csv
python benchmarks/follow_flights.py +experiment=hop --flights 200 --aircraft jsbsim --out follow_flights.csv

Each flight has a wind of the coherent law. Without ``follow`` it flies the planned controls. With it, a
position is measured after a share of the steps; the rest is planned again, and flown if fewer of the same
simulated flights fail with it, as ``pareto-ltl follow --replan --auto`` does. Both are flown in the same
wind, by our steps or by JSBSim, which gets headings, airspeeds and times. Rows of an earlier run of the same
file are kept.

This makes the decisions of ``follow``, but does not run the command: no MAVLink, no late telemetry, and a new
plan is flown from the step of the fix on, without the seconds that it takes.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.random import SeedSequence

from pareto_ltl.extend import Deployment, DrawnFlights, Frame, draw_flights
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.results import planned_run
from pareto_ltl.settings.heights import flight_height
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import clopper_pearson, paired_difference
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.conditioning import Fix
from pareto_ltl_apps.exports.navigation_log import navigation_log
from pareto_ltl_apps.flight.belief import LAW, Belief
from pareto_ltl_apps.flight.replanning import replanned
from pareto_ltl_apps.studies.aircraft import Orders, fly_orders
from pareto_ltl_apps.studies.settings import SitlConfig
from pareto_ltl_apps.studies.sitl import flight_air

MEMBERS = 1000


Parts = list[tuple[Problem, PlannedPath, int]]  # paths flown one after the other, each for some steps


def new_plan(run: Run, step: int, place: FloatArray, sd: float, seed: int) -> Parts:
    """The planned path to the step of the fix and the new one; the whole planned path if that is better."""
    problem, path = run.problem, run.plan.path
    old: Parts = [(problem, path, len(path.u))]
    belief, dt, R = Belief(problem, MEMBERS, SeedSequence(seed)), problem.motion.dt, sd**2 * np.eye(2)
    for t in range(step):
        belief.advance(dt, dt * (problem.motion.b @ path.u[t]))
    if belief.distance(place, R) > 4.0:
        return old
    belief.learn(place, R)
    try:
        done = replanned(run, step * dt, [Fix(place, sd, step)])
    except ParetoLtlError:
        return old
    if done.situation.alarms or done.run is None:
        return old
    new: Parts = [(problem, path, step), (done.run.problem, done.plan.path, len(done.plan.path.u))]
    if sum(count for _, _, count in new) > len(problem.laws[LAW].wind.slot):
        return old
    before, after = (belief.rest_fails(*joined(parts))[1] for parts in (old, new))
    return new if paired_difference(before, after)[2] < 0.0 else old


def joined(parts: Parts) -> tuple[FloatArray, FloatArray]:
    """Controls (T, 2) [m/s] and means (T+1, 2) [m] of paths flown one after the other."""
    u = np.concatenate([path.u[:count] for _, path, count in parts])
    heads = [path.x[:count] for _, path, count in parts[:-1]]
    return u, np.concatenate([*heads, parts[-1][1].x])


def flown_by_steps(run: Run, winds: DrawnFlights, k: int, parts: Parts) -> FloatArray:
    """Positions (T+1, 2) [m] of flight ``k`` by our steps."""
    return winds.only(np.array([k])).flown(*joined(parts))[0]


def flown_by_jsbsim(run: Run, winds: DrawnFlights, k: int, parts: Parts) -> FloatArray:
    """Positions (T+1, 2) [m] of flight ``k`` at the ends of the legs, flown by JSBSim."""
    logs = [(navigation_log(problem, path, run.plan.air), count) for problem, path, count in parts]
    heading, airspeed, duration = (
        np.concatenate([getattr(log, name)[:count] for log, count in logs])
        for name in ("heading", "calibrated", "duration")
    )
    problem, settings = winds.problem, run.settings
    crs = str(problem.scene.crs)
    lon, lat = Frame(crs).to_geographic((problem.scene.start + winds.start[k])[None])
    air = flight_air(problem, winds.draws, k, len(heading))
    height = flight_height(settings).above_sea_level(settings.scene.ground)
    orders = Orders(heading, airspeed, duration, np.array([lat[0], lon[0]]))
    track = fly_orders(orders, air, height, settings[SitlConfig].rate)
    return Frame(crs).to_plane(track.lon, track.lat)


AIRCRAFT = {"steps": flown_by_steps, "jsbsim": flown_by_jsbsim}


@cache
def plan_and_winds(folder: str, flights: int) -> tuple[Run, DrawnFlights]:
    """The run with the plan, and the winds of all flights; once a process."""
    run = planned_run(folder)
    return run, draw_flights(run.problem, LAW, flights, SeedSequence(77))


def one_flight(folder: str, k: int, options: argparse.Namespace) -> list[int]:
    """Whether flight ``k`` fails without and with ``follow``, and whether it took a new plan."""
    run, winds = plan_and_winds(folder, options.flights)
    problem, path, fly = run.problem, run.plan.path, AIRCRAFT[options.aircraft]
    x = fly(run, winds, k, [(problem, path, len(path.u))])
    step = round(options.after * len(path.u))
    place = x[step] + options.sd * np.random.default_rng([5, k]).standard_normal(2)
    parts = new_plan(run, step, place, options.sd, k)
    taken = len(parts) > 1
    flown = (x, fly(run, winds, k, parts) if taken else x)
    return [k, *(int(Deployment.judged(problem, LAW, one[None]).failed[0]) for one in flown), int(taken)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="*", default=["+experiment=hop"])
    parser.add_argument("--flights", type=int, default=400)
    parser.add_argument("--aircraft", choices=sorted(AIRCRAFT), default="steps")
    parser.add_argument("--after", type=float, default=0.4, help="share of the steps before the fix")
    parser.add_argument("--sd", type=float, default=100.0, help="of the fix [m]")
    parser.add_argument("--jobs", type=int, default=1, help="flights at a time")
    parser.add_argument("--out", type=Path, default=Path("follow_flights.csv"))
    options = parser.parse_args()
    known: dict[int, list[int]] = {}
    if options.out.exists():
        with options.out.open(newline="") as file:
            known = {int(row[0]): [int(cell) for cell in row] for row in list(csv.reader(file))[1:]}
    with tempfile.TemporaryDirectory() as folder, options.out.open("a", newline="") as file:
        words = ["plan", *options.words, "report=none", "exports=none", f"hydra.run.dir={folder}/run"]
        if code := run_command_line(words):
            raise SystemExit(code)
        rows, todo = csv.writer(file), [k for k in range(options.flights) if k not in known]
        if not known:
            rows.writerow(["flight", "without", "with", "switched"])
        flown = Parallel(n_jobs=options.jobs, return_as="generator_unordered")(
            delayed(one_flight)(f"{folder}/run", k, options) for k in todo
        )
        for row in flown:
            known[row[0]] = row
            rows.writerow(row)
            file.flush()
    table = np.array([known[k] for k in range(options.flights)])
    plain, followed = table[:, 1].astype(bool), table[:, 2].astype(bool)
    for name, some in (("without", plain), ("with", followed)):
        low, high = clopper_pearson(int(some.sum()), len(some))
        rate = f"{100 * some.mean():.1f} % ({100 * low:.1f} to {100 * high:.1f})"
        print(f"{name} follow {some.sum()} of {len(some)} fail: {rate}")
    middle, low, high = paired_difference(plain, followed)
    interval = f"{100 * middle:+.1f} % ({100 * low:+.1f} to {100 * high:+.1f})"
    print(f"difference {interval}; {table[:, 3].sum()} new plans flown, by {options.aircraft}")


if __name__ == "__main__":
    main()
