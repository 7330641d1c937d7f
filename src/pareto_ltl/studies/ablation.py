"""One setting changed at a time; all plans are simulated with the same model, in the same winds.

    trees, n_max   size of the forest
    beta           slack of Eq. (11): 0 (no parent that is worse in any objective), random (default), large
    epsilon        collision probability allowed at a step
    kernel         covariance of the wind's regression for planning; flights use the kernel of the run
    ball           radius of the maximum-trace ball
    dt             the default plan flown with every step divided into shorter ones of equal control
    law, mission_bound, collision_bound, parents, refine
                   one model of ``fidelity`` for planning; flights use the models of the run.
                   With ``planner.epsilon=null`` each collision bound has another default ε.

Plans are paths of the trees without refinement (``refine=none``), except at other levels of ``refine``.

``dt`` is about the wind laws, not the planner: the flight is the same, only the number of its steps changes.
Independent draws average out, so that under this law bound and failure rate go to 0 with the time step; under
the coherent law finer steps do not make the same flight safer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pareto_ltl.report.records import Study
from pareto_ltl.run.records import PROBLEM, SCENE, Records
from pareto_ltl.settings import Settings
from pareto_ltl.settings.studies import FACTOR_SECTIONS, FACTOR_TITLES
from pareto_ltl.studies.flown_planners import (
    Planner,
    Result,
    Results,
    bound,
    failure_columns,
    flags,
    fly_planners,
    planned_text,
    truth,
    with_plan,
)
from pareto_ltl.studies.parts import PartsProgress, part_key
from pareto_ltl.studies.planning import study_run, unsmoothed, with_wind
from pareto_ltl.studies.statistics import Columns, quartile_columns
from pareto_ltl.studies.tables import kilometres_text, markdown_table, quartiles_cell, rate_cell
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.world.time_step import step_of


def levels(settings: Settings) -> Iterator[tuple[str, Any]]:
    """Every (factor, level) of the settings."""
    for factor in settings.ablation.factors:
        for level in getattr(settings.ablation, factor):
            yield factor, level


def changed(settings: Settings, factor: str, level: Any) -> Settings:
    """``settings`` with ``factor`` set to ``level``; ``dt`` changes flights, not the planner."""
    if factor == "dt":
        return settings
    part = getattr(settings, FACTOR_SECTIONS[factor])
    new = {factor: level}
    if factor == "beta":
        new = {name: level * getattr(part, name) for name in ("beta_risk", "beta_length")}
    return replace(settings, **{FACTOR_SECTIONS[factor]: replace(part, **new)})


def run_ablation(
    settings: Settings, world: Records, directory: Path, progress: PartsProgress | None = None
) -> Study:
    """Plan with every level and seed, and fly all plans."""
    _check(settings)
    dt = step_of(settings.robot, world[SCENE], settings.planner.max_steps)
    settings = replace(settings, robot=replace(settings.robot, dt=dt))
    planners = _planners(settings, world)
    flown_in = part_key(replace(settings, seed=0))  # the model of the flights, which no factor changes

    def key(name: Any, seed: int) -> str:
        planner, cfg = planners[name], settings.evaluation
        mine, runs = replace(planner.run.settings, seed=seed), settings.deployment.runs
        return part_key(mine, "ablation", planner.pieces, flown_in, runs, cfg.laws)

    _, found = fly_planners(settings, planners, key, directory, progress)
    return _collect_ablation(settings, found)


def _check(settings: Settings) -> None:
    plain = settings.robot.a == [[1.0, 0.0], [0.0, 1.0]] and settings.robot.feedback_time is None
    if "dt" in settings.ablation.factors and not plain:
        raise ConfigError(
            "ablation.factors contains dt, which divides time steps: this needs robot.a = [[1,0],[0,1]] and "
            "robot.feedback_time = null (they depend on the time step); leave dt out"
        )


def _planners(settings: Settings, world: Records) -> dict[tuple[str, Any], Planner]:
    """A planner for each (factor, level); those with the default settings share a run."""
    mine = unsmoothed(settings)
    mine = replace(mine, planner=replace(mine.planner, threads=1))
    whole = with_wind(mine, world)
    reference, real = study_run(mine, whole), truth(settings, whole)
    planners = {}
    for factor, level in levels(settings):
        other = changed(mine, factor, level)
        run = study_run(other, world if factor == "kernel" else whole) if other != mine else reference
        run.make(PROBLEM)
        pieces = level if factor == "dt" else 1
        flown_in = truth(cut(settings, pieces), world) if pieces > 1 else real
        planners[factor, level] = Planner(run, flown_in, pieces)
    return planners


def cut(settings: Settings, pieces: int) -> Settings:
    """The same robot and wind with time steps of 1/``pieces`` of the length.

    The last field is held to the end of a step that begins with it, as for an undivided step.
    """
    robot = replace(settings.robot, dt=settings.robot.dt / pieces)
    planner = replace(settings.planner, max_steps=settings.planner.max_steps * pieces)
    wind = settings.wind if pieces == 1 else replace(settings.wind, hold_last=True)
    return replace(settings, robot=robot, planner=planner, wind=wind)


# --- tables ----------------------------------------------------------------------------------


def _collect_ablation(settings: Settings, found: Results) -> Study:
    seeds = settings.evaluation.seeds
    rows = [
        _ablation_row(settings, factor, level, law, [found[(factor, level), seed] for seed in seeds])
        for factor, level in levels(settings)
        for law in settings.evaluation.laws
    ]
    numbers = {"seeds": float(len(seeds))} | {
        f"{row['factor']}_{row['level']}_failure_{row['law']}": row["failure"] for row in rows
    }
    return Study({"ablation": tuple(rows)}, numbers, _ablation_text(settings, rows))


def _ablation_row(
    settings: Settings, factor: str, level: Any, law: str, results: Sequence[Result]
) -> Columns:
    planned = with_plan(results)
    row: Columns = {"factor": factor, "level": level, "law": law, "seeds": len(results)}
    row |= {"shown": settings.robot.dt / level if factor == "dt" else level} | failure_columns(results, law)
    row |= quartile_columns("collided_of_a_plan", [flags(r, law, "collided").mean() for r in planned])
    row |= quartile_columns("bound_planned", [bound(result) for result in planned])
    return row | quartile_columns("bound", [result["laws"][law]["bound"] for result in planned])


def _ablation_text(settings: Settings, rows: Sequence[Columns]) -> str:
    return "\n".join(
        markdown_table(
            f"{FACTOR_TITLES[factor]}: median (quartiles) over seeds; "
            "failed of all flights with 95 % interval",
            {
                FACTOR_TITLES[factor]: _level_text,
                "winds": lambda row: row["law"],
                "with a plan": planned_text,
                "V + R in these winds": lambda row: quartiles_cell(row, "bound"),
                "failed, a plan": lambda row: quartiles_cell(row, "failure_of_a_plan"),
                "failed, all": lambda row: rate_cell(row, "failure"),
                "length [km]": lambda row: kilometres_text(row["length_m"]),
            },
            [row for row in rows if row["factor"] == factor],
        )
        for factor in settings.ablation.factors
    )


def _level_text(row: Columns) -> str:
    value = row["shown"]
    return f"{value:g}" if isinstance(value, int | float) else str(value)
