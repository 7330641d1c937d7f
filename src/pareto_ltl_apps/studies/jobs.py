"""Many jobs, each done once, even if a job, a launcher or the machine is killed.

A job has a name, a key (the fingerprint of all that its result depends on) and files on disk, from which
alone its state is known. Two kinds exist: a run of a sweep (:class:`RunJob`: a results directory) and a part
of a study (``parts``: a small JSON file). :class:`JobQueue` launches the jobs without an answer, in batches.
A launch that breaks, because the process of a job was killed, is handled as follows:

1. jobs that had not begun are launched again, together;
2. jobs that had begun and not ended are launched again, each alone;
3. if no job had begun, one half is launched, and then the other;
4. a job that is killed while it runs alone is launched once more, alone; after the second kill it has failed.

Kills in a launch with other jobs do not count: only launches of a job alone do.
"""

from __future__ import annotations

import logging
import shutil
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from careful_io.error_lines import one_line
from careful_io.files import write_json
from careful_io.fingerprints import unchanged
from careful_io.locks import has_note, hold_lock, is_held, process_note
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import ANSWERS, RUN_LOCK, RUN_LOG
from pareto_ltl.support.schemas import read_document

JOB_LOG = logging.getLogger("pareto_ltl.studies.jobs")

KILLED = "ended without a result: killed, out of memory, or disk full"
TRIES_ALONE = 2  # after so many kills in launches alone, a job is given up
SURVIVORS = (RUN_LOCK, RUN_LOG, ".hydra")  # files that are not deleted when a run is made again
KEY_DIGITS = 16  # digits of the fingerprint that name the directory of a run

Metrics = Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class JobState:
    """The state of a job, read from disk.

    Attributes
    ----------
    status : str
        ``ok`` and ``infeasible`` are answers; ``failed``, ``running`` and ``pending`` are not.
    error : str or None
        Why there is no plan or no answer.
    metrics : mapping of str to float or None
        Numbers of a run that has an answer.
    record : mapping
        What the job wrote: ``run.json`` of a run, the result of a part.
    """

    status: str
    error: str | None = None
    metrics: Metrics = field(default_factory=dict)
    record: Mapping[str, Any] = field(default_factory=dict)

    @property
    def answered(self) -> bool:
        """Whether the job has an answer."""
        return self.status in ANSWERS

    @property
    def cut_off(self) -> bool:
        """Whether a job that began has not ended by itself: it was killed or stopped, or will be.

        A pool raises its error before it kills its other processes, so one of them may still begin another
        job.
        """
        stopped = self.record.get("status") == "stopped"
        return stopped or self.error == KILLED or self.status in ("running", "pending")


class StoredJob(ABC):
    """Work to be done once; its state is on disk.

    Attributes
    ----------
    name : str
        In messages.
    key : str
        Fingerprint of all that the result depends on; no two jobs of a queue share it.
    lock : Path
        The lock file of the working process; if it remains after its end, the process was killed.
    path : Path
        The file that the job writes when it begins or ends.
    """

    def __init__(self, name: str, key: str, lock: Path, path: Path) -> None:
        self.name, self.key, self.lock, self.path = name, key, lock, path

    @abstractmethod
    def look(self) -> JobState:
        """The state on disk; never raises, so that other jobs can continue."""

    def settled(self) -> bool:
        """Whether there is an answer, made from the inputs of the key."""
        return self.look().answered

    @abstractmethod
    def clear(self) -> None:
        """Remove what an earlier attempt left behind."""

    @abstractmethod
    def note_failure(self, error: str) -> None:
        """Write that the job was given up; raises OSError if that cannot be written."""

    def do_once(self, work: Callable[[], object], *, resume: bool = True) -> bool:
        """Do ``work`` unless it is done; return whether it was done now.

        A second process waits for the first and then takes its answer. With ``resume=False`` an existing
        answer is made again.
        """
        self.lock.parent.mkdir(parents=True, exist_ok=True)
        busy = is_held(self.lock)
        with hold_lock(self.lock, note=process_note()) as killed_holder:
            if not killed_holder and (resume or busy) and self.settled():
                return False
            self.clear()
            work()
        return True

    def abandoned(self) -> bool:
        """Whether the last working process was killed: its note exists, and no process holds the lock."""
        # A holder that ends meanwhile removes its note before the lock: it is there for the second look only
        # if the holder was killed.
        return has_note(self.lock) and not is_held(self.lock) and has_note(self.lock)

    def stamps(self) -> tuple[tuple[int, int] | None, ...]:
        """Date and inode of lock and file: if they differ after a launch, the job began in it."""
        return _file_stamp(self.lock), _file_stamp(self.path)


def _file_stamp(path: Path) -> tuple[int, int] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_ino


