"""Long paths are searched for in merged steps: the law in them, the same flights, paths in all steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.extend import draw_flights
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.problem import Problem, with_merged_steps
from pareto_ltl.planning.refine import Effort, front_sweep, sampled_paths
from pareto_ltl.planning.refine.front_sweep import steps_to_merge
from pareto_ltl.planning.refine.sampled import divided
from pareto_ltl.planning.refine.starts import Start, first_starts
from pareto_ltl.planning.refine.sweep import first_of
from pareto_ltl.planning.separation import keeps_epsilon
from pareto_ltl.settings import PlannerConfig, RefineConfig, RobotConfig, preset
from pareto_ltl.world.windows import Window
from plane_kernels.geometry import locate_cells
from problems import box, make_problem, make_scene, smooth_wind

TIMES = 4
PLANNER = PlannerConfig(trees=2, n_max=4000, max_steps=600, epsilon=0.3)
REFINE = RefineConfig(flights=200, sweep_flights=80, classes=1, points=3)
EFFORT = Effort.of(REFINE)
LINE = np.column_stack([np.linspace(2e3, 15e3, 121), np.linspace(3e3, 9e3, 121)])  # [m], 120 steps


def task(
    dt: float = 10.0,
    law: str = "coherent",
    feedback: float | None = None,
    windows: bool = False,
    side: float = 4.0,
) -> Problem:
    """Two regions with an obstacle between them; a path of about 30 km takes 250 steps of 10 s."""
    scene = make_scene(
        {"a": box(13, 2, 13 + side, 2 + side), "b": box(3, 13, 7, 17)}, [box(9, 9, 12, 12)], start=(2.0, 3.0)
    )
    if windows:
        scene = replace(scene, windows={"early": Window("a", 0.0, 2000.0)})
    robot = RobotConfig(dt=dt, u_max=12.0, start_sd=100.0, feedback_time=feedback)
    wind = smooth_wind(scene, speed=1.5, sd=0.9, gust=0.5)
    formula = "F(early & F b)" if windows else "F(a & F b)"
    planner = replace(PLANNER, max_steps=int(6000 / dt))
    return make_problem(formula, scene, wind, robot, planner, fidelity=replace(preset("full"), law=law))


@pytest.mark.parametrize("feedback", [None, 600.0])
def test_a_merged_problem_is_the_problem_of_the_longer_step(feedback: float | None) -> None:
    merged, built = (
        with_merged_steps(task(10.0, feedback=feedback), TIMES),
        task(10.0 * TIMES, feedback=feedback),
    )
    for name in ("gain", "exposed", "closed", "dt", "u_max"):
        np.testing.assert_allclose(getattr(merged.motion, name), getattr(built.motion, name), rtol=1e-12)
    assert merged.horizon == built.horizon
    np.testing.assert_allclose((merged.modes.white, merged.modes.rest), (built.modes.white, built.modes.rest))
    passed = np.cumprod(merged.modes.keep, axis=0)[-1], np.cumprod(built.modes.keep, axis=0)[-1]
    np.testing.assert_allclose(*passed)
    one, other = (propagate(problem, LINE[::TIMES]) for problem in (merged, built))
    np.testing.assert_allclose(one.cov[-1], other.cov[-1], rtol=0.02, atol=1e4)


@pytest.mark.parametrize("feedback", [None, 600.0])
def test_merged_flights_are_the_same_flights(feedback: float | None) -> None:
    problem = task(feedback=feedback)
    merged, flights = (
        with_merged_steps(problem, TIMES),
        draw_flights(problem, "coherent", 400, SeedSequence(1)),
    )
    coarse = propagate(merged, LINE[::TIMES])
    fine = propagate(problem, divided(coarse.x, TIMES))
    off = flights.positions(fine)[:, ::TIMES] - coarse.x
    merged_off = flights.merged(merged, TIMES).positions(coarse) - coarse.x
    spread = off[:, -1].std(axis=0)
    assert (np.abs(merged_off[:, -1] - off[:, -1]).max(axis=0) < 0.35 * spread).all()
    assert np.corrcoef(merged_off[:, -1, 0], off[:, -1, 0])[0, 1] > 0.99


def test_only_long_paths_in_the_coherent_law_without_windows_are_merged() -> None:
    long = [Start(np.repeat(LINE, 3, axis=0), "long")]
    problem = task()
    assert steps_to_merge(EFFORT, problem, long) == round((len(long[0].x) - 1) / EFFORT.legs)
    assert steps_to_merge(EFFORT, problem, [*long, Start(LINE, "short")]) == 1
    assert steps_to_merge(EFFORT, problem, []) == 1
    assert steps_to_merge(EFFORT, task(law="independent"), long) == 1
    assert steps_to_merge(EFFORT, task(windows=True), long) == 1
    run = steps_to_merge(replace(EFFORT, legs=10), task(side=1.0), long) * task().reach
    assert run <= front_sweep.SHARE_OF_PLACE * 1000.0 < run + task().reach  # of the region, 1 km wide


def test_paths_in_merged_steps_are_flown_in_all_steps() -> None:
    problem = task()
    forest = grow_forest(PLANNER, problem, SeedSequence(3))
    flights = draw_flights(problem, "coherent", REFINE.flights, SeedSequence(5))
    found = sampled_paths(EFFORT, problem, forest, first_of(flights))
    assert found
    for path in found:
        assert len(path.u) > 1.5 * EFFORT.legs
        assert problem.logic.distance[path.q[-1]] == 0.0
        assert (np.linalg.norm(path.u, axis=1) <= problem.motion.u_max).all()
        assert (locate_cells(problem.cells, np.ascontiguousarray(path.x)) >= 0).all()
    assert any(keeps_epsilon(problem, path) for path in found)
    fresh = draw_flights(problem, "coherent", 1000, SeedSequence(9))
    failed = [fresh.failed(fresh.flown(path.u, path.x)).mean() for path in found]
    begun = [propagate(problem, start.x) for start in first_starts(problem, forest).values()]
    assert min(failed) < 0.7 * min(fresh.failed(fresh.positions(flight)).mean() for flight in begun)
