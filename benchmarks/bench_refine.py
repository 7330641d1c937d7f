"""Budgets of the sampled refinement, on the real sample of winds: margins, one cone programme, one polish.

Times are CPU times of one core, so that other work on the machine counts little.

python -m pytest benchmarks/bench_refine.py
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.random import SeedSequence

from pareto_ltl.extend import draw_flights
from pareto_ltl.logic.mission import automaton_of
from pareto_ltl.planning.convex.programme import programme, programme_for
from pareto_ltl.planning.margin_model import margin_model, margin_scratch
from pareto_ltl.planning.pack import build_problem
from pareto_ltl.planning.refine.effort import USUAL
from pareto_ltl.planning.refine.sampled import Refiner, resampled_means
from pareto_ltl.planning.refine.starts import line_starts
from pareto_ltl.settings import MissionConfig, PlannerConfig, RobotConfig, SceneConfig, WindConfig, preset
from pareto_ltl.wind import sources
from pareto_ltl.wind.field import fit_wind_field
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene_settings import scene_from_settings
from plane_logic import margin as kernel
from solves import next_means

pytestmark = pytest.mark.benchmark(timer=time.process_time)
CONF = Path(__file__).parents[1] / "conf"
STEPS, RUNS, DT = 50, 300, 1800.0
LOOSE = 1.1  # longest length allowed, over the length of the taut line


def section(kind, name):
    return yaml.safe_load((CONF / kind / f"{name}.yaml").read_text())


@pytest.fixture(scope="module", params=["phi1", "phi2"])
def task(request):
    """A refiner, a taut line in 50 steps and 300 flights; all kernels and the programme are warm."""
    cfg = WindConfig()
    readings = sources.read_readings(cfg)
    scene = scene_from_settings(SceneConfig(**section("scene", request.param)), readings.first_time)
    wind = fit_wind_field(cfg, place_readings(cfg, readings, scene), scene, 200 * DT)
    cells = workspace.decompose(scene)
    mission = MissionConfig(**section("mission", request.param))
    automaton = automaton_of(mission, set(cells.letters), 1000, scene.regions)
    problem = build_problem(
        RobotConfig(dt=DT), PlannerConfig(), cfg, scene, wind, cells, automaton, preset("full")
    )
    refiner = Refiner(problem, margin_model(problem))
    x = resampled_means(problem, line_starts(problem)[0].x, STEPS)
    flights = draw_flights(problem, "coherent", RUNS, SeedSequence(0))
    longest = LOOSE * float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
    refiner.polish(x, flights, how(problem), longest)
    return refiner, x, flights, longest


def how(problem):
    """The first evaluation of a start."""
    size = float(np.ptp(problem.scene.bounds[:, 0]))
    return replace(USUAL.first, widths=tuple(size * width for width in USUAL.first.widths))


def descent_of(refiner, flight, flights):
    """The local model of the failure about ``flight``."""
    width = how(refiner.problem).widths[0]
    return refiner.slope(flight.x, flights.deviations(flight), width, RUNS)[0]


def test_margins_of_300_flights_of_50_steps(benchmark, task):
    refiner, x, flights, _ = task
    flight = refiner.flown(x)
    off = flights.deviations(flight)
    width = how(refiner.problem).widths[0]
    slope = kernel.Slope(np.zeros((STEPS + 1, 2)), np.zeros((STEPS + 1, 3)))
    scratch = margin_scratch(refiner.model, RUNS, STEPS + 1)
    benchmark.extra_info["budget"] = 0.002
    value = benchmark(kernel.smoothed_failure, refiner.model, flight.x, off, width, slope, scratch)
    assert 0.0 < value < 1.0


def test_one_cone_programme_of_50_steps(benchmark, task):
    refiner, x, flights, longest = task
    flight = refiner.flown(x)
    descent = descent_of(refiner, flight, flights)
    benchmark.extra_info["budget"] = 0.005
    found = benchmark(next_means, refiner.problem, flight, descent, 0.5, longest)
    assert found is not None


def test_one_convex_programme_of_50_steps(benchmark, task):
    """In cvxpy and Clarabel, with the chance constraint of every segment; 2 of 10 ms are Clarabel's."""
    refiner, x, flights, longest = task
    flight, stated = refiner.flown(x), programme_for(refiner.problem, STEPS)
    descent = descent_of(refiner, flight, flights)
    stated.descend(flight, descent, 0.5, longest)  # states it
    benchmark.extra_info["budget"] = 0.03
    assert benchmark(stated.descend, flight, descent, 0.5, longest) is not None


def test_stating_a_convex_programme_of_50_steps(benchmark, task):
    refiner, x, flights, longest = task
    flight = refiner.flown(x)
    descent = descent_of(refiner, flight, flights)
    benchmark.extra_info["budget"] = 0.4

    def stated():
        return programme(refiner.problem, STEPS).descend(flight, descent, 0.5, longest)

    assert benchmark.pedantic(stated, rounds=5, warmup_rounds=1) is not None


def test_one_polish_of_50_steps_with_300_flights(benchmark, task):
    refiner, x, flights, longest = task
    benchmark.extra_info["budget"] = 0.1
    arguments = (x, flights, how(refiner.problem), longest)
    polished = benchmark.pedantic(refiner.polish, arguments, rounds=10, warmup_rounds=1)
    before = float(flights.failed(flights.positions(refiner.flown(x))).mean())
    assert polished.failed < before
