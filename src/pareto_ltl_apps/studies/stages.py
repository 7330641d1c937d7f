"""The studies as stages of pipelines: one makes its tables, one draws its figures."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.machine import cores
from pareto_ltl import Run
from pareto_ltl.extend import Pipeline, Record, UnpricedRun
from pareto_ltl_apps.studies.kinds import STUDIES, StudyKind
from pareto_ltl_apps.studies.settings import EvaluationConfig
from pareto_ltl_apps.view.settings import FIGURE_FORMATS, ReportConfig

if TYPE_CHECKING:
    from pareto_ltl import Settings
    from pareto_ltl.extend import Study

FIGURE_FILES = tuple(f"figures/*.{kind}" for kind in FIGURE_FORMATS)
STUDY_FILES = "pareto_ltl.run.study:study"


def draw_study(kind: StudyKind, run: Run, study: Study) -> tuple[Path, ...]:
    """The figures of the study; none with ``report.figures=false``."""
    cfg = run.settings[ReportConfig]
    if not cfg.figures:
        return ()
    from pareto_ltl_apps.view.axes import save_figures

    module, _, function = kind.figures.partition(".")
    figures = getattr(import_module(f"pareto_ltl_apps.view.{module}"), function)
    made = figures(run.settings, study, *run.make(*kind.drawn_on).values())
    return save_figures(run.place / "figures", cfg, made)


def check_size(kind: StudyKind, settings: Settings) -> None:
    """Raise ConfigError if the trees of the study can never fit into memory."""
    planner, grown = settings.planner, "forest" in settings.pipelines.stages
    jobs = 1 if grown else settings[EvaluationConfig].jobs or cores()
    where = f" in each of {jobs} processes (evaluation.jobs)" if jobs > 1 else ""
    Pipeline.require_trees(planner, "planner.n_max", planner.n_max, jobs, where)
    if kind.sizes:
        largest = max(attrgetter(kind.sizes)(settings))
        Pipeline.require_trees(planner, kind.sizes, largest, where=where)


def stages_of(kind: StudyKind) -> Iterator[Record[Any]]:
    """The stages of a study."""

    def make(run: Run) -> Study:
        """The tables, numbers and text of the study."""
        world = UnpricedRun(run.settings, run.make(*kind.needs))
        return kind.make(run.settings, world, run.place, run.progress)

    study = Record(make, kind.name, kind.tables, ("tables.md",), STUDY_FILES, words=kind.words)
    study.elsewhere = kind.many_missions
    if kind.many_missions:
        study.check = partial(check_size, kind)
    yield study

    def draw(run: Run) -> tuple[Path, ...]:
        """The figures of the study."""
        return draw_study(kind, run, run.made(study))

    yield Record(draw, f"{kind.name}{Pipeline.FIGURES}", shows=FIGURE_FILES)


STUDY_STAGES = tuple(stage for kind in STUDIES.values() for stage in stages_of(kind))
