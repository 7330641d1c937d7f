"""The plan of a run, or any path of its front, in the formats of autopilots, maps and navigators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pareto_ltl.run.choosing import kept_records
from pareto_ltl.run.interface import PlanningResult, choose, load_results
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import PLAN, PROBLEM
from pareto_ltl.run.results import Results
from pareto_ltl.run.stage_table import stage_seeds, with_extension_stages
from pareto_ltl.run.stages import EXPORT_STREAM, PLAN_STAGES
from pareto_ltl.settings import ExportsConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import ending_text


def export(
    planned: PlanningResult | Results | str | Path,
    folder: str | Path,
    formats: Sequence[str] | None = None,
    *,
    point: int | None = None,
    **settings: Any,
) -> tuple[Path, ...]:
    """Write a plan into ``folder``; return the paths of the files.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    formats : sequence of str, optional
        Some of the formats of ``exports.formats``; default the formats of the run.
    point : int, optional
        The path of that number in ``front.csv``; default the plan.
    settings
        Other settings of the section ``exports``: ``altitude_lower=300.0, altitude_upper=400.0``.

    Raises
    ------
    ConfigError
        If a setting is wrong.
    DataError
        If there is no plan, or a format of ``formats`` cannot be written for it.
    InfeasibleError
        If the front has no such path.
    """
    from pareto_ltl.exports.exported import exported_plan, flown_level
    from pareto_ltl.exports.formats import writable_formats, write_exports

    run = run_with_plan(planned)
    cfg = _checked(run.settings.exports, formats, settings)
    if point is not None:
        run = choose(planned, point=point).run
    problem, plan = run.make(PROBLEM), run.make(PLAN)
    written, reason = writable_formats(cfg.formats, problem.scene, plan.path.t)
    if reason and (formats is not None or not written):
        raise DataError(reason)
    seeds = stage_seeds(run.settings.seed, EXPORT_STREAM)
    exported = exported_plan(cfg, run.settings.name, flown_level(run.settings), problem, plan, seeds)
    return write_exports(exported, written, Path(folder))


def _checked(cfg: ExportsConfig, formats: Sequence[str] | None, settings: dict[str, Any]) -> ExportsConfig:
    """``cfg`` with other formats and settings; raises ConfigError for a wrong one."""
    wanted = cfg.formats if formats is None else list(formats)
    return replace(cfg, formats=wanted, **settings)


def run_with_plan(planned: PlanningResult | Results | str | Path) -> Run:
    """The run of a plan; of a results directory with its records up to the plan.

    Raises
    ------
    DataError
        If it has no plan.
    """
    if isinstance(planned, PlanningResult):
        return planned.run
    results = load_results(planned)
    if (status := results.run.get("status")) != "ok":
        raise DataError(f"{results.directory}: there is no plan: {ending_text(results.directory, status)}")
    settings = results.settings
    if PLAN.name not in settings.pipelines.stages:
        raise DataError(f"{results.directory}: its run made no plan")
    table = with_extension_stages(PLAN_STAGES, settings.pipelines.stages)
    states = results.plan.path.q
    if not ((states >= 0) & (states < results.automaton.n_states)).all():
        raise DataError(
            f"{results.directory}: plan.json names states that automaton.json lacks; run the plan again"
        )
    return Run(settings, table, kept_records(results).replaced(PLAN, results.plan))
