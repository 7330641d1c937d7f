"""``pareto_ltl.contain``: how often a flight leaves border, corridor and volumes, and the air that it needs.

A rate per flight hour is the probability that a flight leaves, divided by the hours that it is planned to
last: the number of flights that leave for each hour that is flown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import distance_text, plain_power, probability_text
from pareto_ltl import ConfigError, DataError, Run, Scene
from pareto_ltl.extend import (
    FailureRate,
    FlightEvent,
    FlightSample,
    plain_sample,
    planned_run,
    weighted_samples,
)
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.display import Displayed
from pareto_ltl_apps.exports.geojson import LATERAL_FLOOR
from pareto_ltl_apps.preflight import volumes as shaped
from pareto_ltl_apps.preflight.given_volume import given_area
from pareto_ltl_apps.preflight.leaving import Area, border_area, corridor_area, leaving_rate
from pareto_ltl_apps.preflight.volumes import Deviations, Shape, Volumes

if TYPE_CHECKING:
    from pareto_ltl.extend import PlannedPath, Problem

LEVELS = (1e-2, 1e-3, 1e-4)  # per flight hour
STREAM = "contain"  # stream of the flights
HOUR = 3600.0
FEWEST = 100  # flights that leave, below which weighted flights size the volumes
SHAPE_FLIGHTS = 5000  # flights that decide the shape of the volumes
SHAPING, ENOUGH = 50, 300  # flights that leave when the shape is chosen: at least, and as many as are used
LIKELY = 0.5  # probability in all from which a level says nothing about a flight
MEDIAN_SIZE = 2.0  # standard deviations that half of all flights stay within at every step, about
MAX_FLIGHTS = 1_000_000
NOT_COVERED = (
    "failures of engine, propeller, battery, servo, structure and autopilot",
    "loss or falsification of satellite navigation, and of the link to the pilot",
    "wrong actions of pilots and ground crew",
    "other traffic, and what is done to avoid it",
    "height: only the horizontal position is simulated",
    "turns, take-off and landing, which the straight legs of a plan leave out",
    "winds that the law of the plan does not have",
)


@dataclass(frozen=True, slots=True)
class Level:
    """The volumes for one probability, and the fixed buffer of equal containment.

    Attributes
    ----------
    per_hour, in_all : float
        The probability of leaving that is allowed, per flight hour and of the whole flight.
    rate, buffer_rate : FailureRate
        How often fresh flights leave the volumes, and the buffer.
    radius : float
        Of the buffer [m], the same about each leg while it is flown.
    buffer_volume_time : float
        Its sum of area and time [m² s].
    """

    per_hour: float
    in_all: float
    volumes: Volumes
    rate: FailureRate
    radius: float
    buffer_rate: FailureRate
    buffer_volume_time: float

    @property
    def share(self) -> float:
        """Area and time of the volumes, as a share of the fixed buffer."""
        return self.volumes.volume_time / self.buffer_volume_time


@dataclass(frozen=True, slots=True, repr=False)
class Containment(Displayed):
    """How often flights of a plan leave areas, and the smallest volumes that hold them.

    Attributes
    ----------
    route : (T+1, 2) float
        The planned positions [m].
    t : (T+1,) float
        Their times [s after departure].
    floor : float
        The least rate of a flight that the data of the law of forecast errors can say; 0 without such a law.
    areas : tuple of (Area, FailureRate)
        The border, corridors and the given volume.
    levels : tuple of Level
        From the largest probability to the least.
    skipped : tuple of str
        Why levels are missing.
    """

    scene: Scene
    law: str
    route: FloatArray
    t: FloatArray
    flights: int
    floor: float
    areas: tuple[tuple[Area, FailureRate], ...]
    levels: tuple[Level, ...]
    skipped: tuple[str, ...]

    @property
    def hours(self) -> float:
        """Duration of the flight [h]."""
        return float(self.t[-1] - self.t[0]) / HOUR

    def facts(self) -> Mapping[str, str]:
        """How often flights leave each area, and the volumes against the fixed buffer."""
        reported = {f"leave {area.name}": str(rate) for area, rate in self.areas}
        return {"duration": f"{self.hours:.2f} h"} | reported | {
            f"{plain_power(level.per_hour)} per hour": f"{100.0 * level.share:.0f} % of a buffer of "
            f"{distance_text(level.radius)}"
            for level in self.levels
        }  # fmt: skip


def contain(
    planned: Run | str | Path,
    *,
    corridor: float | Sequence[float] = (),
    volume: str | Path | None = None,
    levels: Sequence[float] = LEVELS,
    flights: int = 10_000,
) -> Containment:
    """How often flights of a plan leave its border, corridors and a given volume, and the volumes they need.

    Parameters
    ----------
    planned : Run or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    corridor : float or sequence of float
        Whole widths of corridors along the route [m].
    volume : path, optional
        A GeoJSON file with areas, or an operational intent as in ASTM F3548-21.
    levels : sequence of float
        Probabilities of leaving per flight hour for which the smallest volumes are computed.
    flights : int
        Flights of each sample, 1,000 to 1,000,000.

    Raises
    ------
    ConfigError
        If a width, a level or the number of flights is out of range.
    DataError
        If there is no plan with a promise, or the volume cannot be used.
    """
    run = planned_run(planned)
    widths = [corridor] if isinstance(corridor, int | float) else list(corridor)
    check_numbers(run.scene, widths, levels, flights)
    plan, scene, problem = run.plan, run.scene, run.problem
    if plan.alarmed:
        raise DataError("contain: the plan was made after an alarm, so that the law of its wind says nothing")
    if len(plan.path.u) == 0:
        raise DataError("contain: the plan has no step: the mission is complete at the start")
    path, steps = plan.path, len(plan.path.u)
    seeds = run.seeds(STREAM).spawn(5)
    flown = plain_sample(problem, path, flights, seeds[0])
    areas = [border_area(scene.bounds, steps), *(corridor_area(path.x, width) for width in widths)]
    if volume is not None:
        areas.append(given_area(Path(volume), scene, path.t))
    rates = [
        leaving_rate(problem, path, area, flown, seed)
        for area, seed in zip(areas, seeds[1].spawn(len(areas)), strict=True)
    ]
    made, skipped = Sizing(problem, path, flown, seeds[2:]).levels(sorted(set(levels), reverse=True))
    return Containment(
        scene=scene, law=problem.fidelity.law, route=path.x, t=path.t, flights=flights, floor=run.wind.floor,
        areas=tuple(zip(areas, rates, strict=True)), levels=made, skipped=skipped,
    )  # fmt: skip


def check_numbers(scene: Scene, widths: Sequence[float], levels: Sequence[float], flights: int) -> None:
    """Raise ConfigError for a width, a level or a number of flights out of range."""
    widest = 2.0 * float(np.linalg.norm(scene.bounds[1] - scene.bounds[0]))
    for width in widths:
        if not 0.0 < width <= widest:
            raise ConfigError(
                f"contain: a corridor must be wider than 0 and at most {widest:g} m, twice the map's "
                f"diagonal; got {width:g} m"
            )
    for level in levels:
        if not 1e-6 <= level <= 0.1:
            raise ConfigError(f"contain: levels must be 1e-6 to 0.1 per flight hour, got {level:g}")
    if not 1000 <= flights <= MAX_FLIGHTS:
        raise ConfigError(f"contain: flights must be 1,000 to {MAX_FLIGHTS:,}, got {flights}")


# --- the volumes -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sizing:
    """What the volumes of all levels are sized with.

    A few flights decide their shape, others their size, and the flights ``flown`` say how often they are
    left; ``seeds`` are three streams.
    """

    problem: Problem
    path: PlannedPath
    flown: FlightSample
    seeds: Sequence[SeedSequence]

    @cached_property
    def shaping(self) -> FlightSample:
        """The flights that decide the shape."""
        return plain_sample(self.problem, self.path, SHAPE_FLIGHTS, self.seeds[0])

    @cached_property
    def about(self) -> Deviations:
        """Mean and covariance of the flights."""
        return Deviations.of(self.shaping.x, self.problem.motion.dt)

    @cached_property
    def products(self) -> FloatArray:
        """Of the deviations of the flights that decide the shape."""
        return self.about.products(self.shaping.x)

    def levels(self, per_hour: Sequence[float]) -> tuple[tuple[Level, ...], tuple[str, ...]]:
        """The levels that can be shown, and why others cannot."""
        hours = float(self.path.t[-1] - self.path.t[0]) / HOUR
        useless = [level for level in per_hour if level * hours >= LIKELY]
        skipped = [
            f"{plain_power(level)} per flight hour: {level * hours:.2g} in {hours:.3g} h limits nothing"
            for level in useless
        ]
        usable = [level for level in per_hour if level not in useless]
        common = [level for level in usable if level * hours * len(self.flown) >= FEWEST]
        made = list[Level]()
        for group, rare in ((common, False), ([level for level in usable if level not in common], True)):
            for found in self._group(group, hours, rare=rare) if group else ():
                if isinstance(found, str):
                    skipped.append(found)
                else:
                    made.append(found)
        return tuple(made), tuple(skipped)

    def _group(self, per_hour: Sequence[float], hours: float, *, rare: bool) -> list[Level | str]:
        """Levels whose volumes are sized with the same flights."""
        shapes = self._shapes([level * hours for level in per_hour])
        sizing, fresh = self._samples(shapes[-1], per_hour[-1] * hours if rare else None)
        apart = shaped.buffer_distances(self.path.x, sizing.x), shaped.buffer_distances(self.path.x, fresh.x)
        return [
            self._level(level, level * hours, shape, (sizing, fresh), apart)
            for level, shape in zip(per_hour, shapes, strict=True)
        ]

    def _samples(self, shape: Shape, rare: float | None) -> tuple[FlightSample, FlightSample]:
        """The flights that decide the size, and those that say how often the volumes are left.

        Weighted ones for a probability that is ``rare``, if there is a proposal.
        """
        if rare is not None:
            event = volume_event(self.about, shape, self.products, rare)
            drawn = weighted_samples(self.problem, self.path, event, len(self.flown), self.seeds[2], 2)
            if drawn:
                return drawn[0], drawn[1]
        return plain_sample(self.problem, self.path, len(self.flown), self.seeds[1]), self.flown

    def _shapes(self, leave: Sequence[float]) -> list[Shape]:
        """The shape of each level; rare levels share the one that the flights can tell."""
        least, made = SHAPING / SHAPE_FLIGHTS, dict[float, Shape]()
        for share in [max(share, least) for share in leave]:
            if share not in made:
                known = next(iter(made.values()), None)
                count = min(SHAPE_FLIGHTS, round(ENOUGH / share))
                made[share] = shaped.smallest_shape(self.about, self.products[:, :, :count], share, known)
        return [made[max(share, least)] for share in leave]

    def _level(
        self, per_hour: float, in_all: float, shape: Shape,
        samples: tuple[FlightSample, FlightSample], apart: tuple[FloatArray, FloatArray],
    ) -> Level | str:  # fmt: skip
        """The volumes of one level, or why it cannot be shown."""
        sizing, fresh = samples
        others = (
            () if sizing.weight is None else shaped.PLAIN_SHAPES
        )  # the shape is known from common flights
        tried = [shaped.least_volumes(self.about, one, sizing, in_all) for one in (shape, *others)]
        usable = [volumes for volumes in tried if volumes is not None]
        found = min(usable, key=lambda volumes: volumes.volume_time) if usable else None
        radius = shaped.least_size(sizing, apart[0], in_all)
        if found is None or radius is None:
            return (
                f"{plain_power(per_hour)} per flight hour: {len(sizing):,} flights cannot show a probability "
                f"of {probability_text(in_all)}; give more with --flights"
            )
        radius = max(radius, LATERAL_FLOOR)
        rates = fresh.rate(found.left_by(fresh.x)), fresh.rate(apart[1] > radius)
        size = shaped.buffer_volume_time(self.path.x, radius, self.about.dt)
        return Level(per_hour, in_all, found, rates[0], radius, rates[1], size)


def volume_event(about: Deviations, shape: Shape, products: FloatArray, leave: float) -> FlightEvent:
    """Leaving the ellipses that a share ``leave`` of flights leaves, if sizes beyond the known are Gaussian.

    ``products`` are of known flights.
    """
    sizes = np.sort(about.sizes(shape, products))
    known = min(SHAPING, len(sizes) - 1)
    ratio = max(known / len(sizes) / leave, 1.0)
    scale = float(sizes[len(sizes) // 2]) / MEDIAN_SIZE
    size = math.hypot(float(sizes[-known - 1]), math.sqrt(2.0 * math.log(ratio)) * scale)

    def happens(x: FloatArray) -> BoolArray:
        return about.sizes(shape, about.products(x)) > size

    def normals(x: FloatArray) -> FloatArray:
        made, inverse = np.zeros(x.shape), np.linalg.inv(about.ellipses(shape))
        for row, step in shaped.exit_steps(about, shape, size, x):
            made[row, step] = inverse[step] @ (x[row, step] - about.mean[step])
        return made

    return FlightEvent(happens, normals)


# --- what is reported ------------------------------------------------------------------------------


def floor_sentence(found: Containment) -> str:
    """What the law's data cannot say; empty for a wind without a law of forecast errors."""
    if found.floor == 0.0:
        return ""
    situations = round(1.0 / found.floor) - 1
    return (
        f"The law of forecast errors is from {situations} situations, which cannot show a rate below "
        f"{probability_text(found.floor)} of flights, {plain_power(found.floor / found.hours)} per flight "
        "hour: lower figures are for comparison, of one plan, volume or height with another."
    )
