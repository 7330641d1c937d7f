"""One setting changed at a time; all plans are simulated with the same model, in the same winds.

``trees``, ``n_max``   size of the forest ``beta``               slack of Eq. (11): 0 (no parent that is worse
in any objective), random (default), large ``epsilon``            collision probability allowed at a step
``kernel``             covariance of the wind's regression for planning; flights use that of the run ``ball``
radius of the maximum-trace ball ``dt``                 the default plan flown with every step divided into
shorter ones of equal control

``law``, ``mission_bound``, ``collision_bound``, ``parents``, ``refine``
                       one model of ``fidelity`` for planning; flights use the models of the run.
                       With ``planner.epsilon=null`` each collision bound has its own default ε.

Plans are paths of the trees without refinement (``refine=none``), except at the level ``refine=convex``.

``dt`` is about the wind laws, not the planner: the flight is the same, only the number of its steps changes.
Independent draws average out, so that under this law bound and failure rate go to 0 with the time step; under
the coherent law finer steps do not make the same flight safer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.problem import Problem
from pareto_ltl.report.records import Study
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM, SCENE, Records
from pareto_ltl.settings import Settings
from pareto_ltl.settings.studies import MODEL_FACTORS
from pareto_ltl.studies.compare import bound, failed, outcomes, truth
from pareto_ltl.studies.parts import Part, PartsProgress, part_key, work_parts
from pareto_ltl.studies.planning import study_run, unsmoothed, with_wind
from pareto_ltl.studies.statistics import Columns, quartile_columns, rate_columns
from pareto_ltl.studies.tables import (
    kilometres_text,
    markdown_table,
    quartiles_cell,
    rate_cell,
    text_to_flags,
)
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from pareto_ltl.world.time_step import step_of

FACTOR_TITLES = {
    "trees": "trees",
    "beta": "β, times the default",
    "epsilon": "ε",
    "n_max": "vertices per tree",
    "dt": "time step [s]",
    "kernel": "kernel",
    "ball": "radius of the ball [sd]",
    "law": "wind law of the planner",
    "mission_bound": "mission bound",
    "collision_bound": "collision bound",
    "parents": "parent rule",
    "refine": "refinement",
}


@dataclass(frozen=True, slots=True)
class AblationContext:
    """``runs_of`` make plans, and they are flown in ``worlds`` or ``truth``; by (factor, level)."""

    runs_of: Mapping[tuple[str, Any], Run]
    worlds: Mapping[tuple[str, Any], Problem]
    truth: Problem
    runs: int
    laws: tuple[str, ...]
    kept: dict[int, Any] = field(default_factory=dict)  # default plans by seed, once a process


def levels(settings: Settings) -> Iterator[tuple[str, Any]]:
    """Every (factor, level) of the settings."""
    for factor in settings.ablation.factors:
        for level in getattr(settings.ablation, factor):
            yield factor, level


def changed(settings: Settings, factor: str, level: Any) -> Settings:
    """``settings`` with ``factor`` set to ``level``."""
    planner, wind = settings.planner, settings.wind
    if factor == "beta":
        scaled = replace(
            planner, beta_risk=level * planner.beta_risk, beta_length=level * planner.beta_length
        )
        return replace(settings, planner=scaled)
    if factor in ("trees", "n_max", "epsilon"):
        return replace(settings, planner=replace(planner, **{factor: level}))
    if factor in ("kernel", "ball"):
        return replace(settings, wind=replace(wind, **{factor: level}))
    if factor in MODEL_FACTORS:
        return replace(settings, fidelity=replace(settings.fidelity, **{factor: level}))
    return settings


def run_ablation(
    settings: Settings, world: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Plan with every level and seed, and fly all plans."""
    _check(settings)
    dt = step_of(settings.robot, world[SCENE], settings.planner.max_steps)
    settings = replace(settings, robot=replace(settings.robot, dt=dt))
    context, todo = _ablation_context(settings, world), []
    for factor, level in levels(settings):
        for seed in settings.evaluation.seeds:
            k = _ablation_key(settings, context, factor, level, seed)
            todo.append(Part(f"{factor}-{level}-{seed}", (factor, level, seed), k))
    results = work_parts(settings.evaluation, directory, ablation_part, context, todo, progress)
    found = {part.arguments: result for part, result in zip(todo, results, strict=True)}
    return _collect_ablation(settings, context, found)


def _check(settings: Settings) -> None:
    plain = settings.robot.a == [[1.0, 0.0], [0.0, 1.0]] and settings.robot.feedback == 0.0
    if "dt" in settings.ablation.factors and not plain:
        raise ConfigError(
            "ablation.factors contains dt, which divides time steps: this needs robot.a = [[1,0],[0,1]] and "
            "robot.feedback = 0 (they depend on the time step); leave dt out"
        )


def _ablation_context(settings: Settings, world: Records) -> AblationContext:
    mine = unsmoothed(settings)
    mine = replace(mine, planner=replace(mine.planner, threads=1))
    whole = with_wind(mine, world)
    reference = study_run(mine, whole)
    reference.make(PROBLEM)
    runs_of, worlds = {}, {}
    for factor, level in levels(settings):
        other = changed(mine, factor, level)
        refitted = factor == "kernel" and other != mine
        run = reference if other == mine else study_run(other, world if refitted else whole)
        run.make(PROBLEM)
        runs_of[factor, level] = run
        if factor == "dt":
            worlds[factor, level] = truth(cut(settings, level), world)
    return AblationContext(
        runs_of, worlds, truth(settings, whole), settings.deployment.runs, tuple(settings.evaluation.laws)
    )


