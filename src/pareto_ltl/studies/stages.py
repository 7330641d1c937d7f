"""The stages of the studies: compare, convergence, ablation, hindcast, forecast_test, departure, sitl.

``STUDY_STAGES`` at the end is the table. Packages are imported inside the functions.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.run.records import (
    AUTOMATON,
    DECOMPOSITION,
    EXPORTS,
    OBSERVATIONS,
    PLAN,
    PROBLEM,
    READINGS,
    SCENE,
    RecordKey,
)
from pareto_ltl.run.stage_table import Stage, StageInputs
from pareto_ltl.run.stages import FIGURE_FILES
from pareto_ltl.settings import ReportConfig, RobotConfig, Settings, SitlConfig, WindConfig

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

COMPARISON: RecordKey[Study] = RecordKey("comparison")
CONVERGENCE: RecordKey[Study] = RecordKey("convergence")
ABLATION: RecordKey[Study] = RecordKey("ablation")
HINDCAST: RecordKey[Study] = RecordKey("hindcast")
FORECAST_TEST: RecordKey[Study] = RecordKey("forecast_test")
DEPARTURE: RecordKey[Study] = RecordKey("departure")
SITL: RecordKey[Study] = RecordKey("sitl")
COMPARISON_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("comparison_figures")
CONVERGENCE_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("convergence_figures")
ABLATION_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("ablation_figures")
HINDCAST_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("hindcast_figures")
FORECAST_TEST_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("forecast_test_figures")
REPLANNING: RecordKey[Study] = RecordKey("replanning")
DEPARTURE_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("departure_figures")
SITL_FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("sitl_figures")
WORLD = (OBSERVATIONS, DECOMPOSITION, AUTOMATON, SCENE)  # records from which a study plans


def make_comparison(inputs: StageInputs) -> Study:
    """One mission, several planners, the same winds."""
    from pareto_ltl.studies import compare

    return compare.run_comparison(inputs.settings, inputs.records, inputs.directory, inputs.progress)


def make_convergence(inputs: StageInputs) -> Study:
    """Bound and failure of the selected path as the trees grow."""
    from pareto_ltl.studies import convergence

    return convergence.run_convergence(inputs.settings, inputs.records, inputs.directory, inputs.progress)


def make_ablation(inputs: StageInputs) -> Study:
    """One setting changed at a time."""
    from pareto_ltl.studies import ablation

    return ablation.run_ablation(inputs.settings, inputs.records, inputs.directory, inputs.progress)


def make_hindcast(inputs: StageInputs) -> Study:
    """Plans made from thinned readings, flown through the full fields."""
    from pareto_ltl.studies import hindcast

    return hindcast.run_hindcast(inputs.settings, inputs.directory, inputs.progress)


def make_forecast_test(inputs: StageInputs) -> Study:
    """Plans made from forecasts available at departure, flown through the later fields."""
    from pareto_ltl.studies import forecast_test

    return forecast_test.run_forecast_test(inputs.settings, inputs.directory, inputs.progress)


def make_departure(inputs: StageInputs) -> Study:
    """The mission planned for many starts."""
    from pareto_ltl.studies import departure

    return departure.run_departure(inputs.settings, inputs.records, inputs.directory, inputs.progress)


def make_replanning(inputs: StageInputs) -> Study:
    """The plan in true winds, with and without a new plan at each fix."""
    from pareto_ltl.studies import replanning

    return replanning.run_replanning(inputs.settings, inputs.records, inputs.directory, inputs.progress)


def make_sitl(inputs: StageInputs) -> Study:
    """The exported table, flown by the aircraft of JSBSim in the winds of our flights."""
    from pareto_ltl.exports.exported import flown_level
    from pareto_ltl.studies import sitl

    settings, problem, plan, files = inputs.settings, inputs[PROBLEM], inputs[PLAN], inputs[EXPORTS]
    level, seeds = flown_level(settings), inputs.seeds
    return sitl.run_sitl(settings.sitl, level, problem, plan, files, seeds, inputs.progress)


def make_sitl_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """Tracks of both on the map, and their distance."""
    settings, scene, decomposition = inputs.settings, inputs[SCENE], inputs[DECOMPOSITION]
    if not settings.report.figures:
        return ()
    from pareto_ltl.report.study_sitl import draw_sitl

    folder, study, drawn = inputs.directory / "figures", inputs[SITL], settings.sitl.drawn
    return draw_sitl(folder, settings.report, (scene, decomposition), study, drawn)


def make_comparison_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """Figure 1 and the outcomes of every method."""
    cfg, scene, decomposition = inputs.settings.report, inputs[SCENE], inputs[DECOMPOSITION]
    if not cfg.figures:
        return ()
    from pareto_ltl.report.study_comparison import draw_comparison

    return draw_comparison(inputs.directory / "figures", cfg, scene, decomposition, inputs[COMPARISON])


def make_convergence_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """Figure 2."""
    cfg = inputs.settings.report
    if not cfg.figures:
        return ()
    from pareto_ltl.report.study_convergence import draw_convergence

    return draw_convergence(inputs.directory / "figures", cfg, inputs[CONVERGENCE])


def make_ablation_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """One figure of all factors, and one of the time step."""
    cfg = inputs.settings.report
    if not cfg.figures:
        return ()
    from pareto_ltl.report.study_ablation import draw_ablation

    return draw_ablation(inputs.directory / "figures", cfg, inputs[ABLATION])


def make_hindcast_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """Reliability diagrams."""
    cfg = inputs.settings.report
    if not cfg.figures:
        return ()
    from pareto_ltl.report.study_hindcast import draw_hindcast

    return draw_hindcast(inputs.directory / "figures", cfg, inputs[HINDCAST])


def make_forecast_test_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """Reliability, by region, and sharpness."""
    cfg = inputs.settings.report
    if not cfg.figures:
        return ()
    from pareto_ltl.report.study_forecast_test import draw_forecast_test

    return draw_forecast_test(inputs.directory / "figures", cfg, inputs[FORECAST_TEST])


def make_departure_figures(inputs: StageInputs) -> tuple[Path, ...]:
    """Failure, length and wind against the departure, and the routes."""
    cfg = inputs.settings.report
    if not cfg.figures:
        return ()
    from pareto_ltl.report.study_departure import draw_departure

    folder, scene = inputs.directory / "figures", inputs[SCENE]
    return draw_departure(folder, cfg, scene, inputs[DECOMPOSITION], inputs[DEPARTURE])


TABLES_TEXT = ("tables.md",)
STUDY_STAGES = (
    Stage(
        "comparison",
        makes=COMPARISON,
        make=make_comparison,
        needs=WORLD,
        settings=(Settings,),
        writes=("compare.csv", "compare_seeds.csv", "differences.csv", "no_plan.csv"),
        shows=TABLES_TEXT,
    ),
    Stage(
        "comparison_figures",
        makes=COMPARISON_FIGURES,
        make=make_comparison_figures,
        needs=(SCENE, DECOMPOSITION, COMPARISON),
        settings=(ReportConfig,),
        shows=FIGURE_FILES,
    ),
    Stage(
        "convergence",
        makes=CONVERGENCE,
        make=make_convergence,
        needs=WORLD,
        settings=(Settings,),
        writes=("convergence.csv", "convergence_seeds.csv", "first_answer.csv"),
        shows=TABLES_TEXT,
    ),
    Stage(
        "convergence_figures",
        makes=CONVERGENCE_FIGURES,
        make=make_convergence_figures,
        needs=(CONVERGENCE,),
        settings=(ReportConfig,),
        shows=FIGURE_FILES,
    ),
    Stage(
        "ablation",
        makes=ABLATION,
        make=make_ablation,
        needs=WORLD,
        settings=(Settings,),
        writes=("ablation.csv",),
        shows=TABLES_TEXT,
    ),
    Stage(
        "ablation_figures",
        makes=ABLATION_FIGURES,
        make=make_ablation_figures,
        needs=(ABLATION,),
        settings=(ReportConfig,),
        shows=FIGURE_FILES,
    ),
    Stage(
        "hindcast",
        makes=HINDCAST,
        make=make_hindcast,
        settings=(Settings,),
        writes=("hindcast.csv", "reliability.csv", "scorecard.csv", "no_plan.csv"),
        shows=TABLES_TEXT,
    ),
    Stage(
        "hindcast_figures",
        makes=HINDCAST_FIGURES,
        make=make_hindcast_figures,
        needs=(HINDCAST,),
        settings=(ReportConfig,),
        shows=FIGURE_FILES,
    ),
    Stage(
        "forecast_test",
        makes=FORECAST_TEST,
        make=make_forecast_test,
        settings=(Settings,),
        writes=("forecast_test.csv", "reliability.csv", "regions.csv", "scorecard.csv", "no_plan.csv"),
        shows=TABLES_TEXT,
    ),
    Stage(
        "forecast_test_figures",
        makes=FORECAST_TEST_FIGURES,
        make=make_forecast_test_figures,
        needs=(FORECAST_TEST,),
        settings=(ReportConfig,),
        shows=FIGURE_FILES,
    ),
    Stage(
        "departure",
        makes=DEPARTURE,
        make=make_departure,
        needs=(READINGS, SCENE, DECOMPOSITION, AUTOMATON),
        settings=(Settings,),
        writes=("departures.csv", "departure_lengths.csv", "departures.json"),
        shows=TABLES_TEXT,
    ),
    Stage(
        "departure_figures",
        makes=DEPARTURE_FIGURES,
        make=make_departure_figures,
        needs=(SCENE, DECOMPOSITION, DEPARTURE),
        settings=(ReportConfig,),
        shows=FIGURE_FILES,
    ),
    Stage(
        "replanning",
        makes=REPLANNING,
        make=make_replanning,
        needs=WORLD,
        settings=(Settings,),
        writes=("replanning.csv", "replanning_flights.csv"),
        shows=TABLES_TEXT,
    ),
    Stage(
        "sitl",
        makes=SITL,
        make=make_sitl,
        needs=(PROBLEM, PLAN, EXPORTS),
        settings=(RobotConfig, SitlConfig, WindConfig),
        stream="sitl",
        writes=("sitl.csv",),
        shows=TABLES_TEXT,
    ),
    Stage(
        "sitl_figures",
        makes=SITL_FIGURES,
        make=make_sitl_figures,
        needs=(SCENE, DECOMPOSITION, SITL),
        settings=(ReportConfig, SitlConfig),
        shows=FIGURE_FILES,
    ),
)
