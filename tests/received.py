"""Results directories as another person may send them, and what a command does with them."""

from __future__ import annotations

import os
import shutil
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from guard import sitecustomize as guard

GUARD = Path(guard.__file__).parent
TELEMETRY = "time,heading_true,airspeed_cas_m_s\n0,90,20\n60,90,20\n120,90,20\n"
# Every command that reads a results directory, with the words that it needs besides; all of them end.
COMMANDS: dict[str, tuple[str, ...]] = {
    "front": (),
    "show": ("--print",),
    "explain": (),
    "verify": (),
    "choose": ("--point", "0"),
    "export": (),
    "replan": ("--time", "2h"),
    "beacons": ("--flights", "100"),
    "contain": ("--flights", "1000"),
    "check": ("--wind", "LOG", "limits.failure=0.5"),
    "follow": ("--log", "LOG"),
    "rerun": (),
}


def words_of(command: str, place: Path, log: Path) -> list[str]:
    """The command line of ``command`` for the results directory ``place``."""
    return [command, str(place), *(str(log) if word == "LOG" else word for word in COMMANDS[command])]


def received(made: Path, place: Path, **changes: Any) -> Path:
    """A copy of ``made`` whose settings have ``changes``: ``evaluation__cluster=...``."""
    shutil.copytree(made, place)
    file = place / "config_resolved.yaml"
    content = yaml.safe_load(file.read_text())
    for key, value in changes.items():
        section, _, name = key.partition("__")
        content[section][name] = value
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    return place


@contextmanager
def no_connections(monkeypatch: pytest.MonkeyPatch, notes: Path) -> Iterator[Path]:
    """In the block, this process and those that it starts connect nowhere; ``notes`` lists attempts."""
    notes.write_text("")
    with monkeypatch.context() as patched:
        patched.setenv("PARETO_LTL_NOTES", str(notes))
        before = os.environ.get("PYTHONPATH")
        patched.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(GUARD), before))))
        for name, method in guard.METHODS.items():
            patched.setattr(socket.socket, name, method)
        patched.setattr(socket, "getaddrinfo", guard.look_up)
        yield notes


@dataclass
class Listener:
    """A server on this machine that answers nothing, in place of a scheduler of Dask or a mirror."""

    port: int = 0
    heard: list[bytes] = field(default_factory=list)


@contextmanager
def listening() -> Iterator[Listener]:
    """In the block, a server that notes each connection, and closes it."""
    found = Listener()
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        found.port = server.getsockname()[1]

        def serve() -> None:
            while True:
                try:
                    with server.accept()[0] as connection:
                        connection.settimeout(0.2)
                        try:
                            found.heard.append(connection.recv(1000))
                        except OSError:
                            found.heard.append(b"")
                except OSError:
                    return

        threading.Thread(target=serve, daemon=True).start()
        yield found
        server.shutdown(socket.SHUT_RDWR)


OPENED: list[str] | None = None


def _note_open(event: str, arguments: tuple[Any, ...]) -> None:
    if OPENED is not None and event in ("open", "os.listdir", "os.scandir", "glob.glob"):
        OPENED.append(os.fspath(arguments[0]) if isinstance(arguments[0], str | os.PathLike) else "")


sys.addaudithook(_note_open)


@contextmanager
def opened_paths() -> Iterator[list[str]]:
    """In the block, the list grows by each path that this process opens or lists."""
    global OPENED  # noqa: PLW0603 - a hook of Python stays for the life of the process
    OPENED = []
    try:
        yield OPENED
    finally:
        OPENED = None


def contents(folder: Path) -> dict[str, bytes | str]:
    """All below ``folder`` by name: the bytes of files, the targets of links."""
    return {
        path.relative_to(folder).as_posix(): os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_symlink() or path.is_file()
    }
