"""Resumable parts of a study: each result is a small file, written completely or not at all.

The file of a part has a key, the fingerprint of all that its result depends on: settings, arguments, wind
files and the code. A later run with the same keys reads the files. Unfinished files of a killed run never
have the name of a result.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from careful_io.files import plain_data, remove_dead_drafts, write_json
from careful_io.fingerprints import code_fingerprint, data_fingerprint, file_fingerprint
from careful_io.links import refuse_links_out
from careful_io.machine import cores
from careful_io.reading import read_json
from pareto_ltl import Run, Settings
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.studies import cluster
from pareto_ltl_apps.studies.jobs import KILLED, JobQueue, JobState, StoredJob
from pareto_ltl_apps.studies.kinds import study_sections
from pareto_ltl_apps.studies.settings import EvaluationConfig

PARTS_FOLDER = "parts"
# Sections that parts do not depend on, or that a study adds to its keys itself.
OTHER_SECTIONS = {"name", "report", "pipelines", "ingest", "evaluation", *study_sections()}
# Code that parts do not depend on.
OTHER_CODE = ("pareto_ltl_verify", "pareto_ltl_apps.view", "pareto_ltl_apps.cli", "pareto_ltl.__main__")

Progress = Callable[[int, int], None] | None  # called with the number of parts that are done, and of all
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
    # its seeds are not copied for each part: 3,334 of them took 110 s for 10,002 parts
    one = settings.with_sections(EvaluationConfig())
    relevant = {name: value for name, value in asdict(one).items() if name not in OTHER_SECTIONS}
    relevant["planner"].pop("threads")
    inputs = [file_fingerprint(file) for file in sorted(Run(settings).input_files())]
    code = code_fingerprint(without=OTHER_CODE)
    return data_fingerprint([relevant, plain_data(list(more)), inputs, code])


# --- the folder ------------------------------------------------------------------------------


def parts_folder(cfg: EvaluationConfig, directory: Path) -> Path:
    """The folder of parts: in the results directory, or in the directory of the run to resume.

    Raises
    ------
    DataError
        If ``evaluation.resume`` names a directory without parts, or with a link that leads out of it.
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
    refuse_links_out(place.parent)
    return place


class PartJob(StoredJob):
    """A part with its place on disk."""

    def __init__(self, folder: Path, part: Part) -> None:
        super().__init__(part.name, part.key, folder / f".{part.file}.lock", folder / part.file)
        self.arguments = part.arguments

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

    def result(self) -> dict[str, Any]:
        """The result; DataError if there is none."""
        state = self.look()
        if not state.answered:
            raise DataError(
                f"{self.path}: could not be read back; is another run using this folder, or have the workers "
                "of a cluster another folder under this path?"
            )
        return dict(state.record)

    def clear(self) -> None:
        """Remove the result."""
        self.path.unlink(missing_ok=True)

    def note_failure(self, error: str) -> None:
        """Write ``error`` in place of a result."""
        write_json(self.path, {"key": self.key, "part": self.name, "error": error})

    def keep_result(self, work: PartWork) -> None:
        """Compute the part and write its result, unless another process does."""

        def write() -> None:
            result = work(*self.arguments)
            write_json(self.path, {"key": self.key, "part": self.name, "result": result})

        self.do_once(write)


# --- the work --------------------------------------------------------------------------------


def work_parts(
    cfg: EvaluationConfig,
    directory: Path,
    function: PartWork,
    context: Any,
    parts: Sequence[Part],
    progress: Progress = None,
) -> list[dict[str, Any]]:
    """Results of ``function(context, *part.arguments)`` for all parts, in their order.

    Results are read back from disk even when they are new, so that a resumed run gives the same bytes as one
    that was never stopped. Parts with the same key are computed once.

    Raises
    ------
    DataError
        If parts were given up because they were killed each time; the results of all others are stored.
    """
    from joblib import cpu_count  # heeds affinity and the limits of containers

    place = parts_folder(cfg, directory)
    remove_dead_drafts(place)
    jobs = {part.key: PartJob(place, part) for part in parts}
    todo = [job for job in jobs.values() if not _is_known(job)]
    done, total, work = len(jobs) - len(todo), len(jobs), partial(function, context)
    processes = max(1, min(cfg.jobs or int(cpu_count()), len(todo)))

    def launch(batch: Sequence[PartJob]) -> None:
        nonlocal done
        for _ in _launched(cfg.cluster, processes, work, batch):
            done += 1
            if progress is not None:
                progress(done, total)

    queue = JobQueue(launch, _tell, (BrokenProcessPool,) if cfg.cluster is None else cluster.broken())
    try:
        queue.run(todo)
    except KeyboardInterrupt:
        _tell(f"{done} of {total} parts are stored; evaluation.resume={place.parent} continues with them")
        raise
    if queue.given_up:
        failed = [jobs[key] for key in queue.given_up]
        names = ", ".join(job.name for job in failed)
        raise DataError(
            f"{place}: {len(failed)} of {total} parts have no result: {names} ({failed[0].look().error}); "
            "give the run more memory or fewer processes (evaluation.jobs); "
            f"evaluation.resume={place.parent} continues it"
        )
    results = {key: job.result() for key, job in jobs.items()}
    return [results[part.key] for part in parts]


def _tell(line: str) -> None:
    print(f"pareto-ltl: {line}", file=sys.stderr)


def half_the_cores(cfg: EvaluationConfig) -> EvaluationConfig:
    """``cfg`` for parts that plan with two threads each: another process takes as long to begin as a part."""
    return replace(cfg, jobs=cfg.jobs or max(1, cores() // 2))


def _is_known(job: PartJob) -> bool:
    """Whether the result is on disk; prints one line for a file without a valid result."""
    state = job.look()
    if state.error is not None and job.path.exists():
        _tell(f"{job.path} {state.error}; it is made again")
    return state.answered


# --- processes -------------------------------------------------------------------------------


_PROCESS: dict[str, PartWork] = {}  # in a process of a pool, the work of its parts


def _launched(
    address: str | None, processes: int, work: PartWork, jobs: Sequence[PartJob]
) -> Iterable[object]:
    """Compute ``jobs`` on a cluster, in this process or in several; an item for each that has ended.

    A process gets ``work`` once, when it starts. Raises BrokenProcessPool, or an error of Dask, if a process
    was killed.
    """
    if address is not None:
        return cluster.on_cluster(address, PartJob.keep_result, work, jobs)
    if processes == 1:
        return map(partial(PartJob.keep_result, work=work), jobs)
    from joblib import Parallel, delayed

    pool: Callable[..., Iterable[object]] = Parallel(
        n_jobs=processes, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs",
        initializer=_share_work, initargs=(work,),
    )  # fmt: skip
    return pool(delayed(_keep_result_here)(job) for job in jobs)


def _share_work(work: PartWork) -> None:
    _PROCESS["work"] = work


def _keep_result_here(job: PartJob) -> None:
    job.keep_result(_PROCESS["work"])
