"""Numbers of kernels for small problems, kept in ``recorded_kernels.json`` (``kernels/test_recorded.py``).

Compiled and run as Python they have the same numbers; no search is among them, so that all machines agree.

    python tests/recorded_kernels.py [CASE ...]
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from coherent import LOOSE, STEPS
from landmarks import LANDMARK_SCENE, LANDMARK_WAY
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.refine.effort import Polish
from pareto_ltl.planning.refine.sampled import Refiner, resampled_means
from pareto_ltl.planning.separation import separation
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.simulation.common_flights import draw_flights
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.wind.records import WindField
from problems import QUICK_ERROR, box, make_problem, make_scene, smooth_wind
from recorded import in_lines, in_short

KEPT = Path(__file__).with_name("recorded_kernels.json")
ROBOT = {"dt": 100.0, "u_max": 20.0, "start_sd": 50.0}
ERRORS = {
    "airspeed_sd": 0.04, "heading_sd": 2.0, "clock_sd": 20.0, "airspeed_bias": 0.03, "heading_bias": 1.5,
    "clock_bias": 12.0, "error_correlation": [0.3, 0.1, -0.2],
    "start_error_covariance": [[0.2, 0.1], [5.0, -4.0], [30.0, 20.0]],
}  # fmt: skip
ROBOTS = {
    "plain": {},
    "errors": ERRORS | {"u_min": 4.0},
    "feedback": {"feedback_time": 400.0, "u_min": 4.0},
    "turned": {"a": [[0.98, 0.1], [-0.05, 0.97]], "b": [[0.9, 0.2], [-0.1, 1.1]], "airspeed_sd": 0.02},
}
SCENE = make_scene({"a": box(15, 15, 19, 19), "b": box(4, 6, 8, 10)}, [box(8, 2, 11, 6)], start=(2.0, 2.0))
SHORT = STEPS[::2]
FIELDS = ("x", "u", "cov", "shift", "speed", "F", "psi", "white")  # of a flight; the others are not filled up


def in_waves(field: WindField) -> WindField:
    """``field`` with waves as its modes: eigenvectors of a library differ with the processor."""
    assert field.modes is not None
    table = field.modes.psi
    rows, columns, mode = np.ogrid[: table.shape[1], : table.shape[2], : table.shape[-1]]
    wave = np.cos(0.11 * (1 + mode % 3) * rows - 0.07 * (1 + mode % 5) * columns + mode)
    psi = np.broadcast_to(0.25 * wave[None, :, :, None], table.shape).astype(np.float32)
    return replace(field, modes=replace(field.modes, psi=np.ascontiguousarray(psi)))


def straight(robot: dict[str, Any], formula: str = "F a", fidelity: str = "full") -> Problem:
    """A map of two regions and an obstacle in changing winds."""
    wind = in_waves(smooth_wind(SCENE, slots=9, hours=0.2, until=2000.0, error=QUICK_ERROR))
    return make_problem(formula, SCENE, wind, RobotConfig(**{**ROBOT, **robot}), LOOSE, fidelity=fidelity)


def of_path(robot: dict[str, Any], formula: str = "F a") -> Iterator[tuple[str, Any]]:
    """The flight along a path, its risks and costs, its chance constraints, and simulated flights."""
    problem = straight(robot, formula)
    for law in problem.laws:
        flight = propagate(problem, SHORT, problem.laws[law])
        yield from ((f"{law}/{name}", getattr(flight, name)) for name in FIELDS)
        flown = simulate_flights(problem, flight.u, 24, law, SeedSequence(3), SHORT)
        yield f"{law}/flown", flown.x
        yield f"{law}/accepted", flown.accepted
    lines = separation(problem, propagate(problem, SHORT))
    yield "lines", (lines.offset, lines.risk)
    o = evaluate_path(problem, SHORT, "given", tolerance=10.0).objectives
    yield "risks", (o.mission_risk, o.collision_risk, o.length)


def of_solve(robot: dict[str, Any], formula: str = "F a") -> Iterator[tuple[str, Any]]:
    """Derivatives of the smoothed failure, and a polish of three solves."""
    problem = straight(robot, formula)
    refiner = Refiner(problem, margin_model(problem))
    flights = draw_flights(problem, "coherent", 30, SeedSequence(4))
    flight = refiner.flown(resampled_means(problem, SHORT, 14))
    here, margins = refiner.slope(flight.x, flights.deviations(flight), 500.0, 30)
    yield "gradient", here.gradient
    yield "hessian", here.hessian
    yield "margins", margins
    polished = refiner.polished(flight.x, flights, Polish((500.0,), 3), 1.1 * 24e3)
    yield "polished", polished.x


def of_fixes(robot: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """The same of a robot that measures its position in two landmarks, in winds that change meanwhile."""
    scene = replace(LANDMARK_SCENE, landmarks=(box(4, 4, 7.5, 7.5), box(9.2, 9.2, 12.5, 12.5)))
    wind = in_waves(smooth_wind(scene, slots=9, hours=0.15, speed=2.0, gust=0.3, rho=0.8))
    options = ROBOT | {"u_max": 25.0, "start_sd": 300.0, "fix_sd": 50.0, "fix_time": 250.0} | robot
    problem = make_problem("F a", scene, wind, RobotConfig(**options), LOOSE, fidelity="full")
    way = LANDMARK_WAY[::2]
    flight = propagate(problem, way)
    yield from ((name, getattr(flight, name)) for name in FIELDS)
    yield "flown", simulate_flights(problem, flight.u, 24, "coherent", SeedSequence(3), way).x
    refiner = Refiner(problem, margin_model(problem))
    flights = draw_flights(problem, "coherent", 20, SeedSequence(4))
    here, _ = refiner.slope(way, flights.deviations(flight), 400.0, 20)
    yield "gradient", here.gradient
    yield "polished", refiner.polished(way, flights, Polish((400.0,), 1), 30e3).x


def of_trees(fidelity: str) -> Iterator[tuple[str, Any]]:
    """A tree of few vertices."""
    problem = straight({}, "!b U a", fidelity)
    tree = grow_forest(PlannerConfig(trees=1, n_max=80, threads=1), problem, SeedSequence(2)).trees[0]
    for name in ("x", "q", "parent", "risk", "length"):
        yield name, getattr(tree, name)


CASES: dict[str, Callable[[], Iterator[tuple[str, Any]]]] = {
    **{f"path {name}": lambda robot=robot: of_path(robot) for name, robot in ROBOTS.items()},
    "path before": lambda: of_path({}, "!b U a"),
    "solve": lambda: of_solve({}),
    "solve before": lambda: of_solve({}, "!b U a"),
    "solve two": lambda: of_solve({"u_min": 4.0}, "F(b & F a)"),
    "solve turned": lambda: of_solve(ROBOTS["turned"], "F(b & F a)"),
    "solve feedback": lambda: of_solve(ROBOTS["feedback"]),
    "fixes": lambda: of_fixes({}),
    "fixes errors": lambda: of_fixes(ERRORS),
    "trees paper": lambda: of_trees("paper"),
    "trees full": lambda: of_trees("full"),
}


def found(case: str) -> dict[str, list[Any]]:
    """Size and sums of each array of a case, by name."""
    return {name: in_short(_numbers(value)) for name, value in CASES[case]()}


def _numbers(value: Any) -> list[float]:
    """Of an array, a number, or what has them."""
    if isinstance(value, tuple | list):
        return [number for part in value for number in _numbers(part)]
    return [] if value is None else np.asarray(value, float).ravel().tolist()


def main(names: list[str]) -> None:
    """Write the cases ``names``, or all, into the file."""
    record = json.loads(KEPT.read_text()) if names else {}
    record |= {name: found(name) for name in names or CASES}
    KEPT.write_text(in_lines(record) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
