"""The stage of the front: refinement and comparison of paths, as ``fidelity`` selects."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from numpy.random import SeedSequence

from pareto_ltl.planning import no_path, selection, selection_rules
from pareto_ltl.planning.costs import cost_named
from pareto_ltl.planning.evaluate import completing_path, evaluate_path
from pareto_ltl.planning.plan_files import read_extra_paths
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, Front, PlannedPath
from pareto_ltl.planning.refine import Effort, flown_lines, sampled_paths
from pareto_ltl.planning.refine.sweep import first_of
from pareto_ltl.planning.separation import (
    breach_text,
    keeps_epsilon,
    nearest_paths,
    within_limits,
)
from pareto_ltl.planning.smoothing import smooth_paths
from pareto_ltl.settings import RefineConfig
from pareto_ltl.simulation.common_flights import DrawnFlights, draw_mirrored, is_certain
from pareto_ltl.simulation.judging import judge_front
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.seeds import named_child, stage_seeds

if TYPE_CHECKING:
    from pareto_ltl.settings import Settings

LOG = logging.getLogger(__name__)
JUDGING = "judging"  # child of the front's stream
SEARCHING = "searching"  # stream of the flights that paths are fitted to


@dataclass(frozen=True, slots=True)
class Search:
    """What the front is made of; ``candidates`` are further paths that are judged with it."""

    settings: Settings
    problem: Problem
    forest: Forest
    budget: Budget
    progress: Callable[..., None] | None = None
    candidates: Sequence[PlannedPath] = ()

    @property
    def seeds(self) -> SeedSequence:
        """The random stream of the front, from its beginning."""
        return stage_seeds(self.settings.seed, "front")

    @property
    def grown_from(self) -> SeedSequence:
        """The random stream of the trees, from its beginning."""
        return stage_seeds(self.settings.search_seed, "forest")


def make_front(search: Search) -> Front:
    """The non-dominated paths, refined and judged as set in ``fidelity``."""
    search.budget.heeded = True
    front = FRONT_MAKERS[search.settings.fidelity.judge](search)
    search.budget.heeded = False
    for text in equal_costs(search.settings.selection.costs, front):
        LOG.warning("%s", text)
    return front


def equal_costs(names: Iterable[str], front: Front) -> Iterator[str]:
    """Which of the costs ``names`` are equal on all paths of ``front``, and decide nothing."""
    for name in names:
        values = {path.objectives.costs.get(name) for path in front.paths}
        if len(front.paths) > 1 and len(values) == 1 and (value := values.pop()) is not None:
            text = f"{name} is {cost_named(name).text(value)} on all {len(front.paths)} paths of the front"
            yield f"selection.costs: {text}, and decides nothing"


def _bounded_front(search: Search) -> Front:
    """The front by mission risk, collision risk and length, as published."""
    settings, problem = search.settings, search.problem
    if not len(search.forest.accepted):
        raise InfeasibleError(_no_tree_path(search))
    raw = selection.tree_front(problem, search.forest)
    refined, extra = _refined_paths(search, raw)
    kept = (*within_limits(problem, refined), *extra)
    if not raw and not kept:
        if refined:  # they complete the mission, too close to obstacles
            raise InfeasibleError(breach_text(problem, refined))
        if why := no_path.explain_no_safe_path(settings.planner, problem, search.grown_from):
            raise InfeasibleError(why)
    return selection.build_front(kept, raw, settings.fidelity)


def _flown_front(search: Search) -> Front:
    """The front by failure rate and length, in flights that refinement has not used.

    If no path keeps ``planner.epsilon``, it is the one nearest to it: of equally near paths, the one that
    fails least often.
    """
    settings, problem = search.settings, search.problem
    raw = selection.unlike_paths(problem, search.forest)
    refined, extra = _refined_paths(search, raw)
    paths = refined + extra
    kept = any(keeps_epsilon(problem, path) for path in (*paths, *raw))
    if not kept and settings.fidelity.refine != "none":  # as they are, lines of the map may be nearer
        paths += tuple(evaluate_path(problem, line.x, line.origin) for line in flown_lines(problem))
        kept = any(keeps_epsilon(problem, path) for path in paths)
    chosen = within_limits(problem, paths) if kept else nearest_to_epsilon(search, (*paths, *raw))
    if kept and paths and not chosen:
        LOG.warning("only paths of the search trees are left: %s", breach_text(problem, paths))
    seeds, strict = named_child(search.seeds, JUDGING), settings.planner.epsilon_strict
    front = judge_front(problem, chosen, raw, settings.selection.draws, seeds, strict=strict)
    return front if kept else selection_rules.safest_of_front(front)


def nearest_to_epsilon(search: Search, paths: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """The paths nearest to ``planner.epsilon``, none of which keeps it; within the energy if any is.

    Raises
    ------
    InfeasibleError
        If there are none, and with ``planner.epsilon_strict``.
    """
    problem, settings = search.problem, search.settings
    if not paths:
        no_line = settings.fidelity.refine != "none" and no_path.explain_no_line(settings.planner, problem)
        raise InfeasibleError(no_line or _no_tree_path(search))
    if settings.planner.epsilon_strict:
        raise InfeasibleError(
            f"{breach_text(problem, paths)}; with planner.epsilon_strict=false this path is the plan"
        )
    capacity = math.inf if problem.energy is None else problem.energy.capacity or math.inf
    able = [path for path in paths if path.objectives.costs.get("energy", 0.0) <= capacity]
    return nearest_paths(problem, able or paths)


def _no_tree_path(search: Search) -> str:
    """Text with the reason why the trees have no path that completes the mission."""
    planner = search.settings.planner
    return no_path.explain_no_path(planner, search.problem, search.forest, search.grown_from)


FRONT_MAKERS: dict[str, Callable[[Search], Front]] = {"bound": _bounded_front, "flights": _flown_front}


def _refined_paths(
    search: Search, raw: Sequence[PlannedPath]
) -> tuple[tuple[PlannedPath, ...], tuple[PlannedPath, ...]]:
    """Refined paths; and the paths of ``selection.extra_paths`` and of ``search``."""
    extra = extra_paths(search.settings.selection.extra_paths, search.problem)
    refined: tuple[PlannedPath, ...] = ()
    try:
        refined = REFINERS[search.settings.fidelity.refine](search, raw)
    except InfeasibleError as error:
        LOG.warning("only paths of the search trees are left: %s", error)
    return refined, extra + tuple(search.candidates)


def extra_paths(place: str | None, problem: Problem) -> tuple[PlannedPath, ...]:
    """The paths of the file ``place`` that can be flown in ``problem``; a WARNING names the others."""
    able = []
    for origin, x in [] if place is None else read_extra_paths(place):
        try:
            able.append(completing_path(problem, x, origin))
        except InfeasibleError as error:
            LOG.warning("%s of selection.extra_paths is left out: %s", origin, error)
    return tuple(able)


def _no_refinement(_search: Search, _raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    return ()


def _convex_refinement(
    search: Search, raw: Sequence[PlannedPath], lines: Sequence[PlannedPath] = ()
) -> tuple[PlannedPath, ...]:
    """Convex smoothing of the front, of one path of each mission order, and of ``lines``."""
    problem = search.problem
    candidates = (*raw, *selection.order_representatives(problem, search.forest), *lines)
    return smooth_paths(search.settings.smoothing, problem, candidates, search.progress)


def _sampled_refinement(search: Search, raw: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """Sampled refinement; without uncertainty all flights are the same, and only the length counts.

    Its flights, like its trees, are drawn with ``refine.seed``: as nodes of an integral, they are the same
    for every seed of a run, which decides on the flights that judge the paths.
    """
    problem = search.problem
    if is_certain(problem):
        return _convex_refinement(search, raw, flown_lines(problem))
    effort, seeds = Effort.of(search.settings.refine), stage_seeds(search.settings.search_seed, SEARCHING)

    def draw(runs: int) -> DrawnFlights:
        return draw_mirrored(problem, problem.fidelity.law, runs, seeds)

    return sampled_paths(effort, problem, search.forest, draw, search.progress, search.budget)


def search_paths(refine: RefineConfig, flights: DrawnFlights) -> tuple[PlannedPath, ...]:
    """Paths of many lengths in the problem of ``flights`` on which few of them fail, shortest first."""
    return sampled_paths(Effort.of(refine), flights.problem, None, first_of(flights))


Refiner = Callable[[Search, Sequence[PlannedPath]], tuple[PlannedPath, ...]]
REFINERS: dict[str, Refiner] = {
    "none": _no_refinement,
    "convex": _convex_refinement,
    "sampled": _sampled_refinement,
}
