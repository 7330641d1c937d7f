"""What other paths of the front would give, and why a plan turns or comes back in a region, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from pareto_ltl import Scene
from pareto_ltl.extend import Front, Plan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, flights_text
from pareto_ltl_apps.view.limits import chosen_number

SHORTER = (
    0.10,
    0.03,
)  # shares of the length of the plan by which a path is worth naming, the first that has one
COMPARED = "in the winds in which paths are compared"  # the promise of a plan has other winds
HALF_TURN = 180.0  # [deg] of all turns in a region that are a loop


def trade_lines(scene: Scene, front: Front, plan: Plan) -> Iterator[str]:
    """The best shorter and the best longer path of the front, and the reason of loops.

    All rates come from the front, in the same winds. Nothing where bounds judge, or without the front.
    """
    chosen = chosen_number(front, plan)
    if chosen is None or not front.rates:
        return
    lengths = np.array([path.objectives.length for path in front.paths])
    rates = np.array([rate.failure for rate in front.rates])
    here, now = float(lengths[chosen]), float(rates[chosen])
    floor = 0.0 if plan.promise is None else plan.promise.floor
    rates = np.maximum(rates, floor)  # the data of the law cannot tell lower ones apart
    found = (np.flatnonzero(lengths <= (1.0 - share) * here) for share in SHORTER)
    shorter = next((some for some in found if len(some)), np.empty(0, int))
    if len(shorter):
        k = int(shorter[np.argmin(rates[shorter])])
        less = f"{distance_text(here - float(lengths[k]))} ({100.0 * (1.0 - lengths[k] / here):.0f} %)"
        yield f"Point {k} is {less} shorter: {_instead(front, k, chosen, floor)}"
    longer = np.flatnonzero((lengths > here) & (rates < max(now, floor)))
    if len(longer):
        k = int(longer[np.argmin(rates[longer])])
        more = distance_text(float(lengths[k]) - here)
        yield f"Point {k} is {more} longer: {_instead(front, k, chosen, floor)}"
    yield from _loop_lines(scene, front, chosen, lengths, rates, floor)


def _instead(front: Front, other: int, chosen: int, floor: float) -> str:
    """``4.1 instead of 3.1 of 100 flights fail, ...``; of rates below the floor, what can be said of them."""
    one, two = (_share(front, k, floor) for k in (other, chosen))
    if one == two:
        return f"{one} fail, as of the plan"
    count, _, whole = one.partition(" of ")
    return f"{count if whole == two.partition(' of ')[2] else one} instead of {two} fail, {COMPARED}"


def _share(front: Front, k: int, floor: float) -> str:
    rate = front.rates[k]
    if rate.failure < floor:
        return f"fewer than {flights_text(floor, floor, floor)[0]}"
    return flights_text(rate.failure, rate.low, rate.high)[0]


def _loop_lines(
    scene: Scene, front: Front, chosen: int, lengths: FloatArray, rates: FloatArray, floor: float
) -> Iterator[str]:
    """Why the plan turns in a region or comes back to it: the safest path that does not is less safe."""
    names = looped_regions(scene, front.paths[chosen].x)
    plain = [k for k, path in enumerate(front.paths) if not looped_regions(scene, path.x)]
    if not names or not plain:
        return
    best = min(plain, key=lambda k: float(rates[k]))
    if rates[best] > rates[chosen]:
        where = " and ".join(names)
        yield (
            f"It turns in {where}, so that more flights meet it: {_share(front, chosen, floor)} fail; of the "
            f"safest path without that (point {best}, {distance_text(float(lengths[best]))}) "
            f"{_share(front, best, floor)}"
        )


def looped_regions(scene: Scene, x: FloatArray) -> list[str]:
    """Names of regions that the path ``x`` (T+1, 2) [m] enters twice, or turns in by 180 degrees or more."""
    found = []
    step = np.diff(x, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turns = np.append(0.0, np.append(np.abs(np.diff(heading)), 0.0))  # at each position
    for name, outlines in scene.regions.items():
        if name in scene.forbidden or not outlines:
            continue
        area = shapely.union_all([shapely.Polygon(outline).buffer(0.0) for outline in outlines])
        inside = shapely.contains_xy(area, x)
        entries = int(inside[0]) + int((inside[1:] & ~inside[:-1]).sum())
        if entries > 1 or np.rad2deg(turns[inside].sum()) >= HALF_TURN:
            found.append(name)
    return found
