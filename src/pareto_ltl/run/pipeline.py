"""Pipelines: a list of stages is checked, and their records are made in order, in a results directory."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from careful_io.error_lines import one_line
from careful_io.fingerprints import file_hashes
from careful_io.machine import require_memory
from careful_io.messages import shown_value
from pareto_ltl.run import provenance
from pareto_ltl.run.directory import claimed_directory, discard_try
from pareto_ltl.run.plan_run import PLAN_STAGES, Run
from pareto_ltl.run.progress import ProgressBar
from pareto_ltl.run.record import BaseRun, Record
from pareto_ltl.run.required import require_formula, require_map
from pareto_ltl.support import extensions
from pareto_ltl.support.errors import ConfigError, InfeasibleError, ParetoLtlError
from pareto_ltl.support.run_status import RUN_LOG

if TYPE_CHECKING:
    from pareto_ltl.settings import PlannerConfig, Settings

LOG = logging.getLogger("pareto_ltl")
VERTEX_BYTES = 150  # of a vertex, with fidelity=paper and one obstacle
POSITION_BYTES = 16
WRITTEN = 2.0  # copies of the positions while deployments.npz is packed
Answered = Callable[[dict[str, float]], None]


# --- checks before anything is made ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Pipeline:
    """Settings and their stages, after a check.

    Attributes
    ----------
    files : tuple of str
        Patterns of all files that a run of the application, or a command after it, writes or shows.
    """

    FIGURES: ClassVar[str] = "_figures"  # end of the names of stages that draw a study

    settings: Settings
    stages: tuple[Record[Any], ...]
    files: tuple[str, ...] = ()

    @staticmethod
    def discarded(directory: Path) -> bool:
        """Remove ``directory`` if a run failed in it before a tree grew; returns whether it is gone."""
        return discard_try(directory)

    @staticmethod
    def require_trees(
        planner: PlannerConfig, setting: str, vertices: int, processes: int = 1, where: str = ""
    ) -> None:
        """Raise ConfigError if trees of ``vertices``, which ``setting`` states, can never fit into memory.

        ``where`` follows the number of trees in the message.
        """
        each = processes * planner.trees * VERTEX_BYTES
        require_memory(each, setting, vertices, f"{planner.trees} trees{where}", "planner.trees")

    @classmethod
    def of(
        cls, settings: Settings, stages: Iterable[Record[Any]] | None = None, given: Collection[str] = ()
    ) -> Pipeline:
        """The stages that ``settings.pipelines.stages`` lists, without the stages of the records ``given``.

        Raises
        ------
        ConfigError, FormulaError
            If the list cannot run, or the settings lack the map or the formula that it needs.
        """
        table, listed = stages_by_name(settings, stages), settings.pipelines.stages
        names = dict.fromkeys((*table, *extensions.STAGES.names()))
        known = ", ".join(name for name in names if not name.endswith(Pipeline.FIGURES))
        known = f"{known}, and the {Pipeline.FIGURES} of studies"
        if not listed:
            raise ConfigError(f"pipelines.stages is empty: list at least one of {known}")
        for number, name in enumerate(listed):
            if name not in table:
                raise ConfigError(
                    f"pipelines.stages: there is no stage {shown_value(name, 40)}; there are {known}"
                )
            if name in listed[:number]:
                raise ConfigError(f"pipelines.stages lists {name!r} twice; list it once")
        chosen = tuple(table[name] for name in listed if table[name].name not in given)
        made = [stage.name for stage in chosen]
        if "scene" in made:
            require_map(settings.scene)
        if "automaton" in made:
            require_formula(settings.mission)
        _check_selection(settings, made)
        check_sizes(settings, [table[name] for name in listed])
        return cls(settings, chosen, files_of(table.values()))

    def claimed(self, directory: Path | str) -> AbstractContextManager[None]:
        """In the block, ``directory`` is locked for this run, and cleared of files of an earlier one."""
        return claimed_directory(Path(directory), self.files)

    def run(
        self, directory: Path | str, argv: Sequence[str] = (), overrides: Sequence[str] = ()
    ) -> dict[str, float]:
        """Run all stages into ``directory``, which is locked and cleared first, and return the metrics.

        An error that stops the run is written to ``run.json`` and ``run.log`` and then raised. Raises
        ConfigError if another run uses the directory.
        """
        with self.claimed(directory):
            return self.complete(Run(self.settings, directory=Path(directory)), argv, overrides)

    def complete(
        self, run: Run, argv: Sequence[str] = (), overrides: Sequence[str] = (),
        answered: Answered | None = None,
    ) -> dict[str, float]:  # fmt: skip
        """Make the stages that ``run`` has no records of, in its directory, which is locked already.

        The rest is as for :func:`carry_out`.
        """
        left = [stage for stage in self.stages if stage.name not in run.records]
        return carry_out(run, left, argv, overrides, answered)


@lru_cache
def known_stages() -> tuple[Record[Any], ...]:
    """The stages of a plan, and stages of applications (entry points in ``pareto_ltl.stage_tables``)."""
    return (*PLAN_STAGES, *(stage for table in extensions.STAGE_TABLES.load_all() for stage in table))


def stages_by_name(settings: Settings, stages: Iterable[Record[Any]] | None = None) -> dict[str, Record[Any]]:
    """``stages`` (the known ones) by their names, with those that other packages add and ``settings`` list.

    Raises
    ------
    ConfigError
        If an added stage has the name of a known one, does not load, or is no :class:`Record`.
    """
    table = {stage.stage: stage for stage in (known_stages() if stages is None else stages)}
    group = extensions.STAGES
    added = group.names((*table, *Run.rows()))
    for name in dict.fromkeys(settings.pipelines.stages):
        if name in added:
            stage = group.load(name, lambda loaded: isinstance(loaded, Record))
            if stage.stage != name:
                raise ConfigError(
                    f"entry point {name!r} in {group.name} is the stage {stage.stage!r}; give both one name"
                )
            table[name] = stage
    return table


def files_of(stages: Iterable[Record[Any]]) -> tuple[str, ...]:
    """Patterns of the files that ``stages``, or commands after them, write or show."""
    return tuple(name for stage in stages for name in (*stage.writes, *stage.shows, *stage.later))


def _check_selection(settings: Settings, made: Sequence[str]) -> None:
    """Raise ConfigError for a selection by a cost that the paths of the front do not have."""
    cfg, powered = settings.selection, settings.robot.power.kind != "none"
    known = ["length", *["energy"] * powered, *cfg.costs]
    by_energy = {"energy": "selection.rule=energy", "least": "selection.least=energy"}.get(cfg.rule, "")
    least = {"energy": "energy", "least": cfg.least}.get(cfg.rule, "length")
    weighed = any(cfg.weights[2 + len(known) :])
    if "plan" not in made or (least in known and not weighed):
        return
    if not powered and (least == "energy" or (weighed and not cfg.costs)):
        raise ConfigError(
            f"{by_energy or 'the fourth of selection.weights'} needs the power curve of the robot: take a "
            "robot that has one, e.g. robot=fixed_wing, or set robot.power.kind"
        )
    requested = (
        "selection.weights has more numbers than" if weighed else f"selection.least={least} is none of"
    )
    raise ConfigError(
        f"{requested} the costs of the front ({', '.join(known)}): add the cost to selection.costs, or take "
        "these"
    )


def check_sizes(settings: Settings, listed: Collection[Record[Any]]) -> None:
    """Raise ConfigError if the trees or the flights of ``settings`` can never fit into memory.

    ``planning/growth.py`` and ``simulation/flights.py`` check again when map and wind are known and the need
    is exact.
    """
    planner, flights = settings.planner, settings.deployment
    stages = [stage.stage for stage in listed]
    if "forest" in stages:
        Pipeline.require_trees(planner, "planner.n_max", planner.n_max)
    for stage in listed:
        stage.check(settings)
    if "deployment" in stages:
        each = 2 * POSITION_BYTES * len(flights.laws) * WRITTEN
        require_memory(each, "deployment.runs", flights.runs, "the positions of all simulated flights")


# --- making ------------------------------------------------------------------------------------


def make_all(run: BaseRun, stages: Iterable[Record[Any]]) -> None:
    """Make the records of ``stages`` in order.

    If the mission is infeasible, the records that do not need a missing one are still made (the figure shows
    how far the trees came); then the error is raised.
    """
    infeasible: InfeasibleError | None = None
    for stage in stages:
        try:
            run.made(stage)
        except InfeasibleError as error:
            infeasible = infeasible or error
        except Exception:
            if infeasible is None:
                raise
            LOG.exception("stage %s failed after the mission turned out infeasible", stage.stage)
    if infeasible is not None:
        raise infeasible


def make_answer_first(run: BaseRun, stages: Iterable[Record[Any]], answered: Answered) -> None:
    """:func:`make_all`; ``answered`` is called with the metrics before figures and page, the last stages.

    An infeasible mission has no answer before its figures, which show how far the trees came.
    """
    wanted = list(stages)
    shown = list(takewhile(lambda stage: stage.for_people, reversed(wanted)))
    try:
        make_all(run, wanted[: len(wanted) - len(shown)])
    except InfeasibleError:
        make_all(run, wanted)
        raise
    if shown:
        if run.progress:
            run.progress.close()
        answered(_metrics_of(run))
    make_all(run, wanted)


def _metrics_of(run: BaseRun) -> dict[str, float]:
    from pareto_ltl.run.metrics import run_metrics

    return run_metrics(run.records, run.seconds)


# --- a run with a results directory --------------------------------------------------------------


def _bar_of(run: BaseRun) -> ProgressBar:
    return run.progress or ProgressBar(preset=run.settings.fidelity.name)


def carry_out(
    run: BaseRun, stages: Iterable[Record[Any]], argv: Sequence[str] = (), overrides: Sequence[str] = (),
    answered: Answered | None = None,
) -> dict[str, float]:  # fmt: skip
    """Make the records of ``stages`` in the directory of ``run``; result and errors as :meth:`Pipeline.run`.

    ``answered`` is called with the metrics as soon as only figures and pages are left to be made.

    If ``run`` already has a progress bar, it is used: a run inside another one shows no second bar.
    """
    place = run.directory
    if place is None:
        raise ValueError("the run has no directory: create it with Run(..., directory=PATH)")
    place.mkdir(parents=True, exist_ok=True)
    with logging_to(place / RUN_LOG), run.budget.ends_at_key(), _bar_of(run) as run.progress:
        record = provenance.begin(run.settings, argv, overrides)
        try:
            LOG.info("run %s, seed %d", run.settings.name, run.settings.seed)
            provenance.write_settings(place, run.settings)
            provenance.write(place, record)  # with the present status at any moment
            for name, row in run.rows().items():  # those that were given, so that the directory is complete
                if name in run.records:
                    row.save(place, run.records[name])
            if answered is None:
                make_all(run, stages)
            else:
                make_answer_first(run, stages, answered)
            return _close(run, place, record, "ok")
        except BaseException as error:
            expected = isinstance(error, ParetoLtlError | OSError | KeyboardInterrupt)
            with suppress(OSError):  # a full disk must not hide the error
                LOG.error("%s", one_line(error), exc_info=None if expected else error)
            with suppress(OSError):
                _close(run, place, record, _end_status(error), error)
            raise


def _end_status(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):  # also for SIGTERM, which the command line turns into it
        return "stopped"
    return "infeasible" if isinstance(error, InfeasibleError) else "failed"


def _close(
    run: BaseRun, place: Path, record: dict[str, Any], status: str, error: BaseException | None = None
) -> dict[str, float]:
    """Write how the run ended. A failed run has no metrics, an infeasible one has them if it grew trees."""
    from careful_io.files import write_json

    table = _metrics_of(run)
    measured = status == "ok" or (status == "infeasible" and "forest" in run.records)
    elsewhere = [made for made in run.records.values() if isinstance(made, Path)]  # tables in other folders
    ended = {
        "status": status,
        "error": None if error is None else one_line(error),
        "finished": provenance.now(),
        "inputs": run.input_hashes(),
        "seconds": dict(run.seconds),
        "outputs": file_hashes(elsewhere),
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
    """Write messages of the packages, of the compiler and warnings of Python to the file ``path``."""
    handler = RunLogFile(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    heard = (LOG, *map(logging.getLogger, ("careful_io", "typed_kernels", "wind_laws", "py.warnings")))
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
