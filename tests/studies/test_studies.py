"""The studies on a small world: who plans with what, and that all meet the same winds."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import small_study
from pareto_ltl.extend import Forecast, Pipeline, Study
from pareto_ltl.planning import growth
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import PRESETS, Settings, preset
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.seeds import stage_seeds
from pareto_ltl_apps.studies import compare, convergence, planning, tables
from pareto_ltl_apps.studies.planning import fly_seeded, still, unsmoothed
from pareto_ltl_apps.studies.settings import (
    METHODS,
    MODEL_FACTORS,
    AblationConfig,
    CompareConfig,
    ConvergenceConfig,
    EvaluationConfig,
)
from pareto_ltl_apps.view.study_planners import FACTOR_LABELS

DEFAULT_MODELS = (("mission_bound", "ordered"), ("collision_bound", "path"), ("refine", "none"))


@pytest.fixture(scope="module")
def cfg() -> Settings:
    return small_study.settings()


@pytest.fixture(scope="module")
def world(cfg: Settings) -> Run:
    return small_study.world(cfg)


@pytest.fixture(scope="module")
def compared(cfg: Settings, world: Run, tmp_path_factory: pytest.TempPathFactory) -> Study:
    return compare.run_comparison(cfg, world, tmp_path_factory.mktemp("compare"))


@pytest.fixture(scope="module")
def converged(cfg: Settings, world: Run, tmp_path_factory: pytest.TempPathFactory) -> Study:
    grown = replace(cfg, convergence=ConvergenceConfig(sizes=[400, 20, 100, 200]))
    return convergence.run_convergence(grown, world, tmp_path_factory.mktemp("convergence"))


def row_of(study: Study, method: str) -> dict[str, Any]:
    (row,) = (row for row in study.tables["compare"] if row["method"] == method)
    return dict(row)


# --- plans -----------------------------------------------------------------------------------


def test_a_plan_of_a_study_is_the_plan_of_the_pipeline(cfg: Settings, tmp_path: Path) -> None:
    from pareto_ltl.settings import SceneConfig, WindConfig

    # not the small world: its wind is no file
    mine = unsmoothed(cfg)
    mine.scene = SceneConfig(
        bounds=[[0, 0], [20e3, 20e3]], start=[2e3, 3e3],
        regions={"a": [[13e3, 2e3], [17e3, 2e3], [17e3, 6e3]], "b": [[3e3, 13e3], [7e3, 13e3], [7e3, 17e3]]},
    )  # fmt: skip
    mine.wind = WindConfig(source="calm", hold_last=True)
    mine.pipelines.stages = [
        "readings", "scene", "decomposition", "automaton", "observations", "wind",
        "problem", "forest", "front", "plan",
    ]  # fmt: skip
    mine.seed, mine.refine.seed = 3, None
    Pipeline.of(mine).run(tmp_path)
    path = Run(replace(mine, seed=0)).with_seed(3).plan.path
    np.testing.assert_array_equal(Run.open(tmp_path).plan.path.x, path.x)


def test_cc_rrt_grows_the_forest_without_reselection(cfg: Settings, world: Run) -> None:
    shop = compare.method("cc_rrt", cfg, world)
    options = growth.GrowthOptions(reselect=False)
    seeds = stage_seeds(cfg.seed, "forest")
    plain = growth.grow_forest(cfg.planner, shop.problem, seeds, None, options)
    for one, other in zip(shop.forest.trees, plain.trees, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(one.parent, other.parent)
    proposed = compare.method("paper", cfg, world).forest
    assert sum(tree.reach["reselected"] for tree in proposed.trees) > 0
    assert sum(tree.reach["reselected"] for tree in plain.trees) == 0


def test_ml_rrt_knows_of_no_wind(cfg: Settings, world: Run) -> None:
    shop = compare.method("ml_rrt", cfg, world)
    wind = shop.problem.wind
    assert not wind.mean.any()
    assert not wind.latent.any()
    assert not wind.gust.any()
    assert not shop.problem.modes.psi.any()
    assert compare.method("paper", cfg, world).problem.modes.psi.any()
    plan = shop.plan
    assert plan.path.objectives.mission_risk_paper == 0.0
    np.testing.assert_allclose(np.diff(plan.path.x, axis=0), plan.path.u * cfg.robot.dt, atol=1e-6)


def test_a_still_field_keeps_its_lattice_and_its_clock(cfg: Settings, world: Run) -> None:
    wind = world.with_settings(cfg).wind
    calm = still(wind)
    assert not calm.mean.any()
    assert wind.mean.any()
    np.testing.assert_array_equal(calm.times, wind.times)
    np.testing.assert_array_equal(calm.origin, wind.origin)


def test_every_fidelity_and_baseline_can_be_asked_for() -> None:
    assert set(compare.TITLES) >= set(METHODS)
    assert set(PRESETS) <= set(METHODS)


def test_one_seed_is_one_wind_whatever_flies(cfg: Settings, world: Run) -> None:
    truth = planning.truth(cfg, world)
    u = np.tile([4.0, 3.0], (8, 1))
    first, again, longer, other = (
        fly_seeded(truth, controls, 40, "independent", seed).x
        for controls, seed in ((u, 5), (u, 5), (np.vstack([u, u]), 5), (u, 6))
    )
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, longer[:, : len(u) + 1])
    assert not np.array_equal(first, other)


# --- compare ---------------------------------------------------------------------------------


def test_whoever_knows_the_wind_fails_less_than_who_does_not(compared: Study) -> None:
    assert row_of(compared, "paper")["failure_high"] < row_of(compared, "ml_rrt")["failure_low"]
    assert row_of(compared, "calm_shortest")["length_m"] <= row_of(compared, "ml_rrt")["length_m"]
    assert row_of(compared, "smoothed")["length_m"] <= row_of(compared, "paper")["length_m"]


def test_rates_are_those_of_the_flights(compared: Study, cfg: Settings) -> None:
    for row in compared.tables["compare"]:
        mine = [r for r in compared.tables["compare_seeds"] if r["method"] == row["method"]]
        assert row["flights"] == len(mine) * cfg.deployment.runs
        assert row["failure"] == pytest.approx(np.mean([r["failure"] for r in mine]))
        assert row["failure_low"] <= row["failure"] <= row["failure_high"]
        assert row["collision"] <= row["failure"] + 1e-12
        assert 1 - row["completion"] <= row["failure"] + 1e-12


def test_both_fidelities_fly_under_both_laws_and_keep_the_promise_of_each(
    cfg: Settings, world: Run, tmp_path: Path
) -> None:
    few = EvaluationConfig(seeds=[0], jobs=1, laws=["independent", "coherent"])
    both = CompareConfig(["paper", "full"])
    study = compare.run_comparison(replace(cfg, evaluation=few, compare=both), world, tmp_path)
    rows = {(row["method"], row["law"]): row for row in study.tables["compare"]}
    assert len(rows) == 4
    for row in rows.values():
        assert row["planned"] == 1.0
        assert row["bounds_broken"] == 0
        assert 0.0 <= row["forecast"] <= 1.0
    promised = rows["paper", "independent"]
    assert promised["forecast"] == pytest.approx(promised["bound"], abs=0.01)
    assert rows["paper", "coherent"]["forecast"] > promised["forecast"]


def test_a_difference_is_that_of_the_two_rates(compared: Study, cfg: Settings) -> None:
    for row in compared.tables["differences"]:
        gap = row_of(compared, row["method"])["failure"] - row_of(compared, row["against"])["failure"]
        assert row["difference"] == pytest.approx(gap)
        discordant = row["only_this_failed"] - row["only_the_other_failed"]
        assert discordant == pytest.approx(gap * row["pairs"])


def test_a_method_without_a_plan_is_counted_and_explained(cfg: Settings, world: Run, tmp_path: Path) -> None:
    poor = replace(
        cfg, planner=replace(cfg.planner, trees=1, n_max=3), compare=CompareConfig(["paper", "cc_rrt"])
    )
    study = compare.run_comparison(poor, world, tmp_path)
    row = row_of(study, "paper")
    assert row["planned"] == 0.0
    assert row["flights"] == 0
    assert math.isnan(row["failure"])
    assert len(study.tables["no_plan"]) == 4
    assert all("no path completes the mission" in r["reason"] for r in study.tables["no_plan"])
    assert math.isnan(study.tables["differences"][0]["difference"])
    assert "| proposed (paper) | independent | 0 of 2 | - |" in study.text


def test_panels_show_the_first_seed_of_every_method(compared: Study, cfg: Settings) -> None:
    panels = compared.pictures["panels"]
    assert [panel["method"] for panel in panels] == cfg.compare.methods
    for panel in panels:
        (seed_row,) = (
            r for r in compared.tables["compare_seeds"] if r["method"] == panel["method"] and r["seed"] == 0
        )
        flights = panel["flights"]["independent"]
        assert flights.failed.mean() == pytest.approx(seed_row["failure"])


# --- convergence -----------------------------------------------------------------------------


def test_a_snapshot_is_the_forest_that_had_stopped_there(cfg: Settings, world: Run) -> None:
    problem = world.with_settings(cfg).problem
    big = growth.grow_forest(replace(cfg.planner, n_max=600), problem, stage_seeds(1, "forest"))
    small = growth.grow_forest(replace(cfg.planner, n_max=150), problem, stage_seeds(1, "forest"))
    look = convergence.snapshot(big, 150)
    np.testing.assert_array_equal(look.accepted, small.accepted)
    for one, other in zip(look.trees, small.trees, strict=True):
        for name in ("x", "parent", "step", "q", "cell", "length", "risk"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_the_front_never_gets_worse_as_trees_grow(converged: Study) -> None:
    for seed in (0, 1):
        rows = [row for row in converged.tables["convergence_seeds"] if row["seed"] == seed]
        assert [row["size"] for row in rows] == [20, 100, 200, 400]
        assert np.all(np.diff([row["hypervolume"] for row in rows]) >= -1e-12)
        planned = [row["planned"] for row in rows]
        assert planned == sorted(planned)
    assert converged.tables["convergence"][-1]["planned"] == 1.0


def test_the_bound_of_the_selected_path_never_grows(converged: Study) -> None:
    for seed in (0, 1):
        bounds = [r["mission_risk_paper"] for r in converged.tables["convergence_seeds"] if r["seed"] == seed]
        known = [bound for bound in bounds if math.isfinite(bound)]
        assert known == sorted(known, reverse=True)


def test_a_size_without_a_plan_has_no_volume_and_no_rate(converged: Study) -> None:
    for row in converged.tables["convergence_seeds"]:
        assert (row["hypervolume"] > 0) == bool(row["planned"])
        assert math.isnan(row["failure"]) != bool(row["planned"])


def test_a_bound_counts_as_broken_only_beyond_chance() -> None:
    flights = np.arange(500)
    assert not tables.exceeds(flights < 10, 0.02)  # 2 %, as promised
    assert not tables.exceeds(flights < 15, 0.02)
    assert tables.exceeds(flights < 30, 0.02)  # 6 %: 4.1 % at least


def test_the_first_answer_needs_no_more_than_the_largest_trees(converged: Study) -> None:
    for row in converged.tables["first_answer"]:
        assert 1 < row["first_vertices"] <= 400
        assert row["first_seconds"] > 0


def test_hypervolume_counts_decades_of_risk() -> None:
    assert convergence.decades(1.0) == 1.0
    assert convergence.decades(1e-3) == pytest.approx(2 / 3)
    assert convergence.decades(0.0) == 0.0


# --- ablation --------------------------------------------------------------------------------


def test_levels_that_are_the_default_share_their_parts(cfg: Settings, world: Run, tmp_path: Path) -> None:
    wanted = AblationConfig(factors=["trees", "epsilon"], trees=[3, 1], epsilon=[0.07])
    few = replace(
        cfg,
        planner=replace(cfg.planner, epsilon=0.07),
        ablation=wanted,
        evaluation=EvaluationConfig(seeds=[0], jobs=1, laws=["independent"]),
    )
    study = compare.run_ablation(few, world, tmp_path)
    assert len(list((tmp_path / "parts").iterdir())) == 2  # three trees, one tree
    by_level = {(row["factor"], row["level"]): row for row in study.tables["ablation"]}
    assert by_level["trees", 3]["failure"] == by_level["epsilon", 0.07]["failure"]


def test_one_thing_changes_at_a_time(cfg: Settings) -> None:
    cfg = replace(cfg, planner=replace(cfg.planner, epsilon=0.05))
    for factor, level in (("trees", 7), ("n_max", 9), ("epsilon", 0.2), ("kernel", "rbf"), ("ball", 3.0)):
        other = compare.changed(cfg, factor, level)
        section = other.wind if factor in ("kernel", "ball") else other.planner
        assert getattr(section, factor) == level
        back = compare.changed(
            other, factor, getattr(cfg.wind if section is other.wind else cfg.planner, factor)
        )
        assert back == cfg
    assert compare.changed(cfg, "beta", 1.0) == cfg
    assert compare.changed(cfg, "beta", 0.0).planner.beta_length == 0.0


@pytest.mark.parametrize("factor", MODEL_FACTORS)
def test_one_model_changes_at_a_time(cfg: Settings, factor: str) -> None:
    usual = getattr(cfg.fidelity, factor)
    levels = getattr(AblationConfig(), factor)
    assert usual in levels
    for level in levels:
        other = compare.changed(cfg, factor, level)
        assert getattr(other.fidelity, factor) == level
        assert compare.changed(other, factor, usual) == cfg


def test_models_are_not_changed_unless_asked_for() -> None:
    assert not set(AblationConfig().factors) & set(MODEL_FACTORS)
    assert {*AblationConfig().factors, *MODEL_FACTORS} == set(FACTOR_LABELS)


@pytest.mark.no_cover  # coverage slows the compiler down, and other tests run the same lines
def test_plans_of_every_model_meet_the_same_winds(cfg: Settings, world: Run, tmp_path: Path) -> None:
    """Parts of the default are shared; the flights of a level fly its plan in the run's world."""
    wanted = AblationConfig(factors=["mission_bound", "collision_bound", "refine"])
    one_seed = EvaluationConfig(seeds=[0], jobs=1, laws=["independent", "coherent"])
    models = replace(preset("full"), judge="bound")
    few = replace(cfg, fidelity=models, ablation=wanted, evaluation=one_seed)
    study = compare.run_ablation(few, world, tmp_path)
    assert len(list((tmp_path / "parts").iterdir())) == 5  # default, theorem2, step, convex, sampled
    rows = {(row["factor"], row["level"], row["law"]): row for row in study.tables["ablation"]}
    assert len(rows) == 14
    truth = planning.truth(few, world)
    for factor, level in compare.levels(few):
        plan = world.with_settings(compare.changed(unsmoothed(few), factor, level)).plan
        for law in one_seed.laws:
            flown = fly_seeded(truth, plan.path.u, few.deployment.runs, law, 0, plan.path.x)
            row = rows[factor, level, law]
            assert row["failure"] == pytest.approx(flown.failed.mean())
            assert row["length_m"] == pytest.approx(plan.path.objectives.length)
    for law in one_seed.laws:
        usual = [rows[f, level, law] for f, level in DEFAULT_MODELS]
        assert len({row["failure"] for row in usual}) == 1
        assert rows["refine", "convex", law]["length_m"] < rows["refine", "none", law]["length_m"]


