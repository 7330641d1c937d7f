"""The plans of a desk: command lines that one worker process runs, one after another."""

from __future__ import annotations

import asyncio
import json
import secrets
import shlex
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from careful_io.files import write_json
from careful_io.messages import shown_value
from careful_io.reading import read_json, read_text
from pareto_ltl.support.errors import DataError, NotFoundError
from pareto_ltl.support.run_status import RUN_LOG
from pareto_ltl_apps.desk.folder import PLAN_NAME, PLANS, DeskFolder
from pareto_ltl_apps.view.in_words import mission_in_words

WORKER = (sys.executable, "-m", "pareto_ltl_apps.cli.desk_worker")
PATIENCE = 10.0  # [s] in which a cancelled run can record how it ended
MAX_LINE = 2**24  # bytes of one event
MAX_JOBS = 50  # of one worker, whose memory a new one returns
MAX_ENDED = 20  # jobs whose events stay in memory
STATUS = {"ok": "done", "stopped": "cancelled", "infeasible": "failed", "failed": "failed"}
BEACONS = "beacons"  # the command, and the folder that it writes into
WARNED = " WARNING "  # of a line in run.log
LOST = "the server ended while this plan was made; plan it again"
NOT_BEGUN = "the server ended before this plan was begun; plan it again"
QUEUE = "queue.json"  # in the folder of plans: plans that are not begun, so that they outlive the server


@dataclass(slots=True)
class Job:
    """A command line, its state and all its events.

    Attributes
    ----------
    status : str
        ``running`` (also while it waits), ``done``, ``failed`` or ``cancelled``.
    """

    name: str
    argv: tuple[str, ...]
    status: str = "running"
    error: str = ""
    events: list[dict[str, Any]] = field(default_factory=list)
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    cancelled: bool = False

    @property
    def begun(self) -> bool:
        """Whether the worker has begun the job."""
        return any(event["event"] == "begun" for event in self.events)

    def tell(self, event: dict[str, Any]) -> None:
        """Add an event and wake those who follow the job."""
        self.events.append(event)
        self.changed.set()
        self.changed = asyncio.Event()

    def end(self, status: str, error: str = "") -> None:
        """Set and report the last status."""
        self.status, self.error = status, error
        self.tell({"event": "status", "status": status, "error": error})


