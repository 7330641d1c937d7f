"""What the functions of the Python interface take: a run in memory, or a results directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import ending_text

Planned = Run | str | Path  # of a finished run


def load_results(directory: str | Path | Run) -> Run:
    """The run of a results directory; its records are read on first access.

    Raises
    ------
    DataError
        If the directory holds no run, or a link leads out of it.
    """
    return directory if isinstance(directory, Run) else Run.open(directory)


def planned_run(planned: Planned, needed: Sequence[str] = ("plan",)) -> Run:
    """The run of a plan; one in a results directory is checked.

    Raises
    ------
    DataError
        If ``planned`` is the directory of a run that has not ended with the stages ``needed``.
    """
    run = load_results(planned)
    if run.stored is None:
        return run
    directory, status = run.place, run.provenance.get("status")
    if status != "ok":
        raise DataError(f"{directory}: there is no plan: {ending_text(directory, status)}")
    missing = [name for name in needed if name not in run.settings.pipelines.stages]
    if missing == ["front"] and (directory / "replan.json").is_file():
        raise DataError(
            f"{directory}: the plan was made after an alarm (replan.json), so that its front has no failure "
            "rates to choose by; replan with a correct fix or forecast"
        )
    if missing:
        raise DataError(
            f"{directory}: its run made no {' and no '.join(missing)}; name the results directory of a plan"
        )
    states = run.plan.path.q
    if not ((states >= 0) & (states < run.automaton.n_states)).all():
        raise DataError(f"{directory}: plan.json names states that automaton.json lacks; run the plan again")
    return run
