"""The Python interface: ``pareto_ltl.plan``, ``choose``, ``replan``, ``simulate`` and ``load_results``.

They go through the runner of the command line: the same settings and seed give the same plan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run.choosing import (
    KEPT,
    Choice,
    choose_from_results,
    chosen_settings,
    kept_records,
    require_choice,
    require_plan,
)
from pareto_ltl.run.directory import claimed_directory
from pareto_ltl.run.pipeline import Run, carry_out, check_pipeline
from pareto_ltl.run.records import (
    AUTOMATON,
    DECOMPOSITION,
    DEPLOYMENTS,
    FRONT,
    PLAN,
    PROBLEM,
    READINGS,
    SCENE,
    WIND,
    RecordKey,
    Records,
    T,
)
from pareto_ltl.run.results import RecordView, Results
from pareto_ltl.run.stage_table import with_extension_stages
from pareto_ltl.run.stages import PLAN_STAGES
from pareto_ltl.settings import DeploymentConfig, MissionConfig, SceneConfig, Settings, WindConfig
from pareto_ltl.settings.building import build_settings, section_of
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.resources import choices
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.report.notebook import Drawing
    from pareto_ltl.run.replanning import Replanned
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.readings import Readings
    from pareto_ltl.wind.records import WindField


@dataclass(frozen=True, slots=True, repr=False)
class PlanningResult(RecordView):
    """The result of :func:`plan`. Each record of the run is an attribute, or ``result[KEY]``.

    Attributes
    ----------
    run : Run
        The records, the settings and the time of every stage.
    """

    run: Run

    def __getitem__(self, key: RecordKey[T]) -> T:
        return self.run.make(key)

    @property
    def settings(self) -> Settings:
        """The settings of the run."""
        return self.run.settings

    @property
    def problem(self) -> Problem:
        """Map, wind, automaton and robot as the arrays that planning reads."""
        return self[PROBLEM]

    @property
    def metrics(self) -> dict[str, float]:
        """The numbers of ``metrics.json``, as far as the stages made them."""
        from pareto_ltl.run.metrics import run_metrics

        return run_metrics(self.run.records, self.run.seconds)

    def facts(self) -> Mapping[str, str]:
        """The facts of the plan, the size of the front, and the directory if there is one."""
        facts = dict(self.plan.facts()) | {"front": f"{len(self.front.paths)} paths"}
        where = self.run.directory
        return facts if where is None else facts | {"directory": str(where)}

    def plot(self, **options: Any) -> Drawing:
        """The map with trees, plan and simulated flights."""
        from pareto_ltl.report.notebook import mission_drawing

        flights = self.run.records.get(DEPLOYMENTS)
        maps = (self.scene, self.decomposition, self.wind, self.forest, self.plan)
        return mission_drawing(*maps, flights, **options)


def plan(
    scene: str | Path | Mapping[str, Any] | SceneConfig | Scene,
    formula: str | Mapping[str, Any] | MissionConfig,
    *,
    seed: int = 0,
    out: str | Path | None = None,
    **sections: Any,
) -> PlanningResult:
    """Plan ``formula`` on ``scene``; the same settings give the same results as the command line.

    Parameters
    ----------
    scene : str, Path, mapping, SceneConfig or Scene
        The name of a ready map (``"phi2"``), a GeoJSON or ``scene.json`` file, the keys of section ``scene``,
        or a map in metres.
    formula : str, mapping or MissionConfig
        A formula over the regions of the map (``"F(a & F b)"``), or the keys of section ``mission``.
    seed : int
        Another seed gives other trees.
    out : path, optional
        Run the whole pipeline into this results directory. Without it only up to the plan, with no files.
    sections : mapping, str or settings object
        Any section of :class:`Settings`: ``wind="calm"``, ``planner={"trees": 4}``. A string names a choice
        in ``conf/``; ``mission`` gives the keys other than the formula. ``wind``, or its key ``source``, may
        also be a file, a :class:`Readings`, to which a field is fitted, or a :class:`WindField`.

    Raises
    ------
    ConfigError, FormulaError, DataError
        If a setting, the formula, the map or the wind is wrong.
    InfeasibleError
        If no path completes the mission.
    """
    given, sections = _given_wind(sections)
    if isinstance(scene, Scene):
        given[SCENE] = scene
    settings = build_settings(
        {"pipelines": "plan", "seed": seed}
        | ({} if isinstance(scene, Scene) else {"scene": _map_settings(scene)})
        | sections
        | {"mission": _mission_settings(formula, sections.get("mission"))}
    )
    table = with_extension_stages(PLAN_STAGES, settings.pipelines.stages)
    pipeline = check_pipeline(settings, table, tuple(given))
    run = Run(settings, table, given, directory=None if out is None else Path(out))
    if out is not None:
        with claimed_directory(Path(out), table.files):
            carry_out(run, pipeline.stages)
    else:
        with run.budget.ends_at_key():
            for stage in pipeline.stages:
                run.perform(stage)
                if stage.makes == PLAN:
                    break
    if PLAN not in run.records:
        raise ConfigError(
            f"pipelines.stages makes no plan; it lists {', '.join(settings.pipelines.stages)}: use "
            "pipelines='plan', or add the stage plan and those that it needs"
        )
    return PlanningResult(run)


def _given_wind(sections: Mapping[str, Any]) -> tuple[Records, dict[str, Any]]:
    """The records that section ``wind`` gives, and all sections with the settings that describe them."""
    from pareto_ltl.wind.readings import CALM, Readings, check_all_readings
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.wind.sources import source_of_file

    section = sections.get("wind")
    others = dict(section) if isinstance(section, Mapping) else {}
    wind = others.get("source") if isinstance(section, Mapping) else section
    if isinstance(wind, WindField):
        given, found = Records({WIND: wind, READINGS: CALM}), _given_level(wind, others)
    elif isinstance(wind, Readings):
        check_all_readings(wind, float(others.get("max_speed", WindConfig().max_speed)))
        given, found = Records({READINGS: wind}), _given_level(wind, others)
    elif isinstance(wind, str | Path) and Path(wind).expanduser().is_file():
        given, found = Records(), {"source": source_of_file(Path(wind).expanduser()), "path": str(wind)}
    else:
        return Records(), dict(sections)
    return given, {**sections, "wind": others | found}


def _given_level(wind: Readings | WindField, others: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a wind in memory, which states its level; ConfigError if ``others`` contradicts it."""
    from pareto_ltl.wind.levels import parse_level

    asked = str(others.get("level", "auto"))
    if asked != "auto" and parse_level(asked) != parse_level(wind.level):
        raise ConfigError(
            f"wind.level={shown_text(asked)}: the given {type(wind).__name__} states the level {wind.level}; "
            "leave wind.level out, or give winds of that level"
        )
    return {"source": "given", "level": wind.level}


