"""A second Python process beside a run, for work that would hold the run up.

The two speak through pipes in pickles, which no other process can write; no file is read so.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import IO, Any

from pareto_ltl.support.cores import cores


def can_begin_one() -> bool:
    """Whether a second process would have a core, and Python to run, which a packed program has not."""
    return cores() > 1 and bool(sys.executable) and not getattr(sys, "frozen", False)


def begin_process(statement: str) -> subprocess.Popen[bytes]:
    """Python carrying out ``statement``, with pipes to its standard input and from its standard output.

    It finds the same packages as this process, and none in the current folder (-P). It is in a process group
    of its own, so that Ctrl-C reaches the run alone, which then ends it.

    Raises
    ------
    OSError
        Where no process can be started.
    """
    options = [f"-W{option}" for option in sys.warnoptions]
    program = f"import sys; sys.path[:] = sys.argv[1:]; {statement}"
    command = [sys.executable, "-P", *options, "-c", program, *sys.path]
    apart: dict[str, Any] = {"process_group": 0}
    if sys.platform == "win32":
        apart = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart)


def end_process(process: subprocess.Popen[bytes]) -> None:
    """End it, whatever it does."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):  # what is still to be sent has nobody to read it
                pipe.close()
    process.kill()
    process.wait()


def requests() -> SimpleQueue[Any]:
    """In the second process: what comes through its standard input.

    Ctrl-C is left to the run. Where no more can come, the run has ended, and this process ends with it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    found: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, found.put), daemon=True).start()
    return found


def _listen(stream: IO[bytes], take: Callable[[Any], None]) -> None:
    with suppress(EOFError, OSError):
        while True:
            take(receive(stream))
    os._exit(0)


def send(stream: IO[bytes] | None, thing: Any) -> None:
    """Send ``thing`` to the other process; BrokenPipeError where that has ended."""
    assert stream is not None
    pickle.dump(thing, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()


def receive(stream: IO[bytes] | None) -> Any:
    """What the other process sends next; EOFError where that has ended."""
    assert stream is not None
    try:
        return pickle.load(stream)
    except pickle.UnpicklingError as error:  # it ended while it was sending
        raise EOFError from error


def can_be_sent(thing: Any) -> bool:
    """Whether the other process would receive ``thing``."""
    try:
        pickle.loads(pickle.dumps(thing))
    except Exception:
        return False
    return True


__all__ = ["begin_process", "can_be_sent", "can_begin_one", "end_process", "receive", "requests", "send"]
