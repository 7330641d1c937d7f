"""SIGTERM and SIGHUP as an exception, so that a run records how it ended, as after Ctrl-C.

By default these signals end Python at once: ``run.json`` would keep the status "running", and the
processes of a sweep would continue.

An exception of a signal is lost where Python cannot pass it on: in a finaliser, and in a function that a
library in C calls, as LLVM does while it compiles. Such a signal comes again.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil

CHILDREN_TIME = 5.0  # [s] in which child processes can record how they ended, before they are killed
POOL_TIME = 1.5  # [s] between a process of a pool recording its end and ending: when one process is gone,
# the pool kills the others, which may not have recorded theirs
LATER = 0.05  # [s] after which a signal that was lost comes again
SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class StoppedError(KeyboardInterrupt):
    """The process was asked to end by a signal; code that handles Ctrl-C handles this error too.

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
        """The exit code of a process that a signal ended: 128 plus the number of the signal."""
        return 128 + self.number


@contextmanager
def signals_raise() -> Iterator[None]:
    """In the block, the signals :data:`SIGNALS` end the child processes and raise :class:`StoppedError`.

    These and Ctrl-C come again where Python cannot pass on their exception. A signal that is already ignored,
    as SIGHUP under ``nohup``, stays ignored. Outside the main thread, where Python allows no signal handlers,
    nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before, hook = {number: signal.getsignal(number) for number in SIGNALS}, sys.unraisablehook
    heeded = [number for number, handler in before.items() if handler not in (signal.SIG_IGN, None)]
    lost = list[tuple[BaseException, threading.Timer]]()
    sys.unraisablehook = partial(_come_again, lost)
    for number in heeded:
        signal.signal(number, _stop)
    try:
        yield
    except Exception:
        if lost:  # the error may follow from work that was not done where the signal came
            raise lost[0][0] from None
        raise
    finally:
        for _, timer in lost:
            timer.cancel()
        for number in heeded:
            signal.signal(number, before[number])
        sys.unraisablehook = hook


@contextmanager
def ends_process() -> Iterator[None]:
    """In the block, a job of a pool, the signals :data:`SIGNALS` end the process after :data:`POOL_TIME`."""
    with signals_raise():
        try:
            yield
        except StoppedError as stop:
            time.sleep(POOL_TIME)
            os._exit(stop.exit_code)  # a pool would store an exception as the result of the job


def _stop(number: int, _frame: FrameType | None) -> None:
    """End the child processes and raise; further signals are ignored."""
    for heeded in SIGNALS:
        signal.signal(heeded, signal.SIG_IGN)
    _end_children()
    raise StoppedError(number)


def _come_again(lost: list[tuple[BaseException, threading.Timer]], now: sys.UnraisableHookArgs) -> None:
    """Send the signal whose exception is lost ``now`` once more; show other lost exceptions as usual."""
    here = threading.current_thread() is threading.main_thread()
    if not here or not isinstance(now.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(now)
        return
    number = signal.SIGINT
    if isinstance(now.exc_value, StoppedError):
        stop = StoppedError(now.exc_value.number)
        number = signal.Signals(stop.number)
        signal.signal(number, partial(_raise, stop))  # it is ignored since it came
    timer = threading.Timer(LATER, _send, (number,))
    timer.daemon = True
    lost.append((now.exc_value, timer))
    timer.start()


def _send(number: signal.Signals) -> None:
    """Send a signal to the main thread of this process; Windows can only do as if."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        _thread.interrupt_main(number)


def _raise(error: BaseException, _number: int, _frame: FrameType | None) -> None:
    raise error


def _end_children() -> None:
    """Send SIGTERM to the child processes, wait, and kill those left; their owners read the exit codes."""
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
    """Whether a process has ended, or will end by itself, as joblib's resource tracker does."""
    import psutil

    try:
        words = process.cmdline()
        return process.status() == psutil.STATUS_ZOMBIE or any("resource_tracker" in word for word in words)
    except psutil.Error:
        return True
