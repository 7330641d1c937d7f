"""Small missions planned from end to end, for a comparison of compiled and uncompiled kernels.

``planning/test_uncompiled_plans.py`` runs it both ways:

    NUMBA_DISABLE_JIT=1 python tests/small_plans.py FILE.npz [MISSION ...]
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

import pareto_ltl
from careful_io.yaml_files import read_yaml
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.resources import CONF
from quick_wind import QUICK_WIND

REFINED = {"flights": 20, "sweep_flights": 10, "classes": 1, "points": 2}
COMMON: dict[str, Any] = {
    "robot": {"dt": 3600.0},
    "planner": {"trees": 1, "n_max": 150, "max_steps": 60, "epsilon": 0.7},
    "smoothing": {"candidates": 1, "weights": [1.0]},
    "refine": REFINED,
    "selection": {"draws": 20, "runs": 20},
    "wind": {**QUICK_WIND, "modes_max": 8},
    "deployment": {"runs": 10},
    "report": "none",
    "exports": "none",
}
BEACONS = [[[0.6, 6.5], [3.1, 6.5], [3.1, 9.4], [0.6, 9.4]]]
PHI1 = "F(a & F b & F c)"


def phi1(**changes: Any) -> dict[str, Any]:
    """The keys of the packaged map phi1, with changes."""
    return read_yaml(CONF.file("scene", "phi1")) | changes


MISSIONS: dict[str, tuple[str | dict[str, Any], str, dict[str, Any]]] = {
    "full": ("phi1", PHI1, {}),
    "paper": (
        "phi1",
        PHI1,
        {"fidelity": "paper", "planner": COMMON["planner"] | {"n_max": 600}},
    ),
    "fixes": (
        phi1(landmarks=BEACONS),
        "F a",
        {"refine": REFINED | {"flights": 60, "sweep_flights": 30}},
    ),
    "deadline": ("phi1", "F[0,40h] a & F[0,60h] b", {}),
    "calm": ("phi1", "F a", {"wind": "calm", "robot": COMMON["robot"] | {"heading_sd": 6.0}}),
}


def numbers(name: str) -> dict[str, FloatArray]:
    """The numbers of the plan of ``MISSIONS[name]``, its trees and its simulated flights, by name."""
    scene, formula, changes = MISSIONS[name]
    options = COMMON | changes
    result = pareto_ltl.plan(scene, formula, **options)
    path, tree = result.plan.path, result.forest.trees[0]
    found = {"x": path.x, "cov": path.cov, "tree_x": tree.x, "tree_risk": tree.risk}
    found["objectives"] = np.array(
        [[o.length, o.mission_risk, o.collision_risk] for o in (p.objectives for p in result.front.paths)]
    )
    if result.plan.promise is not None:
        rate = result.plan.promise.rate
        found["rate"] = np.array([rate.failure, rate.low, rate.high])
    return found


def main(file: Path, names: Iterable[str]) -> None:
    """Write the numbers of the missions ``names`` to ``file``."""
    np.savez(file, **{f"{name}.{key}": value for name in names for key, value in numbers(name).items()})


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or MISSIONS)
