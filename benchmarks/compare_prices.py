"""Compare the prices of plans with new plans on changed maps.

Each folder is the result of a plan that flights judge. One limit at a time is eased by as much as should save
a share of the failures by its price, the mission is planned again with the same settings and several seeds,
and the failure rates at the length of the plan are compared, in the best front on either map, since
seeds differ by more than some of these changes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
import shapely

from pareto_ltl import PlanningResult, Scene, Settings, load_results
from pareto_ltl.planning.limits import Price
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import FRONT, SCENE
from pareto_ltl.run.stages import PLAN_TABLE
from pareto_ltl.support.arrays import FloatArray

FARTHEST = 0.02  # largest change of an outline, as a share of the map's size
SIDES = {"western": (0, 0), "southern": (0, 1), "eastern": (1, 0), "northern": (1, 1)}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories")
    parser.add_argument("--most", type=int, default=4, help="prices of outlines tried for each")
    parser.add_argument("--share", type=float, default=0.1, help="share of the failures to be saved")
    parser.add_argument("--seeds", type=int, default=3, help="plans on each map")
    parser.add_argument("--runs", type=int, default=20_000, help="flights that judge a front")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    heads = ("change", "failures", "predicted", "made anew")
    print(f"{'mission':12} {'limit':24} {' '.join(f'{head:>9}' for head in heads)} {'ratio':>6}")
    for folder in asked.results:
        results = load_results(folder)
        before, scene = results.plan, results.scene
        settings, length = results.settings, before.path.objectives.length
        rate = failure(settings, scene, length, asked)
        prices = [price for price in before.prices if price.kind not in ("airspeed", "length")][: asked.most]
        prices += [price for price in before.prices if price.kind in ("airspeed", "length")]
        for price in prices:
            change = asked.share * rate / price.saving
            if price.kind not in ("airspeed", "length"):
                change = min(change, FARTHEST * float(np.ptp(scene.bounds, axis=0).mean()))
            longer = change if price.kind == "length" else 0.0
            saved = rate - failure(*eased(settings, scene, price, change), length + longer, asked)
            predicted = price.saving * change
            print(
                f"{results.settings.name:12} {price.name:24} {change:9.4g} {rate:9.2%} {predicted:9.2%} "
                f"{saved:9.2%} {saved / predicted:6.2f}", flush=True,
            )  # fmt: skip


def failure(settings: Settings, scene: Scene, length: float, asked: argparse.Namespace) -> float:
    """The least failure rate at ``length`` [m] of the fronts of several seeds on ``scene``."""
    found = []
    for seed in range(asked.seeds):
        cfg = replace(settings, seed=seed, selection=replace(settings.selection, draws=asked.runs))
        front = PlanningResult(Run(cfg, PLAN_TABLE, {SCENE: scene}))[FRONT]
        order = np.argsort([path.objectives.length for path in front.paths])
        lengths = np.array([front.paths[k].objectives.length for k in order])
        rates = np.array([max(front.rates[k].failure, 0.5 / asked.runs) for k in order])
        found.append(np.interp(np.log(length), np.log(lengths), np.log(np.minimum.accumulate(rates))))
    return float(np.exp(min(found)))


def eased(settings: Settings, scene: Scene, price: Price, change: float) -> tuple[Settings, Scene]:
    """Settings and map with the limit of ``price`` eased by ``change`` [m or m/s]."""
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
