"""The studies as stages: what ``pipelines/compare.yaml``, ``convergence``, ``ablation`` and ``hindcast``
list.

They join the stages of a plan by name; importing this file makes them known. Rooms are imported inside, as
in ``stages.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.run.stages import Progress, stage

if TYPE_CHECKING:
    from pareto_ltl.logic import Automaton
    from pareto_ltl.settings import ReportConfig, Settings
    from pareto_ltl.studies.records import Study
    from pareto_ltl.wind.records import WindObservations
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene


@stage
def comparison(
    settings: Settings,
    scene: Scene,
    observations: WindObservations,
    decomposition: Decomposition,
    automaton: Automaton,
    directory: Path,
    progress: Progress,
) -> Study:
    """One mission, several planners, the same winds."""
    from pareto_ltl.studies import compare

    return compare.study(settings, _world(scene, observations, decomposition, automaton), directory, progress)


@stage
def convergence(
    settings: Settings,
    scene: Scene,
    observations: WindObservations,
    decomposition: Decomposition,
    automaton: Automaton,
    directory: Path,
    progress: Progress,
) -> Study:
    """Bound and failure of the selected path as the trees grow."""
    from pareto_ltl.studies import convergence as room

    return room.study(settings, _world(scene, observations, decomposition, automaton), directory, progress)


@stage
def ablation(
    settings: Settings,
    scene: Scene,
    observations: WindObservations,
    decomposition: Decomposition,
    automaton: Automaton,
    directory: Path,
    progress: Progress,
) -> Study:
    """One setting changed at a time."""
    from pareto_ltl.studies import ablation as room

    return room.study(settings, _world(scene, observations, decomposition, automaton), directory, progress)


@stage
def hindcast(settings: Settings, directory: Path, progress: Progress) -> Study:
    """Planned from thinned readings, flown through the fields they were thinned from."""
    from pareto_ltl.studies import hindcast as room

    return room.study(settings, directory, progress)


@stage
def comparison_figures(
    report_cfg: ReportConfig, directory: Path, scene: Scene, decomposition: Decomposition, comparison: Study
) -> tuple[Path, ...]:
    if not report_cfg.figures:
        return ()
    from pareto_ltl.report.study_comparison import draw_comparison

    return draw_comparison(directory / "figures", report_cfg, scene, decomposition, comparison)


@stage
def convergence_figures(report_cfg: ReportConfig, directory: Path, convergence: Study) -> tuple[Path, ...]:
    if not report_cfg.figures:
        return ()
    from pareto_ltl.report.study_convergence import draw_convergence

    return draw_convergence(directory / "figures", report_cfg, convergence)


@stage
def ablation_figures(report_cfg: ReportConfig, directory: Path, ablation: Study) -> tuple[Path, ...]:
    if not report_cfg.figures:
        return ()
    from pareto_ltl.report.study_ablation import draw_ablation

    return draw_ablation(directory / "figures", report_cfg, ablation)


@stage
def hindcast_figures(report_cfg: ReportConfig, directory: Path, hindcast: Study) -> tuple[Path, ...]:
    if not report_cfg.figures:
        return ()
    from pareto_ltl.report.study_hindcast import draw_hindcast

    return draw_hindcast(directory / "figures", report_cfg, hindcast)


def _world(
    scene: Scene, observations: WindObservations, decomposition: Decomposition, automaton: Automaton
) -> dict[str, object]:
    return {
        "scene": scene,
        "observations": observations,
        "decomposition": decomposition,
        "automaton": automaton,
    }
