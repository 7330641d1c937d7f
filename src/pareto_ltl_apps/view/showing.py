"""Display of a result: its page, from a results directory, opened in a browser; text on each leg."""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.messages import shown_value
from flight_quantities.medium import medium_of
from pareto_ltl import Run, choose, load_results, simulate
from pareto_ltl.extend import Planned, planned_run
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import ending_text
from pareto_ltl_apps.view import PAGE_FILE, page_stage

if TYPE_CHECKING:
    from pareto_ltl_apps.view.records import ShownRun

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # a browser can open if one of them is set


def page_of(planned: Planned, *, as_is: bool = False) -> Path:
    """The page of a results directory, written from its records; ``as_is``: the one that is there.

    A page contains scripts, and one from another person can contain any.

    Raises
    ------
    DataError
        If the directory holds no finished run of a plan, or cannot be read.
    """
    run = load_results(planned)
    path = run.place / PAGE_FILE
    if not as_is:
        return page(run, path)
    if not path.is_file():
        raise DataError(f"{path}: there is no page; without --as-is it is written")
    return path


def page(planned: Planned, path: str | Path) -> Path:
    """Write the page of a plan as the file ``path``; return it.

    Parameters
    ----------
    planned : Run or path
        What :func:`pareto_ltl.plan` returned, or a results directory.

    Raises
    ------
    DataError
        If there is no finished run of a plan.
    """
    run = load_results(planned)
    if run.stored is not None:
        return page_stage.write_page(Path(path), shown_results(run))
    run.make("problem", "front", "plan", "forecasts")
    return page_stage.write_page(
        Path(path), page_stage.shown_run(run, page_stage.origin_in_memory(run.settings))
    )


def shown_results(run: Run, *, unfinished: bool = False) -> ShownRun:
    """The records for the page of a results directory; ``unfinished``: also of a run that still works.

    Those that follow from its files without planning are made.
    """
    made, place = run.provenance, run.place
    if made.get("status") not in ("ok", "infeasible") and not (
        unfinished and made.get("status") == "running"
    ):
        raise DataError(f"{place}: there is nothing to show: {ending_text(place, made.get('status'))}")
    scene, automaton = run.get("scene"), run.get("automaton")
    if scene is None or automaton is None or run.get("wind") is None:
        raise DataError(f"{place}: it holds no plan of a mission; there is no page of it")
    known, atoms = {*scene.regions, *scene.windows}, automaton.atoms
    if lost := sorted({*atoms} - known - {*automaton.clocks}):
        raise DataError(
            f"{place}: scene.json has no region {shown_value(lost[0])}, which automaton.json "
            "reads; the files are of two missions, or damaged: plan again"
        )
    if run.get("cells") is not None:
        run.make("problem")
    if run.get("plan") is not None and not run.plan.alarmed:
        run.make("forecasts")
    origin = page_stage.origin_of(place, made, made.get("inputs") or {})
    return page_stage.shown_run(run, origin, made.get("error") or "")


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
    place = load_results(planned).directory
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
    planned : Run or path
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
    from pareto_ltl_apps.view.legs import plan_legs, plan_lines
    from pareto_ltl_apps.view.limits import PlanLimits, detour_lines

    run = planned_run(planned)
    if point is not None:
        run = choose(planned, point=point)
    problem, plan = run.problem, run.plan
    medium = medium_of(run.settings.robot.level, run.wind.level)
    if limits:
        reported = PlanLimits(problem.scene, plan, medium)
        document: dict[str, Any] = {
            "law": plan.models.law,
            "epsilon": plan.epsilon,
            "segments": [asdict(row) for row in reported.segments()],
            "prices": [asdict(row) for row in reported.prices()],
        }
        return Explanation(list(reported.lines()), document)
    runs = min(run.settings.deployment.runs, page_stage.MAX_RUNS)
    flown = simulate(run, runs, problem.fidelity.law)
    legs = plan_legs(problem, plan, flown)
    front = run.get("front")
    detours = [] if front is None else detour_lines(problem.scene, front, plan)
    document = {"law": flown.law, "flights": len(flown.x), "legs": [asdict(leg) for leg in legs]}
    lines = list(plan_lines(problem, plan, flown, legs, medium, each=each))
    lines += [f"detour: {line}" for line in detours]
    return Explanation(lines, document | {"detours": detours})
