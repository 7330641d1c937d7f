"""``pareto_ltl.export``: the files of a plan in memory, or of another path of its front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pareto_ltl import DataError, choose
from pareto_ltl.extend import Planned, planned_run
from pareto_ltl_apps.exports.exported import exported_plan
from pareto_ltl_apps.exports.formats import writable_formats, write_exports
from pareto_ltl_apps.exports.settings import ExportsConfig


def export(
    planned: Planned,
    folder: str | Path,
    formats: Sequence[str] | None = None,
    *,
    point: int | None = None,
    **settings: Any,
) -> tuple[Path, ...]:
    """Write a plan into ``folder``; return the paths of the files.

    Parameters
    ----------
    planned : Run or path
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
    run = planned_run(planned)
    stated = run.settings[ExportsConfig]
    cfg = replace(stated, formats=stated.formats if formats is None else list(formats), **settings)
    if point is not None:
        run = choose(planned, point=point)
    problem, plan = run.problem, run.plan
    written, reason = writable_formats(cfg.formats, problem.scene, plan.path.t)
    if reason and (formats is not None or not written):
        raise DataError(reason)
    exported = exported_plan(run.settings.with_sections(cfg), problem, plan, run.seeds("export"))
    return write_exports(exported, written, Path(folder))
