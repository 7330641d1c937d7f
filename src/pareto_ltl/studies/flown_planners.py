"""Several planners of one mission, whose plans are flown in the same winds: ``compare`` and ``ablation``."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.evaluate import forecast
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Plan
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM, Records
from pareto_ltl.settings import Settings, preset
from pareto_ltl.studies.parts import Part, PartsProgress, work_parts
from pareto_ltl.studies.planning import fly_seeded, study_run
from pareto_ltl.studies.statistics import Columns, quartile_columns, rate_columns
from pareto_ltl.studies.tables import flags_to_text, number_or_nan, text_to_flags
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.errors import InfeasibleError

FLAGS = ("accepted", "collided", "off_map", "failed")

Result = Mapping[str, Any]
Results = Mapping[tuple[Any, int], Result]  # by planner and seed


@dataclass(frozen=True, slots=True)
class Planner:
    """A planner, and the problem in which its plans are flown.

    Attributes
    ----------
    pieces : int
        Number of parts into which each step of a plan is divided for its flights, with the same control.
    seeded : bool
        Whether the plan depends on the seed; if not, it is made once in each process.
    """

    run: Run
    truth: Problem
    pieces: int = 1
    seeded: bool = True

    def flown(self, plan: Plan) -> tuple[FloatArray, FloatArray]:
        """Controls (T, 2) [m/s] and means (T+1, 2) [m] of the flights of ``plan``."""
        if self.pieces == 1:
            return plan.path.u, plan.path.x
        u = np.repeat(plan.path.u, self.pieces, axis=0)
        return u, mean_path(self.truth, u)


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
            self.plans[key] = run.make(PLAN)
        return self.plans[key]


def truth(settings: Settings, world: Records) -> Problem:
    """The problem in which plans are flown: ``fidelity=full``, all wind laws."""
    laws = list(settings.evaluation.laws)
    real = replace(settings, fidelity=preset("full"), deployment=replace(settings.deployment, laws=laws))
    return study_run(real, world).make(PROBLEM)


def fly_planners(
    settings: Settings, planners: Mapping[Any, Planner], key: Callable[[Any, int], str], directory: Path,
    progress: PartsProgress | None,
) -> tuple[FlownPlanners, Results]:  # fmt: skip
    """Plan with every planner and seed and fly all plans; ``key`` gives the key of a part.

    A planner of several words is named by a tuple.
    """
    cfg = settings.evaluation
    flown = FlownPlanners(planners, settings.deployment.runs, tuple(cfg.laws))
    todo = [
        Part(f"{_named(name)}-{seed}", (name, seed), key(name, seed))
        for seed in cfg.seeds
        for name in planners
    ]
    results = work_parts(cfg, directory, planner_part, flown, todo, progress)
    return flown, dict(zip([(part.arguments[0], part.arguments[1]) for part in todo], results, strict=True))


def _named(name: Any) -> str:
    return "-".join(map(str, name)) if isinstance(name, tuple) else str(name)


def planner_part(flown: FlownPlanners, name: Any, seed: int) -> Columns:
    """A plan of one planner and the outcomes of its flights; or why there is no plan."""
    began = time.perf_counter()
    try:
        plan = flown.plan(name, seed)
    except InfeasibleError as error:
        return {"planned": False, "reason": str(error), "seconds": time.perf_counter() - began}
    planner, seconds = flown.planners[name], time.perf_counter() - began
    laws = outcomes(planner.truth, *planner.flown(plan), flown.runs, flown.laws, seed)
    return {"seconds": seconds, "x": plan.path.x, "u": plan.path.u} | plan_columns(plan, laws)


def plan_columns(plan: Plan, laws: Mapping[str, Columns]) -> Columns:
    """The columns of a plan and of the outcomes of its flights."""
    return {"planned": True, "objectives": plan.path.objectives.as_dict(), "laws": laws}


def outcomes(
    problem: Problem, u: FloatArray, x: FloatArray, runs: int, laws: Sequence[str], seed: int
) -> dict[str, Columns]:
    """For each law, the flights that completed the mission, met an obstacle, left the map and failed.

    ``bound`` is V + R under the law.
    """
    found: dict[str, Columns] = {}
    for law in laws:
        flown, ahead = fly_seeded(problem, u, runs, law, seed, x), forecast(problem, u, law)
        seen = (flown.accepted, flown.collided, flown.off_map, flown.failed)
        found[law] = dict(zip(FLAGS, map(flags_to_text, seen), strict=True))
        found[law] |= {"bound": min(1.0, ahead.mission_risk + ahead.collision_risk)}
    return found


def mean_path(problem: Problem, u: FloatArray) -> FloatArray:
    """x̂_{t+1} = A x̂_t + dt (B u_t + μ(x̂_t, t)), (T+1, 2)."""
    from pareto_ltl.planning.wind_lookup import interpolate

    motion = problem.motion
    b, x = np.linalg.inv(motion.b_inv), [np.asarray(problem.scene.start, float)]
    for t in range(len(u)):
        mu = interpolate(problem.wind, problem.wind.mean, t, x[-1])
        x.append(motion.a @ x[-1] + motion.dt * (b @ u[t] + mu))
    return np.array(x)


# --- columns of tables -----------------------------------------------------------------------


def with_plan(results: Sequence[Result]) -> list[Result]:
    """The results that have a plan."""
    return [result for result in results if result["planned"]]


def flags(result: Result, law: str, name: str = "failed") -> BoolArray:
    """One of ``FLAGS`` of the flights under ``law``."""
    return text_to_flags(result["laws"][law][name])


def pooled_flags(results: Sequence[Result], law: str, name: str = "failed") -> BoolArray:
    """One of ``FLAGS`` of all flights."""
    return np.concatenate([np.empty(0, bool), *(flags(result, law, name) for result in results)])


def bound(result: Result, mission: str = "mission_risk_ordered") -> float:
    """P(fail or collide) ≤ mission risk + collision risk."""
    costs = result["objectives"]
    return min(1.0, number_or_nan(costs[mission]) + number_or_nan(costs["collision_risk"]))


def failure_columns(results: Sequence[Result], law: str) -> Columns:
    """Shares of seeds with a plan and of failed flights, and medians of failure and length of the plans."""
    planned = with_plan(results)
    return (
        rate_columns("planned", np.array([result["planned"] for result in results]))
        | rate_columns("failure", pooled_flags(planned, law))
        | quartile_columns("failure_of_a_plan", [flags(result, law).mean() for result in planned])
        | quartile_columns("length_m", [result["objectives"]["length"] for result in planned])
    )


def planned_text(row: Columns) -> str:
    """``19 of 20``: seeds with a plan."""
    return f"{round(row['planned'] * row['seeds'])} of {row['seeds']}"
