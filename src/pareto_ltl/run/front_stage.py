"""The stage of the front: refinement and comparison of paths, as ``fidelity`` selects."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Sequence

from pareto_ltl.planning import no_path, selection, selection_rules
from pareto_ltl.planning.costs import cost_named
from pareto_ltl.planning.evaluate import completing_path, evaluate_path
from pareto_ltl.planning.plan_files import read_extra_paths
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front, PlannedPath
from pareto_ltl.planning.refine import MORE_FLIGHTS, flown_lines, sampled_paths, smooth_paths
from pareto_ltl.planning.refine.separation import (
    breach_text,
    keeps_epsilon,
    nearest_paths,
    within_limits,
)
from pareto_ltl.run.records import CANDIDATES, FOREST, PROBLEM
from pareto_ltl.run.stage_table import FOREST_STREAM, StageInputs, named_child, stage_seeds
from pareto_ltl.simulation.common_flights import draw_flights, is_certain
from pareto_ltl.simulation.judging import judge_front
from pareto_ltl.support.errors import InfeasibleError

LOG = logging.getLogger(__name__)
JUDGING = "judging"  # child of the front's stream that refinement does not use


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
        raise InfeasibleError(_no_tree_path(inputs))
    raw = selection.tree_front(problem, inputs[FOREST])
    refined, extra = _refined_paths(inputs, raw)
    kept = (*within_limits(problem, refined), *extra)
    if not raw and not kept:
        if refined:  # they complete the mission, too close to obstacles
            raise InfeasibleError(breach_text(problem, refined))
        grown_from = stage_seeds(settings.seed, FOREST_STREAM)
        if why := no_path.explain_no_safe_path(settings.planner, problem, grown_from):
            raise InfeasibleError(why)
    return selection.build_front(kept, raw, settings.fidelity)


def _flown_front(inputs: StageInputs) -> Front:
    """The front by failure rate and length, in flights that refinement has not used.

    If no path keeps ``planner.epsilon``, it is the one nearest to it: of equally near paths, the one that
    fails least often.
    """
    settings, problem = inputs.settings, inputs[PROBLEM]
    raw = selection.unlike_paths(problem, inputs[FOREST])
    refined, extra = _refined_paths(inputs, raw)
    paths = refined + extra
    kept = any(keeps_epsilon(problem, path) for path in (*paths, *raw))
    if not kept and settings.fidelity.refine != "none":  # as they are, lines of the map may be nearer
        paths += tuple(evaluate_path(problem, line.x, line.origin) for line in flown_lines(problem))
        kept = any(keeps_epsilon(problem, path) for path in paths)
    chosen = within_limits(problem, paths) if kept else nearest_to_epsilon(inputs, (*paths, *raw))
    if kept and paths and not chosen:
        LOG.warning("only paths of the search trees are left: %s", breach_text(problem, paths))
    seeds, strict = named_child(inputs.seeds, JUDGING), settings.planner.epsilon_strict
    front = judge_front(problem, chosen, raw, settings.selection.draws, seeds, strict=strict)
    return front if kept else selection_rules.safest_of_front(front)


def nearest_to_epsilon(inputs: StageInputs, paths: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """The paths nearest to ``planner.epsilon``, none of which keeps it; within the energy if any is.

    Raises
    ------
    InfeasibleError
        If there are none, and with ``planner.epsilon_strict``.
    """
    problem, settings = inputs[PROBLEM], inputs.settings
    if not paths:
        no_line = settings.fidelity.refine != "none" and no_path.explain_no_line(settings.planner, problem)
        raise InfeasibleError(no_line or _no_tree_path(inputs))
    if settings.planner.epsilon_strict:
        raise InfeasibleError(
            f"{breach_text(problem, paths)}; with planner.epsilon_strict=false this path is the plan"
        )
    capacity = math.inf if problem.energy is None else problem.energy.capacity or math.inf
    able = [path for path in paths if path.objectives.costs.get("energy", 0.0) <= capacity]
    return nearest_paths(problem, able or paths)


def _no_tree_path(inputs: StageInputs) -> str:
    """Text with the reason why the trees have no path that completes the mission."""
    settings = inputs.settings
    grown_from = stage_seeds(settings.seed, FOREST_STREAM)
    return no_path.explain_no_path(settings.planner, inputs[PROBLEM], inputs[FOREST], grown_from)


FRONT_MAKERS: dict[str, Callable[[StageInputs], Front]] = {"bound": _bounded_front, "flights": _flown_front}


def _refined_paths(
    inputs: StageInputs, raw: Sequence[PlannedPath]
) -> tuple[tuple[PlannedPath, ...], tuple[PlannedPath, ...]]:
    """Refined paths; and the paths of ``selection.extra_paths`` and of ``CANDIDATES``."""
    extra = extra_paths(inputs.settings.selection.extra_paths, inputs[PROBLEM])
    refined: tuple[PlannedPath, ...] = ()
    try:
        refined = REFINERS[inputs.settings.fidelity.refine](inputs, raw)
    except InfeasibleError as error:
        LOG.warning("only paths of the search trees are left: %s", error)
    return refined, extra + (inputs.get(CANDIDATES) or ())


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
