"""The explanation of a plan, leg by leg."""

from __future__ import annotations

from pathlib import Path

from pareto_ltl.run.exporting import run_with_plan
from pareto_ltl.run.interface import PlanningResult, choose, load_results, simulate
from pareto_ltl.run.page_stage import MOST_RUNS
from pareto_ltl.run.records import PLAN, PROBLEM
from pareto_ltl.run.results import Results


def explain(planned: PlanningResult | Results | str | Path, *, point: int | None = None) -> str:
    """Text on each leg of a plan: its goal, the closest obstacle, the share of flights failed by its end.

    Parameters
    ----------
    planned : PlanningResult, Results or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    point : int, optional
        The path of that number in ``front.csv``; default the plan.

    Raises
    ------
    DataError
        If there is no plan.
    InfeasibleError
        If the front has no such path.
    """
    from pareto_ltl.report.legs import plan_lines

    run = planned.run if isinstance(planned, PlanningResult) else run_with_plan(load_results(planned))
    if point is not None:
        run = choose(planned, point=point).run
    problem, plan = run.make(PROBLEM), run.make(PLAN)
    runs = min(run.settings.deployment.runs, MOST_RUNS)
    flown = simulate(PlanningResult(run), runs, problem.fidelity.law)
    return "\n".join(plan_lines(problem, plan, flown))
