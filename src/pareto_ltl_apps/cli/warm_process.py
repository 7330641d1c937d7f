"""The warm process (``pareto-ltl warm``) has loaded what plans need, and forks a child for each command line.

The child takes over folder, environment, standard streams and ignored signals of the client
(:mod:`.warm_client`), runs the command line as a new process would, and ends. The warm process itself runs
none, so that no run can change the next one; it has one thread, since a fork copies no other. It ends after
some idle minutes, and when its source, its packages or their choices have changed.
"""

from __future__ import annotations

import atexit
import os
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from argparse import Namespace
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from careful_io.folders import make_private
from careful_io.locks import NOTE_START, TakenError, hold_lock, is_held, process_note
from pareto_ltl import Settings
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.output import Answer
from pareto_ltl_apps.cli.warm_client import (
    FORWARDED,
    LONGEST_PATH,
    PATIENCE,
    SOCKET_NAME,
    STREAMS,
    UnsafeError,
    check_folder,
    check_peer,
    connected,
    identity,
    read_message,
    send_message,
    warm_folder,
)
from pareto_ltl_apps.desk.worker import WARMED, load_kernels

LOCK_NAME, LOG_NAME = "warm.lock", "warm.log"
GLANCE = 30.0  # [s] between two looks at whether source and socket are still the same
LAST_WORDS = 20.0  # [s] in which a run whose client has gone can record how it ended
BACKLOG = 16  # connections that wait
READY = "ready"
LOADED = ("pareto_ltl_apps.cli.hydra_app", "pareto_ltl_apps.view.page.content", "rich.console", "rich.table")
Run = Callable[[list[str]], int]


# --- the command -----------------------------------------------------------------------------------


def warm(options: Namespace) -> Answer:
    """Start a warm process beside this one, or end the one that is there."""
    folder = _usable_folder()
    place = folder / SOCKET_NAME
    if options.stop:
        return _stop(place)
    if options.foreground:
        print(READY if _serve(place, 60.0 * options.minutes) else _present(folder), flush=True)
        return Answer({})
    if is_held(folder / LOCK_NAME):
        return Answer({"socket": place}, [_present(folder)], [place])
    with open(folder / LOG_NAME, "wb") as log:
        os.chmod(log.fileno(), 0o600)
        minutes = ("--minutes", str(options.minutes))
        started = subprocess.Popen(
            [sys.executable, "-P", "-m", "pareto_ltl", "warm", "--foreground", *minutes],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, start_new_session=True, text=True,
        )  # fmt: skip
    assert started.stdout is not None
    said = started.stdout.readline().strip()
    if said != READY:
        raise DataError(f"the warm process did not start: {said or f'see {folder / LOG_NAME}'}")
    line = (
        f"process {started.pid} answers plans until it was idle for {options.minutes:g} minutes; "
        "pareto-ltl warm --stop ends it"
    )
    return Answer({"process": started.pid, "socket": place, "minutes": options.minutes}, [line], [place])


def _usable_folder() -> Path:
    if not (hasattr(socket, "SO_PEERCRED") and hasattr(os, "pidfd_open")):
        raise ConfigError("a warm process needs Linux: here each command runs by itself")
    folder = warm_folder()
    if len(os.fsencode(folder / SOCKET_NAME)) > LONGEST_PATH:
        raise ConfigError(
            f"{folder} is too long for the name of a socket: let XDG_RUNTIME_DIR or PARETO_LTL_CACHE name a "
            "shorter folder"
        )
    make_private(folder)
    try:
        check_folder(folder)
    except UnsafeError as error:
        raise DataError(str(error)) from None
    return folder


def _present(folder: Path) -> str:
    """The line about the warm process that is there; the note in its lock names it."""
    note = (folder / LOCK_NAME).read_bytes()[NOTE_START:].decode(errors="replace").strip()
    return f"there is a warm process already ({note}); pareto-ltl warm --stop ends it"


