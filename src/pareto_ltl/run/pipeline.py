"""The runner: checks a list of stages, makes their records in order, and writes a results directory.

Single runs, studies and the Python interface use the same :class:`Run`. The run of a study has no directory:
the study passes records to it and gets others with :meth:`Run.make`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pareto_ltl.run import provenance
from pareto_ltl.run.directory import RUN_LOG, claimed_directory
from pareto_ltl.run.progress import ProgressBar, watcher
from pareto_ltl.run.records import AUTOMATON, DEPLOYMENTS, FOREST, PLAN, SCENE, RecordKey, Records, T
from pareto_ltl.run.stage_table import FIGURES, Stage, StageInputs, StageTable
from pareto_ltl.run.stages import PLAN_TABLE
from pareto_ltl.settings import Settings
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.errors import ConfigError, InfeasibleError, ParetoLtlError
from pareto_ltl.support.machine import cores, require_memory
from pareto_ltl.support.messages import shown_value

LOG = logging.getLogger("pareto_ltl")
VERTEX_BYTES = 150  # of a vertex, with fidelity=paper and one obstacle
POSITION_BYTES = 16
WRITTEN = 2.0  # copies of the positions while deployments.npz is packed
STUDIES = (  # in several processes
    "comparison", "convergence", "ablation", "hindcast", "forecast_test", "departure", "replanning",
    "replan_test",
)  # fmt: skip


# --- checks before anything is made ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Pipeline:
    """Settings and their stages, after a check: each stage finds the records that it needs."""

    settings: Settings
    table: StageTable
    stages: tuple[Stage[Any], ...]


def check_pipeline(settings: Settings, table: StageTable, given: Collection[RecordKey[Any]] = ()) -> Pipeline:
    """The stages that ``settings.pipelines.stages`` lists, without those that make a ``given`` record.

    Raises
    ------
    ConfigError, FormulaError
        If the list cannot run, or the settings lack the map or the formula that it needs.
    """
    listed = settings.pipelines.stages
    known = ", ".join(name for name in table.known if not name.endswith(FIGURES))
    known = f"{known}, and the {FIGURES} of studies"
    if not listed:
        raise ConfigError(f"pipelines.stages is empty: list at least one of {known}")
    stages: list[Stage[Any]] = []
    seen: set[str] = set()
    for name in listed:
        if name not in table:
            raise ConfigError(
                f"pipelines.stages: there is no stage {shown_value(name, 40)}; there are {known}"
            )
        if name in seen:
            raise ConfigError(f"pipelines.stages lists {name!r} twice; list it once")
        seen.add(name)
        stage = table[name]
        if stage.makes in given:
            continue
        made = {*given, *(other.makes for other in stages)}
        if missing := [key.name for key in stage.needs if key not in made]:
            raise ConfigError(
                f"pipelines.stages: {name!r} needs {', '.join(missing)}, which no earlier stage makes; "
                f"list {'it' if len(missing) == 1 else 'them'} before {name!r}"
            )
        stages.append(stage)
    _check_mission(settings, [stage.makes for stage in stages])
    _check_selection(settings, [stage.makes for stage in stages])
    check_sizes(settings, listed)
    return Pipeline(settings, table, tuple(stages))


def _check_selection(settings: Settings, made: Sequence[RecordKey[Any]]) -> None:
    """Raise ConfigError for a selection by a cost that the paths of the front do not have."""
    cfg, powered = settings.selection, settings.robot.power.kind != "none"
    known = ["length", *["energy"] * powered, *cfg.costs]
    by_energy = {"energy": "selection.rule=energy", "least": "selection.least=energy"}.get(cfg.rule, "")
    least = {"energy": "energy", "least": cfg.least}.get(cfg.rule, "length")
    weighed = any(cfg.weights[2 + len(known) :])
    if PLAN not in made or (least in known and not weighed):
        return
    if not powered and (least == "energy" or (weighed and not cfg.costs)):
        raise ConfigError(
            f"{by_energy or 'the fourth of selection.weights'} needs the power curve of the robot: take a "
            "robot that has one, e.g. robot=fixed_wing, or set robot.power.kind"
        )
    asked = "selection.weights has more numbers than" if weighed else f"selection.least={least} is none of"
    raise ConfigError(
        f"{asked} the costs of the front ({', '.join(known)}): add the cost to selection.costs, or take these"
    )


def _check_mission(settings: Settings, made: Sequence[RecordKey[Any]]) -> None:
    from pareto_ltl.support.resources import choices

    if SCENE in made and not (settings.scene.bounds or settings.scene.file):
        raise ConfigError(
            f"scene is missing: choose a ready mission with +experiment=NAME "
            f"({', '.join(choices('experiment'))}) or a map with scene=NAME ({', '.join(choices('scene'))})"
        )
    if AUTOMATON not in made or settings.mission.automaton:
        return
    from pareto_ltl.logic.formula import parse_formula as parse
    from pareto_ltl.logic.normal_form import positive_normal_form as positive
    from pareto_ltl.logic.patterns import formula_of

    formula = formula_of(settings.mission)
    if not formula.strip():
        raise ConfigError(
            "mission.formula is missing: choose a ready mission with +experiment=NAME "
            f"({', '.join(choices('experiment'))}) or give one, e.g. \"mission.formula='F(a & F b)'\""
        )
    positive(parse(formula))  # the automaton stage gets the same tree from the cache of ``parse``


def check_sizes(settings: Settings, stages: Collection[str]) -> None:
    """Raise ConfigError if the trees or the flights of ``settings`` can never fit into memory.

    ``planning/growth.py`` and ``simulation/flights.py`` check again when map and wind are known and the need
    is exact.
    """
    planner, flights = settings.planner, settings.deployment
    if any(stage in stages for stage in (FOREST.name, *STUDIES)):
        jobs = (settings.evaluation.jobs or cores()) if FOREST.name not in stages else 1
        busy = f" in each of {jobs} processes (evaluation.jobs)" if jobs > 1 else ""
        trees = f"{planner.trees} trees{busy}"
        require_memory(
            jobs * planner.trees * VERTEX_BYTES, "planner.n_max", planner.n_max, trees, "planner.trees"
        )
        if "convergence" in stages:
            sizes = max(settings.convergence.sizes)
            require_memory(planner.trees * VERTEX_BYTES, "convergence.sizes", sizes, trees, "planner.trees")
    if DEPLOYMENTS.name in stages:
        each = 2 * POSITION_BYTES * len(flights.laws) * WRITTEN
        require_memory(each, "deployment.runs", flights.runs, "the positions of all simulated flights")


# --- making ------------------------------------------------------------------------------------


@dataclass(slots=True)
class Run:
    """Records and times of one run: ``run[WIND]`` is a record that was made or given.

    Attributes
    ----------
    records : Records
        Records made so far, and those given at the start.
    seconds : dict of str to float
        Time that each stage took, without the stages that it waited for [s].
    directory : Path or None
        Where records are written as soon as they are made; None keeps them in memory.
    progress : ProgressBar or None
        Shows the present stage.
    failure : str
        Why the mission is infeasible; empty if it is not, or not known to be.
    budget : Budget
        Time limit of growth and refinement together.
    """

    settings: Settings
    table: StageTable = PLAN_TABLE
    records: Records = field(default_factory=Records)
    seconds: dict[str, float] = field(default_factory=dict)
    directory: Path | None = None
    progress: ProgressBar | None = None
    failure: str = ""
    budget: Budget = field(init=False)

    def __post_init__(self) -> None:
        self.budget = Budget(self.settings.planner.budget_seconds)

    def __getitem__(self, key: RecordKey[T]) -> T:
        return self.records[key]

    def make(self, key: RecordKey[T]) -> T:
        """The record of ``key``; if it does not exist, it is made, after the records that it needs."""
        if key not in self.records:
            stage = self.table.maker_of(key)
            for need in stage.needs:
                self.make(need)
            self.perform(stage)
        return self.records[key]

    def perform(self, stage: Stage[T]) -> T:
        """Make the record of ``stage`` from existing records; write it if the run has a directory."""
        start = time.perf_counter()
        try:
            with self.progress.stage(stage.name) if self.progress else nullcontext():
                record = stage.make(StageInputs(stage, self))
                self.records[stage.makes] = record
                if self.directory is not None:
                    stage.save(self.directory, record)
                    watcher().made(stage.makes, self.records)
        finally:
            self.seconds[stage.name] = time.perf_counter() - start
        if self.directory is not None:
            LOG.info("%s done in %.3f s", stage.name, self.seconds[stage.name])
        return record

    def with_seed(self, seed: int) -> Run:
        """A run of the same records with another seed, which applies to records not made yet."""
        return Run(replace(self.settings, seed=seed), self.table, self.records.copy())

    def with_record(self, key: RecordKey[T], record: T) -> Run:
        """A run in which ``key`` has ``record``."""
        return Run(self.settings, self.table, self.records.replaced(key, record))


def make_all(run: Run, stages: Sequence[Stage[Any]]) -> None:
    """Make the records of ``stages`` in order.

    If the mission is infeasible, the stages that need no missing record still run (the figure shows how far
    the trees came); then the error is raised.
    """
    for position, stage in enumerate(stages):
        try:
            run.perform(stage)
        except InfeasibleError as error:
            run.failure = str(error)
            _make_rest(run, stages[position + 1 :])
            raise


def _make_rest(run: Run, stages: Sequence[Stage[Any]]) -> None:
    for stage in stages:
        if all(key in run.records for key in stage.needs):
            try:
                run.perform(stage)
            except Exception:
                LOG.exception("stage %s failed after the mission turned out infeasible", stage.name)


# --- a run with a results directory --------------------------------------------------------------


def run_pipeline(
    pipeline: Pipeline, directory: Path | str, argv: Sequence[str] = (), overrides: Sequence[str] = ()
) -> dict[str, float]:
    """Run ``pipeline`` into ``directory``, which is locked and cleared first, and return the metrics.

    An error that stops the run is written to ``run.json`` and ``run.log`` and then raised. Raises ConfigError
    if another run uses the directory.
    """
    with claimed_directory(Path(directory), pipeline.table.files):
        return run_claimed(pipeline, directory, argv, overrides)


def run_claimed(
    pipeline: Pipeline, directory: Path | str, argv: Sequence[str] = (), overrides: Sequence[str] = (),
    progress: ProgressBar | None = None,
) -> dict[str, float]:  # fmt: skip
    """:func:`run_pipeline` in a directory that this process has already locked; ``progress`` shows it."""
    run = Run(pipeline.settings, pipeline.table, directory=Path(directory), progress=progress)
    return carry_out(run, pipeline.stages, argv, overrides)


def carry_out(
    run: Run, stages: Sequence[Stage[Any]], argv: Sequence[str] = (), overrides: Sequence[str] = ()
) -> dict[str, float]:
    """Make the records of ``stages`` in the directory of ``run``; result and errors as :func:`run_claimed`.

    If ``run`` already has a progress bar, it is used: a run inside another one shows no second bar.
    """
    place = run.directory
    if place is None:
        raise ValueError("the run has no directory: create it with Run(..., directory=PATH)")
    place.mkdir(parents=True, exist_ok=True)
    with logging_to(place / RUN_LOG), run.budget.ends_at_key(), run.progress or ProgressBar() as run.progress:
        record = provenance.begin(run.settings, argv, overrides)
        try:
            LOG.info("run %s, seed %d", run.settings.name, run.settings.seed)
            provenance.write_settings(place, run.settings)
            provenance.write(place, record)  # with the present status at any moment
            for key in run.records:  # those that were given, so that the directory is complete
                if key.name in run.table:
                    run.table.maker_of(key).save(place, run.records[key])
            make_all(run, stages)
            return _close(run, place, record, "ok")
        except BaseException as error:
            expected = isinstance(error, ParetoLtlError | OSError | KeyboardInterrupt)
            with suppress(OSError):  # a full disk must not hide the error
                LOG.error("%s", provenance.one_line(error), exc_info=None if expected else error)
            with suppress(OSError):
                _close(run, place, record, _end_status(error), error)
            raise


def _end_status(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):  # also for SIGTERM (support/stopping.py)
        return "stopped"
    return "infeasible" if isinstance(error, InfeasibleError) else "failed"


def _close(
    run: Run, place: Path, record: dict[str, Any], status: str, error: BaseException | None = None
) -> dict[str, float]:
    """Write how the run ended. A failed run has no metrics, an infeasible one has them if it grew trees."""
    from pareto_ltl.run.metrics import run_metrics
    from pareto_ltl.support.files import write_json

    table = run_metrics(run.records, run.seconds)
    measured = status == "ok" or (status == "infeasible" and FOREST in run.records)
    elsewhere = [made for made in run.records.values() if isinstance(made, Path)]  # tables in other folders
    ended = {
        "status": status,
        "error": None if error is None else provenance.one_line(error),
        "finished": provenance.now(),
        "inputs": provenance.input_hashes(run.settings),
        "seconds": dict(run.seconds),
        "outputs": provenance.file_hashes(elsewhere),
        "measured": measured,
    }
    provenance.write(place, record | ended)  # metrics.json follows
    if measured:
        write_json(place / "metrics.json", table)
    return table


class RunLogFile(logging.FileHandler):
    """A log file that raises errors of writing, for example a full disk, as any other file does."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: ARG002, N802 - as logging has it
        """Raise the error of the write, which logging would only print."""
        raise  # noqa: PLE0704 - logging calls this while it handles the error

    def close(self) -> None:
        """Close the file; errors of writing were raised earlier."""
        with suppress(OSError):  # raised by an earlier write
            super().close()


@contextmanager
def logging_to(path: Path) -> Iterator[None]:
    """Write the messages of the package and the warnings of Python to the file ``path``."""
    handler = RunLogFile(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    heard = (LOG, logging.getLogger("py.warnings"))
    before = [(logger, logger.level, logger.propagate) for logger in heard]
    for logger in heard:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        logger.propagate = False  # the log of a sweep goes to the screen
    logging.captureWarnings(True)
    try:
        yield
    finally:
        for logger, level, propagate in before:
            logger.removeHandler(handler)
            logger.setLevel(level)
            logger.propagate = propagate
        logging.captureWarnings(
            any(isinstance(other, RunLogFile) for other in LOG.handlers)
        )  # of an outer run
        handler.close()
