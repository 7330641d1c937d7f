"""The stage runner: makes what a pipeline lists, in order, and leaves a results directory behind."""

from __future__ import annotations

import inspect
import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any
from zlib import crc32

from pareto_ltl.run import provenance, stages
from pareto_ltl.run.progress import ProgressBar
from pareto_ltl.settings import Settings
from pareto_ltl.studies import stages as studies  # noqa: F401 - makes the studies known by name
from pareto_ltl.support.errors import ConfigError, InfeasibleError, ParetoLtlError

log = logging.getLogger("pareto_ltl")

AMBIENT = ("settings", "seeds", "progress", "directory")
SECTION = "_cfg"  # planner_cfg is settings.planner


# --- what a list of stages needs ---------------------------------------------------------------


def needs(name: str) -> tuple[list[str], list[str]]:
    """Records that stage or ingredient ``name`` must have, and those it takes when they are there."""
    make = stages.STAGES.get(name) or stages.INGREDIENTS[name]
    records = [
        p
        for p in inspect.signature(make).parameters.values()
        if p.name not in AMBIENT and not p.name.endswith(SECTION)
    ]
    must = [p.name for p in records if p.default is p.empty]
    return must, [p.name for p in records if p.default is not p.empty]


def lacking(name: str, made: set[str] | Mapping[str, Any]) -> list[str]:
    """Records that ``name`` still needs, ingredients opened up to what they are made from."""
    missing: list[str] = []
    for need in needs(name)[0]:
        if need in made:
            continue
        missing += lacking(need, made) if need in stages.INGREDIENTS else [need]
    return list(dict.fromkeys(missing))


def check(settings: Settings) -> None:
    """Refuse a pipeline that cannot run, before anything is made."""
    listed = settings.pipelines.stages
    known = ", ".join(stages.STAGES)
    if not listed:
        raise ConfigError(f"pipelines.stages is empty: list at least one of {known}")
    made: set[str] = set()
    for name in listed:
        if name not in stages.STAGES:
            raise ConfigError(f"pipelines.stages: there is no stage {name!r}; there are {known}")
        if name in made:
            raise ConfigError(f"pipelines.stages lists {name!r} twice; once is enough")
        if missing := lacking(name, made):
            raise ConfigError(
                f"pipelines.stages: {name!r} needs {', '.join(missing)}, which no earlier stage makes; "
                f"list {'it' if len(missing) == 1 else 'them'} before {name!r}"
            )
        made.add(name)
    _check_mission(settings, {need for name in listed for need in needs(name)[0]} | made)


def _check_mission(settings: Settings, wanted: set[str]) -> None:
    from pareto_ltl.support.resources import choices

    missions = ", ".join(choices("experiment"))
    if "scene" in wanted and not (settings.scene.bounds or settings.scene.file):
        raise ConfigError(
            f"scene is missing: choose a ready mission with +experiment=NAME ({missions}) "
            f"or a map with scene=NAME ({', '.join(choices('scene'))})"
        )
    if "automaton" not in wanted or settings.mission.automaton:
        return
    from pareto_ltl.logic.formula import parse, positive
    from pareto_ltl.logic.patterns import formula_of

    formula = formula_of(settings.mission)
    if not formula.strip():
        raise ConfigError(
            f"mission.formula is missing: choose a ready mission with +experiment=NAME ({missions}) "
            "or give one, e.g. \"mission.formula='F(a & F b)'\""
        )
    positive(parse(formula))


# --- making ------------------------------------------------------------------------------------


