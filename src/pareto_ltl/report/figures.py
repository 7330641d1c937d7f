"""All figures of one run.

``plan`` shows the plan and its simulated flights, ``limits`` what limits the plan, ``front`` the paths it was
selected from, ``wind`` the wind field. A run without a plan still has a map with its trees.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from pareto_ltl.report.axes import Figures, save_figures
from pareto_ltl.report.front import front_figure
from pareto_ltl.report.map import plan_figure
from pareto_ltl.report.plan_maps import limits_figure
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.report.wind import wind_figure
from pareto_ltl.settings import ReportConfig


def draw_run_figures(folder: Path, cfg: ReportConfig, run: DrawnRun) -> tuple[Path, ...]:
    """Write the figures of ``run`` into ``folder``, each in ``report.formats``; return the paths.

    They are ``plan``, ``wind``, ``limits`` if the plan has limits or prices, and ``front`` if the run has a
    front that is not empty.
    """
    made: Figures = {"plan": partial(plan_figure, cfg, run)}
    if run.wind is not None:
        made["wind"] = partial(wind_figure, run.scene, run.wind, run.plan)
    if run.front is not None and len(run.front.paths) > 0:
        made["front"] = partial(front_figure, run.scene, run.forest, run.front, run.plan, run.medium)
    if run.plan is not None and (run.plan.limits is not None or run.plan.prices):
        made["limits"] = partial(limits_figure, run, run.plan)
    return save_figures(folder, cfg, made)