@dataclass(slots=True)
class Plans:
    """The jobs of this server, and the results of earlier ones in its folder."""

    folder: DeskFolder
    jobs: dict[str, Job] = field(default_factory=dict)
    waiting: asyncio.Queue[Job] = field(default_factory=asyncio.Queue)
    left: dict[str, tuple[str, ...]] = field(default_factory=dict)  # what an earlier server did not begin
    worker: asyncio.subprocess.Process | None = None
    done: int = 0  # jobs of the present worker

    def __post_init__(self) -> None:
        """Read what an earlier server left; a damaged note names no plan."""
        with suppress(DataError, OSError):
            for name, argv in list(read_json(self._queue_file()).items())[-MAX_ENDED:]:
                if PLAN_NAME.fullmatch(name) and isinstance(argv, list):
                    self.left[name] = tuple(map(str, argv))

    # --- asked by the API ---------------------------------------------------------------------------

    def plan(self, command: str, words: Sequence[str]) -> Job:
        """A new job that runs ``command`` with the settings ``words``."""
        name = f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
        return self._added(name, (command, *words, f"hydra.run.dir={PLANS}/{name}"))

    def beacons(self, source: str) -> Job:
        """A job that writes into the plan ``source`` what a beacon would save."""
        self.require_done(source)
        return self._added(f"{source}_{BEACONS}", (BEACONS, f"{PLANS}/{source}"))

    def derive(self, source: str, command: str, options: Sequence[str], suffix: str) -> Job:
        """A job that makes another result from the plan ``source``: ``choose`` or ``replan``."""
        self.require_done(source)
        name = f"{source}_{suffix}"
        self.folder.plan_place(name)
        return self._added(name, (command, f"{PLANS}/{source}", *options, "--out", f"{PLANS}/{name}"))

    def cancel(self, name: str) -> None:
        """Stop a running job; the worker records it in ``run.json``."""
        job = self.jobs.get(name)
        if job is None:
            self.state(name)  # an unknown name is an error
            return
        if job.status != "running" or job.cancelled:
            return
        job.cancelled = True
        if job.begun:
            self._stop_worker()
        else:
            job.end("cancelled")
            self._note_queue()

    def remove(self, name: str) -> Path:
        """Move the directory of an ended plan to ``removed/`` in the folder of the desk, and forget the plan.

        Raises
        ------
        NotFoundError
            If there is no such plan.
        DataError
            If it is running.
        """
        if self.state(name)["status"] == "running":
            raise DataError(f"plan {name} is running; cancel it before you remove it")
        place, to = self.folder.plan_place(name), self.folder.removed_place(name)
        if place.is_dir():
            to.parent.mkdir(exist_ok=True)
            place.rename(to)
        self.jobs.pop(name, None)
        if self.left.pop(name, None) is not None:
            self._note_queue()
        return to

    def state(self, name: str) -> dict[str, Any]:
        """``id``, ``status``, ``directory``, ``error`` and ``command`` of a plan, or NotFoundError."""
        place, job = self.folder.plan_place(name), self.jobs.get(name)
        recorded = (place / "run.json").is_file()
        if job is None and not recorded and name not in self.left:
            raise NotFoundError(f"there is no plan {shown_value(name)}")
        if job is not None:
            status, error, argv = job.status, job.error, job.argv
        elif not recorded:
            status, error, argv = "failed", NOT_BEGUN, self.left[name]
        else:
            record = read_json(place / "run.json")
            status = STATUS.get(str(record.get("status")), "failed")
            lost = record.get("status") == "running"
            error = LOST if lost else str(record.get("error") or "")
            argv = tuple(map(str, record.get("argv", ())))
            argv = argv[1:] if argv[:1] == ("pareto-ltl",) else argv
        command = f"cd {shlex.quote(str(self.folder.root))} && {shlex.join(['pareto-ltl', *argv])}"
        return {
            "id": name, "status": status, "directory": str(place), "error": error, "command": command,
            "warnings": _warnings(place), "made_by": argv[0] if argv else "plan", **_summary(place),
        }  # fmt: skip

    def all_states(self) -> list[dict[str, Any]]:
        """The states of all plans, the newest first."""
        names = {name for name, job in self.jobs.items() if job.argv[0] != BEACONS} | self.left.keys()
        place = self.folder.root / PLANS
        if place.is_dir():
            names |= {found.name for found in place.iterdir() if (found / "run.json").is_file()}
        found = []
        for name in sorted(names, reverse=True):
            with suppress(DataError):
                found.append(self.state(name))
        return found

    def require_done(self, name: str) -> Path:
        """The directory of a finished plan; DataError if it is not finished."""
        state = self.state(name)
        if state["status"] != "done":
            raise DataError(f"plan {name} is {state['status']}; only a finished plan has results")
        return Path(state["directory"])

    def require_front(self, name: str) -> Path:
        """The directory of a plan whose front is made, also if it is still checked or was cancelled since."""
        job = self.jobs.get(name)
        made = job is not None and any(event.get("source") == "front" for event in job.events)
        return self.folder.plan_place(name) if made else self.require_done(name)

    async def follow(self, name: str) -> AsyncIterator[dict[str, Any]]:
        """All events of a plan, and its further ones until it ends."""
        state, job = self.state(name), self.jobs.get(name)
        if job is None:
            yield {"event": "status", "status": state["status"], "error": state["error"]}
            return
        sent = 0
        while True:
            changed = job.changed
            for event in job.events[sent:]:
                yield event
            sent = len(job.events)
            if job.status != "running":
                return
            await changed.wait()

    # --- the worker -----------------------------------------------------------------------------------

    async def run_jobs(self) -> None:
        """Run the jobs one after another, until the task is cancelled."""
        try:
            await self._started()
            while True:
                job = await self.waiting.get()
                if job.status == "running":
                    await self._run(job)
                    await self._started()
        finally:
            self._stop_worker()

    def _added(self, name: str, argv: tuple[str, ...]) -> Job:
        """A new job; the present one of that name while it runs."""
        if (present := self.jobs.get(name)) is not None and present.status == "running":
            return present
        ended = [known for known, job in self.jobs.items() if job.status != "running"]
        for known in ended[: -MAX_ENDED or None]:  # their directories have what is known of them
            del self.jobs[known]
        job = self.jobs[name] = Job(name, argv)
        self.left.pop(name, None)
        self.waiting.put_nowait(job)
        self._note_queue()
        return job

    def _queue_file(self) -> Path:
        return self.folder.root / PLANS / QUEUE

    def _note_queue(self) -> None:
        """Write the command lines of plans that are not begun."""
        waiting = {
            name: job.argv for name, job in self.jobs.items() if job.status == "running" and not job.begun
        }
        with suppress(OSError):  # a disk that is full is reported by the plan itself
            self._queue_file().parent.mkdir(exist_ok=True)
            write_json(self._queue_file(), {name: list(argv) for name, argv in (self.left | waiting).items()})

    async def _started(self) -> asyncio.subprocess.Process:
        """The worker; a new one if there is none, or if it has run many jobs."""
        if self.worker is not None and (self.worker.returncode is not None or self.done >= MAX_JOBS):
            self._stop_worker()
            self.worker = None
        if self.worker is None:
            pipe = asyncio.subprocess.PIPE
            self.worker = await asyncio.create_subprocess_exec(
                *WORKER, cwd=self.folder.root, stdin=pipe, stdout=pipe, stderr=None, limit=MAX_LINE
            )
            self.done = 0
        return self.worker

    async def _run(self, job: Job) -> None:
        worker = await self._started()
        assert worker.stdin is not None
        assert worker.stdout is not None
        self.done += 1
        with suppress(ConnectionError):
            worker.stdin.write(json.dumps({"id": job.name, "argv": job.argv}).encode() + b"\n")
            await worker.stdin.drain()
        while line := await worker.stdout.readline():
            event = json.loads(line)
            if event.pop("id") != job.name:
                continue  # it was started
            if event["event"] == "ended":
                status = "done" if event["code"] == 0 else "cancelled" if job.cancelled else "failed"
                job.end(status, "" if status == "cancelled" else str(event["error"]))
                break
            job.tell(event)
            if event["event"] == "begun":
                self._note_queue()
        if job.status == "running":
            job.end(*(("cancelled",) if job.cancelled else ("failed", "the process of the plan ended early")))
        if job.cancelled:
            self.done = MAX_JOBS  # a new worker, warm for the next plan

    def _stop_worker(self) -> None:
        worker = self.worker
        if worker is None or worker.returncode is not None:
            return
        worker.terminate()
        asyncio.get_running_loop().call_later(PATIENCE, _kill, worker)


def _summary(place: Path) -> dict[str, Any]:
    """Mission in words (or its formula), failure rate and length [m] of a plan, for a list."""
    file = place / "plan.json"
    if not file.is_file():
        return {"mission": "", "failure": None, "length_m": None}
    plan = read_json(file)
    formula, promise = str(plan.get("formula", "")), plan.get("promise")
    if promise is not None and plan.get("branches"):  # as it is flown with its fixes
        promise = plan["branches"]["rate"]
    return {
        "mission": mission_in_words(formula) or formula,
        "failure": None if promise is None else promise["failure"],
        "length_m": plan["objectives"]["length"],
    }


def _warnings(place: Path) -> list[str]:
    """The warnings in ``run.log``."""
    try:
        lines = read_text(place / RUN_LOG).splitlines()
    except (DataError, OSError):
        return []
    texts = (line.partition(WARNED)[2].partition(": ")[2] for line in lines if WARNED in line)
    return list(dict.fromkeys(texts))


def _kill(worker: asyncio.subprocess.Process) -> None:
    if worker.returncode is None:
        with suppress(ProcessLookupError):
            worker.kill()
