"""The stages that applications add to every pipeline: files of the plan, figures, the page, the studies."""

from __future__ import annotations

import logging
from pathlib import Path

from pareto_ltl import Run
from pareto_ltl.extend import Record
from pareto_ltl_apps.exports.kinds import BRANCH_FILES, format_files
from pareto_ltl_apps.exports.settings import ExportsConfig
from pareto_ltl_apps.formats.settings import IngestConfig
from pareto_ltl_apps.studies.stages import FIGURE_FILES, STUDY_STAGES
from pareto_ltl_apps.view import PAGE_FILE
from pareto_ltl_apps.view.settings import ReportConfig

LOG = logging.getLogger("pareto_ltl.stages")


def write_plan_files(run: Run) -> tuple[Path, ...]:
    """Files of the plan, in the formats of ``exports.formats`` that the map and its departure allow."""
    settings, plan, problem = run.settings, run.plan, run.problem
    if not settings[ExportsConfig].files:
        return ()
    from pareto_ltl_apps.exports.exported import exported_plan
    from pareto_ltl_apps.exports.formats import writable_formats, write_exports

    formats, reason = writable_formats(settings[ExportsConfig].formats, problem.scene, plan.path.t)
    if reason:
        LOG.info("%s", reason)
    if not formats:
        return ()
    return write_exports(exported_plan(settings, problem, plan, run.seeds("export")), formats, run.place)


def draw_figures(run: Run) -> tuple[Path, ...]:
    """Figures of the records that exist; without a plan the map shows how far the trees came."""
    if not run.settings[ReportConfig].figures:
        return ()
    from pareto_ltl_apps.view.figures import draw_run_figures
    from pareto_ltl_apps.view.page_stage import drawn_records
    from pareto_ltl_apps.view.records import DrawnRun

    drawn = DrawnRun(decomposition=run.cells, **drawn_records(run))
    return draw_run_figures(run.place / "figures", run.settings[ReportConfig], drawn)


def write_page(run: Run) -> tuple[Path, ...]:
    """``report.html`` from the records that exist; without a plan the page states the reason."""
    if not run.settings[ReportConfig].page:
        return ()
    from pareto_ltl_apps.view.page_stage import make_page

    return (make_page(run),)


def write_table(run: Run) -> Path:
    """The wind table of ``pipelines=ingest``; its path is relative to the current folder."""
    from pareto_ltl_apps.formats.wind_table import write_wind_table

    ingest = run.settings[IngestConfig]
    return write_wind_table(run.settings.wind, run.readings, ingest, Path(ingest.out))


EXPORTED = (*format_files(), *BRANCH_FILES)
EXPORT = Record(
    write_plan_files,
    "export",
    EXPORTED,
    name="exports",
    words="Writing files",
    later=tuple(folder + name for folder in ("exports/", "exports_point_*/") for name in EXPORTED),
)
FIGURES = Record(draw_figures, "report", shows=FIGURE_FILES, name="figures", words="Drawing figures")
PAGE = Record(write_page, "page", shows=(PAGE_FILE,), words="Writing the report")
TABLE = Record(write_table, "table")
TABLE.elsewhere = True
STAGES = (TABLE, EXPORT, FIGURES, PAGE, *STUDY_STAGES)
