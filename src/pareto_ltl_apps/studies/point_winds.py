"""Missions over the places of a network, planned from older runs and flown in the winds of newer ones.

The winds are known at the places only. Between them a flight in the real wind draws the error of
interpolation in space, as planning does. Errors that all runs of a model share are not in the winds of newer
runs: plans promise under the law without its lasting part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.random import Generator

from careful_io.files import write_json
from careful_io.times import HOUR, iso, seconds
from pareto_ltl import Readings, Run, Settings
from pareto_ltl.extend import Frame, Problem, UnpricedRun, law_of_newer_runs
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.formats.snapshots import known_at, latest_readings
from pareto_ltl_apps.studies.known_winds import DepartureWinds
from pareto_ltl_apps.studies.random_missions import (
    TRIES,
    Mission,
    delay_of,
    departure_of,
    flight_times,
    formula_of,
    generator_of,
    random_scene,
    situation_of,
)

AT_PLACES = 3  # the start and the first regions are at places
EXTENT = (0.3, 0.8)  # least and greatest extent of these, in sides of the map
CLOSEST = 0.2  # distance between two of them, in sides
LAW_FILE = "law_of_newer_runs.json"
OLDER = 24 * HOUR  # a mission is drawn again if its newest known run is older by more than this
BEFORE = 6 * HOUR  # how long before departure winds are read


@dataclass(frozen=True)
class PointWinds(DepartureWinds):
    """Forecasts at places, by run and lead; ``places`` (P, 2) are longitude and latitude [deg]."""

    places: FloatArray

    @property
    def law_of_reality(self) -> str:
        """Errors of interpolation in space last, as in planning."""
        return "coherent"

    def prepare(self) -> None:
        """Write the law that the winds of newer runs can test."""
        law = law_of_newer_runs(self.settings.wind.forecast_error)
        write_json(self.folder / LAW_FILE, law.document())

    def task(self, number: int) -> Mission:
        """Mission ``number``: its start and the regions a and b are at places."""
        cfg, seed = self.cfg, self.settings.seed
        rng, delay = generator_of(cfg, seed, number), delay_of(cfg, seed, number)
        spell, departure = departure_of(cfg, rng, self.spells)
        for _ in range(TRIES):
            if self.foreseen(departure, delay):
                break
            spell, departure = departure_of(cfg, rng, self.spells)
        else:
            raise DataError(f"{self.truth.name}: no run that old covers a flight; lower {cfg.section}.hours")
        formula, scene, chosen = formula_of(cfg, rng), None, None
        for _ in range(TRIES):
            side = float(rng.uniform(cfg.side[0], cfg.side[1]))
            chosen = places_within(rng, self.places, side)
            if chosen is None:
                continue
            lon, lat = middle_of(self.places[chosen])
            plane = Frame.at(lat, lon)
            points = plane.to_plane(*self.places[chosen].T)
            scene = random_scene(cfg, rng, side, str(plane.crs), iso(departure), points)
            if scene is not None:
                break
        if scene is None:
            raise ConfigError(
                f"{cfg.section}.side={list(cfg.side)}: no {AT_PLACES} places of the table lie on a map of "
                "such a size; widen the range"
            )
        named = replace(cfg, situations="days") if cfg.situations == "auto" else cfg
        return Mission(
            number, replace(scene, border=self.settings.border), formula, spell, lat, lon,
            situation_of(named, spell, departure, lon, lat), delay,
        )  # fmt: skip

    @cached_property
    def _cycles(self) -> tuple[FloatArray, FloatArray]:
        """Start and time of each forecast [s since 1970]."""
        return np.array([s.cycle for s in self.snapshots]), np.array([s.time for s in self.snapshots])

    def foreseen(self, departure: float, delay: float) -> bool:
        """Whether a run that begins ``delay`` [h] before departure, or a day earlier, covers a flight."""
        cycles, times = self._cycles
        age = departure - HOUR * delay - cycles
        new = (age >= 0.0) & (age <= OLDER)
        return bool((new & (times >= departure + HOUR * self.cfg.hours)).any())

    def readings(self, task: Mission, after: float = 0.0) -> Readings:
        """The newest forecast of each time that is known ``after`` [s] departure, up to the flight's end."""
        moment = seconds(str(task.scene.time_zero)) + after
        known = known_at(self.snapshots, moment, HOUR * task.delay)
        end = moment + HOUR * (self.cfg.hours + 1)
        return latest_readings([s for s in known if moment - BEFORE <= s.time <= end], self.truth.files)

    def run_of(self, task: Mission, mine: Settings) -> Run:
        """Plans under the law without what all runs share."""
        law = str(self.folder / LAW_FILE)
        return super().run_of(task, replace(mine, wind=replace(mine.wind, forecast_error=law)))

    def reality(self, run: Run) -> Problem:
        """The winds of the newest runs at the places, and the error of interpolation between them."""
        zero = seconds(str(run.scene.time_zero))
        rows = np.flatnonzero(np.isin(self.truth.times, zero + flight_times(self.cfg, self.truth, run.scene)))
        seen = replace(
            self.truth,
            times=self.truth.times[rows],
            leads=np.zeros(len(rows)),
            points=tuple(self.truth.points[k] for k in rows),
            winds=tuple(self.truth.winds[k] for k in rows),
            remarks=tuple(self.truth.remarks[k] for k in rows),
            origins=tuple(self.truth.origins[k] for k in rows),
        )
        wind = replace(run.settings.wind, forecast_error="none", hold_last=False, max_gap=self.cfg.max_gap)
        world = run.make("scene", "cells", "automaton")
        real = UnpricedRun(replace(run.settings, wind=wind), world | {"readings": seen})
        gusts = self.cfg.gusts**2 * real.wind.gust_var
        return Run(real.settings, world | {"wind": replace(real.wind, gust_var=gusts)}).problem

    def explanation(self, _numbers: Mapping[str, float]) -> str:
        """What the winds of newer runs test."""
        law, newest = self.settings.wind.forecast_error, self.truth.leads.max() / HOUR
        return (
            f"Tested: the promise of a plan under its law, wind.forecast_error={law}, without the lasting "
            f"part, at {len(self.places)} places, against the newest runs (at most {newest:g} h old): what "
            "all runs have wrong is not tested. Between the places both promised and real flights draw the "
            "error of interpolation in space; there the errors of forecasts are smaller than the law says, "
            "since they are interpolated.\n"
        )


