"""The limits of a plan: rows on its segments and on the prices of its limits, for text, page and figure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pareto_ltl.planning.costs import PRICE_KINDS, Price
from pareto_ltl.planning.records import Plan
from pareto_ltl.report.legs import step_times
from pareto_ltl.support.display import SLOW, probability_text
from pareto_ltl.support.medium import AIR, Medium
from pareto_ltl.world.scene import Scene

MOST = 5  # segments and prices that are listed
FINE = 2e-3  # largest change of an outline that a price is given for, as a share of the map's size
KM_H = 1 / 3.6  # [m/s] the change of airspeed that its price is given for
SLOW_CHANGE = 0.03  # largest such change of a slow robot, as a share of its speed
TIGHT_PRICE = 0.05  # least price of a tight place, as a share of the largest price of a segment
TIGHT_RISK = 0.1  # or least collision probability of a tight place, as a share of epsilon
NO_SEGMENTS = "no segment is limited: the map has neither obstacles nor walls"
NO_PRICES = "no prices: no flight comes near to failing, all are the same, or the plan is an earlier one"


@dataclass(frozen=True, slots=True)
class SegmentRow:
    """The chance constraint of the segment ``step``: its times, closest barrier and collision probability."""

    step: int
    begin: str
    end: str
    barrier: str
    deviations: float
    probability: float


@dataclass(frozen=True, slots=True)
class PriceRow:
    """The price of a limit in words.

    Attributes
    ----------
    limit, change : str
        For example ``obstacle 6`` and ``1 km smaller on every side``.
    time : str
        When the saving is largest; empty for the whole flight.
    saving, error : float
        Fall of the failure rate by the change, and its standard error.
    """

    kind: str
    limit: str
    time: str
    change: str
    saving: float
    error: float


def segment_rows(scene: Scene, plan: Plan, most: int = MOST) -> list[SegmentRow]:
    """The ``most`` segments that come closest to ``planner.epsilon``, the closest first."""
    limits, times = plan.limits, step_times(scene, plan.path)
    if limits is None:
        return []
    return [
        SegmentRow(
            k, times[k], times[k + 1], scene.barrier_title(limits.nearest[k]), float(limits.deviations[k]),
            float(limits.probability[k]),
        )
        for k in np.argsort(-limits.probability, kind="stable")[:most].tolist()
    ]  # fmt: skip


def price_rows(scene: Scene, plan: Plan, most: int | None = None, medium: Medium = AIR) -> list[PriceRow]:
    """The ``most`` prices with the largest savings by a small change, the largest first; default all.

    Prices with a standard error above a quarter of the price are left out.
    """
    times, unit = step_times(scene, plan.path), small_change(scene)
    faster, faster_text = speed_change(plan.u_max)
    rows = [
        PriceRow(
            kind=price.kind,
            limit=_limit_text(scene, price, medium),
            time="" if price.step is None else times[price.step],
            change=PRICE_KINDS[price.kind].format(
                faster_text if price.kind == "airspeed" else metres_text(unit)
            ),
            saving=saving_of(price, unit, faster),
            error=saving_of(replace(price, saving=price.error), unit, faster),
        )
        for price in plan.prices
        if price.significant
    ]
    return sorted(rows, key=lambda row: -row.saving)[:most]


def small_change(scene: Scene) -> float:
    """The largest power of ten [m] of at most ``FINE`` of the map's size."""
    return float(10.0 ** math.floor(math.log10(FINE * float(np.ptp(scene.bounds, axis=0).mean()))))


def speed_change(u_max: float) -> tuple[float, str]:
    """The change of ``u_max`` [m/s] that its price is given for, and its text.

    1 km/h; for a slow robot the largest power of ten of at most ``SLOW_CHANGE`` of its speed, in m/s.
    """
    if u_max >= SLOW:
        return KM_H, "1 km/h"
    change = 10.0 ** math.floor(math.log10(SLOW_CHANGE * u_max))
    return change, f"{change:g} m/s"


def saving_of(price: Price, unit: float, faster: float = KM_H) -> float:
    """Failures saved by a change of ``unit`` [m], or of ``faster`` [m/s]."""
    return price.saving * (faster if price.kind == "airspeed" else unit)


