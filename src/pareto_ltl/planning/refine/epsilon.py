"""``planner.epsilon``: which paths keep it in every segment, and the names of the barriers in their way."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.refine.separation import ROUNDING, allowed_risk, separation
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.errors import InfeasibleError

LOG = logging.getLogger(__name__)

WALLS = ("western", "eastern", "southern", "northern")


def keeps_epsilon(problem: Problem, path: PlannedPath) -> bool:
    """Whether no segment of ``path`` is more likely to collide than ``planner.epsilon`` allows."""
    limit = _limit(problem)
    return math.isinf(limit) or bool(separation(problem, propagate(problem, path.x)).risk.max() <= limit)


def _limit(problem: Problem) -> float:
    """The largest risk of a segment that counts as ``planner.epsilon``; inf without a limit."""
    return allowed_risk(problem) * (1.0 + ROUNDING)


def within_limits(problem: Problem, paths: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """The paths that keep ``planner.epsilon`` in every segment; a line in the log states how many do not.

    Raises
    ------
    InfeasibleError
        If none of the paths does; the message says by how much, where, and what would admit one.
    """
    epsilon, limit = allowed_risk(problem), _limit(problem)
    if not paths or math.isinf(limit):
        return tuple(paths)
    parts = [separation(problem, propagate(problem, path.x)) for path in paths]
    worst = np.array([part.risk.max() for part in parts])
    kept = tuple(path for path, risk in zip(paths, worst, strict=True) if risk <= limit)
    if len(kept) == len(paths):
        return kept
    k = int(np.argmin(np.where(worst > limit, worst, np.inf)))
    least = _rounded_up(1.05 * float(worst[k]))
    if not kept:
        step = int(parts[k].risk.argmax())
        nearest = _barrier_name(problem, int(parts[k].owner[step, 0]))
        raise InfeasibleError(
            f"no path keeps planner.epsilon = {epsilon:g} in every segment: the best of {len(paths)} refined "
            f"paths comes closest to {nearest} at step {step + 1}, with a collision probability of "
            f"{probability_text(worst[k])}; set planner.epsilon={least:g}, or null for no limit"
        )
    LOG.info(
        "%d of %d refined paths are not on the front: a segment of each is more likely to collide than "
        "planner.epsilon = %g allows; planner.epsilon=%g would admit the next",
        len(paths) - len(kept), len(paths), epsilon, least,
    )  # fmt: skip
    return kept


def _rounded_up(value: float) -> float:
    """``value`` with two significant digits, rounded up; at most 0.99."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return min(math.ceil(value / unit) * unit, 0.99)


def _barrier_name(problem: Problem, number: int) -> str:
    """The obstacle, wall or forbidden region of polygon ``number`` of a :class:`Separation`."""
    names = barrier_names(problem)
    return problem.scene.barrier_title(names[number]) if number < len(names) else "a forbidden region"


def barrier_names(problem: Problem) -> list[str]:
    """Names of the barriers: ``obstacle 3``, the third of the map, for each of its convex parts; walls."""
    import shapely

    outlines = [shapely.Polygon(corners) for corners in problem.scene.obstacles]
    names = []
    for part in problem.decomposition.obstacles:
        gaps = shapely.distance(outlines, shapely.Point(part.mean(axis=0)))
        names.append(f"obstacle {int(np.argmin(gaps)) + 1}")
    return names + [f"the {side} border" for side in WALLS if problem.scene.walled]
