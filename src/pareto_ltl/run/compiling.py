"""Two processes that compile at the same time: this one the growth of trees, a second one all else.

Growth takes about half of the time. When a run is about to compile it, the second process plans a small
mission of the same kind with a given path (:func:`pareto_ltl.run.warmup.warm_up`); the machine code that it
writes is then on disk. If it fails, or code for other types is needed, this process compiles as usual.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from tempfile import TemporaryDirectory
from threading import Thread

from pareto_ltl.settings import Settings, preset
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.cache import LOCKS_FOLDER, cache_root
from pareto_ltl.support.cores import cores
from pareto_ltl.support.files import process_lives
from pareto_ltl.support.locks import TakenError, hold_lock

GROWTH = "growth.grow"
LONGEST = 300.0  # [s] to wait for the second process
PAUSE = 0.1  # [s]
CODE = "import sys; from pareto_ltl.run.compiling import second_process; second_process(*sys.argv[1:])"


@contextmanager
def compiling_in_two(settings: Settings, budget: Budget) -> Iterator[None]:
    """In the block, a second process compiles if this one compiles growth; the block ends after it.

    It ends earlier if ``budget`` is used up, or after :data:`LONGEST`; the second process is then ended.
    """
    from pareto_ltl.kernels.code_cache import compilation_watched

    kind = kind_of(settings)
    started: list[subprocess.Popen[bytes]] = []
    if kind is None or not _may_start():
        yield
        return
    with ExitStack() as held:

        def start(kernel: str) -> None:
            if kernel == GROWTH and not started:
                with suppress(OSError, TakenError):
                    held.enter_context(_only_one())
                    folder = held.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
                    started.append(_process(kind, folder))

        try:
            with compilation_watched(start):
                yield
            latest = time.monotonic() + LONGEST
            for process in started:
                while process.poll() is None and time.monotonic() < latest and not budget.over():
                    time.sleep(PAUSE)
        finally:
            for process in started:
                process.kill()
                process.wait()


def kind_of(settings: Settings) -> str | None:
    """The kind of warm-up with the kernels of ``settings``; None if there is none."""
    if settings.fidelity != preset(settings.fidelity.name) or settings.robot.feedback_time is not None:
        return None
    if settings.scene.landmarks and settings.fidelity.name == "full":  # paper takes no fixes
        return "full-fixes"
    return settings.fidelity.name


def _may_start() -> bool:
    """Whether there is a core for a second process, and this one is not a worker of a sweep or study."""
    return cores() > 1 and multiprocessing.parent_process() is None and not getattr(sys, "frozen", False)


@contextmanager
def _only_one() -> Iterator[None]:
    """Hold the lock of second processes; TakenError if another run has one."""
    folder = cache_root() / LOCKS_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    with hold_lock(folder / "compiling", wait=False):
        yield


def _process(kind: str, folder: str) -> subprocess.Popen[bytes]:
    """The second process; ``folder`` is for its temporary files, as it may be killed."""
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "TMPDIR": folder, "TEMP": folder}
    return subprocess.Popen(
        [sys.executable, "-c", CODE, kind, str(os.getpid())],
        env=os.environ | paths,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def second_process(kind: str, first: str) -> None:
    """Compile the kernels of ``kind`` except growth; end when the process ``first`` has ended."""
    from pareto_ltl.run.warmup import warm_up

    def watch() -> None:
        while process_lives(int(first)):
            time.sleep(1.0)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
    warm_up(kind, grown=False)
