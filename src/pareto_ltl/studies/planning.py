"""Planners and flights for studies, by runs of ``run/pipeline.py`` without a results directory.

A plan made here is identical to the plan of the command line with the same settings: the stages and their
random streams are the same.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import WIND, Records
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.run.stages import PLAN_TABLE
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.support.arrays import FloatArray
    from pareto_ltl.wind.records import WindField

OF_THE_LATTICE = ("origin", "spacing", "times", "until", "ends", "leads", "level", "score", "source")


def study_run(settings: Settings, world: Records) -> Run:
    """A run from the records of ``world``; it does not change ``world``."""
    return Run(settings, PLAN_TABLE, world.copy())


def with_wind(settings: Settings, world: Records) -> Records:
    """``world`` with its wind field, for all planners that use the same one."""
    return world.replaced(WIND, study_run(settings, world).make(WIND))


def still(wind: WindField) -> WindField:
    """The field of a planner that ignores the wind: mean and uncertainty are 0."""
    import numpy as np

    values = {f.name: getattr(wind, f.name) for f in fields(wind) if f.name not in OF_THE_LATTICE}
    zeros: dict[str, Any] = {
        name: np.zeros_like(value) for name, value in values.items() if isinstance(value, np.ndarray)
    }
    gone: dict[str, Any] = {name: None for name, value in values.items() if is_dataclass(value)}  # modes
    return replace(wind, **zeros, **gone)


def unsmoothed(settings: Settings) -> Settings:
    """The published planner: paths of the trees without refinement."""
    return replace(settings, fidelity=replace(settings.fidelity, refine="none"))


def fly_seeded(
    truth: Problem, u: FloatArray, runs: int, law: str, seed: int, mean: FloatArray | None = None
) -> Deployment:
    """Fly ``u`` (T, 2) [m/s] in the winds of the deployment of a run with ``seed``, along ``mean``.

    The same seed and law give the same winds for all plans (common random numbers).
    """
    from pareto_ltl.simulation.flights import DRAWS, simulate_flights

    children = dict(zip(DRAWS, stage_seeds(seed, "deployment").spawn(len(DRAWS)), strict=True))
    return simulate_flights(truth, u, runs, law, children[law], mean)
