"""Compare the prices of plans with the same paths polished again on changed maps.

Each folder is the result of a plan that flights judge. A price is the derivative of the least failure rate of
one local optimum. So one limit at a time is eased, and tightened, by as much as should change a share of the
failures by its price; on both maps the path of the plan is polished again, from the same start on the same
flights, in the same number of steps, and both paths are judged by the same fresh flights. Half the difference
is compared with the price; the interval of 95 % of the ratio has the error of the price and the flights that
fail on one map only.

With ``--anew N`` each map is also planned anew with N seeds, and the least failure rates at the length of the
plan are compared. Seeds of the search often differ by more than such a change.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.random import SeedSequence

from pareto_ltl import Scene, Settings, load_results
from pareto_ltl.extend import draw_flights, which_fail
from pareto_ltl.planning.evaluate import completing_path
from pareto_ltl.planning.limits import Price
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.effort import Effort
from pareto_ltl.planning.refine.sweep import new_sweep
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.arrays import BoolArray, FloatArray

FARTHEST = {"airspeed": 0.01, "length": 0.01}  # largest relative changes; of other limits:
FARTHEST_OUTLINE = 0.01  # as a share of the map's size
ROUNDS, SETTLED = 6, 0.998  # polishes at the last width, while each lowers the failures below this share
POLISHING, JUDGING = SeedSequence(77), SeedSequence(5)
SIDES = {"western": (0, 0), "southern": (0, 1), "eastern": (1, 0), "northern": (1, 1)}
HEADS = ("change", "failures", "predicted", "observed", "ratio", "from", "to")


class Tried(NamedTuple):
    """A plan, and what both maps of each of its prices have in common.

    ``start`` (T+1, 2) [m] are the means of the plan, polished again on its map.
    """

    results: Run
    settings: Settings
    start: FloatArray
    rate: float
    runs: int


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories")
    parser.add_argument("--most", type=int, default=4, help="prices of outlines tried for each")
    parser.add_argument("--share", type=float, default=0.1, help="share of the failures to be changed")
    parser.add_argument("--anew", type=int, default=0, dest="seeds", help="new plans on each map as well")
    parser.add_argument("--runs", type=int, default=100_000, help="flights that judge a path")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    print(f"{'mission':12} {'limit':24} {' '.join(f'{head:>9}' for head in HEADS)}")
    for folder in asked.results:
        tried = tried_plan(load_results(folder), asked.runs)
        prices = [price for price in tried.results.plan.prices if price.significant]
        outlines = [price for price in prices if price.kind not in FARTHEST][: asked.most]
        for price in (*outlines, *(price for price in prices if price.kind in FARTHEST)):
            change = tried_change(tried, price, asked.share)
            shown(tried, price, change, compared(tried, price, change))
            if asked.seeds:
                anew(tried, price, change, asked)


def tried_plan(results: Run, runs: int) -> Tried:
    """The plan of ``results`` with its time step, polished again, and its failure rate."""
    problem = problem_on(results, results.settings, results.scene)
    settings = replace(results.settings, robot=replace(results.settings.robot, dt=problem.motion.dt))
    path = results.plan.path
    start = polished(problem, settings, path.x, path.objectives.length)
    return Tried(results, settings, start, float(failing(problem, start, runs).mean()), runs)


def problem_on(results: Run, settings: Settings, scene: Scene) -> Problem:
    """The problem with other settings or another map, in the same wind."""
    return Run(settings, {"scene": scene, "wind": results.wind}).problem


def tried_change(tried: Tried, price: Price, share: float) -> float:
    """By how much the limit of ``price`` is eased and tightened [m or m/s]."""
    size = float(np.ptp(tried.results.scene.bounds, axis=0).mean())
    whole = {"airspeed": tried.settings.robot.u_max, "length": tried.results.plan.path.objectives.length}
    farthest = FARTHEST.get(price.kind, FARTHEST_OUTLINE) * whole.get(price.kind, size)
    return min(share * tried.rate / price.saving, farthest)


def compared(tried: Tried, price: Price, change: float) -> tuple[float, float]:
    """Half of the difference of the failure rates with the limit tightened and eased, and its error."""
    tight, wide = (failing_with(tried, price, way * change).astype(float) for way in (-1.0, 1.0))
    half = 0.5 * (tight - wide)
    return float(half.mean()), float(half.std() / math.sqrt(len(half)))


def failing_with(tried: Tried, price: Price, change: float) -> BoolArray:
    """Which flights of the best path fail with the limit of ``price`` eased by ``change``."""
    settings, scene = eased(tried.settings, tried.results.scene, price, change)
    problem, start = problem_on(tried.results, settings, scene), tried.start
    longest = tried.results.plan.path.objectives.length + (change if price.kind == "length" else 0.0)
    return failing(problem, polished(problem, settings, start, longest), tried.runs)


def polished(problem: Problem, settings: Settings, x: FloatArray, longest: float) -> FloatArray:
    """The means of a path after it is polished until it settles, at most ``longest`` [m]."""
    flights = draw_flights(problem, problem.fidelity.law, 4 * settings.refine.flights, POLISHING)
    effort = Effort.of(settings.refine)
    sweep = new_sweep(effort, problem, flights)
    last = sweep.polish_of(replace(effort.finest, inner=8))
    best = sweep.refiner.polish(x, flights, sweep.polish_of(effort.last), longest)
    for _ in range(ROUNDS):
        other = sweep.refiner.polish(best.flight.x, flights, last, longest)
        if other.smoothed >= SETTLED * best.smoothed:
            break
        best = other
    flight = sweep.closing.polished(
        best.flight.x, flights, sweep.polish_of(replace(effort.closing, inner=3)), longest
    )
    return flight.x


def failing(problem: Problem, x: FloatArray, runs: int) -> BoolArray:
    """Which of ``runs`` fresh flights along ``x`` (T+1, 2) fail, in the same winds for every path."""
    return which_fail(problem, [completing_path(problem, x, "polished again")], runs, JUDGING)[0]


def shown(tried: Tried, price: Price, change: float, observed: tuple[float, float]) -> None:
    """One line: a price, and what was observed with its interval of 95 %."""
    predicted = price.saving * change
    ratio, error = observed[0] / predicted, observed[1] / predicted
    spread = 1.96 * math.hypot(error, ratio * price.error / price.saving)
    print(
        f"{tried.results.settings.name:12} {price.name:24} {change:9.4g} {tried.rate:9.2%} {predicted:9.3%} "
        f"{observed[0]:9.3%} {ratio:9.2f} {ratio - spread:9.2f} {ratio + spread:9.2f}", flush=True,
    )  # fmt: skip


def anew(tried: Tried, price: Price, change: float, asked: argparse.Namespace) -> None:
    """One line: what plans made anew save where the limit is eased."""
    length = tried.results.plan.path.objectives.length
    longer = change if price.kind == "length" else 0.0
    rate = failure(tried.settings, tried.results.scene, length, asked)
    other = failure(*eased(tried.settings, tried.results.scene, price, change), length + longer, asked)
    predicted = price.saving * change
    text = f"made anew: {rate:.2%} and {other:.2%}, ratio {(rate - other) / predicted:.2f}"
    print(f"{'':12} {text}", flush=True)


def failure(settings: Settings, scene: Scene, length: float, asked: argparse.Namespace) -> float:
    """The least failure rate at ``length`` [m] of the fronts of several seeds on ``scene``."""
    found = []
    for seed in range(asked.seeds):
        cfg = replace(settings.with_seed(seed), selection=replace(settings.selection, draws=asked.runs))
        front = Run(cfg, {"scene": scene}).front
        order = np.argsort([path.objectives.length for path in front.paths])
        lengths = np.array([front.paths[k].objectives.length for k in order])
        rates = np.array([max(front.rates[k].failure, 0.5 / asked.runs) for k in order])
        found.append(np.interp(np.log(length), np.log(lengths), np.log(np.minimum.accumulate(rates))))
    return float(np.exp(min(found)))


def eased(settings: Settings, scene: Scene, price: Price, change: float) -> tuple[Settings, Scene]:
    """Settings and map with the limit of ``price`` eased by ``change`` [m or m/s], or tightened below 0."""
    match price.kind:
        case "airspeed":
            return replace(
                settings, robot=replace(settings.robot, u_max=settings.robot.u_max + change)
            ), scene
        case "length":
            return settings, scene
        case "obstacle":
            k = int(price.name.split()[-1]) - 1
            parts = grown(scene.obstacles[k], -change)
            obstacles = (*scene.obstacles[:k], *parts, *scene.obstacles[k + 1 :])
            return settings, replace(scene, obstacles=obstacles)
        case "border":
            row, column = SIDES[price.name.split()[1]]
            bounds = scene.bounds.copy()
            bounds[row, column] += change if row else -change
            return settings, replace(scene, bounds=bounds)
    wider = dict(scene.regions)
    for name in price.name.split(" and "):
        way = change if price.kind == "region" else -change
        wider[name] = tuple(part for one in scene.regions[name] for part in grown(one, way))
    return settings, replace(scene, regions=wider)


def grown(outline: FloatArray, change: float) -> list[FloatArray]:
    """The polygon with every side moved outwards by ``change`` [m]."""
    found = shapely.Polygon(outline).buffer(change, join_style="mitre")
    parts = [part for part in shapely.get_parts(found) if not part.is_empty]
    return [shapely.get_coordinates(shapely.geometry.polygon.orient(part).exterior)[:-1] for part in parts]


if __name__ == "__main__":
    main()
