"""How much a detour through a landmark helps: points of the front that cross it, and points that do not."""

from __future__ import annotations

import numpy as np
import shapely

from pareto_ltl.planning.records import Front, Plan
from pareto_ltl.report.page.points import chosen_number
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, probability_text
from pareto_ltl.world.scene import Scene


def detour_lines(scene: Scene, front: Front, plan: Plan) -> list[str]:
    """A sentence for each landmark that some points of the front cross and others do not.

    The plan is compared with the safest path of the other kind: if the plan crosses the landmark, among the
    paths that are no longer than the plan, else among the longer ones. Both rates are taken from the front,
    in the same winds. There is no sentence where the longer path is not the safer one.
    """
    chosen = chosen_number(front, plan)
    if chosen is None or not front.rates:
        return []
    lengths = np.array([path.objectives.length for path in front.paths])
    rates = np.array([rate.failure for rate in front.rates])
    ways = np.array([shapely.LineString(path.x) for path in front.paths])
    lines = []
    for number, corners in enumerate(scene.landmarks, 1):
        crossed = shapely.intersects(shapely.Polygon(corners), ways)
        beside = lengths <= lengths[chosen] if crossed[chosen] else lengths > lengths[chosen]
        others = np.flatnonzero((crossed != crossed[chosen]) & beside)
        if not len(others):
            continue
        other = int(others[np.argmin(rates[others])])
        without, through = (other, chosen) if crossed[chosen] else (chosen, other)
        if rates[through] < rates[without]:
            lines.append(_sentence(number, (without, through), lengths, rates, chosen))
    return lines


def _sentence(
    number: int, points: tuple[int, int], lengths: FloatArray, rates: FloatArray, chosen: int
) -> str:
    without, through = points
    more = distance_text(float(lengths[through] - lengths[without]))
    falls = f"{probability_text(float(rates[without]))} -> {probability_text(float(rates[through]))}"
    if through == chosen:
        return f"{more} more through landmark {number} than point {without} without it: fails {falls}"
    return f"{more} more through landmark {number}, point {through} of the front: fails {falls}"
