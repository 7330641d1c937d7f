"""Many jobs, each done once, even if a job, a launcher or the machine is killed.

A job has a name, a key (the fingerprint of all that its result depends on) and a place on disk, which alone
says how far it is. Two kinds exist: a run of a sweep (``sweeps.runs``: a results directory) and a part of a
study (``parts``: a small JSON file). :class:`JobQueue` launches what has no answer, in batches. A launch that
breaks, because a job took its process down, is sorted out:

1. jobs that had not begun are launched again, together;
2. jobs that were at work are launched again, each alone;
3. where nothing had begun, one half is launched, and then the other;
4. a job that is alone and is killed gets one more launch, alone; a job killed twice alone is given up.

To be at work beside a job that is killed costs a job nothing: only launches of its own count.
"""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from pareto_ltl.run.provenance import ANSWERS, one_line
from pareto_ltl.support.locks import has_note, hold_passing_lock, is_held, process_note

JOB_LOG = logging.getLogger(__name__)

KILLED = "ended without a word: killed, out of memory, or its disk was full"
TRIES_ALONE = 2  # launches of its own in which a job may be killed

Metrics = Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class JobState:
    """What the disk says of a job.

    Attributes
    ----------
    status : str
        ``ok`` and ``infeasible`` are answers; ``failed``, ``running`` and ``pending`` are not.
    error : str or None
        Why there is no plan or no answer.
    metrics : mapping of str to float or None
        Numbers of a run that has an answer.
    record : mapping
        What the job wrote of itself: ``run.json`` of a run, the result of a part.
    """

    status: str
    error: str | None = None
    metrics: Metrics = field(default_factory=dict)
    record: Mapping[str, Any] = field(default_factory=dict)

    @property
    def answered(self) -> bool:
        """Whether there is nothing left to do."""
        return self.status in ANSWERS

    @property
    def cut_off(self) -> bool:
        """Whether a job that began has not ended by itself: it was killed or stopped, or is about to be.

        A pool raises before it kills its other processes, so that one of them may begin another job.
        """
        stopped = self.record.get("status") == "stopped"
        return stopped or self.error == KILLED or self.status in ("running", "pending")


class StoredJob(ABC):
    """Something to be done once; what is known of it is on disk."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What messages call it."""

    @property
    @abstractmethod
    def key(self) -> str:
        """Fingerprint of all that the result depends on; no two jobs of a queue share it."""

    @property
    @abstractmethod
    def lock(self) -> Path:
        """The file that the process at work holds; after its end the file is there only if it was killed."""

    @property
    @abstractmethod
    def traces(self) -> tuple[Path, ...]:
        """Files that a job writes when it begins or ends."""

    @abstractmethod
    def look(self) -> JobState:
        """What the disk says; never an exception, for the other jobs go on."""

    @abstractmethod
    def settled(self) -> bool:
        """Whether the answer is there and was made from what the key stands for."""

    @abstractmethod
    def clear(self) -> None:
        """Remove what an earlier attempt left behind."""

    @abstractmethod
    def note_failure(self, error: str) -> None:
        """Write down that the job was given up; OSError where that cannot be written."""

    def do_once(self, work: Callable[[], object], *, resume: bool = True) -> bool:
        """Do ``work`` unless it is done; return whether it was done now.

        A second process waits for the first and then takes its answer. With ``resume=False`` an answer that
        was there before is made again.
        """
        self.lock.parent.mkdir(parents=True, exist_ok=True)
        busy = is_held(self.lock)
        with hold_passing_lock(self.lock, note=process_note()) as killed_holder:
            if not killed_holder and (resume or busy) and self.settled():
                return False
            self.clear()
            work()
        return True

    def abandoned(self) -> bool:
        """Whether the last process at work was killed: its note is there, and no process holds the lock."""
        return has_note(self.lock) and not is_held(self.lock)

    def stamps(self) -> tuple[tuple[int, int] | None, ...]:
        """Date and inode of each trace: other ones after a launch say that the job began in it."""
        return tuple(_file_stamp(path) for path in self.traces)


def _file_stamp(path: Path) -> tuple[int, int] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_ino


AnyJob = TypeVar("AnyJob", bound=StoredJob)


@dataclass(slots=True)
class JobQueue(Generic[AnyJob]):
    """Launches jobs until each has an answer, failed or is given up.

    Attributes
    ----------
    launch : callable
        Does a batch of jobs and returns when all are done; raises one of ``breaks`` when a job took it down.
    tell : callable
        Gets a line for the user when a launch broke.
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
        """Launch ``batch``; the batches in which what is left of it must be launched again."""
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
            self.tell(f"{len(killed)} of the jobs at work were killed; going on with the others")
            return [fresh, *([job] for job in killed)]
        if fresh:
            self.tell(f"a launch broke ({reason}); going on with {len(fresh)} jobs")
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
        """Note, on disk if possible, that this job cannot be done; its own account of a failure stays."""
        state = job.look()
        if state.answered or (state.status == "failed" and not killed):
            return
        self.given_up[job.key] = error
        try:
            job.note_failure(error)
            job.lock.unlink(missing_ok=True)  # or the kill would outlive the note
        except OSError as obstacle:
            JOB_LOG.info("%s: cannot be written (%s)", job.name, obstacle)


def _wait_for_survivors(jobs: Sequence[StoredJob]) -> None:
    """Wait for jobs that go on although their launch broke, as those on a cluster do."""
    while any(is_held(job.lock) for job in jobs):
        time.sleep(0.1)
