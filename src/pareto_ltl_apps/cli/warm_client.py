"""A command line that a warm process (``pareto-ltl warm``), which has loaded all code, answers.

The two talk through a Unix socket in a folder that belongs to the user and that others cannot enter. Each
asks the system who the other one is. The client sends the words of the command line, its folder, its
environment and its three standard streams, which a child of the warm process takes over. Nothing else is
sent, and nothing received is executed. Where there is no warm process, or it has loaded another program than
this one, the program runs as usual.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

SOCKET_NAME = "warm.socket"
LONGEST_PATH = 100  # bytes of the name of a socket
MOST_BYTES = 2**22  # of a message
PATIENCE = 5.0  # [s] to wait for the begin of an answer
STREAMS = (0, 1, 2)
FORWARDED = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)
)
# Variables that are read while Python, numba and the libraries of linear algebra start.
READ_AT_START = (
    "PYTHON", "NUMBA", "OMP_", "OPENBLAS", "MKL_", "GOTO", "BLIS", "MPL", "LD_", "LC_", "LANG", "TZ",
    "PARETO_LTL", "COVERAGE",
)  # fmt: skip
SOURCES = Path(__file__).resolve().parents[2]  # folder of the installed packages
OURS = (
    "careful_io", "flight_quantities", "ltlf", "pareto_ltl", "pareto_ltl_apps", "pareto_ltl_verify",
    "plane_kernels", "plane_logic", "typed_kernels", "hydra_plugins", "wind_laws", "declared_settings",
)  # fmt: skip
NOT_WARM = {"warm", "warmup", "serve", "follow", "sweep", "verify", "rerun", "cache", "formula"}


class UnsafeError(Exception):
    """A socket or a folder that is not the user's alone."""


def warm_folder() -> Path:
    """The folder of the socket: of the session (``XDG_RUNTIME_DIR``), else in the user's cache."""
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(runtime) / "pareto_ltl"
    from pareto_ltl.support.cache import cache_root

    return cache_root() / "warm"


def identity() -> str:
    """Fingerprint of all that a process reads as it starts: two with the same one answer alike."""
    files = [
        (entry.path, entry.stat().st_mtime_ns, entry.stat().st_size)
        for folder in (*(SOURCES / name for name in OURS), *_added_folders())
        for entry in _files(folder)
    ]
    places = sys.path if sys.flags.safe_path else sys.path[1:]  # without the folder of the script
    packages = [(path, os.stat(path).st_mtime_ns) for path in places if os.path.isdir(path)]
    flags = repr(sys.flags).partition("safe_path")[0]
    environment = sorted((k, v) for k, v in os.environ.items() if k.startswith(READ_AT_START))
    parts = (sys.version, sys.prefix, flags, packages, sorted(files), environment, _limits())
    return hashlib.sha256(repr(parts).encode(errors="surrogateescape")).hexdigest()


def _added_folders() -> Iterator[Path]:
    """In a checkout, the choices and pipelines are beside the packages."""
    for name in ("conf", "pipelines"):
        if (folder := SOURCES.parent / name).is_dir():
            yield folder


def _files(folder: Path | str) -> Iterator[os.DirEntry[str]]:
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                if entry.name != "__pycache__":
                    yield from _files(entry.path)
            else:
                yield entry


def _limits() -> Any:
    """What the system lets this process use: limits, cores and priority."""
    import resource

    kinds = [getattr(resource, name) for name in dir(resource) if name.startswith("RLIMIT_")]
    limits = [resource.getrlimit(kind) for kind in kinds]
    return limits, sorted(os.sched_getaffinity(0)), os.getpriority(os.PRIO_PROCESS, 0)


# --- the other side is the user's ------------------------------------------------------------------


def check_folder(folder: Path) -> None:
    """Raise UnsafeError if ``folder`` is a link, another user's, or open to others."""
    found = os.lstat(folder)
    if not (found.st_mode & 0o170000 == 0o040000 and found.st_uid == os.geteuid()):
        raise UnsafeError(f"{folder} is no folder of yours")
    if found.st_mode & 0o077:
        raise UnsafeError(f"{folder} is open to others (mode {found.st_mode & 0o777:o}; chmod 700)")


