"""A second process that compiles kernels while a run compiles growth."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from tempfile import TemporaryDirectory

from careful_io.locks import TakenError, hold_lock
from careful_io.machine import cores
from pareto_ltl.settings import Settings, preset
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.cache import LOCKS_FOLDER, cache_root
from typed_kernels.watching import compilation_begins, compilation_ends, compilation_watched

GROWTH = "growth.grow"
LONGEST = 300.0  # [s] to wait for the second process
PAUSE = 0.1  # [s]
REST = "the rest, in a second process"
CODE = "import sys; from pareto_ltl_apps.cli.warmup import second_process; second_process(*sys.argv[1:])"


@contextmanager
def compiling_in_two(settings: Settings, budget: Budget) -> Iterator[None]:
    """In the block, a second process compiles all else while this one compiles growth.

    Growth takes about half of the time. The second process plans a small mission of the same kind with a
    given path (``warmup.warm_up``); the machine code that it writes is then on disk. If it fails, or code for
    other types is needed, this process compiles as usual. The block ends after the second process.

    It ends earlier if ``budget`` is used up, or after :data:`LONGEST`; the second process is then ended.
    """
    kind = kind_of(settings)
    if kind is None or not _may_start():
        yield
        return
    started: list[subprocess.Popen[bytes]] = []
    with ExitStack() as held:

        def start(kernel: str) -> None:
            if kernel == GROWTH and not started:
                with suppress(OSError, TakenError):  # another run has a second process
                    locks = cache_root() / LOCKS_FOLDER
                    locks.mkdir(parents=True, exist_ok=True)
                    held.enter_context(hold_lock(locks / "compiling", wait=False))
                    folder = held.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
                    started.append(_process(kind, folder))
                    held.callback(started[0].wait)
                    held.callback(started[0].kill)

        with compilation_watched(start):
            yield
        latest = time.monotonic() + LONGEST
        if started and started[0].poll() is None:
            compilation_begins(REST)
        while started and started[0].poll() is None and time.monotonic() < latest and not budget.over():
            time.sleep(PAUSE)
        compilation_ends(REST)


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


def _process(kind: str, folder: str) -> subprocess.Popen[bytes]:
    """The second process; ``folder`` is for its temporary files, as it may be killed."""
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "TMPDIR": folder, "TEMP": folder}
    return subprocess.Popen(
        [sys.executable, "-c", CODE, kind, str(os.getpid())],
        env=os.environ | paths,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
