"""A run of a sweep as a job: a results directory, named by the fingerprint of its settings and the code."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pareto_ltl.run import provenance
from pareto_ltl.run.directory import RUN_LOG
from pareto_ltl.studies.jobs import KILLED, JobState, Metrics, StoredJob
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.locks import is_held
from pareto_ltl.support.run_status import RUN_LOCK
from pareto_ltl.support.schemas import read_document

SURVIVORS = (RUN_LOCK, RUN_LOG, ".hydra")  # files that are not deleted when a run is made again
KEY_DIGITS = 16  # digits of the fingerprint that name a directory


@dataclass(frozen=True, slots=True)
class RunJob(StoredJob):
    """The run in ``directory``, whose name is the beginning of the fingerprint of its settings."""

    directory: Path

    @property
    def name(self) -> str:
        """The name of the directory."""
        return self.directory.name

    @property
    def key(self) -> str:
        """The fingerprint of the settings, which is the name of the directory."""
        return self.directory.name

    @property
    def lock(self) -> Path:
        """The lock of the directory."""
        return self.directory / RUN_LOCK

    @property
    def traces(self) -> tuple[Path, ...]:
        """Files that show that a process has begun: lock and record of the run."""
        return self.lock, self.directory / "run.json"

    def look(self) -> JobState:
        """The state of the run, from its files."""
        path = self.directory / "run.json"
        if not path.is_file():
            return self._unfinished({})
        try:
            record = read_document(path, "run")
        except DataError:
            return JobState("failed", "run.json cannot be read")
        status, error = str(record.get("status")), record.get("error")
        if status == "running" or self.abandoned():
            return self._unfinished(record)
        if status not in provenance.ANSWERS:
            return JobState("failed", str(error), record=record)
        if not record.get("measured", status == "ok"):
            return JobState(status, error, record=record)
        try:
            return JobState(status, error, read_metrics(self.directory / "metrics.json"), record)
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
            and provenance.unchanged(state.record.get("inputs") or {})
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
        provenance.write(self.directory, {**self.look().record, "status": "failed", "error": error})


def read_metrics(path: Path) -> Metrics:
    """The metrics of a finished run; raises DataError if the file is missing or has other content."""
    return read_document(path, "metrics")
