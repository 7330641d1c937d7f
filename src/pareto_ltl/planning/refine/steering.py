"""Steering: the convex programme from the start of a problem to its goal, without search trees."""

from __future__ import annotations

from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.refine import smoothing
from pareto_ltl.planning.refine.epsilon import within_limits
from pareto_ltl.planning.refine.sampled import path_length
from pareto_ltl.planning.refine.starts import line_starts, roadmap_starts, unlike_starts
from pareto_ltl.settings import SmoothingConfig
from pareto_ltl.support.errors import InfeasibleError

WAYS = 4  # lines past different sides of obstacles that are bent, the shortest


def steered_path(problem: Problem, cfg: SmoothingConfig, weight: float) -> PlannedPath:
    """The path of the least length / shortest + ``weight`` (mission risk + collision risk).

    It begins with lines of the roadmap, and each segment keeps ``planner.epsilon``.

    Raises
    ------
    InfeasibleError
        If there is no line to the goal, the programme has no solution, or a segment breaks epsilon.
    """
    lines = unlike_starts(problem, [*line_starts(problem), *roadmap_starts(problem)])
    begun = [
        smoothing.Start(start.x, None, start.origin)
        for start in sorted(lines.values(), key=lambda start: path_length(start.x))[:WAYS]
    ]
    if not begun:
        raise InfeasibleError("no line leads from the start to the goal between the obstacles")
    model, shortest = smoothing.fitting_programme(problem, begun), path_length(begun[0].x)
    task = smoothing.SmoothingTask(cfg, model, problem, shortest)
    weights = [*(w for w in sorted(cfg.weights, reverse=True) if w > weight), weight]
    found = smoothing.bend_each(task, begun, weights, None)
    if not found:
        raise InfeasibleError(
            "no path leads from the start to the goal within the limits of airspeed and planner.epsilon"
        )
    paths = [evaluate_path(problem, path.x, "steered") for path in found]
    return min(within_limits(problem, paths), key=lambda path: task.merit(path, weight))