def places_within(rng: Generator, places: FloatArray, side: float) -> list[int] | None:
    """Three random places that fit on a map of the given ``side`` [m]; None if this draw has none."""
    first = int(rng.integers(len(places)))
    plane = Frame.at(*places[first, ::-1])
    arc = np.hypot(*plane.to_plane(*places.T).T)
    near = np.flatnonzero((arc > CLOSEST * side) & (arc < EXTENT[1] * side))
    if len(near) < AT_PLACES - 1:
        return None
    chosen = [first, *rng.choice(near, AT_PLACES - 1, replace=False).tolist()]
    lon, lat = middle_of(places[chosen])
    points = Frame.at(lat, lon).to_plane(*places[chosen].T)
    extent = float(np.ptp(points, axis=0).max())
    apart = min(np.linalg.norm(points[i] - points[j]) for i in range(AT_PLACES) for j in range(i))
    return chosen if EXTENT[0] * side <= extent <= EXTENT[1] * side and apart >= CLOSEST * side else None


def middle_of(places: FloatArray) -> tuple[float, float]:
    """Longitude and latitude [deg] of the centre of the least upright square around places of one network."""
    lon, lat = (places.min(axis=0) + places.max(axis=0)) / 2
    plane = Frame.at(lat, lon)
    points = plane.to_plane(*places.T)
    east, north = plane.to_geographic((points.min(axis=0) + points.max(axis=0))[None] / 2)
    return float(east[0]), float(north[0])
