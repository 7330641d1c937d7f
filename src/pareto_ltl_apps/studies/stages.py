"""The studies as stages of pipelines: one makes its tables, one draws its figures."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl import Run
from pareto_ltl.extend import Pipeline, Record, UnpricedRun
from pareto_ltl.settings.outputs import FIGURE_FORMATS
from pareto_ltl_apps.studies.kinds import STUDIES, StudyKind

if TYPE_CHECKING:
    from pareto_ltl.extend import Study

FIGURE_FILES = tuple(f"figures/*.{kind}" for kind in FIGURE_FORMATS)
STUDY_FILES = "pareto_ltl.run.study:study"


def draw_study(kind: StudyKind, run: Run, study: Study) -> tuple[Path, ...]:
    """The figures of the study; none with ``report.figures=false``."""
    cfg = run.settings.report
    if not cfg.figures:
        return ()
    from pareto_ltl_apps.view.axes import save_figures

    module, _, function = kind.figures.partition(".")
    figures = getattr(import_module(f"pareto_ltl_apps.view.{module}"), function)
    made = figures(run.settings, study, *run.make(*kind.drawn_on).values())
    return save_figures(run.place / "figures", cfg, made)


def stages_of(kind: StudyKind) -> Iterator[Record[Any]]:
    """The stages of a study."""

    def make(run: Run) -> Study:
        """The tables, numbers and text of the study."""
        world = UnpricedRun(run.settings, run.make(*kind.needs))
        return kind.make(run.settings, world, run.place, run.progress)

    study = Record(make, kind.name, kind.tables, ("tables.md",), STUDY_FILES, study=kind.many_missions)
    yield study

    def draw(run: Run) -> tuple[Path, ...]:
        """The figures of the study."""
        return draw_study(kind, run, run.made(study))

    yield Record(draw, f"{kind.name}{Pipeline.FIGURES}", shows=FIGURE_FILES)


STUDY_STAGES = tuple(stage for kind in STUDIES.values() for stage in stages_of(kind))
