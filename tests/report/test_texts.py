"""What figures say: laws beside probabilities, nothing over the edge, laws told apart without colour."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from shapely import Polygon

import small_study
from drawn_world import (
    decomposition_of,
    flights_of,
    forest_of,
    front_of,
    path_of,
    plan_of,
    scene_of,
    wind_of,
)
from figure_texts import labels_without_unit, texts_of, texts_outside, wrong_texts
from pareto_ltl.extend import FailureRate
from pareto_ltl.planning.evaluate import Forecast
from pareto_ltl.planning.rates import Promise
from pareto_ltl.settings import preset
from pareto_ltl_apps.studies import compare, convergence, sweep_summary
from pareto_ltl_apps.studies.settings import (
    AblationConfig,
    CompareConfig,
    ConvergenceConfig,
    EvaluationConfig,
)
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import rate_tick_text, rate_ticks
from pareto_ltl_apps.view.figures import draw_record
from pareto_ltl_apps.view.front import front_figure
from pareto_ltl_apps.view.map import plan_figure, shown_probability
from pareto_ltl_apps.view.map_layers import (
    area_on_map,
    covering_points,
    dense_path,
    label_position,
    places_inside,
)
from pareto_ltl_apps.view.metric_names import LAW_NAMES, METRIC_LABELS, is_probability, metric_label
from pareto_ltl_apps.view.records import DrawnRun
from pareto_ltl_apps.view.settings import ReportConfig
from pareto_ltl_apps.view.study_forecast_test import reliability_figure
from pareto_ltl_apps.view.study_planners import (
    ablation_figure,
    comparison_figure,
    convergence_figure,
    outcomes_figure,
)
from pareto_ltl_apps.view.sweep_figures import axis_label
from pareto_ltl_apps.view.wind import wind_figure

LAWS = ("independent", "coherent")
BOUNDS = np.array([[0.0, 0.0], [10.0, 10.0]])
LONG = " & ".join(f"F(a & F(long_name_of_a_region_{k} & F c))" for k in range(9))


def run_of(formula: str = "F(a & F b & F c)", fidelity: str = "paper", **changes: Any) -> DrawnRun:
    scene = scene_of()
    front = replace(front_of(scene), models=preset(fidelity))
    plan = replace(plan_of(front.paths[0], formula), fidelity=fidelity)
    path = plan.path
    run = DrawnRun(
        scene, decomposition_of(scene), wind_of(), forest_of(scene), front, plan,
        {law: flights_of(path, law=law) for law in LAWS},
        {law: Forecast(law, path.x, path.cov, 0.9, 0.3) for law in LAWS},
    )  # fmt: skip
    return replace(run, **changes)


def flown_run(**changes: Any) -> DrawnRun:
    """A run whose front flights have judged."""
    run = run_of(fidelity="full", **changes)
    assert run.front is not None
    assert run.plan is not None
    size = len(run.front.paths)
    rates = tuple(FailureRate.counted("coherent", 40 * (k + 1), 4000) for k in range(size))
    front = replace(
        run.front, rates=rates, failed=np.zeros((size, 4000), bool), reference=np.array([1.0, 5e6]),
        raw_rates=tuple(FailureRate.counted("coherent", 60, 500) for _ in run.front.raw),
    )  # fmt: skip
    promise = Promise(FailureRate.counted("coherent", 1324, 20_000), rates[0], 0.186, 0.1, True)
    return replace(run, front=front, plan=replace(run.plan, promise=promise))


def without_plan() -> DrawnRun:
    scene = scene_of()
    nothing = forest_of(scene, accepted=False)
    return run_of(forest=nothing, front=None, plan=None, deployments={}, forecasts={})


RUNS = {
    "paper": run_of,
    "full": lambda: run_of(fidelity="full"),
    "flown": flown_run,
    "a long formula": lambda: run_of(LONG),
    "a formula without a space": lambda: run_of("F(" + "a" * 200 + ")"),
    "no plan": without_plan,
    "a plane nowhere on Earth": lambda: run_of(scene=scene_of(crs=None)),
    "no simulation": lambda: run_of(deployments={}, forecasts={}),
    "calm": lambda: run_of(wind=replace(wind_of(), mean=0.0 * wind_of().mean)),
}


@pytest.mark.parametrize("name", RUNS)
def test_every_text_of_a_run_names_its_law_and_stays_on_the_page(name: str) -> None:
    run = RUNS[name]()
    notebook = [] if run.front is None else [draw_record(run.front).figure]
    with style.report_style():
        figures = [plan_figure(ReportConfig(), run), wind_figure(run.scene, run.wind, run.plan)]
        if run.front is not None:
            figures.append(front_figure(run, run.front))
        for figure in [*figures, *notebook]:
            assert wrong_texts(texts_of(figure)) == []
            assert texts_outside(figure) == []
            assert labels_without_unit(figure) == []


def test_a_text_with_a_probability_and_no_law_is_found() -> None:
    wrong = ["mission risk at most 0.62 %", "failed: 55 of 500", "0.0000", "independent winds: 130 %"]
    assert wrong_texts([*wrong, "no plan", "coherent winds: 55 of 500 failed", "100 %"]) == wrong


def test_the_map_begins_with_what_fails_and_states_no_bound() -> None:
    with style.report_style():
        said = texts_of(plan_figure(ReportConfig(), flown_run()))
    for law in LAWS:
        assert f"{law} winds: 3 of 60 flights failed (5.0 %), 40 drawn" in said
    assert not [text for text in said if "V +" in text or "R ≤" in text]
    assert "95 % of positions, coherent winds" in said
    assert "6.6 of 100 flights fail (6.3 to 7.0), in winds of this forecast" in said


def test_a_law_and_its_failures_are_told_apart_without_colour() -> None:
    """Relative luminance (WCAG 2) at least 1.4 times apart, and dashes of their own."""

    def luminance(colour: str) -> float:
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
        return float(np.dot([0.2126, 0.7152, 0.0722], linear)) + 0.05

    shades = [style.law_colour("independent"), style.law_colour("coherent"), style.FAILED]
    for one, other in combinations(map(luminance, shades), 2):
        assert max(one, other) / min(one, other) > 1.4
    assert style.law_dashes("independent") != style.law_dashes("coherent")
    assert style.law_mark("independent") != style.law_mark("coherent")


def test_an_axis_without_a_unit_is_found() -> None:
    with style.report_style():
        figure = style.blank_figure(3.0, 3.0)
        style.axes_at(figure, 0.5, 0.5, 2.0, 2.0).set(xlabel="length", ylabel="east [km]")
    assert labels_without_unit(figure) == ["length"]


def test_failed_flights_end_in_a_cross() -> None:
    with style.report_style():
        figure = plan_figure(ReportConfig(paths=60), run_of())
    crosses = [line for line in figure.axes[0].lines if line.get_marker() == "x"]
    assert [len(line.get_xdata()) for line in crosses] == [3, 3]  # type: ignore[arg-type]


def test_the_end_of_the_path_is_not_under_the_name_of_its_region() -> None:
    run = run_of()
    assert run.plan is not None
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    half = np.array([1.5, 1.5])
    path = dense_path(np.array([[-5.0, 5.0], [5.0, 5.0]]))
    place = label_position(Polygon(square), half, BOUNDS, path)
    assert (np.abs(path - place) >= half).any(axis=1).all()
    assert (half <= place).all()
    assert (place <= 10.0 - half).all()
    np.testing.assert_allclose(label_position(Polygon(square), half, BOUNDS), [5.0, 5.0])


def test_the_name_of_a_region_too_small_for_it_stands_beside_it_on_the_map() -> None:
    corner = np.array([[9.6, 9.6], [10.0, 9.6], [10.0, 10.0], [9.6, 10.0]])
    half = np.array([2.0, 0.5])
    place = label_position(Polygon(corner), half, BOUNDS, corner)
    assert (place - half >= 0.0).all()
    assert (place + half <= 10.0).all()
    assert (np.abs(corner - place) >= half - 1e-9).any(axis=1).all()


def test_the_name_of_a_small_region_avoids_other_places_and_stays_beside_it() -> None:
    part = np.array([[4.5, 4.5], [5.5, 4.5], [5.5, 5.5], [4.5, 5.5]])
    half = np.array([1.5, 0.4])
    above = covering_points(np.array([[2.0, 5.6], [8.0, 5.6], [8.0, 9.0], [2.0, 9.0]]), half)
    left = covering_points(np.array([[0.0, 3.0], [4.4, 3.0], [4.4, 5.5], [0.0, 5.5]]), half)
    for blocked in (above, left, np.vstack([above, left])):
        place = label_position(Polygon(part), half, BOUNDS, None, blocked)
        assert (np.abs(blocked - place) >= half).any(axis=1).all()
        gap = np.abs(place - 5.0) - half - 0.5
        assert gap.max() <= 0.5 * half.min()  # not farther away than a quarter of its height
        assert gap.max() >= -1e-9


def test_the_name_of_an_obstacle_lies_in_what_the_map_shows_of_it() -> None:
    cut = np.array([[-30.0, 2.0], [6.0, 2.0], [6.0, 5.0], [-30.0, 5.0]])  # its centre is off the map
    half = np.array([2.0, 0.5])
    place = label_position(area_on_map([cut], BOUNDS), half, BOUNDS)
    np.testing.assert_allclose(place, [3.0, 3.5], atol=0.2)
    bent = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 8.0], [9.0, 8.0], [9.0, 9.0], [1.0, 9.0]])
    area = area_on_map([bent], BOUNDS)
    inside = label_position(area, np.array([0.4, 0.4]), BOUNDS)  # its centre is outside of it
    assert inside[0] <= 1.6 or inside[1] >= 8.4
    assert len(places_inside(area, half + 0.2)) == 0
    assert len(places_inside(area_on_map([bent + 20.0], BOUNDS), half)) == 0


def test_the_name_of_a_region_lies_beside_the_obstacles_in_it() -> None:
    square, rock = (
        np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]]),
        np.array([[4, 4], [6, 4], [6, 6], [4, 6.0]]),
    )
    half = np.array([1.5, 0.5])
    place = label_position(area_on_map([square], BOUNDS, [rock]), half, BOUNDS)
    assert (np.abs(place - 5.0) >= half + 1.0).any()


def test_a_probability_is_set_with_raised_powers() -> None:
    assert shown_probability(3.2e-7) == "3.2·10⁻⁵\N{NO-BREAK SPACE}%"
    assert shown_probability(0.162) == "16.2\N{NO-BREAK SPACE}%"


def test_ticks_of_a_rate_are_round_and_few() -> None:
    assert [rate_tick_text(p) for p in rate_ticks(1e-3, 1.0)] == ["0.1", "1", "10", "100"]
    assert [rate_tick_text(p, 0.1) for p in rate_ticks(0.1, 1.0)] == ["≤ 10", "20", "50", "100"]
    assert [rate_tick_text(p, 1e-9) for p in rate_ticks(1e-9, 1.0)] == [
        "≤ 10⁻⁷",
        "10⁻⁶",
        "10⁻⁴",
        "0.01",
        "1",
        "100",
    ]


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The records of the three studies of one mission, and the map they were made on."""
    cfg = small_study.settings(
        evaluation=EvaluationConfig(seeds=[0, 1], laws=list(LAWS), jobs=1),
        compare=CompareConfig(methods=["paper", "ml_rrt"]),
        convergence=ConvergenceConfig(sizes=[100, 400]),
        ablation=AblationConfig(factors=["epsilon"], epsilon=[0.05, 0.2]),
    )
    world, folder = small_study.world(cfg), tmp_path_factory.mktemp("studies")
    made = {
        "compare": compare.run_comparison(cfg, world, folder / "compare"),
        "convergence": convergence.run_convergence(cfg, world, folder / "convergence"),
        "ablation": compare.run_ablation(cfg, world, folder / "ablation"),
    }
    return cfg, world, made


