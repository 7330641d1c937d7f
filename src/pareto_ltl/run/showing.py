"""Display of a result: its page, from a results directory, opened in a browser; text on each leg."""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run import page_stage
from pareto_ltl.run import records as keys
from pareto_ltl.run.choosing import choose
from pareto_ltl.run.interface import simulate
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import RecordKey
from pareto_ltl.run.results import Planned, PlanningResult, Results, load_results, place_of, planned_run
from pareto_ltl.run.stage_table import stage_seeds, with_extension_stages
from pareto_ltl.run.stages import PLAN_STAGES
from pareto_ltl.settings.outputs import PAGE_FILE
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.medium import medium_of
from pareto_ltl.support.messages import shown_value
from pareto_ltl.support.run_status import ending_text
from pareto_ltl.world.windows import clock_windows

if TYPE_CHECKING:
    from pareto_ltl.report.records import ShownRun

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # a browser can open if one of them is set


def page_of(planned: Results | str | Path, *, as_is: bool = False) -> Path:
    """The page of a results directory, written from its records; ``as_is``: the one that is there.

    A page contains scripts, and one from another person can contain any.

    Raises
    ------
    DataError
        If the directory holds no finished run of a plan, or cannot be read.
    """
    results = load_results(planned)
    path = results.directory / PAGE_FILE
    if not as_is:
        return page(results, path)
    if not path.is_file():
        raise DataError(f"{path}: there is no page; without --as-is it is written")
    return path


def page(planned: Planned, path: str | Path) -> Path:
    """Write the page of a plan as the file ``path``; return it.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`pareto_ltl.plan` returned, or a results directory.

    Raises
    ------
    DataError
        If there is no finished run of a plan.
    """
    if not isinstance(planned, PlanningResult):
        return page_stage.write_page(Path(path), shown_results(load_results(planned)))
    run = planned.run
    needed: tuple[RecordKey[Any], ...] = (keys.PROBLEM, keys.FRONT, keys.PLAN, keys.FORECASTS)
    for key in needed:
        run.make(key)
    origin = page_stage.origin_in_memory(run.settings)
    seeds = stage_seeds(run.settings.seed, page_stage.DEPLOYMENT_STREAM)
    return page_stage.write_page(Path(path), page_stage.shown_run(run.settings, run.records, origin, seeds))


def shown_results(results: Results, *, unfinished: bool = False) -> ShownRun:
    """The records for the page of a results directory; ``unfinished``: also of a run that still works."""
    record, run = results.run, _run_of_records(results, unfinished)
    origin = page_stage.origin_of(results.directory, record, record.get("inputs") or {})
    seeds = stage_seeds(run.settings.seed, page_stage.DEPLOYMENT_STREAM)
    return page_stage.shown_run(run.settings, run.records, origin, seeds, record.get("error") or "")


def _run_of_records(results: Results, unfinished: bool) -> Run:
    """A run with the records of the directory, and those that follow from them without planning."""
    status = results.run.get("status")
    if status not in ("ok", "infeasible") and not (unfinished and status == "running"):
        ending = ending_text(results.directory, status)
        raise DataError(f"{results.directory}: there is nothing to show: {ending}")
    there = results.records()
    if keys.SCENE not in there or keys.WIND not in there or keys.AUTOMATON not in there:
        raise DataError(f"{results.directory}: it holds no plan of a mission; there is no page of it")
    known, atoms = {*there[keys.SCENE].regions, *there[keys.SCENE].windows}, there[keys.AUTOMATON].atoms
    if lost := sorted({*atoms} - known - {*clock_windows(atoms)}):
        raise DataError(
            f"{results.directory}: scene.json has no region {shown_value(lost[0])}, which automaton.json "
            "reads; the files are of two missions, or damaged: plan again"
        )
    settings = results.settings
    run = Run(settings, with_extension_stages(PLAN_STAGES, settings.pipelines.stages), there)
    if keys.DECOMPOSITION in there:
        run.make(keys.PROBLEM)
    if keys.PLAN in there and not there[keys.PLAN].alarmed:
        run.make(keys.FORECASTS)
    return run


def open_page(path: Path) -> bool:
    """Open ``path`` in the default browser; False if there is no browser or no screen."""
    if sys.platform not in ("win32", "darwin") and not any(map(os.environ.get, DISPLAYS)):
        return False
    import webbrowser

    try:
        return webbrowser.open(path.resolve().as_uri())
    except (OSError, webbrowser.Error):
        return False


def show(planned: Planned) -> Path:
    """Open the page of a plan in the default browser; return its path, also if there is no browser.

    The page of a results directory is its ``report.html``; the page of a plan in memory is written to a new
    temporary folder.
    """
    place = place_of(planned)
    if place is None:
        from tempfile import mkdtemp

        path = page(planned, Path(mkdtemp(prefix="pareto_ltl_page_")) / PAGE_FILE)
    else:
        path = page_of(place)
    open_page(path)
    return path


@dataclass(frozen=True, slots=True)
class Explanation:
    """Lines of text on a plan, and the same for programs."""

    lines: list[str]
    document: dict[str, Any]


def explain(planned: Planned, *, point: int | None = None, limits: bool = False) -> str:
    """The text of :func:`explanation`, of all legs."""
    return "\n".join(explanation(planned, point=point, limits=limits).lines)


def explanation(
    planned: Planned, *, point: int | None = None, limits: bool = False,
    each: bool = False,
) -> Explanation:  # fmt: skip
    """Text on the legs of a plan: its goal, the closest obstacle, the share of flights failed by its end.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    point : int, optional
        The path of that number in ``front.csv``; default the plan.
    limits : bool
        Only the segments that come closest to ``planner.epsilon``, and what easier limits would save.
    each : bool
        A line for each leg; default: one for successive legs of one heading.

    Raises
    ------
    DataError
        If there is no plan.
    InfeasibleError
        If the front has no such path.
    """
    from pareto_ltl.report.legs import plan_legs, plan_lines
    from pareto_ltl.report.limits import PlanLimits, detour_lines

    run = planned_run(planned)
    if point is not None:
        run = choose(planned, point=point).run
    problem, plan = run.make(keys.PROBLEM), run.make(keys.PLAN)
    medium = medium_of(run.settings.robot.level, run.make(keys.WIND).level)
    if limits:
        told = PlanLimits(problem.scene, plan, medium)
        document: dict[str, Any] = {
            "law": plan.models.law,
            "epsilon": plan.epsilon,
            "segments": [asdict(row) for row in told.segments()],
            "prices": [asdict(row) for row in told.prices()],
        }
        return Explanation(list(told.lines()), document)
    runs = min(run.settings.deployment.runs, page_stage.MOST_RUNS)
    flown = simulate(PlanningResult(run), runs, problem.fidelity.law)
    legs = plan_legs(problem, plan, flown)
    front = run.records.get(keys.FRONT)
    detours = [] if front is None else detour_lines(problem.scene, front, plan)
    document = {"law": flown.law, "flights": len(flown.x), "legs": [asdict(leg) for leg in legs]}
    lines = list(plan_lines(problem, plan, flown, legs, medium, each=each))
    lines += [f"detour: {line}" for line in detours]
    return Explanation(lines, document | {"detours": detours})
