"""What a run made: a plan in memory, or a results directory; and the run of either, to continue from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run import provenance
from pareto_ltl.run import records as keys
from pareto_ltl.run.metrics import run_metrics
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.received import inert
from pareto_ltl.run.records import RecordKey, Records, RecordView, T
from pareto_ltl.run.stage_table import with_extension_stages
from pareto_ltl.run.stages import PLAN_STAGES, PLAN_TABLE
from pareto_ltl.settings import Settings
from pareto_ltl.settings.building import read_settings_file
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.links import refuse_links_out
from pareto_ltl.support.reading import shaped
from pareto_ltl.support.run_status import ending_text
from pareto_ltl.support.schemas import read_document

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.report.figures import Drawing


@dataclass(frozen=True, slots=True, repr=False)
class PlanningResult(RecordView):
    """The result of :func:`plan`. Each record of the run is an attribute, or ``result[KEY]``.

    Attributes
    ----------
    run : Run
        The records, the settings and the time of every stage.
    """

    run: Run

    def __getitem__(self, key: RecordKey[T]) -> T:
        return self.run.make(key)

    @property
    def settings(self) -> Settings:
        """The settings of the run."""
        return self.run.settings

    @property
    def problem(self) -> Problem:
        """Map, wind, automaton and robot as the arrays that planning reads."""
        return self[keys.PROBLEM]

    @property
    def metrics(self) -> dict[str, float]:
        """The numbers of ``metrics.json``, as far as the stages made them."""
        return run_metrics(self.run.records, self.run.seconds)

    def facts(self) -> Mapping[str, str]:
        """The facts of the plan, the size of the front, and the directory if there is one."""
        facts = dict(self.plan.facts()) | {"front": f"{len(self.front.paths)} paths"}
        where = self.run.directory
        return facts if where is None else facts | {"directory": str(where)}

    def plot(self, **options: Any) -> Drawing:
        """The map with trees, plan and simulated flights."""
        return _mission_drawing(self, deployments=self.run.records.get(keys.DEPLOYMENTS), **options)


@dataclass(frozen=True, slots=True, repr=False)
class Results(RecordView):
    """One results directory, read lazily: ``Results("outputs/phi1/...").plan.path.objectives``.

    ``metrics.json`` is written last; its presence means that the run is complete.
    """

    directory: Path

    def __init__(self, directory: Path | str) -> None:
        object.__setattr__(self, "directory", Path(directory))

    def __getitem__(self, key: RecordKey[T]) -> T:
        return PLAN_TABLE.maker_of(key).load(self.directory)

    def records(self, required: Sequence[RecordKey[Any]] = ()) -> Records:
        """The ``required`` records, and those whose files exist; each is read when it is asked for."""
        stages = (stage for stage in PLAN_STAGES if stage.codec)
        there = (s for s in stages if s.makes in required or (self.directory / s.writes[0]).is_file())
        return Records(unread={stage.makes: partial(stage.load, self.directory) for stage in there})

    def facts(self) -> Mapping[str, str]:
        """Directory, and name, seed, fidelity and status of the run."""
        record = self.run if (self.directory / "run.json").is_file() else {}
        names = ("name", "seed", "fidelity", "status")
        return {"directory": str(self.directory)} | {name: str(record.get(name)) for name in names}

    def plot(self, **options: Any) -> Drawing:
        """The map with trees and plan, as a ``Drawing``."""
        return _mission_drawing(self, **options)

    @property
    def settings(self) -> Settings:
        """The settings that the run was made with."""
        return read_settings_file(self.directory / "config_resolved.yaml")

    @property
    def done(self) -> bool:
        """Whether the run has ended with an answer: a plan, tables, or that no plan exists."""
        if not (self.directory / "run.json").is_file():
            return False
        record = self.run
        answered = record.get("status") in provenance.ANSWERS
        return answered and (not record.get("measured", True) or (self.directory / "metrics.json").is_file())

    @property
    def metrics(self) -> dict[str, float]:
        """The numbers of ``metrics.json``, NaN where it has null."""
        content = read_document(self.directory / "metrics.json", "metrics")
        return {name: math.nan if value is None else value for name, value in content.items()}

    @property
    def run(self) -> dict[str, Any]:
        """The content of ``run.json``: status, versions, times."""
        return read_document(self.directory / "run.json", "run")


def _mission_drawing(view: RecordView, **options: Any) -> Drawing:
    from pareto_ltl.report.figures import mission_drawing

    return mission_drawing(view.scene, view.decomposition, view.wind, view.forest, view.plan, **options)


# --- the run of a plan, to continue from --------------------------------------------------------

Planned = PlanningResult | Results | str | Path  # what the functions of the Python interface take


def load_results(directory: str | Path | Results) -> Results:
    """The results directory of a finished run; its records are read on first access.

    Raises
    ------
    DataError
        If the directory holds no run, or a link leads out of it.
    """
    results = directory if isinstance(directory, Results) else Results(directory)
    if not (results.directory / "run.json").is_file():
        raise DataError(f"{results.directory}: there is no run.json; name a results directory")
    refuse_links_out(results.directory)
    return results


def place_of(planned: Planned, out: Path | None = None) -> Path | None:
    """The results directory of a plan; None in memory. Raises ConfigError if it is ``out``."""
    place = planned.run.directory if isinstance(planned, PlanningResult) else load_results(planned).directory
    if out is not None and place is not None and out.resolve() == place.resolve():
        raise ConfigError(f"{out}: the result would overwrite its source; name another folder")
    return place


def planned_run(planned: Planned, needed: Sequence[RecordKey[Any]] = (keys.PLAN,)) -> Run:
    """The run of a plan; the records of a results directory are read when they are asked for.

    Raises
    ------
    DataError
        If ``planned`` is the directory of a run that has not ended with the records ``needed``.
    """
    if isinstance(planned, PlanningResult):
        return planned.run
    results = load_results(planned)
    directory, status = results.directory, results.run.get("status")
    if status != "ok":
        raise DataError(f"{directory}: there is no plan: {ending_text(directory, status)}")
    settings = results.settings
    listed = settings.pipelines.stages
    missing = [key.name for key in needed if key.name not in listed]
    if missing == [keys.FRONT.name] and (directory / "replan.json").is_file():
        raise DataError(
            f"{directory}: the plan was made after an alarm (replan.json), so that its front has no failure "
            "rates to choose by; replan with a correct fix or forecast"
        )
    if missing:
        raise DataError(
            f"{directory}: its run made no {' and no '.join(missing)}; name the results directory of a plan"
        )
    records = results.records((*keys.GROUND, keys.FOREST, keys.PLAN, *needed))  # never made again
    with shaped(directory / "metrics.json", "the metrics of a run"):
        seconds = float(results.metrics["growth_seconds"])
    records.read_later(keys.FOREST, lambda: replace(results.forest, seconds=seconds))
    states = records[keys.PLAN].path.q
    if not ((states >= 0) & (states < records[keys.AUTOMATON].n_states)).all():
        raise DataError(f"{directory}: plan.json names states that automaton.json lacks; run the plan again")
    read = {str(name): str(digest) for name, digest in (results.run.get("inputs") or {}).items()}
    return Run(inert(settings), with_extension_stages(PLAN_STAGES, listed), records, read=read)