def test_every_text_of_a_study_names_its_law(studies: Any) -> None:
    cfg, world, made = studies
    tables, pictures = made["compare"].tables, made["compare"].pictures
    with style.report_style():
        for figure in (
            comparison_figure(cfg.report, world.scene, world.cells, pictures["wind"], pictures["panels"]),
            outcomes_figure(tables["compare"], tables["compare_seeds"]),
            convergence_figure(made["convergence"].tables["convergence"], made["convergence"].numbers),
            ablation_figure(made["ablation"].tables["ablation"], ["epsilon"]),
        ):
            said = texts_of(figure)
            assert wrong_texts(said) == []
            assert texts_outside(figure) == []
            assert labels_without_unit(figure) == []
            assert all(any(law in text for text in said) for law in LAWS)


def test_every_row_of_a_table_names_its_law(studies: Any) -> None:
    for study in studies[2].values():
        rows = [line for line in study.text.splitlines() if line.startswith("|") and "%" in line]
        assert len(rows) >= 2
        assert wrong_texts(f"failed {line}" for line in rows) == []


def test_the_reliability_of_a_hindcast_names_the_law_of_each_panel() -> None:
    group = {"promised": 0.02, "realised": 0.03, "realised_low": 0.01, "realised_high": 0.1}
    names = [
        "bound_paper",
        "bound_independent",
        "bound_coherent",
        "simulated_independent",
        "simulated_coherent",
    ]
    with style.report_style():
        figure = reliability_figure([group | {"promise": name} for name in names], [])
        said = texts_of(figure)
    assert wrong_texts(said) == []
    assert texts_outside(figure) == []
    assert labels_without_unit(figure) == []
    assert len([text for text in said if "winds" in text]) == len(names)


def test_every_metric_that_is_a_probability_names_its_law_on_axes_and_pages() -> None:
    for name in [*METRIC_LABELS, *LAW_NAMES]:
        if is_probability(name) and name != "completed":
            assert any(law in metric_label(name) for law in (*LAWS, "fidelity.law")), name
            assert axis_label(name).endswith("[%]")
    assert {name for name in sweep_summary.SHOWN_METRICS if "fidelity.law" in metric_label(name)} == set()
    assert sweep_summary.metric_text("failure_coherent", 3.2e-7) == "3.2e-5 %"


def test_a_longer_path_of_another_map_keeps_its_text_on_the_page(tmp_path: Path) -> None:
    scene = scene_of(crs=None, scale=10.0)
    plan = replace(plan_of(path_of(scene)), dt=0.125)
    with style.report_style():
        figure = plan_figure(ReportConfig(), run_of(scene=scene, plan=plan, deployments={}))
        assert texts_outside(figure) == []