def _stop(place: Path) -> Answer:
    """Ask the warm process to end; it does when the runs that it has begun have ended."""
    try:
        with connected(place) as connection:
            send_message(connection, {"stop": True})
            runs, _ = read_message(connection)
    except (OSError, ValueError):
        return Answer({"stopped": False}, ["there is no warm process"])
    number = int(runs.get("runs", 0))
    last = f", after the {number} runs that it has begun" * (number > 0)
    return Answer({"stopped": True, "runs": number}, [f"the warm process ends{last}"])


# --- the process -----------------------------------------------------------------------------------


def _serve(place: Path, idle: float) -> bool:
    """Load, then answer until the process was idle for ``idle`` [s]; False if there is another one."""
    from pareto_ltl_apps.cli.commands import run_command_line

    try:
        with hold_lock(place.parent / LOCK_NAME, wait=False, note=process_note()):
            loaded_as = identity()
            load(run_command_line)
            place.unlink(missing_ok=True)  # of a process that was killed
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
                listener.bind(os.fspath(place))
                listener.listen(BACKLOG)
                print(READY, flush=True)
                try:
                    Warm(listener, place, loaded_as, idle, run_command_line).serve()
                finally:
                    place.unlink(missing_ok=True)
    except TakenError:
        return False
    return True


def load(run: Run) -> None:
    """Import what a plan needs, and make a small one of each preset, whose machine code then is in memory."""
    for name in (*WARMED, *LOADED):
        import_module(name)
    for preset in Settings.PRESETS:
        load_kernels(run, f"fidelity={preset}")
    for thread in threading.enumerate():  # imports in the background
        if thread is not threading.current_thread():
            thread.join()


@dataclass
class Warm:
    """A process that answers the command lines of its user, each in a child process.

    Attributes
    ----------
    listener : socket
        Accepts connections at ``place``.
    loaded_as : str
        The :func:`~.warm_client.identity` of this process when it began to load.
    idle : float
        Time without a run after which it ends [s].
    run : callable
        Runs a command line and returns its exit code.
    """

    listener: socket.socket
    place: Path
    loaded_as: str
    idle: float
    run: Run
    children: dict[int, tuple[int, socket.socket]] = field(default_factory=dict)  # handle -> process, client
    ending: bool = False

    def serve(self) -> None:
        """Answer until it is time to end."""
        mine, last = os.lstat(self.place), time.monotonic()
        with selectors.DefaultSelector() as ready:
            ready.register(self.listener, selectors.EVENT_READ)
            while self.children or not self.ending:
                wait = min(GLANCE, max(0.0, last + self.idle - time.monotonic()))
                for key, _ in ready.select(GLANCE if self.children else wait):
                    if key.fileobj is self.listener:
                        self._accept(ready)
                    else:
                        self._reap(ready, key.fd)
                    last = time.monotonic()
                self.ending |= not self.children and time.monotonic() - last >= self.idle
                self.ending |= not self._is_current(mine)

    def _is_current(self, mine: os.stat_result) -> bool:
        """Whether the socket is still the one of this process, and the source the one that it has loaded."""
        try:
            return os.path.samestat(os.lstat(self.place), mine) and identity() == self.loaded_as
        except OSError:
            return False

    def _accept(self, ready: selectors.BaseSelector) -> None:
        """Begin the command line of the next client, or refuse it."""
        client, _ = self.listener.accept()
        client.settimeout(PATIENCE)
        streams: list[int] = []
        try:
            check_peer(client)
            message, streams = read_message(client, len(STREAMS))
            if message.get("stop"):
                self.ending = True
                send_message(client, {"runs": len(self.children)})
            elif request := self._request_of(message, streams):
                handle = self._fork(request, client, streams, ready)
                ready.register(handle, selectors.EVENT_READ)
                return
            else:
                send_message(client, {"refused": True})
            client.close()
        except (OSError, ValueError, UnsafeError):
            client.close()
        finally:
            for stream in streams:
                os.close(stream)

    def _request_of(self, message: dict[str, Any], streams: list[int]) -> Request | None:
        """The request of a client that this process can answer as the client would itself, else None."""
        alone = threading.active_count() == 1  # no other thread would exist in a child
        same = message.get("identity") == self.loaded_as == identity()
        return Request.of(message) if same and alone and len(streams) == len(STREAMS) else None

    def _fork(
        self, request: Request, client: socket.socket, streams: list[int], ready: selectors.BaseSelector
    ) -> int:
        """A child process that runs ``request``; returns its handle."""
        process = os.fork()
        if process:
            handle = os.pidfd_open(process)
            self.children[handle] = process, client
            return handle
        code = 1
        try:
            ready.close()
            self.listener.close()
            for other, (_, connection) in self.children.items():
                os.close(other)
                connection.close()
            code = answer(request, client, streams, self.run)
        finally:
            os._exit(code)

    def _reap(self, ready: selectors.BaseSelector, handle: int) -> None:
        """A child has ended; tell its client if a signal did it."""
        process, client = self.children.pop(handle)
        ready.unregister(handle)
        os.close(handle)
        _, status = os.waitpid(process, 0)
        if (code := os.waitstatus_to_exitcode(status)) < 0:
            with suppress(OSError):
                send_message(client, {"code": 128 - code})
        client.close()


