"""What limits a plan, in words: the segments closest to their chance constraint, and the prices of limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pareto_ltl.planning.limits import PRICE_KINDS, Price
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Plan
from pareto_ltl.report.legs import step_times
from pareto_ltl.support.display import probability_text
from pareto_ltl.world.scene import Scene

MOST = 5  # segments and prices that are listed
FINE = 2e-3  # largest change of an outline that a price is given for, as a share of the map's size
KM_H = 1 / 3.6  # [m/s] the change of airspeed that its price is given for


def limit_lines(problem: Problem, plan: Plan, most: int = MOST) -> Iterator[str]:
    """Lines on the ``most`` segments that come closest to ``planner.epsilon``, then on the largest prices."""
    limits, law = plan.limits, problem.fidelity.law
    times = step_times(problem.scene, plan.path)
    if limits is None:
        yield "no segment is limited: the map has neither obstacles nor walls"
    else:
        allowed = "no limit" if plan.epsilon >= 1.0 else f"{probability_text(plan.epsilon)} allowed"
        yield (
            f"collision probability of a segment, {law} winds, {allowed} (planner.epsilon); at most "
            f"{probability_text(float(limits.probability.max()))}"
        )
        for k in np.argsort(-limits.probability, kind="stable")[:most].tolist():
            yield (
                f"{k:>4}  {times[k]} - {times[k + 1]}; {limits.nearest[k]}, {limits.deviations[k]:.1f} "
                f"standard deviations away; {probability_text(float(limits.probability[k]))}"
            )
    yield ""
    rows = price_rows(problem.scene, plan)[:most]
    if not rows:
        yield "no prices: no flight comes near to failing, or the plan is of an earlier version"
        return
    failing = "" if plan.promise is None else f" of the {probability_text(plan.promise.rate.failure)}"
    yield f"what a small change of a limit would save{failing} failures in {law} winds, with the same length:"
    yield from (f"      {row}" for row in rows)


def price_rows(scene: Scene, plan: Plan) -> list[str]:
    """One line for each price, in the unit of a small change, the largest saving first."""
    times, unit = step_times(scene, plan.path), small_change(scene)
    savings = [(price, saving_of(price, unit)) for price in plan.prices]
    savings.sort(key=lambda pair: -pair[1])
    return [_row(price, saving, unit, times) for price, saving in savings]


def small_change(scene: Scene) -> float:
    """The largest power of ten [m] of at most ``FINE`` of the map's size."""
    return float(10.0 ** math.floor(math.log10(FINE * float(np.ptp(scene.bounds, axis=0).mean()))))


def saving_of(price: Price, unit: float) -> float:
    """Failures saved by a change of ``unit`` [m], or of one km/h."""
    return price.saving * (KM_H if price.kind == "airspeed" else unit)


def _row(price: Price, saving: float, unit: float, times: list[str]) -> str:
    change = "1 km/h" if price.kind == "airspeed" else f"{unit / 1e3:g} km" if unit >= 1e3 else f"{unit:g} m"
    subject = f"region {price.name}" if price.kind in ("region", "avoided") else price.name
    at = "" if price.step is None else f" at {times[price.step]}"
    return (
        f"{subject}{at}: {PRICE_KINDS[price.kind].format(change)}, {100.0 * saving:.2g} points fewer failures"
    )