def _mission_settings(formula: Any, others: Any) -> Any:
    """The section ``mission`` from a formula or its keys, and from the other keys in ``others``.

    Raises ConfigError if both give the same key, or ``others`` cannot be combined with the formula.
    """
    mission = {"formula": formula} if isinstance(formula, str) else formula
    if others is None:
        return mission
    if not (isinstance(mission, Mapping) and isinstance(others, Mapping)):
        raise ConfigError(
            "the mission is given twice, as the second argument and as mission=...: give one of them, or the "
            "formula and mission={...} with the other keys"
        )
    if twice := sorted(set(mission) & set(others)):
        raise ConfigError(f"mission.{twice[0]} is given twice, in the second argument and in mission={{...}}")
    return {**mission, **others}


def choose(
    planned: PlanningResult | Results | str | Path,
    *,
    failure: float | None = None,
    length: float | None = None,
    knee: bool = False,
    point: int | None = None,
    energy: float | None = None,
    selection: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
) -> PlanningResult:
    """Select another path of a front as the plan, without planning again. Give exactly one criterion.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`plan` returned, or a results directory.
    failure : float, optional
        The shortest path with at most this failure rate (upper end of its interval in the front).
    length : float, optional
        The safest path of at most this length [m].
    knee : bool
        The knee of the front: beyond it, a lower failure rate costs much more length.
    point : int, optional
        The path of that number in ``result.front.paths`` and ``front.csv``.
    energy : float, optional
        The path with the least energy and at most this failure rate; needs a robot with a power curve.
    selection : mapping, optional
        The path that a rule picks: the same mapping as for :func:`plan`, e.g.
        ``{"rule": "weighted", "weights": [0.8, 0.1, 0.1]}``; other settings of the selection stay.
    out : path, optional
        Write a whole results directory there, identical to a run with that selection; ``planned`` must
        then be a results directory. Without it, nothing is written.

    Raises
    ------
    InfeasibleError
        If the front has no such path.
    """
    choice = Choice(failure, length, knee, point, energy, selection)
    if isinstance(planned, PlanningResult):
        if out is not None:
            raise ConfigError("choose writes from a results directory: plan with out=DIR and give choose DIR")
        run, where = planned.run, "the front"
    else:
        results = load_results(planned)
        require_plan(results)
        table = with_extension_stages(PLAN_STAGES, results.settings.pipelines.stages)
        if out is not None:
            return PlanningResult(choose_from_results(results, choice, table, Path(out)))
        run, where = Run(results.settings, table, kept_records(results)), str(results.directory)
    require_choice(choice, run.make(FRONT), where)
    records = Records({key: run.make(key) for key in (*KEPT, PROBLEM)})
    other = Run(chosen_settings(run.settings, choice), run.table, records)
    other.make(PLAN)
    return PlanningResult(other)