# --- a child ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Request:
    """A command line, and what its process would have inherited."""

    program: str
    argv: list[str]
    folder: str
    environment: dict[str, str]
    umask: int
    ignored: list[int]

    @classmethod
    def of(cls, message: dict[str, Any]) -> Request:
        """The request in a message; ValueError if it is none."""
        argv, environment, ignored = (message.get(name) for name in ("argv", "environment", "ignored"))
        if not (isinstance(argv, list) and isinstance(environment, dict) and isinstance(ignored, list)):
            raise ValueError("not a request")
        program, folder, umask = (message.get(name) for name in ("program", "folder", "umask"))
        texts = (program, folder, *argv, *environment, *environment.values())
        if not all(isinstance(t, str) for t in texts) or not all(
            isinstance(n, int) for n in (umask, *ignored)
        ):
            raise ValueError("not a request")
        return cls(str(program), argv, str(folder), environment, int(umask or 0), ignored)


def answer(request: Request, client: socket.socket, streams: list[int], run: Run) -> int:
    """Run ``request`` as a new process would; send its number at first and its exit code at last."""
    for number in (*FORWARDED, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN if number in request.ignored else signal.SIG_DFL)
    if signal.SIGINT not in request.ignored:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(request.environment)
    os.umask(request.umask)
    os.chdir(request.folder)
    for number, stream in zip(STREAMS, streams, strict=True):
        os.dup2(stream, number)
        os.close(stream)
    opened = partial(open, encoding=sys.stdout.encoding, errors="replace", closefd=False)  # as console.main
    own = {"stdin": opened(0), "stdout": opened(1, "w"), "stderr": opened(2, "w", buffering=1)}
    for name, opened_stream in own.items():
        setattr(sys, name, opened_stream)
        setattr(sys, f"__{name}__", opened_stream)
    sys.argv, tempfile.tempdir = [request.program, *request.argv], None
    send_message(client, {"process": os.getpid()})
    threading.Thread(target=_end_with, args=(client,), daemon=True).start()
    code = run(request.argv)
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    atexit._run_exitfuncs()  # noqa: SLF001 - what the end of a process calls
    client.settimeout(PATIENCE)
    with suppress(OSError):
        send_message(client, {"code": code})
    return code


def _end_with(client: socket.socket) -> None:
    """End this process when its client has ended, as a run without a warm process would with it."""
    client.settimeout(None)
    with suppress(OSError):
        client.recv(1)
    os.kill(os.getpid(), signal.SIGTERM)  # a run records how it ended; see pareto_ltl_apps/stopping.py
    time.sleep(LAST_WORDS)
    os._exit(128 + signal.SIGTERM)
