"""A plan as text, leg by leg, for a terminal: goal of each leg, closest obstacle, and failure rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pareto_ltl.exports.geojson import border_corners
from pareto_ltl.exports.navigation_log import NavigationLog, expected_winds, navigation_log
from pareto_ltl.logic.automaton import show_letter
from pareto_ltl.logic.in_words import mission_in_words
from pareto_ltl.logic.timed import places_of
from pareto_ltl.planning.costs import cost_named
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import FailureRate, Plan, PlannedPath, counted_rate
from pareto_ltl.simulation.failure_times import failure_times
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, probability_text, rate_text
from pareto_ltl.world.navigation import utc_times
from pareto_ltl.world.scene import Scene

FAR = 99.0  # standard deviations; larger clearances are shown as "over 99 sd"


@dataclass(frozen=True, slots=True)
class Clearance:
    """The barrier nearest to a leg in standard deviations: its name, distance [m], and distance in sd."""

    name: str
    metres: float
    deviations: float

    def __str__(self) -> str:
        sd = f"{self.deviations:.1f} sd" if self.deviations < FAR else f"over {FAR:.0f} sd"
        return f"{self.name} at {distance_text(self.metres)} = {sd}"


def closest_barriers(scene: Scene, path: PlannedPath) -> list[Clearance | None]:
    """For each leg the obstacle, or the side of a walled border, that is nearest in standard deviations.

    With a on the leg and b on the barrier at their smallest distance, and n the direction from a to b,

        clearance = |b - a| / √(n' Σ(a) n),

    where Σ(a) is interpolated between the covariances at both ends of the leg. None without barriers.
    """
    import shapely

    names = [scene.obstacle_title(n) for n in range(1, len(scene.obstacles) + 1)]
    shapes: list[shapely.Geometry] = [shapely.Polygon(corners) for corners in scene.obstacles]
    if scene.walled:
        corners = border_corners(scene.bounds)
        names += [f"the {side} border" for side in ("southern", "eastern", "northern", "western")]
        shapes += [shapely.LineString([corners[k], corners[(k + 1) % 4]]) for k in range(4)]
    if not shapes:
        return [None] * len(path.u)
    barriers, found = np.array(shapes, object), list[Clearance | None]()
    for k, (start, end) in enumerate(pairwise(path.x)):
        lines = shapely.shortest_line(shapely.LineString([start, end]), barriers)
        ends = shapely.get_coordinates(lines).reshape(-1, 2, 2)
        metres, deviations = _clearances(ends, start, end, path.cov[k : k + 2])
        nearest = int(np.lexsort((metres, deviations))[0])
        found.append(Clearance(names[nearest], float(metres[nearest]), float(deviations[nearest])))
    return found


def _clearances(
    ends: FloatArray, start: FloatArray, end: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distances [m] and clearances in standard deviations, (N,), of shortest lines ``ends`` (N, 2, 2)."""
    gap = ends[:, 1] - ends[:, 0]
    metres = np.hypot(gap[:, 0], gap[:, 1])
    leg = max(float(np.hypot(*(end - start))), 1e-12)
    share = np.clip(np.hypot(*(ends[:, 0] - start).T) / leg, 0.0, 1.0)[:, None, None]
    there = (1.0 - share) * cov[0] + share * cov[1]
    toward = gap / np.maximum(metres, 1e-12)[:, None]
    sd = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", toward, there, toward), 0.0))
    return metres, np.where(metres > 0.0, metres / np.maximum(sd, 1e-12), 0.0)


def plan_lines(problem: Problem, plan: Plan, flown: Deployment) -> Iterator[str]:
    """Lines of text: mission, the legs towards each goal, what is promised and what is not covered.

    ``flown`` are simulated flights of the plan; every probability is given with its wind law.
    """
    path, scene = plan.path, problem.scene
    words = mission_in_words(plan.formula)
    yield f"mission: {words or plan.formula}" + (f"   [{plan.formula}]" if words else "")
    yield (
        f"plan: {distance_text(path.objectives.length)} in {float(path.t[-1] - path.t[0]) / 3600:.2f} h, "
        f"{len(path.u)} legs, airspeed {plan.u_min:g} to {plan.u_max:g} m/s"
        + "".join(f", {cost_named(name).text(cost)}" for name, cost in path.objectives.further_costs.items())
        + (f", departure {utc[0]}" if (utc := utc_times(scene.time_zero, path.t)) else "")
    )
    yield (
        f"failed: share of {len(flown.x):,} simulated flights that have failed by the end of the leg, "
        f"{flown.law} winds"
    )
    yield f"sd: standard deviation of the position, and of the wind, {problem.fidelity.law} winds"
    courses = _courses(problem, path)
    failed = failure_times(problem, flown).counts().sum(axis=0) / len(flown.x)
    near, times = closest_barriers(scene, path), step_times(scene, path)
    for first, last in _stretches(path):
        yield ""
        yield _goal_line(problem, path, first, last)
        for k in range(first, last):
            told = [f"{k:>4}  {times[k]} - {times[k + 1]}", courses[k]]
            told += [str(near[k])] if near[k] is not None else []
            told += [f"failed {probability_text(float(failed[k + 1]))}"]
            told += ["position fix at its end"] if k + 1 in path.fixes else []
            yield "; ".join(told)
    yield ""
    yield from _promise_lines(plan, flown)


def step_times(scene: Scene, path: PlannedPath) -> list[str]:
    """The time of every step for people: UTC, or hours since departure."""
    utc = utc_times(scene.time_zero, path.t)
    if utc is None:
        return [f"{t / 3600:.2f} h" for t in path.t]
    day = utc[0][:10]  # of the departure; shown only where it changes
    return [f"{time[11:16]}Z" if time[:10] == day else f"{time[5:10]} {time[11:16]}Z" for time in utc]


def _stretches(path: PlannedPath) -> list[tuple[int, int]]:
    """Legs (first, last + 1) of each stretch, which ends where the automaton state changes."""
    changes = np.flatnonzero(np.diff(path.q)) + 1
    ends = sorted({0, *changes.tolist(), len(path.u)})
    return list(pairwise(ends))


def _goal_line(problem: Problem, path: PlannedPath, first: int, last: int) -> str:
    """The heading of the legs ``first`` to ``last`` - 1: their goal and the change of state."""
    before, after = int(path.q[first]), int(path.q[last])
    if before == after:
        done = problem.automaton.distance[before] == 0.0
        return f"{'after the mission is complete' if done else 'onward'}: state {before}"
    letter = places_of(path.label[last], problem.automaton.windows) & frozenset(problem.atoms)
    end = ", which completes the mission" if problem.automaton.distance[after] == 0.0 else ""
    return f"to {show_letter(letter)}: state {before} to {after} of {problem.automaton.n_states}{end}"


def _courses(problem: Problem, path: PlannedPath) -> list[str]:
    """Heading, airspeed and expected wind of each leg; on a map without a place there are no directions."""
    if problem.scene.crs is None:
        wind, variance = expected_winds(problem, path)
        columns = zip(np.hypot(*path.u.T), np.hypot(*wind.T), np.sqrt(variance.mean(axis=1)), strict=True)
        return [f"{air:.1f} m/s; wind {speed:.1f} m/s (sd {sd:.1f})" for air, speed, sd in columns]
    log = navigation_log(problem, path)
    return [_true_course(log, k) for k in range(len(path.u))]


def _true_course(log: NavigationLog, k: int) -> str:
    heading = "drifting" if np.isnan(log.heading[k]) else f"heading {log.heading[k] % 360.0:05.1f} true"
    return (
        f"{heading}, {log.airspeed[k]:.1f} m/s; wind {log.wind_speed[k]:.1f} m/s from "
        f"{log.wind_from[k]:03.0f} (sd {log.wind_sd[k]:.1f})"
    )


def _promise_lines(plan: Plan, flown: Deployment) -> Iterator[str]:
    """Promised rate, simulated rate, bound, and what the probabilities cover and do not cover."""
    cost, models, promise = plan.path.objectives, plan.models, plan.promise
    if promise is not None:
        yield f"promised: fails {_rate_words(promise.rate)}"
    yield f"simulated: fails {_rate_words(counted_rate(flown.law, int(flown.failed.sum()), len(flown.x)))}"
    bound = min(1.0, cost.mission_risk + cost.collision_risk)
    yield f"bound {models.mission_symbol} + R: {probability_text(bound)}, {models.law} winds"
    for name, text in (("covered", plan.covered), ("not covered", plan.not_covered)):
        if text:
            yield f"{name}: {text}"


def _rate_words(rate: FailureRate) -> str:
    return f"{rate_text(rate.failure, rate.low, rate.high)} of {rate.sample}, {rate.law} winds"
