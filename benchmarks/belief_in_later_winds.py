"""Do the ellipses of ``follow`` hold the truth in winds that really came?

python benchmarks/belief_in_later_winds.py --missions 60

Random missions of ``forecast_test`` are planned with what was known at departure and flown once through later
fields. The belief gets what the robot has flown through the air, and measures its position once, after half
of the steps. Printed is the share of steps at which the truth lies in the 50, 90 and 99 % ellipses, before
the fix and after it, with the 95 % interval of a bootstrap over missions, since the steps of one are alike.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.random import SeedSequence

from pareto_ltl.extend import draw_flights
from pareto_ltl.settings import PlannerConfig, SelectionConfig, Settings, preset
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl_apps.flight.belief import Belief
from pareto_ltl_apps.studies.forecast_test import known_of_files, mission_settings
from pareto_ltl_apps.studies.known_winds import KnownWinds
from pareto_ltl_apps.studies.random_missions import mission
from pareto_ltl_apps.studies.settings import ForecastTestConfig

SHARES, SD = (0.5, 0.9, 0.99), 500.0  # of the ellipses; error of the fix [m]
MEMBERS = 2  # simulated flights of the belief, which the ellipses do not need


def distances(known: KnownWinds, k: int) -> tuple[FloatArray, FloatArray]:
    """Distances of the truth from the estimate in standard deviations, before the fix and after it."""
    settings = known.settings
    task = mission(known.cfg, settings.seed, k, known.spells, settings.border)
    run = known.run_of(task, mission_settings(settings, known.cfg, task, preset("full")))
    try:
        path = run.plan.path
    except ParetoLtlError:
        return np.empty(0), np.empty(0)
    wind = draw_flights(known.reality(run), "independent", 1, SeedSequence([7, k]))
    flight = wind.flown(path.u, path.x)[0]
    problem, rng = run.problem, np.random.default_rng([8, k])
    belief, dt, R = Belief(problem, MEMBERS, SeedSequence(k)), problem.motion.dt, SD**2 * np.eye(2)
    found, middle = [], len(path.u) // 2
    for t in range(len(path.u)):
        belief.advance(dt, dt * (problem.motion.b @ path.u[t]))
        found.append(belief.distance(flight[t + 1], np.zeros((2, 2))))
        if t + 1 == middle:
            belief.learn(flight[t + 1] + SD * rng.standard_normal(2), R)
    return np.array(found[:middle]), np.array(found[middle:])


def held(rows: list[FloatArray], share: float, rng: np.random.Generator) -> str:
    """The share of steps within the ellipse of ``share``, and its interval over missions."""
    radius = math.sqrt(-2.0 * math.log(1.0 - share))
    inside, steps = (np.array([f(row) for row in rows]) for f in (lambda r: (r <= radius).sum(), len))
    picks = rng.integers(len(rows), size=(4000, len(rows)))
    again = inside[picks].sum(axis=1) / steps[picks].sum(axis=1)
    low, high = np.quantile(again, [0.025, 0.975])
    return f"{100 * inside.sum() / steps.sum():.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=60)
    parser.add_argument("--truth", help="folder of GRIB2 files; default: the NOAA files beside the checkout")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    base = Settings(planner=PlannerConfig(epsilon=None), selection=SelectionConfig(rule="length", length=1e7))
    cfg = replace(base[ForecastTestConfig], truth=options.truth)
    known = known_of_files(base.with_sections(cfg), cfg, Path("unused"))
    rows = Parallel(n_jobs=options.jobs)(delayed(distances)(known, k) for k in range(options.missions))
    rng = np.random.default_rng(9)
    print(f"{'ellipse':>8} {'before the fix':>20} {'after it':>20}")
    for share in SHARES:
        parts = [held([row[part] for row in rows if len(row[part])], share, rng) for part in (0, 1)]
        print(f"{100 * share:6.0f} % {parts[0]:>20} {parts[1]:>20}")
    print(f"{sum(len(row[0]) > 0 for row in rows)} of {options.missions} missions with a plan")


if __name__ == "__main__":
    main()
