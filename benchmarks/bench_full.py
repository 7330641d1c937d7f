"""Full fidelity's budgets, on the real sample of winds: modes, growth, bounds, ranking, flights.

python -m pytest benchmarks/bench_full.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.random import SeedSequence

from oracle import path_risk as risk
from pareto_ltl.logic.mission import automaton_of
from pareto_ltl.planning import growth, selection
from pareto_ltl.planning.evaluate import evaluate_path, ordered_mission_risk, propagate
from pareto_ltl.planning.pack import build_problem
from pareto_ltl.planning.records import Forest
from pareto_ltl.planning.smoothing import smooth_paths
from pareto_ltl.settings import (
    MissionConfig,
    PlannerConfig,
    RobotConfig,
    SceneConfig,
    SmoothingConfig,
    WindConfig,
    preset,
)
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.simulation.judging import judge_front
from pareto_ltl.wind import sources
from pareto_ltl.wind.field import fit_wind_field as field
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene_settings import scene_from_settings
from wind_laws import gp as regression
from wind_laws import modes
from wind_laws.lattice import mode_lattice

CONF = Path(__file__).parents[1] / "conf"


def section(kind, name):
    return yaml.safe_load((CONF / kind / f"{name}.yaml").read_text())


@pytest.fixture(scope="module", params=["phi1", "phi2"])
def mission(request):
    """Problem and scene, kernels compiled by a first small forest."""
    cfg = WindConfig()
    scene = scene_from_settings(
        SceneConfig(**section("scene", request.param)), sources.read_readings(cfg).first_time
    )
    wind = field(cfg, place_readings(cfg, sources.read_readings(cfg), scene), scene, 200 * 1800.0)
    cells = workspace.decompose(scene)
    automaton = automaton_of(
        MissionConfig(**section("mission", request.param)), set(cells.letters), 1000, scene.regions
    )
    made = build_problem(RobotConfig(), PlannerConfig(), cfg, scene, wind, cells, automaton, preset("full"))
    growth.grow_forest(PlannerConfig(trees=1, n_max=50), made, SeedSequence(0))
    return made


@pytest.fixture(scope="module")
def paths(mission):
    return selection.tree_front(mission, growth.grow_forest(PlannerConfig(), mission, SeedSequence(0)))


def speed(forest: Forest) -> float:
    return sum(map(len, forest.trees)) / sum(tree.seconds for tree in forest.trees)


def test_modes_of_all_slots(benchmark):
    cfg = WindConfig()
    scene = scene_from_settings(
        SceneConfig(**section("scene", "phi1")), sources.read_readings(cfg).first_time
    )
    posterior = regression.fit_posterior(cfg, place_readings(cfg, sources.read_readings(cfg), scene))
    origin, spacing, shape = mode_lattice(scene.bounds, cfg.modes_spacing)
    nodes = origin + spacing * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    nobody = np.zeros((len(posterior.gust_var), len(nodes), 2, 0))
    arguments = (posterior, (), nobody, tuple(shape), nodes, cfg.energy, cfg.modes_max)
    benchmark.extra_info["budget"] = 2.0
    benchmark.pedantic(modes.error_modes, arguments, rounds=3)


def test_full_vertices_a_second_on_one_core(benchmark, mission):
    cfg = PlannerConfig(trees=8, n_max=2500, threads=1)
    forests: list[Forest] = []
    benchmark.pedantic(lambda: forests.append(growth.grow_forest(cfg, mission, SeedSequence(0))), rounds=5)
    benchmark.extra_info["figures"] = [("vertices/s", float(np.median([*map(speed, forests)])), 350_000)]
    benchmark.extra_info["sense"] = ">="


def test_full_first_accepted_path(benchmark, mission):
    """One tree per repetition, each with another seed."""
    cfg = PlannerConfig(trees=1, n_max=5000)
    seeds, found = iter(SeedSequence(0).spawn(1000)), list[bool]()

    def first() -> None:
        options = growth.GrowthOptions(stop_at_first=True)
        found.append(len(growth.grow_forest(cfg, mission, next(seeds), options=options).accepted) > 0)

    benchmark.extra_info["budget"] = 0.010
    benchmark.pedantic(first, rounds=40)
    benchmark.extra_info["figures"] = [("share of trees that find one", sum(found) / len(found), 0.95, ">=")]


def test_mission_bound_of_a_path(benchmark, mission, paths):
    path = paths[0]
    flight = propagate(mission, path.x)
    found = benchmark(ordered_mission_risk, mission, flight)
    assert found == pytest.approx(risk.ordered_bound(mission, path.x, path.cov), abs=1e-12)


def test_exact_evaluation_of_a_path(benchmark, mission, paths):
    benchmark(evaluate_path, mission, paths[0].x, "")


def test_judging_paths_by_4000_common_flights(benchmark, mission, paths):
    """Twenty paths, of which the race drops none: copies of one another."""
    some = [replace(path, origin=f"{k}") for k in range(5) for path in paths[:4]]
    arguments = (mission, some[:20], (), 4000, SeedSequence(0))
    benchmark.extra_info["budget"] = 1.0
    benchmark.pedantic(judge_front, arguments, rounds=5, warmup_rounds=1)


def test_judging_hundreds_of_paths(benchmark, mission):
    """The race drops most paths of a forest early; the bounds of the remaining paths are included."""
    mission = replace(mission, epsilon=1.0)  # no limit, which paths of trees do not keep
    forest = growth.grow_forest(PlannerConfig(), mission, SeedSequence(0))
    found = forest.accepted[:300]
    many = [evaluate_path(mission, forest.trees[j].path(v), f"{j} {v}", tight=False) for j, v in found]
    benchmark.extra_info["budget"] = 2.0
    benchmark.pedantic(judge_front, (mission, (), many, 4000, SeedSequence(0)), rounds=3, warmup_rounds=1)


@pytest.mark.parametrize(("runs", "budget"), [(500, 0.05), (2000, 0.2), (100_000, 1.5)])
def test_coherent_flights(benchmark, mission, paths, runs, budget):
    benchmark.extra_info["budget"] = budget
    arguments = (mission, paths[0].u, runs, "coherent", SeedSequence(1), paths[0].x)
    benchmark.pedantic(
        deployment.simulate_flights, arguments, rounds=3 if runs > 10_000 else 10, warmup_rounds=1
    )


def test_full_smoothing(benchmark, mission, paths):
    benchmark.pedantic(smooth_paths, (SmoothingConfig(), mission, paths), rounds=3, warmup_rounds=1)
