"""Missions that no path flies within ``planner.epsilon``: the nearest path is the plan, and says so."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

import pareto_ltl
from careful_io.reading import read_json
from lies.editing import Lie, both, edited, in_json, in_metrics, in_plan
from pareto_ltl.planning import separation
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.power import EnergyModel, Wing
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run import front_stage
from pareto_ltl.run.plan_run import Run
from pareto_ltl.simulation.judging import count_failures
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl_apps.cli.summary import limit_rows, plan_paragraphs
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings, verify
from quick_wind import QUICK_WIND

GAP = {
    "name": "gap", "unit": 1e5, "centre": [37.0, -92.0], "bounds": [[0, 0], [10, 10]], "start": [1, 5],
    "regions": {"a": [[7, 4], [9, 4], [9, 6], [7, 6]]},
    "obstacles": [[[4, 0], [4.5, 0], [4.5, 4.8], [4, 4.8]], [[4, 5.2], [4.5, 5.2], [4.5, 10], [4, 10]]],
}  # fmt: skip
FORBIDDEN = GAP | {"regions": {**GAP["regions"], "c": [[4, 0], [4.5, 0], [4.5, 5.2], [4, 5.2]]}}
FORBIDDEN |= {"obstacles": [[[4, 5.4], [4.5, 5.4], [4.5, 10], [4, 10]]]}
SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 1, "n_max": 400, "max_steps": 60},
    "refine": {"flights": 100, "sweep_flights": 50, "classes": 1, "points": 3},
    "selection": {"draws": 500, "runs": 2000},
    "wind": QUICK_WIND,
    "deployment": {"runs": 2000},
    "report": {"figures": False},
}
OF_EPSILON = [
    claim
    for claim in CLAIMS
    if claim.name in ("plan: whether it keeps epsilon", "plan: limits of its segments")
]


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A plan through a gap of 40 km, where positions are uncertain by as much."""
    return pareto_ltl.plan(GAP, "F a", out=tmp_path_factory.mktemp("nearest") / "run", **SMALL)


def worst_of(problem: Problem, x: np.ndarray) -> float:
    return float(separation.separation(problem, propagate(problem, x)).risk.max())


def front_again(planned: Run, **planner: Any) -> Run:
    """The run up to the trees with other settings of the planner; its front is not made yet."""
    settings = replace(planned.settings, planner=replace(planned.settings.planner, **planner))
    return Run(settings, planned.make("scene", "wind", "problem", "forest"))


def test_the_nearest_path_is_the_plan_and_every_file_says_so(planned: Run) -> None:
    place, plan = planned.directory, planned.plan
    assert place is not None
    document, metrics = read_json(place / "plan.json"), read_json(place / "metrics.json")
    worst = worst_of(planned.problem, plan.path.x)
    assert worst > plan.epsilon == 0.05
    assert plan.worst is not None
    assert document["epsilon_kept"] is False
    assert document["worst_segment"]["probability"] == pytest.approx(worst)
    assert document["worst_segment"]["nearest"] in ("obstacle 1", "obstacle 2")
    assert (metrics["completed"], metrics["epsilon_kept"]) == (1.0, 0.0)
    assert metrics["worst_segment_probability"] == pytest.approx(worst)
    assert plan.promise is not None
    assert plan.promise.rate.runs == 2000
    again = Run.open(place).plan
    assert (again.epsilon_kept, again.worst, again.remedies) == (False, plan.worst, plan.remedies)
    log = (place / "run.log").read_text()
    step, nearest = plan.worst.step, plan.worst.nearest
    said = (
        rf"WARNING \S+ no path keeps planner.epsilon = 5.0 %, .* segment {step + 1} of {len(plan.path.u)}, "
    )
    assert re.search(said + rf".* {100 * worst:.1f} %, closest to {nearest}; it fails ", log)
    page = (place / "report.html").read_text()
    assert 'id="breach"' in page
    assert f"closest to {nearest}" in page
    rows = dict(limit_rows(plan))
    assert "above the 5.0 % allowed" in rows["likeliest collision, coherent winds"]
    named = replace(planned.scene, obstacle_names=("EFKU CTR",) * len(planned.scene.obstacles))
    (text,) = dict(limit_rows(plan, scene=named)).values()
    assert text.endswith("(EFKU CTR)") or "obstacle" not in text
    paragraphs = list(plan_paragraphs(planned, place, plan))
    assert paragraphs[0].startswith("The plan is the path nearest to planner.epsilon")
    assert ("What helps, tried with 4,000 flights" in " ".join(paragraphs)) is bool(plan.remedies)


def test_prices_of_a_plan_that_breaks_epsilon_are_of_flights_alone(planned: Run) -> None:
    """Multipliers about such a path measure the breach: one metre would save more than all flights."""
    prices = planned.plan.prices
    assert prices
    assert {price.kind for price in prices} <= {"obstacle", "border", "region"}
    assert planned.plan.promise is not None
    sd = float(np.sqrt(np.linalg.eigvalsh(planned.plan.path.cov[-1])[-1]))
    assert max(price.saving for price in prices) < planned.plan.promise.rate.failure / (0.1 * sd)