class RunJob(StoredJob):
    """The run in ``directory``, whose name is the beginning of the fingerprint of its settings."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory.name, directory.name, directory / RUN_LOCK, directory / "run.json")
        self.directory = directory

    def look(self) -> JobState:
        """The state of the run, from its files."""
        if not self.path.is_file():
            return self._unfinished({})
        try:
            record = read_document(self.path, "run")
        except DataError:
            return JobState("failed", "run.json cannot be read")
        status, error = str(record.get("status")), record.get("error")
        if status == "running" or self.abandoned():
            return self._unfinished(record)
        if status not in ANSWERS:
            return JobState("failed", str(error), record=record)
        if not record.get("measured", status == "ok"):
            return JobState(status, error, record=record)
        try:
            metrics = read_document(self.directory / "metrics.json", "metrics")
            return JobState(status, error, metrics, record)
        except DataError:
            if is_held(self.lock):  # run.json comes just before metrics.json
                return JobState("running", record=record)
            return JobState("failed", "metrics.json is missing or damaged", record=record)

    def _unfinished(self, record: dict[str, Any]) -> JobState:
        """State of a run that has not written how it ended."""
        if is_held(self.lock):
            return JobState("running", record=record)
        if not record and not self.abandoned():
            return JobState("pending")
        return JobState("failed", KILLED, record=record)

    def settled(self) -> bool:
        """Whether the answer was made by this code from these settings and from unchanged files."""
        state = self.look()
        return (
            state.answered
            and str(state.record.get("config_hash", "")).startswith(self.key)
            and unchanged(state.record.get("inputs") or {})
        )

    def clear(self) -> None:
        """Remove what an earlier attempt left behind; its log stays."""
        for path in self.directory.iterdir():
            if path.name in SURVIVORS:
                continue
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()

    def note_failure(self, error: str) -> None:
        """Write ``error`` into the record of the run."""
        self.directory.mkdir(exist_ok=True)
        write_json(self.directory / "run.json", {**self.look().record, "status": "failed", "error": error})


# --- the queue -------------------------------------------------------------------------------


AnyJob = TypeVar("AnyJob", bound=StoredJob)


@dataclass(slots=True)
class JobQueue(Generic[AnyJob]):
    """Launches jobs until each has an answer, failed or is given up.

    Attributes
    ----------
    launch : callable
        Does a batch of jobs and returns when all are done; raises one of ``breaks`` if the process of a job
        was killed.
    tell : callable
        Called with a line for the user when a launch breaks.
    breaks : tuple of exception types
        Errors that mean a broken launch; all others are passed on.
    given_up : dict
        The reason for each job that was given up, by its key.
    """

    launch: Callable[[Sequence[AnyJob]], None]
    tell: Callable[[str], None]
    breaks: tuple[type[Exception], ...] = (Exception,)
    given_up: dict[str, str] = field(default_factory=dict)
    _killed_alone: Counter[str] = field(default_factory=Counter, init=False)

    def run(self, jobs: Sequence[AnyJob]) -> None:
        """Launch ``jobs``; return when each was tried."""
        batches = [list(jobs)]
        while batches:
            if batch := batches.pop():
                batches += reversed(self._launch_batch(batch))

    def _launch_batch(self, batch: list[AnyJob]) -> list[list[AnyJob]]:
        """Launch ``batch``; return the batches in which its remaining jobs must be launched again."""
        before = {job.key: job.stamps() for job in batch}
        try:
            self.launch(batch)
        except self.breaks as error:
            reason = one_line(error)
            JOB_LOG.info("a launch of %d jobs broke: %s", len(batch), reason)
        else:
            return []
        _wait_for_survivors(batch)
        began = {job.key for job in batch if job.stamps() != before[job.key]}
        fresh = [job for job in batch if job.key not in began]
        killed = [job for job in batch if job.key in began and job.look().cut_off]
        if len(batch) == 1:
            return [batch] if self._deserves_another(batch[0], bool(killed), reason) else []
        if killed:
            self.tell(f"{len(killed)} of the running jobs were killed; continuing with the others")
            return [fresh, *([job] for job in killed)]
        if fresh:
            self.tell(f"a launch broke ({reason}); continuing with {len(fresh)} jobs")
        middle = (len(fresh) + 1) // 2
        return [fresh[:middle], fresh[middle:]]

    def _deserves_another(self, job: AnyJob, killed: bool, reason: str) -> bool:
        """Whether a job that was alone when its launch broke is launched again; else it is given up."""
        if killed:
            self._killed_alone[job.key] += 1
            if self._killed_alone[job.key] < TRIES_ALONE:
                self.tell(f"{job.name} was killed; it is run once more")
                return True
        self._give_up(job, f"killed ({reason})" if killed else reason, killed)
        return False

    def _give_up(self, job: AnyJob, error: str, killed: bool) -> None:
        """Note, on disk if possible, that this job was given up; a failure that it reported is retained."""
        state = job.look()
        if state.answered or (state.status == "failed" and not killed):
            return
        self.given_up[job.key] = error
        try:
            job.note_failure(error)
            job.lock.unlink(missing_ok=True)  # else the job would still count as killed
        except OSError as obstacle:
            JOB_LOG.info("%s: cannot be written (%s)", job.name, obstacle)


def _wait_for_survivors(jobs: Sequence[StoredJob]) -> None:
    """Wait for jobs that continue although their launch broke, as jobs on a cluster can."""
    while any(is_held(job.lock) for job in jobs):
        time.sleep(0.1)
