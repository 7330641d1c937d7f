"""Smoothing against exact evaluation, known optima and a general-purpose optimiser."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence
from scipy.optimize import minimize
from scipy.special import ndtr

from oracle import path_risk as risk
from pareto_ltl.logic import translate
from pareto_ltl.planning import growth, selection, separation, smoothing
from pareto_ltl.planning.convex import programme, statement
from pareto_ltl.planning.evaluate import completes_mission, evaluate_path, propagate
from pareto_ltl.planning.pack import build_problem
from pareto_ltl.planning.records import objective_row
from pareto_ltl.planning.routes.obligations import path_obligations
from pareto_ltl.planning.routes.taut_lines import CAP, pull_taut, walk_line
from pareto_ltl.planning.wind_lookup import interpolate, wind_and_gradient
from pareto_ltl.settings import PlannerConfig, RobotConfig, SmoothingConfig, WindConfig
from pareto_ltl.wind.records import WindField
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene import Scene
from pareto_ltl_verify.gaussians import spread_along

KM = 1e3
STEP = 54 * KM  # of the default robot: 30 m/s for half an hour


def box(west, south, east, north):
    return KM * np.array([[west, south], [east, south], [east, north], [west, north]], float)


def still_air(size=1000.0):
    return wind_of(lambda x, y, k: (0 * x, 0 * x), 0.0, 0.0, size)


def rough_air(size=1000.0):
    def mean(x, y, k):
        return 4 * np.sin(y / 2e5 + 0.2 * k) + 1, 4 * np.cos(x / 2e5 - 0.2 * k)

    return wind_of(mean, 0.5, 1.0, size)


def wind_of(mean, latent, gust, size):
    spacing = 25 * KM
    nodes = np.arange(-100 * KM, (size + 100) * KM + 1, spacing)
    x, y = np.meshgrid(nodes, nodes, indexing="ij")
    times = 10_800.0 * np.arange(8)
    table = np.array([np.stack(mean(x, y, k), axis=-1) for k in range(len(times))])
    return WindField(
        np.full(2, nodes[0]), spacing, times, table, np.full_like(table, latent),
        np.full((len(times), 2), gust), until=np.inf,
    )  # fmt: skip


def build(formula, start, regions, obstacles=(), wind=None, size=1000.0, planner=None):
    scene = Scene(
        KM * np.array([[0, 0], [size, size]]), KM * np.array(start, float), regions, tuple(obstacles)
    )
    cells = workspace.decompose(scene)
    return build_problem(
        RobotConfig(dt=1800.0), planner or PlannerConfig(), WindConfig(), scene, wind or still_air(size),
        cells, translate(formula, cells.letters),
    )  # fmt: skip


def flown(task, corners, origin="by hand"):
    return evaluate_path(task, walk_line(task, KM * np.array(corners, float)), origin)


def shortest(paths):
    return min(path.objectives.length for path in paths)


@pytest.fixture(scope="module")
def windy():
    """Two regions around three obstacles in rough air, and its tree paths."""
    obstacles = [box(250, 200, 400, 600), box(550, 450, 700, 900), box(450, 0, 520, 250)]
    regions = {"a": box(100, 700, 300, 900), "b": box(780, 500, 960, 700)}
    task = build("F(a & F b)", (80, 80), regions, obstacles, rough_air())
    forest = growth.grow_forest(PlannerConfig(trees=3, n_max=1500, threads=1), task, SeedSequence(3))
    return task, selection.tree_front(task, forest)


# --- known optima ------------------------------------------------------------------------------


def test_without_obstacles_the_way_to_a_region_becomes_a_straight_line():
    region = box(700, 600, 800, 700)
    task = build("F a", (100, 100), {"a": region})
    crooked = flown(task, [(100, 100), (200, 500), (500, 300), (750, 650)])
    best = shortest(smoothing.smooth_paths(SmoothingConfig(), task, [crooked]))
    straight = shapely.Polygon(region).distance(shapely.Point(100 * KM, 100 * KM))
    assert straight <= best <= straight + 10.0


def test_the_way_around_an_obstacle_bends_at_its_corner():
    task = build("F a", (100, 100), {"a": box(700, 80, 800, 120)}, [box(300, 0, 400, 300)])
    crooked = flown(task, [(100, 100), (200, 600), (600, 500), (750, 100)])
    best = shortest(smoothing.smooth_paths(SmoothingConfig(), task, [crooked]))
    exact = KM * (math.hypot(200, 200) + 100 + math.hypot(300, 180))
    assert exact - 1.0 <= best <= 1.0005 * exact


def test_the_other_side_of_an_obstacle_is_found_where_it_is_shorter():
    task = build("F a", (100, 500), {"a": box(700, 480, 800, 520)}, [box(300, 450, 400, 900)])
    crooked = flown(task, [(100, 500), (250, 950), (450, 950), (750, 500)])
    best = shortest(smoothing.smooth_paths(SmoothingConfig(), task, [crooked]))
    exact = KM * (math.hypot(200, 50) + 100 + math.hypot(300, 30))
    assert exact - 1.0 <= best <= 1.0005 * exact


def test_a_convex_optimum_agrees_with_a_general_purpose_optimiser():
    """Length / shortest + λ f_o over four free steps, in air whose uncertainty does not depend on place."""
    task = build(
        "F a",
        (100, 100),
        {"a": box(230, 180, 300, 260)},
        wind=wind_of(lambda x, y, k: (x * 0 + 2, x * 0 - 1), 4.0, 6.0, 1000),
    )
    first = flown(task, [(100, 100), (120, 200), (250, 200)])
    weight, length0 = 3.0, first.objectives.length
    steps, cov = len(first.x) - 1, first.cov[-1]
    normal, offset = workspace.half_planes(task.decomposition.regions["a"][0])
    sd = spread_along(normal, cov)
    wind = np.array([2.0, -1.0])

    def cost(z):
        x = np.vstack([first.x[:1], z.reshape(-1, 2) * STEP])
        length = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
        return length / length0 + weight * ndtr(-(offset - normal @ x[-1]) / sd).sum()

    def spare(z):
        x = np.vstack([first.x[:1], z.reshape(-1, 2) * STEP])
        return 1.0 - np.linalg.norm(np.diff(x, axis=0) / 1800.0 - wind, axis=1) / 30.0

    middle = np.linspace(first.x[0], first.x[-1], steps + 1)[1:] / STEP
    independent = minimize(
        cost, middle.ravel() + 1e-3, constraints={"type": "ineq", "fun": spare}, method="SLSQP", tol=1e-10,
        options={"maxiter": 500},
    )  # fmt: skip
    model = programme.programme(task, steps, 1, 4)
    shared = smoothing.SmoothingTask(SmoothingConfig(rounds=6), model, task, length0)
    ours = smoothing.iterate(shared, first.x, weight)
    value = ours.objectives.length / length0 + weight * ours.objectives.mission_risk_paper
    assert independent.success
    assert value == pytest.approx(independent.fun, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "formula", "optimum"),
    [("phi1", "F(a & F b & F c)", 16.916), ("phi2", "F(a & F(b & F c)) | F(a & F(d & F c))", 14.04)],
)
def test_calm_missions_end_within_a_thousandth_of_the_exact_optimum(name, formula, optimum):
    """The optimum comes from an exact visibility graph, in units of 100 km."""
    import yaml

    from pareto_ltl.settings import SceneConfig
    from pareto_ltl.support.resources import resource_folder
    from pareto_ltl.world.scene_settings import scene_from_settings as read_scene

    settings_ = yaml.safe_load((resource_folder("conf") / "scene" / f"{name}.yaml").read_text())
    scene = read_scene(SceneConfig(**settings_))
    cells = workspace.decompose(scene)
    shifted = wind_of(lambda x, y, k: (0 * x, 0 * x), 0.0, 0.0, 1000.0)
    task = build_problem(
        RobotConfig(dt=1800.0),
        PlannerConfig(),
        WindConfig(),
        scene,
        shifted,
        cells,
        translate(formula, cells.letters),
    )
    forest = growth.grow_forest(PlannerConfig(trees=2, threads=1), task, SeedSequence(0))
    best = shortest(smoothing.smooth_paths(SmoothingConfig(), task, selection.tree_front(task, forest)))
    assert 0.999 * optimum * 1e5 <= best <= 1.001 * optimum * 1e5


# --- promises ----------------------------------------------------------------------------------


def test_every_smoothed_path_flies_and_completes_the_mission(windy):
    task, paths = windy
    smoothed = smoothing.smooth_paths(SmoothingConfig(), task, paths)
    assert smoothed
    for path in smoothed:
        again = evaluate_path(task, path.x, path.origin)
        assert completes_mission(task, again)
        assert again.objectives == path.objectives
        assert np.linalg.norm(path.u, axis=1).max() <= task.motion.u_max * (1 + 1e-6)
        assert "smoothed at risk weight" in path.origin
        assert path.origin.startswith("tree ")


def test_no_smoothed_path_is_dominated_by_a_tree_path(windy):
    task, paths = windy
    old = np.array([objective_row(p.objectives) for p in paths])
    for path in smoothing.smooth_paths(SmoothingConfig(), task, paths):
        row = objective_row(path.objectives)
        assert not ((old <= row).all(axis=1)).any()


@pytest.mark.parametrize("weight", [1.0, 10.0, 100.0])
def test_smoothing_lowers_the_weighted_cost_of_the_best_tree_path(windy, weight):
    task, paths = windy
    length = shortest(paths)
    shared = smoothing.SmoothingTask(SmoothingConfig(), None, task, length)
    old, new = (
        min(shared.merit(path, weight) for path in group)
        for group in (paths, smoothing.smooth_paths(SmoothingConfig(), task, paths))
    )
    assert new < 0.95 * old


def test_a_larger_weight_buys_a_smaller_risk(windy):
    task, paths = windy
    begun = smoothing.taut_starts(SmoothingConfig(), task, paths)
    model = smoothing.fitting_programme(task, begun)
    shared = smoothing.SmoothingTask(SmoothingConfig(), model, task, paths[0].objectives.length)
    risks = []
    for weight in (1.0, 10.0, 100.0):
        path = smoothing.iterate(shared, begun[0].x, weight)
        risks.append(path.objectives.mission_risk_paper + path.objectives.collision_risk)
    assert risks[0] > risks[1] > risks[2] * 0.999


def test_the_same_input_gives_the_same_paths(windy):
    task, paths = windy
    one, two = (smoothing.smooth_paths(SmoothingConfig(), task, paths) for _ in range(2))
    assert [p.origin for p in one] == [p.origin for p in two]
    for p, q in zip(one, two, strict=True):
        np.testing.assert_array_equal(p.x, q.x)


def test_without_paths_there_is_nothing_to_smooth(windy):
    task, _ = windy
    assert smoothing.smooth_paths(SmoothingConfig(), task, []) == ()


def test_progress_counts_to_the_end(windy):
    task, paths = windy
    calls = []
    smoothing.smooth_paths(SmoothingConfig(rounds=1, weights=[1.0]), task, paths, lambda *c: calls.append(c))
    assert calls == [(k + 1, calls[-1][1]) for k in range(calls[-1][1])]


def test_where_the_solver_fails_nothing_is_returned(windy, monkeypatch):
    task, paths = windy
    monkeypatch.setattr(programme.Programme, "bend", lambda self, *_: None)
    assert smoothing.smooth_paths(SmoothingConfig(), task, paths) == ()


@pytest.mark.parametrize("status", ["infeasible", "optimal_inaccurate", "user_limit", "solver_error"])
def test_only_solved_statuses_are_believed(windy, monkeypatch, status):
    import cvxpy

    task, paths = windy
    monkeypatch.setattr(cvxpy.Problem, "status", property(lambda self: status))
    assert smoothing.smooth_paths(SmoothingConfig(rounds=1), task, paths) == ()


def test_an_iterate_that_does_not_fly_is_drawn_back_to_the_one_that_did(windy):
    task, paths = windy
    old = paths[0].x
    wild = old.copy()
    wild[len(old) // 2] += 0.9 * STEP
    assert smoothing.flown_path(task, wild) is None
    path = smoothing.damped_path(task, old, wild)
    assert path is None or completes_mission(task, path)
    tame = old.copy()
    tame[1:-1] += 1e-3
    assert smoothing.damped_path(task, old, tame) is not None


# --- what a step owes the mission --------------------------------------------------------------


def test_steps_that_must_be_seen_are_witnesses_and_their_safest_step_is_chosen():
    task = build(
        "F(a & F b)", (100, 100), {"a": box(300, 50, 500, 150), "b": box(700, 50, 900, 150)}, wind=rough_air()
    )
    path = flown(task, [(100, 100), (800, 100)])
    cov = propagate(task, path.x).cov
    owed = path_obligations(task, path.x, cov)
    seen = [
        {task.atoms[task.theorem2.atom[part]] for t, part in owed.witness if t == step}
        for step, _ in owed.witness
    ]
    assert seen == [{"a"}, {"b"}]
    step, _ = owed.witness[0]
    assert path.label[step] == {"a"}
    assert abs(path.x[step, 0] - 400 * KM) < STEP / 2 + 5 * KM  # not at the rim where it came in


def test_a_region_that_must_not_be_seen_yet_is_avoided():
    regions = {"a": box(700, 80, 800, 120), "b": box(300, 50, 420, 400)}
    task = build("!b U a", (100, 100), regions)
    around = flown(task, [(100, 100), (300, 450), (450, 450), (750, 100)])
    owed = path_obligations(task, around.x, propagate(task, around.x).cov)
    b = [label == {"b"} for label in task.labels]
    assert owed.avoid[1:-1][:, b].all()
    smoothed = smoothing.smooth_paths(SmoothingConfig(), task, [around])
    assert shortest(smoothed) < around.objectives.length
    for path in smoothed:
        assert not any("b" in label for label in path.label)


def test_pulling_keeps_witnesses_and_never_lengthens(windy):
    task, paths = windy
    for path in paths[:5]:
        cov = propagate(task, path.x).cov
        keep = [t for t, _ in path_obligations(task, path.x, cov).witness]
        line = pull_taut(task, path.x, cov, keep, task.world.collision.z)
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() <= path.objectives.length + 1e-6
        for t in keep:
            assert (np.abs(line - path.x[t]).sum(axis=1) == 0).any()


def test_walking_takes_the_fewest_steps_and_keeps_corners():
    task = build("F a", (100, 100), {"a": box(700, 600, 800, 700)})
    corners = KM * np.array([(100, 100), (333, 100), (333, 480), (750, 650)], float)
    x = walk_line(task, corners)
    legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    assert len(x) - 1 == np.ceil(legs / (STEP * CAP)).sum()
    assert np.linalg.norm(np.diff(x, axis=0), axis=1).max() <= STEP
    for corner in corners:
        assert (np.linalg.norm(x - corner, axis=1) < 1e-6).any()


def test_walking_against_a_wind_too_strong_ends():
    gale = wind_of(lambda x, y, k: (np.where(x > 3e5, -35.0, 0.0), 0 * x), 0.0, 0.0, 1000.0)
    task = build("F a", (100, 100), {"a": box(700, 80, 800, 120)}, wind=gale)
    assert walk_line(task, KM * np.array([(100, 100), (750, 100)], float)) is None


# --- numbers -----------------------------------------------------------------------------------


def test_the_wind_gradient_agrees_with_differences(windy):
    task, paths = windy
    x = paths[0].x[:-1]
    mean, gradient = wind_and_gradient(task.wind, x)
    h = 1.0
    for t in range(len(x)):
        np.testing.assert_allclose(mean[t], interpolate(task.wind, task.wind.mean, t, x[t]), atol=1e-10)
        for axis in range(2):
            e = h * np.eye(2)[axis]
            ahead = interpolate(task.wind, task.wind.mean, t, x[t] + e)
            behind = interpolate(task.wind, task.wind.mean, t, x[t] - e)
            np.testing.assert_allclose(gradient[t][:, axis], (ahead - behind) / (2 * h), atol=1e-8)


def test_propagation_on_an_empty_map_is_that_of_the_reference(windy):
    task, paths = windy
    x = paths[0].x + 10 * STEP * np.linspace(0, 1, len(paths[0].x))[:, None] ** 3  # through walls, too fast
    cov, _ = risk.propagate_independent(task, x)
    np.testing.assert_allclose(propagate(task, x).cov, cov[:, [0, 0, 1], [0, 1, 1]], rtol=1e-9)


def test_tangents_lie_below_the_tail_of_the_normal_law():
    s = np.linspace(0, 6, 601)
    model = np.max(statement.tail_tangents(statement.PIECES, s), axis=0)
    assert (model <= ndtr(-s) + 1e-15).all()
    assert (ndtr(-s) - np.maximum(model, 0.0)).max() < 0.1


def test_separating_faces_serve_both_ends_of_a_step():
    task = build("F a", (100, 100), {"a": box(700, 600, 800, 700)}, [box(300, 300, 500, 500)])
    faces = task.obstacles
    x = KM * np.array([(200, 200), (310, 250), (520, 290), (600, 450)], float)
    clearance = x @ faces.normal.T - faces.offset
    chosen = separation.separating(faces, clearance)
    south, east = (int(np.flatnonzero((faces.normal == n).all(axis=1))[0]) for n in ([0.0, -1.0], [1.0, 0.0]))
    assert chosen[:, 0].tolist() == [south, south, east]


coordinate = st.integers(0, 4)


@settings(deadline=None, max_examples=8)
@given(st.sets(st.tuples(coordinate, coordinate), min_size=0, max_size=4), st.integers(0, 2**16))
def test_random_maps_keep_every_promise(places, seed):
    obstacles = [box(150 + 150 * i, 150 + 150 * j, 210 + 150 * i, 210 + 150 * j) for i, j in sorted(places)]
    task = build(
        "F(a & F b)",
        (50, 50),
        {"a": box(860, 860, 990, 990), "b": box(860, 20, 990, 130)},
        obstacles,
        rough_air(),
    )
    forest = growth.grow_forest(PlannerConfig(trees=1, n_max=1000, threads=1), task, SeedSequence(seed))
    paths = selection.tree_front(task, forest)
    cfg = SmoothingConfig(candidates=1, weights=[10.0])
    for path in smoothing.smooth_paths(cfg, task, paths):
        assert completes_mission(task, evaluate_path(task, path.x, path.origin))
        row = objective_row(path.objectives)
        assert not any((objective_row(p.objectives) <= row).all() for p in paths)
