"""Planners and flights for studies, by runs without a results directory.

A plan made here is identical to the plan of the command line with the same settings: the stages and their
random streams are the same. ``compare``, ``ablation`` and ``convergence`` fly the plans of several planners,
seeds or sizes in the same winds; :func:`outcomes` has their flights, :func:`failure_columns` the columns that
their tables share.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl import Run, Settings, WindField
from pareto_ltl.extend import Deployment, Forecast, Plan, Problem, law_seeds
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.seeds import stage_seeds
from pareto_ltl_apps.studies import tables
from pareto_ltl_apps.studies.parts import Part, Progress, part_key, work_parts
from pareto_ltl_apps.studies.settings import EvaluationConfig
from pareto_ltl_apps.studies.tables import Columns

OF_THE_LATTICE = ("origin", "spacing", "times", "until", "ends", "leads", "level", "score", "source")
FLAGS = ("accepted", "collided", "off_map", "failed")

Result = Mapping[str, Any]
Results = Mapping[tuple[Any, int], Result]  # by planner and seed


def with_wind(settings: Settings, world: Run) -> Run:
    """``world`` with its wind field, for all planners that use the same one."""
    return world.given(wind=world.with_settings(settings).wind)


def still(wind: WindField) -> WindField:
    """The field of a planner that ignores the wind: mean and uncertainty are 0."""
    still: dict[str, Any] = {}
    for name in (f.name for f in fields(wind) if f.name not in OF_THE_LATTICE):
        if isinstance(value := getattr(wind, name), np.ndarray):
            still[name] = np.zeros_like(value)
        elif is_dataclass(value):  # modes
            still[name] = None
    return replace(wind, **still)


def unsmoothed(settings: Settings, **planner: Any) -> Settings:
    """The published planner, in one thread: paths of the trees without refinement; ``planner``: settings."""
    models = replace(settings.fidelity, refine="none")
    return replace(settings, fidelity=models, planner=replace(settings.planner, threads=1, **planner))


def truth(settings: Settings, world: Run) -> Problem:
    """The problem in which plans are flown: ``fidelity=full``, all wind laws."""
    laws = list(settings[EvaluationConfig].laws)
    real = replace(
        settings, fidelity=Settings.preset("full"), deployment=replace(settings.deployment, laws=laws)
    )
    return world.with_settings(real).problem


def fly_seeded(
    truth: Problem, u: FloatArray, runs: int, law: str, seed: int, mean: FloatArray | None = None
) -> Deployment:
    """Fly ``u`` (T, 2) [m/s] in the winds of the deployment of a run with ``seed``, along ``mean``.

    The same seed and law give the same winds for all plans (common random numbers).
    """
    from pareto_ltl.extend import simulate_flights

    child = law_seeds(stage_seeds(seed, "deployment"))[law]
    return simulate_flights(truth, u, runs, law, child, mean)


# --- several planners -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Planner:
    """A planner, and the problem in which its plans are flown.

    Attributes
    ----------
    pieces : int
        Number of parts into which each step of a plan is divided for its flights, with the same control.
    seeded : bool
        Whether the plan depends on the seed; if not, it is made once in each process.
    key : tuple
        What the results depend on beside the settings of ``run``, the number of flights and their laws.
    """

    run: Run
    truth: Problem
    key: tuple[Any, ...]
    pieces: int = 1
    seeded: bool = True

    def flown(self, plan: Plan) -> tuple[FloatArray, FloatArray | None]:
        """Controls (T, 2) [m/s] and means (T+1, 2) [m] of the flights of ``plan``; None: not known."""
        if self.pieces == 1:
            return plan.path.u, plan.path.x
        return np.repeat(plan.path.u, self.pieces, axis=0), None


@dataclass(frozen=True, slots=True)
class FlownPlanners:
    """Data for all parts; ``plans`` are the plans that several parts use."""

    planners: Mapping[Any, Planner]
    runs: int
    laws: tuple[str, ...]
    plans: dict[tuple[int, int | None], Plan] = field(default_factory=dict)

    def plan(self, name: Any, seed: int) -> Plan:
        """The plan of a planner, made once in each process."""
        planner = self.planners[name]
        key = id(planner.run), (seed if planner.seeded else None)
        if key not in self.plans:
            run = planner.run.with_seed(seed) if planner.seeded else planner.run
            self.plans[key] = run.plan
        return self.plans[key]


def fly_planners(
    settings: Settings, planners: Mapping[Any, Planner], directory: Path, progress: Progress
) -> tuple[FlownPlanners, Results]:
    """Plan with every planner and seed and fly all plans; a planner of several words is named by a tuple."""
    cfg = settings[EvaluationConfig]
    flown = FlownPlanners(planners, settings.deployment.runs, tuple(cfg.laws))
    pairs, todo = [(name, seed) for seed in cfg.seeds for name in planners], []
    for name, seed in pairs:
        planner, words = planners[name], "-".join(map(str, name)) if isinstance(name, tuple) else name
        mine = replace(planner.run.settings, seed=seed)
        key = part_key(mine, planner.key, planner.pieces, flown.runs, flown.laws)
        todo.append(Part(f"{words}-{seed}", (name, seed), key))
    results = work_parts(cfg, directory, planner_part, flown, todo, progress)
    return flown, dict(zip(pairs, results, strict=True))


def planner_part(flown: FlownPlanners, name: Any, seed: int) -> Columns:
    """A plan of one planner and the outcomes of its flights; or why there is no plan."""
    began = time.perf_counter()
    try:
        plan = flown.plan(name, seed)
    except InfeasibleError as error:
        return {"planned": False, "reason": str(error), "seconds": time.perf_counter() - began}
    planner, seconds = flown.planners[name], time.perf_counter() - began
    laws = outcomes(planner.truth, planner.flown(plan), flown.runs, flown.laws, seed)
    return {"seconds": seconds, "x": plan.path.x, "u": plan.path.u} | plan_columns(plan, laws)


def plan_columns(plan: Plan, laws: Mapping[str, Columns]) -> Columns:
    """The columns of a plan and of the outcomes of its flights."""
    return {"planned": True, "objectives": plan.path.objectives.as_dict(), "laws": laws}


def outcomes(
    problem: Problem, flight: tuple[FloatArray, FloatArray | None], runs: int, laws: Sequence[str], seed: int
) -> dict[str, Columns]:
    """For each law, the flights that completed the mission, met an obstacle, left the map and failed.

    ``flight`` has controls (T, 2) [m/s] and means (T+1, 2) [m], which are computed if None. ``bound`` is
    V + R under the law.
    """
    found: dict[str, Columns] = {}
    for law in laws:
        u, x = flight
        ahead = Forecast.of(problem, u, law)
        flown = fly_seeded(problem, u, runs, law, seed, ahead.x if x is None else x)
        found[law] = {name: tables.flags_to_text(getattr(flown, name)) for name in FLAGS}
        found[law] |= {"bound": min(1.0, ahead.mission_risk + ahead.collision_risk)}
    return found


# --- columns of tables -----------------------------------------------------------------------


def with_plan(results: Sequence[Result]) -> list[Result]:
    """The results that have a plan."""
    return [result for result in results if result["planned"]]


def flags(result: Result, law: str, name: str = "failed") -> BoolArray:
    """One of ``FLAGS`` of the flights under ``law``."""
    return tables.text_to_flags(result["laws"][law][name])


def pooled_flags(results: Sequence[Result], law: str, name: str = "failed") -> BoolArray:
    """One of ``FLAGS`` of all flights."""
    return np.concatenate([np.empty(0, bool), *(flags(result, law, name) for result in results)])


def bound(result: Result, mission: str = "mission_risk_ordered") -> float:
    """P(fail or collide) ≤ mission risk + collision risk."""
    costs = result["objectives"]
    return min(1.0, tables.number_or_nan(costs[mission]) + tables.number_or_nan(costs["collision_risk"]))


def failure_columns(results: Sequence[Result], law: str) -> Columns:
    """Shares of seeds with a plan and of failed flights, and medians of failure and length of the plans."""
    planned = with_plan(results)
    return (
        tables.rate_columns("planned", np.array([result["planned"] for result in results]))
        | tables.rate_columns("failure", pooled_flags(planned, law))
        | tables.quartile_columns("failure_of_a_plan", [flags(result, law).mean() for result in planned])
        | tables.quartile_columns("length_m", [result["objectives"]["length"] for result in planned])
    )


def planned_text(row: Columns) -> str:
    """``19 of 20``: seeds with a plan."""
    return f"{round(row['planned'] * row['seeds'])} of {row['seeds']}"
