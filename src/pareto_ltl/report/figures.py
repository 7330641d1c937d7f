"""All figures of one run.

``plan`` shows the plan and its simulated flights, ``front`` the paths it was selected from, ``wind`` the wind
field. A run without a plan still has a map with its trees.
"""

from __future__ import annotations

from pathlib import Path

from pareto_ltl.report import style
from pareto_ltl.report.front import front_figure
from pareto_ltl.report.map import plan_figure
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.report.wind import wind_figure
from pareto_ltl.settings import ReportConfig


def draw_run_figures(folder: Path, cfg: ReportConfig, run: DrawnRun) -> tuple[Path, ...]:
    """Write ``plan``, ``front`` and ``wind``, each as .png and .svg, into ``folder``; return their paths.

    ``front`` is left out if the run has no front or an empty one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with style.report_style():
        figures = {
            "plan": plan_figure(cfg, run),
            "wind": wind_figure(run.scene, run.wind, run.plan),
        }
        if run.front is not None and run.front.paths:
            figures["front"] = front_figure(run.scene, run.forest, run.front, run.plan)
        return tuple(
            path
            for name, figure in figures.items()
            for path in style.save_figure(figure, folder, name, cfg.dpi)
        )


__all__ = ["DrawnRun", "draw_run_figures"]