def check_peer(connection: socket.socket) -> None:
    """Raise UnsafeError if the process at the other end is another user's."""
    size = struct.calcsize("3i")
    _, user, _ = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    if user != os.geteuid():
        raise UnsafeError("the other process is another user's")


# --- messages --------------------------------------------------------------------------------------


def send_message(connection: socket.socket, message: Mapping[str, Any], streams: Sequence[int] = ()) -> None:
    """Send ``message`` as its length and JSON, with the file descriptors ``streams``."""
    content = json.dumps(message).encode()
    head = struct.pack("!I", len(content))
    if streams:
        socket.send_fds(connection, [head], list(streams))
    else:
        connection.sendall(head)
    connection.sendall(content)


def read_message(connection: socket.socket, streams: int = 0) -> tuple[dict[str, Any], list[int]]:
    """A message and its file descriptors, at most ``streams``; ValueError if it is none."""
    head, got = b"", list[int]()
    if streams:
        head, got, _, _ = socket.recv_fds(connection, 4, streams)
    else:
        head = connection.recv(4, socket.MSG_WAITALL)
    try:
        (length,) = struct.unpack("!I", head) if len(head) == 4 else (0,)
        if not 0 < length <= MOST_BYTES:
            raise ValueError("a message has a length")
        content = bytearray()
        while len(content) < length:
            if not (piece := connection.recv(length - len(content))):
                raise ValueError("a message was cut")
            content += piece
        message = json.loads(content)
        if not isinstance(message, dict):
            raise ValueError("a message is an object")
    except BaseException:
        for handle in got:
            os.close(handle)
        raise
    return message, got


# --- the client ------------------------------------------------------------------------------------


def warm_answer(argv: Sequence[str]) -> int | None:
    """The exit code of the command line ``argv`` in a warm process; None if it runs here."""
    if not hasattr(socket, "SO_PEERCRED") or not _may_be_warm(argv):
        return None
    place = warm_folder() / SOCKET_NAME
    if not os.path.lexists(place):
        return None
    try:
        with connected(place) as connection:
            send_message(connection, _request(argv), STREAMS)
            begun, _ = read_message(connection)
            process = begun.get("process")
            if not isinstance(process, int) or process <= 1:
                return None  # it is not as this program, and ends
            connection.settimeout(None)
            return _watched(connection, process)
    except (OSError, ValueError, UnsafeError) as error:
        if isinstance(error, UnsafeError):
            print(f"pareto-ltl: not asking the warm process: {error}", file=sys.stderr)
        return None


def _may_be_warm(argv: Sequence[str]) -> bool:
    """Whether a command is one that loading takes a large part of; help and version need no package."""
    words = set(argv)
    return not words & (NOT_WARM | {"-h", "--help", "--help=all", "--help-all", "--version", "-sc", "-m"})


@contextmanager
def connected(place: Path) -> Iterator[socket.socket]:
    """A connection to the socket ``place``, after the checks of both sides."""
    check_folder(place.parent)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(PATIENCE)
        connection.connect(os.fspath(place))
        check_peer(connection)
        yield connection


def _request(argv: Sequence[str]) -> dict[str, Any]:
    umask = os.umask(0o077)
    os.umask(umask)
    ignored = [number for number in FORWARDED if signal.getsignal(number) is signal.SIG_IGN]
    return {
        "identity": identity(), "program": sys.argv[0], "argv": list(argv), "folder": os.getcwd(),
        "environment": dict(os.environ), "umask": umask, "ignored": ignored,
    }  # fmt: skip


def _watched(connection: socket.socket, process: int) -> int:
    """Pass signals to ``process`` until it ends; its exit code."""

    def forward(number: int, _frame: object) -> None:
        with suppress(ProcessLookupError):
            os.kill(process, number)

    def pause(_number: int, _frame: object) -> None:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGSTOP)
            os.kill(os.getpid(), signal.SIGSTOP)  # until the shell continues this process
            os.kill(process, signal.SIGCONT)

    for number in FORWARDED:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, forward)
    signal.signal(signal.SIGTSTP, pause)
    try:
        ended, _ = read_message(connection)
    except (OSError, ValueError):
        ended = {}
    if isinstance(code := ended.get("code"), int):
        return code
    print("pareto-ltl: the warm process was killed; run the command again", file=sys.stderr)
    return 1
