"""A second Python process for work that would delay a run.

The two processes exchange pickles through pipes, which no other process can write to. No file is unpickled.
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
    """Whether there is a core for a second process and a Python to run it; a packed program has none."""
    return cores() > 1 and bool(sys.executable) and not getattr(sys, "frozen", False)


def begin_process(statement: str) -> subprocess.Popen[bytes]:
    """Start Python to execute ``statement``, with pipes to its standard input and from its standard output.

    It has the import path of this process, without the current folder (-P), and a process group of its own,
    so that Ctrl-C reaches only the run, which then ends it.

    Raises
    ------
    OSError
        If no process can be started.
    """
    options = [f"-W{option}" for option in sys.warnoptions]
    program = f"import sys; sys.path[:] = sys.argv[1:]; {statement}"
    command = [sys.executable, "-P", *options, "-c", program, *sys.path]
    apart: dict[str, Any] = {"process_group": 0}
    if sys.platform == "win32":
        apart = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart)


def end_process(process: subprocess.Popen[bytes]) -> None:
    """Close the pipes of ``process``, kill it and wait for its end."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):  # unsent data is dropped
                pipe.close()
    process.kill()
    process.wait()


def requests() -> SimpleQueue[Any]:
    """In the second process: a queue of the objects that arrive at its standard input.

    Ctrl-C is ignored here. When the input is closed, the run has ended, and this process ends too.
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
    """Send ``thing`` to the other process; BrokenPipeError if that process has ended."""
    assert stream is not None
    pickle.dump(thing, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()


def receive(stream: IO[bytes] | None) -> Any:
    """Wait for the next object from the other process; EOFError if that process has ended."""
    assert stream is not None
    try:
        return pickle.load(stream)
    except pickle.UnpicklingError as error:  # it ended while it was sending
        raise EOFError from error


def can_be_sent(thing: Any) -> bool:
    """Whether ``thing`` can be pickled and unpickled."""
    try:
        pickle.loads(pickle.dumps(thing))
    except Exception:
        return False
    return True
