"""The limits of a plan: rows on its segments and on the prices of its limits, for text, page and figure.

And how much a detour through a landmark helps: points of the front that cross it, and points that do not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from careful_io.texts import SLOW, distance_text, probability_text
from flight_quantities.medium import AIR, Medium
from pareto_ltl import Scene
from pareto_ltl.extend import Front, Plan, Price
from pareto_ltl.support.display import allowed_text
from pareto_ltl_apps.view.legs import step_times

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


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """The limits of a plan on its map, in the words of what the robot moves in."""

    scene: Scene
    plan: Plan
    medium: Medium

    @property
    def law(self) -> str:
        """The wind law of all probabilities: ``coherent winds``."""
        return f"{self.plan.models.law} {self.medium.flows}"

    def segments(self, limit: int = MOST) -> list[SegmentRow]:
        """The ``limit`` segments that come closest to ``planner.epsilon``, the closest first."""
        limits, times = self.plan.limits, step_times(self.scene, self.plan.path)
        if limits is None:
            return []
        return [
            SegmentRow(
                k, times[k], times[k + 1], self.scene.barrier_title(limits.nearest[k]),
                float(limits.deviations[k]), float(limits.probability[k]),
            )
            for k in np.argsort(-limits.probability, kind="stable")[:limit].tolist()
        ]  # fmt: skip

    def prices(self, largest: int | None = None) -> list[PriceRow]:
        """The ``largest`` prices with the largest savings by a small change, the largest first; default all.

        Prices with a standard error above a quarter of the price are left out.
        """
        times, unit = step_times(self.scene, self.plan.path), small_change(self.scene)
        faster, faster_text = speed_change(self.plan.u_max)
        rows = [
            PriceRow(
                kind=price.kind,
                limit=self._limit_text(price),
                time="" if price.step is None else times[price.step],
                change=price.change.format(faster_text if price.kind == "airspeed" else metres_text(unit)),
                saving=saving_of(price, unit, faster),
                error=saving_of(replace(price, saving=price.error), unit, faster),
            )
            for price in self.plan.prices
            if price.significant
        ]
        return sorted(rows, key=lambda row: -row.saving)[:largest]

    def _limit_text(self, price: Price) -> str:
        if price.kind == "airspeed":
            return price.name.replace(AIR.speed, self.medium.speed)
        of_region = price.kind in ("region", "avoided")
        return f"region {price.name}" if of_region else self.scene.barrier_title(price.name)

    def unsure(self) -> str:
        """How many prices are not shown, since too few flights come near to their limits; empty for 0."""
        number = sum(not price.significant for price in self.plan.prices)
        text = "not shown, with a standard error above a quarter of the price"
        return f"{text}: {number} of {len(self.plan.prices)}" if number else ""

    def lines(self, largest: int = MOST) -> Iterator[str]:
        """Lines on the ``largest`` segments closest to ``planner.epsilon``, then on the largest prices."""
        plan, segments, prices = self.plan, self.segments(largest), self.prices(largest)
        if not segments:
            yield NO_SEGMENTS
        else:
            closest = allowed_text(segments[0].probability, plan.epsilon)
            yield f"largest collision probability of a segment, {self.law}: {closest} (planner.epsilon)"
            yield from self.breach()
            for row in segments:
                yield (
                    f"{row.step:>4}  {row.begin} - {row.end}; {row.barrier}, {row.deviations:.1f} "
                    f"standard deviations away; {probability_text(row.probability)}"
                )
        yield ""
        unsure = self.unsure()
        if not prices:
            yield unsure or NO_PRICES
            return
        failing = "" if plan.promise is None else f" of the {probability_text(plan.promise.rate.failure)}"
        others = "the others as they are"
        yield f"what a small change of a limit would save{failing} failures in {self.law}, {others}:"
        for price in prices:
            at = f" at {price.time}" if price.time else ""
            saved = points_text(price.saving)
            yield f"      {price.limit}{at}: {price.change}, {saved} points fewer failures"
        if unsure:
            yield unsure

    def breach(self) -> Iterator[str]:
        """Sentences on a plan that breaks ``planner.epsilon``, and the changes that help a plan."""
        if not self.plan.epsilon_kept and self.plan.worst is not None:
            yield self.plan.breach(self.scene)
        for remedy in self.plan.remedies:
            worst, fails = map(probability_text, (remedy.worst_segment_probability, remedy.failure))
            yield f"tried: {remedy.change}: worst segment {worst}, fails {fails}"

    def tables(self) -> dict[str, Any]:
        """Rows of both tables of a page, and the texts around them."""
        plan = self.plan
        return {
            "fails": "" if plan.promise is None else probability_text(plan.promise.rate.failure),
            "tight_price": probability_text(TIGHT_PRICE),
            "tight_risk": probability_text(TIGHT_RISK * plan.epsilon),
            "no_prices": self.unsure() or NO_PRICES,
            "unsure": self.unsure(),
            "no_segments": NO_SEGMENTS,
            "breach": "" if plan.epsilon_kept or plan.worst is None else plan.breach(self.scene),
            "remedies": [
                {
                    "change": remedy.change, "worst": probability_text(remedy.worst_segment_probability),
                    "fails": probability_text(remedy.failure), "runs": f"{remedy.runs:,}",
                }
                for remedy in plan.remedies
            ],
            "prices": [
                {
                    "limit": row.limit, "time": row.time or "–", "change": row.change,
                    "saved": points_text(row.saving),
                }
                for row in self.prices()
            ],
            "segments": [
                {
                    "time": f"{row.begin}\u00a0– {row.end}", "barrier": row.barrier,
                    "deviations": f"{row.deviations:.1f}", "probability": probability_text(row.probability),
                    "allowed": epsilon_text(plan),
                }
                for row in self.segments()
            ],
        }  # fmt: skip

    def places(self) -> list[dict[str, Any]]:
        """Segments whose price or collision probability is large: the step, and lines of text for each."""
        plan, limits = self.plan, self.plan.limits
        if limits is None:
            return []
        times, unit = step_times(self.scene, plan.path), small_change(self.scene)
        priced = limits.price > TIGHT_PRICE * float(limits.price.max())
        places = []
        for k in np.flatnonzero(priced | (limits.probability > TIGHT_RISK * plan.epsilon)).tolist():
            risk = allowed_text(float(limits.probability[k]), plan.epsilon)
            barrier = self.scene.barrier_title(limits.nearest[k])
            lines = [f"{barrier}, {times[k]} to {times[k + 1]}", f"collides {risk}, {self.law}"]
            if priced[k]:
                saved = points_text(float(limits.price[k]) * unit)
                lines.append(f"all barriers {metres_text(unit)} farther: {saved} points fewer failures")
            places.append({"step": k, "lines": lines})
        return places


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


# --- detours -------------------------------------------------------------------------------------


def chosen_number(front: Front | None, plan: Plan | None) -> int | None:
    """The index of the plan in the front; None without a plan, or if the front does not contain it."""
    if plan is None or front is None:
        return None
    same = (k for k, path in enumerate(front.paths) if np.array_equal(path.x, plan.path.x))
    return next(same, None)


def detour_lines(scene: Scene, front: Front, plan: Plan) -> list[str]:
    """A sentence for each landmark that some points of the front cross and others do not.

    The plan is compared with the safest path of the other kind: if the plan crosses the landmark, among the
    paths that are no longer than the plan, else among the longer ones. Both rates are taken from the front,
    in the same winds. There is no sentence where the longer path is not the safer one.
    """
    import shapely

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
            more = distance_text(float(lengths[through] - lengths[without]))
            other_one = f", point {through} of the front"
            than = f" than point {without} without it" if through == chosen else other_one
            falls = f"{probability_text(float(rates[without]))} -> {probability_text(float(rates[through]))}"
            lines.append(f"{more} more through landmark {number}{than}: fails {falls}")
    return lines
