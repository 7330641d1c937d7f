"""Resumable parts of a study: each result is a small file, written completely or not at all.

The file of a part has a key, the fingerprint of all that its result depends on: settings, arguments, wind
files and the code. A later run with the same keys reads the files. Unfinished files of a killed run never
have the name of a result.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from pareto_ltl.run.provenance import input_files
from pareto_ltl.settings import EvaluationConfig, Settings
from pareto_ltl.studies import cluster
from pareto_ltl.studies.jobs import KILLED, JobQueue, JobState, StoredJob
from pareto_ltl.support.cores import cores
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import plain_data, remove_dead_drafts, write_json
from pareto_ltl.support.fingerprints import code_fingerprint, data_fingerprint, file_fingerprint
from pareto_ltl.support.reading import read_json

PARTS_FOLDER = "parts"
OTHER_SECTIONS = (  # sections that parts do not depend on, or that a study adds to its keys itself
    "name", "report", "pipelines", "ingest", "evaluation", "compare", "convergence", "ablation", "hindcast",
    "forecast_test", "departure", "replanning", "sitl",
)  # fmt: skip
OTHER_CODE = ("report", "cli", "__main__")  # code that parts do not depend on

PartsProgress = Callable[[int, int], None]  # called with the number of parts that are done, and of all
PartWork = Callable[..., Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Part:
    """One independent piece of a study.

    Attributes
    ----------
    name : str
        Readable beginning of the file name.
    arguments : tuple
        Passed to the work function after the context.
    key : str
        Fingerprint of all that the result depends on.
    """

    name: str
    arguments: tuple[Any, ...]
    key: str

    @property
    def file(self) -> str:
        """Name of the file of the result."""
        return f"{self.name}-{self.key[:12]}.json"


def part_key(settings: Settings, *more: Any) -> str:
    """Fingerprint of the settings that matter to a plan, of ``more``, of the wind files and of the code."""
    relevant = {name: value for name, value in asdict(settings).items() if name not in OTHER_SECTIONS}
    relevant["planner"].pop("threads")
    inputs = [file_fingerprint(file) for file in sorted(input_files(settings))]
    code = code_fingerprint(without=OTHER_CODE)
    return data_fingerprint([relevant, plain_data(list(more)), inputs, code])


# --- the folder ------------------------------------------------------------------------------


def parts_folder(cfg: EvaluationConfig, directory: Path) -> Path:
    """The folder of parts: in the results directory, or in the directory of the run to resume.

    Raises
    ------
    DataError
        If ``evaluation.resume`` names a directory without parts.
    """
    if cfg.resume is None:
        place = directory / PARTS_FOLDER
        place.mkdir(parents=True, exist_ok=True)
        return place
    place = Path(cfg.resume).expanduser() / PARTS_FOLDER
    if not place.is_dir():
        raise DataError(
            f"evaluation.resume={cfg.resume}: there is no folder {PARTS_FOLDER}/ in it; name the results "
            "directory of a run of compare, convergence, ablation, hindcast, forecast_test, departure, "
            "replanning or replan_test, or leave evaluation.resume out"
        )
    return place


@dataclass(frozen=True, slots=True)
class PartJob(StoredJob):
    """A part with its place on disk."""

    folder: Path
    part: Part

    @property
    def name(self) -> str:
        """The name of the part."""
        return self.part.name

    @property
    def key(self) -> str:
        """Fingerprint of all that the result depends on."""
        return self.part.key

    @property
    def path(self) -> Path:
        """The file of the result."""
        return self.folder / self.part.file

    @property
    def lock(self) -> Path:
        """The lock of the process that computes the part."""
        return self.folder / f".{self.part.file}.lock"

    @property
    def traces(self) -> tuple[Path, ...]:
        """Files that show that a process has begun: lock and result."""
        return self.lock, self.path

    def look(self) -> JobState:
        """The state of the part, from its files."""
        if self.abandoned():
            return JobState("failed", KILLED)
        if not self.path.exists():
            return JobState("running" if self.lock.exists() else "pending")
        try:
            content = read_json(self.path)
        except DataError as error:
            reason = str(error).removeprefix(f"{self.path}: ").split("; run the plan")[0]
            return JobState("failed", f"is damaged ({reason})")
        mine = content.get("key") == self.key
        if mine and isinstance(content.get("result"), dict):
            return JobState("ok", record=content["result"])
        if mine and isinstance(content.get("error"), str):
            return JobState("failed", f"was given up ({content['error']})")
        reason = f"expected the result of {self.name}, got something else"
        return JobState("failed", f"is damaged ({reason})")

    def settled(self) -> bool:
        """Whether there is a result of these settings."""
        return self.look().answered

    def clear(self) -> None:
        """Remove the result."""
        self.path.unlink(missing_ok=True)

    def note_failure(self, error: str) -> None:
        """Write ``error`` in place of a result."""
        write_json(self.path, {"key": self.key, "part": self.name, "error": error})

    def keep_result(self, function: PartWork, context: Any) -> None:
        """Compute the part and write its result, unless another process does."""

        def work() -> None:
            result = function(context, *self.part.arguments)
            write_json(self.path, {"key": self.key, "part": self.name, "result": result})

        self.do_once(work)


# --- the work --------------------------------------------------------------------------------


def work_parts(
    cfg: EvaluationConfig,
    directory: Path,
    function: PartWork,
    context: Any,
    parts: Sequence[Part],
    progress: PartsProgress | None = None,
) -> list[dict[str, Any]]:
    """Results of ``function(context, *part.arguments)`` for all parts, in their order.

    Results are read back from disk even when they are new, so that a resumed run gives the same bytes as one
    that was never stopped. Parts with the same key are computed once.

    Raises
    ------
    DataError
        If parts were given up because they were killed each time; the results of all others are stored.
    """
    place = parts_folder(cfg, directory)
    remove_dead_drafts(place)
    jobs = {part.key: PartJob(place, part) for part in parts}
    todo = [job for job in jobs.values() if not _is_known(job)]
    tally = _Tally(len(jobs) - len(todo), len(jobs), progress)
    queue = JobQueue(
        partial(_launch_parts, _spread_of(cfg, len(todo)), function, context, tally),
        lambda line: print(f"pareto-ltl: {line}", file=sys.stderr),
        breaks=(BrokenProcessPool,) if cfg.cluster is None else cluster.broken(),
    )
    try:
        queue.run(todo)
    except KeyboardInterrupt:
        stored = f"{tally.done} of {tally.total} parts are stored"
        print(f"pareto-ltl: {stored}; evaluation.resume={place.parent} continues with them", file=sys.stderr)
        raise
    _refuse_given_up(place, [jobs[key] for key in queue.given_up], len(jobs))
    results = {key: _result_of(job) for key, job in jobs.items()}
    return [results[part.key] for part in parts]


def process_count(cfg: EvaluationConfig, parts: int) -> int:
    """Number of processes for ``parts``, at most one for each part."""
    from joblib import cpu_count  # heeds affinity and the limits of containers

    return max(1, min(cfg.jobs or int(cpu_count()), parts))


def half_the_cores(cfg: EvaluationConfig) -> EvaluationConfig:
    """``cfg`` for parts that plan with two threads each: another process takes as long to begin as a part."""
    return replace(cfg, jobs=cfg.jobs or max(1, cores() // 2))


@dataclass(slots=True)
class _Tally:
    """Counts parts that are done, and reports each."""

    done: int
    total: int
    progress: PartsProgress | None

    def count_one(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, self.total)


def _is_known(job: PartJob) -> bool:
    """Whether the result is on disk; prints one line for a file without a valid result."""
    state = job.look()
    if state.error is not None and job.path.exists():
        print(f"pareto-ltl: {job.path} {state.error}; it is made again", file=sys.stderr)
    return state.answered


def _result_of(job: PartJob) -> dict[str, Any]:
    state = job.look()
    if not state.answered:
        raise DataError(
            f"{job.path}: could not be read back; is another run using this folder, or have the workers of a "
            "cluster another folder under this path?"
        )
    return dict(state.record)


def _refuse_given_up(place: Path, jobs: Sequence[PartJob], total: int) -> None:
    if not jobs:
        return
    names, first = ", ".join(job.name for job in jobs), jobs[0].look().error
    raise DataError(
        f"{place}: {len(jobs)} of {total} parts have no result: {names} ({first}); give the run "
        f"more memory or fewer processes (evaluation.jobs); evaluation.resume={place.parent} continues it"
    )


# --- processes -------------------------------------------------------------------------------


Spread: TypeAlias = Callable[[PartWork, Any, Sequence["PartJob"]], Iterable[None]]


def _launch_parts(
    spread: Spread, function: PartWork, context: Any, tally: _Tally, jobs: Sequence[PartJob]
) -> None:
    """Compute ``jobs``; raises BrokenProcessPool, or an error of Dask, if one of them was killed."""
    for _ in spread(function, context, jobs):
        tally.count_one()


def _spread_of(cfg: EvaluationConfig, parts: int) -> Spread:
    """How ``parts`` are computed: in this process, in several, or on a cluster."""
    if cfg.cluster is not None:
        return partial(_on_cluster, cfg.cluster)
    processes = process_count(cfg, parts)
    return _in_turn if processes == 1 else partial(_spread, processes)


def _on_cluster(address: str, function: PartWork, context: Any, jobs: Sequence[PartJob]) -> Iterator[None]:
    for _ in cluster.on_cluster(address, _keep_result, (function, context), jobs):
        yield


def _keep_result(job: PartJob, shared: tuple[PartWork, Any]) -> None:
    job.keep_result(*shared)


def _in_turn(function: PartWork, context: Any, jobs: Sequence[PartJob]) -> Iterator[None]:
    for job in jobs:
        job.keep_result(function, context)
        yield


def _spread(processes: int, function: PartWork, context: Any, jobs: Sequence[PartJob]) -> Iterator[None]:
    """Compute ``jobs`` in several processes; each gets the context once, when it starts."""
    from joblib import Parallel, delayed

    pool = Parallel(
        n_jobs=processes,
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch="2*n_jobs",
        initializer=_share_context,
        initargs=(_Shared(context),),
    )
    yield from pool(delayed(_keep_result_here)(job, function) for job in jobs)


@dataclass(frozen=True, slots=True, eq=False)  # joblib compares these, and arrays have no truth value
class _Shared:
    """The context of all parts of a study."""

    context: Any


_PROCESS: dict[str, _Shared] = {}  # in a process of a pool, its context


def _share_context(shared: _Shared) -> None:
    _PROCESS["shared"] = shared


def _keep_result_here(job: PartJob, function: PartWork) -> None:
    job.keep_result(function, _PROCESS["shared"].context)
