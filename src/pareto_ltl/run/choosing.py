"""Another path of a front as the plan, without planning again.

The records of a run (map, wind, cells, automaton, trees, front) are reused; the stages from the plan on run
with another selection. Their files are identical to the files of a whole run with that selection.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run.directory import claimed_directory
from pareto_ltl.run.file_shape import shaped
from pareto_ltl.run.pipeline import Run, carry_out
from pareto_ltl.run.records import (
    AUTOMATON,
    DECOMPOSITION,
    FOREST,
    FRONT,
    OBSERVATIONS,
    PLAN,
    READINGS,
    SCENE,
    WIND,
    RecordKey,
    Records,
)
from pareto_ltl.run.results import Results
from pareto_ltl.run.stage_table import Stage, StageTable
from pareto_ltl.settings import SelectionConfig, Settings
from pareto_ltl.settings.building import section_of
from pareto_ltl.support.display import distance_text, probability_text, round_up
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.run_status import ending_text

if TYPE_CHECKING:
    from pareto_ltl.planning.records import Front

KEPT: tuple[RecordKey[Any], ...] = (SCENE, DECOMPOSITION, AUTOMATON, WIND, FOREST, FRONT)
RAW: tuple[RecordKey[Any], ...] = (READINGS, OBSERVATIONS)  # from which the wind was made


@dataclass(frozen=True, slots=True)
class Choice:
    """The criterion for a path of a front; give exactly one.

    Attributes
    ----------
    failure : float or None
        The shortest path with at most this failure rate (upper end of its interval).
    length : float or None
        The safest path of at most this length [m].
    knee : bool
        The knee of the front.
    point : int or None
        The path of that number in ``front.csv``.
    energy : float or None
        The path with the least energy and at most this failure rate.
    selection : mapping or None
        The path that these settings of ``selection`` pick: a rule and what it reads.
    """

    failure: float | None = None
    length: float | None = None
    knee: bool = False
    point: int | None = None
    energy: float | None = None
    selection: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        values = (self.failure, self.length, self.point, self.energy, self.selection)
        if sum(value is not None for value in values) + self.knee != 1:
            raise ConfigError("give one of failure, energy, length, knee, point and selection")
        if self.selection is not None and "rule" not in self.selection:
            raise ConfigError(
                "selection names no rule; expected e.g. {'rule': 'weighted', 'weights': [1, 0, 0]}"
            )
        if self.point is not None and self.point < 0:
            raise ConfigError(f"point must be the number of a path, 0 or more, got {self.point}")

    def settings(self, cfg: SelectionConfig) -> SelectionConfig:
        """``cfg`` with the rule for this criterion; raises ConfigError for a value out of range."""
        changes = self._changes()
        values = {field.name: getattr(cfg, field.name) for field in fields(cfg)}
        if changes["rule"] != cfg.rule:
            values["options"] = {}  # options belong to one rule
        changed = section_of("selection", values | changes)
        assert isinstance(changed, SelectionConfig)
        return changed

    def _changes(self) -> dict[str, Any]:
        """The settings of ``selection`` that express this criterion."""
        if self.selection is not None:
            return dict(self.selection)
        if self.failure is not None:
            return {"rule": "threshold", "alpha": self.failure}
        if self.energy is not None:
            return {"rule": "energy", "alpha": self.energy}
        if self.length is not None:
            return {"rule": "length", "length": self.length}
        if self.point is not None:
            return {"rule": "point", "point": self.point}
        return {"rule": "knee"}

    @property
    def name(self) -> str:
        """The choice as part of the name of a folder: ``failure_0.02``, ``length_1900km``, ``point_3``."""
        if self.selection is not None:
            return f"rule_{self.selection['rule']}"
        if self.failure is not None:
            return f"failure_{self.failure:g}"
        if self.energy is not None:
            return f"energy_{self.energy:g}"
        if self.length is not None:
            return f"length_{self.length / 1e3:.10g}km"
        return "knee" if self.point is None else f"point_{self.point}"


def require_choice(choice: Choice, front: Front, where: str) -> None:
    """Raise InfeasibleError if ``front`` has no such path; the text begins with ``where``."""
    lengths = [path.objectives.length for path in front.paths]
    if choice.point is not None and choice.point >= len(lengths):
        raise InfeasibleError(
            f"{where}: there is no point {choice.point}; the front has points 0 to {len(lengths) - 1}"
        )
    if choice.length is not None and choice.length < min(lengths):
        raise InfeasibleError(
            f"{where}: no path is as short as {distance_text(choice.length)}; the shortest of the front, "
            f"point {lengths.index(min(lengths))}, has {distance_text(min(lengths))}"
        )
    limits = [rate.high for rate in front.rates] or [
        path.objectives.mission_risk + path.objectives.collision_risk for path in front.paths
    ]
    if choice.energy is not None and "energy" not in front.paths[0].objectives.costs:
        raise ConfigError(
            f"{where}: the paths have no energy; plan with a robot that has a power curve, e.g. "
            "robot=fixed_wing"
        )
    wanted = choice.failure if choice.energy is None else choice.energy
    if wanted is not None and wanted < min(limits):
        named = "upper end of 95 %" if front.rates else f"bound {front.models.mission_symbol} + R"
        raise InfeasibleError(
            f"{where}: no path has a failure rate of at most {probability_text(wanted)} in "
            f"{front.models.law} winds ({named}); the safest path of the front, "
            f"point {limits.index(min(limits))}, has {probability_text(min(limits))}: use "
            f"{round_up(min(limits)):g} or more"
        )


# --- from a results directory -------------------------------------------------------------------


def choose_from_results(
    results: Results, choice: Choice, table: StageTable, place: Path, argv: Sequence[str] = ()
) -> Run:
    """Write the results of ``choice`` into ``place``, from the records of ``results``.

    Raises
    ------
    ConfigError
        If ``place`` is the directory of ``results``.
    DataError
        If ``results`` holds no finished plan.
    InfeasibleError
        If the front has no such path.
    """
    require_plan(results)
    if place.resolve() == results.directory.resolve():
        raise ConfigError(f"{place}: the result would overwrite its source; name another folder")
    settings = chosen_settings(results.settings, choice)
    records = kept_records(results)
    require_choice(choice, records[FRONT], str(results.directory))
    run = Run(settings, table, records, directory=place)
    with claimed_directory(place, table.files):
        carry_out(run, later_stages(settings, table), argv)
    return run


def require_plan(results: Results, needed: Sequence[RecordKey[Any]] = (FRONT, PLAN)) -> None:
    """Raise DataError unless ``results`` is a finished run with the records ``needed``."""
    directory = results.directory
    if not directory.is_dir():
        raise DataError(f"{directory}: no such folder; give a results directory")
    if results.run.get("status") != "ok":
        raise DataError(
            f"{directory}: there is no front to choose from: "
            f"{ending_text(directory, results.run.get('status'))}"
        )
    stages = results.settings.pipelines.stages
    missing = [key.name for key in needed if key.name not in stages]
    if missing == [FRONT.name] and (directory / "replan.json").is_file():
        raise DataError(
            f"{directory}: the plan was made after an alarm (replan.json), so that its front has no failure "
            "rates to choose by; replan with a correct fix or forecast"
        )
    if missing:
        raise DataError(
            f"{directory}: its run made no {' and no '.join(missing)}; name the results directory of a plan"
        )


def chosen_settings(settings: Settings, choice: Choice) -> Settings:
    """``settings`` with the rule of ``choice``."""
    return replace(settings, selection=choice.settings(settings.selection))


def kept_records(results: Results) -> Records:
    """The records of ``results`` that come before the plan; the forest with its time of growth."""
    fronted = FRONT.name in results.settings.pipelines.stages  # else a plan after an alarm
    records = Records({key: results[key] for key in KEPT if fronted or key is not FRONT})
    with shaped(results.directory / "metrics.json", "the metrics of a run"):
        timed = replace(records[FOREST], seconds=float(results.metrics["growth_seconds"]))
    return records.replaced(FOREST, timed)


def later_stages(settings: Settings, table: StageTable) -> list[Stage[Any]]:
    """The stages of ``settings`` that must run; stages of ``RAW`` only if another one needs their record."""
    stages = [table[name] for name in settings.pipelines.stages]
    left = [stage for stage in stages if stage.makes not in KEPT]
    wanted = {need for stage in left for need in (*stage.needs, *stage.uses) if stage.makes not in RAW}
    return [stage for stage in left if stage.makes not in RAW or stage.makes in wanted]


def default_place(directory: Path, choice: Choice) -> Path:
    """A folder beside ``directory``, with the choice in its name."""
    directory = directory.resolve()
    return directory.with_name(f"{directory.name}_{choice.name}")