def replan(
    planned: PlanningResult | Results | str | Path,
    time: float | str | None = None,
    fix: Sequence[float] | None = None,
    *,
    fixes: str | Path | Sequence[Sequence[Any]] | None = None,
    wind: str | Path | Mapping[str, Any] | Readings | WindField | None = None,
    quick: bool = True,
    out: str | Path | None = None,
) -> Replanned:
    """Plan the rest of a flight again, from position fixes or a newer forecast (docs/replanning.md).

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`plan` returned, or a results directory.
    time : float or str, optional
        When: seconds after departure, ``"6h"``, or an ISO 8601 time; rounded to a step of the plan. With
        ``fixes`` it is the time of the last one.
    fix : (latitude, longitude, sd) or (x, y, sd), optional
        Measured position [deg, or m on a map without a place on Earth] and its standard deviation [m].
    fixes : path or sequence of (time, latitude, longitude, sd), optional
        Several fixes: a CSV file with the columns ``time,lat,lon,sd_m`` (or ``time,x,y,sd_m``), or rows.
    wind : path, mapping, Readings or WindField, optional
        A newer forecast for the rest of the flight: a file that the reader of the plan's wind reads, or keys
        of section ``wind`` that differ.
    quick : bool
        Whether to use a coarser refinement, which takes half of the time.
    out : path, optional
        Write a results directory of the new plan there.

    Without fixes and without ``wind`` there is no new information, and the rest of the plan is unchanged.

    Raises
    ------
    ConfigError
        If the time lies outside the plan, or a fix is off the map or contradicts another one.
    DataError
        If the file of fixes or the newer forecast cannot be used.
    InfeasibleError
        If no path completes the mission from there.
    """
    from pareto_ltl.run.replan_files import write_replanned
    from pareto_ltl.run.replanning import replanned
    from pareto_ltl.run.situations import fixes_from

    if isinstance(planned, PlanningResult):
        run, source = planned.run, str(planned.run.directory or "a plan in memory")
    else:
        results = load_results(planned)
        require_plan(results, (PLAN,))
        run, source = _run_of(results), str(results.directory)
        run.records[DECOMPOSITION], run.records[AUTOMATON] = results.decomposition, results.automaton
        if out is not None and Path(out).resolve() == results.directory.resolve():
            raise ConfigError(f"{out}: the result would overwrite its source; name another folder")
    done = replanned(run, time, fixes_from(run, time, fix, fixes), wind=wind, quick=quick)
    if out is not None:
        write_replanned(done, run, Path(out), source)
    return done


def simulate(
    planned: PlanningResult | Results | str | Path,
    runs: int = 500,
    law: str = "coherent",
    *,
    seed: int | None = None,
) -> Deployment:
    """Simulate ``runs`` flights of a plan in winds of the law ``law``: ``independent`` or ``coherent``.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`plan` returned, or a results directory.
    seed : int, optional
        Seed of the winds; default the seed of the plan. One seed gives the same winds to every plan.
    """
    run = planned.run if isinstance(planned, PlanningResult) else _run_of(load_results(planned))
    settings = replace(
        run.settings,
        seed=run.settings.seed if seed is None else seed,
        deployment=DeploymentConfig(runs=runs, laws=[law]),
    )
    records = Records({PROBLEM: run.make(PROBLEM), PLAN: run.make(PLAN)})
    return Run(settings, run.table, records).make(DEPLOYMENTS)[law]


def load_results(directory: str | Path | Results) -> Results:
    """The results directory of a finished run; its records are read on first access.

    Raises
    ------
    DataError
        If the directory holds no run.
    """
    results = directory if isinstance(directory, Results) else Results(directory)
    if not (results.directory / "run.json").is_file():
        raise DataError(f"{results.directory}: there is no run.json; name a results directory")
    return results


def _run_of(results: Results) -> Run:
    """The run of a results directory, with its map, its wind and its plan."""
    settings = results.settings
    table = with_extension_stages(PLAN_STAGES, settings.pipelines.stages)
    given = Records({SCENE: results.scene, WIND: results.wind, PLAN: results.plan})
    return Run(settings, table, given)


def _map_settings(scene: str | Path | Mapping[str, Any] | SceneConfig) -> SceneConfig:
    """Settings of the map from its keys, its name or its file; ConfigError for an unknown name."""
    if isinstance(scene, str | Path) and str(scene) not in choices("scene"):
        if not Path(scene).expanduser().is_file():
            ready = ", ".join(choices("scene"))
            raise ConfigError(f"scene {str(scene)!r} is neither a file nor a ready map; there are {ready}")
        return SceneConfig(file=str(scene))
    built = section_of("scene", str(scene) if isinstance(scene, Path) else scene)
    assert isinstance(built, SceneConfig)
    return built
