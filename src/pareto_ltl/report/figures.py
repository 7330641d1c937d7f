"""All figures of one run.

``plan`` shows the plan and its simulated flights, ``front`` the paths it was selected from, ``wind`` the wind
field. A run without a plan still has a map with its trees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pareto_ltl.planning.records import Forest, Front, Plan
from pareto_ltl.report import style
from pareto_ltl.report.front import RISK_LABELS, front_figure
from pareto_ltl.report.map import plan_figure
from pareto_ltl.report.wind import wind_figure
from pareto_ltl.settings import ReportConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """The records of a run that its figures show.

    Attributes
    ----------
    forest, front, plan : or None
        None where the run did not make it; the map then says that there is no plan.
    mission_bound : str
        The bound that paths are judged by, ``fidelity.mission_bound``.
    deployments : mapping of wind law to Deployment
        Simulated flights; the first ``report.paths`` of each law are drawn.
    """

    scene: Scene
    decomposition: Decomposition
    wind: WindField
    forest: Forest | None = None
    front: Front | None = None
    plan: Plan | None = None
    mission_bound: str = "theorem2"
    deployments: Mapping[str, Deployment] = field(default_factory=dict)


def draw_run_figures(folder: Path, cfg: ReportConfig, run: DrawnRun) -> tuple[Path, ...]:
    """Write ``plan``, ``front`` and ``wind``, each as .png and .svg, into ``folder``; return their paths.

    ``front`` is left out if the run has no front or an empty one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with style.report_style():
        figures = {
            "plan": plan_figure(
                cfg, run.scene, run.decomposition, run.wind, run.forest, run.plan, run.deployments
            ),
            "wind": wind_figure(run.scene, run.wind, run.plan),
        }
        if run.front is not None and run.front.paths:
            label = RISK_LABELS[run.mission_bound]
            figures["front"] = front_figure(run.scene, run.forest, run.front, run.plan, label)
        return tuple(
            path
            for name, figure in figures.items()
            for path in style.save_figure(figure, folder, name, cfg.dpi)
        )


__all__ = ["DrawnRun", "draw_run_figures"]
