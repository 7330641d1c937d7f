"""The studies as stages of pipelines: each is a row of ``STUDIES``, which makes the study and its figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl import Run
from pareto_ltl.extend import Pipeline, Record, UnpricedRun
from pareto_ltl.settings.outputs import FIGURE_FORMATS

if TYPE_CHECKING:
    from pareto_ltl.extend import Study

FIGURE_FILES = tuple(f"figures/*.{kind}" for kind in FIGURE_FORMATS)
STUDY_FILES = "pareto_ltl.run.study:study"
MAP = ("scene", "cells")  # records of figures with a map
WORLD = ("observations", "cells", "automaton", "scene")  # for plans


@dataclass(frozen=True, slots=True)
class StudyKind:
    """A study: the stages ``name`` and ``name_figures``.

    Attributes
    ----------
    module : str
        The module of ``studies`` with ``run_name``, which takes the settings, the records of ``needs``, the
        results directory and a function for the progress, and returns the :class:`Study`.
    drawing : str
        The module of ``view`` with ``name_figures``, which takes the settings, the study and the records of
        ``drawn_on``, and returns the functions that draw the figures, by name.
    tables : tuple of str
        The files of the study.
    many_missions : bool
        It plans in several processes.
    """

    name: str
    module: str
    drawing: str
    tables: tuple[str, ...]
    needs: tuple[str, ...] = WORLD
    drawn_on: tuple[str, ...] = ()
    many_missions: bool = True

    def make(self, run: Run) -> Study:
        """The tables, numbers and text of the study."""
        work = getattr(import_module(f"pareto_ltl_apps.studies.{self.module}"), f"run_{self.name}")
        world = UnpricedRun(run.settings, run.make(*self.needs))
        study: Study = work(run.settings, world, run.place, run.progress)
        return study

    def draw(self, run: Run, study: Study) -> tuple[Path, ...]:
        """The figures of the study; none with ``report.figures=false``."""
        cfg = run.settings.report
        if not cfg.figures:
            return ()
        from pareto_ltl_apps.view.axes import save_figures

        figures = getattr(
            import_module(f"pareto_ltl_apps.view.{self.drawing}"), f"{self.name}{Pipeline.FIGURES}"
        )
        made = figures(run.settings, study, *run.make(*self.drawn_on).values())
        return save_figures(run.place / "figures", cfg, made)

    def stages(self) -> Iterator[Record[Any]]:
        """The stages of the study."""
        study = Record(
            self.make, self.name, self.tables, ("tables.md",), STUDY_FILES, study=self.many_missions
        )  # fmt: skip
        yield study

        def draw(run: Run) -> tuple[Path, ...]:
            """The figures of the study."""
            return self.draw(run, run.made(study))

        yield Record(draw, f"{self.name}{Pipeline.FIGURES}", shows=FIGURE_FILES)


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
        ("forecast_test.csv", "leads.csv", "surfaces.csv", "promise_levels.csv", "conformal_limits.csv",
         *FIELD_TABLES), needs=(),
    ),
    StudyKind(
        "departure", "departure", "study_departure",
        ("departures.csv", "departure_lengths.csv", "departures.json"),
        needs=("readings", *MAP, "automaton"), drawn_on=MAP,
    ),
    StudyKind(
        "levels", "levels", "study_levels", ("levels.csv", "level_lengths.csv", "levels.json"),
        needs=(*MAP, "automaton"), drawn_on=MAP,
    ),
    StudyKind("replanning", "replanning", "study_planners", FLIGHT_TABLES),
    StudyKind("replan_test", "replanning", "study_planners", FLIGHT_TABLES, needs=()),
    StudyKind(
        "sitl", "sitl", "study_planners", ("sitl.csv",),
        needs=("problem", "plan"), drawn_on=MAP, many_missions=False,
    ),
)  # fmt: skip
STUDY_STAGES = tuple(stage for study in STUDIES for stage in study.stages())
