"""One mission, several planners, the same winds: ``compare`` and ``ablation``.

``compare`` runs these methods (the paper's Figure 1 and its baseline):

``paper``            the proposed planner as in the paper: paths of the trees without refinement
``smoothed``         the same with convex smoothing, as ``pipelines=plan fidelity=paper``
``full``             refined and ranked by flights, as ``pipelines=plan fidelity=full``
``cc_rrt``           plain CC-RRT: chance constraints, no re-selection of parents (lines 5-13 of Algorithm 2)
``ml_rrt``           the same planner without any knowledge of wind, μ = 0 and Σ = 0 (the paper's baseline)
``calm_shortest``    the shortest path in still air, by convex smoothing of ``ml_rrt``; one path for all seeds

The last two fly the airspeeds that they planned for calm air in the wind. All plans of one seed meet the same
winds.

``ablation`` changes one setting at a time; all plans are simulated with the same model:

    trees, n_max   size of the forest
    beta           slack of Eq. (11): 0 (no parent that is worse in any objective), random (default), large
    epsilon        collision probability allowed at a step
    kernel         covariance of the wind's regression for planning; flights use the kernel of the run
    ball           radius of the maximum-trace ball
    dt             the default plan flown with every step divided into shorter ones of equal control
    law, mission_bound, collision_bound, refine
                   one model of ``fidelity`` for planning; flights use the models of the run.
                   With ``planner.epsilon=null`` each collision bound has another default ε.

Plans are paths of the trees without refinement (``refine=none``), except at other levels of ``refine``.

``dt`` is about the wind laws, not the planner: the flight is the same, only the number of its steps changes.
Independent draws average out, so that under this law bound and failure rate go to 0 with the time step; under
the coherent law finer steps do not make the same flight safer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.texts import probability_text
from pareto_ltl import Run, Settings
from pareto_ltl.extend import Study
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.world.time_step import step_of
from pareto_ltl_apps.studies import planning, tables
from pareto_ltl_apps.studies.parts import Progress, part_key
from pareto_ltl_apps.studies.planning import (
    FlownPlanners,
    Planner,
    Result,
    Results,
    bound,
    flags,
    pooled_flags,
)
from pareto_ltl_apps.studies.settings import FACTOR_SECTIONS, AblationConfig, CompareConfig, EvaluationConfig
from pareto_ltl_apps.studies.tables import Columns, quartile_columns, quartiles_cell, rate_cell, rate_columns
from pareto_ltl_apps.view.factors import FACTOR_TITLES

TITLES = {
    "paper": "proposed (paper)",
    "smoothed": "paper, smoothed",
    "full": "full fidelity",
    "cc_rrt": "CC-RRT",
    "ml_rrt": "ML-RRT (no wind)",
    "calm_shortest": "shortest in calm air",
}
CALM = ("ml_rrt", "calm_shortest")  # methods that plan for calm air
COSTS = ("mission_risk_paper", "mission_risk_ordered", "collision_risk")


def method(name: str, settings: Settings, world: Run) -> Run:
    """The run of the planner ``name``, with its settings and the wind that it plans in."""
    models = Settings.preset("full" if name == "full" else "paper")
    if name not in ("smoothed", "full", "calm_shortest"):
        models = replace(models, refine="none")
    # Seeds share the cores, not trees. Without other parents to try there is no re-selection.
    near = 0 if name == "cc_rrt" else settings.planner.near
    planner = replace(settings.planner, threads=1, near=near)
    run = world.with_settings(replace(settings, fidelity=models, planner=planner))
    wind = run.wind
    if name in CALM:
        run = run.given(wind=planning.still(wind))
    run.make("problem")
    return run


def run_comparison(settings: Settings, world: Run, directory: Path, progress: Progress = None) -> Study:
    """Plan with every method and seed, fly all, and compare."""
    world = planning.with_wind(settings, world)
    real = planning.truth(settings, world)
    planners = {}
    for name in settings[CompareConfig].methods:
        run, key = method(name, settings, world), ("compare", name, settings.fidelity.label)
        planners[name] = Planner(run, real, key, seeded=name != "calm_shortest")
    flown, found = planning.fly_planners(settings, planners, directory, progress)
    names, seeds, laws = settings[CompareConfig].methods, settings[EvaluationConfig].seeds, flown.laws
    rows = [_method_row(name, law, [found[name, seed] for seed in seeds]) for name in names for law in laws]
    pairs = [_difference(names[0], name, law, found, seeds) for name in names[1:] for law in laws]
    each = [(name, seed, found[name, seed]) for name in names for seed in seeds]
    made = {
        "compare": rows,
        "compare_seeds": [_flight_row(*one, law) for one in each if one[-1]["planned"] for law in laws],
        "differences": pairs,
        "no_plan": [
            {"method": name, "seed": seed, "reason": result["reason"]}
            for name, seed, result in each
            if not result["planned"]
        ],
    }
    numbers = {
        f"{row['method']}_failure_{row['law']}{end}": row[f"failure{end}"]
        for row in rows
        for end in ("", "_low", "_high")
    }
    numbers |= {f"{row['method']}_planned": row["planned"] for row in rows} | {"seeds": float(len(seeds))}
    winds = (planner.run.wind for planner in planners.values())
    pictures = {
        "panels": [_panel(flown, name, found[name, seeds[0]], seeds[0]) for name in names],
        "wind": next((wind for wind in winds if wind.mean.any()), None),  # for the arrows
    }
    return Study(made, numbers, _methods_text(rows, pairs), pictures)


# --- tables of methods -----------------------------------------------------------------------


def _method_row(name: str, law: str, results: Sequence[Result]) -> Columns:
    """All seeds of one method under one law; a seed without a plan has no flights."""
    planned = planning.with_plan(results)
    row: Columns = {"method": name, "title": TITLES[name], "law": law, "seeds": len(results)}
    row |= {"flights": len(pooled_flags(planned, law))} | planning.failure_columns(results, law)
    for rate, flag in (("collision", "collided"), ("off_map", "off_map"), ("completion", "accepted")):
        row |= rate_columns(rate, pooled_flags(planned, law, flag))
    for cost in COSTS:
        row |= quartile_columns(cost, [tables.number_or_nan(one["objectives"][cost]) for one in planned])
    bounds = [bound(result) for result in planned]
    row |= quartile_columns("bound_paper", [bound(result, "mission_risk_paper") for result in planned])
    row |= quartile_columns("bound", bounds)
    row |= {"bound_mean": float(np.mean(bounds)) if bounds else math.nan}
    row |= quartile_columns("forecast", [result["laws"][law]["bound"] for result in planned])
    broken = (tables.exceeds(flags(result, law), result["laws"][law]["bound"]) for result in planned)
    row |= {"bounds_broken": sum(broken)}  # plans that fail significantly more often than the forecast
    return row | quartile_columns("plan_seconds", [result["seconds"] for result in results])


def _flight_row(name: str, seed: int, result: Result, law: str) -> Columns:
    costs = result["objectives"]
    row: Columns = {"method": name, "seed": seed, "law": law, "length_m": costs["length"]}
    row |= {cost: tables.number_or_nan(costs[cost]) for cost in COSTS} | {"steps": len(result["u"])}
    row |= rate_columns("failure", flags(result, law))
    return row | rate_columns("collision", flags(result, law, "collided"))


def _difference(first: str, other: str, law: str, found: Results, seeds: Sequence[int]) -> Columns:
    """Failure of ``other`` minus failure of ``first``, flight by flight in the same winds."""
    both = [s for s in seeds if found[first, s]["planned"] and found[other, s]["planned"]]
    pairs = [(flags(found[first, s], law), flags(found[other, s], law)) for s in both]
    gaps = np.array([b.mean() - a.mean() for a, b in pairs])
    alone = sum(int((b & ~a).sum()) for a, b in pairs)
    first_alone = sum(int((a & ~b).sum()) for a, b in pairs)
    row: Columns = {"method": other, "against": first, "law": law, "seeds": len(both)}
    row |= {"pairs": sum(len(a) for a, _ in pairs)}
    middle = float(gaps.mean()) if len(gaps) else math.nan
    row |= tables.interval_columns("difference", middle, *tables.mean_interval(gaps))
    row |= {"only_this_failed": alone, "only_the_other_failed": first_alone}
    return row | {"mcnemar_p": tables.mcnemar_test(first_alone, alone)}


def _panel(flown: FlownPlanners, name: str, result: Result, seed: int) -> Columns:
    """The plan of a method with its flights, for Figure 1."""
    panel: Columns = {"method": name, "title": TITLES[name], "planned": result["planned"]}
    if not result["planned"]:
        return panel
    u, x = (np.array(result[key], float).reshape(-1, 2) for key in ("u", "x"))
    truth = flown.planners[name].truth
    flights = {law: planning.fly_seeded(truth, u, flown.runs, law, seed, x) for law in flown.laws}
    return panel | {"x": x, "flights": flights, "length_m": result["objectives"]["length"]}


def _methods_text(rows: Sequence[Columns], pairs: Sequence[Columns]) -> str:
    first = tables.markdown_table(
        "Failure of the flights (missed the mission, touched an obstacle or, where the border is a wall, "
        "left the map), 95 % intervals; bounds: mission "
        "risk (f_o or V) + collision risk R, in the winds that the plan was made for and in those flown in; "
        "medians over seeds",
        {
            "method": "title",
            "winds": "law",
            "planned": planning.planned_text,
            "length [km]": tables.length_cell,
            "f_o + R, as planned": lambda row: _planned_risk(row, "bound_paper"),
            "V + R, as planned": lambda row: _planned_risk(row, "bound"),
            "V + R in these winds": lambda row: probability_text(row["forecast"]),
            "failed": lambda row: rate_cell(row, "failure"),
            "collided": lambda row: rate_cell(row, "collision"),
            "left the map": lambda row: rate_cell(row, "off_map"),
            "completed": lambda row: rate_cell(row, "completion"),
        },
        rows,
    )
    if not pairs:
        return first
    reference = TITLES[pairs[0]["against"]]
    return f"{first}\n" + tables.markdown_table(
        f"Failure minus failure of {reference}, in the same winds (95 % interval over seeds)",
        {
            "method": lambda row: TITLES[row["method"]],
            "winds": "law",
            "difference": _points,
            "only this failed": lambda row: f"{row['only_this_failed']:,}",
            "only the other failed": lambda row: f"{row['only_the_other_failed']:,}",
            "McNemar p": lambda row: "< 1e-6" if row["mcnemar_p"] < 1e-6 else f"{row['mcnemar_p']:.2g}",
        },
        pairs,
    )


def _planned_risk(row: Columns, name: str) -> str:
    """A bound of the plan, and the winds that the method plans for; f_o does not hold in coherent winds."""
    law = Settings.preset("full" if row["method"] == "full" else "paper").law
    winds = "calm air" if row["method"] in CALM else f"{law} winds"
    if name == "bound_paper" and winds == "coherent winds":
        return "-"
    return f"{probability_text(row[name])} in {winds}"


def _points(row: Columns) -> str:
    if math.isnan(row["difference_low"]):  # one seed has no interval over seeds
        return f"{100 * row['difference']:+.2f} %"
    low, high = max(row["difference_low"], -1.0), min(row["difference_high"], 1.0)
    return f"{100 * row['difference']:+.2f} % ({100 * low:+.2f} to {100 * high:+.2f})"


# --- one setting at a time -------------------------------------------------------------------


def levels(settings: Settings) -> Iterator[tuple[str, Any]]:
    """Every (factor, level) of the settings."""
    for factor in settings[AblationConfig].factors:
        for level in getattr(settings[AblationConfig], factor):
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


def run_ablation(settings: Settings, world: Run, directory: Path, progress: Progress = None) -> Study:
    """Plan with every level and seed, and fly all plans.

    Raises
    ------
    ConfigError
        If time steps cannot be divided.
    """
    plain = settings.robot.a == [[1.0, 0.0], [0.0, 1.0]] and settings.robot.feedback_time is None
    if "dt" in settings[AblationConfig].factors and not plain:
        raise ConfigError(
            "ablation.factors contains dt, which divides time steps: this needs robot.a = [[1,0],[0,1]] and "
            "robot.feedback_time = null (they depend on the time step); leave dt out"
        )
    dt = step_of(settings.robot, world.scene, settings.planner.max_steps)
    settings = replace(settings, robot=replace(settings.robot, dt=dt))
    cfg = settings[EvaluationConfig]
    _, found = planning.fly_planners(settings, _planners(settings, world), directory, progress)
    rows = [
        _level_row(settings, name, law, [found[name, seed] for seed in cfg.seeds])
        for name in levels(settings)
        for law in cfg.laws
    ]
    numbers = {f"{row['factor']}_{row['level']}_failure_{row['law']}": row["failure"] for row in rows}
    return Study({"ablation": rows}, {"seeds": float(len(cfg.seeds))} | numbers, _levels_text(settings, rows))


def _planners(settings: Settings, world: Run) -> dict[tuple[str, Any], Planner]:
    """A planner for each (factor, level); those with the default settings share a run."""
    mine = planning.unsmoothed(settings)
    whole = planning.with_wind(mine, world)
    reference, real = whole.with_settings(mine), planning.truth(settings, whole)
    key = "ablation", part_key(replace(settings, seed=0))  # with the model of the flights, which stays
    planners = {}
    for factor, level in levels(settings):
        other = changed(mine, factor, level)
        same = world if factor == "kernel" else whole
        run = same.with_settings(other) if other != mine else reference
        run.make("problem")
        pieces = level if factor == "dt" else 1
        flown_in = planning.truth(cut(settings, pieces), world) if pieces > 1 else real
        planners[factor, level] = Planner(run, flown_in, key, pieces)
    return planners


def cut(settings: Settings, pieces: int) -> Settings:
    """The same robot and wind with time steps of 1/``pieces`` of the length.

    The last field is held to the end of a step that begins with it, as for an undivided step.
    """
    robot = replace(settings.robot, dt=settings.robot.dt / pieces)
    planner = replace(settings.planner, max_steps=settings.planner.max_steps * pieces)
    wind = settings.wind if pieces == 1 else replace(settings.wind, hold_last=True)
    return replace(settings, robot=robot, planner=planner, wind=wind)


def _level_row(settings: Settings, name: tuple[str, Any], law: str, results: Sequence[Result]) -> Columns:
    """All seeds of one level under one law."""
    (factor, level), planned = name, planning.with_plan(results)
    row: Columns = {"factor": factor, "level": level, "law": law, "seeds": len(results)}
    row |= {"shown": settings.robot.dt / level if factor == "dt" else level}
    row |= planning.failure_columns(results, law)
    collided = [planning.flags(result, law, "collided").mean() for result in planned]
    row |= quartile_columns("collided_of_a_plan", collided)
    row |= quartile_columns("bound_planned", [planning.bound(result) for result in planned])
    return row | quartile_columns("bound", [result["laws"][law]["bound"] for result in planned])


def _levels_text(settings: Settings, rows: Sequence[Columns]) -> str:
    return "\n".join(
        tables.markdown_table(
            f"{FACTOR_TITLES.get(factor, factor)}: median (quartiles) over seeds; "
            "failed of all flights with 95 % interval",
            {
                FACTOR_TITLES.get(factor, factor): lambda row: (
                    row["shown"] if isinstance(row["shown"], str) else f"{row['shown']:g}"
                ),
                "winds": "law",
                "with a plan": planning.planned_text,
                "V + R in these winds": lambda row: quartiles_cell(row, "bound"),
                "failed, a plan": lambda row: quartiles_cell(row, "failure_of_a_plan"),
                "failed, all": lambda row: rate_cell(row, "failure"),
                "length [km]": tables.length_cell,
            },
            [row for row in rows if row["factor"] == factor],
        )
        for factor in settings[AblationConfig].factors
    )
