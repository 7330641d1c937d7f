"""The studies as stages of pipelines: each is a row of ``STUDIES``, which makes the study and its figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run.records import (
    AUTOMATON,
    DECOMPOSITION,
    EXPORTS,
    OBSERVATIONS,
    PLAN,
    PROBLEM,
    READINGS,
    SCENE,
    RecordKey,
)
from pareto_ltl.run.stage_table import FIGURES, Stage, StageInputs, StageTable, with_extension_stages
from pareto_ltl.run.stages import FIGURE_FILES, PLAN_STAGES
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

WORLD = (OBSERVATIONS, DECOMPOSITION, AUTOMATON, SCENE)  # records from which a study plans
STUDY_FILES = "pareto_ltl.report.records:study"
MAP = (SCENE, DECOMPOSITION)  # records of figures with a map


@dataclass(frozen=True, slots=True)
class StudyKind:
    """A study: the stage ``name``, and the stage ``name_figures`` if it has figures.

    Attributes
    ----------
    run : str
        ``module:function`` in ``studies``; the function takes the settings, the records of ``needs``, the
        results directory and a function for the progress, and returns the :class:`Study`.
    tables : tuple of str
        The files of the study.
    figures : str
        ``module:function`` in ``report``; the function takes the settings, the study and the records of
        ``drawn_on``, and returns the functions that draw the figures, by name.
    """

    name: str
    run: str
    tables: tuple[str, ...]
    figures: str = ""
    needs: tuple[RecordKey[Any], ...] = WORLD
    drawn_on: tuple[RecordKey[Any], ...] = ()

    def make(self, inputs: StageInputs) -> Study:
        """The tables, numbers and text of the study."""
        run = _function(f"pareto_ltl.studies.{self.run}")
        study: Study = run(inputs.settings, inputs.records, inputs.directory, inputs.progress)
        return study

    def draw(self, inputs: StageInputs) -> tuple[Path, ...]:
        """The figures of the study; none with ``report.figures=false``."""
        cfg = inputs.settings.report
        if not cfg.figures:
            return ()
        from pareto_ltl.report.study_axes import save_figures

        made, world = _function(f"pareto_ltl.report.{self.figures}"), [inputs[key] for key in self.drawn_on]
        return save_figures(
            inputs.directory / "figures", cfg, made(inputs.settings, inputs[self.key], *world)
        )

    @property
    def key(self) -> RecordKey[Study]:
        """Key of the record of the study."""
        return RecordKey(self.name)

    def stages(self) -> Iterator[Stage[Any]]:
        """The stages of the study."""
        yield Stage(
            makes=self.key,
            make=self.make,
            needs=self.needs,
            writes=self.tables,
            shows=("tables.md",),
            codec=STUDY_FILES,
        )
        if self.figures:
            name, needs = f"{self.name}{FIGURES}", (*self.drawn_on, self.key)
            key: RecordKey[tuple[Path, ...]] = RecordKey(name)
            yield Stage(makes=key, make=self.draw, needs=needs, shows=FIGURE_FILES)


def _function(place: str) -> Any:
    """The function at ``module:function``."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


FIELD_TABLES = ("reliability.csv", "regions.csv", "scorecard.csv", "no_plan.csv")
STUDIES = (
    StudyKind(
        "comparison",
        "compare:run_comparison",
        ("compare.csv", "compare_seeds.csv", "differences.csv", "no_plan.csv"),
        "study_comparison:comparison_figures",
        drawn_on=MAP,
    ),
    StudyKind(
        "convergence",
        "convergence:run_convergence",
        ("convergence.csv", "convergence_seeds.csv", "first_answer.csv"),
        "study_convergence:convergence_figures",
    ),
    StudyKind("ablation", "ablation:run_ablation", ("ablation.csv",), "study_ablation:ablation_figures"),
    StudyKind(
        "hindcast",
        "forecast_test:run_hindcast",
        ("hindcast.csv", *FIELD_TABLES),
        "study_forecast_test:reliability_figures",
        needs=(),
    ),
    StudyKind(
        "forecast_test",
        "forecast_test:run_forecast_test",
        ("forecast_test.csv", "leads.csv", *FIELD_TABLES),
        "study_forecast_test:forecast_test_figures",
        needs=(),
    ),
    StudyKind(
        "departure",
        "departure:run_departure",
        ("departures.csv", "departure_lengths.csv", "departures.json"),
        "study_departure:departure_figures",
        needs=(READINGS, SCENE, DECOMPOSITION, AUTOMATON),
        drawn_on=MAP,
    ),
    StudyKind(
        "replanning",
        "replanning:run_replanning",
        ("replanning.csv", "replanning_flights.csv"),
        "study_replanning:replanning_figures",
    ),
    StudyKind(
        "replan_test",
        "replan_test:run_replan_test",
        ("replanning.csv", "replanning_flights.csv"),
        "study_replanning:replanning_figures",
        needs=(),
    ),
    StudyKind(
        "sitl",
        "sitl:run_sitl",
        ("sitl.csv",),
        "study_sitl:sitl_figures",
        needs=(PROBLEM, PLAN, EXPORTS),
        drawn_on=MAP,
    ),
)
STUDY_STAGES = tuple(stage for study in STUDIES for stage in study.stages())


def application_stages(settings: Settings) -> StageTable:
    """The stages of plans, of studies and, if ``settings`` list them, of other packages, which it loads."""
    return with_extension_stages((*PLAN_STAGES, *STUDY_STAGES), settings.pipelines.stages)
