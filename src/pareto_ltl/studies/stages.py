"""The studies as stages of pipelines: each is a row of ``STUDIES``, which makes the study and its figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run import records
from pareto_ltl.run.records import RecordKey
from pareto_ltl.run.stage_table import FIGURES, Stage, StageInputs, StageTable, with_extension_stages
from pareto_ltl.run.stages import FIGURE_FILES, PLAN_STAGES
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.report.records import Study

STUDY_FILES = "pareto_ltl.report.records:study"
MAP = (records.SCENE, records.DECOMPOSITION)  # records of figures with a map
WORLD = (records.OBSERVATIONS, records.DECOMPOSITION, records.AUTOMATON, records.SCENE)  # for plans


@dataclass(frozen=True, slots=True)
class StudyKind:
    """A study: the stages ``name`` and ``name_figures``.

    Attributes
    ----------
    module : str
        The module of ``studies`` with ``run_name``, which takes the settings, the records of ``needs``, the
        results directory and a function for the progress, and returns the :class:`Study`.
    drawing : str
        The module of ``report`` with ``name_figures``, which takes the settings, the study and the records of
        ``drawn_on``, and returns the functions that draw the figures, by name.
    tables : tuple of str
        The files of the study.
    """

    name: str
    module: str
    drawing: str
    tables: tuple[str, ...]
    needs: tuple[RecordKey[Any], ...] = WORLD
    drawn_on: tuple[RecordKey[Any], ...] = ()

    @property
    def key(self) -> RecordKey[Study]:
        """Key of the record of the study."""
        return RecordKey(self.name)

    def make(self, inputs: StageInputs) -> Study:
        """The tables, numbers and text of the study."""
        run = getattr(import_module(f"pareto_ltl.studies.{self.module}"), f"run_{self.name}")
        study: Study = run(inputs.settings, inputs.records, inputs.directory, inputs.progress)
        return study

    def draw(self, inputs: StageInputs) -> tuple[Path, ...]:
        """The figures of the study; none with ``report.figures=false``."""
        cfg = inputs.settings.report
        if not cfg.figures:
            return ()
        from pareto_ltl.report.axes import save_figures

        figures = getattr(import_module(f"pareto_ltl.report.{self.drawing}"), f"{self.name}{FIGURES}")
        made = figures(inputs.settings, inputs[self.key], *(inputs[key] for key in self.drawn_on))
        return save_figures(inputs.directory / "figures", cfg, made)

    def stages(self) -> Iterator[Stage[Any]]:
        """The stages of the study."""
        yield Stage(
            self.key, self.make, needs=self.needs, writes=self.tables, shows=("tables.md",), codec=STUDY_FILES
        )
        drawn: RecordKey[tuple[Path, ...]] = RecordKey(f"{self.name}{FIGURES}")
        yield Stage(drawn, self.draw, needs=(*self.drawn_on, self.key), shows=FIGURE_FILES)


FIELD_TABLES = ("reliability.csv", "regions.csv", "scorecard.csv", "no_plan.csv")
FLIGHT_TABLES = ("replanning.csv", "replanning_flights.csv")
STUDIES = (
    StudyKind(
        "comparison", "compare", "study_planners",
        ("compare.csv", "compare_seeds.csv", "differences.csv", "no_plan.csv"), drawn_on=MAP,
    ),
    StudyKind(
        "convergence", "convergence", "study_planners",
        ("convergence.csv", "convergence_seeds.csv", "first_answer.csv"),
    ),
    StudyKind("ablation", "compare", "study_planners", ("ablation.csv",)),
    StudyKind(
        "hindcast", "forecast_test", "study_forecast_test", ("hindcast.csv", *FIELD_TABLES), needs=()
    ),
    StudyKind(
        "forecast_test", "forecast_test", "study_forecast_test",
        ("forecast_test.csv", "leads.csv", *FIELD_TABLES), needs=(),
    ),
    StudyKind(
        "departure", "departure", "study_departure",
        ("departures.csv", "departure_lengths.csv", "departures.json"),
        needs=(records.READINGS, *MAP, records.AUTOMATON), drawn_on=MAP,
    ),
    StudyKind("replanning", "replanning", "study_planners", FLIGHT_TABLES),
    StudyKind("replan_test", "replanning", "study_planners", FLIGHT_TABLES, needs=()),
    StudyKind(
        "sitl", "sitl", "study_planners", ("sitl.csv",),
        needs=(records.PROBLEM, records.PLAN, records.EXPORTS), drawn_on=MAP,
    ),
)  # fmt: skip
STUDY_STAGES = tuple(stage for study in STUDIES for stage in study.stages())


def application_stages(settings: Settings) -> StageTable:
    """The stages of plans, of studies and, if ``settings`` list them, of other packages, which it loads."""
    return with_extension_stages((*PLAN_STAGES, *STUDY_STAGES), settings.pipelines.stages)
