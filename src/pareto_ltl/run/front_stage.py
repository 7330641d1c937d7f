"""The stage of the front: refinement and comparison of paths, as ``fidelity`` selects."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence

from pareto_ltl.planning import no_path, selection
from pareto_ltl.planning.costs import cost_named
from pareto_ltl.planning.evaluate import completing_path
from pareto_ltl.planning.plan_files import read_extra_paths
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front, PlannedPath
from pareto_ltl.planning.refine import MORE_FLIGHTS, flown_lines, sampled_paths, smooth_paths
from pareto_ltl.planning.refine.separation import keeps_epsilon, within_limits
from pareto_ltl.run.records import CANDIDATES, FOREST, PROBLEM
from pareto_ltl.run.stage_table import FOREST_STREAM, StageInputs, named_child, stage_seeds
from pareto_ltl.simulation.common_flights import draw_flights, is_certain
from pareto_ltl.simulation.judging import judge_front
from pareto_ltl.support.errors import InfeasibleError

LOG = logging.getLogger(__name__)
JUDGING = "judging"  # child of the front's stream that refinement does not use
NO_TREE_PATH = (
    "no path of the trees keeps planner.epsilon in every segment: set fidelity.refine=sampled, which looks "
    "for one, or planner.epsilon=null for no limit"
)


def make_front(inputs: StageInputs) -> Front:
    """The non-dominated paths, refined and judged as set in ``fidelity``."""
    inputs.budget.heeded = True
    front = FRONT_MAKERS[inputs.settings.fidelity.judge](inputs)
    inputs.budget.heeded = False
    for text in equal_costs(inputs.settings.selection.costs, front):
        LOG.warning("%s", text)
    return front


def equal_costs(names: Iterable[str], front: Front) -> Iterator[str]:
    """Which of the costs ``names`` are equal on all paths of ``front``, and decide nothing."""
    for name in names:
        values = {path.objectives.costs.get(name) for path in front.paths}
        if len(front.paths) > 1 and len(values) == 1 and (value := values.pop()) is not None:
            text = f"{name} is {cost_named(name).text(value)} on all {len(front.paths)} paths of the front"
            yield f"selection.costs: {text}, and decides nothing"


def _bounded_front(inputs: StageInputs) -> Front:
    """The front by mission risk, collision risk and length, as published."""
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
    settings, problem = inputs.settings, inputs[PROBLEM]
    raw = selection.unlike_paths(problem, inputs[FOREST])
    refined, fault = _refined_paths(inputs, raw)
    if not refined and not any(keeps_epsilon(problem, path) for path in raw):
        if raw:
            raise InfeasibleError(fault.removeprefix("; ") or NO_TREE_PATH)
        refused = no_path.explain_refused(settings.planner, problem, fault.removeprefix("; "))
        raise InfeasibleError(refused or _no_path(inputs))
    seeds = named_child(inputs.seeds, JUDGING)
    return judge_front(problem, refined, raw, settings.selection.draws, seeds)


def _no_path(inputs: StageInputs) -> str:
    """Text with the reason why the trees have no path that completes the mission."""
    settings = inputs.settings
    grown_from = stage_seeds(settings.seed, FOREST_STREAM)
    return no_path.explain_no_path(settings.planner, inputs[PROBLEM], inputs[FOREST], grown_from)


FRONT_MAKERS: dict[str, Callable[[StageInputs], Front]] = {"bound": _bounded_front, "flights": _flown_front}


def _refined_paths(inputs: StageInputs, raw: Sequence[PlannedPath]) -> tuple[tuple[PlannedPath, ...], str]:
    """Refined paths, with the paths of ``selection.extra_paths`` and ``CANDIDATES``; why none is refined."""
    problem, fault = inputs[PROBLEM], ""
    extra = extra_paths(inputs.settings.selection.extra_paths, problem) + (inputs.get(CANDIDATES) or ())
    refined: tuple[PlannedPath, ...] = ()
    try:
        refined = REFINERS[inputs.settings.fidelity.refine](inputs, raw)
        refined = within_limits(problem, refined)
    except InfeasibleError as error:
        left = any(keeps_epsilon(problem, path) for path in (*raw, *extra))
        if refined and not left:  # they complete the mission, too close to obstacles
            raise
        if left:
            LOG.warning("only paths of the search trees are left: %s", error)
        refined, fault = (), f"; {error}"
    return (*refined, *extra), fault


def extra_paths(place: str | None, problem: Problem) -> tuple[PlannedPath, ...]:
    """The paths of the file ``place`` that can be flown in ``problem``; a WARNING names the others."""
    able = []
    for origin, x in [] if place is None else read_extra_paths(place):
        try:
            able.append(completing_path(problem, x, origin))
        except InfeasibleError as error:
            LOG.warning("%s of selection.extra_paths is left out: %s", origin, error)
    return tuple(able)


def _no_refinement(_inputs: StageInputs, _raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    return ()


def _convex_refinement(
    inputs: StageInputs, raw: Sequence[PlannedPath], lines: Sequence[PlannedPath] = ()
) -> tuple[PlannedPath, ...]:
    """Convex smoothing of the front, of one path of each mission order, and of ``lines``."""
    problem = inputs[PROBLEM]
    candidates = (*raw, *selection.order_representatives(problem, inputs[FOREST]), *lines)
    return smooth_paths(inputs.settings.smoothing, problem, candidates, inputs.progress)


def _sampled_refinement(inputs: StageInputs, raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """Sampled refinement; without uncertainty all flights are the same, and only the length counts."""
    problem = inputs[PROBLEM]
    if is_certain(problem):
        return _convex_refinement(inputs, raw, flown_lines(problem))
    cfg = inputs.settings.refine
    flights = draw_flights(problem, problem.fidelity.law, MORE_FLIGHTS * cfg.flights, inputs.seeds)
    return sampled_paths(cfg, problem, inputs[FOREST], flights, inputs.progress, inputs.budget)


Refiner = Callable[[StageInputs, Sequence[PlannedPath]], tuple[PlannedPath, ...]]
REFINERS: dict[str, Refiner] = {
    "none": _no_refinement,
    "convex": _convex_refinement,
    "sampled": _sampled_refinement,
}
