"""Costs of a path: each is one row, and a front compares all that are asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pareto_ltl.planning.costs import COSTS, costs_with
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.plan_files import read_front, write_front
from pareto_ltl.planning.records import Front, Objectives, PlannedPath
from pareto_ltl.planning.selection import box_above, build_front
from pareto_ltl.planning.selection_rules import choose_path
from pareto_ltl.run.front_stage import equal_costs
from pareto_ltl.settings import SelectionConfig, preset
from pareto_ltl.support.arrays import square_matrices
from pareto_ltl.support.errors import ConfigError
from problems import box, make_problem, make_scene, smooth_wind


def further_problem(*names: str):
    """A problem whose paths are compared by the costs ``names`` too."""
    return replace(make_problem("F a", make_scene({"a": box(8, 8, 10, 10)})), costs=costs_with(names))


def path_of(risk: float, **costs: float) -> PlannedPath:
    """A path of one step with these costs."""
    return PlannedPath(
        t=np.array([0.0, 60.0]), x=np.zeros((2, 2)), cov=np.zeros((2, 2, 2)), q=np.zeros(2, np.int64),
        label=(frozenset(), frozenset("a")), u=np.zeros((1, 2)),
        objectives=Objectives(costs, risk, risk, 0.0, risk), origin="", order="a",
    )  # fmt: skip


def test_duration_is_the_number_of_steps_times_the_step() -> None:
    problem = further_problem("duration")
    costs = problem.costs_of(np.zeros((6, 2)), np.zeros((5, 2)))
    assert list(costs) == ["length", "duration"]
    assert costs["duration"] == 5 * problem.motion.dt


def test_turns_add_up_the_changes_of_course_of_either_sign_and_skip_rests() -> None:
    x = 100.0 * np.array([[0, 0], [1, 0], [1, 1], [1, 1], [2, 1], [3, 2]])
    assert further_problem("turns").costs_of(x, x[1:])["turns"] == pytest.approx(90 + 90 + 45)


@pytest.mark.parametrize("law", ["independent", "coherent"])
def test_held_air_is_the_hull_of_the_ellipses_of_each_step(law: str) -> None:
    """Another road: the convex hull of two polygons of 720 corners, by shapely."""
    scene, models = make_scene({"a": box(8, 8, 10, 10)}), replace(preset("full"), law=law)
    problem = make_problem("F a", scene, smooth_wind(scene), fidelity=models)
    x = 1e5 * np.array([[0.5, 0.5], [1.0, 0.7], [1.0, 0.7], [1.2, 1.5]])
    cov = square_matrices(propagate(problem, x).cov)
    angles = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    circle, total = 3.0 * np.column_stack([np.cos(angles), np.sin(angles)]), 0.0
    for here, there, one, other in zip(x[:-1], x[1:], cov[:-1], cov[1:], strict=True):
        ring = circle @ np.linalg.cholesky(0.5 * (one + other)).T
        total += shapely.MultiPoint([*(here + ring), *(there + ring)]).convex_hull.area
    assert total > 0.0
    wanted = total * 1e-6 * problem.motion.dt / 3600.0
    assert replace(problem, costs=costs_with(["containment"])).costs_of(x, x[1:])["containment"] == (
        pytest.approx(wanted, rel=1e-4)
    )


def front_of_three() -> Front:
    """Paths of which no two objectives suffice to tell who is dominated."""
    rows = [(0.1, 5.0, 300.0), (0.1, 6.0, 200.0), (0.2, 4.0, 400.0), (0.1, 6.0, 250.0)]
    return build_front([path_of(risk, length=length, turns=turns) for risk, length, turns in rows], [])


def test_a_front_over_three_objectives_keeps_what_is_best_in_any_of_them() -> None:
    costs = [tuple(path.objectives.costs.values()) for path in front_of_three().paths]
    assert costs == [(5.0, 300.0), (6.0, 200.0), (4.0, 400.0)]


def test_a_cost_that_is_equal_on_all_paths_is_named() -> None:
    paths = [path_of(risk, length=length, turns=90.0) for risk, length in ((0.1, 6.0), (0.2, 5.0))]
    expected = "selection.costs: turns is 90° on all 2 paths of the front, and decides nothing"
    assert list(equal_costs(["turns"], build_front(paths, []))) == [expected]
    assert list(equal_costs(["turns"], build_front(paths[:1], []))) == []
    assert list(equal_costs(["turns"], front_of_three())) == []


def test_a_front_with_further_costs_is_read_as_it_was_written(tmp_path: Path) -> None:
    front = front_of_three()
    front = replace(front, raw=tuple(path.objectives for path in front.paths))
    write_front(tmp_path, front)
    assert (tmp_path / "front.csv").read_text().splitlines()[0].endswith(",origin,turns_deg")
    again = read_front(tmp_path)
    assert [path.objectives for path in again.paths] == [path.objectives for path in front.paths]
    assert again.raw == front.raw


def test_rules_read_the_further_costs() -> None:
    front = front_of_three()
    least = SelectionConfig(rule="least", least="turns", alpha=0.15)
    assert choose_path(least, front).objectives.costs["turns"] == 200.0
    weighted = SelectionConfig(rule="weighted", weights=[0.0, 0.0, 0.0, 1.0])
    assert choose_path(weighted, front).objectives.costs["turns"] == 200.0
    with pytest.raises(ConfigError, match=r"has 5 numbers, and the front has 2 costs"):
        choose_path(replace(weighted, weights=[1.0] * 5), front)
    with pytest.raises(ConfigError, match=r"selection.least=duration: .* selection.costs=\[duration\]"):
        choose_path(replace(least, least="duration"), front)


def test_a_cost_that_is_0_on_all_paths_leaves_the_hypervolume_a_number() -> None:
    paths = [path_of(risk, length=length, turns=0.0) for risk, length in [(0.1, 5.0), (0.2, 4.0)]]
    assert 0.0 < build_front(paths, []).hypervolume < 1.0
    assert box_above(np.array([[5.0, 0.0], [4.0, 0.0]])).tolist() == [10.0, 1.0]  # also of fronts by flights


def test_names_and_columns_are_different() -> None:
    assert len({cost.column for cost in COSTS.values()}) == len(COSTS)
    assert all(cost.text(1234.5) for cost in COSTS.values())
