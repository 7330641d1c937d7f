"""``follow.jsonl``: every event of a watch, one JSON object a line, appended and flushed.

The lines ``flown`` and ``fix`` are all that the belief depends on: :func:`read_journal` gives them back after
the process was killed, and the watch continues with the same belief.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

from pareto_ltl.support.errors import ConfigError, DataError

NAME = "follow.jsonl"
SCHEMA = "pareto_ltl.follow/1"
SAFE = ("fix", "status", "alarm", "end")  # events after which the disk has all of them


class Journal:
    """Appends events to a file; a disk that is full is reported once, and the watch goes on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failed = ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():  # without a line that was cut off when a watch was killed
                os.truncate(path, path.read_bytes().rfind(b"\n") + 1)
            self.file: TextIO = path.open("a", encoding="utf-8")
        except OSError as error:
            raise DataError(f"{path}: cannot be written ({error}); name another folder with --out") from None

    def write(self, event: Mapping[str, Any]) -> None:
        """Append ``event``; after a status, a fix or an alarm wait until it is on the disk."""
        if self.failed:
            return
        try:
            self.file.write(json.dumps(event, allow_nan=False, separators=(",", ":")) + "\n")
            self.file.flush()
            if event["event"] in SAFE:
                os.fsync(self.file.fileno())
        except OSError as error:
            self.failed = f"{self.path}: {error}"

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def read_journal(path: Path) -> Iterator[dict[str, Any]]:
    """The events of a file; a last line without an end was cut off, and is left out.

    Raises
    ------
    DataError
        If the file cannot be read, or another line is damaged.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); start without --resume") from None
    for number, line in enumerate(text[: text.rfind("\n") + 1].splitlines(), 1):
        try:
            event = json.loads(line)
            if not isinstance(event, dict) or not isinstance(event.get("event"), str):
                raise ValueError
        except ValueError:
            raise DataError(f"{path}, line {number}: no event; start without --resume") from None
        yield event


def require_place(folder: Path, *, resume: bool) -> Path:
    """The journal of ``folder``; ConfigError if one is there that would be mixed with another flight."""
    path = folder / NAME
    if path.exists() and not resume:
        raise ConfigError(f"{path} is there already: give --resume to continue it, or another --out")
    if resume and not path.exists():
        raise ConfigError(f"{path}: there is no journal to resume; start without --resume")
    return path
