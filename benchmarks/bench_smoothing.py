"""Smoothing budgets: a warm convex solve in 40 ms, a path of 100 steps past 10 obstacles in 150 ms.

A taut line past 300 obstacles or 2,000 corners: 1 s and 100 MB.

python -m pytest benchmarks/bench_smoothing.py
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import yaml
from numpy.random import SeedSequence

from large_maps import Waiting, many_discs, rough_disc
from pareto_ltl.logic import translate
from pareto_ltl.planning import growth, selection, smoothing
from pareto_ltl.planning.convex import programme
from pareto_ltl.planning.evaluate import completes_mission
from pareto_ltl.planning.pack import build_problem
from pareto_ltl.planning.refine.starts import Start
from pareto_ltl.planning.routes.obligations import possible_orders
from pareto_ltl.planning.routes.taut_lines import taut_line
from pareto_ltl.settings import PlannerConfig, RobotConfig, SceneConfig, SmoothingConfig, WindConfig
from pareto_ltl.support.resources import resource_folder
from pareto_ltl.wind.records import WindField
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings
from problems import box

FORMULAS = {"phi1": "F(a & F b & F c)", "phi2": "F(a & F(b & F c)) | F(a & F(d & F c))"}
DT = 600.0  # [s] steps short enough for about 100 of them
# Exact wind-free optima (visibility graph over the free space, regions closed), in metres.
CALM_OPTIMUM = {"phi1": 1_691_600.0, "phi2": 1_404_000.0}


def wind(speed, variance):
    nodes = np.arange(-650e3, 651e3, 25e3)
    x, y = np.meshgrid(nodes, nodes, indexing="ij")
    times = 10_800.0 * np.arange(14)
    mean = np.array(
        [np.stack([np.sin(y / 3e5 + k / 9), np.cos(x / 3e5 - k / 9)], axis=-1) for k in range(14)]
    )
    return WindField(
        nodes[[0, 0]], 25e3, times, speed * mean, np.full_like(mean, variance), np.full((14, 2), variance),
        until=np.inf,
    )  # fmt: skip


def planned(mission, dt, speed, variance):
    """The problem and the front of its trees."""
    scene = scene_from_settings(
        SceneConfig(**yaml.safe_load((resource_folder("conf") / "scene" / f"{mission}.yaml").read_text()))
    )
    cells = workspace.decompose(scene)
    task = build_problem(
        RobotConfig(dt=dt), PlannerConfig(), WindConfig(), scene, wind(speed, variance), cells,
        translate(FORMULAS[mission], cells.letters),
    )  # fmt: skip
    forest = growth.grow_forest(PlannerConfig(), task, SeedSequence(0))
    return task, selection.tree_front(task, forest)


@pytest.fixture(scope="module")
def long():
    """A line of about 100 steps on the map with 10 obstacles, and its programme, warm."""
    task, paths = planned("phi2", DT, 5.0, 1.5)
    x = smoothing.shortened_path(task, paths[0].x)
    assert 95 <= len(x) - 1 <= 110, f"the budgets speak of 100 steps, this line has {len(x) - 1}: change DT"
    start = Start(x, "")
    model = smoothing.fitting_programme(task, [start])
    shared = smoothing.SmoothingTask(SmoothingConfig(), model, task, paths[0].objectives.length)
    smoothing.iterate(shared, x, 10.0)
    return task, paths, shared, model


def test_a_warm_convex_solve(benchmark, long):
    _, paths, shared, model = long
    x = smoothing.shortened_path(long[0], paths[0].x)
    benchmark.extra_info["budget"] = 0.040
    assert benchmark(model.bend, x, 10.0, 1.0, shared.shortest) is not None


@pytest.mark.parametrize("weights", [(10.0,), (100.0, 10.0, 1.0)], ids=["one weight", "three weights"])
def test_a_path_of_100_steps_past_10_obstacles(benchmark, long, weights):
    """All steps of smoothing one path of a tree: pulled, walked, bent, shortened, bent again."""
    task, paths, shared, _ = long

    def in_all():
        x, path = smoothing.shortened_path(task, paths[0].x), None
        for weight in weights:
            path = smoothing.improve(shared, x, weight)
            x = path.x
        return path

    benchmark.extra_info["budget"] = 0.150
    assert completes_mission(task, benchmark.pedantic(in_all, rounds=7, warmup_rounds=1))


def test_building_the_programme(benchmark, long):
    task, paths, shared, model = long
    x = smoothing.shortened_path(task, paths[0].x)

    def build():
        fresh = programme.programme(task, model.shape.steps, model.shape.witnesses, model.shape.faces)
        return fresh.bend(x, 10.0, 1.0, shared.shortest)

    benchmark.extra_info["budget"] = 0.5
    assert benchmark.pedantic(build, rounds=3) is not None


@pytest.mark.parametrize("mission", ["phi1", "phi2"])
def test_a_front_in_rough_wind(benchmark, mission):
    task, paths = planned(mission, 1800.0, 5.0, 1.5)
    cfg = SmoothingConfig(candidates=4, weights=[1.0, 10.0, 100.0])
    benchmark.extra_info["budget"] = 1.0
    smoothed = benchmark.pedantic(smoothing.smooth_paths, (cfg, task, paths), rounds=3, warmup_rounds=1)
    length = min(path.objectives.length for path in paths)
    shared = smoothing.SmoothingTask(cfg, None, task, length)
    old, new = (min(shared.merit(p, 10.0) for p in group) for group in (paths, smoothed))
    benchmark.extra_info["figures"] = [("weighted cost over cost of the trees", new / old, 1.0)]


@pytest.mark.parametrize("mission", CALM_OPTIMUM)
def test_calm_length(benchmark, mission):
    task, paths = planned(mission, 1800.0, 0.0, 0.0)
    benchmark.extra_info["budget"] = 1.0
    smoothed = benchmark.pedantic(
        smoothing.smooth_paths, (SmoothingConfig(), task, paths), rounds=3, warmup_rounds=1
    )
    ratio = min(path.objectives.length for path in smoothed) / CALM_OPTIMUM[mission]
    benchmark.extra_info["figures"] = [("length over the optimum", ratio, 1.01)]


# --- large maps: 20 km, steps of 1 km -----------------------------------------------------------


SMALL = (0.15, 0.35)  # radii of obstacles [km]
MAPS = {
    "300 obstacles": (many_discs(300, 1, SMALL, corners=6), {}, "F(a & F b)"),
    "300 obstacles of 32 corners": (many_discs(300, 1, SMALL, corners=32), {}, "F(a & F b)"),
    "an obstacle of 2000 corners": ([rough_disc(2000, 9, 9, 3)], {}, "F(a & F b)"),
    "a region of 2000 corners": ([], {"a": rough_disc(2000, 15, 15, 2)}, "F(a & F b)"),
    "a forbidden region of 2000 corners": ([], {"a": rough_disc(2000, 10, 9, 3)}, "!a U b"),
}


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("deviation", [0.0, 40.0], ids=["no deviation", "40 m"])
def test_a_taut_line_past(benchmark, name, deviation):
    """The second line on the map; the first also simplifies the outlines."""
    obstacles, regions, formula = MAPS[name]
    scene = Scene(
        np.array([[0.0, 0.0], [20e3, 20e3]]), np.array([1e3, 1e3]),
        {"a": box(16, 16, 18, 18), "b": box(2, 15, 4, 17)} | regions, (*obstacles, box(10.6, 1.1, 11.4, 1.9)),
    )  # fmt: skip
    cells = workspace.decompose(scene)
    task = build_problem(
        RobotConfig(dt=100.0, u_max=10.0), PlannerConfig(), WindConfig(), scene, wind(0.0, 0.0), cells,
        translate(formula, cells.letters),
    )  # fmt: skip
    path = Waiting(scene.start[None], deviation**2 * np.eye(2)[None])
    order = possible_orders(task, 1)[0]
    assert taut_line(task, order, path.x, path.cov, 1.0, 2.0) is not None
    tracemalloc.start()
    taut_line(task, order, path.x, path.cov, 1.0, 2.0)
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    benchmark.extra_info["budget"] = 1.0
    benchmark.extra_info["figures"] = [("memory [MB]", peak, 100.0)]
    benchmark.pedantic(taut_line, (task, order, path, 1.0, 2.0), rounds=3)
