"""What planning scales in: automaton states, steps, obstacles, regions, corners, vertices."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from scale.case import GIBIBYTE, Case
from scale.maps import crowded_map, region_names

MODELS = ("paper", "full")
SECONDS = 30.0  # for a plan at the largest size
FEW = {"trees": 4, "n_max": 5000, "max_steps": 1000}  # where the size of the trees is not what is measured
WIND = {"source": "sample", "hold_last": True}  # for as long as a plan takes
FAST = {"u_max": 60.0, "dt": 900.0}  # long missions end while the wind is known


def planned(scene: dict[str, Any], formula: str, fidelity: str, **sections: Any) -> float:
    """CPU seconds, of all cores together, from the settings to a plan; a busy machine counts less."""
    import pareto_ltl

    sections = {"wind": WIND, "robot": FAST, "planner": FEW} | sections
    began = time.process_time()
    pareto_ltl.plan(scene, formula, seed=1, fidelity=fidelity, **sections)
    return time.process_time() - began


# --- automata ---------------------------------------------------------------------------------


def pairs_in_order(states: int) -> tuple[str, int]:
    """A formula whose automaton has about ``states`` states, and the number of its regions.

    Pairs of regions, each visited in order, multiply the states by 3; one more region is added if the number
    of states is then closer.
    """
    pairs, left = 0, states
    while left >= 3:
        pairs, left = pairs + 1, left / 3
    names = region_names(2 * pairs + (left >= 1.5))
    parts = [f"F({a} & F {b})" for a, b in zip(names[: 2 * pairs : 2], names[1 : 2 * pairs : 2], strict=True)]
    return " & ".join([*parts, *[f"F {name}" for name in names[2 * pairs :]]]), len(names)


def many_states(fidelity: str) -> Callable[[int], float]:
    def run(states: int) -> float:
        formula, regions = pairs_in_order(states)
        return planned(crowded_map(regions, 6), formula, fidelity, logic={"max_states": 20_000})

    return run


def coverage(fidelity: str) -> Callable[[int], float]:
    def run(regions: int) -> float:
        formula = " & ".join(f"F {name}" for name in region_names(regions))
        return planned(crowded_map(regions, 6), formula, fidelity, logic={"max_states": 20_000})

    return run


# --- steps ------------------------------------------------------------------------------------


def many_steps(fidelity: str) -> Callable[[int], float]:
    """A path of about ``steps`` steps: some 1,900 km at 30 m/s, so that the step is short."""

    def run(steps: int) -> float:
        vertices = max(2500, 25 * steps)
        return planned(
            crowded_map(3, 6), "F(r0 & F r1 & F r2)", fidelity, robot={"dt": 63_000.0 / steps},
            planner={"trees": 4, "n_max": vertices, "max_steps": 4 * steps},
        )  # fmt: skip

    return run


# --- maps -------------------------------------------------------------------------------------


def many_obstacles(fidelity: str) -> Callable[[int], float]:
    def run(obstacles: int) -> float:
        robot = {
            "dt": 200.0,
            "u_max": 60.0,
            "feedback_time": 600.0,
        }  # for narrow gaps
        return planned(crowded_map(3, obstacles), "F(r0 & F r1)", fidelity, robot=robot)

    return run


def many_regions(fidelity: str) -> Callable[[int], float]:
    """Visit three of the regions in order and none of the others before the third."""

    def run(regions: int) -> float:
        others = " & ".join(f"!{name}" for name in region_names(regions)[3:])
        return planned(crowded_map(regions, 6), f"F(r0 & F(r1 & F r2)) & (({others}) U r2)", fidelity)

    return run


def many_corners(fidelity: str) -> Callable[[int], float]:
    def run(corners: int) -> float:
        return planned(crowded_map(3, 6, corners), "F(r0 & F r1 & F r2)", fidelity)

    return run


# --- trees ------------------------------------------------------------------------------------


def many_vertices(vertices: int) -> float:
    """CPU seconds of growth alone, ten trees of ``vertices`` each; they are the same in every preset."""
    from numpy.random import SeedSequence

    import pareto_ltl
    from pareto_ltl.planning.growth import grow_forest
    from pareto_ltl.settings import PlannerConfig

    problem = pareto_ltl.plan(
        "phi1", "F(a & F b & F c)", fidelity="paper", wind="sample", robot={"dt": 1800.0},
        planner={"trees": 2, "n_max": 2000},
    ).problem  # fmt: skip
    cfg = PlannerConfig(trees=10, n_max=vertices)
    grow_forest(replace(cfg, n_max=100), problem, SeedSequence(1))
    began = time.process_time()
    grow_forest(cfg, problem, SeedSequence(1))
    return time.process_time() - began


def in_both_models(
    name: str, sizes: tuple[int, ...], make: Callable[[str], Callable[[int], float]], unit: str
) -> list[Case]:
    """The case with ``fidelity=paper`` and with ``fidelity=full``."""
    return [Case(f"{name}, {model}", sizes, make(model), unit, SECONDS) for model in MODELS]


CASES = [
    *in_both_models("states", (9, 81, 729, 2187, 13_122), many_states, "automaton states"),
    *in_both_models("coverage", (4, 8, 11, 14), coverage, "regions to visit"),
    *in_both_models("steps", (60, 125, 250, 500, 1000), many_steps, "steps of the path, about"),
    *in_both_models("obstacles", (10, 30, 100, 300, 1000), many_obstacles, "obstacles"),
    *in_both_models("regions", (6, 12, 25, 50), many_regions, "regions on the map"),
    *in_both_models("corners", (10, 60, 300, 2000), many_corners, "corners of each polygon"),
    Case(
        "vertices", (1000, 10_000, 100_000, 1_000_000), many_vertices,
        "vertices of each of 10 trees", 300.0, 4 * GIBIBYTE,
    ),
]  # fmt: skip
