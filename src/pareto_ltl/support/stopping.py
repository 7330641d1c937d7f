"""A request to end (SIGTERM, SIGHUP) as an exception, so that a run notes how it ended, as after Ctrl-C.

Without this, Python dies of these signals at once: ``run.json`` would say "running" for ever, and the
processes of a sweep would go on.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil

CHILDREN_TIME = 5.0  # [s] that child processes have to note how they ended, before they are killed
POOL_TIME = 1.5  # [s] that a process of a pool stays once it has noted its end: at the first that is gone,
# the pool kills the others, which may not have noted theirs
SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class StoppedError(KeyboardInterrupt):
    """The process was asked to end; whatever heeds Ctrl-C heeds it, too.

    Attributes
    ----------
    number : int
        Number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.number = number

    @property
    def exit_code(self) -> int:
        """What a shell expects of a process that a signal ended."""
        return 128 + self.number


@contextmanager
def signals_raise() -> Iterator[None]:
    """In the block, a request to end raises :class:`StoppedError`, once the child processes have ended.

    A signal that is ignored, as SIGHUP is under ``nohup``, stays ignored. Outside the main thread, where
    Python allows no signal handlers, the block is only run.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in SIGNALS}
    heeded = [number for number, handler in before.items() if handler not in (signal.SIG_IGN, None)]
    for number in heeded:
        signal.signal(number, _stop)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, before[number])


@contextmanager
def ends_process() -> Iterator[None]:
    """Requests to end in a job that a pool carries out: the process ends, and begins no other job."""
    with signals_raise():
        try:
            yield
        except StoppedError as stop:
            time.sleep(POOL_TIME)
            os._exit(stop.exit_code)  # a pool would take an exception for the result of the job


def _stop(number: int, _frame: FrameType | None) -> None:
    """Pass the signal on and raise; a second one does not interrupt the clean-up."""
    for heeded in SIGNALS:
        signal.signal(heeded, signal.SIG_IGN)
    _end_children()
    raise StoppedError(number)


def _end_children() -> None:
    """Ask the child processes to end, wait, and kill what is left; their exit codes stay for their owners."""
    import psutil

    children = [child for child in psutil.Process().children(recursive=True) if not _has_ended(child)]
    for child in children:
        with suppress(psutil.Error):
            child.terminate()
    end = time.monotonic() + CHILDREN_TIME
    while (children := [child for child in children if not _has_ended(child)]) and time.monotonic() < end:
        time.sleep(0.02)
    for child in children:
        with suppress(psutil.Error):
            child.kill()


def _has_ended(process: psutil.Process) -> bool:
    """Whether a process has ended, or ends by itself, as the one of joblib that removes its files."""
    import psutil

    try:
        words = process.cmdline()
        return process.status() == psutil.STATUS_ZOMBIE or any("resource_tracker" in word for word in words)
    except psutil.Error:
        return True


__all__ = ["SIGNALS", "StoppedError", "ends_process", "signals_raise"]