def _limit_text(scene: Scene, price: Price, medium: Medium) -> str:
    if price.kind == "airspeed":
        return price.name.replace(AIR.speed, medium.speed)
    of_region = price.kind in ("region", "avoided")
    return f"region {price.name}" if of_region else scene.barrier_title(price.name)


def metres_text(metres: float) -> str:
    """A small change of an outline: ``1 km`` or ``10 m``."""
    return f"{metres / 1e3:g} km" if metres >= 1e3 else f"{metres:g} m"


def points_text(saving: float) -> str:
    """A fall of the failure rate in percentage points: ``0.27``."""
    return probability_text(saving).removesuffix(" %")


def epsilon_text(plan: Plan) -> str:
    """``5.0 %``, or ``no limit``."""
    return "no limit" if plan.epsilon >= 1.0 else probability_text(plan.epsilon)


def priced_obstacles(plan: Plan) -> list[int]:
    """Numbers of the obstacles that have a price to show; the first of the map has the number 1."""
    shown = (price for price in plan.prices if price.kind == "obstacle" and price.significant)
    return [int(price.name.removeprefix("obstacle ")) for price in shown]


# --- text ---------------------------------------------------------------------------------------


def limit_lines(scene: Scene, plan: Plan, most: int = MOST, medium: Medium = AIR) -> Iterator[str]:
    """Lines on the ``most`` segments that come closest to ``planner.epsilon``, then on the largest prices."""
    law = f"{plan.models.law} {medium.flows}"
    segments, prices = segment_rows(scene, plan, most), price_rows(scene, plan, most, medium)
    if not segments:
        yield NO_SEGMENTS
    else:
        allowed = epsilon_text(plan) + " allowed" * (plan.epsilon < 1.0)
        yield (
            f"collision probability of a segment, {law}, {allowed} (planner.epsilon); at most "
            f"{probability_text(segments[0].probability)}"
        )
        for row in segments:
            yield (
                f"{row.step:>4}  {row.begin} - {row.end}; {row.barrier}, {row.deviations:.1f} "
                f"standard deviations away; {probability_text(row.probability)}"
            )
    yield ""
    unsure = unsure_text(plan)
    if not prices:
        yield unsure or NO_PRICES
        return
    failing = "" if plan.promise is None else f" of the {probability_text(plan.promise.rate.failure)}"
    others = "the others as they are"
    yield f"what a small change of a limit would save{failing} failures in {law}, {others}:"
    for price in prices:
        at = f" at {price.time}" if price.time else ""
        yield f"      {price.limit}{at}: {price.change}, {points_text(price.saving)} points fewer failures"
    if unsure:
        yield unsure


def unsure_text(plan: Plan) -> str:
    """How many prices are not shown, since too few flights come near to these limits; empty if all are."""
    number = sum(not price.significant for price in plan.prices)
    if not number:
        return ""
    return f"not shown, with a standard error above a quarter of the price: {number} of {len(plan.prices)}"


# --- places on the map --------------------------------------------------------------------------


def tight_places(scene: Scene, plan: Plan, medium: Medium = AIR) -> list[tuple[int, list[str]]]:
    """The segments whose price or collision probability is large: their step, and lines of text on them."""
    limits, law = plan.limits, f"{plan.models.law} {medium.flows}"
    if limits is None:
        return []
    times, unit, largest = step_times(scene, plan.path), small_change(scene), float(limits.price.max())
    priced = limits.price > TIGHT_PRICE * largest
    places = []
    for k in np.flatnonzero(priced | (limits.probability > TIGHT_RISK * plan.epsilon)).tolist():
        limit = "" if plan.epsilon >= 1.0 else f" of at most {epsilon_text(plan)}"
        risk = probability_text(float(limits.probability[k]))
        barrier = scene.barrier_title(limits.nearest[k])
        lines = [f"{barrier}, {times[k]} to {times[k + 1]}", f"collides {risk}{limit}, {law}"]
        if priced[k]:
            saved = points_text(float(limits.price[k]) * unit)
            lines.append(f"all barriers {metres_text(unit)} farther: {saved} points fewer failures")
        places.append((k, lines))
    return places
