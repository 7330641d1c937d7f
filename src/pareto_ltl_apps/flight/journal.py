"""The journal of a watch: ``follow.jsonl`` has every event, one JSON object a line, appended and flushed.

Its lines ``flown`` and ``fix`` are all that the belief depends on: :func:`read_journal` gives them back after
the process was killed, and the watch continues with the same belief. :data:`FIELDS` is the schema: what every
event of a kind has, and what type; other keys, and events of other kinds, are passed on as they are.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

from careful_io.links import open_unlinked
from careful_io.messages import shown_value
from careful_io.reading import refuse_special
from pareto_ltl.support.errors import ConfigError, DataError

NAME = "follow.jsonl"
SCHEMA = "pareto_ltl.follow/2"
SAFE = ("fix", "status", "alarm", "end")  # events after which the disk has all of them
LONGEST = 1_000_000  # characters of a line
HUGE = 1e12  # of a number; also keeps out NaN
FASTEST = 1e3  # [m/s] of what was flown


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < HUGE


def _pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_number, value))


def _text(value: object) -> bool:
    return isinstance(value, str)


def _flag(value: object) -> bool:
    return isinstance(value, bool)


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and _number(value) and value > 0.0


def _one_of(*allowed: str) -> Callable[[object], bool]:
    return lambda value: value in allowed


def _or_null(check: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: value is None or check(value)


Fields = dict[str, Callable[[object], bool]]
BELIEVED: Fields = {
    "x": _number, "y": _number, "major": _number, "minor": _number, "angle": _number, "failure": _number,
    "energy": _or_null(_number), "shown": _flag, "law": _text,
}  # fmt: skip
FIELDS: dict[str, Fields] = {
    "begin": {"schema": _text, "plan": _text, "formula": _text, "departure": _or_null(_text),
              "members": _number},
    "waiting": {"seconds": _number},
    "flown": {"seconds": _positive, "east": _number, "north": _number},
    "fix": {"place": _pair, "given": _pair, "sd": _positive, "distance": _number,
            "use": _one_of("learnt", "refused", "restarted")},
    "status": BELIEVED,
    "goal": {"goal": lambda value: isinstance(value, list), "planned": _number, "probability": _number,
             "late": _flag},
    "alarm": {"kind": _text, "text": _text, "advice": _text},
    "sent": {"text": _text},
    "answered": {"text": _text},
    "replanned": {"directory": _text, "at": _number},
    "switched": {"directory": _text, "at": _number, "known": lambda value: isinstance(value, list)},
    "unused": {"refused": lambda value: isinstance(value, dict)},
    "end": {**BELIEVED, "complete": _number, "refused": lambda value: isinstance(value, dict)},
}  # fmt: skip


class Journal:
    """Appends events to a file; a disk that is full is reported once, and the watch goes on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failed = ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.file: TextIO = os.fdopen(open_unlinked(path, os.O_RDWR | os.O_APPEND), "a", encoding="utf-8")
            os.truncate(self.file.fileno(), _whole(path.read_bytes()))  # without a last line that is damaged
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


def _whole(data: bytes) -> int:
    """How many bytes are whole lines, of which the last one is an event."""
    end = data.rfind(b"\n") + 1
    last = data[data.rfind(b"\n", 0, max(end - 1, 0)) + 1 : end]
    return end if not last or not isinstance(_parsed(last), str) else end - len(last)


def read_journal(path: Path) -> Iterator[dict[str, Any]]:
    """The events of a file; a last line that was cut off or is damaged is left out.

    Raises
    ------
    DataError
        If the file cannot be read, or another line is damaged or no event of :data:`FIELDS`.
    """
    refuse_special(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); start without --resume") from None
    for number, line in enumerate(data[: _whole(data)].splitlines(), 1):
        event = _parsed(line)
        if isinstance(event, dict) and event.get("schema", SCHEMA) != SCHEMA:
            event = f"expected the schema {SCHEMA!r}, found {shown_value(event['schema'])}"
        if isinstance(event, str):
            raise DataError(
                f"{path}, line {number}: {event}; start a new watch with another --out, without --resume"
            )
        yield event


def _parsed(line: bytes) -> dict[str, Any] | str:
    """The event of a line, or what is wrong with it."""
    try:
        event = json.loads(line.decode("utf-8", "replace"), parse_constant=lambda _: None)
    except (ValueError, RecursionError):
        event = None
    if len(line) > LONGEST or not isinstance(event, dict) or not isinstance(event.get("event"), str):
        return "no event"
    event = {_readable(key): _readable(value) for key, value in event.items()}
    kind = event["event"]
    for name, check in {"time": _number, **FIELDS.get(kind, {})}.items():
        if name not in event:
            return f"the event {kind} has no {name}"
        if not check(event[name]):
            return f"{name} of the event {kind} is {shown_value(event[name])}"
    if kind == "flown" and max(abs(event["east"]), abs(event["north"])) > FASTEST * event["seconds"]:
        return f"the event {kind} is faster than {FASTEST:g} m/s"
    return event


def _readable(value: Any) -> Any:
    """``value`` without halves of characters, which cannot be printed or written."""
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value


def damaged_end(path: Path) -> int:
    """Bytes at the end of a journal that are no event, and are left out."""
    data = path.read_bytes()
    return len(data) - _whole(data)


def require_place(folder: Path, *, resume: bool) -> Path:
    """The journal of ``folder``; ConfigError if one is there that would be mixed with another flight."""
    path = folder / NAME
    if path.exists() and not resume:
        raise ConfigError(f"{path} is there already: give --resume to continue it, or another --out")
    if resume and not path.exists():
        raise ConfigError(f"{path}: there is no journal to resume; start without --resume")
    return path
