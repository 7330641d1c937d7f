"""Run an installer and show how far it is: an amount, and the time that is left."""

from __future__ import annotations

import queue
import re
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from threading import Thread

ROOT = Path(__file__).resolve().parents[1]
PACE = {True: 0.2, False: 10.0}  # [s] between two lines of progress, on a terminal and in a file


def watched(
    command: list[str], what: str, seconds: int, total: int, environment: Mapping[str, str]
) -> str | None:
    """Run ``command`` and show how far it is; None, or what it said if it failed.

    ``seconds`` is how long it usually takes, ``total`` the number of packages, 0 where it is not known.
    """
    print(f"installing {what}" + (f": about {seconds} s" if seconds else ""), flush=True)
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        errors="replace", env=dict(environment), cwd=ROOT,
    )  # fmt: skip
    lines: queue.Queue[str | None] = queue.Queue()
    Thread(target=_read_lines, args=(process, lines), daemon=True).start()
    progress, terminal = Progress(total), sys.stdout.isatty()
    began = shown_at = time.monotonic()
    try:
        while True:
            with suppress(queue.Empty):
                line = lines.get(timeout=0.1)
                if line is None:
                    break
                progress.heard(line)
            now = time.monotonic()
            if now - shown_at >= PACE[terminal]:
                shown_at = now
                text = progress.line(now - began)
                print(f"\r\033[K{text[:78]}" if terminal else text, end="" if terminal else "\n", flush=True)
    except BaseException:
        process.terminate()
        process.wait()
        raise
    finally:
        if terminal:
            print("\r\033[K", end="", flush=True)
    failed = process.wait() != 0
    if not failed:
        print(f"  done in {time.monotonic() - began:.0f} s", flush=True)
    return "".join(progress.said) or f"ended with {process.returncode}" if failed else None


def _read_lines(process: subprocess.Popen[str], lines: queue.Queue[str | None]) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        lines.put(line)
    lines.put(None)


class Progress:
    """How far an installer is, from the lines that it prints: MB of uv, packages of pip."""

    def __init__(self, total: int) -> None:
        self.total, self.said, self.collected, self.now = total, list[str](), 0, "asking the package index"
        self.sizes: dict[str, float] = {}
        self.fetched: set[str] = set()

    def heard(self, line: str) -> None:
        """Take a line of the installer into account."""
        self.said.append(line)
        words = line.split()
        if match := re.match(r"\s*Downloading ([\w.-]+) \(([\d.]+)([KMG])iB\)", line):  # uv
            self.sizes[match[1]] = float(match[2]) * {"K": 1e-3, "M": 1.049, "G": 1074.0}[match[3]]
            self.now = "downloading"
        elif line.startswith(" Downloaded"):
            self.fetched.add(words[1])
        elif line.startswith("Prepared"):
            self.now = "unpacking"
        elif words[:1] in (["Collecting"], ["Processing"]):  # pip
            self.collected += 1
            self.now = words[1].partition("==")[0]
        elif line.startswith(("Building", "Installing collected")):
            self.now = "unpacking" if words[0] == "Installing" else " ".join(words[:4])

    def line(self, elapsed: float) -> str:
        """What is done after ``elapsed`` seconds, and how long the rest takes."""
        whole = sum(self.sizes.values())
        done = sum(size for name, size in self.sizes.items() if name in self.fetched)
        parts = [f"  {elapsed:.0f} s"]
        share = 0.0
        if whole:
            parts.append(f"{done:.0f} of {whole:.0f} MB")
            share = done / whole
        elif self.collected and self.total:
            parts.append(f"{min(self.collected, self.total)} of {self.total} packages")
            share = min(self.collected / self.total, 1.0)
        if 0.1 < share < 1.0 and self.now != "unpacking":
            parts.append(f"about {elapsed * (1 - share) / share:.0f} s left")
        return ", ".join([*parts, self.now])
