"""Compare the best place of ``pareto-ltl beacons`` with a grid search by new plans.

Each folder is the result of a plan on a map without landmarks. A beacon is put on each node of a grid over
the map, and the mission is planned again in a coarse search (as in ``replan``). The best nodes, and the
best place of the beacon map, are then planned with the settings of the folder and several seeds; the least
failure rates over at most the length of the plan are compared.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed

from compare_prices import failure
from pareto_ltl import Scene, Settings, beacons, load_results
from pareto_ltl.planning.pack import disc
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.flight.rest_of_flight import prompt_settings

CLOSE = 1.1  # limit of failures with the best place of the map over failures with the best node


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories")
    parser.add_argument("--radius", type=float, help="of a beacon [m]; default: 2 %% of the map")
    parser.add_argument("--spacing", type=float, default=2.0, help="of the nodes, in radii")
    parser.add_argument("--finalists", type=int, default=8, help="nodes planned with all settings")
    parser.add_argument("--seeds", type=int, default=2, help="such plans for each of them")
    parser.add_argument("--runs", type=int, default=20_000, help="flights that judge a front")
    parser.add_argument("--jobs", type=int, default=2, help="plans at a time")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    rough = argparse.Namespace(seeds=1, runs=4000)
    pool = Parallel(n_jobs=asked.jobs)
    for folder in asked.results:
        results = load_results(folder)
        settings, scene, length = results.settings, results.scene, results.plan.path.objectives.length
        found = beacons(folder, radius=asked.radius)
        best = found.places.at[found.sites[0].number]
        nodes = grid(scene, found.radius, asked.spacing)
        prompt = prompt_settings(settings)
        first = pool(delayed(with_beacon)(prompt, scene, at, found.radius, length, rough) for at in nodes)
        places = np.vstack([best, nodes[np.argsort(first, kind="stable")[: asked.finalists]]])
        rates = pool(delayed(with_beacon)(settings, scene, at, found.radius, length, asked) for at in places)
        without = failure(settings, scene, length, asked)
        print(f"{settings.name}: beacons of {found.radius / 1e3:.3g} km, over at most {length / 1e3:.4g} km")
        print(f"  without a beacon {without:.3%}, best of {asked.seeds} seeds as below")
        print(f"  beacon map {place(best)}: {found.sites[0].rate.failure:.3%} with the plan as it is")
        print(f"  beacon map {place(best)}: {rates[0]:.3%} made anew")
        for at, rate in zip(places[1:], rates[1:], strict=True):
            print(f"  grid       {place(at)}: {rate:.3%} made anew")
        ratio = rates[0] / min(rates[1:])
        print(f"  over the best of {len(nodes)} nodes {ratio:.3f}, at most {CLOSE} asked", flush=True)


def place(at: FloatArray) -> str:
    """A place in kilometres."""
    return f"({at[0] / 1e3:.1f}, {at[1] / 1e3:.1f}) km"


def grid(scene: Scene, radius: float, spacing: float) -> FloatArray:
    """Nodes (N, 2) [m], ``spacing`` radii apart, whose beacons lie on the map."""
    low, high = scene.bounds
    sides = [
        np.linspace(a + radius, b - radius, max(2, round((b - a - 2 * radius) / (spacing * radius)) + 1))
        for a, b in zip(low, high, strict=True)
    ]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)


def with_beacon(
    settings: Settings, scene: Scene, at: FloatArray, radius: float, length: float, asked: argparse.Namespace
) -> float:
    """The least failure rate with a beacon at ``at``, over at most ``length`` [m]."""
    return failure(settings, replace(scene, landmarks=(disc(at, radius),)), length, asked)


if __name__ == "__main__":
    main()
