"""A peer as a child process: one JSON object per line in each direction."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


class Peer:
    """A script of this folder, run by the Python of its own environment."""

    def __init__(self, name: str, environments: Path) -> None:
        self.name = name
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - as long as the peer lives
        python = environments / name / "bin" / "python"
        self.process = subprocess.Popen(
            [python, HERE / f"{name}_peer.py"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self.errors, text=True,
        )  # fmt: skip

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to ``request``. Raises RuntimeError with the peer's last error output if it stops."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            self.errors.seek(0)
            raise RuntimeError(f"{self.name} stopped: {self.errors.read()[-2000:]}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def missing(name: str, environments: Path) -> str | None:
    """One line that says what to install for the peer; None if everything is installed."""
    if not (environments / name / "bin" / "python").exists():
        return f"{name}: not in {environments / name}, left out; to install it: make build/peers/{name}"
    if name == "mona" and shutil.which("mona") is None:
        return "mona: the program is not on PATH, left out; to install it: apt-get install mona"
    return None


def serve(handle: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Answer the requests of standard input; what libraries print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    while line := sys.stdin.readline():
        print(json.dumps(handle(json.loads(line))), file=answers, flush=True)
    os._exit(0)  # without the reports of the bindings on what they leak
