"""Compare the best place of ``pareto-ltl beacons`` with a grid search by plans made anew.

Each folder is the result of a plan on a map without landmarks. A beacon is put on each node of a grid over
the map and on the best places of the beacon map, the mission is planned again with it, and the least failure
rates over at most the length of the plan are compared.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed

from compare_prices import failure
from pareto_ltl import Scene, Settings, beacons, load_results
from pareto_ltl.simulation.beacons import disc
from pareto_ltl.support.arrays import FloatArray

CLOSE = 1.1  # failures with the best beacon of the map, in those of the best node, that are asked for


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", help="results directories")
    parser.add_argument("--radius", type=float, help="of a beacon [m]; default: 2 %% of the map")
    parser.add_argument("--grid", type=int, default=7, help="nodes along each side of the map")
    parser.add_argument("--best", type=int, default=1, help="places of the beacon map that are tried")
    parser.add_argument("--seeds", type=int, default=1, help="plans on each map")
    parser.add_argument("--runs", type=int, default=20_000, help="flights that judge a front")
    parser.add_argument("--jobs", type=int, default=2, help="plans at a time")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    for folder in asked.results:
        results = load_results(folder)
        settings, scene, length = results.settings, results.scene, results.plan.path.objectives.length
        found = beacons(folder, radius=asked.radius)
        order = np.argsort(found.failure, kind="stable")[: asked.best]
        nodes = grid(scene, found.radius, asked.grid)
        places = np.vstack([found.places.at[order], nodes])
        rates = np.array(
            Parallel(n_jobs=asked.jobs)(
                delayed(with_beacon)(settings, scene, at, found.radius, length, asked) for at in places
            )
        )
        without = failure(settings, scene, length, asked)
        print(f"{settings.name}: beacons of {found.radius / 1e3:.3g} km, over at most {length / 1e3:.4g} km")
        print(f"  without a beacon {without:.3%}")
        for at, rate, planned in zip(places[: asked.best], found.failure[order], rates, strict=False):
            print(f"  beacon map {at / 1e3} km: {rate:.3%} with the plan as it is, {planned:.3%} made anew")
        for k in asked.best + np.argsort(rates[asked.best :])[:5]:
            print(f"  grid       {places[k] / 1e3} km: {rates[k]:.3%} made anew")
        ratio = rates[0] / rates[asked.best :].min()
        print(
            f"  best place of the map over the best of {len(nodes)} nodes: {ratio:.3f} (at most {CLOSE})",
            flush=True,
        )


def grid(scene: Scene, radius: float, count: int) -> FloatArray:
    """Nodes (count², 2) [m] whose beacons lie on the map."""
    low, high = scene.bounds
    sides = [np.linspace(a + radius, b - radius, count) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)


def with_beacon(
    settings: Settings, scene: Scene, at: FloatArray, radius: float, length: float, asked: argparse.Namespace
) -> float:
    """The least failure rate with a beacon at ``at``, over at most ``length`` [m]."""
    return failure(settings, replace(scene, landmarks=(disc(at, radius),)), length, asked)


if __name__ == "__main__":
    main()
