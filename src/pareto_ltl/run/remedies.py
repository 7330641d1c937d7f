"""What would help a plan that breaks ``planner.epsilon`` or hardly ever succeeds: changes that are tried.

A trial flies the path of the plan, not planned again, in the changed problem: its worst segment, and its
failures in :data:`RUNS` flights, in the same random numbers for all changes. Planning again can gain more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import distance_text
from pareto_ltl.planning.costs.duration import hours_text
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.limits import Remedy
from pareto_ltl.planning.pack import build_problem, missing_for_fixes
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Plan, PlannedPath
from pareto_ltl.planning.separation import segment_risks
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.judging import count_failures
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl.wind.records import WindField, WindObservations
from pareto_ltl.world.scene import Scene

RUNS = 4000  # flights of each trial
HOPELESS = 0.9  # failure rate from which changes are tried although the plan keeps epsilon
GAIN = 0.9  # a change helps if it reduces one of the two figures to this share
FEEDBACK = (1800.0, 600.0, 300.0, 60.0)  # values of robot.feedback_time that are tried [s], the easiest first
WIDER = 1.5  # ratio of the widths of a region that is tried
BEACON = 0.02  # radius of a beacon, as a share of the map's size
ALONG = 48  # places of a beacon along the path
PLACES = 16  # of those on the map, that are tried
HOUR = 3600.0
SLOT = 3.0 * HOUR  # [s] between the fields of a forecast that goes on


@dataclass(frozen=True, slots=True)
class Trial:
    """The plan whose path is flown under changes, and what they need.

    Attributes
    ----------
    wind : WindField
        The wind of the plan.
    seed : SeedSequence
        Seed of the flights of every trial.
    """

    settings: Settings
    problem: Problem
    wind: WindField
    plan: Plan
    seed: SeedSequence

    @property
    def path(self) -> PlannedPath:
        """The path of the plan."""
        return self.plan.path

    def worst(self, problem: Problem) -> float:
        """The collision probability of the worst segment in ``problem``."""
        return min(1.0, float(segment_risks(problem, propagate(problem, self.path.x)).max()))

    def remedy(self, change: str, problem: Problem) -> Remedy:
        """The figures of the path in the changed ``problem``, rounded to four digits."""
        seed = SeedSequence(self.seed.entropy, spawn_key=self.seed.spawn_key)
        failed = count_failures(problem, self.path, RUNS, seed) / RUNS
        return Remedy(change, float(f"{self.worst(problem):.4g}"), failed, RUNS)

    def rebuilt(self, scene: Scene, wind: WindField) -> Problem:
        """The problem with another map or wind."""
        from pareto_ltl.logic.mission import automaton_of
        from pareto_ltl.world.cells import decompose

        problem, settings = self.problem, self.settings
        cells, automaton = problem.decomposition, problem.automaton
        if scene is not problem.scene:
            cells = decompose(scene)
            letters = {*cells.letters, frozenset[str]()}
            limit = settings.logic.max_states
            automaton = automaton_of(
                settings.mission, letters, limit, scene.regions, scene.windows, scene.forbidden
            )
        robot = replace(settings.robot, dt=problem.motion.dt)
        return build_problem(
            robot, settings.planner, settings.wind, scene, wind, cells, automaton, settings.fidelity
        )


def tried_remedies(trial: Trial) -> tuple[Remedy, ...]:
    """The changes that help, the one with the least probability of its worst segment first."""
    now = trial.remedy("", trial.problem)
    found = list[Remedy]()
    for changes in TRIALS:
        try:
            found += [trial.remedy(*change) for change in changes(trial)]
        except ParetoLtlError:  # the changed map or wind is not a problem that can be planned
            continue
    helps = (
        remedy
        for remedy in found
        if remedy.worst_segment_probability <= GAIN * now.worst_segment_probability
        or remedy.failure <= GAIN * now.failure
    )
    return tuple(sorted(helps, key=lambda remedy: (remedy.worst_segment_probability, remedy.failure)))


# --- changes --------------------------------------------------------------------------------------


def _feedback(trial: Trial) -> Iterator[tuple[str, Problem]]:
    """Position feedback: the slowest with which the path keeps epsilon, or else the fastest."""
    usual = trial.settings.robot.feedback_time
    times = [time for time in FEEDBACK if usual is None or time < usual]
    for time in times:
        problem = trial.problem.with_feedback(time)
        if trial.worst(problem) <= trial.problem.epsilon or time == times[-1]:
            yield f"position feedback, robot.feedback_time={time:g}", problem
            return


def _beacon(trial: Trial) -> Iterator[tuple[str, Problem]]:
    """A beacon at the place along the path where it reduces the worst segment most."""
    problem, robot = trial.problem, trial.settings.robot
    if missing_for_fixes(robot, problem.fidelity):
        return
    radius = BEACON * float(np.ptp(problem.scene.bounds, axis=0).min())
    steps = np.unique(np.linspace(1, len(trial.path.u), ALONG).round().astype(int))
    low, high = problem.scene.bounds + radius * np.array([[1.0], [-1.0]])
    along = trial.path.x[steps]
    along = along[((along >= low) & (along <= high)).all(axis=1)]
    if not len(along):
        return
    chosen = along[np.unique(np.linspace(0, len(along) - 1, PLACES).round().astype(int))]
    marked = [problem.with_beacons(robot, at[None], radius) for at in chosen]
    best = int(np.argmin([trial.worst(one) for one in marked]))
    where = _place_text(problem.scene, chosen[best])
    yield f"a beacon of radius {distance_text(radius)} at {where}", marked[best]


def _place_text(scene: Scene, at: FloatArray) -> str:
    if scene.crs is None:
        return f"x {at[0]:,.0f} m, y {at[1]:,.0f} m"
    lon, lat = scene.frame.to_geographic(at)
    return f"{float(lat[0]):.4f}, {float(lon[0]):.4f}"


def _younger_forecast(trial: Trial) -> Iterator[tuple[str, Problem]]:
    """A forecast that begins at departure; and one of the whole flight where the last field is held."""
    wind, end = trial.wind, float(trial.path.t[-1])
    leads = wind.leads if len(wind.leads) else np.full(len(wind.times), np.nan)
    if wind.evidence is None or wind.error is None or not np.isfinite(leads).all():
        return
    if trial.settings.wind.source == "ensemble":  # the spread of its members is not in the record
        return
    age = float(leads[0] - wind.times[0])
    if age >= HOUR:
        text = f"a forecast that begins {hours_text(age)} later, at departure"
        yield text, _refitted(trial, wind.times, leads - age)
    held = end - float(wind.times[-1])
    if held >= HOUR and wind.held is None:
        later = wind.times[-1] + SLOT * np.arange(1, np.ceil(held / SLOT) + 1)
        leads = np.append(leads, leads[-1] + later - wind.times[-1])
        text = f"a forecast that goes on for {hours_text(held)}, where the last field is held"
        yield text, _refitted(trial, np.append(wind.times, later), leads)


def _refitted(trial: Trial, times: FloatArray, leads: FloatArray) -> Problem:
    """The problem in the same wind with other leads of its forecast; later ``times`` have the last field."""
    from pareto_ltl.wind.field import fit_wind_field

    wind, problem = trial.wind, trial.problem
    assert wind.evidence is not None
    rows = np.minimum(np.arange(len(times)), len(wind.times) - 1).tolist()
    points, winds = (tuple(table[k] for k in rows) for table in (wind.evidence.points, wind.evidence.winds))
    until = None if wind.until is None or wind.until < times[-1] else wind.until
    seen = WindObservations(
        times, points, winds, wind.source, np.maximum(leads, 0.0), wind.level, until, wind.ends, wind.error
    )
    horizon = problem.max_steps * problem.motion.dt
    return trial.rebuilt(problem.scene, fit_wind_field(trial.settings.wind, seen, problem.scene, horizon))


def _larger_region(trial: Trial) -> Iterator[tuple[str, Problem]]:
    """The region that costs the most failures, larger about its middle."""
    import shapely
    from shapely.affinity import scale

    scene, law = trial.problem.scene, trial.wind
    priced = (price for price in trial.plan.prices if price.kind == "region" and price.name in scene.regions)
    price = max(priced, key=lambda price: price.saving, default=None)
    if price is None:
        return
    whole = shapely.unary_union([shapely.Polygon(part) for part in scene.regions[price.name]])
    middle, sky = whole.centroid, shapely.box(*scene.bounds.ravel())
    parts = [
        shapely.intersection(scale(shapely.Polygon(part), WIDER, WIDER, origin=middle), sky)
        for part in scene.regions[price.name]
    ]
    outlines = tuple(shapely.get_coordinates(part)[:-1] for part in parts)
    larger = replace(scene, regions={**scene.regions, price.name: outlines})
    yield f"region {price.name} {WIDER:g} times as wide", trial.rebuilt(larger, law)


TRIALS: tuple[Callable[[Trial], Iterator[tuple[str, Problem]]], ...] = (
    _feedback, _beacon, _younger_forecast, _larger_region,
)  # fmt: skip
