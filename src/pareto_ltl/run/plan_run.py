"""The run of a plan: one method for each of its records.

Packages are imported inside the methods, so that a configuration error is reported without loading them.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from careful_io.links import refuse_links_out
from careful_io.messages import shown_text
from careful_io.reading import shaped
from flight_quantities.heights import Height
from pareto_ltl.run import provenance
from pareto_ltl.run.plan_additions import additions_to_plans
from pareto_ltl.run.record import BaseRun, Record, record
from pareto_ltl.run.required import require_formula, require_map
from pareto_ltl.settings import RobotConfig, WindConfig
from pareto_ltl.settings.heights import flight_height
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.run_status import ANSWERS
from pareto_ltl.support.schemas import read_document
from pareto_ltl.support.seeds import stage_seeds

if TYPE_CHECKING:
    import xarray as xr

    from pareto_ltl.logic import Automaton
    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Forest, Front, Plan
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.readings import Readings
    from pareto_ltl.wind.records import WindField, WindObservations
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene

LOG = logging.getLogger(__name__)
MAP_FILES, PLAN_FILES = "pareto_ltl.world.scene_files", "pareto_ltl.planning.plan_files"
LOGIC_FILES, FLIGHTS = "pareto_ltl.logic.automaton_files", "pareto_ltl.simulation.records"


class Run(BaseRun):
    """A plan, and all that it follows from; each record is made when it is first asked for.

    ``run.plan`` makes the plan, and before it what it needs. :meth:`open` reads the records of a results
    directory instead. ``run.given(wind=field).plan`` is the plan in another wind.
    """

    @record(words="Reading the wind")
    def readings(self) -> Readings:
        """All wind readings of the source; each file is read once, a large one only around the scene."""
        from pareto_ltl.run.provenance import wanted_wind
        from pareto_ltl.wind.sources import read_readings

        settings = self.settings
        if self.read is not None:
            raise DataError("a results directory has no readings of winds: give the run a wind")
        _check_sample(settings.robot, settings.wind)
        readings = read_readings(settings.wind, wanted_wind(settings))
        for note in readings.notes:
            LOG.info("%s: %s", readings.name, note)
        return readings

    @record("scene.json", codec=f"{MAP_FILES}:scene", words="Reading the map")
    def scene(self) -> Scene:
        """The map; without ``mission.start_time`` the robot departs at the first wind time."""
        from careful_io.times import lacks_zone
        from pareto_ltl.logic.mission import region_use
        from pareto_ltl.planning.open_sky import sky_room
        from pareto_ltl.world.scene_settings import add_random_places, scene_from_settings
        from pareto_ltl.world.scene_sketch import MissionUse

        settings, mission = self.settings, self.settings.mission
        require_map(settings.scene)
        departure = mission.start_time or self.readings.first_time

        def use() -> MissionUse | None:
            found = region_use(mission)
            return None if found is None else MissionUse(*found)

        if mission.start_time and lacks_zone(mission.start_time):
            LOG.warning(
                "mission.start_time=%s states no zone and is taken as UTC; write %sZ, or the offset of its "
                "zone", shown_text(mission.start_time), shown_text(mission.start_time),
            )  # fmt: skip
        height = flight_height(settings)
        return scene_from_settings(
            add_random_places(settings.scene), departure, settings.fidelity.border, use,
            height if height.stated else None, sky_room(settings, self.readings, departure),
        )  # fmt: skip

    @record("cells.json", codec=f"{MAP_FILES}:cells", stage="decomposition", words="Dividing the map")
    def cells(self) -> Decomposition:
        """The convex cells of the map."""
        from pareto_ltl.world import cells

        return cells.decompose(self.scene)

    @record("automaton.json", "automaton.hoa", codec=f"{LOGIC_FILES}:automaton", words="Reading the mission")
    def automaton(self) -> Automaton:
        """The minimal automaton of the mission, over the letters of the cells and the one off the map."""
        from pareto_ltl.logic.mission import automaton_of
        from pareto_ltl.world import cells

        settings, scene = self.settings, self.scene
        require_formula(settings.mission)
        letters = {*self.cells.letters, frozenset[str]()}
        result = automaton_of(
            settings.mission,
            letters,
            settings.logic.max_states,
            scene.regions,
            scene.windows,
            scene.forbidden,
        )
        windows = result.windows
        asked = (windows[atom].region if atom in windows else atom for atom in result.atoms)
        places = {place for place in asked if place is not None}
        if cut_off := cells.unreachable_regions(self.cells, scene, places):
            LOG.warning("no way on the map leads from the start to %s", ", ".join(cut_off))
        return result

    @record(words="Reading the wind")
    def observations(self) -> WindObservations:
        """The readings near the map, in its plane and with times since departure."""
        from pareto_ltl.wind.observations import place_readings

        return place_readings(self.settings.wind, self.readings, self.scene)

    @record("wind.nc", codec="pareto_ltl.wind.netcdf:wind", words="Fitting the wind")
    def wind(self) -> WindField:
        """The posterior wind for as long as a plan can last."""
        from pareto_ltl.wind import field
        from pareto_ltl.world.time_step import step_of

        settings = self.settings
        steps = settings.planner.max_steps
        horizon = steps * step_of(settings.robot, self.scene, steps)
        return field.fit_wind_field(settings.wind, self.observations, self.scene, horizon)

    @record(words="Preparing the search")
    def problem(self) -> Problem:
        """Map, wind, automaton and robot as the arrays that planning reads."""
        from pareto_ltl.planning.convex.programme import import_early
        from pareto_ltl.planning.costs import costs_with
        from pareto_ltl.planning.pack import build_problem
        from pareto_ltl.world.windows import missed_windows

        settings = self.settings
        _check_level(flight_height(settings), self.wind)
        if settings.fidelity.refine != "none":
            import_early()  # behind the modes of the wind and the trees
        problem = build_problem(
            settings.robot,
            settings.planner,
            settings.wind,
            self.scene,
            self.wind,
            self.cells,
            self.automaton,
            settings.fidelity,
        )
        problem = replace(problem, costs=costs_with(settings.selection.costs))
        for addition in additions_to_plans(settings):
            problem = addition.problem(problem)
        for line in missed_windows(problem.automaton.windows, problem.max_steps * problem.motion.dt):
            LOG.warning("%s", line)
        return problem

    @record("trees.npz", codec=f"{PLAN_FILES}:forest", words="Searching for paths")
    def forest(self) -> Forest:
        """The search trees (Algorithm 1)."""
        from pareto_ltl.planning import growth
        from pareto_ltl.run.second_process import compiling_in_two

        settings, problem = self.settings, self.problem
        self.budget.heeded = True
        with compiling_in_two(settings, self.budget):
            seeds = stage_seeds(settings.search_seed, "forest")
            return growth.grow_forest(settings.planner, problem, seeds, self.progress, budget=self.budget)

    @record("front.csv", "front.npz", codec=f"{PLAN_FILES}:front", words="Improving the paths")
    def front(self) -> Front:
        """The non-dominated paths, refined and judged as set in ``fidelity``."""
        from pareto_ltl.run.front_stage import Search, make_front

        candidates = self.records.get("candidates", ())
        return make_front(
            Search(self.settings, self.problem, self.forest, self.budget, self.progress, candidates)
        )

    @record("plan.json", "plan.csv", codec=f"{PLAN_FILES}:plan", words="Checking the plan with new flights")
    def plan(self) -> Plan:
        """The path to fly, the chance constraint of each of its segments, and the prices of its limits."""
        plan = self.unpriced_plan()
        from pareto_ltl.run import plan_stage

        plan = plan_stage.priced(self.problem, plan, self.seeds("plan"))
        return plan_stage.with_remedies(self.settings, self.problem, self.wind, plan, self.seeds("plan"))

    def unpriced_plan(self) -> Plan:
        """The plan without prices."""
        front, problem, wind = self.front, self.problem, self.wind
        from pareto_ltl.run.plan_stage import chosen_plan

        plan = chosen_plan(self.settings, problem, wind, front, self.seeds("plan"))
        for addition in additions_to_plans(self.settings):
            plan = addition.plan(self, plan)
        return plan

    @record(words="Checking the plan with new flights")
    def forecasts(self) -> Mapping[str, Forecast]:
        """V and R of the plan under every law of ``deployment.laws``."""
        plan = self.plan
        from pareto_ltl.planning.evaluate import Forecast

        return {law: Forecast.of(self.problem, plan.path.u, law) for law in self.settings.deployment.laws}

    @record("deployments.npz", codec=f"{FLIGHTS}:deployments", stage="deployment", words="Flying the plan")
    def deployments(self) -> Mapping[str, Deployment]:
        """Simulated flights of the plan under every law of ``deployment.laws``."""
        plan = self.plan
        from pareto_ltl.simulation.flights import deploy_plan

        return deploy_plan(self.settings.deployment, self.problem, plan, self.seeds("deployment"))

    # --- a results directory ---

    @classmethod
    def open(cls, directory: str | Path) -> Self:
        """The run of a results directory, whose records are read when they are asked for.

        What has no file (the problem, for example) is made of them. Nothing is written.

        Raises
        ------
        DataError
            If the directory holds no run, or a link leads out of it.
        """
        from pareto_ltl.settings import Settings

        directory = Path(directory)
        if not (directory / "run.json").is_file():
            raise DataError(f"{directory}: there is no run.json; name a results directory")
        refuse_links_out(directory)
        inputs = read_document(directory / "run.json", "run").get("inputs") or {}
        return cls(
            Settings.of_file(directory / "config_resolved.yaml").inert(),
            directory=directory,
            read={str(name): str(digest) for name, digest in inputs.items()},
            stored=frozenset(name for name, row in cls.rows().items() if row.codec),
        )

    def _load(self, row: Record[Any]) -> Any:
        found, measured = super()._load(row), self.place / "metrics.json"
        if row.name == "forest" and measured.is_file():  # the time of growth is not in its file
            with shaped(measured, "the metrics of a run"):
                found = replace(found, seconds=float(self.metrics["growth_seconds"]))
        return found

    @property
    def provenance(self) -> dict[str, Any]:
        """The content of ``run.json``: status, versions, times; in memory, as a run of it would begin."""
        if self.directory is None:
            return provenance.begin(self.settings, ())
        return read_document(self.place / "run.json", "run")

    def source(self, out: Path | None = None) -> Path | None:
        """Its results directory; None in memory. ConfigError if a result in ``out`` would overwrite it."""
        place = self.directory
        if out is not None and place is not None and out.resolve() == place.resolve():
            raise ConfigError(f"{out}: the result would overwrite its source; name another folder")
        return place

    @property
    def done(self) -> bool:
        """Whether the run in the results directory has an answer: a plan, tables, or that no plan exists.

        ``metrics.json`` is written last; its presence means that the run is complete.
        """
        if not (self.place / "run.json").is_file():
            return False
        made = self.provenance
        answered = made.get("status") in ANSWERS
        return answered and (not made.get("measured", True) or (self.place / "metrics.json").is_file())

    # --- for people ---

    @property
    def metrics(self) -> dict[str, float]:
        """The numbers of ``metrics.json``, NaN where it has null; in memory of the records made so far."""
        if self.stored is not None:
            content = read_document(self.place / "metrics.json", "metrics")
            return {name: math.nan if value is None else value for name, value in content.items()}
        from pareto_ltl.run.metrics import run_metrics

        return run_metrics(self.records, self.seconds)

    def to_xarray(self) -> xr.Dataset:
        """Wind and plan as a dataset of xarray; without the plan if the run has none yet."""
        from pareto_ltl.run.datasets import dataset_of

        return dataset_of(self.scene, self.wind, self.get("plan"))

    def facts(self) -> Mapping[str, str]:
        """The facts of the plan, and the size of the front; of a results directory, what run it holds."""
        where = {} if self.directory is None else {"directory": str(self.directory)}
        if self.stored is not None:
            made, names = self.provenance, ("name", "seed", "fidelity", "status")
            return where | {name: str(made.get(name)) for name in names}
        if "plan" not in self.records:
            return {"name": self.settings.name, "seed": str(self.settings.seed)} | where
        facts = dict(self.plan.facts())
        if "front" in self.records:
            facts["front"] = f"{len(self.front.paths)} paths"
        return facts | where


class UnpricedRun(Run):
    """For studies, which read no price: pricing is more than half of a small plan's time."""

    @record(*Run.plan.writes, codec=Run.plan.codec, words=Run.plan.words)
    def plan(self) -> Plan:
        """The path to fly."""
        return self.unpriced_plan()


PLAN_STAGES = tuple(Run.rows().values())


def _check_sample(robot: RobotConfig, wind: WindConfig) -> None:
    """Refuse a stated level of the packaged sample; a robot at another level gets a warning."""
    if wind.source == "sample" and wind.level not in ("10m", "10 m", robot.level):
        raise ConfigError(
            f"wind.level={shown_text(wind.level)}: the packaged sample has winds 10 m above ground only; "
            "expected wind.level=10m, or another wind.source with winds of that level"
        )


def _check_level(height: Height, wind: WindField) -> None:
    """Warn if the level of the wind is not the level of the flight; calm air has no level."""
    from pareto_ltl.support.levels import level_mismatch

    if height.stated and wind.evidence is not None and (gap := level_mismatch(height.level, wind.level)):
        LOG.warning(
            "%s: winds at other heights differ, often by a factor of two; read winds of that level, or, if a "
            "table has them, state it with wind.level=%s",
            gap,
            height.level,
        )
