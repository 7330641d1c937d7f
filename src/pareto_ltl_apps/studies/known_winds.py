"""The winds that planning knows in ``forecast_test``: a class for each value of the setting ``known``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from careful_io.files import write_text
from careful_io.texts import probability_text
from careful_io.times import HOUR, iso, seconds
from pareto_ltl import Readings, Run, Scene, Settings, WindField
from pareto_ltl.extend import Forecast, PlannedPath, Problem, Snapshot, UnpricedRun, with_interpolation_errors
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.formats.snapshots import known_at, latest_readings
from pareto_ltl_apps.studies import random_missions
from pareto_ltl_apps.studies.planning import fly_seeded
from pareto_ltl_apps.studies.random_missions import Mission, Spell, at_times
from pareto_ltl_apps.studies.settings import EvaluationConfig, ForecastTestConfig
from pareto_ltl_apps.studies.tables import Columns

NORMAL_90 = 1.6448536269514722  # P(|z| <= this) = 0.9 for a standard normal z


@dataclass(frozen=True)
class KnownWinds:
    """The winds of all missions, and the part of them that planning knows.

    Attributes
    ----------
    folder : Path
        The results directory.
    snapshots : tuple of Snapshot
        The winds of all cycles.
    truth : Readings
        The newest wind of each time.
    nodes : mapping of the name of a period to (n, 2) float
        Longitude and latitude of the readings for planning [deg]; empty for every node.
    """

    settings: Settings
    cfg: ForecastTestConfig
    folder: Path
    snapshots: tuple[Snapshot, ...]
    truth: Readings
    spells: tuple[Spell, ...]
    nodes: Mapping[str, FloatArray]

    def prepare(self) -> None:
        """Write the files that all missions read."""

    @property
    def law_of_reality(self) -> str:
        """The wind law of flights in :meth:`reality`."""
        return "independent"

    def task(self, number: int) -> Mission:
        """Mission ``number``."""
        return random_missions.mission(
            self.cfg, self.settings.seed, number, self.spells, self.settings.border
        )

    def reality(self, run: Run) -> Problem:
        """The problem of ``run`` with the real wind."""
        wind = random_missions.real_wind(self.cfg, run.settings.wind, self.truth, run.scene, run.wind)
        world = run.make("scene", "cells", "automaton")  # they do not depend on the fidelity
        # Without modes: the field is known, and gusts are independent at each step.
        models = replace(Settings.preset("paper"), collision_bound=run.settings.fidelity.collision_bound)
        return Run(replace(run.settings, fidelity=models), world | {"wind": wind}).problem

    def run_of(self, task: Mission, mine: Settings) -> Run:
        """The run of the planner with the settings ``mine``, which knows only some winds."""
        raise NotImplementedError

    def promised(self, run: Run, paths: Iterable[PlannedPath], seed: int) -> list[dict[str, float]]:
        """The promised probabilities of failure of each path, by name."""
        raise NotImplementedError

    def run_columns(self, run: Run) -> Columns:
        """Columns about the winds that ``run`` knows."""
        raise NotImplementedError

    def title(self, numbers: Mapping[str, float]) -> str:
        """The title of the table of scores."""
        raise NotImplementedError

    def explanation(self, numbers: Mapping[str, float]) -> str:
        """The errors that the test covers and does not cover, in one paragraph."""
        raise NotImplementedError

    def thinned(self, readings: Readings, k: int, spell: Spell) -> tuple[FloatArray, FloatArray]:
        """Places (n, 2) [deg] and winds (n, 2) [m/s] of time ``k`` of ``readings`` that planning gets."""
        if (nodes := self.nodes.get(spell.name)) is None:
            return readings.points[k], readings.winds[k]
        return nodes, readings.at_nodes(k, nodes)

    def simulated(
        self, model: Problem, path: PlannedPath, laws: Sequence[str], seed: int
    ) -> dict[str, float]:
        """Share of flights that fail in winds drawn from ``model``, for each law."""
        runs = self.settings.deployment.runs
        return {
            f"simulated_{law}": float(fly_seeded(model, path.u, runs, law, seed, path.x).failed.mean())
            for law in laws
        }


class DepartureWinds(KnownWinds):
    """``known=departure``: forecasts that are ``delay`` old at departure; each plan promises in its law.

    If planning knows every node, the wind between nodes and between the times of fields is not known at all:
    flights in the real wind draw it, as planning does.
    """

    @property
    def law_of_reality(self) -> str:
        """Errors of interpolation last, as in planning."""
        return "coherent" if self.cfg.points is None else "independent"

    def reality(self, run: Run) -> Problem:
        """The later fields, with errors of interpolation if planning knows every node."""
        if self.cfg.points is not None:
            return super().reality(run)
        wind = random_missions.real_wind(self.cfg, run.settings.wind, self.truth, run.scene, run.wind)
        world = run.make("scene", "cells", "automaton")
        return Run(run.settings, world | {"wind": with_interpolation_errors(wind, run.wind)}).problem

    def readings(self, task: Mission, after: float = 0.0) -> Readings:
        """The readings known ``after`` [s] departure: in its period, the newest of each time, thinned."""
        moment = seconds(str(task.scene.time_zero)) + after
        known = known_at(self.snapshots, moment, HOUR * task.delay)
        mine = [snap for snap in known if snap.time >= task.spell.start]
        readings = latest_readings(mine, self.truth.files)
        pairs = [self.thinned(readings, k, task.spell) for k in range(len(readings.times))]
        points, winds = zip(*pairs, strict=True)
        return replace(readings, points=points, winds=winds)

    def run_of(self, task: Mission, mine: Settings) -> Run:
        """Plans from the readings; the last known field is held to the end of the mission."""
        readings = self.readings(task)
        held = (seconds(str(task.scene.time_zero)) - float(readings.times[-1])) / HOUR + self.cfg.hours
        folder, longest = str(readings.files[0].parent), max(mine.wind.max_gap, held)
        wind = replace(mine.wind, source="grib", path=folder, hold_last=True, max_gap=longest)
        scene = replace(task.scene, border=mine.border)  # set by the fidelity where scene.border is auto
        return UnpricedRun(replace(mine, wind=wind), {"scene": scene, "readings": readings})

    def promised(self, run: Run, paths: Iterable[PlannedPath], seed: int) -> list[dict[str, float]]:
        """The share of failures in the problem in which a path is planned, and the bound of planning."""
        law, model = run.settings.fidelity.law, run.problem
        return [
            {f"bound_{law}": min(1.0, path.objectives.mission_risk + path.objectives.collision_risk)}
            | self.simulated(model, path, (law,), seed)
            for path in paths
        ]

    def run_columns(self, run: Run) -> Columns:
        """Last field and newest cycle that planning knew [h after departure]; negative if before it."""
        departure, readings = seconds(str(run.scene.time_zero)), run.readings
        newest = float(np.max(readings.times - readings.leads))
        return {
            "known_hours": float(readings.times[-1] - departure) / HOUR,
            "cycle_hours": (newest - departure) / HOUR,
        }

    def title(self, numbers: Mapping[str, float]) -> str:
        """The known winds, and the number of missions."""
        seen = "every node" if self.cfg.points is None else f"{self.cfg.points} readings a time"
        return (
            f"A forecast test: the chosen plans of {numbers['missions_planned']:.0f} of "
            f"{numbers['missions']:.0f} random missions, planned from {seen} of cycles at least "
            f"{self._delay_text()} h old and flown through the later fields; a mission is one trial for the "
            "95 % interval"
        )

    def _delay_text(self) -> str:
        limit = self.cfg.delay_most
        return f"{self.cfg.delay:g}" if limit is None else f"{self.cfg.delay:g} to {limit:g}"

    def explanation(self, numbers: Mapping[str, float]) -> str:
        """Errors that the later fields show, and those that they do not."""
        wind, planned = self.settings.wind, numbers["missions_planned"] / numbers["missions"]
        drawn = " (drawn in the real wind too)" if self.cfg.points is None else ""
        return (
            f"Tested: the promise of a plan under its law, wind.forecast_error={wind.forecast_error}, in "
            f"the winds that came within {self.cfg.hours:g} h of departure; {probability_text(planned)} of "
            "the missions have a plan. Covered: errors of forecasts and of the last known field, of "
            f"interpolation in space and time{drawn}, level {wind.level}. Not covered: what the fields "
            f"themselves have wrong, winds smaller than their grid beyond {self.cfg.gusts:g} times the "
            "fitted white part, other seasons; missions of one period share its weather, which the intervals "
            "ignore.\n"
        )


class AllWinds(KnownWinds):
    """``known=all``: readings of the whole flight; a plan promises under every law of the studies."""

    def prepare(self) -> None:
        """Write a table of thinned readings for each period, as ``pipelines=ingest`` writes it."""
        for spell in self.spells:
            lines = ["time,lat,lon,u,v"]
            for k in range(spell.first, spell.last + 1):
                points, winds = self.thinned(self.truth, k, spell)
                lines += [
                    f"{iso(self.truth.times[k])},{lat:g},{lon:g},{u:.2f},{v:.2f}"
                    for (lon, lat), (u, v) in zip(points.tolist(), winds.tolist(), strict=True)
                ]
            write_text(self._table(spell), "\n".join(lines) + "\n")

    def _table(self, spell: Spell) -> Path:
        return self.folder / f"readings_{spell.name}.csv"

    def run_of(self, task: Mission, mine: Settings) -> Run:
        """Plans from the table of the period; the last field is not held."""
        wind = replace(mine.wind, source="csv", path=str(self._table(task.spell)), hold_last=False)
        return UnpricedRun(replace(mine, wind=wind), {"scene": task.scene})

    def promised(self, run: Run, paths: Iterable[PlannedPath], seed: int) -> list[dict[str, float]]:
        """V + R and the share of failures with ``fidelity=full`` under each law, and f_o + R."""
        full = replace(run.settings, fidelity=Settings.preset("full"))
        laws = self.settings[EvaluationConfig].laws
        model = UnpricedRun(full, {"scene": run.scene}).problem
        promises = []
        for path in paths:
            costs = path.objectives
            ahead = {law: Forecast.of(model, path.u, law) for law in laws}
            promises.append(
                {"bound_paper": min(1.0, costs.mission_risk_paper + costs.collision_risk)}
                | {f"bound_{law}": min(1.0, f.mission_risk + f.collision_risk) for law, f in ahead.items()}
                | self.simulated(model, path, laws, seed)
            )
        return promises

    def run_columns(self, run: Run) -> Columns:
        """The fit inside the map: sd of z = (truth - mean)/sd, and share of |z| within 90 %."""
        z = scores(self.truth, run.scene, run.wind)
        return {"z_sd": float(np.sqrt((z**2).mean())), "coverage_90": float((np.abs(z) <= NORMAL_90).mean())}

    def title(self, numbers: Mapping[str, float]) -> str:
        """The number of plans and missions."""
        return (
            f"A test of interpolation: {numbers['plans']:.0f} plans for {numbers['missions_planned']:.0f} of "
            f"{numbers['missions']:.0f} random missions, flown through the full fields; a mission is one "
            "trial for the 95 % interval"
        )

    def explanation(self, numbers: Mapping[str, float]) -> str:
        """What is known from the readings, and how well the fit agrees with the full fields."""
        return (
            "Planning knew thinned readings of the whole flight, also of times after departure: this tests "
            "interpolation in space, not forecasts (pipelines=forecast_test tests those). 'front' are plans "
            "spread along each front, 'chosen' is the plan that selection picks.\n"
            f"\nThe fit against the full fields inside the maps: z-score sd {numbers['z_sd']:.2f}, "
            f"90 % intervals hold {probability_text(numbers['coverage_90'])}; "
            f"gusts x {self.cfg.gusts:g}.\n"
        )


def scores(readings: Readings, scene: Scene, wind: WindField) -> FloatArray:
    """z = (truth - mean) / sd of the full fields at the nodes inside the map, (K, nodes, 2)."""
    points = wind.lattice.nodes()
    inside = np.all((points >= scene.bounds[0]) & (points <= scene.bounds[1]), axis=1)
    truth = at_times(readings, scene, wind.times, points[inside])
    flat = (len(wind.times), -1, 2)
    sd = np.sqrt(wind.latent_var.reshape(flat)[:, inside] + wind.gust_var[:, None])
    return np.asarray((truth - wind.mean.reshape(flat)[:, inside]) / sd, float)


KNOWN_WINDS: Mapping[str, type[KnownWinds]] = {"departure": DepartureWinds, "all": AllWinds}