def test_the_mean_path_is_the_planned_one(cfg: Settings, world: Run) -> None:
    shop = world.with_settings(unsmoothed(cfg))
    path = shop.plan.path
    np.testing.assert_allclose(Forecast.of(shop.problem, path.u, "independent").x, path.x, atol=1e-6)


def test_independent_winds_promise_more_the_finer_the_step(cfg: Settings, world: Run, tmp_path: Path) -> None:
    """Σ_T = T v² dt: the bound of one flight falls with dt, though nothing about the wind has changed."""
    study = compare.run_ablation(
        replace(cfg, ablation=AblationConfig(factors=["dt"], dt=[1, 4])), world, tmp_path
    )
    coarse, fine = study.tables["ablation"]
    assert (coarse["shown"], fine["shown"]) == (100.0, 25.0)
    assert fine["length_m"] == pytest.approx(coarse["length_m"], rel=0.01)
    assert fine["bound"] < coarse["bound"]


def test_a_flight_to_the_last_hour_of_the_wind_can_be_cut_into_pieces(cfg: Settings, world: Run) -> None:
    """A step may begin with the last field; its pieces must find a wind too."""
    cfg = replace(cfg, planner=replace(cfg.planner, max_steps=400))
    known = len(planning.truth(cfg, world).wind.slot)
    assert known == 301  # the wind ends before planner.max_steps does
    u = np.zeros((known, 2))
    for pieces in (1, 4):
        finer = planning.truth(compare.cut(cfg, pieces), world)
        controls = np.repeat(u, pieces, axis=0)
        assert np.isfinite(Forecast.of(finer, controls, "independent").x).all()
        assert np.isfinite(fly_seeded(finer, controls, 3, "independent", 0).x).all()


def test_steps_cannot_be_cut_where_the_motion_has_dynamics_of_its_own(
    cfg: Settings, world: Run, tmp_path: Path
) -> None:
    damped = replace(cfg, robot=replace(cfg.robot, a=[[0.9, 0.0], [0.0, 0.9]]))
    with pytest.raises(ConfigError, match="leave dt out"):
        compare.run_ablation(damped, world, tmp_path)


# --- pictures --------------------------------------------------------------------------------


def test_every_study_draws_its_figures(
    cfg: Settings, world: Run, compared: Study, converged: Study, tmp_path: Path
) -> None:
    from pareto_ltl_apps.view.axes import save_figures
    from pareto_ltl_apps.view.study_planners import comparison_figures, convergence_figures

    asked = replace(cfg.report, formats=["png", "svg"])
    made = {
        **comparison_figures(cfg, compared, world.scene, world.cells),
        **convergence_figures(cfg, converged),
    }
    drawn = save_figures(tmp_path, asked, made)
    assert {path.name for path in drawn} == {
        f"{name}.{kind}" for name in ("figure1", "outcomes", "figure2") for kind in ("png", "svg")
    }
    assert all(path.stat().st_size > 2000 for path in drawn)