@dataclass(slots=True)
class Run:
    """Records and times of one run as it proceeds."""

    settings: Settings
    directory: Path
    progress: ProgressBar
    records: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def make(self, name: str) -> Any:
        """Make record ``name``, and before it the ingredients it lacks; write it where it has a place."""
        from pareto_ltl.run.results import Results

        must, may = needs(name)
        for need in must:
            if need not in self.records and need in stages.INGREDIENTS:
                self.make(need)
        given = {need: self.records[need] for need in (*must, *may) if need in self.records}
        make = stages.STAGES.get(name) or stages.INGREDIENTS[name]
        start = time.perf_counter()
        try:
            with self.progress.stage(name):
                record = make(**given, **self._ambient(name, inspect.signature(make).parameters))
                self.records[name] = record
                Results(self.directory).save(name, record)
        finally:
            self.seconds[name] = time.perf_counter() - start
        log.info("%s done in %.3f s", name, self.seconds[name])
        return record

    def _ambient(self, name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
        from numpy.random import SeedSequence

        # A stage's stream depends on its name alone: another pipeline, the same draws.
        seeds = SeedSequence(self.settings.seed, spawn_key=(crc32(name.encode()),))
        ambient = {
            "settings": self.settings,
            "seeds": seeds,
            "progress": self.progress,
            "directory": self.directory,
        }
        sections = {f"{f.name}{SECTION}": getattr(self.settings, f.name) for f in fields(self.settings)}
        return {key: value for key, value in (ambient | sections).items() if key in parameters}


def make_all(run: Run) -> None:
    """Make the listed stages in order.

    Where a mission turns out infeasible, the stages that need none of what is missing still follow (the
    picture of how far the trees came), then the error does.
    """
    listed = run.settings.pipelines.stages
    for position, name in enumerate(listed):
        try:
            run.make(name)
        except InfeasibleError:
            _make_rest(run, listed[position + 1 :])
            raise


def _make_rest(run: Run, names: Sequence[str]) -> None:
    for name in names:
        if not lacking(name, run.records):
            try:
                run.make(name)
            except Exception:
                log.exception("stage %s failed after the mission turned out infeasible", name)


def run(
    settings: Settings, directory: Path | str, argv: Sequence[str] = (), overrides: Sequence[str] = ()
) -> dict[str, float]:
    """Run the pipeline of ``settings`` into ``directory`` and return the metrics.

    What stops a run is noted in ``run.json`` and ``run.log`` first and then raised.
    """
    check(settings)
    place = Path(directory)
    place.mkdir(parents=True, exist_ok=True)
    with logging_to(place / "run.log"), ProgressBar() as bar:
        return _recorded(Run(settings, place, bar), provenance.begin(settings, argv, overrides))


def _recorded(run: Run, record: dict[str, Any]) -> dict[str, float]:
    """Make all stages, with ``run.json`` telling at any moment how far that has come."""
    log.info("run %s, seed %d", run.settings.name, run.settings.seed)
    try:
        provenance.write_settings(run.directory, run.settings)
        provenance.write(run.directory, record)
        make_all(run)
        table = _close(run, record, "ok")
    except BaseException as error:
        expected = isinstance(error, ParetoLtlError | OSError | KeyboardInterrupt)
        log.error("%s", provenance.one_line(error), exc_info=None if expected else error)
        with suppress(OSError):  # a full disk must not hide what filled it
            _close(run, record, "infeasible" if isinstance(error, InfeasibleError) else "failed", error)
        raise
    return table


def _close(
    run: Run, record: dict[str, Any], status: str, error: BaseException | None = None
) -> dict[str, float]:
    """Write how the run ended. A failed run has no metrics; an infeasible one that grew trees has."""
    from pareto_ltl.run.metrics import metrics
    from pareto_ltl.support.files import write_json

    table = metrics(run.records, run.seconds)
    measured = status == "ok" or (status == "infeasible" and "forest" in run.records)
    ended = provenance.end(record, run.settings, status, run.seconds, error)
    provenance.write(run.directory, ended | {"measured": measured})  # metrics.json is still to come
    if measured:
        write_json(run.directory / "metrics.json", table)
    return table


@contextmanager
def logging_to(path: Path) -> Iterator[None]:
    """What the package and Python's warnings have to say goes to ``path``."""
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    heard = (log, logging.getLogger("py.warnings"))
    before = [(logger, logger.level, logger.propagate) for logger in heard]
    for logger in heard:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        logger.propagate = False  # a sweep's own log goes to the screen
    logging.captureWarnings(True)
    try:
        yield
    finally:
        logging.captureWarnings(False)
        for logger, level, propagate in before:
            logger.removeHandler(handler)
            logger.setLevel(level)
            logger.propagate = propagate
        handler.close()
