"""A plan as text, leg by leg, for a terminal: goal of each leg, closest obstacle, and failure rate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from careful_io.texts import distance_text, probability_text, rate_text, speed_digits
from flight_quantities.medium import WATER, Medium
from pareto_ltl import Scene
from pareto_ltl.extend import Deployment, FailureRate, Plan, PlannedPath, Problem, cost_named, show_letter
from pareto_ltl.logic.timed import places_of
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.exported import height_sentence
from pareto_ltl_apps.exports.geojson import border_corners
from pareto_ltl_apps.exports.navigation_log import expected_winds, navigation_log
from pareto_ltl_apps.view.in_words import mission_in_words

FAR = 99.0  # standard deviations; larger clearances are shown as "over 99 sd"
ONE_HEADING = 3.0  # degrees; legs of a group have headings that differ less from the first one's
ONE_AIRSPEED = 0.5  # [m/s] and airspeeds that differ by at most this and a tenth


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


@dataclass(frozen=True, slots=True)
class Leg:
    """One step of a plan, as it is flown.

    Attributes
    ----------
    number : int
        The step, from 0.
    begin, end : str
        Times in UTC, or in hours since departure.
    heading_true, wind_from : float
        Directions in degrees; NaN where the robot drifts, and on a map without a place on Earth.
    airspeed, wind, wind_sd : float
        True airspeed and speed of the expected wind, standard deviation of a component of the wind [m/s].
    calibrated : float
        Calibrated airspeed, which an autopilot holds [m/s]; NaN in the water.
    closest : Clearance or None
        The nearest barrier; None without barriers.
    failed : float
        Share of the simulated flights that have failed by the end of the leg.
    fix : bool
        A position fix is possible at its end.
    """

    number: int
    begin: str
    end: str
    heading_true: float
    airspeed: float
    wind: float
    wind_from: float
    wind_sd: float
    calibrated: float
    closest: Clearance | None
    failed: float
    fix: bool


def plan_legs(problem: Problem, plan: Plan, flown: Deployment) -> list[Leg]:
    """The legs of a plan; ``flown`` are simulated flights of it."""
    path, scene = plan.path, problem.scene
    factor = math.nan if plan.air is None else math.sqrt(plan.air.density_ratio)
    failed = flown.failure_times(problem).counts().sum(axis=0) / len(flown.x)
    near, times = closest_barriers(scene, path), step_times(scene, path)
    return [
        Leg(
            k,
            times[k],
            times[k + 1],
            *course,
            factor * course[1],
            near[k],
            float(failed[k + 1]),
            k + 1 in path.fixes,
        )
        for k, course in enumerate(_courses(problem, path))
    ]


def plan_lines(
    problem: Problem,
    plan: Plan,
    flown: Deployment,
    legs: Sequence[Leg],
    medium: Medium,
    *,
    each: bool = False,
) -> Iterator[str]:
    """Lines of text: mission, height, legs towards each goal, the promise and the errors that it leaves out.

    ``flown`` are simulated flights of the plan, ``legs`` come from :func:`plan_legs`; every probability is
    given with its wind law. Successive legs of one heading and airspeed share a line, or with ``each`` have
    one line each.
    """
    path, scene = plan.path, problem.scene
    words, flows, utc = mission_in_words(plan.formula), medium.flows, scene.frame.utc(path.t)
    yield f"mission: {words or plan.formula}" + (f"   [{plan.formula}]" if words else "")
    yield (
        f"plan: {distance_text(path.objectives.length)} in {float(path.t[-1] - path.t[0]) / 3600:.2f} h, "
        f"{len(path.u)} legs, {medium.speed} {plan.u_min:g} to {plan.u_max:g} m/s"
        + "".join(f", {cost_named(name).text(cost)}" for name, cost in path.objectives.further_costs.items())
        + (f", departure {utc[0]}" if utc else "")
    )
    if plan.height is not None:
        yield height_sentence(plan.height, plan.air, medium)
    failed = "simulated flights that have failed by the end of the leg"
    yield f"failed: share of {len(flown.x):,} {failed}, {flown.law} {flows}"
    sd = f"standard deviation of the position, and of the {medium.flow}"
    yield f"sd: {sd}, {problem.fidelity.law} {flows}"
    for first, last in _stretches(path):
        yield ""
        yield _goal_line(problem, path, first, last)
        groups = ([leg] for leg in legs[first:last]) if each else of_one_heading(legs[first:last])
        for group in groups:
            yield _legs_line(group, medium)
    yield ""
    yield from _promise_lines(plan, flown, medium)


def of_one_heading(legs: Sequence[Leg]) -> list[list[Leg]]:
    """Successive legs in groups of about one heading and airspeed; a position fix ends a group."""
    groups = list[list[Leg]]()
    for leg in legs:
        if groups and not groups[-1][-1].fix and _like(groups[-1][0], leg):
            groups[-1].append(leg)
        else:
            groups.append([leg])
    return groups


def _like(one: Leg, other: Leg) -> bool:
    turn = abs((one.heading_true - other.heading_true + 180.0) % 360.0 - 180.0)
    alike = min(ONE_AIRSPEED, 0.1 * max(one.airspeed, other.airspeed))
    return turn < ONE_HEADING and abs(one.airspeed - other.airspeed) <= alike


def _legs_line(legs: Sequence[Leg], medium: Medium) -> str:
    """The line of one or several legs of one heading: mean course and wind, and what is closest."""
    first, last = legs[0], legs[-1]
    number = f"{first.number}" if len(legs) == 1 else f"{first.number}-{last.number}"
    words = [f"{number:>7}  {first.begin} - {last.end}", _course_text(legs, medium)]
    near = [leg.closest for leg in legs if leg.closest is not None]
    words += [str(min(near, key=lambda one: one.deviations))] if near else []
    words += [f"failed {probability_text(last.failed)}"]
    words += ["position fix at its end"] if last.fix else []
    return "; ".join(words)


def _course_text(legs: Sequence[Leg], medium: Medium) -> str:
    """Mean heading, airspeed and expected wind; on a map without a place there are no directions."""
    means = np.mean([(leg.airspeed, leg.wind, leg.wind_sd) for leg in legs], axis=0).tolist()
    digits = speed_digits(max(means[:2]))
    air, wind, sd = (f"{mean:.{digits}f}" for mean in means)
    held = float(np.mean([leg.calibrated for leg in legs]))
    speed = f"{air} m/s" if math.isnan(held) else f"{air} m/s true ({held:.{digits}f} calibrated)"
    if np.isnan(legs[0].wind_from):
        return f"{speed}; {medium.flow} {wind} m/s (sd {sd})"
    heading, source = map(_mean_angle, zip(*((leg.heading_true, leg.wind_from) for leg in legs), strict=True))
    course = "drifting" if np.isnan(heading) else f"heading {heading:05.1f} true"
    toward = f"sets to {(source + 180.0) % 360.0:03.0f}" if medium is WATER else f"from {source:03.0f}"
    return f"{course}, {speed}; {medium.flow} {wind} m/s {toward} (sd {sd})"


def _mean_angle(degrees: Sequence[float]) -> float:
    """The circular mean in [0, 360)."""
    turns = np.exp(1j * np.radians(degrees)).mean()
    return float(np.degrees(np.angle(turns)) % 360.0)


def step_times(scene: Scene, path: PlannedPath) -> list[str]:
    """The time of every step for people: UTC, or hours since departure."""
    utc = scene.frame.utc(path.t)
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


def _courses(problem: Problem, path: PlannedPath) -> list[tuple[float, float, float, float, float]]:
    """Heading, airspeed, wind speed, direction that the wind comes from, and sd of the wind, of each leg."""
    if problem.scene.crs is None:
        wind, variance = expected_winds(problem, path)
        unknown = np.full(len(path.u), np.nan)
        columns = unknown, np.hypot(*path.u.T), np.hypot(*wind.T), unknown, np.sqrt(variance.mean(axis=1))
    else:
        log = navigation_log(problem, path)
        columns = log.heading, log.airspeed, log.wind_speed, log.wind_from, log.wind_sd
    return list(zip(*(column.tolist() for column in columns), strict=True))


def _promise_lines(plan: Plan, flown: Deployment, medium: Medium) -> Iterator[str]:
    """Promised rate, simulated rate, bound, and what the probabilities cover and do not cover."""
    cost, models, promise, flows = plan.path.objectives, plan.models, plan.promise, medium.flows

    def fails(rate: FailureRate) -> str:
        return f"fails {rate_text(rate.failure, rate.low, rate.high)} of {rate.sample}, {rate.law} {flows}"

    if plan.alarmed:
        yield Plan.NO_PROMISE
    else:
        if promise is not None:
            yield plan.answer(flows)
            yield f"promised: {fails(promise.rate)}"
            if promise.rate.failure < promise.floor:
                yield f"promised: {promise.fails}"
        yield f"simulated: {fails(flown.rate)}"
        bound = probability_text(min(1.0, cost.mission_risk + cost.collision_risk))
        yield f"upper bound of failures, {models.mission_symbol} + R: {bound}, {models.law} {flows}"
    for name, text in (("covered", plan.covered), ("not covered", plan.not_covered)):
        if text:
            yield f"{name}: {text}"
