"""A map with landmarks is searched with them and without; what one search lacks costs the other nothing."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest
from numpy.random import SeedSequence

from landmarks import LANDMARK_WAY, landmark_problem
from pareto_ltl.planning import refine
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.front_stage import REFINERS
from pareto_ltl.run.records import FOREST, PROBLEM
from pareto_ltl.settings import RefineConfig
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.errors import InfeasibleError


class Inputs(dict[object, Any]):
    """Records of a run, and what else the stage reads."""

    settings = SimpleNamespace(refine=RefineConfig(flights=50))
    seeds = SeedSequence(1)
    progress = None

    def __init__(self) -> None:
        super().__init__({PROBLEM: landmark_problem(), FOREST: None})
        self.budget = Budget()


def has_landmarks(problem: Problem) -> bool:
    return bool(problem.scene.landmarks)


@pytest.mark.parametrize(("failing", "text"), [(True, "with landmarks"), (False, "without landmarks")])
def test_the_paths_of_one_search_are_kept_if_the_other_has_none(
    failing: bool, text: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def search(_cfg: object, problem: Problem, *_: object) -> tuple[PlannedPath, ...]:
        if has_landmarks(problem) is failing:
            raise InfeasibleError("blocked")
        return (evaluate_path(problem, LANDMARK_WAY, "found"),)

    monkeypatch.setattr(refine, "sampled_paths", search)
    inputs = Inputs()
    with caplog.at_level(logging.WARNING):
        (path,) = REFINERS["sampled"](inputs, ())  # type: ignore[arg-type]
    assert f"the search {text} has no path: blocked" in caplog.text
    assert path.fixes == evaluate_path(inputs[PROBLEM], LANDMARK_WAY, "").fixes != ()


def test_without_any_path_the_fault_is_that_of_the_search_with_landmarks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def search(_cfg: object, problem: Problem, *_: object) -> tuple[PlannedPath, ...]:
        raise InfeasibleError("with" if has_landmarks(problem) else "without")

    monkeypatch.setattr(refine, "sampled_paths", search)
    with pytest.raises(InfeasibleError, match=r"^with$"):
        REFINERS["sampled"](Inputs(), ())  # type: ignore[arg-type]


def test_a_time_budget_leaves_time_for_both_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    left = {}

    def search(_cfg: object, problem: Problem, *rest: Any) -> tuple[PlannedPath, ...]:
        left[has_landmarks(problem)] = rest[-1].left()
        return ()

    monkeypatch.setattr(refine, "sampled_paths", search)
    inputs = Inputs()
    inputs.budget = Budget(100.0)
    REFINERS["sampled"](inputs, ())  # type: ignore[arg-type]
    assert left == {True: pytest.approx(60.0), False: pytest.approx(100.0)}