def _ablation_key(settings: Settings, context: AblationContext, factor: str, level: Any, seed: int) -> str:
    """Key of a part; levels equal to the default settings share their parts."""
    pieces = level if factor == "dt" else 1
    mine = replace(context.runs_of[factor, level].settings, seed=seed)
    return part_key(mine, "ablation", pieces, as_flown(settings), context.runs, context.laws)


def as_flown(settings: Settings) -> str:
    """Fingerprint of the model in which plans are flown; it does not change with the factor."""
    return part_key(replace(settings, seed=0))


def cut(settings: Settings, pieces: int) -> Settings:
    """The same robot and wind with time steps of 1/``pieces`` of the length.

    The last field is held to the end of a step that begins with it, as for an undivided step.
    """
    robot = replace(settings.robot, dt=settings.robot.dt / pieces)
    planner = replace(settings.planner, max_steps=settings.planner.max_steps * pieces)
    wind = settings.wind if pieces == 1 else replace(settings.wind, hold_last=True)
    return replace(settings, robot=robot, planner=planner, wind=wind)


# --- one plan --------------------------------------------------------------------------------


def ablation_part(context: AblationContext, factor: str, level: Any, seed: int) -> Columns:
    """One plan with one factor at ``level``, and the outcomes of its flights in the true model."""
    try:
        plan = _ablation_plan(context, factor, level, seed)
    except InfeasibleError as error:
        return {"planned": False, "reason": str(error)}
    path, world = plan.path, context.truth
    objectives, u, x = asdict(path.objectives), path.u, path.x
    if factor == "dt" and level > 1:
        world, u = context.worlds[factor, level], np.repeat(path.u, level, axis=0)
        x = mean_path(world, u)
    return {
        "planned": True,
        "objectives": objectives,
        "laws": outcomes(world, u, x, context.runs, context.laws, seed),
    }


def _ablation_plan(context: AblationContext, factor: str, level: Any, seed: int) -> Any:
    """The plan of one level and seed; for ``dt`` it is made once for all levels."""
    if factor != "dt":
        return context.runs_of[factor, level].with_seed(seed).make(PLAN)
    if seed not in context.kept:
        context.kept[seed] = context.runs_of[factor, level].with_seed(seed).make(PLAN)
    return context.kept[seed]


def mean_path(problem: Problem, u: FloatArray) -> FloatArray:
    """x̂_{t+1} = A x̂_t + dt (B u_t + μ(x̂_t, t)), (T+1, 2)."""
    from pareto_ltl.planning.reference import interpolate

    motion = problem.motion
    b, x = np.linalg.inv(motion.b_inv), [np.asarray(problem.scene.start, float)]
    for t in range(len(u)):
        mu = interpolate(problem.wind, problem.wind.mean, t, x[-1])
        x.append(motion.a @ x[-1] + motion.dt * (b @ u[t] + mu))
    return np.array(x)


# --- tables ----------------------------------------------------------------------------------


def _collect_ablation(
    settings: Settings, context: AblationContext, found: Mapping[tuple[Any, ...], Mapping[str, Any]]
) -> Study:
    seeds = settings.evaluation.seeds
    rows = [
        _ablation_row(settings, factor, level, law, [found[factor, level, seed] for seed in seeds])
        for factor, level in levels(settings)
        for law in context.laws
    ]
    numbers = {"seeds": float(len(seeds))} | {
        f"{row['factor']}_{row['level']}_failure_{row['law']}": row["failure"] for row in rows
    }
    return Study({"ablation": tuple(rows)}, numbers, _ablation_text(settings, rows))


def _ablation_row(
    settings: Settings, factor: str, level: Any, law: str, results: Sequence[Mapping[str, Any]]
) -> Columns:
    planned = [result for result in results if result["planned"]]
    lost = [failed(result, law) for result in planned]
    row: Columns = {"factor": factor, "level": level, "law": law, "seeds": len(results)}
    row |= {"shown": settings.robot.dt / level if factor == "dt" else level}
    row |= rate_columns("planned", np.array([result["planned"] for result in results]))
    row |= rate_columns("failure", np.concatenate(lost) if lost else np.empty(0, bool))
    row |= quartile_columns("failure_of_a_plan", [f.mean() for f in lost])
    row |= quartile_columns(
        "collided_of_a_plan", [text_to_flags(r["laws"][law]["collided"]).mean() for r in planned]
    )
    row |= quartile_columns("bound_planned", [bound(result, "mission_risk_ordered") for result in planned])
    row |= quartile_columns("bound", [result["laws"][law]["bound"] for result in planned])
    return row | quartile_columns("length_m", [result["objectives"]["length"] for result in planned])


def _ablation_text(settings: Settings, rows: Sequence[Columns]) -> str:
    return "\n".join(
        markdown_table(
            f"{FACTOR_TITLES[factor]}: median (quartiles) over seeds; "
            "failed of all flights with 95 % interval",
            (
                FACTOR_TITLES[factor],
                "winds",
                "with a plan",
                "V + R in these winds",
                "failed, a plan",
                "failed, all",
                "length [km]",
            ),
            (
                (
                    _label(row["shown"]),
                    row["law"],
                    f"{round(row['planned'] * row['seeds'])} of {row['seeds']}",
                    quartiles_cell(row, "bound"),
                    quartiles_cell(row, "failure_of_a_plan"),
                    rate_cell(row, "failure"),
                    kilometres_text(row["length_m"]),
                )
                for row in rows
                if row["factor"] == factor
            ),
        )
        for factor in settings.ablation.factors
    )


def _label(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)