def test_no_candidate_is_nearer_than_the_plan(planned: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of paths that are equally near, the plan is the one that fails least often."""
    seen: list[Sequence[PlannedPath]] = []
    nearest = front_stage.nearest_paths

    def watched(problem: Problem, paths: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
        seen.append(paths)
        return nearest(problem, paths)

    monkeypatch.setattr(front_stage, "nearest_paths", watched)
    run = front_again(planned)
    (path,), (paths,) = run.front.paths, seen
    problem = run.problem
    worst = np.array([worst_of(problem, one.x) for one in paths])
    assert path.x.tobytes() == planned.plan.path.x.tobytes()
    assert worst_of(problem, path.x) <= (1.0 + separation.ALIKE) * worst.min()
    rivals = [one for one, risk in zip(paths, worst, strict=True) if risk <= 1.02 * worst.min()]
    failures = [count_failures(problem, one, 4000, SeedSequence(8)) for one in rivals]
    assert count_failures(problem, path, 4000, SeedSequence(8)) <= min(failures) + 5 * 4000**0.5


def test_a_path_that_needs_too_much_energy_is_not_the_nearest(planned: Run) -> None:
    """Two paths, the nearer one beyond the capacity; if both are, energy is the cause that is named."""
    run = front_again(planned)
    curve = Wing(base=100.0, drag=0.0, lift=0.0)
    path = planned.plan.path
    costs = path.objectives.costs
    spent = [2e6, 1e6]
    near, far = (
        replace(path, x=x, objectives=replace(path.objectives, costs={**costs, "energy": energy}))
        for x, energy in zip((path.x, np.add(path.x, [0.0, 20e3])), spent, strict=True)
    )
    for capacity, expected in ((3e6, near), (1.5e6, far), (0.5e6, near)):
        problem = replace(run.problem, energy=EnergyModel(curve, capacity))
        search = front_stage.Search(run.settings, problem, run.forest, run.budget)
        (found,) = front_stage.nearest_to_epsilon(search, (near, far))
        assert found is expected


def test_a_strict_epsilon_refuses_and_its_advice_gives_the_plan(planned: Run) -> None:
    with pytest.raises(InfeasibleError, match=r"no path keeps planner\.epsilon = 0\.05") as told:
        front_again(planned, epsilon_strict=True).make("front")
    text = str(told.value)
    assert re.search(r"closest to obstacle [12] at step \d+ of \d+, with a collision probability of", text)
    assert "with planner.epsilon_strict=false this path is the plan" in text
    least = float(text.partition("set planner.epsilon=")[2].split(",", 1)[0])
    settings = {**SMALL, "planner": SMALL["planner"] | {"epsilon": least, "epsilon_strict": True}}
    assert pareto_ltl.plan(GAP, "F a", **settings).plan.epsilon_kept


def test_where_no_refined_path_can_be_flown_a_line_of_the_map_is_the_plan(
    planned: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That the last polishes are refused is no cause to have no plan."""
    monkeypatch.setitem(front_stage.REFINERS, "sampled", lambda *_: ())
    monkeypatch.setattr(front_stage.selection, "unlike_paths", lambda *_: ())
    run = front_again(planned)
    (path,) = run.front.paths
    assert "line" in path.origin
    assert not run.plan.epsilon_kept
    with pytest.raises(InfeasibleError, match="comes closest to obstacle"):
        front_again(planned, epsilon_strict=True).make("front")


def test_the_figures_of_position_feedback_are_those_of_such_a_robot(planned: Run) -> None:
    """The same path in a problem that is built from settings with that feedback, in other flights."""
    found = [one for one in planned.plan.remedies if one.change.startswith("position feedback")]
    assert len(found) == 1
    time = float(found[0].change.split("=")[1])
    robot = {"dt": 1800.0, "feedback_time": time}
    held = pareto_ltl.plan(GAP, "F a", **SMALL | {"robot": robot}).problem
    path = planned.plan.path
    assert worst_of(held, path.x) == pytest.approx(found[0].worst_segment_probability, rel=1e-3)
    failed = count_failures(held, path, 4000, SeedSequence(99)) / 4000
    spread = 5.0 * np.sqrt(max(failed * (1.0 - failed), 1e-3) / 2000)
    assert abs(failed - found[0].failure) < spread
    assert found[0].worst_segment_probability <= planned.plan.epsilon or time == 60.0


def test_the_checker_accepts_the_plan_and_rejects_the_lie(planned: Run, tmp_path: Path) -> None:
    place = planned.directory
    assert place is not None
    assert [finding for finding in verify(place) if not finding.holds] == []
    kept = both(in_plan(lambda p: p.update(epsilon_kept=True)), in_metrics({"epsilon_kept": 1.0}))
    small = both(
        kept,
        in_plan(lambda p: p["worst_segment"].update(probability=0.04)),
        in_metrics({"worst_segment_probability": 0.04}),
    )
    silent = in_json("plan.json", lambda p: (p.pop("epsilon_kept"), p.pop("worst_segment")))
    for number, lie in enumerate((kept, small, silent)):
        copy = edited(place, tmp_path / str(number), Lie("epsilon is kept", lie, ()))
        assert not all(finding.holds for finding in findings(open_evidence(copy), OF_EPSILON))
        shutil.rmtree(copy)


def test_a_forbidden_region_is_named_and_checked(tmp_path: Path) -> None:
    result = pareto_ltl.plan(FORBIDDEN, "!c U a", out=tmp_path / "run", **SMALL)
    assert not result.plan.epsilon_kept
    assert result.plan.worst is not None
    assert result.plan.worst.nearest in ("region c", "obstacle 1")
    assert [finding for finding in verify(tmp_path / "run") if not finding.holds] == []


def test_a_start_beside_an_obstacle_has_a_plan_unless_epsilon_is_strict() -> None:
    beside = GAP | {"start": [3.95, 3.0]}
    settings = {**SMALL, "robot": {"dt": 1800.0, "start_sd": 5000.0}}
    assert not pareto_ltl.plan(beside, "F a", **settings).plan.epsilon_kept
    settings["planner"] = SMALL["planner"] | {"epsilon_strict": True}
    with pytest.raises(InfeasibleError, match="the start lies closer to an obstacle"):
        pareto_ltl.plan(beside, "F a", **settings)
