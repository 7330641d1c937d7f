"""The stage of the front: refinement and comparison of paths, as ``fidelity`` selects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from pareto_ltl.run.records import FOREST, PROBLEM
from pareto_ltl.run.stage_table import StageInputs, named_child, stage_seeds
from pareto_ltl.support.errors import InfeasibleError

if TYPE_CHECKING:
    from pareto_ltl.planning.records import Front, PlannedPath

FOREST_STREAM = "forest"  # stream of the random numbers of growth
JUDGING = "judging"  # child of the front's stream that refinement does not use


def make_front(inputs: StageInputs) -> Front:
    """The non-dominated paths, refined and judged as ``fidelity`` says."""
    inputs.budget.heeded = True
    if inputs.ahead is not None:
        inputs.ahead.wait()
    front = FRONT_MAKERS[inputs.settings.fidelity.judge](inputs)
    inputs.budget.heeded = False
    return front


def _bounded_front(inputs: StageInputs) -> Front:
    """The front by mission risk, collision risk and length, as published."""
    from pareto_ltl.planning import no_path, selection

    settings, problem = inputs.settings, inputs[PROBLEM]
    if not len(inputs[FOREST].accepted):
        raise InfeasibleError(_no_path(inputs))
    raw = selection.tree_front(problem, inputs[FOREST])
    refined, fault = _refined_paths(inputs, raw)
    if not raw and not refined:
        grown_from = stage_seeds(settings.seed, FOREST_STREAM)
        why = no_path.explain_no_safe_path(settings.planner, problem, grown_from)
        if why:
            raise InfeasibleError(why + fault)
    return selection.build_front(refined, raw, settings.fidelity)


def _flown_front(inputs: StageInputs) -> Front:
    """The front by failure rate and length, in flights that refinement has not used."""
    from pareto_ltl.planning import selection
    from pareto_ltl.simulation.judging import judge_front

    settings, problem = inputs.settings, inputs[PROBLEM]
    raw = selection.unlike_paths(problem, inputs[FOREST])
    refined, fault = _refined_paths(inputs, raw)
    if not raw and not refined:
        raise InfeasibleError(_no_path(inputs) + fault)
    seeds = named_child(inputs.seeds, JUDGING)
    return judge_front(problem, refined, raw, settings.selection.draws, seeds)


def _no_path(inputs: StageInputs) -> str:
    """Text that says why the trees have no path that completes the mission."""
    from pareto_ltl.planning import no_path

    settings = inputs.settings
    grown_from = stage_seeds(settings.seed, FOREST_STREAM)
    return no_path.explain_no_path(settings.planner, inputs[PROBLEM], inputs[FOREST], grown_from)


FRONT_MAKERS: dict[str, Callable[[StageInputs], Front]] = {"bound": _bounded_front, "flights": _flown_front}


def _refined_paths(inputs: StageInputs, raw: Sequence[PlannedPath]) -> tuple[tuple[PlannedPath, ...], str]:
    """The paths that ``fidelity.refine`` makes from those of the trees; if none can be flown, the reason."""
    try:
        return REFINERS[inputs.settings.fidelity.refine](inputs, raw), ""
    except InfeasibleError as error:
        return (), f"; {error}"


def _no_refinement(_inputs: StageInputs, _raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    return ()


def _convex_refinement(inputs: StageInputs, raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """Convex smoothing of the front and of one path of each mission order."""
    from pareto_ltl.planning import selection
    from pareto_ltl.planning.refine import smooth_paths

    problem = inputs[PROBLEM]
    candidates = (*raw, *selection.order_representatives(problem, inputs[FOREST]))
    return smooth_paths(inputs.settings.smoothing, problem, candidates, inputs.progress)


def _sampled_refinement(inputs: StageInputs, raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """Sampled refinement; without uncertainty all flights are the same, and only the length counts."""
    from pareto_ltl.planning.refine import sampled_paths
    from pareto_ltl.simulation.common_flights import draw_flights, is_certain

    problem, cfg = inputs[PROBLEM], inputs.settings.refine
    if is_certain(problem):
        return _convex_refinement(inputs, raw)
    flights = draw_flights(problem, problem.fidelity.law, cfg.flights, inputs.seeds)
    return sampled_paths(cfg, problem, inputs[FOREST], flights, inputs.progress, inputs.budget)


Refiner = Callable[[StageInputs, Sequence["PlannedPath"]], tuple["PlannedPath", ...]]
REFINERS: dict[str, Refiner] = {
    "none": _no_refinement,
    "convex": _convex_refinement,
    "sampled": _sampled_refinement,
}


__all__ = ["FOREST_STREAM", "REFINERS", "make_front"]
